"""Two nodes in one process: what one publishes, the other gets as the very same object.

Run by itself it starts both. On a robot, launch does: ``components: [components:camera, components:detector]``, or
``python -m simple_ros.components components:camera components:detector``.
"""

import asyncio

from simple_ros import aio
from simple_ros.components import component, run_components
from simple_ros.msg.sensor_msgs import Image

published = []


async def camera(node):
    publisher = await node.advertise("image", Image)
    await publisher.wait_for_subscribers()
    image = Image(height=1080, width=1920, encoding="rgb8", data=bytes(1920 * 1080 * 3))
    published.append(image)
    publisher.publish(image)


async def detector(node):
    subscriber = await node.subscribe("image", Image)
    image = await subscriber.receive()
    same = image is published[0]
    print(f"got an image of {len(image.data)} bytes, {'not copied' if same else 'a copy'}")


async def main():
    here = __name__
    await asyncio.wait_for(
        run_components([component(f"{here}:camera"), component(f"{here}:detector")]), 10
    )


if __name__ == "__main__":
    aio.run(main())
