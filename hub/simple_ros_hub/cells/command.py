"""The command cell."""

from __future__ import annotations

import time
from typing import ClassVar

from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.wireless_ros_msgs import ChannelState, Constraint, Degradation
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros_engines.cross_domain.mappings import convert_network_metrics_to_control_limits
from simple_ros_hub.cells.teleop import CommandGuard, Velocity
from simple_ros_hub.cells.topic_cell import TopicCell

__all__ = ["CommandCell"]

_SAFE = 3
_LEAST_RATE_HZ = 5.0
_MOST_RTT_MS = 2000.0


class CommandCell(TopicCell):
    """Remote commands: slower the later they come, none at all while the link is silent.

    Further parameters: ``source``, ``sink`` (Twist), ``safe_distance`` (m that may be driven blind),
    ``hold_when_safe`` (hold while the hub is at level SAFE).
    """

    cell_name: ClassVar[str] = "command_cell"
    summary: ClassVar[str] = "Remote commands, within what the link's delay allows."
    priority: int = 5
    share: ClassVar[float] = 0.1
    deadline_s: float = 0.1

    def __init__(self) -> None:
        super().__init__()
        self.guard = CommandGuard(convert_network_metrics_to_control_limits(20.0))
        self._publisher: Publisher[Twist] | None = None
        self._distance_m = 1.0
        self._holds_when_safe = True
        self._is_safe_level = False

    async def set_up(self, node: NodeHandle) -> None:
        """Join source and sink."""
        get = node.declare_parameter
        source = str(await get("~source", "/cmd_vel/remote", read_only=True))
        sink = str(await get("~sink", "/cmd_vel", read_only=True))
        self._distance_m = float(
            await get("~safe_distance", 1.0, minimum=0.05, maximum=100, read_only=True)
        )
        self._holds_when_safe = bool(await get("~hold_when_safe", True, read_only=True))
        self._publisher = await node.advertise(sink, Twist)
        await node.subscribe(source, Twist, self._command)
        node.create_timer(0.02, lambda _: self._tick())

    def _on_constraint(self, constraint: Constraint) -> None:
        if self.channel is None and constraint.expected_latency_ms > 0:
            self._limit(constraint.expected_latency_ms, 0.0)

    def _on_channel(self, state: ChannelState) -> None:
        if state.rtt_ms > 0:
            self._limit(state.rtt_ms, state.loss)

    def _limit(self, rtt_ms: float, loss: float) -> None:
        limits = convert_network_metrics_to_control_limits(
            min(_MOST_RTT_MS, rtt_ms), min(1.0, loss), safe_distance_m=self._distance_m
        )
        # Commands of an operator come in bursts after a delay; below this rate nobody can steer.
        rate_hz = max(_LEAST_RATE_HZ, limits.max_rate_hz)
        self.guard.limits = type(limits)(limits.max_speed_mps, rate_hz, limits.hold_timeout_s)

    def on_degradation(self, message: Degradation) -> None:
        """At level SAFE the robot is held."""
        self._is_safe_level = message.level >= _SAFE

    @property
    def _is_held(self) -> bool:
        return self._is_safe_level and self._holds_when_safe

    def _command(self, message: Twist) -> None:
        self.came(message.ByteSize())
        wanted = Velocity(message.linear.x, message.linear.y, message.angular.z)
        if self._is_held and not wanted.is_zero:
            self.held_back += 1
            self._pass(self.guard.hold())
            return
        self.execute(wanted)

    def _execute(self, wanted: Velocity) -> Velocity | None:
        """Pass a command on, within limits."""
        kept = self.guard.command(wanted, time.monotonic())
        if kept is None:
            self.held_back += 1
        self._pass(kept)
        return kept

    def _tick(self) -> None:
        self._pass(self.guard.hold() if self._is_held else self.guard.tick(time.monotonic()))

    def _pass(self, velocity: Velocity | None) -> None:
        # To the robot's own motors no budget of the link applies.
        if velocity is None or self._publisher is None or not self.active:
            return
        message = Twist()
        message.linear.x, message.linear.y = velocity.forward, velocity.left
        message.angular.z = velocity.turn
        self._publisher.publish(message)
        self.messages_out += 1
        self.bytes_out += message.ByteSize()
