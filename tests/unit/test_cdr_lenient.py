"""Samples that are shorter, longer or wrong, and messages that do not fit."""

from __future__ import annotations

import contextlib
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.msg.geometry_msgs import PoseWithCovariance, Twist
from simple_ros.msg.sensor_msgs import Imu, JointState, Range
from simple_ros.msg.std_msgs import Byte, Header, Int16MultiArray, String
from simple_ros.msg.visualization_msgs import Marker, MarkerType
from simple_ros_firmware_bridge import cdr


def range_sample(*, has_variance: bool) -> bytes:
    message = Range(radiation_type=Range.INFRARED, field_of_view=0.5, range=1.5, variance=0.25)
    message.header.stamp.seconds = 7
    message.header.frame_id = "tof"
    data = cdr.encode(message)
    return data if has_variance else data[:-4]


def test_a_range_of_humble_has_no_variance() -> None:
    old = cdr.decode(range_sample(has_variance=False), Range)
    new = cdr.decode(range_sample(has_variance=True), Range)
    assert (old.range, old.variance) == (1.5, 0.0)
    assert (new.range, new.variance) == (1.5, 0.25)


def test_what_follows_the_last_member_is_ignored() -> None:
    assert cdr.decode(range_sample(has_variance=True) + b"newer", Range).variance == 0.25


@pytest.mark.parametrize("cut", [1, 2, 3, 6])
def test_a_sample_that_ends_within_a_member_is_refused(cut: int) -> None:
    with pytest.raises(cdr.CdrError, match=r"sensor_msgs\.Range"):
        cdr.decode(range_sample(has_variance=True)[:-cut], Range)


def test_a_twist_may_lack_a_member_and_not_half_of_one() -> None:
    assert cdr.decode(struct.pack("<3d", 1, 2, 3), Twist).linear.z == 3
    with pytest.raises(cdr.CdrError):
        cdr.decode(struct.pack("<4d", 1, 2, 3, 4), Twist)
    with pytest.raises(cdr.CdrError):
        cdr.decode(b"", Twist)


def test_an_empty_string_may_have_no_length_at_all() -> None:
    assert cdr.decode(b"\0\0\0\0", String).data == ""
    assert cdr.decode(b"\x01\0\0\0\0", String).data == ""


@pytest.mark.parametrize("count", [0xFFFFFFFF, 1000])
def test_a_length_is_checked_before_anything_is_made(count: int) -> None:
    for message_class in (String, JointState, Int16MultiArray):
        with pytest.raises(cdr.CdrError):
            cdr.decode(bytes(8) + struct.pack("<I", count) + bytes(8), message_class)
            cdr.decode(struct.pack("<I", count) + bytes(8), message_class)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_sample_or_an_error(data: bytes) -> None:
    for message_class in (Imu, JointState, Range, Marker, PoseWithCovariance):
        for order in "<>":
            with contextlib.suppress(cdr.CdrError):
                cdr.decode(data, message_class, order)


def test_a_number_that_does_not_fit_is_named() -> None:
    with pytest.raises(cdr.CdrError, match="data does not fit"):
        cdr.encode(Byte(data=300))


def test_an_array_that_is_too_long_is_named_and_a_short_one_filled() -> None:
    with pytest.raises(cdr.CdrError, match="covariance has 40 numbers instead of 36"):
        cdr.encode(PoseWithCovariance(covariance=[0.0] * 40))
    again = cdr.decode(cdr.encode(PoseWithCovariance(covariance=[2.0])), PoseWithCovariance)
    assert list(again.covariance) == [2.0] + [0.0] * 35


def test_marker_constants_are_those_of_ros() -> None:
    arrow = Marker(type=MarkerType.ARROW)
    data = cdr.encode(arrow)
    assert struct.unpack_from("<i", data, 8 + 8 + 8 + 4) == (0,)
    assert cdr.decode(data, Marker).type == MarkerType.ARROW


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.lists(st.text(max_size=9), max_size=5), st.lists(finite, max_size=6), st.sampled_from("<>")
)
def test_there_and_back(names: list[str], positions: list[float], order: str) -> None:
    message = JointState(
        name=[name.replace("\0", "") for name in names], position=positions, velocity=[math.pi]
    )
    message.header.frame_id = "base"
    message.header.stamp.seconds, message.header.stamp.nanos = 12, 345
    assert cdr.decode(cdr.encode(message, order), JointState, order) == message


def test_more_than_a_second_in_the_nanoseconds_is_carried() -> None:
    data = struct.pack("<iI", 5, 2_500_000_000) + struct.pack("<I", 1) + bytes(1)
    stamp = cdr.decode(data, Header).stamp
    assert (stamp.seconds, stamp.nanos) == (7, 500_000_000)
