"""Inertial units, satellite receivers, joints and batteries."""

from __future__ import annotations

import math

import numpy as np
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from simple_ros.foxglove.convert.arrows import add_arrows
from simple_ros.foxglove.convert.base import Context
from simple_ros.foxglove.convert.common import frame_of, oriented, stamp_of
from simple_ros.msg.diagnostic_msgs import DiagnosticArray, DiagnosticStatus, KeyValue
from simple_ros.msg.geometry_msgs import Vector3
from simple_ros.msg.sensor_msgs import BatteryState, Imu, JointState, NavSatFix, NavSatStatus

__all__ = ["battery", "imu_motion", "imu_orientation", "joints", "location", "stamped"]


ACCELERATION_SCALE = 0.1
"""Length of an arrow in m per m/s²: gravity is about a metre."""
TURN_RATE_SCALE = 0.5
"""Length of an arrow in m per rad/s."""
LOW_BATTERY, EMPTY_BATTERY = 0.2, 0.1
"""Share of charge below which a battery is a warning, and an error."""

_ARROW_SIZE_M = (0.02, 0.05, 0.0)
_ACCELERATION_COLOR = (0.95, 0.65, 0.1, 1.0)
_TURN_RATE_COLOR = (0.2, 0.6, 1.0, 1.0)
_NOT_MEASURED = -1.0
"""First element of a covariance whose quantity the sensor does not measure."""

_BAD_HEALTH = frozenset(
    {
        BatteryState.POWER_SUPPLY_HEALTH_OVERHEAT,
        BatteryState.POWER_SUPPLY_HEALTH_DEAD,
        BatteryState.POWER_SUPPLY_HEALTH_OVERVOLTAGE,
        BatteryState.POWER_SUPPLY_HEALTH_UNSPEC_FAILURE,
        BatteryState.POWER_SUPPLY_HEALTH_COLD,
        BatteryState.POWER_SUPPLY_HEALTH_WATCHDOG_TIMER_EXPIRE,
        BatteryState.POWER_SUPPLY_HEALTH_SAFETY_TIMER_EXPIRE,
    }
)
_QUANTITIES = {
    "voltage": "V",
    "current": "A",
    "temperature": "°C",
    "charge": "Ah",
    "capacity": "Ah",
    "design_capacity": "Ah",
}


# -- inertial units --------------------------------------------------------------------------------


def imu_motion(message: Imu, context: Context) -> SceneUpdate:
    """Acceleration and turn rate as arrows in the frame of the sensor."""
    update = SceneUpdate()
    for name, measured, covariance, scale, color in (
        (
            "acceleration",
            message.linear_acceleration,
            message.linear_acceleration_covariance,
            ACCELERATION_SCALE,
            _ACCELERATION_COLOR,
        ),
        (
            "turn rate",
            message.angular_velocity,
            message.angular_velocity_covariance,
            TURN_RATE_SCALE,
            _TURN_RATE_COLOR,
        ),
    ):
        entity = SceneEntity(
            timestamp=stamp_of(message.header, context),
            frame_id=frame_of(message.header, context),
            id=name,
            frame_locked=True,
        )
        entity.lifetime.SetInParent()
        if list(covariance[:1]) != [_NOT_MEASURED]:
            _add_arrow(entity, measured, scale, color)
        update.entities.append(entity)
    return update


def _add_arrow(
    entity: SceneEntity, value: Vector3, scale: float, color: tuple[float, float, float, float]
) -> None:
    end = scale * np.array([[value.x, value.y, value.z]])
    if np.isfinite(end).all():
        add_arrows(entity, np.zeros((1, 3)), end, _ARROW_SIZE_M, color)


def imu_orientation(message: Imu, context: Context) -> PoseInFrame | None:
    """The orientation, at the origin of the usual frame; None from a sensor that measures none."""
    if list(message.orientation_covariance[:1]) == [_NOT_MEASURED]:
        return None
    pose = PoseInFrame(timestamp=stamp_of(message.header, context), frame_id=context.frame_id)
    pose.pose.position.SetInParent()
    pose.pose.orientation.CopyFrom(oriented(message.orientation))
    return pose


