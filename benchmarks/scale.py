"""200 nodes and 2,000 topics on one Master: cost per registration, push latency, memory, CPU, time to list."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import psutil
from rest import MIN_SECONDS, a_master, cpu_s

from simple_ros.aio import NodeHandle, Publisher
from simple_ros.benchmark.peers import Peer
from simple_ros.graph_source import fetch_graph
from simple_ros.msg.example import SensorData
from simple_ros.net.master_client import MasterClient

NODES = 200
TOPICS_EACH = 10
WINDOW = 200
LISTINGS = 5


def measure(seconds: float = 10.0) -> dict[str, Any]:
    """One round, with a Master of its own."""
    with a_master() as (process, address):
        return asyncio.run(_measure(address, psutil.Process(process.pid), seconds))


async def _measure(address: str, master: psutil.Process, seconds: float) -> dict[str, Any]:
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
    pushes = await _subscribed(nodes, publishers)
    full = master.memory_info().rss
    listing = await _listed(address)
    percent = await _at_rest(master.pid, seconds)
    await asyncio.gather(*(node.close() for node in nodes))
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
        "percent": percent,
        **listing,
    }


async def _subscribed(
    nodes: list[NodeHandle], publishers: list[Publisher[SensorData]]
) -> list[float]:
    """How long from the call of subscribe until the publisher knows, sorted."""
    pushes: list[float] = []
    for index, publisher in enumerate(publishers):
        subscriber = nodes[(index // TOPICS_EACH + 1) % NODES]
        begun = time.perf_counter()
        await subscriber.subscribe(publisher.topic, SensorData, lambda message: None)
        while not publisher.targets:
            await asyncio.sleep(0)
        pushes.append(time.perf_counter() - begun)
    return sorted(pushes)


async def _listed(address: str) -> dict[str, float]:
    """How long the whole graph takes, and the command that lists topics."""
    client = MasterClient(address)
    graph_s, command_s = [], []
    for _ in range(LISTINGS):
        begun = time.perf_counter()
        graph = await fetch_graph(client)
        graph_s.append(time.perf_counter() - begun)
        if len(graph.nodes) != NODES:
            raise SystemExit(f"the Master lists {len(graph.nodes)} nodes instead of {NODES}")
    await client.close()
    command = [sys.executable, "-m", "simple_ros.cli.main", "topic", "list", "--master", address]
    for _ in range(LISTINGS):
        begun = time.perf_counter()
        # In a thread: the nodes of this process must go on.
        await asyncio.to_thread(subprocess.run, command, check=True, capture_output=True)
        command_s.append(time.perf_counter() - begun)
    return {
        "graph_ms": 1e3 * sorted(graph_s)[LISTINGS // 2],
        "topic_list_ms": 1e3 * sorted(command_s)[LISTINGS // 2],
    }


async def _at_rest(pid: int, seconds: float) -> float:
    """CPU of the Master while nothing changes, in percent of a core."""
    seconds = max(MIN_SECONDS, seconds)
    begun = cpu_s(pid)
    await asyncio.sleep(seconds)
    return 100 * (cpu_s(pid) - begun) / seconds


def measure_all(seconds: float, peers: Sequence[Peer]) -> dict[str, Any]:
    found = measure(seconds)
    rows = [
        ("registration, first 200 of 4,000", f"{found['first_us'] / 1e3:.2f} ms"),
        (
            "registration, last 200",
            f"{found['last_us'] / 1e3:.2f} ms ({found['growth']:.2f} times)",
        ),
        (
            "from `subscribe` until the publisher knows",
            f"{found['push_p50_ms']:.2f} ms p50, {found['push_p99_ms']:.2f} ms p99",
        ),
        (
            "memory, empty and full",
            f"{found['rss_start_mb']:.0f} and {found['rss_full_mb']:.0f} MB",
        ),
        ("CPU at rest, 200 nodes", f"{found['percent']:.2f} % of a core"),
        ("the whole graph", f"{found['graph_ms']:.0f} ms"),
        ("`simple-ros topic list`, whole command", f"{found['topic_list_ms']:.0f} ms"),
    ]
    return found | {"rows": rows}


if __name__ == "__main__":
    for what, value in measure_all(10.0, ())["rows"]:
        print(f"{what:<45}{value}")
