"""Starts peers as processes, round after round, and collects what they report."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, Self

from simple_ros.benchmark.peers import Peer
from simple_ros.benchmark.workloads import Job, Role, Workload
from simple_ros.errors import SimpleRosError

__all__ = ["Child", "Failure", "Outcome", "RunFailed", "end", "master", "one_run"]

_START_LIMIT_S = 20.0
_SEND_LIMIT_S = 45.0
_LINE_BYTES = 1 << 20
_PROGRAMS: dict[Role, str] = {"send": "sender", "receive": "receiver"}
_ERROR_LINES = 3


class RunFailed(SimpleRosError, RuntimeError):
    """A peer ended or said nothing."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A run that gave no figures."""

    peer: str
    workload: str
    reason: str


Outcome = dict[str, float]
"""The summary of one run: ``per_second``, ``p50_us``, ``lost``, ``first_ms`` and so on."""


class Child:
    """A process that speaks lines of JSON."""

    def __init__(self, process: asyncio.subprocess.Process, role: str) -> None:
        self._process = process
        self._role = role

    @classmethod
    async def start(
        cls, command: Sequence[str], role: str, environment: Mapping[str, str] | None = None
    ) -> Self:
        """A new process.

        Raises:
            RunFailed: There is no such program.
        """
        try:
            process = await asyncio.create_subprocess_exec(
                *command,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                limit=_LINE_BYTES,
                env=os.environ | (environment or {}),
            )
        except OSError as error:
            raise RunFailed(f"the {role} did not start: {error}") from error
        return cls(process, role)

    async def said(self, key: str, limit_s: float) -> Any:
        """The value of the next line with that key."""
        output = self._process.stdout
        assert output is not None
        try:
            async with asyncio.timeout(limit_s):
                while line := await output.readline():
                    # A library may print, too.
                    with contextlib.suppress(ValueError):
                        facts = json.loads(line)
                        if isinstance(facts, dict) and key in facts:
                            return facts[key]
        except TimeoutError:
            raise RunFailed(f"the {self._role} said no {key!r} within {limit_s:.0f} s") from None
        raise RunFailed(f"the {self._role} ended: {await self._last_words()}")

    async def _last_words(self) -> str:
        assert self._process.stderr is not None
        lines = (await self._process.stderr.read()).decode(errors="replace").split("\n")
        return " / ".join(line.strip() for line in lines[-_ERROR_LINES - 1 :] if line.strip())

    def tell(self) -> None:
        """Send a line: go, or everything is sent."""
        with contextlib.suppress(OSError):
            assert self._process.stdin is not None
            self._process.stdin.write(b"go\n")

    async def kill(self) -> None:
        """End it, and take its last words."""
        end(self._process)
        await self._process.communicate()


async def one_run(
    peer: Peer,
    workload: Workload,
    services: Mapping[str, str],
    environment: Mapping[str, str] | None = None,
) -> Outcome:
    """One sender and its receivers, from their start to their end.

    Args:
        peer: Whose programs.
        workload: What they do.
        services: Where what the peer needs is.
        environment: Added to that of the processes.

    Raises:
        RunFailed: A process ended or hung; messages that were lost are no failure but a figure.
    """
    workload = workload.shortened(peer.fractions.get(workload.name, 1.0))
    used = {name: services[name] for name in peer.services}

    async def start(role: Role, index: int = 0, at: tuple[Any, ...] = ()) -> Child:
        job = Job(role, workload, index, at, used, peer.options)
        command = (*peer.command, json.dumps(job.as_json()))
        return await Child.start(command, _PROGRAMS[role], environment)

    children: list[Child] = []
    try:
        indices = range(workload.receivers)
        children += await asyncio.gather(*(start("receive", index) for index in indices))
        receivers = list(children)
        at = [await child.said("ready", _START_LIMIT_S) for child in receivers]
        begun = time.monotonic()
        sender = await start("send", at=tuple(at))
        children.append(sender)
        heard = [await child.said("heard", _START_LIMIT_S) for child in receivers]
        reports = await _figures(sender, receivers)
        return _summary(reports) | {"first_ms": 1e3 * (max(heard) - begun)}
    finally:
        await asyncio.gather(*(child.kill() for child in children))


async def _figures(sender: Child, receivers: Sequence[Child]) -> list[dict[str, Any]]:
    """Let the sender send, and hear everybody's report, the sender's last."""
    sender.tell()
    sent = await sender.said("sent", _SEND_LIMIT_S)
    for child in receivers:
        child.tell()
    reports = [await child.said("report", _SEND_LIMIT_S) for child in receivers]
    return [*reports, sent]


def _summary(reports: list[dict[str, Any]]) -> Outcome:
    """Of several receivers: the sum of the rates, the worst of the rest."""
    *received, sent = reports
    summed = {"received", "lost", "repeated", "per_second", "mb_s"}
    found: Outcome = {}
    for key in received[0]:
        values = [report[key] for report in received if key in report]
        found[key] = sum(values) if key in summed else max(values)
    found["send_cpu_us"] = sent["send_cpu_us"]
    found["cpu_us"] = sent["send_cpu_us"] + found["receive_cpu_us"]
    return found


def end(process: asyncio.subprocess.Process, how: signal.Signals = signal.SIGKILL) -> None:
    """Send a signal to a child that has not ended."""
    if process.returncode is None:
        # Not process.kill(): that asks for the child's end itself, behind the back of the event loop.
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, how)


@asynccontextmanager
async def master() -> AsyncIterator[str]:
    """A Master of its own; gives its address.

    Raises:
        RunFailed: It does not start.
    """
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *("-m", "simple_ros_master", "--port", "0"),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        assert process.stdout is not None
        line = (await process.stdout.readline()).decode().strip()
        if not line:
            assert process.stderr is not None
            why = (await process.stderr.read()).decode().strip().split("\n")[-1]
            raise RunFailed(f"no Master started: {why}")
        yield line.rsplit(" ", 1)[1]
    finally:
        end(process, signal.SIGTERM)
        await process.communicate()
