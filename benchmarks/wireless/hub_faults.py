"""Faults of real processes: how long until everything is in Operation again, and what it costs.

    python benchmarks/wireless/hub_faults.py [--seeds 20] [--hub-kills 5]

For each seed one process of three engines and two cells is killed (SIGKILL) or stopped (SIGSTOP), in turn. Then
the hub itself is killed with SIGKILL and started again. Bar: 5 s.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import os
import random
import signal
import statistics
import sys
import tempfile
import time
from pathlib import Path

import psutil

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.msg.wireless_ros_msgs import ChannelState, SystemEvent, SystemStatus
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_master import Master

# Each fault is the first for its component: the delay that doubles with each further one is not what is measured.
CONFIG = """
components:
  radio_info_engine: {engine: radio-information, parameters: {source: synthetic}, RESPAWN}
  cross_domain_engine: {engine: cross-domain, after: radio_info_engine, RESPAWN}
  physical_adaptive_engine: {engine: physical-adaptive, after: cross_domain_engine, RESPAWN}
  camera_cell: {cell: camera, priority: 2, RESPAWN}
  command_cell: {cell: command, RESPAWN}
""".replace("RESPAWN", "respawn: {limit: 5, within_s: 0.1, delay_s: 0.2}")


class Watch:
    def __init__(self) -> None:
        self.status = SystemStatus()
        self.events: list[SystemEvent] = []
        self.states: list[float] = []

    @property
    def pids(self) -> dict[str, int]:
        return {item.name: item.pid for item in self.status.components}

    @property
    def operates(self) -> bool:
        return self.status.phase == "OPERATION" and not self.status.degraded

    def took(self, status: SystemStatus) -> None:
        self.status = status


async def until(condition, what: str, limit_s: float = 60) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"not within {limit_s:g} s: {what}")
        await asyncio.sleep(0.01)


async def start_hub(master: str, place: str) -> asyncio.subprocess.Process:
    config = Path(place) / "components.yaml"
    config.write_text(CONFIG)
    words = ("--config", str(config))
    return await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "simple_ros_hub",
        *words,
        env={
            **os.environ,
            "SIMPLE_ROS_MASTER": master,
            "SIMPLE_ROS_RUN_DIR": place,
            "SIMPLE_ROS_ARGS": "_check_interval:=0.1",
        },
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.DEVNULL,
    )


def told(name: str, times: list[float]) -> None:
    if times:
        print(f"{name:<24} median {statistics.median(times):.2f} s, worst {max(times):.2f} s")


async def strike(watch: Watch, seed: int) -> tuple[bool, float]:
    rng = random.Random(seed)
    before = watch.pids
    victim = rng.choice(sorted(before))
    is_kill = seed % 2 == 0
    begun = time.monotonic()
    os.kill(before[victim], signal.SIGKILL if is_kill else signal.SIGSTOP)
    await until(lambda: watch.pids.get(victim) not in (0, None, before[victim]), victim)
    await until(lambda: watch.operates, "operation")
    took_s = time.monotonic() - begun
    others = {name for name, pid in watch.pids.items() if pid != before[name]} - {victim}
    if others:
        print(f"seed {seed}: {others} were restarted, too")
    return is_kill, took_s


async def main(seeds: int, hub_kills: int) -> None:
    with tempfile.TemporaryDirectory() as place:
        async with (
            Master(host="127.0.0.1", port=0) as master,
            NodeHandle("bench", master=master.address, arguments=Arguments()) as node,
        ):
            await measure(node, master.address, place, seeds, hub_kills)


async def measure(node: NodeHandle, master: str, place: str, seeds: int, hub_kills: int) -> None:
    watch = Watch()
    space = "/wireless_ros"
    await node.subscribe(f"{space}/system_status", SystemStatus, watch.took, qos=LATCHED)
    await node.subscribe(
        f"{space}/system_events", SystemEvent, watch.events.append, qos=QosProfile(depth=1000)
    )
    await node.subscribe(
        f"{space}/channel_state", ChannelState, lambda _: watch.states.append(time.monotonic())
    )
    hub = await start_hub(master, place)
    try:
        await until(lambda: watch.operates, "the first start")
        memory = psutil.Process(hub.pid).memory_info().rss
        kills, hangs = [], []
        for seed in range(seeds):
            is_kill, took_s = await strike(watch, seed)
            (kills if is_kill else hangs).append(took_s)
        grown = psutil.Process(hub.pid).memory_info().rss - memory
        numbers = [event.number for event in watch.events]
        failures = sum(" failed: " in event.text for event in watch.events)
        told("kill -9", kills)
        told("SIGSTOP", hangs)
        print(
            f"faults {seeds}, failures told {failures}, events told twice "
            f"{len(numbers) - len(set(numbers))}, hub's memory {grown / 1e6:+.1f} MB"
        )
        await hub_killed(watch, hub, master, place, hub_kills)
    finally:
        end_all(place)


async def hub_killed(watch: Watch, hub, master: str, place: str, hub_kills: int) -> None:
    takeovers, holes, restarted = [], [], 0
    for _ in range(hub_kills):
        before = watch.pids
        begun = time.monotonic()
        hub.kill()
        await hub.wait()
        watch.status = SystemStatus()
        hub = await start_hub(master, place)
        await until(lambda: watch.operates, "operation after the hub's death")
        takeovers.append(time.monotonic() - begun)
        restarted += watch.pids != before
        times = [at for at in watch.states if at >= begun - 0.5]
        holes.append(max(b - a for a, b in itertools.pairwise(times)))
    told("kill -9 of the hub", takeovers)
    told("  hole in the metrics", holes)
    print(f"  engines or cells restarted in {restarted} of {hub_kills}")
    hub.kill()
    await hub.wait()


def end_all(place: str) -> None:
    mark = f"SIMPLE_ROS_HUB_COMPONENT={place}".encode()
    for directory in Path("/proc").iterdir():
        if directory.name.isdigit():
            with contextlib.suppress(OSError):
                pid = int(directory.name)
                if mark in (directory / "environ").read_bytes() and os.getsid(pid) == pid:
                    os.killpg(pid, signal.SIGKILL)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--hub-kills", type=int, default=5)
    options = parser.parse_args()
    asyncio.run(main(options.seeds, options.hub_kills))
