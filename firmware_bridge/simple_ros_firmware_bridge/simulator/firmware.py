"""The firmware of a simulated robot_xl: what it measures when, and what it does when told."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from simple_ros_firmware_bridge.simulator import samples
from simple_ros_firmware_bridge.simulator.client import BoardClient
from simple_ros_firmware_bridge.simulator.creation import Topic
from simple_ros_firmware_bridge.simulator.robot import Robot

__all__ = ["Firmware"]

_MAX_STEP_S = 0.01


class Firmware:
    """Timers of a board and its robot. Times are seconds since the board was switched on.

    Args:
        seed: Of the noise.
        key: Client key.
        old_names: Publish under ``/ddd/...`` as the first firmware did.
        gives_up: See `BoardClient`.
        has_variance: Whether its Range has the member of Iron and later.
    """

    def __init__(
        self,
        seed: int = 1,
        key: bytes = b"\x0a\x0b\x0c\x0d",
        *,
        old_names: bool = False,
        gives_up: bool = False,
        has_variance: bool = False,
    ) -> None:
        self.robot = Robot(Random(seed))  # noqa: S311  (noise)
        self._has_variance = has_variance
        published: list[tuple[str, str, str, float, Callable[[int], bytes]]] = [
            ("/joint_states", "/joint_states", "sensor_msgs/JointState", 100, self._joints),
            ("/imu/data_raw", "/ddd/imu", "sensor_msgs/Imu", 50, self._imu),
            ("/odom", "/ddd/odom", "nav_msgs/Odometry", 20, self._odometry),
            ("/sensors/range_tof", "/ddd/range_tof", "sensor_msgs/Range", 10, self._tof),
            ("/sensors/range_ultrasonic", "/ddd/range", "sensor_msgs/Range", 10, self._sonar),
            ("/sensors/illuminance", "/ddd/illuminance", "sensor_msgs/Illuminance", 5, self._lux),
        ]
        topics = [
            Topic(number, old if old_names else new, type_name)
            for number, (new, old, type_name, _, _) in enumerate(published, 1)
        ]
        command = "/ddd/cmd_vel" if old_names else "/cmd_vel"
        self._command = len(topics)
        topics.append(Topic(15, command, "geometry_msgs/Twist", is_published=False))
        self.client = BoardClient(topics, key, gives_up=gives_up)
        self._timers = [(1 / rate, make) for _, _, _, rate, make in published]
        self._due = [0.001 * index for index in range(len(published))]
        self._stepped_at = 0.0

    def next_timeout(self) -> float:
        """When to call `run`."""
        timeout = self.client.next_timeout()
        due = [] if self.client.is_blocked else self._due
        return min([*due, *([] if timeout is None else [timeout])], default=self._stepped_at + 0.01)

    def receive(self, message: bytes, now: float) -> None:
        """A message of the agent."""
        self.client.receive(message, now)
        for index, data in self.client.take_samples():
            if index == self._command:
                self.robot.command(samples.twist(data), now)

    def run(self, now: float) -> None:
        """Let time pass and do what is due; while it waits for an answer the timers stand still."""
        while (rest := now - self._stepped_at) > 1e-9:
            step = min(_MAX_STEP_S, rest)
            self._stepped_at += step
            self.robot.step(self._stepped_at, step)
        self.client.handle_timeout(now)
        for index, (period, make) in enumerate(self._timers):
            if now < self._due[index] or self.client.is_blocked:
                continue
            self.client.publish(index, make(self._stamp_ns(now)), now)
            missed = (now - self._due[index]) // period
            self._due[index] += period * (1 + missed)

    def _stamp_ns(self, now: float) -> int:
        return round(now * 1e9) + (self.client.offset_ns or 0)

    def _joints(self, stamp_ns: int) -> bytes:
        return samples.joint_states(self.robot, stamp_ns)

    def _imu(self, stamp_ns: int) -> bytes:
        return samples.imu(self.robot, stamp_ns)

    def _odometry(self, stamp_ns: int) -> bytes:
        return samples.odometry(self.robot.pose, self.robot.body, stamp_ns)

    def _tof(self, stamp_ns: int) -> bytes:
        return samples.range_of(
            self.robot.distance_ahead(), stamp_ns, is_infrared=True, has_variance=self._has_variance
        )

    def _sonar(self, stamp_ns: int) -> bytes:
        return samples.range_of(
            self.robot.distance_ahead(),
            stamp_ns,
            is_infrared=False,
            has_variance=self._has_variance,
        )

    def _lux(self, stamp_ns: int) -> bytes:
        return samples.illuminance(300 + self.robot.random.gauss(0, 2), stamp_ns)
