"""The square of the demo."""

from __future__ import annotations

import math
import random

import pytest

from simple_ros_firmware_bridge.mecanum import BodySpeed, Pose, integrated
from simple_ros_firmware_bridge.square import SquareDriver


@pytest.mark.parametrize("start", [Pose(), Pose(1.0, -2.0, 2.5)])
@pytest.mark.parametrize("slip", [0.0, 0.2])
def test_it_closes_from_anywhere_with_wheels_that_slip(start: Pose, slip: float) -> None:
    rng = random.Random(1)
    driver, pose, seen = SquareDriver(), start, []
    for _ in range(3000):
        wanted = driver.command(pose)
        really = BodySpeed(*(part * (1 + slip * rng.uniform(-1, 1)) for part in wanted))
        pose = integrated(pose, really, 0.05)
        seen.append(pose)
        if driver.squares == 2:
            break
    assert driver.squares == 2
    assert driver.miss_m < 0.03
    # The far corner is a diagonal away.
    assert max(math.hypot(at.x - start.x, at.y - start.y) for at in seen) == pytest.approx(
        math.sqrt(2), abs=0.03
    )


def test_it_is_never_faster_than_it_may() -> None:
    driver, pose = SquareDriver(speed_m_s=0.3, turn_rad_s=0.7), Pose()
    for _ in range(500):
        wanted = driver.command(pose)
        assert abs(wanted.vx) <= 0.3 + 1e-9
        assert abs(wanted.wz) <= 0.7 + 1e-9
        pose = integrated(pose, wanted, 0.05)
