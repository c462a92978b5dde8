"""What the measurements of the Pico bridge share: processes, rows of the table, bad lines."""

from __future__ import annotations

import asyncio
import contextlib
import random
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from simple_ros_firmware_bridge.simulator.firmware import Firmware
from simple_ros_firmware_bridge.simulator.pty_board import PtyBoard

NOMINAL_HZ = 195


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        what: Is measured.
        value: The figure.
        unit: Of it.
        bar: What it shall be, in words; empty for what is shown only.
        is_met: Whether it is.
    """

    what: str
    value: float
    unit: str
    bar: str = ""
    is_met: bool = True


def at_most(what: str, value: float, unit: str, limit: float) -> Row:
    return Row(what, value, unit, f"<= {limit:g}", value <= limit)


def below(what: str, value: float, unit: str, limit: float) -> Row:
    return Row(what, value, unit, f"< {limit:g}", value < limit)


def at_least(what: str, value: float, unit: str, limit: float) -> Row:
    return Row(what, value, unit, f">= {limit:g}", value >= limit)


def exactly(what: str, value: float, unit: str, wanted: float) -> Row:
    return Row(what, value, unit, f"{wanted:g}", value == wanted)


def percentile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def latency_rows(what: str, values: list[float], limit_ms: float = 0.0) -> list[Row]:
    """Median, p99 and worst in ms; the bar is for p99."""
    p99 = percentile(values, 0.99) * 1e3
    return [
        Row(f"{what}, median", percentile(values, 0.5) * 1e3, "ms"),
        below(f"{what}, p99", p99, "ms", limit_ms) if limit_ms else Row(f"{what}, p99", p99, "ms"),
        Row(f"{what}, worst of {len(values)}", max(values) * 1e3, "ms"),
    ]


async def until(condition: Callable[[], object], limit_s: float = 30) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("the bridge did not do what is measured")
        await asyncio.sleep(0.001)


@asynccontextmanager
async def program(*words: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """``python WORDS``, ended at the end."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *words,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        await process.communicate()


@dataclass(frozen=True)
class Place:
    """Where things are: the Master, and where sessions are kept; how long the long runs take."""

    master: str
    state: Path
    seconds: float
    short_s: float

    def bridge(self, board: PtyBoard, *words: str) -> tuple[str, ...]:
        port = ("--port", board.path, "--state", str(self.state), "--master", self.master)
        return ("-m", "simple_ros_firmware_bridge", *port, *words)


class Lag:
    """How late this process, which is the board, wakes up: what no bridge could do better on this computer now."""

    _PERIOD_S = 0.01

    def __init__(self) -> None:
        self._late: list[float] = []
        self._task = asyncio.create_task(self._watch())

    async def _watch(self) -> None:
        while True:
            due = time.perf_counter() + self._PERIOD_S
            await asyncio.sleep(self._PERIOD_S)
            self._late.append(time.perf_counter() - due)

    def rows(self) -> list[Row]:
        self._task.cancel()
        if not self._late:
            return []
        return [
            Row("(this process woke up too late, p99)", percentile(self._late, 0.99) * 1e3, "ms"),
            Row("(this process woke up too late, worst)", max(self._late) * 1e3, "ms"),
        ]


class Tap:
    """One way of a line, spoiled from now on by whatever is put into ``spoil``."""

    def __init__(self, spoil: Callable[[bytes], bytes] = bytes) -> None:
        self.spoil = spoil

    def __call__(self, data: bytes) -> bytes:
        return self.spoil(data)


class Pause:
    """Lets the timers of a board stand still, so that what was sent can be counted exactly."""

    def __init__(self, firmware: Firmware) -> None:
        self._firmware = firmware
        self._run = firmware.run
        self.is_on = False
        firmware.run = self._step  # type: ignore[method-assign]

    def _step(self, now: float) -> None:
        if self.is_on:
            self._firmware.client.handle_timeout(now)
        else:
            self._run(now)


def flipping(rng: random.Random) -> Callable[[bytes], bytes]:
    """One of a hundred chunks of 42 bytes gets a flipped bit."""

    def spoil(data: bytes) -> bytes:
        out = bytearray(data)
        for start in range(0, len(out), 42):
            if rng.random() < 0.01:
                out[rng.randrange(start, min(start + 42, len(out)))] ^= 1 << rng.randrange(8)
        return bytes(out)

    return spoil


def losing(rng: random.Random, share: float) -> Callable[[bytes], bytes]:
    """Whole messages vanish."""
    return lambda data: b"" if rng.random() < share else data
