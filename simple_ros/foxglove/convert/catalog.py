"""Which converters there are for a type."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan as FoxgloveLaserScan
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log as FoxgloveLog
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message

from simple_ros.foxglove.convert import logs, poses, scans, sensors
from simple_ros.foxglove.convert.base import Context, Converter, MessageConverter
from simple_ros.foxglove.convert.grids import GridConverter
from simple_ros.foxglove.convert.images import (
    CompressedImageConverter,
    ImageConverter,
    calibration,
)
from simple_ros.foxglove.convert.ros_names import RosMessageConverter
from simple_ros.foxglove.convert.scans import PointCloudConverter
from simple_ros.foxglove.convert.scene import MarkerArrayConverter, MarkerConverter
from simple_ros.msg import (
    diagnostic_msgs,
    geometry_msgs,
    nav_msgs,
    rosgraph_msgs,
    sensor_msgs,
    tf2_msgs,
    ustc,
)

__all__ = ["converters_for", "convertible_types"]

M = TypeVar("M", bound=Message)
Maker = Callable[[], Converter]


def converters_for(type_name: str) -> tuple[Converter, ...]:
    """What makes messages of a type visible; empty if nothing does, or nothing needs to.

    Args:
        type_name: Full protobuf name, such as ``sensor_msgs.LaserScan``.

    Returns:
        New converters with each call, with different suffixes: one that remembers serves one topic.
    """
    return tuple(make() for make in _MAKERS.get(type_name, ()))


def convertible_types() -> tuple[str, ...]:
    """The types for which there are converters."""
    return tuple(sorted(_MAKERS))


def _by(
    source: type[M],
    target: type[Message],
    suffix: str,
    function: Callable[[M, Context], Message | None],
) -> Maker:
    return lambda: MessageConverter(source, target, suffix, function)


def _renamed(
    source: type[M],
    target: type[Message],
    suffix: str,
    function: Callable[[M, Context], Message | None],
) -> Maker:
    return lambda: RosMessageConverter(source, target, suffix, function)


_DIAGNOSTICS, _JOINTS = diagnostic_msgs.DiagnosticArray, sensor_msgs.JointState

_MAKERS: Mapping[str, tuple[Maker, ...]] = {
    "visualization_msgs.Marker": (MarkerConverter,),
    "visualization_msgs.MarkerArray": (MarkerArrayConverter,),
    "tf2_msgs.TFMessage": (
        _by(tf2_msgs.TFMessage, FrameTransforms, "/transforms", poses.transforms),
    ),
    "geometry_msgs.TransformStamped": (
        _by(geometry_msgs.TransformStamped, FrameTransforms, "/transforms", poses.transform),
    ),
    "geometry_msgs.PoseStamped": (
        _by(geometry_msgs.PoseStamped, PoseInFrame, "/pose", poses.stamped_pose),
    ),
    "geometry_msgs.PoseWithCovarianceStamped": (
        _by(geometry_msgs.PoseWithCovarianceStamped, PoseInFrame, "/pose", poses.covered_pose),
    ),
    "geometry_msgs.Odometry": (
        _by(geometry_msgs.Odometry, PoseInFrame, "/pose", poses.flat_odometry),
    ),
    "geometry_msgs.PoseArray": (
        _by(geometry_msgs.PoseArray, PosesInFrame, "/poses", poses.pose_array),
    ),
    "geometry_msgs.PolygonStamped": (
        _by(geometry_msgs.PolygonStamped, SceneUpdate, "/scene", poses.polygon),
    ),
    "ustc.Pose": (_by(ustc.Pose, PoseInFrame, "/pose", poses.bare_pose),),
    "nav_msgs.Odometry": (_by(nav_msgs.Odometry, PoseInFrame, "/pose", poses.odometry),),
    "nav_msgs.Path": (
        _by(nav_msgs.Path, SceneUpdate, "/scene", poses.path_line),
        _by(nav_msgs.Path, PosesInFrame, "/poses", poses.path_poses),
    ),
    "nav_msgs.OccupancyGrid": (GridConverter,),
    "sensor_msgs.LaserScan": (
        _by(sensor_msgs.LaserScan, FoxgloveLaserScan, "/scan", scans.laser_scan),
    ),
    "sensor_msgs.PointCloud2": (PointCloudConverter,),
    "sensor_msgs.Image": (ImageConverter,),
    "sensor_msgs.CompressedImage": (CompressedImageConverter,),
    "sensor_msgs.CameraInfo": (
        _by(sensor_msgs.CameraInfo, CameraCalibration, "/calibration", calibration),
    ),
    "sensor_msgs.Imu": (
        _by(sensor_msgs.Imu, SceneUpdate, "/scene", sensors.imu_motion),
        _by(sensor_msgs.Imu, PoseInFrame, "/orientation", sensors.imu_orientation),
    ),
    "sensor_msgs.NavSatFix": (
        _by(sensor_msgs.NavSatFix, LocationFix, "/location", sensors.location),
    ),
    "sensor_msgs.JointState": (
        _by(_JOINTS, JointStates, "/joints", sensors.joints),
        _renamed(_JOINTS, _JOINTS, "/ros", sensors.stamped),
    ),
    "sensor_msgs.BatteryState": (
        _renamed(sensor_msgs.BatteryState, _DIAGNOSTICS, "/diagnostics", sensors.battery),
    ),
    "rosgraph_msgs.Log": (_by(rosgraph_msgs.Log, FoxgloveLog, "/log", logs.log_line),),
}
