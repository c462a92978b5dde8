"""What ``simple-ros launch`` does: the Master if need be, then everything described, until it is over."""

from __future__ import annotations

import asyncio
import importlib.util
import sys
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Protocol

from simple_ros.errors import MasterUnavailable
from simple_ros.launch.description import LaunchDescription, ProcessDescription, Ready, ReadyWhen
from simple_ros.launch.errors import LaunchFailed
from simple_ros.launch.events import Ended, GivenUp, IsReady, ProcessEvent
from simple_ros.launch.logs import new_log_directory
from simple_ros.launch.plan import State, Status, Verdict
from simple_ros.launch.reader import RESERVED_NAME
from simple_ros.launch.restart import Respawn
from simple_ros.launch.supervisor import Supervisor
from simple_ros.launch.usage import Usage
from simple_ros.net.addresses import is_loopback, master_address, split_address
from simple_ros.net.master_client import MasterClient

__all__ = ["Display", "Launcher", "MasterChoice"]

_MASTER_MODULE = "simple_ros_master"
_LISTENING = "listening on "
_LINES_SHOWN = 5


class MasterChoice(Enum):
    """Which Master is used."""

    AUTO = "auto"
    """One that runs; else one is started."""
    START = "start"
    """One of the launch's own."""
    REQUIRE = "require"
    """One that runs."""


class Display(Protocol):
    """Where a launch is shown."""

    period_s: float

    def say(self, line: str, *, is_bad: bool = False) -> None:
        """Something the user should know."""

    def lines(self, name: str, lines: Sequence[str]) -> None:
        """Output of a process that is wanted on the screen."""

    def show(self, rows: Sequence[tuple[Status, Usage | None, str]]) -> None:
        """All processes: what is known, what they take, their last line of output."""


class Launcher:
    """One run of a launch.

    Args:
        description: What to start.
        display: Where to show it.
        master: Which Master to use.
    """

    def __init__(
        self, description: LaunchDescription, display: Display, master: MasterChoice
    ) -> None:
        self._description = description
        self._display = display
        self._choice = master
        self._to_screen = {
            process.name for process in description.processes if process.log.value != "file"
        }
        self._ready_at_once = {
            process.name
            for process in description.processes
            if process.ready.when is ReadyWhen.STARTED
        }
        self._supervisor: Supervisor | None = None
        self._master = ""
        self.has_failed = False

    async def run(self) -> None:
        """Start everything and return when it is over; every process has ended then.

        Raises:
            LaunchFailed: There is no Master and none can be started, or logs cannot be written.
            MasterUnavailable: A running Master is required and there is none.
        """
        # What was written is checked before anything is made.
        address = master_address()
        starts_master = await self._must_start_master(address)
        logs = new_log_directory(Path(self._description.file).name.partition(".")[0])
        self._display.say(f"logs are in {logs}")
        supervisor = Supervisor(self._happened, self._lines_came, logs)
        self._supervisor = supervisor
        showing = asyncio.create_task(self._keep_showing(supervisor))
        try:
            verdict = await self._until_over(supervisor, address, starts_master=starts_master)
            self.has_failed = verdict.has_failed
            self._display.say(f"over: {verdict.reason}", is_bad=verdict.has_failed)
        finally:
            self.has_failed |= supervisor.has_failed
            await supervisor.close(last=RESERVED_NAME)
            showing.cancel()
            self._show(supervisor)

    async def _until_over(
        self, supervisor: Supervisor, address: str, *, starts_master: bool
    ) -> Verdict:
        for process in self._description.processes:
            supervisor.add(process)
        if starts_master:
            supervisor.add(_master_process(address))
            supervisor.start(RESERVED_NAME)
            while supervisor.status(RESERVED_NAME).state is not State.RUNNING:
                await supervisor.wait_for_change()
                if (verdict := supervisor.verdict()) is not None and verdict.has_failed:
                    return verdict
        else:
            self._master = address
            self._display.say(f"using the Master at {address}")
        supervisor.use_master(self._master)
        supervisor.start(*(process.name for process in self._description.processes))
        while (verdict := supervisor.verdict({RESERVED_NAME})) is None:
            await supervisor.wait_for_change()
        return verdict

    async def _must_start_master(self, address: str) -> bool:
        host, port = split_address(address)
        if self._choice is not MasterChoice.START and port:
            async with MasterClient(address) as client:
                try:
                    await client.get_nodes()
                except MasterUnavailable:
                    if self._choice is MasterChoice.REQUIRE:
                        raise
                else:
                    return False
        if not is_loopback(host):
            raise LaunchFailed(
                f"no Master answers at {address}, and one can be started on this host only "
                "if SIMPLE_ROS_MASTER names it localhost"
            )
        if importlib.util.find_spec(_MASTER_MODULE) is None:
            raise LaunchFailed(
                f"there is no Master here: Python package {_MASTER_MODULE} is missing"
            )
        return True

    # -- what happens --------------------------------------------------------------------------

    def _happened(self, event: ProcessEvent) -> None:
        supervisor = self._supervisor
        assert supervisor is not None
        is_bad = isinstance(event, GivenUp) or (
            isinstance(event, Ended) and not event.expected and not event.exit.is_good
        )
        if not (isinstance(event, IsReady) and event.name in self._ready_at_once):
            self._display.say(str(event), is_bad=is_bad)
        if is_bad and isinstance(event, Ended):
            for line in supervisor.last_lines(event.name)[-_LINES_SHOWN:]:
                self._display.say(f"    {line}")
        path = supervisor.log_path(event.name)
        if isinstance(event, GivenUp) and path is not None and path.exists():
            self._display.say(f"    its log: {path}")

    def _lines_came(self, name: str, lines: Sequence[str]) -> None:
        if name == RESERVED_NAME and not self._master:
            found = [line for line in lines if _LISTENING in line]
            self._master = found[0].rpartition(" ")[2] if found else ""
        if name in self._to_screen:
            self._display.lines(name, lines)

    async def _keep_showing(self, supervisor: Supervisor) -> None:
        while True:
            self._show(supervisor)
            await asyncio.sleep(self._display.period_s)

    def _show(self, supervisor: Supervisor) -> None:
        rows = []
        for status in supervisor.statuses():
            lines = supervisor.last_lines(status.name)
            rows.append((status, supervisor.usage(status.name), lines[-1] if lines else ""))
        self._display.show(rows)


def _master_process(address: str) -> ProcessDescription:
    host, port = split_address(address)
    host = "127.0.0.1" if host == "localhost" else host
    command = (sys.executable, "-m", _MASTER_MODULE, "--host", host, "--port", str(port))
    return ProcessDescription(
        RESERVED_NAME,
        command,
        environment={"PYTHONUNBUFFERED": "1"},
        ready=Ready(ReadyWhen.OUTPUT, _LISTENING),
        # With port 0 a second one would be elsewhere, where nobody looks.
        respawn=Respawn(limit=3) if port else None,
        required=True,
    )
