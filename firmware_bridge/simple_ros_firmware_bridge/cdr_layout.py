"""Where the layout of a ROS 2 message is not what our protobuf definition says by itself.

By itself: fields in their order, int32 as 32 bits, bytes as a sequence of octets, repeated as a sequence,
an enum as one octet, Timestamp as seconds of 32 bits and nanoseconds. Checked against the definitions of
ROS 2 Humble and Jazzy by ``tests/unit/test_cdr_ros.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["CODES", "ENUM_VALUES", "FIXED", "LEFT_OUT", "ORDER", "SECONDS"]

LEFT_OUT = {("std_msgs.Header", "seq")}
"""Fields that ROS 2 does not have."""

CODES: Mapping[tuple[str, str], str] = {
    ("std_msgs.Byte", "data"): "B",
    ("std_msgs.Char", "data"): "B",
    ("std_msgs.Int8", "data"): "b",
    ("std_msgs.Int16", "data"): "h",
    ("std_msgs.UInt8", "data"): "B",
    ("std_msgs.UInt16", "data"): "H",
    ("std_msgs.Int16MultiArray", "data"): "h",
    ("std_msgs.UInt16MultiArray", "data"): "H",
    ("sensor_msgs.NavSatStatus", "status"): "b",
    ("sensor_msgs.NavSatStatus", "service"): "H",
    ("sensor_msgs.JoyFeedback", "id"): "B",
    ("visualization_msgs.Marker", "type"): "i",
    ("visualization_msgs.Marker", "action"): "i",
    ("action_msgs.GoalStatus", "status"): "b",
}
"""Numbers that are narrower or wider there, as codes of `struct`."""

FIXED: Mapping[tuple[str, str], int] = {
    ("geometry_msgs.PoseWithCovariance", "covariance"): 36,
    ("geometry_msgs.TwistWithCovariance", "covariance"): 36,
    ("geometry_msgs.AccelWithCovariance", "covariance"): 36,
    ("sensor_msgs.Imu", "orientation_covariance"): 9,
    ("sensor_msgs.Imu", "angular_velocity_covariance"): 9,
    ("sensor_msgs.Imu", "linear_acceleration_covariance"): 9,
    ("sensor_msgs.MagneticField", "magnetic_field_covariance"): 9,
    ("sensor_msgs.CameraInfo", "k"): 9,
    ("sensor_msgs.CameraInfo", "r"): 9,
    ("sensor_msgs.CameraInfo", "p"): 12,
    ("sensor_msgs.NavSatFix", "position_covariance"): 9,
    ("action_msgs.GoalInfo", "goal_id"): 16,
}
"""Arrays whose length is part of the type, so that it is not sent."""

ORDER: Mapping[str, tuple[str, ...]] = {
    "visualization_msgs.Marker": (
        "header",
        "ns",
        "id",
        "type",
        "action",
        "pose",
        "scale",
        "color",
        "lifetime",
        "frame_locked",
        "points",
        "colors",
        "texture_resource",
        "texture",
        "uv_coordinates",
        "text",
        "mesh_resource",
        "mesh_file",
        "mesh_use_embedded_materials",
    ),
}
"""Fields in the order of ROS 2, where it is another."""

SECONDS = {("visualization_msgs.Marker", "lifetime")}
"""Numbers of seconds that are a Duration there."""

ENUM_VALUES: Mapping[tuple[str, str], tuple[int, ...]] = {
    # ROS: ARROW, CUBE, SPHERE, CYLINDER, LINE_STRIP, LINE_LIST, CUBE_LIST, SPHERE_LIST, POINTS,
    # TEXT_VIEW_FACING, MESH_RESOURCE, TRIANGLE_LIST, ARROW_STRIP
    ("visualization_msgs.Marker", "type"): (3, 0, 1, 2, 4, 20, 21, 22, 5, 6, 7, 23, 24),
    # ROS: ADD (and MODIFY), a number without meaning, DELETE, DELETEALL
    ("visualization_msgs.Marker", "action"): (0, -1, 1, 2),
}
"""Constants that have other numbers there: by the number of ROS, ours."""
