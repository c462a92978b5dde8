"""Lifecycles, hardware interfaces and the drive controller, without time or topics."""

from __future__ import annotations

import logging
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.msg.sensor_msgs import Imu, JointState
from simple_ros_firmware_bridge.control.drive import DriveController, DriveLimits, Odometer, limited
from simple_ros_firmware_bridge.control.hardware import (
    WHEEL_JOINTS,
    HardwareError,
    MockSystem,
    RobotImu,
    RobotSystem,
)
from simple_ros_firmware_bridge.control.lifecycle import InvalidTransition, Lifecycle, State
from simple_ros_firmware_bridge.mecanum import BodySpeed, Mecanum, WheelSpeeds

DRIVE = Mecanum(0.05, 0.3)


def joints(names: tuple[str, ...] = WHEEL_JOINTS) -> JointState:
    return JointState(
        name=names, position=range(len(names)), velocity=[10.0 * i for i in range(len(names))]
    )


def test_a_life() -> None:
    seen: list[str] = []
    life = Lifecycle("arm", lambda name, how, old, new: seen.append(f"{name} {how} {new.value}"))
    for transition in ("configure", "activate", "error", "configure", "activate", "shutdown"):
        life.go(transition)
    assert life.state is State.FINALIZED
    assert seen[2] == "arm error unconfigured"
    with pytest.raises(InvalidTransition, match="arm is finalized: it cannot activate"):
        life.go("activate")


def test_joints_are_read_by_name_and_unknown_ones_told_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    system = RobotSystem(DRIVE)
    message = joints((*reversed(WHEEL_JOINTS), "gripper"))
    with caplog.at_level(logging.ERROR):
        for _ in range(3):
            system.joint_states_came(message, 1.0)
    assert system.read(1.0).angles == (3, 2, 1, 0)
    assert system.read(1.0).speeds == WheelSpeeds(30, 20, 10, 0)
    assert caplog.text.count("'gripper'") == 1


@pytest.mark.parametrize("nonsense", [math.nan, math.inf])
def test_nonsense_of_a_board_does_not_stay(nonsense: float) -> None:
    system = RobotSystem(DRIVE, period_s=0.01)
    system.joint_states_came(joints(), 1.0)
    wrong = joints()
    wrong.position[0] = nonsense
    system.joint_states_came(wrong, 2.0)
    with pytest.raises(HardwareError, match="1000 ms ago"):
        system.read(2.0)
    system.joint_states_came(joints(), 3.0)
    assert system.read(3.0).angles == (0, 1, 2, 3)


def test_a_dead_board_does_not_look_alive() -> None:
    system = RobotSystem(DRIVE, period_s=0.01)
    with pytest.raises(HardwareError, match="RobotSystem: no joint states received"):
        system.read(0.0)
    system.joint_states_came(joints(WHEEL_JOINTS[:3]), 0.0)
    with pytest.raises(HardwareError):  # one wheel is missing
        system.read(0.0)
    system.joint_states_came(joints(), 1.0)
    system.read(1.049)
    with pytest.raises(HardwareError, match="60 ms ago"):
        system.read(1.06)
    system.joint_states_came(joints(), 2.0)
    system.reset()
    with pytest.raises(HardwareError):
        system.read(2.0)


def test_names_without_numbers_are_not_believed() -> None:
    system = RobotSystem(DRIVE)
    system.joint_states_came(JointState(name=WHEEL_JOINTS, position=[1.0]), 1.0)
    with pytest.raises(HardwareError):
        system.read(1.0)


def test_wheel_speeds_become_a_twist_and_the_mock_follows() -> None:
    body = BodySpeed(0.3, -0.2, 0.5)
    wheels = DRIVE.wheels(body)
    assert RobotSystem(DRIVE).write(wheels, 0.0) == pytest.approx(body)
    mock = MockSystem(DRIVE)
    mock.write(wheels, 1.0)
    reading = mock.read(2.0)
    assert reading.speeds == wheels
    assert reading.angles == pytest.approx(wheels)


def test_the_imu_gets_old() -> None:
    imu = RobotImu(period_s=0.02)
    with pytest.raises(HardwareError, match="RobotImuSensor: no IMU data"):
        imu.read(0.0)
    imu.imu_came(Imu(), 1.0)
    imu.read(1.099)
    with pytest.raises(HardwareError):
        imu.read(1.11)


LIMITS = DriveLimits(1.0, 2.0, 2.0, 8.0, 0.5)
speeds = st.floats(-5, 5)


@given(speeds, speeds, speeds, st.floats(0.001, 0.05))
def test_limits_hold_and_the_wish_is_reached(vx: float, vy: float, wz: float, dt_s: float) -> None:
    now = BodySpeed()
    for _ in range(4000):
        new = limited(BodySpeed(vx, vy, wz), now, dt_s, LIMITS)
        assert math.hypot(new.vx - now.vx, new.vy - now.vy) <= 2.0 * dt_s + 1e-9
        assert abs(new.wz - now.wz) <= 8.0 * dt_s + 1e-9
        if new == now:
            break
        now = new
    assert math.hypot(now.vx, now.vy) <= 1.0 + 1e-9
    assert math.hypot(now.vx, now.vy) == pytest.approx(min(1, math.hypot(vx, vy)), abs=1e-6)
    assert now.wz == pytest.approx(max(-2, min(2, wz)), abs=1e-6)


def test_without_commands_it_stops_as_gently_as_it_starts() -> None:
    controller = DriveController(DRIVE, LIMITS)
    controller.command(BodySpeed(vx=1), 0.0)
    now = 0.0
    fastest = 0.0
    while now < 1.5:
        now += 0.01
        controller.update(now, 0.01)
        fastest = max(fastest, controller.speed.vx)
    assert fastest == pytest.approx(1.0, abs=0.03)
    assert controller.speed == BodySpeed()
    assert not controller.command(BodySpeed(vx=math.nan), now)


@pytest.mark.parametrize("steps", [10, 1000])
def test_the_same_way_is_as_uncertain_however_often_it_is_looked_at(steps: int) -> None:
    odometer = Odometer(DRIVE, slip=0.03)
    for step in range(steps + 1):
        odometer.update((40 * step / steps,) * 4, WheelSpeeds())
    assert odometer.pose.x == pytest.approx(2.0)
    assert odometer.way_variance_m2 == pytest.approx(2 * 0.03**2)


def test_odometry_of_a_square() -> None:
    odometer = Odometer(DRIVE)
    angles = [0.0] * 4
    odometer.update(tuple(angles), WheelSpeeds())
    for _ in range(4):
        for body in (BodySpeed(vx=1), BodySpeed(wz=math.pi / 2)):
            wheels = DRIVE.wheels(body)
            for _ in range(50):
                angles = [at + speed * 0.02 for at, speed in zip(angles, wheels, strict=True)]
                odometer.update(tuple(angles), wheels)
    assert odometer.pose == pytest.approx((0, 0, 0), abs=1e-9)
    assert odometer.way_variance_m2 > 0
    assert odometer.pose_covariance()[0] > odometer.pose_covariance()[14]
    before = odometer.pose
    odometer.restart()
    odometer.update((9.0, 9.0, 9.0, 9.0), WheelSpeeds())
    assert odometer.pose == before
