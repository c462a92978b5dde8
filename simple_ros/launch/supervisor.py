"""Runs processes as a `Plan` decides: the library under ``simple-ros launch``, for other programs too.

::

    async with Supervisor(on_event=print) as supervisor:
        supervisor.add(ProcessDescription("camera", ("python3", "-m", "my_robot.camera")))
        supervisor.start("camera")
        ...
        await supervisor.restart("camera")

All of it happens on the event loop it is made on. Every process has ended when the block is left.
"""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Self

from simple_ros.launch.child_process import GENTLY, ChildProcess, Command, StopStep
from simple_ros.launch.description import LogTo, ProcessDescription, ReadyWhen
from simple_ros.launch.events import Ended, Exit, GivenUp, ProcessEvent, Restarting, Started
from simple_ros.launch.guarding import Guard
from simple_ros.launch.logs import LogFile
from simple_ros.launch.plan import Plan, State, Status, Verdict
from simple_ros.launch.readiness import NotifySocket, watch_nodes
from simple_ros.launch.usage import Usage

__all__ = ["Supervisor"]

_LOGGED = (Started, Ended, Restarting, GivenUp)
OnEvent = Callable[[ProcessEvent], None]
OnLines = Callable[[str, Sequence[str]], None]


class Supervisor:
    """Starts, watches, restarts and ends processes.

    Args:
        on_event: Called with what happens to them, as it happens.
        on_lines: Called with a process's name and lines of its output.
        log_directory: Where log files go; None for no files.
    """

    def __init__(
        self,
        on_event: OnEvent | None = None,
        on_lines: OnLines | None = None,
        log_directory: Path | None = None,
    ) -> None:
        self._on_event = on_event
        self._on_lines = on_lines
        self._log_directory = log_directory
        self._loop = asyncio.get_running_loop()
        self._plan = Plan()
        self._runs: dict[str, asyncio.Task[None]] = {}
        self._children: dict[str, ChildProcess] = {}
        self._logs: dict[str, LogFile] = {}
        self._guard = Guard()
        self._timer: asyncio.TimerHandle | None = None
        self._watching: asyncio.Task[None] | None = None
        self._changed = asyncio.Event()
        self._sockets: Path | None = None
        self._master: str | None = None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    # -- for everybody -------------------------------------------------------------------------

    def use_master(self, address: str) -> None:
        """Where the Master is: processes get it in their environment, and nodes are awaited there.

        Without it no process is ready by being registered.
        """
        self._master = address
        if self._watching is not None:
            self._watching.cancel()
        self._watching = self._loop.create_task(watch_nodes(address, self._node_came))

    def add(self, description: ProcessDescription) -> None:
        """Know a process; `start` starts it.

        Raises:
            ValueError: One of this name runs.
        """
        if description.name in self._runs:
            raise ValueError(f"process {description.name!r} runs")
        self._plan.add(description)

    def start(self, *names: str) -> None:
        """Start processes, each once those it comes after are ready. Nothing for one that runs.

        Raises:
            UnknownProcess: There is none of that name.
        """
        for name in names:
            self._plan.start(name)
        self._settle()

    async def stop(self, name: str, steps: Sequence[StopStep] = GENTLY) -> None:
        """End a process and what it started; it is not restarted. Returns when it has ended.

        Args:
            name: Which one.
            steps: Signals, each with the seconds it gets then; SIGKILL follows.

        Raises:
            UnknownProcess: There is none of that name.
        """
        self._plan.stop(name)
        self._settle()
        run, child = self._runs.get(name), self._children.get(name)
        if child is not None:
            await child.stop(steps)
        if run is not None:
            await asyncio.wait([run])

    async def kill(self, name: str) -> None:
        """As `stop`, at once with SIGKILL."""
        await self.stop(name, ())

    async def restart(self, name: str) -> None:
        """End a process and start it again; its restarts are counted anew."""
        await self.stop(name)
        self.start(name)

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a process and what it started; what comes of it is its own doing.

        Raises:
            UnknownProcess: There is none of that name.
        """
        self._plan.status(name)
        child = self._children.get(name)
        if child is not None:
            child.signal(number)

    def status(self, name: str) -> Status:
        """What is known about a process.

        Raises:
            UnknownProcess: There is none of that name.
        """
        return self._plan.status(name)

    def statuses(self) -> list[Status]:
        """All processes, in the order they were added."""
        return self._plan.statuses()

    def usage(self, name: str) -> Usage | None:
        """CPU since the last call and memory of a process; None if it does not run."""
        child = self._children.get(name)
        return None if child is None else child.meter.usage()

    def last_lines(self, name: str) -> Sequence[str]:
        """The last lines of output of a process's newest run."""
        child = self._children.get(name)
        return () if child is None else child.last_lines

    def log_path(self, name: str) -> Path | None:
        """Its log file, or None."""
        wanted = self._plan.description(name).log is not LogTo.SCREEN
        if self._log_directory is None or not wanted:
            return None
        return self._log_directory / f"{name.replace('/', '-')}.log"

    def verdict(self, background: Collection[str] = ()) -> Verdict | None:
        """Why all of it is over, or None; see `Plan.verdict`."""
        return self._plan.verdict(background)

    @property
    def has_failed(self) -> bool:
        """Whether any process was given up."""
        return self._plan.has_failed

    async def wait_for_change(self) -> None:
        """Return when anything has happened to any process since the last call."""
        await self._changed.wait()
        self._changed.clear()

    async def close(self, last: str = "") -> None:
        """End all processes at once, within some 4 s.

        Args:
            last: One that ends after the others.
        """
        others = [status.name for status in self.statuses() if status.name != last]
        await asyncio.gather(*(self.stop(name) for name in others))
        if len(others) < len(self.statuses()):
            await self.stop(last, [(number, patience_s / 2) for number, patience_s in GENTLY])
        if self._watching is not None:
            self._watching.cancel()
            await asyncio.gather(self._watching, return_exceptions=True)
        if self._timer is not None:
            self._timer.cancel()
        for log in self._logs.values():
            log.close()
        await self._guard.close()
        if self._sockets is not None:
            shutil.rmtree(self._sockets, ignore_errors=True)
            self._sockets = None

    # -- inside --------------------------------------------------------------------------------

    def _settle(self) -> None:
        """Carry out what the plan has decided."""
        for name in self._plan.take_starts():
            self._runs[name] = self._loop.create_task(self._run(name))
        for event in self._plan.take_events():
            self._tell(event)
        if self._timer is not None:
            self._timer.cancel()
        due = self._plan.next_timeout()
        self._timer = None if due is None else self._loop.call_at(due, self._time_is_up)
        self._changed.set()

    def _time_is_up(self) -> None:
        # The loop may call a little before the time.
        self._plan.handle_timeout(max(self._loop.time(), self._plan.next_timeout() or 0.0))
        self._settle()

    def _tell(self, event: ProcessEvent) -> None:
        log = self._log(event.name)
        if log is not None and isinstance(event, _LOGGED):
            log.note(str(event).removeprefix(f"{event.name}: "))
        if self._on_event is not None:
            self._on_event(event)

    def _log(self, name: str) -> LogFile | None:
        path = self.log_path(name)
        if path is None:
            return None
        return self._logs.setdefault(name, LogFile(path))

    def _lines_came(self, name: str, lines: Sequence[str]) -> None:
        log = self._log(name)
        if log is not None:
            log.lines(lines)
        ready = self._plan.description(name).ready
        if ready.when is ReadyWhen.OUTPUT and any(ready.text in line for line in lines):
            self._is_ready(name)
        if self._on_lines is not None:
            self._on_lines(name, lines)

    def _node_came(self, name: str) -> None:
        known = {status.name for status in self.statuses() if status.state is State.STARTING}
        if name in known and self._plan.description(name).ready.when is ReadyWhen.REGISTERED:
            self._is_ready(name)

    def _is_ready(self, name: str) -> None:
        if self._plan.status(name).state is State.STARTING:
            self._plan.ready(name, self._loop.time())
            self._settle()

    async def _run(self, name: str) -> None:
        """One run of a process, from its start to its end."""
        description = self._plan.description(name)
        notify: NotifySocket | None = None
        if description.ready.when is ReadyWhen.NOTIFY:
            notify = NotifySocket(self._socket_path(name), lambda: self._is_ready(name))
        try:
            how = await self._ran(description, notify)
        except OSError as error:
            how = Exit(1, error.strerror or str(error))
        finally:
            if notify is not None:
                notify.close()
        self._runs.pop(name)
        self._plan.ended(name, how, self._loop.time())
        self._settle()

    async def _ran(self, description: ProcessDescription, notify: NotifySocket | None) -> Exit:
        name = description.name
        master = {} if self._master is None else {"SIMPLE_ROS_MASTER": self._master}
        # A process that does not notify must not answer for this one's own starter.
        socket = {"NOTIFY_SOCKET": None if notify is None else str(notify.path)}
        variables = {**master, **socket, "SIMPLE_ROS_ARGS": None, **description.variables}
        command = Command(description.command, variables, description.cwd, description.limits)
        child = await ChildProcess.start(command, lambda lines: self._lines_came(name, lines))
        self._children[name] = child
        await self._guard.watch(child.pid)
        self._plan.started(name, child.pid, self._loop.time())
        self._settle()
        if self._plan.status(name).state is State.STOPPING:
            await child.stop()
        how = await child.ended()
        self._guard.forget(child.pid)
        return how

    def _socket_path(self, name: str) -> Path:
        # The path of a socket has at most 107 bytes, names may have more.
        if self._sockets is None:
            self._sockets = Path(tempfile.mkdtemp(prefix="simple_ros_"))
        names = [status.name for status in self.statuses()]
        return self._sockets / str(names.index(name))
