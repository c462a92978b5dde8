"""Our messages in the types that Foxglove's panels show. Pure.

A panel shows a topic by the name of its type. For each of our types below the bridge offers further
topics, whose messages are made from ours when somebody wants them:

==========================================  ==============  =====================================
messages                                    topic +         shown as
==========================================  ==============  =====================================
visualization_msgs Marker, MarkerArray      /scene          foxglove.SceneUpdate
tf2_msgs.TFMessage                          /transforms     foxglove.FrameTransforms
geometry_msgs.TransformStamped              /transforms     foxglove.FrameTransforms
geometry_msgs PoseStamped, Odometry,        /pose           foxglove.PoseInFrame
PoseWithCovarianceStamped; ustc.Pose
geometry_msgs.PoseArray                     /poses          foxglove.PosesInFrame
geometry_msgs.PolygonStamped                /scene          foxglove.SceneUpdate
nav_msgs.Odometry                           /pose           foxglove.PoseInFrame
nav_msgs.Path                               /scene          foxglove.SceneUpdate, a line
nav_msgs.Path                               /poses          foxglove.PosesInFrame
nav_msgs.OccupancyGrid                      /grid           foxglove.Grid
sensor_msgs.LaserScan                       /scan           foxglove.LaserScan
sensor_msgs.PointCloud2                     /points         foxglove.PointCloud
sensor_msgs.Image                           /image          foxglove.RawImage
sensor_msgs.CompressedImage                 /image          foxglove.CompressedImage
sensor_msgs.CameraInfo                      /calibration    foxglove.CameraCalibration
sensor_msgs.Imu                             /scene          foxglove.SceneUpdate, two arrows
sensor_msgs.Imu                             /orientation    foxglove.PoseInFrame
sensor_msgs.NavSatFix                       /location       foxglove.LocationFix
sensor_msgs.JointState                      /joints         foxglove.JointStates
sensor_msgs.JointState                      /ros            ros.sensor_msgs.JointState
sensor_msgs.BatteryState                    /diagnostics    ros.diagnostic_msgs.DiagnosticArray
rosgraph_msgs.Log                           /log            foxglove.Log
==========================================  ==============  =====================================
"""

from simple_ros.foxglove.convert.base import (
    DEFAULT_FRAME,
    Context,
    ConversionFailed,
    Converter,
)
from simple_ros.foxglove.convert.catalog import converters_for, convertible_types

__all__ = [
    "DEFAULT_FRAME",
    "Context",
    "ConversionFailed",
    "Converter",
    "converters_for",
    "convertible_types",
]
