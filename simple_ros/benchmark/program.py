"""The main function of every program that is measured.

``program JOB`` with the job as JSON. A receiver prints ``{"ready": ...}`` with what a sender must know to reach
it, ``{"heard": ...}`` when the first warm-up arrives and ``{"report": ...}`` after the last message. A sender sends
warm-ups until it is told a line, then everything, prints ``{"sent": ...}`` and stays until told to end.
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Awaitable, Callable
from typing import Any, TypeAlias

from simple_ros.benchmark.sink import Sink, say
from simple_ros.benchmark.source import wait_for_end
from simple_ros.benchmark.workloads import Job, job_from

__all__ = ["Receive", "Send", "ready", "run_program"]

Receive: TypeAlias = Callable[[Job, Sink], Awaitable[None] | None]
Send: TypeAlias = Callable[[Job], Awaitable[None] | None]


def ready(at: Any = "") -> None:
    """Tell the harness that this receiver listens, and where."""
    say(ready=at)


def run_program(
    receive: Receive,
    send: Send,
    argv: list[str] | None = None,
    new_loop: Callable[[], asyncio.AbstractEventLoop] | None = None,
) -> None:
    """Do the job on the command line.

    Args:
        receive: Gives messages to the sink, for ever.
        send: Sends with `drive` or `drive_async`; a coroutine must itself wait for the end.
        argv: Instead of the command line.
        new_loop: Makes the event loop of who brings one of his own; else asyncio's. A job may want uvloop.
    """
    job = job_from(json.loads((argv or sys.argv[1:])[0]))
    if job.role == "receive":
        sink = Sink(job.workload)
        sink.watch()
        _finish(receive(job, sink), job, new_loop)
        return
    made = send(job)
    _finish(made, job, new_loop)
    if made is None:
        wait_for_end()


def _finish(
    made: Awaitable[None] | None,
    job: Job,
    new_loop: Callable[[], asyncio.AbstractEventLoop] | None,
) -> None:
    if made is None:
        return

    async def run() -> None:
        await made

    if job.options.get("loop") == "uvloop":
        import uvloop

        uvloop.run(run())
    else:
        with asyncio.Runner(loop_factory=new_loop) as runner:
            runner.run(run())
