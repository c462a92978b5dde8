"""The controller manager: 100 times a second it reads the robot, lets controllers decide, and tells the robot.

It listens to ``cmd_vel`` and tells the robot by ``hardware/cmd_vel``, which the bridge maps to the board's
``cmd_vel``; were both the same topic it would hear itself.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Any, Self

from simple_ros.aio import NodeHandle, Publisher
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.nav_msgs import Odometry
from simple_ros.msg.sensor_msgs import Imu, JointState
from simple_ros.msg.std_msgs import String
from simple_ros.qos import LATCHED, QosProfile
from simple_ros.tf import TransformBroadcaster
from simple_ros_firmware_bridge.control import messages
from simple_ros_firmware_bridge.control.drive import DriveController, Odometer
from simple_ros_firmware_bridge.control.hardware import (
    HardwareError,
    JointReading,
    MockSystem,
    RobotImu,
    RobotSystem,
)
from simple_ros_firmware_bridge.control.lifecycle import Lifecycle, State
from simple_ros_firmware_bridge.control.settings import Settings
from simple_ros_firmware_bridge.mecanum import BodySpeed

__all__ = ["ACTIVATION_LIMIT_S", "ControllerManager"]

logger = logging.getLogger(__name__)

PERIOD_S = 0.01
ACTIVATION_LIMIT_S = 5.0
_ODOMETRY_EVERY = 2
_POLL_S = 0.005
_RETRY_S = 1.0
_LOG_EVERY_S = 1.0
_NEWEST = QosProfile(depth=1)
_CONTROLLERS = {
    "RobotSystem": ("drive_controller", "joint_state_broadcaster"),
    "RobotImuSensor": ("imu_broadcaster",),
}
_NAMES = (*_CONTROLLERS, *_CONTROLLERS["RobotSystem"], *_CONTROLLERS["RobotImuSensor"])


class ControllerManager:
    """Runs the loop until it is closed. Make it by `create`.

    Args:
        node: A started node.
        settings: What it goes by.
        is_mock: Whether there is no board. Said loudly again and again.
    """

    def __init__(self, node: NodeHandle, settings: Settings, *, is_mock: bool = False) -> None:
        self._node = node
        self._loop = asyncio.get_running_loop()
        kind = MockSystem if is_mock else RobotSystem
        self.system = kind(settings.drive, settings.joint_period_s)
        self.imu = RobotImu(settings.imu_period_s)
        self.drive = DriveController(settings.drive, settings.limits)
        self.odometer = Odometer(settings.drive)
        self.lifecycles = {name: Lifecycle(name, self._changed) for name in _NAMES}
        self._is_mock = is_mock
        self._publishers: dict[str, Publisher[Any]] = {}
        self._tf: TransformBroadcaster | None = None
        self._ticks = 0
        self._updated_at = self._loop.time()
        self._logged: dict[str, float] = {}
        self._tasks: list[asyncio.Task[None]] = []

    @classmethod
    async def create(cls, node: NodeHandle, settings: Settings, *, is_mock: bool = False) -> Self:
        """A manager whose loop runs; hardware that does not answer is tried again and again."""
        manager = cls(node, settings, is_mock=is_mock)
        await manager._open()
        # Without a board there is no IMU to wait for.
        interfaces = (manager.system,) if is_mock else (manager.system, manager.imu)
        manager._tasks = [manager._loop.create_task(manager._bring_up(it)) for it in interfaces]
        node.create_timer(PERIOD_S, lambda _: manager.tick())
        return manager

    async def _open(self) -> None:
        topics: dict[str, tuple[type[Any], QosProfile]] = {
            "hardware/cmd_vel": (Twist, _NEWEST),
            "odometry/wheels": (Odometry, QosProfile(depth=10)),
            "joint_state_broadcaster/joint_states": (JointState, QosProfile(depth=10)),
            "imu/data": (Imu, QosProfile(depth=10)),
        }
        for name in _NAMES:
            topics[f"{name}/transition_event"] = (String, LATCHED)
        for topic, (message_class, qos) in topics.items():
            self._publishers[topic] = await self._node.advertise(topic, message_class, qos=qos)
        self._tf = await TransformBroadcaster.create(self._node)
        await self._node.subscribe("cmd_vel", Twist, self._command, qos=_NEWEST)
        await self._node.subscribe("joint_states", JointState, self._joints, qos=_NEWEST)
        await self._node.subscribe("imu/data_raw", Imu, self._imu, qos=_NEWEST)

    # -- what comes ----------------------------------------------------------------------------

    def _command(self, message: Twist) -> None:
        if not self.drive.command(messages.body_speed(message), self._loop.time()):
            self._complain("cmd_vel", "a command that is no speed (NaN or infinite) was refused")

    def _joints(self, message: JointState) -> None:
        self.system.joint_states_came(message, self._loop.time())

    def _imu(self, message: Imu) -> None:
        self.imu.imu_came(message, self._loop.time())

    # -- bringing up ---------------------------------------------------------------------------

    async def _bring_up(self, interface: RobotSystem | RobotImu) -> None:
        """Configure and activate it whenever it is not active, for as long as the program runs."""
        lifecycle = self.lifecycles[interface.lifecycle]
        while True:
            if lifecycle.state is State.UNCONFIGURED and not await self._activated(interface):
                await asyncio.sleep(_RETRY_S)
            await asyncio.sleep(_POLL_S)

    async def _activated(self, interface: RobotSystem | RobotImu) -> bool:
        lifecycle = self.lifecycles[interface.lifecycle]
        lifecycle.go("configure")
        interface.reset()
        end = self._loop.time() + ACTIVATION_LIMIT_S
        while (problem := self._problem_of(interface)) is not None:
            if self._loop.time() > end:
                logger.error("%s; not activated within %g s", problem, ACTIVATION_LIMIT_S)
                lifecycle.go("error")
                return False
            await asyncio.sleep(_POLL_S)
        lifecycle.go("activate")
        self._controllers(interface.lifecycle, is_up=True)
        return True

    def _problem_of(self, interface: RobotSystem | RobotImu) -> HardwareError | None:
        try:
            interface.read(self._loop.time())
        except HardwareError as error:
            return error
        return None

    def _controllers(self, interface: str, *, is_up: bool) -> None:
        """Controllers live and stop with the hardware they need."""
        if interface == RobotSystem.lifecycle:
            self.drive.stop()
            self.odometer.restart()
        for name in _CONTROLLERS[interface]:
            for transition in ("configure", "activate") if is_up else ("deactivate", "cleanup"):
                self.lifecycles[name].go(transition)

    # -- the loop ------------------------------------------------------------------------------

    def tick(self) -> None:
        """One period: read, decide, write."""
        now = self._loop.time()
        elapsed, self._updated_at = now - self._updated_at, now
        self._ticks += 1
        if self._is_mock:
            self._complain("mock", "MOCK MODE: operation=dev, no wheel is really turning")
        reading = self._read("RobotSystem", self.system, now)
        if reading is not None:
            # A loop that was held up must not make one huge step of it.
            wheels = self.drive.update(now, min(elapsed, 5 * PERIOD_S))
            self._tell(self.system.write(wheels, now))
            self._show(reading)
        measured = self._read("RobotImuSensor", self.imu, now)
        if measured is not None and self._ticks % _ODOMETRY_EVERY == 0:
            self._publishers["imu/data"].publish(measured)

    def _read(self, name: str, interface: Any, now: float) -> Any:
        if self.lifecycles[name].state is not State.ACTIVE:
            return None
        try:
            return interface.read(now)
        except HardwareError as error:
            self._complain(name, str(error))
            if name == "RobotSystem":
                self._tell(BodySpeed())
            self._controllers(name, is_up=False)
            self.lifecycles[name].go("error")
            return None

    def _tell(self, body: BodySpeed) -> None:
        self._publishers["hardware/cmd_vel"].publish(messages.twist(body))

    def _show(self, reading: JointReading) -> None:
        self.odometer.update(reading.angles, reading.speeds)
        if self._ticks % _ODOMETRY_EVERY:
            return
        stamp = self._node.clock.now()
        self._publishers["odometry/wheels"].publish(messages.odometry(self.odometer, stamp))
        states = messages.joint_state(reading, stamp)
        self._publishers["joint_state_broadcaster/joint_states"].publish(states)
        assert self._tf is not None
        self._tf.send([messages.transform(self.odometer, stamp)])

    def _changed(self, name: str, transition: str, before: State, after: State) -> None:
        logger.info("%s: %s, %s -> %s", name, transition, before.value, after.value)
        event = String(data=f"{transition}: {before.value} -> {after.value}")
        self._publishers[f"{name}/transition_event"].publish(event)

    def _complain(self, what: str, text: str) -> None:
        """Log an error, at most once a second of its kind."""
        now = self._loop.time()
        if now - self._logged.get(what, -_LOG_EVERY_S) >= _LOG_EVERY_S:
            self._logged[what] = now
            logger.error("%s", text)

    async def close(self) -> None:
        """Stop the robot and finalize everything."""
        for task in self._tasks:
            task.cancel()
        if self.lifecycles["RobotSystem"].state is State.ACTIVE:
            self._tell(BodySpeed())
        for lifecycle in self.lifecycles.values():
            lifecycle.go("shutdown")
