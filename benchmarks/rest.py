"""What nodes cost when little happens: user+system CPU of whole processes, and memory, after their start.

``rest``: a Master, an idle node, a 100 Hz timer that publishes to one subscriber, bare loops that do the same, all at
the same time; then a launch of 50 nodes. ``start``: what imports take, ours and those of installed rivals.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
from peers_install import python_of, result_of

from simple_ros.benchmark.peers import Peer

FLEET = 50
SETTLE_S = 2.0
UP_LIMIT_S = 60.0
IMPORTS = 5
MIN_SECONDS = 1.0

IDLE = """
from simple_ros import aio
async def main():
    async with aio.NodeHandle("idle", master="{address}") as node:
        await node.wait_for_master()
        print("ready", flush=True)
        await node.spin()
aio.run(main())
"""
SUBSCRIBER = """
from simple_ros import aio
from simple_ros.msg.geometry_msgs import Twist
async def main():
    async with aio.NodeHandle("sink", master="{address}") as node:
        await node.subscribe("cmd_vel", Twist, lambda message: None)
        print("ready", flush=True)
        await node.spin()
aio.run(main())
"""
PUBLISHER = """
from simple_ros import aio
from simple_ros.msg.geometry_msgs import Twist
async def main():
    async with aio.NodeHandle("source", master="{address}") as node:
        publisher = await node.advertise("cmd_vel", Twist)
        await publisher.wait_for_subscribers(1, timeout=10)
        twist = Twist()
        def tick(event):
            twist.linear.x += 0.001
            publisher.publish(twist)
        node.create_timer(0.01, tick)
        print("ready", flush=True)
        await node.spin()
aio.run(main())
"""
BARE = """
import asyncio, socket
from simple_ros.msg.geometry_msgs_pb2 import Twist
async def main():
    server = socket.create_server(("127.0.0.1", 0))
    sock = socket.create_connection(server.getsockname())
    other, _ = server.accept()
    twist = Twist()
    print("ready", flush=True)
    while True:
        await asyncio.sleep(0.01)
        twist.linear.x += 0.001
        sock.sendall(twist.SerializeToString())
        other.recv(4096)
asyncio.run(main())
"""
BARE_BLOCKING = """
import socket, time
from simple_ros.msg.geometry_msgs_pb2 import Twist
server = socket.create_server(("127.0.0.1", 0))
sock = socket.create_connection(server.getsockname())
other, _ = server.accept()
twist = Twist()
print("ready", flush=True)
while True:
    time.sleep(0.01)
    twist.linear.x += 0.001
    sock.sendall(twist.SerializeToString())
    other.recv(4096)
"""
MEMBER = """
from simple_ros import aio
async def main():
    async with aio.NodeHandle("member") as node:
        await node.spin()
