"""Messages as text and text as messages, without a process or a Master."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
import yaml
from google.protobuf import text_format
from google.protobuf.struct_pb2 import Struct
from google.protobuf.timestamp_pb2 import Timestamp

from simple_ros.cli.message_cpp import cpp_text
from simple_ros.cli.message_fields import UnknownField, check_path, split_path, stamp_path
from simple_ros.cli.message_input import BadMessageText, message_of
from simple_ros.cli.message_text import field_json, field_text, message_json, yaml_text
from simple_ros.errors import SimpleRosError
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.geometry_msgs import Odometry, Point, Point32, PoseStamped, Twist, Vector3
from simple_ros.msg.nav_msgs import Path
from simple_ros.msg.sensor_msgs import Image, LaserScan
from simple_ros.msg.std_msgs import Header, Int64, String
from simple_ros.msg.visualization_msgs import Marker

PATH = Path(
    header=Header(stamp=Timestamp(seconds=1, nanos=500_000_000), frame_id="map"),
    poses=[PoseStamped(header=Header(seq=i)) for i in range(2)],
)
PATH.poses[1].pose.position.x = 2.5


class TestYamlText:
    def test_all_fields_also_zeros(self) -> None:
        assert yaml_text(Twist(linear=Vector3(x=1.0))) == (
            "linear:\n  x: 1.0\n  y: 0.0\n  z: 0.0\nangular: {}"
        )

    def test_it_is_yaml(self) -> None:
        text = yaml_text(PATH)
        loaded = yaml.safe_load(text)
        assert loaded["header"]["frame_id"] == "map"
        assert loaded["header"]["stamp"].isoformat() == "1970-01-01T00:00:01.500000+00:00"
        assert [pose["header"]["seq"] for pose in loaded["poses"]] == [0, 1]
        assert loaded["poses"][1]["pose"]["position"] == {"x": 2.5, "y": 0.0, "z": 0.0}

    def test_it_reads_back_as_the_same_message(self) -> None:
        twist = Twist(linear=Vector3(x=0.1), angular=Vector3(z=-1e-9))
        assert message_of(Twist, yaml_text(twist)) == twist

    @pytest.mark.parametrize("text", ["", "two\nlines", 'a "quote": {', "\x1b[31m", "ünï"])
    def test_strings_are_quoted(self, text: str) -> None:
        written = yaml_text(String(data=text))
        assert "\n" not in written
        assert "\x1b" not in written
        assert yaml.safe_load(written) == {"data": text}

    def test_long_lists_are_cut_unless_full(self) -> None:
        scan = LaserScan(ranges=[1.5] * 70)
        assert ", 1.5, ... 6 more]" in yaml_text(scan)
        assert yaml.safe_load(yaml_text(scan, full=True))["ranges"] == [1.5] * 70
        path = Path(poses=[PoseStamped()] * 70)
        assert yaml_text(path).splitlines()[-1] == "# ... 6 more"
        assert len(yaml.safe_load(yaml_text(path, full=True))["poses"]) == 70

    def test_bytes_are_counted(self) -> None:
        lines = yaml_text(Image(data=bytes(range(20)))).splitlines()
        assert lines[-1] == "data: <20 bytes 00 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d 0e 0f ...>"
        full = yaml_text(Image(data=bytes(range(20))), full=True)
        assert full.endswith("0f 10 11 12 13>")
        assert yaml_text(Image()).endswith("data: <0 bytes>")

    @pytest.mark.parametrize(
        ("value", "text"),
        [(0.1, "0.1"), (1 / 3, "0.33333334"), (3e38, "3e+38"), (math.nan, ".nan")],
    )
    def test_single_precision_is_written_short(self, value: float, text: str) -> None:
        assert yaml_text(Point32(x=value)).splitlines()[0] == f"x: {text}"

    def test_an_empty_message(self) -> None:
        assert yaml_text(Struct()) == "fields: {}"

    def test_a_map(self) -> None:
        struct = Struct()
        struct.update({"b": 1.0, "a": "x"})
        assert yaml_text(struct) == (
            'fields:\n  "a":\n    string_value: "x"\n  "b":\n    number_value: 1.0'
        )

    def test_a_time_out_of_range_shows_its_numbers(self) -> None:
        header = Header(stamp=Timestamp(seconds=2**60))
        assert yaml.safe_load(yaml_text(header))["stamp"] == {"seconds": 2**60, "nanos": 0}
        with pytest.raises(ValueError):
            message_json(header)


class TestCppText:
    def test_as_text_format_but_for_numbers(self) -> None:
        marker = Marker(ns='a "b"\n', id=3, points=[Point(x=1), Point()])
        text = cpp_text(marker)
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
        assert cpp_text(odometry) == expected

    def test_floats(self) -> None:
        assert cpp_text(Point32(x=0.1, y=1 / 3)).splitlines()[1:3] == [
            "x: 0.1",
            "y: 0.333333343",
        ]

    def test_a_map(self) -> None:
        struct = Struct()
        struct.update({"a": True})
        assert text_format.Parse(cpp_text(struct).split("\n", 1)[1], Struct()) == struct


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
        parts = split_path(path)
        check_path(Path.DESCRIPTOR, parts)
        assert field_text(PATH, parts) == text
        assert field_json(PATH, parts) == value

    def test_lists(self) -> None:
        scan = LaserScan(ranges=[1.0, 2.0])
        assert field_text(scan, ("ranges",)) == "[1.0, 2.0]"
        assert field_text(scan, ("ranges", "1")) == "2.0"
        assert field_json(scan, ("ranges",)) == [1.0, 2.0]
        assert field_text(PATH, ("poses",)).startswith("- header:\n    seq: 0\n")
        with pytest.raises(IndexError):
            field_text(scan, ("ranges", "2"))
        with pytest.raises(IndexError):
            field_json(scan, ("ranges", "2"))

    def test_a_wrong_path_is_told_with_the_fields_there_are(self) -> None:
        with pytest.raises(UnknownField) as caught:
            check_path(Odometry.DESCRIPTOR, ("pose", "pos"))
        assert caught.value.known == ("position", "orientation")
        assert str(caught.value) == (
            "geometry_msgs.Pose (at 'pose') has no field 'pos'; "
            "its fields are position, orientation"
        )

    @pytest.mark.parametrize("path", ["poses.pose", "header.seq.x", "header.seq[0]", "", "poses[]"])
    def test_other_wrong_paths(self, path: str) -> None:
        with pytest.raises(SimpleRosError):
            check_path(Path.DESCRIPTOR, split_path(path))

    def test_json_keeps_names_and_zeros(self) -> None:
        assert message_json(Header(frame_id="a")) == {"seq": 0, "frame_id": "a"}

    def test_where_the_stamp_is(self) -> None:
        assert stamp_path(Path.DESCRIPTOR) == ("header", "stamp")
        assert stamp_path(Header.DESCRIPTOR) == ("stamp",)
        with pytest.raises(SimpleRosError, match=r"geometry_msgs\.Twist has neither header\.stamp"):
            stamp_path(Twist.DESCRIPTOR)


class TestMessageOf:
    def test_yaml_and_json(self) -> None:
        wanted = Twist(linear=Vector3(x=0.5), angular=Vector3(z=-1))
        assert message_of(Twist, "{linear: {x: 0.5}, angular: {z: -1}}") == wanted
        assert message_of(Twist, "linear:\n  x: 0.5\nangular:\n  z: -1\n") == wanted
        text = json.dumps({"linear": {"x": 0.5}, "angular": {"z": -1}})
        assert message_of(Twist, text) == wanted
        assert message_of(Twist, "") == message_of(Twist, "{}") == Twist()
        assert message_of(Twist, "linear: null") == Twist()

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
        message = message_of(Header, f"{{stamp: {stamp}}}")
        assert message == Header(stamp=Timestamp(seconds=1, nanos=500_000_000))

    def test_bytes_and_numbers_that_are_none(self) -> None:
        assert message_of(Image, "{data: !!binary AAEC}") == Image(data=b"\0\1\2")
        scan = message_of(LaserScan, "{ranges: [.inf, -.inf, 1e-3]}")
        assert isinstance(scan, LaserScan)
        assert list(scan.ranges) == pytest.approx([math.inf, -math.inf, 1e-3])

    def test_an_unknown_field_is_told_with_its_place_and_the_known_ones(self) -> None:
        with pytest.raises(UnknownField) as caught:
            message_of(Path, "{poses: [{pose: {position: {x: 1, w: 2}}}]}")
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
            ("{linear: {x: fast}}", "this is no geometry_msgs.Twist: field 'linear': field 'x': "),
        ],
    )
    def test_what_does_not_fit_is_one_line(self, text: str, reason: str) -> None:
        with pytest.raises(BadMessageText) as caught:
            message_of(Twist, text)
        assert reason in str(caught.value)
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize("stamp", ["{seconds: x}", "{seconds: 99999999999999}", "5", "[1]"])
    def test_bad_times(self, stamp: str) -> None:
        with pytest.raises(BadMessageText):
            message_of(Header, f"{{stamp: {stamp}}}")

    def test_a_list_is_wanted(self) -> None:
        with pytest.raises(SimpleRosError):
            message_of(DiagnosticArray, "{status: {name: a}}")

    def test_int64(self) -> None:
        assert message_of(Int64, f"{{data: {2**62}}}") == Int64(data=2**62)
