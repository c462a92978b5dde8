"""200 nodes and 2,000 topics on one Master: cost per registration, push latency, memory."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import time
from typing import Any

import psutil

from simple_ros.aio import NodeHandle, Publisher
from simple_ros.msg.example import SensorData

NODES = 200
TOPICS_EACH = 10
WINDOW = 200


def measure() -> dict[str, Any]:
    """One round, with a Master of its own."""
    process = subprocess.Popen(
        [sys.executable, "-m", "simple_ros_master", "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout is not None
        address = process.stdout.readline().rsplit(" ", 1)[1].strip()
        return asyncio.run(_measure(address, psutil.Process(process.pid)))
    finally:
        process.terminate()
        process.wait(5)


async def _measure(address: str, master: psutil.Process) -> dict[str, Any]:
    started = master.memory_info().rss
    nodes = [NodeHandle(f"node{index}", master=address) for index in range(NODES)]
    for node in nodes:
        await node.start()
        await node.wait_for_master()
    costs: list[float] = []
    publishers: list[Publisher[SensorData]] = []
    for node in nodes:
        for topic in range(TOPICS_EACH):
            begun = time.perf_counter()
            publishers.append(await node.advertise(f"{node.name}/topic{topic}", SensorData))
            costs.append(time.perf_counter() - begun)
    pushes: list[float] = []
    for index, publisher in enumerate(publishers):
        subscriber = nodes[(index // TOPICS_EACH + 1) % NODES]
        begun = time.perf_counter()
        await subscriber.subscribe(publisher.topic, SensorData, lambda message: None)
        while not publisher.targets:
            await asyncio.sleep(0)
        pushes.append(time.perf_counter() - begun)
    full = master.memory_info().rss
    await asyncio.gather(*(node.close() for node in nodes))
    pushes.sort()
    first, last = sum(costs[:WINDOW]) / WINDOW, sum(costs[-WINDOW:]) / WINDOW
    return {
        "registrations": len(costs) + len(pushes),
        "first_us": 1e6 * first,
        "last_us": 1e6 * last,
        "growth": last / first,
        "push_p50_ms": 1e3 * pushes[len(pushes) // 2],
        "push_p99_ms": 1e3 * pushes[int(0.99 * len(pushes))],
        "rss_start_mb": started / 1e6,
        "rss_full_mb": full / 1e6,
    }


if __name__ == "__main__":
    print(measure())
