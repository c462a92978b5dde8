"""The frame tree against 4x4 matrices of numpy that know nothing of quaternions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from simple_ros.errors import SimpleRosError
from simple_ros.msg.geometry_msgs import Quaternion, Transform, TransformStamped, Vector3
from simple_ros.tf import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgument,
    LookupException,
    Rigid,
)
from simple_ros.tf.rigid import (
    IDENTITY,
    conjugate,
    from_message,
    multiply,
    normalised,
    rotate,
    slerp,
    to_message,
)
from simple_ros.time import Duration, Time

Matrix = NDArray[np.float64]
COORDINATE = st.floats(-100, 100)
ANGLE = st.floats(-math.pi, math.pi)


def axis_matrix(axis: int, angle: float) -> Matrix:
    """A rotation about a coordinate axis, by its definition."""
    c, s = math.cos(angle), math.sin(angle)
    one, two = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(4)
    matrix[one, one] = matrix[two, two] = c
    matrix[one, two], matrix[two, one] = -s, s
    return matrix


def shift_matrix(x: float, y: float, z: float) -> Matrix:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def axis_quaternion(axis: int, angle: float) -> tuple[float, float, float, float]:
    parts = [0.0, 0.0, 0.0, math.cos(angle / 2)]
    parts[axis] = math.sin(angle / 2)
    return (parts[0], parts[1], parts[2], parts[3])


@st.composite
def rigids(draw: st.DrawFn) -> tuple[Rigid, Matrix]:
    x, y, z = draw(COORDINATE), draw(COORDINATE), draw(COORDINATE)
    roll, pitch, yaw = draw(ANGLE), draw(ANGLE), draw(ANGLE)
    rotation = multiply(
        axis_quaternion(2, yaw), multiply(axis_quaternion(1, pitch), axis_quaternion(0, roll))
    )
    matrix = (
        shift_matrix(x, y, z) @ axis_matrix(2, yaw) @ axis_matrix(1, pitch) @ axis_matrix(0, roll)
    )
    return Rigid((x, y, z), normalised(rotation)), matrix


def matrix_of(rigid: Rigid) -> Matrix:
    """By where the corners of the unit cube go."""
    origin = np.array(rigid.apply((0.0, 0.0, 0.0)))
    matrix = np.eye(4)
    matrix[:3, 3] = origin
    for column, unit in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
        matrix[:3, column] = np.array(rigid.apply(unit)) - origin
    return matrix


def close(left: Matrix, right: Matrix) -> bool:
    return bool(np.allclose(left, right, atol=1e-6))


@given(rigids())
def test_a_rigid_is_its_matrix(made: tuple[Rigid, Matrix]) -> None:
    rigid, matrix = made
    assert close(matrix_of(rigid), matrix)
    assert close(rigid.rotation_matrix(), matrix[:3, :3])
    assert close(matrix_of(from_message(to_message(rigid))), matrix)


@given(rigids(), rigids())
def test_composition_is_the_product(a: tuple[Rigid, Matrix], b: tuple[Rigid, Matrix]) -> None:
    assert close(matrix_of(a[0].after(b[0])), a[1] @ b[1])


@given(rigids())
def test_inverse(made: tuple[Rigid, Matrix]) -> None:
    rigid, matrix = made
    assert close(matrix_of(rigid.inverse()), np.linalg.inv(matrix))
    assert close(matrix_of(rigid.after(rigid.inverse())), np.eye(4))
    assert close(matrix_of(rigid.inverse().inverse()), matrix)


@given(rigids())
def test_roll_pitch_yaw(made: tuple[Rigid, Matrix]) -> None:
    rigid, matrix = made
    roll, pitch, yaw = rigid.rpy()
    again = axis_matrix(2, yaw) @ axis_matrix(1, pitch) @ axis_matrix(0, roll)
    assert np.allclose(again[:3, :3], matrix[:3, :3], atol=1e-4)


@given(rigids(), rigids(), st.floats(0, 1))
def test_interpolation(a: tuple[Rigid, Matrix], b: tuple[Rigid, Matrix], share: float) -> None:
    (left, left_matrix), (right, right_matrix) = a, b
    assert close(matrix_of(left.toward(right, 0.0)), left_matrix)
    assert close(matrix_of(left.toward(right, 1.0)), right_matrix)
    between = left.toward(right, share)
    assert math.hypot(*between.rotation) == pytest.approx(1.0)
    expected = left_matrix[:3, 3] * (1 - share) + right_matrix[:3, 3] * share
    assert np.allclose(between.translation, expected, atol=1e-6)


@given(st.integers(0, 2), ANGLE, st.floats(-3.1, 3.1), st.floats(0, 1))
def test_slerp_turns_evenly(axis: int, start: float, turn: float, share: float) -> None:
    begin, end = axis_quaternion(axis, start), axis_quaternion(axis, start + turn)
    found = Rigid((0.0, 0.0, 0.0), slerp(begin, end, share)).rotation_matrix()
    assert np.allclose(found, axis_matrix(axis, start + share * turn)[:3, :3], atol=1e-6)
    minus = (-end[0], -end[1], -end[2], -end[3])
    again = Rigid((0.0, 0.0, 0.0), slerp(begin, minus, share)).rotation_matrix()
    assert np.allclose(found, again, atol=1e-6), "q and -q are one rotation"


def test_known_answers() -> None:
    left_turn = axis_quaternion(2, math.pi / 2)
    assert rotate(left_turn, (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))
    assert rotate(conjugate(left_turn), (0.0, 1.0, 0.0)) == pytest.approx((1.0, 0.0, 0.0))
    assert Rigid((1.0, 2.0, 3.0), left_turn).apply((1.0, 0.0, 0.0)) == pytest.approx((1, 3, 3))
    with pytest.raises(ValueError, match="no rotation"):
        normalised((0.0, 0.0, 0.0, 0.0))


# -- the tree -----------------------------------------------------------------------------------


def edge(parent: str, child: str, seconds: float, rigid: Rigid = IDENTITY) -> TransformStamped:
    message = TransformStamped(child_frame_id=child, transform=to_message(rigid))
    message.header.frame_id = parent
    message.header.stamp.CopyFrom(Time.of(seconds).to_msg())
    return message


def at(x: float, y: float = 0.0, z: float = 0.0) -> Rigid:
    return Rigid((x, y, z), (0.0, 0.0, 0.0, 1.0))


def place(answer: TransformStamped) -> tuple[float, float, float]:
    t = answer.transform.translation
    return (t.x, t.y, t.z)


def moving_robot() -> BufferCore:
    """map > odom > base > camera, and map > door; base moves 1 m/s along x from 1 s to 5 s."""
    core = BufferCore()
    core.set_transform(edge("odom", "base", 5, at(5)))
    core.set_transform(edge("odom", "base", 1, at(1)))
    core.set_transform(edge("map", "odom", 2, at(10)))
    core.set_transform(edge("map", "odom", 4, at(10)))
    core.set_transform(edge("base", "camera", 0, at(0, 0, 1)), is_static=True)
    core.set_transform(edge("map", "door", 0, at(0, 7)), is_static=True)
    return core


def test_lookup_interpolates() -> None:
    answer = moving_robot().lookup_transform("map", "camera", Time.of(3.5))
    assert place(answer) == pytest.approx((13.5, 0, 1))
    assert (answer.header.frame_id, answer.child_frame_id) == ("map", "camera")
    assert Time.from_msg(answer.header.stamp) == Time.of(3.5)


def test_latest_is_the_latest_common_time() -> None:
    core = moving_robot()
    for time in (None, Time()):
        answer = core.lookup_transform("map", "camera", time)
        assert Time.from_msg(answer.header.stamp) == Time.of(4)
        assert place(answer) == pytest.approx((14, 0, 1))
    assert core.latest_common_time("odom", "base") == Time.of(5)
    assert core.latest_common_time("map", "door") == Time(), "static"
    assert core.latest_common_time("base", "base") == Time.of(5)
    assert core.lookup_transform("base", "base").transform.rotation.w == 1.0


def test_sideways_through_the_common_ancestor() -> None:
    core = moving_robot()
    answer = core.lookup_transform("camera", "door", Time.of(3))
    assert place(answer) == pytest.approx((-13, 7, -1))
    back = core.lookup_transform("door", "camera", Time.of(3))
    assert place(back) == pytest.approx((13, -7, 1))
    assert core.path("camera", "door") == ("door", "map", "odom", "base", "camera")


def test_what_lies_above_the_common_ancestor_does_not_matter() -> None:
    core = moving_robot()
    assert place(core.lookup_transform("odom", "camera", Time.of(5))) == pytest.approx((5, 0, 1))
    core.set_transform(edge("base", "wheel", 5, at(0, 0.5)))
    assert core.can_transform("camera", "wheel", Time.of(5))


def test_time_travel() -> None:
    core = moving_robot()
    answer = core.lookup_transform_full("base", Time.of(5), "base", Time.of(2), "odom")
    assert place(answer) == pytest.approx((-3, 0, 0)), "where base was 3 s ago, seen from it now"
    assert Time.from_msg(answer.header.stamp) == Time.of(5)
    latest = core.lookup_transform_full("base", None, "door", None, "odom")
    assert place(latest) == pytest.approx((-15, 7, 0))


def test_unknown_frame() -> None:
    with pytest.raises(LookupException, match="did you mean 'camera'") as caught:
        moving_robot().lookup_transform("map", "camrea")
    assert caught.value.frame == "camrea"
    assert "base" in caught.value.known
    assert isinstance(caught.value, LookupError)
    assert isinstance(caught.value, SimpleRosError)
    with pytest.raises(LookupException, match="no transform has come yet"):
        BufferCore().lookup_transform("a", "b")


def test_not_connected() -> None:
    core = moving_robot()
    core.set_transform(edge("other", "thing", 3))
    with pytest.raises(ConnectivityException) as caught:
        core.lookup_transform("map", "thing")
    assert (caught.value.target_root, caught.value.source_root) == ("map", "other")
    with pytest.raises(ConnectivityException):
        core.lookup_transform("thing", "camera", Time.of(99))


def test_extrapolation_says_which_and_when() -> None:
    core = moving_robot()
    with pytest.raises(ExtrapolationException, match="after the last") as caught:
        core.lookup_transform("odom", "base", Time.of(5.5))
    error = caught.value
    assert (error.parent, error.child) == ("odom", "base")
    assert (error.earliest, error.latest) == (Time.of(1), Time.of(5))
    assert error.requested == Time.of(5.5)
    assert isinstance(error, ValueError)
    with pytest.raises(ExtrapolationException, match="before the first"):
        core.lookup_transform("base", "odom", Time.of(0.5))
    core.set_transform(edge("base", "arm", 3))
    with pytest.raises(ExtrapolationException, match=r"known at 3\.000000000 s alone"):
        core.lookup_transform("base", "arm", Time.of(4))
    assert core.can_transform("base", "arm", Time.of(3))


@pytest.mark.parametrize("name", ["", "/map"])
def test_names_in_questions(name: str) -> None:
    with pytest.raises(InvalidArgument):
        moving_robot().lookup_transform(name, "base")


def test_leading_slashes_of_what_is_sent_are_dropped() -> None:
    core = BufferCore()
    core.set_transform(edge("/map", "/base", 1))
    assert core.frames() == ("base", "map")


def bad_rotation(**parts: float) -> TransformStamped:
    message = edge("a", "b", 1)
    message.transform.rotation.CopyFrom(Quaternion(**parts))
    return message


def test_transforms_that_make_no_sense() -> None:
    negative = edge("a", "b", 1)
    negative.header.stamp.seconds = -1
    nowhere = edge("a", "b", 1)
    nowhere.transform.translation.x = math.nan
    for message in (
        edge("", "b", 1),
        edge("a", "", 1),
        edge("a", "/a", 1),
        bad_rotation(),
        bad_rotation(w=1.1),
        bad_rotation(x=math.nan, w=1.0),
        bad_rotation(x=math.inf),
        negative,
        nowhere,
    ):
        core = BufferCore()
        with pytest.raises(InvalidArgument):
            core.set_transform(message)
        assert core.frames() == ()
    assert BufferCore().set_transform(bad_rotation(w=1.001))


def test_rotations_nearly_of_length_one_are_normalised() -> None:
    core = BufferCore()
    core.set_transform(bad_rotation(x=0.7, w=0.71))
    r = core.lookup_transform("a", "b").transform.rotation
    assert math.hypot(r.x, r.y, r.z, r.w) == pytest.approx(1.0, abs=1e-12)


def test_cache_time() -> None:
    core = BufferCore(Duration.of(10))
    for second in range(1, 16):
        assert core.set_transform(edge("a", "b", second, at(second)))
    with pytest.raises(ExtrapolationException) as caught:
        core.lookup_transform("a", "b", Time.of(4.9))
    assert caught.value.earliest == Time.of(5)
    assert not core.set_transform(edge("a", "b", 4.9)), "older than the cache reaches"
    assert not core.set_transform(edge("a", "b", 7, at(99))), "its stamp is there"
    assert place(core.lookup_transform("a", "b", Time.of(7))) == (7, 0, 0)
    with pytest.raises(InvalidArgument, match="cache time"):
        BufferCore(Duration())


def test_static_holds_for_all_times_and_the_last_one_counts() -> None:
    core = moving_robot()
    assert place(core.lookup_transform("base", "camera", Time.of(1e6))) == (0, 0, 1)
    core.set_transform(edge("base", "camera", 0, at(0, 0, 2)), is_static=True)
    assert place(core.lookup_transform("base", "camera")) == (0, 0, 2)


def test_another_parent() -> None:
    core = BufferCore()
    for second in (1, 2):
        core.set_transform(edge("table", "cup", second, at(1)))
    core.set_transform(edge("table", "hand", 0, at(5)), is_static=True)
    for second in (3, 4):
        core.set_transform(edge("hand", "cup", second, at(0.5)))
    assert place(core.lookup_transform("table", "cup", Time.of(1.5))) == pytest.approx((1, 0, 0))
    assert place(core.lookup_transform("table", "cup", Time.of(2.9))) == pytest.approx((1, 0, 0))
    assert place(core.lookup_transform("table", "cup", Time.of(3))) == pytest.approx((5.5, 0, 0))
    assert place(core.lookup_transform("table", "cup")) == pytest.approx((5.5, 0, 0))


def test_a_circle_is_told() -> None:
    core = BufferCore()
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a")):
        core.set_transform(edge(parent, child, 1))
    core.set_transform(edge("x", "y", 1))
    with pytest.raises(LookupException, match="circle") as caught:
        core.lookup_transform("y", "a")
    assert set(caught.value.loop) == {"a", "b", "c"}
    with pytest.raises(LookupException, match="circle"):
        core.lookup_transform("y", "a", Time.of(1))


def test_clear_keeps_what_is_static() -> None:
    core = moving_robot()
    core.clear()
    assert core.can_transform("base", "camera")
    with pytest.raises(ConnectivityException):
        core.lookup_transform("map", "base", Time.of(3))
    core.set_transform(edge("odom", "base", 0.5, at(3)))
    assert place(core.lookup_transform("odom", "base")) == (3, 0, 0)


def test_facts() -> None:
    core = BufferCore()
    core.set_transform(edge("odom", "base", 1), "driver")
    core.set_transform(edge("odom", "base", 3), "driver")
    core.set_transform(edge("base", "camera", 0), is_static=True)
    base, camera = core.facts()
    assert (base.frame, base.parent, base.authority) == ("base", "odom", "driver")
    assert (base.earliest, base.latest, base.is_static) == (Time.of(1), Time.of(3), False)
    assert (camera.frame, camera.is_static, camera.latest) == ("camera", True, None)


@given(st.lists(rigids(), min_size=2, max_size=6), st.data())
def test_any_two_frames_of_any_tree(made: list[tuple[Rigid, Matrix]], data: st.DataObject) -> None:
    core = BufferCore()
    world = {"f0": np.eye(4)}
    for number, (rigid, matrix) in enumerate(made, 1):
        parent = data.draw(st.sampled_from(sorted(world)))
        core.set_transform(edge(parent, f"f{number}", 1, rigid), is_static=number % 2 == 0)
        world[f"f{number}"] = world[parent] @ matrix
    target, source = (data.draw(st.sampled_from(sorted(world))) for _ in range(2))
    answer = from_message(core.lookup_transform(target, source, Time.of(1)).transform)
    expected = np.linalg.inv(world[target]) @ world[source]
    assert np.allclose(matrix_of(answer), expected, atol=1e-6)


def test_message_forms() -> None:
    assert to_message(at(1, 2, 3)) == Transform(
        translation=Vector3(x=1, y=2, z=3), rotation=Quaternion(w=1)
    )
