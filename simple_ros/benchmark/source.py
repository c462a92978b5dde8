"""How senders send: warm-ups until the harness says go, then all messages, then wait for the end.

A warm-up every few milliseconds shows when the first one arrives, and that everybody listens before
anything counts. What the harness says are lines on standard input.
"""

from __future__ import annotations

import asyncio
import os
import select
import sys
import time
from collections.abc import Awaitable, Callable
from typing import Any

from simple_ros.benchmark.sink import say
from simple_ros.benchmark.workloads import Workload

__all__ = ["drive", "drive_async", "until_end", "wait_for_end"]

_WARM_UP_S = 0.005
_SLOW_WARM_UP_S = 0.05
_LARGE_BYTES = 64 * 1024


def drive(workload: Workload, make: Callable[[int], Any], send: Callable[[Any], Any]) -> None:
    """Send from a thread that may block.

    Args:
        workload: What to send.
        make: Makes the message of a number.
        send: Sends it, and waits while there is no room.
    """
    while not _told(_pause(workload)):
        send(make(0))
    begun, cpu = time.perf_counter(), time.process_time()
    if not workload.rate_hz:
        for number in range(1, workload.count + 1):
            send(make(number))
    else:
        due = time.monotonic()
        for number in range(1, workload.count + 1):
            due += 1 / workload.rate_hz
            time.sleep(max(0.0, due - time.monotonic()))
            send(make(number))
    _report(workload, begun, cpu)


async def drive_async(
    workload: Workload,
    make: Callable[[int], Any],
    send: Callable[[Any], Awaitable[Any]],
    flush: Callable[[], Any] = lambda: None,
) -> None:
    """The same on an event loop.

    Args:
        workload: What to send.
        make: Makes the message of a number.
        send: Sends it, waiting while there is no room; awaited where messages go flat out.
        flush: Called after the last message, for senders that gather.
    """
    loop = asyncio.get_running_loop()
    go = asyncio.create_task(until_end())
    while not go.done():
        await send(make(0))
        flush()
        await asyncio.sleep(_pause(workload))
    begun, cpu = time.perf_counter(), time.process_time()
    if not workload.rate_hz:
        for number in range(1, workload.count + 1):
            await send(make(number))
    else:
        due = loop.time()
        for number in range(1, workload.count + 1):
            due += 1 / workload.rate_hz
            delay = due - loop.time()
            if delay > 0:
                await asyncio.sleep(delay)
            await send(make(number))
            flush()
    flush()
    _report(workload, begun, cpu)


def _pause(workload: Workload) -> float:
    return _SLOW_WARM_UP_S if workload.size_bytes > _LARGE_BYTES else _WARM_UP_S


def _told(wait_s: float) -> bool:
    """Whether the harness said something within that time."""
    readable, _, _ = select.select([sys.stdin], [], [], wait_s)
    if readable and not os.read(sys.stdin.fileno(), 64):
        raise SystemExit("the harness is gone")
    return bool(readable)


def _report(workload: Workload, begun: float, cpu: float) -> None:
    """Tell the harness that everything is sent, and what it cost here."""
    took_s, cpu_s = time.perf_counter() - begun, time.process_time() - cpu
    say(sent={"send_s": took_s, "send_cpu_us": 1e6 * cpu_s / workload.count})


def wait_for_end() -> None:
    """Keep what is connected until the harness has all reports."""
    sys.stdin.readline()


async def until_end() -> None:
    """The same on an event loop."""
    loop, heard = asyncio.get_running_loop(), asyncio.Event()
    stdin = sys.stdin.fileno()

    def read() -> None:
        if not os.read(stdin, 64):
            raise SystemExit("the harness is gone")
        heard.set()

    loop.add_reader(stdin, read)
    await heard.wait()
    loop.remove_reader(stdin)