aio.run(main())
"""
LAUNCH_NODE = "  - {{node: member{index}, script: member.py}}"


@contextmanager
def child(*command: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """A process whose first line has come; it gets SIGTERM at the end."""
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | environment,
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait(20)


@contextmanager
def a_master() -> Iterator[tuple[subprocess.Popen[str], str]]:
    with child(sys.executable, "-m", "simple_ros_master", "--port", "0") as process:
        assert process.stdout is not None
        yield process, process.stdout.readline().rsplit(" ", 1)[1].strip()


def cpu_s(pid: int) -> float:
    """Computing time of a process until now: that of the scheduler, in nanoseconds, where there is such a file."""
    tasks = Path(f"/proc/{pid}/task")
    try:
        return (
            sum(int((task / "schedstat").read_text().split()[0]) for task in tasks.iterdir()) / 1e9
        )
    except (OSError, ValueError, IndexError):
        times = psutil.Process(pid).cpu_times()
        return float(times.user + times.system)


def percents(pids: dict[str, int], seconds: float) -> dict[str, float]:
    """How much of a core each process uses."""
    time.sleep(SETTLE_S)
    begun, start = {name: cpu_s(pid) for name, pid in pids.items()}, time.monotonic()
    time.sleep(max(MIN_SECONDS, seconds))
    took = time.monotonic() - start
    return {
        f"{name}_percent": 100 * (cpu_s(pid) - begun[name]) / took for name, pid in pids.items()
    }


def nodes(seconds: float) -> dict[str, float]:
    """Idle node, publisher with one subscriber, bare loops and Master, all at the same time."""
    texts = {"idle": IDLE, "subscriber": SUBSCRIBER, "publisher": PUBLISHER}
    texts |= {"bare": BARE, "bare_blocking": BARE_BLOCKING}
    with a_master() as (master, address):
        pids = {"master": master.pid}
        with all_of(texts, address) as started:
            pids |= {name: process.pid for name, process in started.items()}
            found = percents(pids, seconds)
            for name in ("idle", "publisher", "master"):
                found[f"{name}_rss_mb"] = psutil.Process(pids[name]).memory_info().rss / 1e6
    return found


@contextmanager
def all_of(texts: dict[str, str], address: str) -> Iterator[dict[str, subprocess.Popen[str]]]:
    started: dict[str, subprocess.Popen[str]] = {}
    try:
        for name, text in texts.items():
            code = text.replace("{address}", address)
            process = subprocess.Popen(
                [sys.executable, "-c", code],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            started[name] = process
            assert process.stdout is not None
            if process.stdout.readline().strip() != "ready":
                raise SystemExit(f"the program {name!r} of 'rest' did not start")
        yield started
    finally:
        for process in reversed(started.values()):
            process.terminate()
            process.wait(10)


def fleet(seconds: float, count: int = FLEET) -> dict[str, float]:
    """So many idle nodes, a process each, started by ``simple-ros launch``."""
    with tempfile.TemporaryDirectory() as text, a_master() as (_, address):
        directory = Path(text)
        (directory / "member.py").write_text(MEMBER)
        entries = [LAUNCH_NODE.format(index=index) for index in range(count)]
        (directory / "fleet.yaml").write_text("\n".join(["launch:", *entries]) + "\n")
        begun = time.monotonic()
        command = [sys.executable, "-m", "simple_ros.cli.main", "launch"]
        command += [str(directory / "fleet.yaml"), "--plain", "--master", "require"]
        with child(*command, SIMPLE_ROS_MASTER=address) as launcher:
            until_listed(address, count)
            up_s = time.monotonic() - begun
            processes = psutil.Process(launcher.pid).children(recursive=True)
            used = percents({str(process.pid): process.pid for process in processes}, seconds)
            full = [process.memory_full_info() for process in processes]
    return {
        "fleet_nodes": float(count),
        "fleet_up_s": up_s,
        "fleet_percent": sum(used.values()),
        "fleet_rss_mb": sum(info.rss for info in full) / 1e6,
        "fleet_pss_mb": sum(info.pss for info in full) / 1e6,
    }


def until_listed(address: str, count: int) -> None:
    """Wait until the Master lists so many nodes."""
    from simple_ros.net.master_client import MasterClient

    async def wait() -> None:
        client = MasterClient(address)
        end = time.monotonic() + UP_LIMIT_S
        try:
            while len(await client.get_nodes()) < count:
                if time.monotonic() > end:
                    raise SystemExit(
                        f"not all of {count} nodes registered within {UP_LIMIT_S:.0f} s"
                    )
                await asyncio.sleep(0.05)
        finally:
            await client.close()

    asyncio.run(wait())


def measure_all(seconds: float, peers: Sequence[Peer]) -> dict[str, Any]:
    """Both, and as rows of a table."""
    found = nodes(seconds) | fleet(seconds)
    rows = [
        ("idle node, CPU", f"{found['idle_percent']:.3f} % of a core"),
        ("node with a 100 Hz timer that publishes, CPU", f"{found['publisher_percent']:.2f} %"),
        ("its subscriber, CPU", f"{found['subscriber_percent']:.2f} %"),
        (
            "a bare loop at 100 Hz (asyncio.sleep, sendall, recv), CPU",
            f"{found['bare_percent']:.2f} %",
        ),
        (
            "the same without a loop (time.sleep, sendall, recv), CPU",
            f"{found['bare_blocking_percent']:.2f} %",
        ),
        ("Master with three nodes, CPU", f"{found['master_percent']:.3f} %"),
        ("idle node, memory (RSS)", f"{found['idle_rss_mb']:.1f} MB"),
        ("Master, memory (RSS)", f"{found['master_rss_mb']:.1f} MB"),
        (
            f"launch of {found['fleet_nodes']:.0f} nodes, until all are known",
            f"{found['fleet_up_s']:.1f} s",
        ),
        ("their CPU at rest, in sum", f"{found['fleet_percent']:.2f} %"),
        (
            "their memory, in sum",
            f"{found['fleet_rss_mb']:,.0f} MB RSS, {found['fleet_pss_mb']:,.0f} MB (PSS: shared pages once)",
        ),
    ]
    return found | {"seconds": seconds, "rows": rows}


# -- imports ---------------------------------------------------------------------------------------

OWN_IMPORTS = ("import simple_ros", "import simple_ros.aio", "from simple_ros import NodeHandle")
RIVAL_IMPORTS = {
    "rospy": "import rospy",
    "rclpy_kilted": "import rclpy",
    "rclpy_jazzy": "import rclpy",
    "zenoh": "import zenoh",
    "zmq": "import zmq",
}


def import_ms(python: str, statement: str) -> float:
    """Whole process, less one that imports nothing; median."""

    def took(code: str) -> float:
        begun = time.perf_counter()
        subprocess.run([python, "-c", code], check=True, capture_output=True)
        return time.perf_counter() - begun

    pairs = [(took(statement), took("pass")) for _ in range(IMPORTS)]
    return 1e3 * statistics.median(full - empty for full, empty in pairs)


def measure_start(seconds: float, peers: Sequence[Peer]) -> dict[str, Any]:
    """What each import takes."""
    found = {statement: import_ms(sys.executable, statement) for statement in OWN_IMPORTS}
    for name, statement in RIVAL_IMPORTS.items():
        if not result_of(name)["reason"]:
            found[f"{statement} ({name})"] = import_ms(str(python_of(name)), statement)
    return {
        "imports_ms": found,
        "rows": [(f"`{name}`", f"{ms:.0f} ms") for name, ms in found.items()],
    }


if __name__ == "__main__":
    for what, value in measure_all(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0, ())["rows"]:
        print(f"{what:<60}{value}")
