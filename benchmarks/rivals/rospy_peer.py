"""rospy: its own messages and codec, sent by the thread that publishes, Nagle off."""

import time

import lean  # noqa: F401
import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import Image

from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive

BUFFER_BYTES = 1 << 24


def _message_class(job):
    return Image if job.workload.size_bytes else Twist


def receive(job, sink):
    rospy.init_node(f"sink{job.index}", disable_signals=True, disable_rosout=True)

    def take_image(image):
        # rospy counts header.seq itself.
        sink.pixels(image.height, image.header.stamp.to_sec(), image.data)

    rospy.Subscriber(
        "bench",
        _message_class(job),
        take_image if job.workload.size_bytes else sink.message,
        buff_size=BUFFER_BYTES,
        tcp_nodelay=True,
    )
    ready()
    rospy.spin()


def send(job):
    rospy.init_node("source", disable_signals=True, disable_rosout=True)
    # No queue: what is published is written by this thread, and waits while there is no room.
    publisher = rospy.Publisher("bench", _message_class(job), queue_size=None, tcp_nodelay=True)
    while publisher.get_num_connections() < job.workload.receivers:
        time.sleep(0.001)
    drive(
        job.workload, _images(job) if job.workload.size_bytes else _twists(job), publisher.publish
    )


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
    pixels = bytes(job.workload.size_bytes)

    def make(number):
        image = Image(height=number, width=1920, encoding="rgb8", step=5760, data=pixels)
        image.header.stamp = rospy.Time.from_sec(time.monotonic())
        return image

    return make


run_program(receive, send)
