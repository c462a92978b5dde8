"""Measurements of the bridge alone: latency, load, bad lines, garbage, restarts."""

from __future__ import annotations

import asyncio
import itertools
import random
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
from pico_tools import (
    NOMINAL_HZ,
    Pause,
    Place,
    Row,
    Tap,
    at_least,
    at_most,
    below,
    exactly,
    flipping,
    latency_rows,
    losing,
    program,
    until,
)

from simple_ros import aio
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.registry import MsgFactory
from simple_ros.msg.sensor_msgs import JointState
from simple_ros_firmware_bridge.simulator.firmware import Firmware
from simple_ros_firmware_bridge.simulator.pty_board import PtyBoard

TOPICS = {
    "joint_states": "sensor_msgs.JointState",
    "imu/data_raw": "sensor_msgs.Imu",
    "odom": "nav_msgs.Odometry",
    "sensors/range_tof": "sensor_msgs.Range",
    "sensors/range_ultrasonic": "sensor_msgs.Range",
    "sensors/illuminance": "sensor_msgs.Illuminance",
}
_BARE_BYTES = 240
_REFERENCE_S = 10.0
_RESTARTS = 5
_GARBAGE_BYTES = 1_000_000


class Looker:
    """Counts what arrives, and how old it is; the board is in this process, so one clock measures both ends."""

    def __init__(self, firmware: Firmware) -> None:
        self.count = 0
        self.topics: set[str] = set()
        self.ages: list[float] = []
        self.reports: list[dict[str, str]] = []
        self._made_at: dict[int, float] = {}
        make = firmware._stamp_ns

        def stamp(now: float) -> int:
            stamp_ns = make(now)
            self._made_at[stamp_ns] = time.perf_counter()
            return stamp_ns

        firmware._stamp_ns = stamp  # type: ignore[method-assign]

    async def look(self, node: aio.NodeHandle) -> None:
        for topic, name in TOPICS.items():
            kind = MsgFactory.instance().get_class(name)
            await node.subscribe(topic, kind, lambda m, t=topic: self._came(t, m))
        await node.subscribe("diagnostics", DiagnosticArray, self._reported)

    def _came(self, topic: str, message: Any) -> None:
        self.count += 1
        self.topics.add(topic)
        stamp = message.header.stamp
        made_at = self._made_at.get(stamp.seconds * 10**9 + stamp.nanos)
        if made_at is not None:
            self.ages.append(time.perf_counter() - made_at)

    def _reported(self, message: DiagnosticArray) -> None:
        self.reports.append({item.key: item.value for item in message.status[0].values})


async def _counted(pause: Pause, firmware: Firmware, look: Looker) -> tuple[int, int]:
    """Samples that were acknowledged and samples that arrived, with none under way."""
    pause.is_on = True
    await until(lambda: not firmware.client.is_blocked)
    stable, since = look.count, time.monotonic()
    while time.monotonic() - since < 0.3:
        if look.count != stable:
            stable, since = look.count, time.monotonic()
        await asyncio.sleep(0.01)
    counts = firmware.client.counters.published, look.count
    pause.is_on = False
    return counts


async def clean(place: Place) -> list[Row]:
    """A clean line: loss, load and latency, beside a process that only copies bytes."""
    bare = await _bare(place.short_s / 2)
    firmware = Firmware()
    pause, look = Pause(firmware), Looker(firmware)
    async with (
        PtyBoard(firmware) as board,
        aio.NodeHandle("looker", master=place.master) as node,
        program(*place.bridge(board)) as bridge,
    ):
        await look.look(node)
        await until(lambda: len(look.topics) == len(TOPICS))
        usage = psutil.Process(bridge.pid)
        await until(lambda: look.reports)
        sent, got = await _counted(pause, firmware, look)
        look.ages.clear()
        look.reports.clear()
        spent, begin = sum(usage.cpu_times()[:2]), time.monotonic()
        await asyncio.sleep(place.seconds)
        spent, took = sum(usage.cpu_times()[:2]) - spent, time.monotonic() - begin
        ages = list(look.ages)
        sent_after, got_after = await _counted(pause, firmware, look)
    bare += await _bare(place.short_s / 2)
    sent, got = sent_after - sent, got_after - got
    parts = [report["latency to topic, over 1 ms"].split(" of ") for report in look.reports]
    late, all_of_them = (sum(int(part[index]) for part in parts) for index in (0, 1))
    return [
        Row(f"sent by the board in {took:.0f} s", sent / took, "samples/s"),
        exactly("lost", sent - got, "samples", 0),
        below("the bridge's part of a core", 100 * spent / took, "%", 10),
        at_most(
            f"agent: samples that took over 1 ms from read to topic ({late} of {all_of_them})",
            100 * late / max(1, all_of_them),
            "%",
            1,
        ),
        *latency_rows("board's stamp to subscriber's callback", ages),
        *latency_rows("bare: the same bytes, copied from pty to TCP", bare),
    ]


