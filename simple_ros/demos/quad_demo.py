"""What ``simple-ros demo`` does: starts the Master and the quadrotor's nodes, and watches them.

The Master, each node and the Foxglove bridge are processes of their own, as on a robot. This process adds a node too,
``demo_view``, which learns all it shows from the topics and from the Master.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import math
import os
import sys
from collections.abc import Coroutine
from typing import Any, Protocol

from simple_ros.demos.observer import TopicObserver
from simple_ros.demos.ports import free_port
from simple_ros.demos.processes import DemoProcess, ProcessEnded, Processes, UsageMeter
from simple_ros.demos.quad_demo_view import DemoState, ProcessRow
from simple_ros.errors import SimpleRosError
from simple_ros.msg.geometry_msgs import Odometry
from simple_ros.msg.visualization_msgs import Marker
from simple_ros.node import NodeHandle

__all__ = ["DemoFailed", "Display", "QuadDemo"]

_MASTER_MODULE = "simple_ros_master"
_NODES = ("quad_simulator", "quad_visualizer")
_BRIDGE = ("simple_ros.cli.main", "foxglove")
_TOPICS = {
    "quad_odometry": "geometry_msgs.Odometry",
    "quad_marker_array": "visualization_msgs.MarkerArray",
    "quad_path_short": "visualization_msgs.Marker",
    "quad_path_incremental": "visualization_msgs.Marker",
}
_FLOWING_WITHIN_S = 30.0
_USAGE_EVERY_S = 1.0


class DemoFailed(SimpleRosError, RuntimeError):
    """The demo cannot start, or its messages do not flow."""


class Display(Protocol):
    """Where the demo is shown."""

    period_s: float

    def say(self, line: str) -> None:
        """What is also in the state, for a display that scrolls."""

    def show(self, state: DemoState) -> None:
        """What is known now."""


class QuadDemo:
    """One run of the demo; made on the running event loop.

    Args:
        display: Where to show it.
        command: How ``simple-ros`` is called here.
        duration_s: How long to fly, counted from when messages flow on all topics; None for ever.
        foxglove_port: Where apps find the flight, or one of the next ports if it is taken; 0 for
            any free one, None for no bridge.
    """

    def __init__(
        self,
        display: Display,
        command: str,
        duration_s: float | None,
        foxglove_port: int | None = None,
    ) -> None:
        self._display = display
        self._command = command
        self._duration_s = math.inf if duration_s is None else duration_s
        self._foxglove_port = foxglove_port
        self._foxglove = self._app_link = ""
        self._bridge: DemoProcess | None = None
        self._clock = asyncio.get_running_loop().time
        self._started = self._clock()
        self._flying_since: float | None = None
        self._master = ""
        self._notice = ""
        self._topics = TopicObserver(_TOPICS)
        self._processes = Processes()
        self._own_meter = UsageMeter(os.getpid())
        self._process_rows: tuple[ProcessRow, ...] = ()
        self._measured_at = -math.inf

    async def run(self, master_port: int) -> None:
        """Fly; every process has ended when this returns, raises or is cancelled.

        Args:
            master_port: Where the Master shall listen; if somebody else does, it takes another.

        Raises:
            ProcessEnded: One of the processes ended by itself.
            DemoFailed: Messages do not flow on all topics, or no Master is installed.
        """
        async with self._processes:
            await self._start_master(master_port)
            for name in _NODES:
                await self._start(name, f"simple_ros.demos.{name}", "--master", self._master)
            if self._foxglove_port is not None:
                await self._start_bridge(self._foxglove_port)
            await _unless_ended(self._processes.first_end(), self._watch())

    @property
    def summary(self) -> str:
        """What came of it, in one line."""
        rows = [row for row in self._topics.rows() if row.messages]
        messages = sum(row.messages for row in rows)
        return f"demo over: {messages:,} messages on {len(rows)} topics"

    # -- starting ------------------------------------------------------------------------------

    async def _start_master(self, port: int) -> None:
        if importlib.util.find_spec(_MASTER_MODULE) is None:
            raise DemoFailed(f"there is no Master here: Python package {_MASTER_MODULE} is missing")
        try:
            self._master = await self._started_master(port)
        except ProcessEnded as error:
            if not port or " in use " not in error.last_words:
                raise
            self._processes.children.clear()
            self._master = await self._started_master(0)
            self._notice = f"port {port} is taken, so this Master is at {self._master}"
        self._display.say(
            f"{self._notice or f'the Master is at {self._master}'}; look at it from another "
            f"terminal: export SIMPLE_ROS_MASTER={self._master}; {self._command} graph"
        )

    async def _started_master(self, port: int) -> str:
        child = await self._start("master", _MASTER_MODULE, "--port", str(port))
        line = await child.line_with("listening on ")
        return line.rpartition(" ")[2]

    async def _start_bridge(self, port: int) -> None:
        module, *arguments = _BRIDGE
        options = ("--master", self._master, "--port", str(free_port(port)))
        self._bridge = await self._start("foxglove", module, *arguments, *options)

    async def _learn_link(self) -> None:
        """Wait until the bridge says where apps find it; that it ended instead is told elsewhere."""
        if self._bridge is None:
            return
        with contextlib.suppress(ProcessEnded):
            line = await self._bridge.line_with("listening at ")
            link = await self._bridge.line_with("open ")
            self._foxglove = line.removeprefix("listening at ")
            self._app_link = link.removeprefix("open ")
            self._display.say(
                f"in Foxglove: open {self._app_link}; arrange the panels by importing the "
                f"layout that {self._command} demo --layout prints"
            )

    async def _start(self, name: str, module: str, *arguments: str) -> DemoProcess:
        return await self._processes.start(name, [sys.executable, "-m", module, *arguments])

    # -- watching ------------------------------------------------------------------------------

    async def _watch(self) -> None:
        async with NodeHandle("demo_view", master=self._master) as node:
            await self._topics.subscribe(node)
            watching = asyncio.gather(self._topics.watch_graph(node.client), self._learn_link())
            try:
                while not self._is_over():
                    await self._pause()
                    self._display.show(self._state())
            finally:
                watching.cancel()
                await asyncio.gather(watching, return_exceptions=True)

    async def _pause(self) -> None:
        """Until it is time to show again."""
        if self._flying_since is None:
            try:
                async with asyncio.timeout(self._display.period_s):
                    await self._topics.flowing.wait()
            except TimeoutError:
                return
            self._flying_since = self._clock()
            self._display.say("messages flow on all topics")
        left_s = self._flying_since + self._duration_s - self._clock()
        await asyncio.sleep(min(self._display.period_s, left_s))

    def _is_over(self) -> bool:
        """Whether the time is up.

        Raises:
            DemoFailed: It is, and messages do not flow.
        """
        now = self._clock()
        if self._duration_s == math.inf:
            return False
        if self._flying_since is None:
            limit, over = _FLOWING_WITHIN_S, now - self._started >= _FLOWING_WITHIN_S
        else:
            limit, over = self._duration_s, now - self._flying_since >= self._duration_s
        silent = [row.name for row in self._topics.rows() if not row.rate_hz]
        if over and silent:
            raise DemoFailed(f"no messages on {', '.join(silent)} after {limit:g} s")
        return over

    def _state(self) -> DemoState:
        newest = self._topics.newest
        odometry, path = newest.get("quad_odometry"), newest.get("quad_path_short")
        since = self._flying_since
        return DemoState(
            self._master,
            self._command,
            None if since is None else self._clock() - since,
            self._notice,
            self._topics.rows(),
            None if odometry is None else Odometry.FromString(odometry),
            () if path is None else tuple(Marker.FromString(path).points),
            self._measured_processes(),
            self._foxglove,
            self._app_link,
        )

    def _measured_processes(self) -> tuple[ProcessRow, ...]:
        """Measured once a second: CPU shares over shorter times only flicker."""
        if self._clock() - self._measured_at >= _USAGE_EVERY_S:
            self._measured_at = self._clock()
            rows = [
                ProcessRow(child.name, child.pid, child.state, child.meter.usage())
                for child in self._processes.children
            ]
            rows.append(ProcessRow("demo_view", os.getpid(), "running", self._own_meter.usage()))
            self._process_rows = tuple(rows)
        return self._process_rows


async def _unless_ended(
    ending: Coroutine[Any, Any, ProcessEnded], work: Coroutine[Any, Any, None]
) -> None:
    """Do the work; if a process ends first, raise that."""
    ended, done = asyncio.create_task(ending), asyncio.create_task(work)
    try:
        await asyncio.wait((ended, done), return_when=asyncio.FIRST_COMPLETED)
        if ended.done():
            raise ended.result()
        await done
    finally:
        ended.cancel()
        done.cancel()
        await asyncio.gather(ended, done, return_exceptions=True)
