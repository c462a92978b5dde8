"""What the relay costs: CPU of its process, and what it adds to a message's way, with a camera's stream.

The camera, the relay and the listener are processes of their own. The same stream is sent straight to the listener as well,
for comparison.

python benchmarks/network_exposure/relay_load.py        bar: 1280x720 at 30 Hz below 27 % of a core (the paper)
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import statistics
import time
from multiprocessing.connection import Connection

import numpy as np
import psutil

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.large import large
from simple_ros.msg.sensor_msgs import Image
from simple_ros_engines.network_exposure.relay import FlowRelay
from simple_ros_master import Master

LargeImage = large(Image)


def relay(address: str) -> None:
    async def work() -> None:
        async with NodeHandle("flow_relay", master=address, arguments=Arguments()) as node:
            await FlowRelay().run(node)

    asyncio.run(work())


def listener(address: str, topic: str, out: Connection) -> None:
    """Sends back the seconds that each picture took."""

    async def work() -> None:
        times: list[float] = []

        def came(image: object) -> None:
            stamp = image.fields.header.stamp  # type: ignore[attr-defined]
            times.append(time.time() - stamp.ToNanoseconds() / 1e9)

        async with NodeHandle("listener", master=address, arguments=Arguments()) as node:
            await node.subscribe(topic, LargeImage, came)
            out.send("ready")
            await asyncio.to_thread(out.recv)
            out.send(times)

    asyncio.run(work())


async def measure(
    width: int, height: int, rate_hz: float, seconds: float, *, relayed: bool
) -> None:
    source = "image_qos" if relayed else "image"
    near, far = multiprocessing.Pipe()
    async with Master(host="127.0.0.1", port=0) as master:
        processes = [multiprocessing.Process(target=listener, args=(master.address, "image", far))]
        if relayed:
            processes.append(multiprocessing.Process(target=relay, args=(master.address,)))
        for process in processes:
            process.start()
        try:
            await asyncio.to_thread(near.recv)
            async with NodeHandle("camera", master=master.address, arguments=Arguments()) as node:
                publisher = await node.advertise(source, LargeImage)
                await publisher.wait_for_subscribers(1, 20)
                watched = psutil.Process(processes[-1].pid)
                pixels = np.zeros((height, width, 3), np.uint8)
                begun, cpu = time.monotonic(), sum(watched.cpu_times()[:2])
                for number in range(int(rate_hz * seconds)):
                    head = Image(height=height, width=width, encoding="rgb8", step=3 * width)
                    head.header.stamp.FromNanoseconds(time.time_ns())
                    publisher.publish(LargeImage(head, pixels))
                    await asyncio.sleep(max(0.0, begun + (number + 1) / rate_hz - time.monotonic()))
                took_s = time.monotonic() - begun
                share = 100 * (sum(watched.cpu_times()[:2]) - cpu) / took_s
            near.send("done")
            times = await asyncio.to_thread(near.recv)
        finally:
            for process in processes:
                process.terminate()
                process.join()
    sent = int(rate_hz * seconds)
    what = "relay" if relayed else "straight, listener"
    told = f"median {1000 * statistics.median(times):.2f} ms" if times else "nothing came"
    print(
        f"{width}x{height} at {rate_hz:g} Hz, {what}: {share:.1f} % of a core, {told}, {len(times)} of {sent}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=30.0)
    options = parser.parse_args()
    multiprocessing.set_start_method("spawn")
    for width, height in ((320, 240), (640, 480), (1280, 720)):
        for relayed in (False, True):
            asyncio.run(measure(width, height, options.rate, options.seconds, relayed=relayed))


if __name__ == "__main__":
    main()