async def _bare(seconds: float) -> list[float]:
    """Ages of samples that a process copies from a pseudo terminal to a socket."""
    ages: list[float] = []
    firmware = Firmware()
    line = PtyBoard(firmware)

    async def hear(reader: asyncio.StreamReader, _: asyncio.StreamWriter) -> None:
        while data := await reader.readexactly(_BARE_BYTES):
            ages.append(time.perf_counter() - struct.unpack_from("<d", data)[0])

    server = await asyncio.start_server(_until_end(hear), "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    copier = str(Path(__file__).with_name("pico_bare.py"))
    async with program(copier, line.path, str(port)):

        async def speak() -> None:
            while True:
                line.noise(struct.pack("<d", time.perf_counter()).ljust(_BARE_BYTES, b"."))
                await asyncio.sleep(1 / NOMINAL_HZ)

        speaking = asyncio.create_task(speak())
        await until(lambda: len(ages) > 20)
        ages.clear()
        await asyncio.sleep(seconds)
        speaking.cancel()
    server.close()
    line.close()
    return ages


def _until_end(hear: Callable[..., Any]) -> Callable[..., Any]:
    async def quiet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await hear(reader, writer)
        except asyncio.IncompleteReadError:
            writer.close()

    return quiet


async def _spoiled(
    place: Place,
    spoil: Callable[[int], Callable[[bytes], bytes]],
    command_hz: float,
    seconds: float,
) -> tuple[float, int, float]:
    """Share of what the same board publishes on the same line when it is clean, publishes that failed, sends."""
    up, down = Tap(), Tap()
    firmware = Firmware(key=b"bad!")
    client = firmware.client
    async with (
        PtyBoard(firmware, spoil_up=up, spoil_down=down) as board,
        aio.NodeHandle("pilot", master=place.master) as pilot,
        program(*place.bridge(board, "--no-keep")),
    ):
        commands = await pilot.advertise("cmd_vel", Twist)
        pilot.create_timer(1 / command_hz, lambda _: commands.publish(Twist()))
        await until(lambda: client.counters.published > 100)

        async def rate(length_s: float) -> float:
            before, begin = client.counters.published, time.monotonic()
            await asyncio.sleep(length_s)
            return (client.counters.published - before) / (time.monotonic() - begin)

        best = await rate(_REFERENCE_S / 2)
        up.spoil, down.spoil = spoil(1), spoil(2)
        failed = client.counters.failed
        sends, messages = client.output.sends, client.output.messages
        reached = await rate(seconds)
        failed = client.counters.failed - failed
        per_message = (client.output.sends - sends) / (client.output.messages - messages)
        up.spoil = down.spoil = bytes
        best = (best + await rate(_REFERENCE_S / 2)) / 2
    return 100 * reached / best, failed, per_message


async def flips(place: Place) -> list[Row]:
    """A bad cable: 1 % of 42-byte chunks with a flipped bit, both ways."""
    rows = []
    for command_hz in (20, 100):
        share, failed, _ = await _spoiled(
            place, lambda seed: flipping(random.Random(seed)), command_hz, place.seconds
        )
        what = f"flipped bits, cmd_vel at {command_hz} Hz"
        rows.append(at_least(f"{what}: of the best possible publishes", share, "%", 98))
        rows.append(exactly(f"{what}: publishes that failed", failed, "", 0))
    return rows


async def loss(place: Place) -> list[Row]:
    """5 % of messages lost each way: on a pty in real time, and for slow boards in simulated time."""
    share, failed, sends = await _spoiled(
        place, lambda seed: losing(random.Random(seed), 0.05), 20, place.short_s
    )
    rows = [
        at_least("5 % lost each way: of the best possible publishes", share, "%", 85),
        exactly("5 % lost each way: publishes that failed", failed, "", 0),
        at_most("5 % lost each way: sends per message", sends, "", 1.3),
    ]
    return rows + await asyncio.to_thread(_simulated)


def _simulated() -> list[Row]:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
    from support.pico_line import Line, Run

    rows = []
    for name, delay_s in (("board", 0.0005), ("board 20 times slower", 0.01)):
        shares, sends, failed = [], [], 0
        for command_hz, seed in itertools.product((20, 100), (1, 2, 3)):
            lines = [Line(delay_s, loss=lost, command_hz=command_hz) for lost in (0.0, 0.05)]
            ideal, lossy = (Run(line, seed).run(20) for line in lines)
            shares.append(100 * lossy.published / ideal.published)
            sends.append(lossy.sends_per_message)
            failed += lossy.failed
        what = f"5 % lost, simulated {name}"
        rows += [
            at_least(f"{what}: least share of 6 runs", min(shares), "%", 85),
            at_most(f"{what}: most sends per message", max(sends), "", 1.3),
            exactly(f"{what}: publishes that failed", failed, "", 0),
        ]
    return rows


async def restart(place: Place) -> list[Row]:
    """The bridge is killed with -9 and started at once, several times."""
    firmware = Firmware(key=b"kill", gives_up=True)
    times: list[float] = []
    async with PtyBoard(firmware) as board, aio.NodeHandle("l", master=place.master) as looker:
        await looker.subscribe("joint_states", JointState, lambda _: times.append(time.monotonic()))
        for _ in range(_RESTARTS):
            seen = len(times)
            async with program(*place.bridge(board)) as bridge:
                await until(lambda n=seen: len(times) > n + 100)
                bridge.kill()
        async with program(*place.bridge(board)):
            seen = len(times)
            await until(lambda: len(times) > seen + 100)
    holes = sorted(later - earlier for earlier, later in itertools.pairwise(times))[-_RESTARTS:]
    return [
        Row(f"hole in the data, median of {_RESTARTS} restarts", holes[_RESTARTS // 2], "s"),
        below("hole in the data, longest", holes[-1], "s", 1.5),
        exactly("times the board began anew", firmware.client.counters.resets, "", 0),
    ]


async def garbage(place: Place) -> list[Row]:
    """Seeded garbage on the line of a board that is connected."""
    firmware = Firmware(key=b"junk")
    pause, look, rng = Pause(firmware), Looker(firmware), random.Random(20261122)
    sizes = []
    async with (
        PtyBoard(firmware) as board,
        aio.NodeHandle("looker", master=place.master) as node,
        program(*place.bridge(board, "--no-keep")) as bridge,
    ):
        await look.look(node)
        await until(lambda: len(look.topics) == len(TOPICS))
        usage = psutil.Process(bridge.pid)
        pause.is_on = True
        unseen = await _uncounted(board, look)
        for _ in range(3):
            await _fill(board, rng.randbytes(_GARBAGE_BYTES))
            count, begin = look.count, time.monotonic()
            pause.is_on = False
            await until(lambda n=count: look.count > n)
            delay = time.monotonic() - begin
            sizes.append(usage.memory_info().rss / 1e6)
            pause.is_on = True
            await until(lambda: not firmware.client.is_blocked)
        unseen = await _uncounted(board, look) - unseen
        alive = bridge.returncode is None
    return [
        exactly("bytes sent less bytes counted (3,000,000 of garbage)", unseen, "", 0),
        below("from the end of the garbage to the next sample", delay, "s", 1),
        below("memory: the third million over the first", sizes[-1] - sizes[0], "MB", 1),
        exactly("times the bridge ended", int(not alive), "", 0),
        exactly("times the board began anew", firmware.client.counters.resets, "", 0),
    ]


async def _uncounted(board: PtyBoard, look: Looker) -> int:
    """Bytes that were sent and that the bridge does not tell of, with none under way."""
    seen = len(look.reports)
    await until(lambda: len(look.reports) > seen + 1)
    return board.sent_bytes - int(look.reports[-1]["bytes"])


async def _fill(board: PtyBoard, data: bytes) -> None:
    while data:
        data = data[board.noise(data[:1024]) :]
        await asyncio.sleep(0)
