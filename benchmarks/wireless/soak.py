"""An hour of faults: the real system, real processes, wall-clock time.

    python benchmarks/wireless/soak.py [--minutes 60] [--seed 1] [--out soak.json]
    python benchmarks/wireless/soak.py --read soak.json

A Master, the link shaper (a simulated radio), a robot and an operator, and `simple-ros launch wireless_ros.yaml`
with the hub, three engines and four cells. Faults come by a seed, one every 20 s or so: kill -9 and SIGSTOP of
engines and cells, kill -9 of the hub, of the hub and one more at once, of the Master (started again after 3 s), a source of
metrics that falls silent (the shaper is stopped for 6 s), a dead zone. After each, everything must be in Operation
again within 5 s, with no other process restarted, and pictures must reach the operator. At the end each fault
must be in the event log exactly once, and memory and open files of every process that lived long must be flat.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

import psutil
from soak_model import Fault, Sample, Struck, faults
from soak_report import BAR_S, Found
from soak_world import NODES, NotWithin, Watch, World, until

from simple_ros import aio
from simple_ros.arguments import Arguments
from simple_ros.msg.std_msgs import Bool
from simple_ros.msg.wireless_ros_msgs import (
    GetSystemEvents,
    GetSystemEventsRequest,
    SystemStatus,
)
from simple_ros_hub.event_log import EventLog

SAMPLE_S = 5.0


class Soak:
    def __init__(self, world: World, watch: Watch) -> None:
        self.world, self.watch = world, watch
        self.struck: list[Struck] = []
        self.samples: dict[tuple[str, int], list[Sample]] = {}
        self.begun = time.monotonic()
        self.lag_s = 0.0

    # -- faults --------------------------------------------------------------------------------

    async def strike(self, fault: Fault) -> Struck:
        before, self.lag_s = self.world.table(), 0.0
        item = Struck(fault, time.time_ns())
        self.struck.append(item)
        act = {
            "kill": self.one,
            "stop": self.one,
            "hub": self.hub,
            "hub and one more": self.hub,
            "master": self.master,
            "silent": self.silent,
            "dead zone": self.dead_zone,
        }[fault.kind]
        try:
            await act(item, dict(before))
            for name, count in dict(self.watch.counts).items():
                await until(
                    lambda n=name, c=count: self.watch.counts[n] > c, f"{name} at the operator", 5
                )
        except NotWithin as error:
            item.wrong.append(str(error))
        if item.took_s > BAR_S and fault.kind != "dead zone":
            item.wrong.append(f"took {item.took_s:.2f} s")
        await asyncio.sleep(fault.pause_s)
        self.compare(item, before)
        item.lag_s = self.lag_s
        try:
            await until(lambda: self.watch.operates, "Operation in the end", 5)
        except NotWithin as error:
            item.wrong.append(f"{error}; {list(self.watch.status.reasons)}")
            # The next fault needs something to strike.
            await until(lambda: self.watch.operates, "Operation at all", 120)
        return item

    def compare(self, item: Struck, before: list[tuple[str, int]]) -> None:
        allowed = {
            "hub": {"hub"},
            "hub and one more": {"hub", item.fault.victim},
            "master": {"master"},
            "kill": {item.fault.victim},
            "stop": {item.fault.victim},
        }.get(item.fault.kind, set())
        now = self.world.table()
        if [name for name, _ in now] != [name for name, _ in before]:
            item.wrong.append(f"processes before {before}, now {now}")
        changed = {name for name, pid in now if pid != dict(before).get(name)}
        if changed != allowed:
            item.wrong.append(f"restarted: {changed}, not {allowed}")

    async def one(self, item: Struck, before: dict[str, int]) -> None:
        victim = item.fault.victim
        begun = time.monotonic()
        os.kill(before[victim], signal.SIGKILL if item.fault.kind == "kill" else signal.SIGSTOP)
        await until(lambda: self.watch.pid(victim) not in (0, before[victim]), victim, 20)
        await until(lambda: self.watch.operates, "Operation", 20)
        item.took_s = time.monotonic() - begun

    async def hub(self, item: Struck, before: dict[str, int]) -> None:
        begun = time.monotonic()
        os.kill(before["hub"], signal.SIGKILL)
        if item.fault.kind != "hub":
            os.kill(before[item.fault.victim], signal.SIGKILL)
        # What the dead one had sent may still be on its way.
        await until(lambda: self.world.hub_pid not in (0, before["hub"]), "another hub", 20)
        self.watch.status = SystemStatus()
        await until(lambda: self.watch.operates, "Operation under the next hub", 20)
        item.took_s = time.monotonic() - begun

    async def master(self, item: Struck, before: dict[str, int]) -> None:
        os.kill(before["master"], signal.SIGKILL)
        for _ in range(30):
            await asyncio.sleep(0.1)
            if not self.watch.operates:
                item.wrong.append("not in Operation without the Master")
                break
        await self.world.start_master()
        begun = time.monotonic()
        while True:
            with contextlib.suppress(Exception):
                known = {
                    info.node_name.strip("/") for info in await self.watch.node.client.get_nodes()
                }
                if known >= NODES:
                    break
            if time.monotonic() - begun > 20:
                raise NotWithin("not within 20 s: all nodes at the new Master")
            await asyncio.sleep(0.05)
        await until(lambda: self.watch.operates, "Operation", 20)
        item.took_s = time.monotonic() - begun

    async def silent(self, item: Struck, before: dict[str, int]) -> None:
        os.kill(before["shaper"], signal.SIGSTOP)
        try:
            item.shown_s = await until(lambda: self.watch.status.degraded, "a degraded status", 6)
            await asyncio.sleep(max(0.0, 6 - item.shown_s))
        finally:
            os.kill(before["shaper"], signal.SIGCONT)
        item.took_s = await until(lambda: self.watch.operates, "Operation", 20)

    async def dead_zone(self, item: Struck, before: dict[str, int]) -> None:
        self.watch.dead.publish(Bool(data=True))
        try:
            level = lambda: self.watch.status.degradation.level  # noqa: E731
            item.shown_s = await until(lambda: level() >= 2, "degradation ESSENTIAL or SAFE", 10)
            await asyncio.sleep(5)
        finally:
            self.watch.dead.publish(Bool(data=False))
        item.took_s = await until(lambda: level() == 0, "degradation NORMAL", 30)

    # -- the run -------------------------------------------------------------------------------

    async def run(self, minutes: float, seed: int, out: Path) -> None:
        try:
            await until(lambda: self.watch.operates, "the first start", 60)
        except NotWithin:
            for name, child in self.world.children.items():
                print(name, child.state, *child.last_lines, sep="\n   ")
            raise
        await until(lambda: len(self.watch.counts) == 3, "the operator", 20)
        await asyncio.sleep(5)
        self.begun = time.monotonic()
        watching = [asyncio.create_task(w) for w in (self.sample(), self.feel_the_computer())]
        for first, second in faults(seed):
            spent = (time.monotonic() - self.begun) / 60 / minutes
            if spent >= 1:
                break
            item = await self.strike(first if spent < 0.5 else second)
            wrong = f"  WRONG: {'; '.join(item.wrong)}" if item.wrong else ""
            print(
                f"{(time.monotonic() - self.begun) / 60:6.2f} min  {item.fault.kind:<17}"
                f"{item.fault.victim if item.fault.kind in ('kill', 'stop', 'hub and one more') else '':<25}"
                f"{item.took_s:6.2f} s  load {os.getloadavg()[0]:4.1f} lag {item.lag_s:4.2f} s{wrong}",
                flush=True,
            )
            # If this program is ended, what it has seen can be judged all the same.
            self.so_far(spent * minutes).save(out)
        for task in watching:
            task.cancel()
        await asyncio.gather(*watching, return_exceptions=True)

    async def feel_the_computer(self) -> None:
        """How late this program itself is: what it measures is then the computer's, too."""
        while True:
            due = time.monotonic() + 0.05
            await asyncio.sleep(0.05)
            self.lag_s = max(self.lag_s, time.monotonic() - due)

    async def sample(self) -> None:
        while True:
            for name, pid in [*self.world.table(), ("this program", os.getpid())]:
                with contextlib.suppress(psutil.Error):
                    process = psutil.Process(pid)
                    now = Sample(
                        time.monotonic() - self.begun, process.memory_info().rss, process.num_fds()
                    )
                    self.samples.setdefault((name, pid), []).append(now)
            await asyncio.sleep(SAMPLE_S)

    def so_far(self, minutes: float) -> Found:
        entries = EventLog(self.world.place).read(1_000_000)
        return Found(minutes, self.struck, self.samples, entries, self.watch.events)

    async def found(self, minutes: float) -> Found:
        """What there is to judge."""
        found = self.so_far(minutes)
        entries = found.entries
        ask = self.watch.node.service_client("/wireless_ros/get_system_events", GetSystemEvents)
        told = [event.number for event in (await ask.call(GetSystemEventsRequest())).events]
        if told[: len(entries)] != [entry.number for entry in entries][-len(told) :]:
            found.more.append("the service tells other events than the file has")
        return found


async def main(minutes: float, seed: int, out: Path) -> Found:
    os.environ |= {
        "SIMPLE_ROS_TRANSPORTS": "local,shaped",
        "SIMPLE_ROS_SITE": "observer",
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
    }
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        world = World(Path(folder))
        try:
            await world.start()
            os.environ["SIMPLE_ROS_LINK_SHAPER"] = world.shaper
            async with aio.NodeHandle("soak", master=world.master, arguments=Arguments()) as node:
                watch = Watch(node)
                await watch.open()
                soak = Soak(world, watch)
                await soak.run(minutes, seed, out)
                found = await soak.found(minutes)
        finally:
            await world.stop()
            left = world.components()
            for _, pid in left:
                os.killpg(pid, signal.SIGKILL)
        found.more += [f"left behind in the end: {name}, process {pid}" for name, pid in left]
        found.save(out)
        return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("soak.json"))
    parser.add_argument("--read", type=Path, metavar="FILE", help="judge an earlier run again")
    options = parser.parse_args()
    if options.read:
        result = Found.read(options.read)
    else:
        result = asyncio.run(main(options.minutes, options.seed, options.out))
    is_well = result.tell()
    print("all well" if is_well else "NOT all well")
    sys.exit(not is_well)
