"""What the hub takes over from one before it, and leaves to the next."""

from __future__ import annotations

import logging
import os
import time
from typing import TYPE_CHECKING

from simple_ros.errors import ConfigError
from simple_ros_hub.conditions import State
from simple_ros_hub.degradation import DegradationJudge, Level
from simple_ros_hub.memory import Memory
from simple_ros_hub.policy import PolicyKeeper
from simple_ros_hub.routes import RouteJudge
from simple_ros_hub.steering import Steering

if TYPE_CHECKING:
    from simple_ros_hub.hub import Hub

__all__ = ["Recollection"]

logger = logging.getLogger(__name__)


class Recollection:
    """Reads and writes a hub's memory.

    Args:
        hub: Whose.
    """

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._written: Memory | None = None

    def recall(self) -> Memory:
        """Go on with policy, degradation, route and conditions of an earlier hub."""
        hub = self._hub
        before = Memory.of(hub.place.remembered())
        hub.policy = PolicyKeeper(hub.settings.policy_dwell_s)
        try:
            if before.policy:
                hub.policy.pin(before.policy, time.monotonic())
                hub.policy.pinned = before.pinned
        except ConfigError:
            logger.warning("the policy %r of an earlier hub is unknown", before.policy)
        hub.steering = Steering(hub.node, before.base, hub.steering_trouble)
        hub.degradation = DegradationJudge(level=Level(before.level))
        hub.chronicle.go_on(before.present)
        if hub.settings.routes:
            hub.routes = RouteJudge(hub.settings.routes, before.route)
        return before

    def take_over(self, before: Memory) -> bool:
        """Processes of an earlier hub; those that ended since are started in their turn.

        Returns:
            Whether that are all components.
        """
        hub = self._hub
        if before.hub:
            hub.log_error(f"The hub before this one died (process {before.hub})")
        found = hub.keeper.recover(hub.components)
        for name, pid in found.items():
            hub.supervision.found(name, pid, time.monotonic())
        for name, pid in before.pids.items():
            if name in hub.components and name not in found:
                hub.supervision.lost(name, pid)
        for name in before.stopped:
            if name in hub.components and name not in found:
                hub.supervision.was_stopped(name)
        return {*found, *before.pids, *before.stopped} >= hub.components.keys()

    def remember(self) -> None:
        """Write what changed; call it often."""
        self._write(os.getpid(), processes=True)

    def ended(self, *, leave_running: bool) -> None:
        """The hub ends as it was asked to; nothing if it never got to work."""
        if self._written is not None:
            self._write(0, processes=leave_running)

    def _write(self, pid: int, *, processes: bool) -> None:
        hub = self._hub
        memory = self._memory(pid, processes=processes)
        if memory == self._written:
            return
        trouble = ""
        try:
            hub.place.remember(memory.facts())
        except OSError as error:
            trouble = f"nothing is remembered in {hub.place.directory}: {error.strerror}"
        else:
            self._written = memory
        hub.condition("memory", trouble, "the hub can remember again", 0.0)

    def _memory(self, pid: int, *, processes: bool) -> Memory:
        hub = self._hub
        views = hub.supervision.views()
        pids = {view.component.name: view.pid for view in views if view.pid}
        return Memory(
            hub=pid,
            pids=pids if processes else {},
            stopped=tuple(view.component.name for view in views if view.state is State.STOPPED),
            present=hub.journal.present,
            level=int(hub.degradation.level),
            policy=hub.policy.policy,
            pinned=hub.policy.pinned,
            # A copy: the present one changes.
            base={name: dict(group) for name, group in hub.steering.base.items()},
            route=hub.routes.route if hub.routes is not None else "",
        )