# -- satellite receivers ---------------------------------------------------------------------------


def location(message: NavSatFix, context: Context) -> LocationFix | None:
    """A place on the map; None without a fix."""
    is_place = math.isfinite(message.latitude) and math.isfinite(message.longitude)
    if message.status.status == NavSatStatus.STATUS_NO_FIX or not is_place:
        return None
    return LocationFix(
        timestamp=stamp_of(message.header, context),
        frame_id=frame_of(message.header, context),
        latitude=message.latitude,
        longitude=message.longitude,
        altitude=message.altitude,
        position_covariance=message.position_covariance,
        position_covariance_type=_COVARIANCE_TYPES.get(
            message.position_covariance_type, LocationFix.UNKNOWN
        ),
    )


_COVARIANCE_TYPES = {
    NavSatFix.COVARIANCE_TYPE_APPROXIMATED: LocationFix.APPROXIMATED,
    NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN: LocationFix.DIAGONAL_KNOWN,
    NavSatFix.COVARIANCE_TYPE_KNOWN: LocationFix.KNOWN,
}


# -- under their own fields ------------------------------------------------------------------------


def stamped(message: JointState, context: Context) -> JointState:
    """The message itself, with a stamp: panels expect a header."""
    message.header.stamp.CopyFrom(stamp_of(message.header, context))
    return message


# -- joints ----------------------------------------------------------------------------------------


def joints(message: JointState, context: Context) -> JointStates:
    """Joints with what is known of each.

    Raises:
        ValueError: An array is neither empty nor as long as the names.
    """
    states = JointStates(timestamp=stamp_of(message.header, context))
    known = []
    for field in ("position", "velocity", "effort"):
        values = getattr(message, field)
        if len(values) not in (0, len(message.name)):
            raise ValueError(f"{len(message.name)} joints have {len(values)} values of {field}")
        if values:
            known.append((field, values))
    for index, name in enumerate(message.name):
        states.joints.add(name=name, **{field: values[index] for field, values in known})
    return states


# -- batteries -------------------------------------------------------------------------------------


def battery(message: BatteryState, context: Context) -> DiagnosticArray:
    """A battery as one line of the diagnostics; what is not measured (NaN) is left out."""
    name = f"battery {message.location or message.serial_number}".strip()
    level, text = _battery_health(message)
    measured = [
        KeyValue(key=field, value=f"{getattr(message, field):g} {unit}")
        for field, unit in _QUANTITIES.items()
        if math.isfinite(getattr(message, field))
    ]
    words = BatteryState.PowerSupplyStatus
    if message.power_supply_status in words.values():
        status = words.Name(message.power_supply_status)
        measured.append(KeyValue(key="status", value=_word(status, "POWER_SUPPLY_STATUS_")))
    result = DiagnosticArray()
    result.header.stamp.CopyFrom(stamp_of(message.header, context))
    result.header.frame_id = message.header.frame_id
    result.status.add(
        level=level,
        name=f"{context.topic}: {name}",
        message=text,
        hardware_id=message.serial_number,
        values=measured,
    )
    return result


def _battery_health(message: BatteryState) -> tuple[DiagnosticStatus.Level.ValueType, str]:
    if not message.present:
        return DiagnosticStatus.WARN, "no battery"
    charged = "charge unknown"
    if math.isfinite(message.percentage):
        charged = f"{message.percentage:.0%}"
    if message.power_supply_health in _BAD_HEALTH:
        health = BatteryState.PowerSupplyHealth.Name(message.power_supply_health)
        return DiagnosticStatus.ERROR, f"{_word(health, 'POWER_SUPPLY_HEALTH_')}, {charged}"
    if message.percentage < EMPTY_BATTERY:
        return DiagnosticStatus.ERROR, f"empty, {charged}"
    if message.percentage < LOW_BATTERY:
        return DiagnosticStatus.WARN, f"low, {charged}"
    return DiagnosticStatus.OK, charged


def _word(name: str, prefix: str) -> str:
    return name.removeprefix(prefix).lower().replace("_", " ")
