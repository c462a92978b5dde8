"""Settings of the controller, as parameters of its node."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

from simple_ros.aio import NodeHandle
from simple_ros_firmware_bridge.control.drive import DriveLimits
from simple_ros_firmware_bridge.mecanum import Mecanum

__all__ = ["Settings", "declared_settings", "wants_mock"]

_PARAMETERS: Mapping[str, tuple[float, str]] = {
    "wheel_radius_m": (0.04, "Radius of a wheel."),
    "lever_m": (0.2, "Half the wheelbase plus half the track."),
    "max_speed_m_s": (1.0, "Along the floor."),
    "max_turn_rad_s": (3.0, "Rate of turn."),
    "max_acceleration_m_s2": (2.5, "Along the floor."),
    "max_turn_acceleration_rad_s2": (10.0, "Of the rate of turn."),
    "command_timeout_s": (0.5, "The robot stops when no command came for so long."),
    "joint_period_s": (0.01, "Between joint states of the board; dead after 5 of them."),
    "imu_period_s": (0.02, "Between IMU messages of the board; dead after 5 of them."),
}


@dataclass(frozen=True)
class Settings:
    """What the controller goes by.

    Attributes:
        drive: Measures.
        limits: What it may do.
        joint_period_s: Between joint states.
        imu_period_s: Between IMU messages.
    """

    drive: Mecanum
    limits: DriveLimits
    joint_period_s: float
    imu_period_s: float


async def declared_settings(node: NodeHandle) -> Settings:
    """Declare the parameters of the node, wait for a Master, and give their values.

    Raises:
        ConfigError: Values that make no sense.
    """
    value = {
        name: await node.declare_parameter(f"~{name}", default, minimum=1e-6, description=text)
        for name, (default, text) in _PARAMETERS.items()
    }
    return Settings(
        Mecanum(value["wheel_radius_m"], value["lever_m"]),
        DriveLimits(
            value["max_speed_m_s"],
            value["max_turn_rad_s"],
            value["max_acceleration_m_s2"],
            value["max_turn_acceleration_rad_s2"],
            value["command_timeout_s"],
        ),
        value["joint_period_s"],
        value["imu_period_s"],
    )


def wants_mock() -> bool:
    """Whether the environment says ``operation=dev``: then there may be no board."""
    return os.environ.get("operation", "") == "dev"  # noqa: SIM112  (the robot's own name for it)
