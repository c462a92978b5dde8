"""What nodes cost when little happens: user+system CPU of whole processes, after their start."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import Any

import psutil

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
from simple_ros.msg.geometry_msgs import Twist
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


def _start(text: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "ready"
    return process


def measure(seconds: float) -> dict[str, Any]:
    """Idle node, publisher with one subscriber, bare loop and Master, all at the same time."""
    master = subprocess.Popen(
        [sys.executable, "-m", "simple_ros_master", "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert master.stdout is not None
    address = master.stdout.readline().rsplit(" ", 1)[1].strip()
    processes = {"master": master}
    for name, text in [
        ("idle", IDLE),
        ("subscriber", SUBSCRIBER),
        ("publisher", PUBLISHER),
        ("bare", BARE),
    ]:
        processes[name] = _start(text.replace("{address}", address))
    try:
        time.sleep(2.0)
        begun = {name: _cpu(process) for name, process in processes.items()}
        time.sleep(seconds)
        used = {
            f"{name}_percent": 100 * (_cpu(process) - begun[name]) / seconds
            for name, process in processes.items()
        }
        rss = psutil.Process(processes["idle"].pid).memory_info().rss
        return used | {"idle_rss_mb": rss / 1e6}
    finally:
        for process in reversed(processes.values()):
            process.terminate()
            process.wait(5)


def _cpu(process: subprocess.Popen[str]) -> float:
    times = psutil.Process(process.pid).cpu_times()
    return float(times.user + times.system)


if __name__ == "__main__":
    print(measure(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0))
