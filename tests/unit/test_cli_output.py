"""What the commands print and what they make of a text, without a process or a Master."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
import yaml
from google.protobuf import text_format
from google.protobuf.struct_pb2 import Struct
from google.protobuf.timestamp_pb2 import Timestamp

from simple_ros.cli import node, output, topic
from simple_ros.cli.output import BadMessageText, Style, UnknownField, UnknownName
from simple_ros.errors import SimpleRosError, UnknownMessageType
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.geometry_msgs import Odometry, Point, Point32, PoseStamped, Twist, Vector3
from simple_ros.msg.nav_msgs import Path
from simple_ros.msg.sensor_msgs import Image, LaserScan
from simple_ros.msg.std_msgs import Header, Int64, String
from simple_ros.msg.visualization_msgs import Marker
from simple_ros.rpc import ros_rpc_pb2 as ros

PATH = Path(
    header=Header(stamp=Timestamp(seconds=1, nanos=500_000_000), frame_id="map"),
    poses=[PoseStamped(header=Header(seq=i)) for i in range(2)],
)
PATH.poses[1].pose.position.x = 2.5


class TestYamlText:
    def test_all_fields_also_zeros(self) -> None:
        assert output.yaml_text(Twist(linear=Vector3(x=1.0))) == (
            "linear:\n  x: 1.0\n  y: 0.0\n  z: 0.0\nangular: {}"
        )

    def test_it_is_yaml(self) -> None:
        text = output.yaml_text(PATH)
        loaded = yaml.safe_load(text)
        assert loaded["header"]["frame_id"] == "map"
        assert loaded["header"]["stamp"].isoformat() == "1970-01-01T00:00:01.500000+00:00"
        assert [pose["header"]["seq"] for pose in loaded["poses"]] == [0, 1]
        assert loaded["poses"][1]["pose"]["position"] == {"x": 2.5, "y": 0.0, "z": 0.0}

    def test_it_reads_back_as_the_same_message(self) -> None:
        twist = Twist(linear=Vector3(x=0.1), angular=Vector3(z=-1e-9))
        assert output.message_of(Twist, output.yaml_text(twist)) == twist

    @pytest.mark.parametrize("text", ["", "two\nlines", 'a "quote": {', "\x1b[31m", "ünï"])
    def test_strings_are_quoted(self, text: str) -> None:
        written = output.yaml_text(String(data=text))
        assert "\n" not in written
        assert "\x1b" not in written
        assert yaml.safe_load(written) == {"data": text}

    def test_long_lists_are_cut_unless_full(self) -> None:
        scan = LaserScan(ranges=[1.5] * 70)
        assert ", 1.5, ... 6 more]" in output.yaml_text(scan)
        assert yaml.safe_load(output.yaml_text(scan, full=True))["ranges"] == [1.5] * 70
        path = Path(poses=[PoseStamped()] * 70)
        assert output.yaml_text(path).splitlines()[-1] == "# ... 6 more"
        assert len(yaml.safe_load(output.yaml_text(path, full=True))["poses"]) == 70

    def test_bytes_are_counted(self) -> None:
        lines = output.yaml_text(Image(data=bytes(range(20)))).splitlines()
        assert lines[-1] == "data: <20 bytes 00 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d 0e 0f ...>"
        full = output.yaml_text(Image(data=bytes(range(20))), full=True)
        assert full.endswith("0f 10 11 12 13>")
        assert output.yaml_text(Image()).endswith("data: <0 bytes>")

    @pytest.mark.parametrize(
        ("value", "text"),
        [(0.1, "0.1"), (1 / 3, "0.33333334"), (3e38, "3e+38"), (math.nan, ".nan")],
    )
    def test_single_precision_is_written_short(self, value: float, text: str) -> None:
        assert output.yaml_text(Point32(x=value)).splitlines()[0] == f"x: {text}"

    def test_an_empty_message(self) -> None:
        assert output.yaml_text(Struct()) == "fields: {}"

    def test_a_map(self) -> None:
        struct = Struct()
        struct.update({"b": 1.0, "a": "x"})
        assert output.yaml_text(struct) == (
            'fields:\n  "a":\n    string_value: "x"\n  "b":\n    number_value: 1.0'
        )

    def test_a_time_out_of_range_shows_its_numbers(self) -> None:
        header = Header(stamp=Timestamp(seconds=2**60))
        assert yaml.safe_load(output.yaml_text(header))["stamp"] == {"seconds": 2**60, "nanos": 0}
        with pytest.raises(ValueError):
            output.message_json(header)


class TestCppText:
    def test_as_text_format_but_for_numbers(self) -> None:
        marker = Marker(ns='a "b"\n', id=3, points=[Point(x=1), Point()])
        text = output.cpp_text(marker)
        assert text.startswith("[visualization_msgs.Marker]\n")
        assert text.endswith("}\n\n")
        assert text_format.Parse(text.split("\n", 1)[1], Marker()) == marker

    @pytest.mark.parametrize(
        ("value", "text"),
        [
            (1.0, "1"),
            (0.1, "0.1"),
            (-0.45440418938617422, "-0.45440418938617422"),  # printed so by the C++ tool
            (1e22, "1e+22"),
            (math.inf, "inf"),
        ],
    )
    def test_doubles(self, value: float, text: str) -> None:
        odometry = Odometry(linear_velocity=Vector3(x=value))
        expected = f"[geometry_msgs.Odometry]\nlinear_velocity {{\n  x: {text}\n}}\n\n"
        assert output.cpp_text(odometry) == expected

    def test_floats(self) -> None:
        assert output.cpp_text(Point32(x=0.1, y=1 / 3)).splitlines()[1:3] == [
            "x: 0.1",
            "y: 0.333333343",
        ]

    def test_a_map(self) -> None:
        struct = Struct()
        struct.update({"a": True})
        assert text_format.Parse(output.cpp_text(struct).split("\n", 1)[1], Struct()) == struct


class TestFields:
    @pytest.mark.parametrize(
        ("path", "text", "value"),
        [
            ("header.frame_id", '"map"', "map"),
            ("header.stamp.nanos", "500000000", 500_000_000),
            ("header.stamp", "1970-01-01T00:00:01.500Z", "1970-01-01T00:00:01.500Z"),
            ("poses[1].pose.position.x", "2.5", 2.5),
            ("poses.1.header.seq", "1", 1),
            ("poses[1].pose.position", "x: 2.5\ny: 0.0\nz: 0.0", {"x": 2.5, "y": 0.0, "z": 0.0}),
        ],
    )
    def test_a_path_leads_to_a_part(self, path: str, text: str, value: Any) -> None:
        parts = output.split_path(path)
        output.check_path(Path.DESCRIPTOR, parts)
        assert output.field_text(PATH, parts) == text
        assert output.field_json(PATH, parts) == value

    def test_lists(self) -> None:
        scan = LaserScan(ranges=[1.0, 2.0])
        assert output.field_text(scan, ("ranges",)) == "[1.0, 2.0]"
        assert output.field_text(scan, ("ranges", "1")) == "2.0"
        assert output.field_json(scan, ("ranges",)) == [1.0, 2.0]
        assert output.field_text(PATH, ("poses",)).startswith("- header:\n    seq: 0\n")
        with pytest.raises(IndexError):
            output.field_text(scan, ("ranges", "2"))
        with pytest.raises(IndexError):
            output.field_json(scan, ("ranges", "2"))

    def test_a_wrong_path_is_told_with_the_fields_there_are(self) -> None:
        with pytest.raises(UnknownField) as caught:
            output.check_path(Odometry.DESCRIPTOR, ("pose", "pos"))
        assert caught.value.known == ("position", "orientation")
        assert str(caught.value) == (
            "geometry_msgs.Pose (at 'pose') has no field 'pos'; "
            "its fields are position, orientation"
        )

    @pytest.mark.parametrize("path", ["poses.pose", "header.seq.x", "header.seq[0]", "", "poses[]"])
    def test_other_wrong_paths(self, path: str) -> None:
        with pytest.raises(SimpleRosError):
            output.check_path(Path.DESCRIPTOR, output.split_path(path))

    def test_json_keeps_names_and_zeros(self) -> None:
        assert output.message_json(Header(frame_id="a")) == {"seq": 0, "frame_id": "a"}

    def test_where_the_stamp_is(self) -> None:
        assert output.stamp_path(Path.DESCRIPTOR) == ("header", "stamp")
        assert output.stamp_path(Header.DESCRIPTOR) == ("stamp",)
        with pytest.raises(SimpleRosError, match=r"geometry_msgs\.Twist has neither header\.stamp"):
            output.stamp_path(Twist.DESCRIPTOR)


class TestMessageOf:
    def test_yaml_and_json(self) -> None:
        wanted = Twist(linear=Vector3(x=0.5), angular=Vector3(z=-1))
        assert output.message_of(Twist, "{linear: {x: 0.5}, angular: {z: -1}}") == wanted
        assert output.message_of(Twist, "linear:\n  x: 0.5\nangular:\n  z: -1\n") == wanted
        text = json.dumps({"linear": {"x": 0.5}, "angular": {"z": -1}})
        assert output.message_of(Twist, text) == wanted
        assert output.message_of(Twist, "") == output.message_of(Twist, "{}") == Twist()
        assert output.message_of(Twist, "linear: null") == Twist()

    @pytest.mark.parametrize(
        "stamp",
        [
            "1970-01-01T00:00:01.5Z",
            '"1970-01-01T00:00:01.5Z"',
            "1970-01-01 00:00:01.5",
            "{seconds: 1, nanos: 500000000}",
        ],
    )
    def test_times(self, stamp: str) -> None:
        message = output.message_of(Header, f"{{stamp: {stamp}}}")
        assert message == Header(stamp=Timestamp(seconds=1, nanos=500_000_000))

    def test_bytes_and_numbers_that_are_none(self) -> None:
        assert output.message_of(Image, "{data: !!binary AAEC}") == Image(data=b"\0\1\2")
        scan = output.message_of(LaserScan, "{ranges: [.inf, -.inf, 1e-3]}")
        assert isinstance(scan, LaserScan)
        assert list(scan.ranges) == pytest.approx([math.inf, -math.inf, 1e-3])

    def test_an_unknown_field_is_told_with_its_place_and_the_known_ones(self) -> None:
        with pytest.raises(UnknownField) as caught:
            output.message_of(Path, "{poses: [{pose: {position: {x: 1, w: 2}}}]}")
        assert str(caught.value) == (
            "geometry_msgs.Point (at 'poses.0.pose.position') has no field 'w'; "
            "its fields are x, y, z"
        )

    @pytest.mark.parametrize(
        ("text", "reason"),
        [
            ("{linear: {x: 1}", "the message is not YAML: expected ',' or '}'"),
            ("forward", "is written as {linear: ..., angular: ...}, not as 'forward'"),
            ("{linear: [1]}", "'linear' is a geometry_msgs.Vector3, not [1]"),
            ("{linear: {x: fast}}", "not a geometry_msgs.Twist: "),
        ],
    )
    def test_what_does_not_fit_is_one_line(self, text: str, reason: str) -> None:
        with pytest.raises(BadMessageText) as caught:
            output.message_of(Twist, text)
        assert reason in str(caught.value)
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize("stamp", ["{seconds: x}", "{seconds: 99999999999999}", "5", "[1]"])
    def test_bad_times(self, stamp: str) -> None:
        with pytest.raises(BadMessageText):
            output.message_of(Header, f"{{stamp: {stamp}}}")

    def test_a_list_is_wanted(self) -> None:
        with pytest.raises(SimpleRosError):
            output.message_of(DiagnosticArray, "{status: {name: a}}")

    def test_int64(self) -> None:
        assert output.message_of(Int64, f"{{data: {2**62}}}") == Int64(data=2**62)


class TestUnknownName:
    def test_near_matches(self) -> None:
        error = UnknownName("topic", "odm", ["odom", "scan", "tf"])
        assert (error.near, str(error)) == (("odom",), "no topic 'odm'; did you mean 'odom'?")
        assert UnknownName("node", "quad", ["quad_simulator"]).near == ("quad_simulator",)

    def test_none(self) -> None:
        assert str(UnknownName("node", "x")) == "no node 'x'; see 'simple-ros node list'"


class TestMeasurements:
    def test_spread(self) -> None:
        assert output.spread([1.0, 3.0]) == output.Spread(2.0, 1.0, 3.0, 1.0)

    @pytest.mark.parametrize("times", [[], [1.0], [1.0, 1.0]])
    def test_too_few(self, times: list[float]) -> None:
        assert output.rate_facts(times) is None
        assert output.bandwidth_facts(times, [1] * len(times)) is None

    def test_rate(self) -> None:
        facts = output.rate_facts([1.0, 1.1, 1.3, 1.4])
        assert facts is not None
        assert facts == pytest.approx(
            {"rate_hz": 7.5, "min_s": 0.1, "max_s": 0.2, "stddev_s": 0.0471404521, "window": 4}
        )
        assert output.rate_line(facts) == (
            "rate 7.50 Hz, period min 100.000 ms max 200.000 ms stddev 47.140 ms, window 4"
        )

    def test_bandwidth(self) -> None:
        facts = output.bandwidth_facts([0.0, 0.5, 1.0], [100, 1500, 2000])
        assert facts is not None
        assert output.bandwidth_line(facts) == (
            "3.50 kB/s, size mean 1.20 kB min 100 B max 2.00 kB, window 3"
        )

    def test_delay(self) -> None:
        assert output.delay_facts([]) is None
        facts = output.delay_facts([0.001, 0.003])
        assert facts is not None
        line = "delay mean 2.000 ms min 1.000 ms max 3.000 ms, window 2"
        assert output.delay_line(facts) == line

    def test_a_negative_delay_is_not_believed(self) -> None:
        facts = output.delay_facts([-0.001, 0.003])
        assert facts is not None
        assert "clocks of the two hosts differ" in output.delay_line(facts)

    @pytest.mark.parametrize(
        ("count", "text"), [(0, "0 B"), (999, "999 B"), (1e6, "1.00 MB"), (5e9, "5.00 GB")]
    )
    def test_sizes(self, count: float, text: str) -> None:
        assert output.size_text(count) == text

    def test_durations(self) -> None:
        assert output.duration_text(0.0005) == "0.500 ms"
        assert output.duration_text(2.0) == "2.000 s"

    def test_ping(self) -> None:
        assert node.ping_summary([None]) == "0 of 1 answered"
        assert node.ping_summary([1.0, None, 2.0]) == (
            "2 of 3 answered: mean 1.500 ms min 1.000 ms max 2.000 ms"
        )


def test_columns() -> None:
    assert output.columns([("a", "b"), ("long", "c")]) == "a     b\nlong  c"


class TestTopicsOfType:
    TOPICS = (
        ros.TopicInfo(topic_name="b", msg_type="geometry_msgs.Twist"),
        ros.TopicInfo(topic_name="a", msg_type="geometry_msgs.Twist"),
        ros.TopicInfo(topic_name="c", msg_type="their_msgs.Thing"),
    )

    @pytest.mark.parametrize(
        "spelling",
        ["geometry_msgs.Twist", "geometry_msgs/Twist", "geometry_msgs::msg::Twist", "Twist"],
    )
    def test_any_spelling(self, spelling: str) -> None:
        assert topic.topics_of_type(list(self.TOPICS), spelling) == ["a", "b"]

    def test_a_type_that_is_unknown_here(self) -> None:
        assert topic.topics_of_type(list(self.TOPICS), "their_msgs/msg/Thing") == ["c"]

    def test_none(self) -> None:
        assert topic.topics_of_type(list(self.TOPICS), "std_msgs/String") == []
        with pytest.raises(UnknownMessageType):
            topic.topics_of_type(list(self.TOPICS), "no_msgs/Such")


class TestGraphTexts:
    """The C++ texts are those that rosnode and rostopic printed, with their trailing spaces."""

    ROBOT = ros.NodeInfo(node_name="quad_simulator", ip="127.0.0.1", port=60000)
    OTHER = ros.NodeInfo(node_name="a", ip="::1", port=1, addresses=["10.0.0.1:1"])
    TOPIC = ros.TopicInfo(topic_name="quad_odometry", msg_type="geometry_msgs.Odometry")

    def test_nodes(self) -> None:
        nodes = [self.ROBOT, self.OTHER]
        assert node.written_list(nodes, Style.READABLE) == (
            "a               [::1]:1\nquad_simulator  127.0.0.1:60000"
        )
        assert node.written_list(nodes[:1], Style.CPP) == (
            "Active nodes:\n * quad_simulator (127.0.0.1:60000)\nTotal nodes: 1"
        )
        assert node.written_list([], Style.CPP) == "Active nodes:\nTotal nodes: 0"

    def test_a_node(self) -> None:
        found = ros.GetNodeInfoResponse(node_info=self.ROBOT, publishes=[self.TOPIC])
        assert node.written_info(found, Style.CPP).splitlines() == [
            "Node: quad_simulator",
            " - IP: 127.0.0.1",
            " - Port: 60000",
            "Published topics: ",
            "  * quad_odometry (geometry_msgs.Odometry)",
            "Subscribed topics: ",
            "  None",
        ]
        alone = ros.GetNodeInfoResponse(node_info=self.OTHER)
        assert node.written_info(alone, Style.READABLE).splitlines() == [
            "Node: a",
            "Address: [::1]:1 (also 10.0.0.1:1)",
            "Publishes: nothing",
            "Subscribes: nothing",
        ]

    def test_topics(self) -> None:
        line = topic.written_list([self.TOPIC], Style.READABLE)
        assert line == "quad_odometry  geometry_msgs.Odometry"
        assert topic.written_list([self.TOPIC], Style.CPP) == (
            "Active topics:\n * quad_odometry [geometry_msgs.Odometry]"
        )

    def test_a_topic(self) -> None:
        found = ros.GetTopicInfoResponse(msg_type="geometry_msgs.Odometry", publishers=[self.ROBOT])
        assert topic.written_info("quad_odometry", found, Style.CPP).splitlines() == [
            "Topic: quad_odometry",
            "Type: geometry_msgs.Odometry",
            "Publishers: ",
            "  * quad_simulator (127.0.0.1:60000)",
            "Subscribers: None",
        ]
        assert topic.written_info("quad_odometry", found, Style.READABLE).splitlines() == [
            "Topic: quad_odometry",
            "Type: geometry_msgs.Odometry",
            "Publishers:",
            "  quad_simulator  127.0.0.1:60000",
            "Subscribers: none",
        ]
