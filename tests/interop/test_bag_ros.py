"""Bags of ROS 1 and ROS 2, written by the package ``rosbags``, become ours."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from simple_ros.bag import Bag, NotABag
from simple_ros.bag.channel_qos import profile_in
from simple_ros.bag.examination import examine
from simple_ros.bag.ros_import import carry_over, import_ros_bag
from simple_ros.msg.sensor_msgs import CameraInfo
from simple_ros.msg.std_msgs import Duration, Int8MultiArray, Int16MultiArray
from simple_ros.msg.visualization_msgs import DELETE, SPHERE, Marker
from simple_ros.qos import Durability, Reliability

rosbag1 = pytest.importorskip("rosbags.rosbag1")
rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")
interfaces = pytest.importorskip("rosbags.interfaces")

START_NS = 1_700_000_000 * 10**9


def filled(store: Any, *, with_seq: bool) -> list[tuple[str, str, Any]]:
    """Messages of several types: topic, type, object."""
    import numpy as np

    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=17, nanosec=5)
    seq = {"seq": 3} if with_seq else {}
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="laser", **seq)
    vector = types["geometry_msgs/msg/Vector3"]
    scan = types["sensor_msgs/msg/LaserScan"](
        header=header,
        angle_min=-1.0,
        angle_max=1.0,
        angle_increment=1.0,
        time_increment=0.0,
        scan_time=0.5,
        range_min=0.25,
        range_max=8.0,
        ranges=np.array([1.0, 2.0, 4.0], dtype=np.float32),
        intensities=np.array([], dtype=np.float32),
    )
    grid = types["nav_msgs/msg/OccupancyGrid"](
        header=header,
        info=types["nav_msgs/msg/MapMetaData"](
            map_load_time=stamp,
            resolution=0.5,
            width=2,
            height=2,
            origin=types["geometry_msgs/msg/Pose"](
                position=types["geometry_msgs/msg/Point"](x=1.0, y=2.0, z=3.0),
                orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
            ),
        ),
        data=np.array([0, 100, -1, 50], dtype=np.int8),
    )
    twist = types["geometry_msgs/msg/Twist"](
        linear=vector(x=0.5, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=1.5)
    )
    return [
        ("/scan", "sensor_msgs/msg/LaserScan", scan),
        ("/map", "nav_msgs/msg/OccupancyGrid", grid),
        ("/cmd_vel", "geometry_msgs/msg/Twist", twist),
    ]


def write_ros1(path: Path) -> None:
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    with rosbag1.Writer(path) as writer:
        for index, (topic, kind, message) in enumerate(filled(store, with_seq=True)):
            latching = 1 if topic == "/map" else None
            connection = writer.add_connection(topic, kind, typestore=store, latching=latching)
            data = store.serialize_ros1(message, kind)
            for turn in range(3):
                writer.write(connection, START_NS + turn * 10 + index, data)
        stats = "rosgraph_msgs/msg/TopicStatistics"
        writer.add_connection("/stats", stats, typestore=store)


def write_ros2(path: Path) -> None:
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    never = interfaces.QosTime(2147483647, 4294967295)
    latched = interfaces.Qos(
        interfaces.QosHistory.KEEP_LAST,
        1,
        interfaces.QosReliability.RELIABLE,
        interfaces.QosDurability.TRANSIENT_LOCAL,
        never,
        never,
        interfaces.QosLiveliness.AUTOMATIC,
        never,
        False,
    )
    with rosbag2.Writer(path, version=9) as writer:
        for index, (topic, kind, message) in enumerate(filled(store, with_seq=False)):
            offered = [latched] if topic == "/map" else []
            connection = writer.add_connection(
                topic, kind, typestore=store, offered_qos_profiles=offered
            )
            data = store.serialize_cdr(message, kind)
            for turn in range(3):
                writer.write(connection, START_NS + turn * 10 + index, data)


@pytest.mark.parametrize("kind", ["ros1", "ros2"])
def test_a_bag(tmp_path: Path, kind: str) -> None:
    source = tmp_path / ("theirs.bag" if kind == "ros1" else "theirs")
    (write_ros1 if kind == "ros1" else write_ros2)(source)
    target = tmp_path / "ours.mcap"
    found = import_ros_bag(source, target)
    assert (found.messages, found.missing) == (9, {})
    assert found.skipped == (
        {"stats": "no type rosgraph_msgs.TopicStatistics in simple_ros"} if kind == "ros1" else {}
    )
    assert examine(target).errors == []
    with Bag(target) as bag:
        messages = list(bag.messages())
    topics = {message.topic.name: message for message in messages}
    assert [message.log_time for message in messages[:4]] == [
        START_NS,
        START_NS + 1,
        START_NS + 2,
        START_NS + 10,
    ]
    scan: Any = topics["scan"].decoded()
    assert list(scan.ranges) == [1.0, 2.0, 4.0]
    assert (scan.header.frame_id, scan.header.stamp.ToNanoseconds()) == ("laser", 17 * 10**9 + 5)
    assert scan.header.seq == (3 if kind == "ros1" else 0)
    grid: Any = topics["map"].decoded()
    assert grid.data == bytes([0, 100, 255, 50])
    assert (grid.info.width, grid.info.origin.position.y) == (2, 2.0)
    twist: Any = topics["cmd_vel"].decoded()
    assert (twist.linear.x, twist.angular.z) == (0.5, 1.5)
    offered = profile_in(topics["map"].topic.metadata)
    assert (offered.durability, offered.reliability) == (
        Durability.TRANSIENT_LOCAL,
        Reliability.RELIABLE,
    )
    assert not topics["scan"].topic.is_latched


def test_by_the_command(tmp_path: Path) -> None:
    write_ros1(tmp_path / "theirs.bag")
    command = [sys.executable, "-m", "simple_ros.cli.main", "bag", "convert"]

    def run(*paths: Path) -> tuple[int, str, str]:
        done = subprocess.run(
            [*command, *map(str, paths)], capture_output=True, text=True, timeout=30, check=False
        )
        return done.returncode, done.stdout, done.stderr

    target = tmp_path / "ours.mcap"
    code, stdout, stderr = run(tmp_path / "theirs.bag", target)
    assert (code, stdout) == (0, f"wrote {target}: 9 messages\n")
    assert stderr.startswith("warning: 'stats' is left out: no type")
    (tmp_path / "junk.bag").write_bytes(b"#ROSBAG V2.0\n and nothing more")
    code, _, stderr = run(tmp_path / "junk.bag", tmp_path / "none.mcap")
    assert code == 1
    assert "junk.bag is no bag: as a ROS bag it cannot be read" in stderr
    assert "Traceback" not in stderr
    assert not (tmp_path / "none.mcap").exists()


def test_what_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(NotABag):
        import_ros_bag(tmp_path / "none.bag", tmp_path / "out.mcap")
    assert list(tmp_path.iterdir()) == []


class TestFields:
    """Fields that are written otherwise in ROS."""

    def test_markers(self) -> None:
        theirs = SimpleNamespace(
            ns="a",
            type=2,
            action=2,
            lifetime=SimpleNamespace(sec=1, nanosec=500_000_000),
            texture_gamma=1.0,
        )
        marker, missing = Marker(), Missing()
        carry_over(theirs, marker, missing)
        assert (marker.ns, marker.type, marker.action, marker.lifetime) == (
            "a",
            SPHERE,
            DELETE,
            1.5,
        )
        assert missing == {"visualization_msgs.Marker": {"texture_gamma"}}

    def test_upper_case_of_ros1(self) -> None:
        info = CameraInfo()
        carry_over(SimpleNamespace(K=[1.0, 2.0], D=[]), info, Missing())
        assert list(info.k) == [1.0, 2.0]

    def test_octets_and_numbers(self) -> None:
        octets, numbers = Int8MultiArray(), Int16MultiArray()
        carry_over(SimpleNamespace(data=[-1, 2]), octets, Missing())
        carry_over(SimpleNamespace(data=[-1, 2]), numbers, Missing())
        assert (octets.data, list(numbers.data)) == (b"\xff\x02", [-1, 2])

    def test_negative_durations(self) -> None:
        message = Duration()
        theirs = SimpleNamespace(data=SimpleNamespace(sec=-2, nanosec=500_000_000))
        carry_over(theirs, message, Missing())
        assert message.data.ToNanoseconds() == -1_500_000_000


class Missing(dict[str, set[str]]):
    def __missing__(self, key: str) -> set[str]:
        return self.setdefault(key, set())
