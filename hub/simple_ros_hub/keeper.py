"""Processes that outlive the hub: started apart from it, found again by a later one.

Each is the leader of a session of its own and writes to a file, so nothing ties it to the hub. A
variable in its environment says whose it is; a new hub finds it by that, in ``/proc``. Ends are told by pidfds,
which work for children of others too, and never mean another process of the same number. Linux only.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import resource
import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import psutil

from simple_ros.launch import Exit, Limits
from simple_ros.launch.usage import Usage, UsageMeter
from simple_ros_hub.components import Component

__all__ = ["Ended", "ProcessKeeper"]

logger = logging.getLogger(__name__)

MARK = "SIMPLE_ROS_HUB_COMPONENT"
_LOG_BYTES = 5_000_000
_TAIL_BYTES = 4096

Ended = Callable[[str, str], None]


@dataclass(slots=True)
class _Process:
    pid: int
    handle: int
    is_child: bool
    meter: UsageMeter
    over: asyncio.Event


class ProcessKeeper:
    """Starts, finds and ends the processes of components.

    Args:
        directory: Of this system; log files go there, and it tells its processes from others'.
        on_end: Called with a component's name and how its process ended.
        master: Told to the processes.
    """

    def __init__(self, directory: Path, on_end: Ended, master: str) -> None:
        self._directory = directory
        self._on_end = on_end
        self._master = master
        self._running: dict[str, _Process] = {}
        self._loop = asyncio.get_running_loop()

    def recover(self, names: Mapping[str, Component]) -> dict[str, int]:
        """Take over what an earlier hub started and still runs; their process ids by name.

        Of two with one name the younger is kept, the other is killed; so are those of names not known.
        """
        found: dict[str, psutil.Process] = {}
        for process, name in _marked(str(self._directory)):
            other = found.get(name)
            if name not in names:
                logger.warning(
                    "process %d of component %r, unknown now, is killed", process.pid, name
                )
                _kill_group(process.pid)
            elif other is None or other.create_time() <= process.create_time():
                found[name] = process
                if other is not None:
                    _kill_group(other.pid)
            else:
                _kill_group(process.pid)
        taken = {}
        for name, process in found.items():
            with contextlib.suppress(ProcessLookupError):
                self._watch(name, process.pid, is_child=False)
                taken[name] = process.pid
        return taken

    def start(self, component: Component) -> int:
        """Start a component's process; its process id.

        Raises:
            OSError: It cannot be started.
        """
        log = os.open(
            self._fresh_log(component.name), os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644
        )
        try:
            pid = os.posix_spawnp(
                component.command[0],
                component.command,
                self._environment(component),
                file_actions=[
                    (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
                    (os.POSIX_SPAWN_DUP2, log, 1),
                    (os.POSIX_SPAWN_DUP2, log, 2),
                ],
                setsid=True,
                setsigmask=(),
                setsigdef=(signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE),
            )
        finally:
            os.close(log)
        self._watch(component.name, pid, is_child=True)
        _limit(pid, component.limits)
        return pid

    def kill(self, name: str) -> None:
        """End it and what it started at once, also if it is stopped (SIGSTOP); nothing if it has ended."""
        process = self._running.get(name)
        if process is not None:
            _kill_group(process.pid)

    async def stop(self, name: str, patience_s: float = 1.2) -> None:
        """End it with SIGINT, after ``patience_s`` with SIGKILL; returns when it has ended."""
        process = self._running.get(name)
        if process is None:
            return
        for number in (signal.SIGINT, signal.SIGKILL):
            with contextlib.suppress(ProcessLookupError):
                # A stopped process only heeds signals once it goes on.
                os.killpg(process.pid, number)
                os.killpg(process.pid, signal.SIGCONT)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(patience_s):
                    await process.over.wait()
                return

    async def close(self, *, leave_running: bool) -> None:
        """Watch no more; end all processes first, unless they are to run on."""
        if not leave_running:
            await asyncio.gather(*(self.stop(name) for name in list(self._running)))
        for process in self._running.values():
            self._loop.remove_reader(process.handle)
            os.close(process.handle)
        self._running.clear()

    def usage(self, name: str) -> Usage | None:
        """CPU since the last call and memory of its process; None if it has none."""
        process = self._running.get(name)
        return None if process is None else process.meter.usage()

    def log_path(self, name: str) -> Path:
        """Where its output goes."""
        return self._directory / f"{name}.log"

    def last_line(self, name: str) -> str:
        """The last line of its output; empty if there is none."""
        try:
            with self.log_path(name).open("rb") as file:
                file.seek(max(0, file.seek(0, os.SEEK_END) - _TAIL_BYTES))
                lines = file.read().decode(errors="replace").split("\n")
        except OSError:
            return ""
        return next((line.strip() for line in reversed(lines) if line.strip()), "")

    # -- inside --------------------------------------------------------------------------------

    def _environment(self, component: Component) -> dict[str, str]:
        ours = {
            "SIMPLE_ROS_MASTER": self._master,
            MARK: f"{self._directory}:{component.name}",
            "PYTHONUNBUFFERED": "1",
        }
        inherited = {name: value for name, value in os.environ.items() if name != "NOTIFY_SOCKET"}
        return {**inherited, **component.variables, **ours}

    def _fresh_log(self, name: str) -> Path:
        path = self.log_path(name)
        with contextlib.suppress(FileNotFoundError):
            if path.stat().st_size > _LOG_BYTES:
                path.replace(path.with_suffix(".log.1"))
        return path

    def _watch(self, name: str, pid: int, *, is_child: bool) -> None:
        handle = os.pidfd_open(pid)
        self._running[name] = _Process(pid, handle, is_child, UsageMeter(pid), asyncio.Event())
        self._loop.add_reader(handle, self._has_ended, name)

    def _has_ended(self, name: str) -> None:
        process = self._running.pop(name)
        self._loop.remove_reader(process.handle)
        # What it started must not go on without it. Its number is not given away before it is waited for.
        _kill_group(process.pid)
        how = self._how(process)
        os.close(process.handle)
        process.over.set()
        says_why = process.is_child and how != "ended with code 0" and "killed" not in how
        line = self.last_line(name) if says_why else ""
        self._on_end(name, f"{how} ({line})" if line else how)

    def _how(self, process: _Process) -> str:
        if not process.is_child:
            return "ended"
        with contextlib.suppress(ChildProcessError):
            _, status = os.waitpid(process.pid, 0)
            return str(Exit(os.waitstatus_to_exitcode(status)))
        return "ended"


def _marked(directory: str) -> list[tuple[psutil.Process, str]]:
    """Leaders of sessions that a hub of this directory started, with their components' names."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, OSError):
            mark = process.environ().get(MARK, "")
            place, colon, name = mark.rpartition(":")
            is_leader = os.getsid(process.pid) == process.pid
            if colon and place == directory and is_leader and process.status() != "zombie":
                found.append((process, name))
    return found


def _kill_group(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def _limit(pid: int, limits: Limits) -> None:
    wishes = {
        resource.RLIMIT_DATA: limits.memory_bytes,
        resource.RLIMIT_CPU: limits.cpu_seconds,
        resource.RLIMIT_NOFILE: limits.files,
    }
    try:
        for kind, most in wishes.items():
            if most is not None:
                resource.prlimit(pid, kind, (most, most))
        if limits.nice is not None:
            os.setpriority(os.PRIO_PROCESS, pid, limits.nice)
    except ProcessLookupError:
        return  # It has ended already, which is told elsewhere.
    except (OSError, ValueError) as error:
        logger.warning("process %d runs without its limits: %s", pid, error)
