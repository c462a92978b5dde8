"""The quadrotor's motion against numerical differentiation, and the shapes drawn of it."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.demos.quadrotor import (
    GRAVITY_M_S2,
    Circle,
    Quaternion,
    Vector,
    euler_angles_rad,
    motion_at,
    odometry,
    product,
    rotated,
    state_at,
    state_of,
)
from simple_ros.demos.quadrotor_markers import (
    propeller_angle_rad,
    quadrotor_markers,
    short_path_marker,
    step_marker,
)
from simple_ros.msg.geometry_msgs import Point, Pose
from simple_ros.msg.visualization_msgs import ADD, CUBE, CYLINDER, LINE_STRIP

STEP_S = 1e-4

times_s = st.floats(0.0, 100.0)
circles = st.builds(
    Circle,
    radius_m=st.floats(0.5, 10.0),
    angular_speed_rad_s=st.floats(0.2, 3.0) | st.floats(-3.0, -0.2),
    height_m=st.floats(-5.0, 5.0),
    swing_m=st.floats(0.0, 0.5),
    swing_angular_speed_rad_s=st.floats(0.0, 2.0),
)


def derivative(of: Callable[[float], Vector], t_s: float) -> list[float]:
    before, after = of(t_s - STEP_S), of(t_s + STEP_S)
    return [(b - a) / (2 * STEP_S) for a, b in zip(before, after, strict=True)]


def conjugate(q: Quaternion) -> Quaternion:
    return (-q[0], -q[1], -q[2], q[3])


def dot(a: Vector, b: Vector) -> float:
    return sum(p * q for p, q in zip(a, b, strict=True))


class TestMotion:
    def test_it_is_the_circle_of_the_cpp_simulator(self) -> None:
        motion = motion_at(1.28)
        assert motion.position_m == pytest.approx(
            (-1.6711775542628153, 1.0987108728542532, 0.6194390882724784), abs=1e-12
        )
        assert motion.velocity_m_s == pytest.approx(
            (-2.1974217457085063, -3.3423551085256307, 0.08020957578842927), abs=1e-12
        )

    @given(times_s, circles)
    def test_each_is_the_derivative_of_the_one_before(self, t_s: float, circle: Circle) -> None:
        motion = motion_at(t_s, circle)
        pairs: list[tuple[Callable[[float], Vector], Vector]] = [
            (lambda t: motion_at(t, circle).position_m, motion.velocity_m_s),
            (lambda t: motion_at(t, circle).velocity_m_s, motion.acceleration_m_s2),
            (lambda t: motion_at(t, circle).acceleration_m_s2, motion.jerk_m_s3),
        ]
        for below, value in pairs:
            assert derivative(below, t_s) == pytest.approx(value, abs=1e-4)


class TestAttitude:
    @pytest.mark.parametrize(
        ("t_s", "sent"),
        [
            (0.78, (-0.00181309852393, -0.33586995781294, 0.94189289813318, 0.00508454115524)),
            (1.28, (0.15955495142671, -0.29584807523446, 0.82894609872634, -0.44706207540078)),
            (1.78, (-0.28203781683921, 0.18325208064352, -0.51309436156287, 0.78968824288119)),
        ],
    )
    def test_it_is_what_the_cpp_simulator_sends(self, t_s: float, sent: Quaternion) -> None:
        ours = state_at(t_s).orientation
        sign = math.copysign(1.0, sum(a * b for a, b in zip(ours, sent, strict=True)))
        assert [sign * part for part in ours] == pytest.approx(sent, abs=1e-11)

    @given(times_s, circles)
    def test_thrust_points_along_acceleration_and_hover(self, t_s: float, circle: Circle) -> None:
        ax, ay, az = motion_at(t_s, circle).acceleration_m_s2
        thrust = (ax, ay, az + GRAVITY_M_S2)
        up = rotated((0.0, 0.0, 1.0), state_at(t_s, circle).orientation)
        length = math.hypot(*thrust)
        assert up == pytest.approx([part / length for part in thrust], abs=1e-9)

    @given(times_s, circles)
    def test_it_is_a_unit_quaternion_that_faces_where_it_flies(
        self, t_s: float, circle: Circle
    ) -> None:
        state = state_at(t_s, circle)
        assert math.hypot(*state.orientation) == pytest.approx(1.0)
        vx, vy, _ = state.velocity_m_s
        ahead = rotated((1.0, 0.0, 0.0), state.orientation)
        left = rotated((0.0, 1.0, 0.0), state.orientation)
        assert dot(ahead, (vx, vy, 0.0)) > 0
        assert dot(left, (vx, vy, 0.0)) == pytest.approx(0.0, abs=1e-9)

    @given(times_s, circles)
    def test_turn_rate_is_the_derivative_of_the_attitude(self, t_s: float, circle: Circle) -> None:
        before = state_at(t_s - STEP_S, circle).orientation
        after = state_at(t_s + STEP_S, circle).orientation
        *axis, w = product(conjugate(before), after)
        # A small turn is twice the vector part; the sign of a quaternion means nothing.
        measured = [math.copysign(2.0, w) * part / (2 * STEP_S) for part in axis]
        state = state_at(t_s, circle)
        assert state.angular_velocity_rad_s == pytest.approx(measured, abs=1e-4)

    def test_a_level_circle_is_a_steady_bank(self) -> None:
        circle = Circle(swing_m=0.0)
        for t_s in (0.0, 0.7, 2.9):
            roll, pitch, _ = euler_angles_rad(state_at(t_s, circle).orientation)
            assert roll == pytest.approx(-math.atan2(8.0, GRAVITY_M_S2))
            assert pitch == pytest.approx(0.0, abs=1e-12)
            rate = state_at(t_s, circle).angular_velocity_rad_s
            assert math.hypot(*rate) == pytest.approx(2.0)

    def test_with_no_heading_there_is_no_attitude(self) -> None:
        with pytest.raises(ZeroDivisionError):
            state_of(motion_at(0.0, Circle(radius_m=0.0)))


def test_rotations_compose() -> None:
    first, second = state_at(0.3).orientation, state_at(2.2).orientation
    vector = (0.3, -1.2, 2.0)
    at_once = rotated(vector, product(first, second))
    assert at_once == pytest.approx(rotated(rotated(vector, second), first))


def test_odometry_tells_the_whole_state() -> None:
    state = state_at(1.1)
    message = odometry(state)
    at, q = message.pose.position, message.pose.orientation
    assert (at.x, at.y, at.z) == state.position_m
    assert (q.x, q.y, q.z, q.w) == state.orientation
    v, w = message.linear_velocity, message.angular_velocity
    assert (v.x, v.y, v.z) == state.velocity_m_s
    assert (w.x, w.y, w.z) == state.angular_velocity_rad_s


class TestMarkers:
    pose = odometry(state_at(0.9)).pose

    def test_body_four_arms_four_propellers(self) -> None:
        markers = quadrotor_markers(self.pose).markers
        assert [marker.id for marker in markers] == list(range(9))
        assert [marker.type for marker in markers] == [CUBE] + 8 * [CYLINDER]
        assert {marker.ns for marker in markers} == {"quadrotor"}
        assert {marker.action for marker in markers} == {ADD}
        assert {marker.color.a for marker in markers} == {1.0}
        assert markers[0].pose == self.pose

    def test_propellers_sit_on_the_tips_of_their_arms(self) -> None:
        markers = quadrotor_markers(self.pose).markers
        for arm, propeller in zip(markers[1:5], markers[5:9], strict=True):
            middle, hub = arm.pose.position, propeller.pose.position
            along = rotated((0.0, 0.0, arm.scale.z / 2), quaternion(arm.pose))
            ends = [
                math.dist(
                    (middle.x + s * along[0], middle.y + s * along[1], middle.z + s * along[2]),
                    (hub.x, hub.y, hub.z),
                )
                for s in (-1, 1)
            ]
            assert min(ends) == pytest.approx(0.02)

    def test_all_of_it_moves_as_one(self) -> None:
        def distances(pose: Pose) -> list[float]:
            centres = [marker.pose.position for marker in quadrotor_markers(pose).markers]
            points = [(centre.x, centre.y, centre.z) for centre in centres]
            return [math.dist(a, b) for a in points for b in points]

        assert distances(self.pose) == pytest.approx(distances(odometry(state_at(3.3)).pose))

    def test_only_propellers_turn_and_neighbours_against_each_other(self) -> None:
        still = quadrotor_markers(self.pose).markers
        turned = quadrotor_markers(self.pose, 0.2).markers
        assert list(still[:5]) == list(turned[:5])
        angles = []
        for before, after in zip(still[5:], turned[5:], strict=True):
            assert before.pose.position == after.pose.position
            turn = product(conjugate(quaternion(before.pose)), quaternion(after.pose))
            assert turn[:2] == pytest.approx((0.0, 0.0), abs=1e-12)
            angles.append(2 * math.atan2(turn[2], turn[3]))
        assert angles == pytest.approx([0.2, 0.2, -0.2, -0.2])

    @given(times_s)
    def test_propellers_keep_turning(self, t_s: float) -> None:
        angle_rad = propeller_angle_rad(t_s)
        assert 0 <= angle_rad < 2 * math.pi
        step_rad = (propeller_angle_rad(t_s + 0.02) - angle_rad) % math.pi
        assert 0.1 < step_rad < math.pi / 2  # else a blade seems to stand or to turn back

    def test_lines_are_those_of_the_cpp_visualizer(self) -> None:
        points = [Point(x=float(i)) for i in range(3)]
        path = short_path_marker(points)
        assert (path.ns, path.id, path.type) == ("quad_path_short", 0, LINE_STRIP)
        assert (path.lifetime, path.scale.x) == (50.0, 0.35)
        assert list(path.points) == points
        step = step_marker(points[1], points[2])
        assert (step.ns, step.id, step.type) == ("quad_path_incremental", 1, LINE_STRIP)
        assert (step.lifetime, step.scale.x) == (-1.0, 0.15)
        assert list(step.points) == points[1:]


def quaternion(pose: Pose) -> Quaternion:
    q = pose.orientation
    return (q.x, q.y, q.z, q.w)
