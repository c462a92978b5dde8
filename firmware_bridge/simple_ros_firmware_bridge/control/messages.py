"""Messages of the controller, from values."""

from __future__ import annotations

import math

from simple_ros.msg.geometry_msgs import TransformStamped, Twist
from simple_ros.msg.nav_msgs import Odometry
from simple_ros.msg.sensor_msgs import JointState
from simple_ros.time import Time
from simple_ros_firmware_bridge.control.drive import Odometer
from simple_ros_firmware_bridge.control.hardware import WHEEL_JOINTS, JointReading
from simple_ros_firmware_bridge.mecanum import BodySpeed

__all__ = ["body_speed", "joint_state", "odometry", "transform", "twist"]

ODOM_FRAME = "odom"
BASE_FRAME = "base_link"


def twist(body: BodySpeed) -> Twist:
    """Body speeds as a command."""
    message = Twist()
    message.linear.x, message.linear.y = body.vx, body.vy
    message.angular.z = body.wz
    return message


def body_speed(message: Twist) -> BodySpeed:
    """What of a command a robot on a floor can do."""
    return BodySpeed(message.linear.x, message.linear.y, message.angular.z)


def joint_state(reading: JointReading, stamp: Time) -> JointState:
    """What the wheels did."""
    message = JointState(name=WHEEL_JOINTS, position=reading.angles, velocity=reading.speeds)
    message.header.stamp.FromNanoseconds(stamp.nanoseconds)
    return message


def odometry(odometer: Odometer, stamp: Time) -> Odometry:
    """Where the robot is."""
    message = Odometry(child_frame_id=BASE_FRAME)
    message.header.frame_id = ODOM_FRAME
    message.header.stamp.FromNanoseconds(stamp.nanoseconds)
    pose = message.pose.pose
    pose.position.x, pose.position.y, yaw = odometer.pose
    pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    message.pose.covariance.extend(odometer.pose_covariance())
    message.twist.twist.CopyFrom(twist(odometer.speed))
    message.twist.covariance.extend(odometer.speed_covariance())
    return message


def transform(odometer: Odometer, stamp: Time) -> TransformStamped:
    """Where the robot is, for tf."""
    message = TransformStamped(child_frame_id=BASE_FRAME)
    message.header.frame_id = ODOM_FRAME
    message.header.stamp.FromNanoseconds(stamp.nanoseconds)
    where = message.transform
    where.translation.x, where.translation.y, yaw = odometer.pose
    where.rotation.z, where.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message
