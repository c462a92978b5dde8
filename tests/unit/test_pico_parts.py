"""Names, stamps, settings, and what counters mean in words."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from simple_ros.diagnostics import ERROR, OK, WARN
from simple_ros.errors import ConfigError, InvalidName
from simple_ros_firmware_bridge.config import BoardConfig, load_boards
from simple_ros_firmware_bridge.judgement import LineFacts, judge_line
from simple_ros_firmware_bridge.mapping import TopicMap, graph_type
from simple_ros_firmware_bridge.memory_file import MemoryFile
from simple_ros_firmware_bridge.serial_framing import LineCounters
from simple_ros_firmware_bridge.stamps import OffsetFilter, needs_new_stamp

SECOND = 10**9


def test_types_of_boards() -> None:
    assert graph_type("nav_msgs::msg::dds_::Odometry_") == "nav_msgs.Odometry"
    assert graph_type("nav_msgs/Odometry") == ""


@pytest.mark.parametrize(
    ("board", "graph"),
    [
        ("rt/odom", "odom"),
        ("/odom", "odom"),
        ("rt/ddd/imu", "imu/data_raw"),
        ("rt/ddd/odom", "odom"),
        ("rt/ddd/range_tof", "sensors/range_tof"),
        ("rt/ddd/range", "sensors/range_ultrasonic"),
        ("rt/ddd/illuminance", "sensors/illuminance"),
        ("rt/ddd/cmd_vel", "cmd_vel"),
        ("rt/joint_states", "joint_states"),
    ],
)
def test_standard_names(board: str, graph: str) -> None:
    assert TopicMap().topic(board) == graph


def test_names_of_the_user_win_and_boards_have_namespaces() -> None:
    names = TopicMap({"/rt/cmd_vel": "hardware/cmd_vel", "odom": "/odometry"}, prefix="/left/")
    assert names.topic("rt/cmd_vel") == "left/hardware/cmd_vel"
    assert names.topic("rt/odom") == "/odometry"
    assert names.topic("rt/imu") == "left/imu"
    with pytest.raises(InvalidName):
        names.topic("rt/a b")


def test_stamps_since_power_on_become_times_of_day() -> None:
    offset = OffsetFilter()
    start = 1_700_000_000 * SECOND
    assert needs_new_stamp(0)
    assert needs_new_stamp(90 * SECOND)
    assert not needs_new_stamp(start)
    assert offset.restamped(0, start) == start
    delays = [5, 2, 9, 3, 40]
    made = [
        offset.restamped(i * SECOND, start + i * SECOND + delay * 10**6)
        for i, delay in enumerate(delays, 1)
    ]
    # From the second on the least delay is known, so that distances are those of the board again.
    assert [later - earlier for earlier, later in itertools.pairwise(made[1:])] == [SECOND] * 3
    assert offset.restamped(SECOND, start + 100 * SECOND) == start + 100 * SECOND  # started anew


def facts(**changes: object) -> LineFacts:
    counters = LineCounters(**{k: v for k, v in changes.items() if k in vars(LineCounters())})  # type: ignore[arg-type]
    others = {k: v for k, v in changes.items() if k not in vars(LineCounters())}
    usual = {
        "is_open": True,
        "why_closed": "",
        "has_session": True,
        "silence_s": 0.0,
        "vain_bytes": 0,
        "vain_lines": 0,
        "vain_s": 0.0,
        "strangers": 0,
        "baud": 115200,
    }
    return LineFacts(counters=counters, **{**usual, **others})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("found", "level", "words"),
    [
        (facts(frames=100, bytes=9000), OK, "connected"),
        (facts(is_open=False, why_closed="no such file"), ERROR, "no such file"),
        (facts(vain_bytes=69, vain_s=3), ERROR, "is 115200 baud right"),
        (facts(vain_bytes=900, vain_s=1), OK, "connected"),
        (facts(vain_bytes=69, vain_s=3, vain_lines=2), ERROR, "is it micro-ROS"),
        (facts(frames=5, crlf_frames=1), ERROR, "CR LF"),
        (facts(silence_s=5.2), ERROR, "silent for 5 s"),
        (facts(has_session=False, silence_s=5.2), WARN, "is this its port"),
        (facts(has_session=False, strangers=3), WARN, "has to be reset"),
        (facts(has_session=False), WARN, "not connected yet"),
        (facts(frames=90, crc_errors=10), WARN, "10 of 100 messages came damaged"),
    ],
)
def test_what_a_line_is_like_in_words(found: LineFacts, level: int, words: str) -> None:
    judged = judge_line(found)
    assert judged.level == level
    assert words in judged.text


def test_boards_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "boards.yaml"
    path.write_text(
        "boards:\n"
        "  - {port: /dev/ttyACM0, prefix: left, remap: {cmd_vel: hardware/cmd_vel}}\n"
        "  - port: /dev/ttyUSB0\n    baud: 921600\n"
        "    profiles: {odom: {topic: odom, type: nav_msgs/msg/Odometry}}\n"
    )
    left, right = load_boards(path)
    assert left == BoardConfig("/dev/ttyACM0", 115200, "left", {"cmd_vel": "hardware/cmd_vel"})
    assert right.profiles["odom"].type_name == "nav_msgs::msg::dds_::Odometry_"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("boards: 3", "needs a key 'boards'"),
        ("boards: []\nboard: 1", "no key 'board'"),
        ("boards: []", "empty"),
        ("boards: [{port: 5}]", r"boards\[0\]: port must be text, not 5"),
        ("boards: [{prefix: a b}]", r"boards\[0\]: .* must not contain ' '"),
        ("boards: [{baud: true}]", r"boards\[0\]: baud must be"),
        ("boards: [{restamp: maybe}]", r"boards\[0\]: restamp must be true or false"),
        ("boards: [{remap: {a: 1}}]", r"boards\[0\]: remap: 1 is no name"),
        ("boards: [{remap: {a: b!}}]", r"boards\[0\]: remap: .* must not contain '!'"),
        ("boards: [{port: /dev/a}, {port: /dev/a}]", "port /dev/a is named twice"),
        ("boards: [{}, {prefix: b}]", "'the first Pico that is found' is named twice"),
        ("boards: [{profiles: {a: {topic: b, type: Imu}}}]", "a.type must be like sensor_msgs/Imu"),
        ("boards: [{profiles: {a: {topic: b!, type: a/B}}}]", "a.topic: .* must not contain"),
        ("boards: [{prot: x}]", r"boards\[0\].prot: there is no such key"),
        ("boards: [{baud: 0}]", r"boards\[0\]: baud must be"),
        ("boards: [{remap: 3}]", "remap must be a mapping"),
        ("boards: [{profiles: {a: {topic: b}}}]", "needs 'topic' and 'type'"),
        ("boards: [", "boards.yaml"),
    ],
)
def test_a_wrong_file_is_told_with_its_key(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "boards.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        load_boards(path)


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "boards.yaml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match=r"boards\.yaml: .*utf-8"):
        load_boards(path)


def test_memory_on_disk(tmp_path: Path) -> None:
    kept = MemoryFile(tmp_path / "deep", "/dev/serial/by-id/usb Pico")
    assert kept.load() is None
    kept.keep({"version": 1})
    assert MemoryFile(tmp_path / "deep", "/dev/serial/by-id/usb Pico").load() == {"version": 1}
    kept.keep(None)
    kept.keep(None)
    assert kept.load() is None
    assert list((tmp_path / "deep").iterdir()) == []
    MemoryFile(None, "x").keep({})
