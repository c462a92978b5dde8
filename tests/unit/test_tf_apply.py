from __future__ import annotations

import math

import numpy as np
import pytest

from simple_ros.msg.arrays import numpy_to_pointcloud2, pointcloud2_to_numpy, points_to_pointcloud2
from simple_ros.msg.geometry_msgs import (
    Point,
    PointStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    Transform,
    TransformStamped,
    Twist,
    Vector3,
    Vector3Stamped,
)
from simple_ros.msg.std_msgs import Header
from simple_ros.tf import do_transform, transform_points

HALF = math.sqrt(0.5)
LEFT = Quaternion(z=HALF, w=HALF)
HEADER = Header(frame_id="camera", seq=3)
# What is at x in the camera is at y in the map, shifted by (1, 2, 3).
MOVE = TransformStamped(
    header=Header(frame_id="map"),
    child_frame_id="camera",
    transform=Transform(translation=Vector3(x=1, y=2, z=3), rotation=LEFT),
)
MOVE.header.stamp.seconds = 77


def near(message: Point | Vector3) -> tuple[float, float, float]:
    return (round(message.x, 9), round(message.y, 9), round(message.z, 9))


def test_plain_values() -> None:
    point = Point(x=1)
    assert near(do_transform(point, MOVE)) == (1, 3, 3)
    assert point == Point(x=1), "not changed"
    assert near(do_transform(Vector3(x=1), MOVE)) == (0, 1, 0), "turned, not shifted"
    assert do_transform(Quaternion(w=2), MOVE).z == pytest.approx(HALF)
    pose = do_transform(Pose(position=Point(y=1), orientation=LEFT), MOVE)
    assert near(pose.position) == (0, 2, 3)
    assert pose.orientation.z == pytest.approx(1)


def test_stamped_messages_get_frame_and_stamp() -> None:
    pose = Pose(position=Point(x=1), orientation=Quaternion(w=1))
    for moved in (
        do_transform(PointStamped(header=HEADER, point=Point(x=1)), MOVE),
        do_transform(Vector3Stamped(header=HEADER, vector=Vector3(x=1)), MOVE),
        do_transform(QuaternionStamped(header=HEADER, quaternion=LEFT), MOVE),
        do_transform(PoseStamped(header=HEADER, pose=pose), MOVE),
        do_transform(PoseArray(header=HEADER, poses=[pose, pose]), MOVE),
    ):
        assert (moved.header.frame_id, moved.header.seq) == ("map", 3)
        assert moved.header.stamp.seconds == 77
    assert near(moved.poses[1].position) == (1, 3, 3)


def test_covariance_turns_with_the_axes() -> None:
    message = PoseWithCovarianceStamped(header=HEADER)
    message.pose.pose.orientation.w = 1
    message.pose.covariance.extend(np.diag([4.0, 1, 0, 9, 0, 0]).ravel())
    moved = do_transform(message, MOVE)
    found = np.array(moved.pose.covariance).reshape(6, 6)
    assert np.allclose(found, np.diag([1, 4, 0, 0, 9, 0]))
    bare = PoseWithCovarianceStamped()
    bare.pose.pose.orientation.w = 1
    assert len(do_transform(bare, MOVE).pose.covariance) == 0


def test_cloud() -> None:
    record = np.dtype(
        [(name, "f4") for name in ("x", "y", "z", "intensity", "normal_x", "normal_y", "normal_z")]
    )
    points = np.zeros((2, 3), record)
    points["x"], points["intensity"], points["normal_x"] = 1, 5, 1
    points["x"][1, 2] = np.nan
    cloud = numpy_to_pointcloud2(points, header=HEADER)
    moved = do_transform(cloud, MOVE)
    assert moved.header.frame_id == "map"
    assert not moved.is_dense
    found = pointcloud2_to_numpy(moved)
    assert found.dtype == record
    assert np.allclose(found["y"][0], 3)
    assert np.isnan(found["x"][1, 2])
    assert np.allclose(found["intensity"], 5)
    assert np.allclose(found["normal_y"], 1)
    empty = points_to_pointcloud2(np.zeros((0, 3), np.float32))
    assert do_transform(empty, MOVE).width == 0


def test_points() -> None:
    points = np.array([[[1.0, 0, 0], [0, 1, 0]]])
    assert np.allclose(transform_points(points, MOVE), [[[1, 3, 3], [0, 2, 3]]])


def test_what_cannot_be_moved() -> None:
    with pytest.raises(TypeError, match=r"geometry_msgs\.Twist"):
        do_transform(Twist(), MOVE)
    with pytest.raises(TypeError, match="int"):
        do_transform(1, MOVE)
    flat = points_to_pointcloud2(np.zeros((2, 2), np.float32), ("x", "y"))
    with pytest.raises(ValueError, match="no field z"):
        do_transform(flat, MOVE)
    with pytest.raises(ValueError, match="no rotation"):
        do_transform(Pose(), MOVE)
