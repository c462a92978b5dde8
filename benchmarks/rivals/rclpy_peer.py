"""rclpy: its own messages and codec, reliable, keep all, one executor thread. Flat out and for pixels, Fast DDS takes its LARGE_DATA transports.

Its publish drops what its history has no room for, so with large messages, flat out, the sender waits now and then
until all are acknowledged.
"""

import array
import os
import time

import lean  # noqa: F401
import rclpy
from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image

from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive

DEPTH = 1000
UNACKNOWLEDGED = 8
LIMIT = Duration(seconds=30)


def _qos():
    return QoSProfile(
        depth=DEPTH, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE
    )


def _node(job, name):
    if job.workload.size_bytes or not (job.workload.rate_hz or job.workload.receivers > 1):
        os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "LARGE_DATA")
    rclpy.init(domain_id=int(job.services["dds"]))
    return rclpy.create_node(name, enable_rosout=False, start_parameter_services=False)


def _message_class(job):
    return Image if job.workload.size_bytes else Twist


def receive(job, sink):
    node = _node(job, f"sink{job.index}")

    def take_image(image):
        stamp = image.header.stamp
        sink.pixels(image.height, stamp.sec + stamp.nanosec / 1e9, image.data)

    take = take_image if job.workload.size_bytes else sink.message
    node.create_subscription(_message_class(job), "bench", take, _qos())
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    ready()
    executor.spin()


def send(job):
    node = _node(job, "source")
    publisher = node.create_publisher(_message_class(job), "bench", _qos())
    while publisher.get_subscription_count() < job.workload.receivers:
        time.sleep(0.001)
    sent = 0
    is_large = job.workload.size_bytes and not job.workload.rate_hz

    def put(message):
        nonlocal sent
        publisher.publish(message)
        sent += 1
        if is_large and sent % UNACKNOWLEDGED == 0:
            publisher.wait_for_all_acked(LIMIT)

    drive(job.workload, _images(job) if job.workload.size_bytes else _twists(job), put)


def _twists(job):
    is_timed = bool(job.workload.rate_hz)

    def make(number):
        twist = Twist()
        linear, angular = twist.linear, twist.angular
        linear.x, linear.y, linear.z = float(number), 2.2, 3.3
        angular.x, angular.y = 4.4, 5.5
        angular.z = time.monotonic() if is_timed else 6.6
        return twist

    return make


def _images(job):
    pixels = array.array("B", bytes(job.workload.size_bytes))

    def make(number):
        image = Image(height=number, width=1920, encoding="rgb8", step=5760, data=pixels)
        stamp_ns = time.monotonic_ns()
        image.header.stamp.sec = stamp_ns // 10**9
        image.header.stamp.nanosec = stamp_ns % 10**9
        return image

    return make


run_program(receive, send)
