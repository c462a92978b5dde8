"""Kinematics of the drive."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros_firmware_bridge.mecanum import BodySpeed, Mecanum, Pose, WheelSpeeds, integrated

DRIVE = Mecanum(0.04, 0.2)
speeds = st.floats(-10, 10)


@given(speeds, speeds, speeds)
def test_wheels_and_body_are_inverse(vx: float, vy: float, wz: float) -> None:
    body = DRIVE.body(DRIVE.wheels(BodySpeed(vx, vy, wz)))
    assert body == pytest.approx((vx, vy, wz), abs=1e-9)


@pytest.mark.parametrize(
    ("body", "signs"),
    [
        (BodySpeed(vx=1), (1, 1, 1, 1)),
        (BodySpeed(vy=1), (-1, 1, 1, -1)),
        (BodySpeed(wz=1), (-1, 1, -1, 1)),
    ],
)
def test_which_way_wheels_turn(body: BodySpeed, signs: tuple[int, ...]) -> None:
    assert tuple(math.copysign(1, wheel) for wheel in DRIVE.wheels(body)) == signs


def test_straight_ahead_is_speed_over_radius() -> None:
    assert DRIVE.wheels(BodySpeed(vx=0.4)) == pytest.approx(WheelSpeeds(10, 10, 10, 10))


@given(speeds, speeds, st.floats(-6, 6), st.floats(0, 2))
def test_one_long_step_is_many_short_ones(vx: float, vy: float, wz: float, time_s: float) -> None:
    body, start = BodySpeed(vx, vy, wz), Pose(1, 2, 0.5)
    once = integrated(start, body, time_s)
    pose = start
    for _ in range(64):
        pose = integrated(pose, body, time_s / 64)
    assert pose[:2] == pytest.approx(once[:2], abs=1e-6)
    assert math.remainder(pose.yaw - once.yaw, 2 * math.pi) == pytest.approx(0, abs=1e-6)


def test_a_circle_ends_where_it_began() -> None:
    pose = integrated(Pose(), BodySpeed(vx=1, wz=math.pi / 2), 4)
    assert pose == pytest.approx((0, 0, 0), abs=1e-9)


@pytest.mark.parametrize("measures", [(0, 1), (1, -1), (math.nan, 1), (1, math.inf)])
def test_measures_that_make_no_sense(measures: tuple[float, float]) -> None:
    with pytest.raises(ConfigError, match="_m must be a positive number"):
        Mecanum(*measures)
