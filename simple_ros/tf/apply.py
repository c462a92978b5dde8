"""Moving messages from one frame to another.

`do_transform` takes a message and a `TransformStamped` as `Buffer.lookup_transform` gives it: ``header``
names the frame to transform to. What is stamped comes back with that frame and the transform's stamp.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from simple_ros.msg.arrays import (
    covariance_6x6,
    numpy_to_covariance,
    numpy_to_pointcloud2,
    pointcloud2_to_numpy,
)
from simple_ros.msg.geometry_msgs import (
    Point,
    PointStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)
from simple_ros.msg.sensor_msgs import PointCloud2
from simple_ros.msg.std_msgs import Header
from simple_ros.tf.rigid import Rigid, from_message, multiply, normalised, rotate

__all__ = ["do_transform", "transform_points"]

MessageT = TypeVar("MessageT")


def do_transform(message: MessageT, transform: TransformStamped) -> MessageT:
    """The message in the frame that the transform leads to; the message itself is not changed.

    Known are Point, Vector3 (turned, not shifted), Quaternion, Pose, each also stamped, PoseArray,
    PoseWithCovarianceStamped and PointCloud2 (fields x, y, z and normal_x, normal_y, normal_z).

    Raises:
        TypeError: There is no way to transform a message of that type.
        ValueError: A rotation has no length, or a cloud has no x, y and z.
    """
    moved: MessageT = _moved(message, from_message(transform.transform))
    header = getattr(moved, "header", None)
    if isinstance(header, Header):
        header.stamp.CopyFrom(transform.header.stamp)
        header.frame_id = transform.header.frame_id
    return moved


def transform_points(points: NDArray[Any], transform: TransformStamped) -> NDArray[np.float64]:
    """Points of shape (..., 3) in the frame that the transform leads to, as a new array."""
    return _move_points(points, from_message(transform.transform))


def _move_points(points: NDArray[Any], rigid: Rigid) -> NDArray[np.float64]:
    moved: NDArray[np.float64] = points @ rigid.rotation_matrix().T + np.array(rigid.translation)
    return moved


@singledispatch
def _moved(message: Any, rigid: Rigid) -> Any:  # noqa: ARG001
    name = getattr(getattr(message, "DESCRIPTOR", None), "full_name", type(message).__name__)
    raise TypeError(f"do_transform knows no way to transform {name}")


@_moved.register
def _(message: Point, rigid: Rigid) -> Point:
    x, y, z = rigid.apply((message.x, message.y, message.z))
    return Point(x=x, y=y, z=z)


@_moved.register
def _(message: Vector3, rigid: Rigid) -> Vector3:
    x, y, z = rotate(rigid.rotation, (message.x, message.y, message.z))
    return Vector3(x=x, y=y, z=z)


@_moved.register
def _(message: Quaternion, rigid: Rigid) -> Quaternion:
    own = normalised((message.x, message.y, message.z, message.w))
    x, y, z, w = normalised(multiply(rigid.rotation, own))
    return Quaternion(x=x, y=y, z=z, w=w)


@_moved.register
def _(message: Pose, rigid: Rigid) -> Pose:
    return Pose(
        position=_moved(message.position, rigid), orientation=_moved(message.orientation, rigid)
    )


@_moved.register
def _(message: PointStamped, rigid: Rigid) -> PointStamped:
    return PointStamped(header=message.header, point=_moved(message.point, rigid))


@_moved.register
def _(message: Vector3Stamped, rigid: Rigid) -> Vector3Stamped:
    return Vector3Stamped(header=message.header, vector=_moved(message.vector, rigid))


@_moved.register
def _(message: QuaternionStamped, rigid: Rigid) -> QuaternionStamped:
    return QuaternionStamped(header=message.header, quaternion=_moved(message.quaternion, rigid))


@_moved.register
def _(message: PoseStamped, rigid: Rigid) -> PoseStamped:
    return PoseStamped(header=message.header, pose=_moved(message.pose, rigid))


@_moved.register
def _(message: PoseArray, rigid: Rigid) -> PoseArray:
    return PoseArray(header=message.header, poses=[_moved(pose, rigid) for pose in message.poses])


@_moved.register
def _(message: PoseWithCovarianceStamped, rigid: Rigid) -> PoseWithCovarianceStamped:
    """Both blocks of the covariance, and what connects them, turn with the axes."""
    moved = PoseWithCovarianceStamped(header=message.header)
    moved.pose.pose.CopyFrom(_moved(message.pose.pose, rigid))
    if message.pose.covariance:
        turn = np.kron(np.eye(2), rigid.rotation_matrix())
        covariance = turn @ covariance_6x6(message.pose.covariance) @ turn.T
        moved.pose.covariance.extend(numpy_to_covariance(covariance))
    return moved


@_moved.register
def _(message: PointCloud2, rigid: Rigid) -> PointCloud2:
    cloud = pointcloud2_to_numpy(message).copy()
    _check_fields(cloud, ("x", "y", "z"))
    points = np.stack([cloud[name] for name in ("x", "y", "z")], axis=-1).astype(np.float64)
    _put(cloud, ("x", "y", "z"), _move_points(points, rigid))
    normals = ("normal_x", "normal_y", "normal_z")
    if set(normals) <= set(cloud.dtype.names or ()):
        directions = np.stack([cloud[name] for name in normals], axis=-1).astype(np.float64)
        _put(cloud, normals, directions @ rigid.rotation_matrix().T)
    return numpy_to_pointcloud2(cloud, header=message.header, is_dense=message.is_dense)


def _check_fields(cloud: NDArray[Any], names: tuple[str, ...]) -> None:
    there = cloud.dtype.names or ()
    missing = [name for name in names if name not in there]
    if missing:
        raise ValueError(f"the cloud has no field {' and '.join(missing)}; it has {list(there)}")


def _put(cloud: NDArray[Any], names: tuple[str, ...], values: NDArray[np.float64]) -> None:
    for column, name in enumerate(names):
        cloud[name] = values[..., column]
