"""Quality of service: what happens when a subscription asks for more than is offered."""

import asyncio

from simple_ros import DEFAULT, SENSOR_DATA, QosEvent, aio
from simple_ros.msg.sensor_msgs import Range


async def main() -> None:
    told = asyncio.Event()

    def on_event(event: QosEvent) -> None:
        print(f"event: {event}")
        told.set()

    async with aio.NodeHandle("rangefinder") as sensor, aio.NodeHandle("brake") as brake:
        await sensor.advertise("range", Range, qos=SENSOR_DATA)  # offers best effort
        await brake.subscribe("range", Range, print, qos=DEFAULT, on_event=on_event)
        await told.wait()


aio.run(main())
