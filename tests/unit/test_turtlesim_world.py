"""The plane of the turtles and the loop that drives them along a circle."""

from __future__ import annotations

import math
from functools import partial
from random import Random

import pytest

from simple_ros.errors import ConfigError
from simple_ros.msg.visualization_msgs import ARROW, CUBE, LINE_LIST
from simple_ros_engines.network_exposure.turtlesim.circle import Circle, CircleController
from simple_ros_engines.network_exposure.turtlesim.markers import markers
from simple_ros_engines.network_exposure.turtlesim.picture import Picture
from simple_ros_engines.network_exposure.turtlesim.world import (
    SIDE_M,
    TRAIL,
    Pen,
    Slip,
    TurtleRefused,
    World,
)

TICK_S = 0.016


def driven(world: World, name: str, linear: float, angular: float, span_s: float) -> None:
    now_s = 0.0
    while now_s < span_s - 1e-9:
        world.command(name, linear, 0.0, angular, now_s)
        now_s += TICK_S
        world.step(TICK_S, now_s)


def test_names_are_given_in_turn_and_used_once() -> None:
    world = World()
    assert [world.spawn(1, 1, 0).name for _ in range(2)] == ["turtle1", "turtle2"]
    world.kill("turtle1")
    assert world.spawn(1, 1, 0).name == "turtle1"
    with pytest.raises(TurtleRefused, match="there already"):
        world.spawn(1, 1, 0, "turtle2")
    with pytest.raises(TurtleRefused, match="proper name"):
        world.spawn(1, 1, 0, "no/name")
    with pytest.raises(TurtleRefused, match="turtle2, turtle1"):
        world.kill("bob")


@pytest.mark.parametrize(
    "place", [(-0.1, 1, 0), (1, SIDE_M + 0.1, 0), (math.nan, 1, 0), (1, 1, math.inf)]
)
def test_no_turtle_is_outside(place: tuple[float, float, float]) -> None:
    world = World()
    with pytest.raises(TurtleRefused, match="cannot be at"):
        world.spawn(*place)
    world.spawn(1, 1, 0)
    with pytest.raises(TurtleRefused, match="cannot be at"):
        world.teleport("turtle1", *place)


def test_a_circle_closes() -> None:
    world = World()
    turtle = world.spawn(5, 5, 0)
    steps = round(2 * math.pi / (0.5 * TICK_S))
    driven(world, "turtle1", 1.0, 2 * math.pi / (steps * TICK_S), steps * TICK_S)
    assert (turtle.x, turtle.y) == pytest.approx((5, 5), abs=0.01)
    assert turtle.theta == pytest.approx(0, abs=0.01)


def test_a_command_counts_for_a_second() -> None:
    world = World()
    turtle = world.spawn(1, 5, 0)
    world.command("turtle1", 1.0, 0.0, 0.0, 0.0)
    for tick in range(1, 300):
        world.step(0.01, 0.01 * tick)
    assert turtle.x == pytest.approx(2.0, abs=0.02)
    assert turtle.linear == 0


def test_sideways_and_nonsense() -> None:
    world = World()
    turtle = world.spawn(5, 5, 0)
    assert world.command("turtle1", 0.0, 1.0, 0.0, 0.0)
    world.step(0.5, 0.5)
    assert (turtle.x, turtle.y) == pytest.approx((5, 5.5))
    assert not world.command("turtle1", math.nan, 0.0, 0.0, 0.5)
    assert not world.command("turtle1", 1e300, 0.0, 0.0, 0.5)
    assert not world.command("nobody", 0.0, 0.0, 0.0, 0.5)


def test_the_wall_is_told_once() -> None:
    world = World()
    turtle = world.spawn(SIDE_M - 0.1, 5, 0)
    world.command("turtle1", 1.0, 0.0, 0.0, 0.0)
    told = [len(world.step(0.05, 0.05 * tick)) for tick in range(1, 11)]
    assert sum(told) == 1
    assert (turtle.x, turtle.at_wall) == (SIDE_M, True)
    world.command("turtle1", -1.0, 0.0, 0.0, 0.5)
    world.step(0.05, 0.55)
    assert not turtle.at_wall


def test_pens_draw_and_lift() -> None:
    world = World()
    world.spawn(1, 1, 0)
    driven(world, "turtle1", 1.0, 0.0, 0.5)
    drawn = len(list(world.strokes(0)))
    assert drawn > 5
    world.set_pen("turtle1", Pen(is_off=True, width=0))
    driven(world, "turtle1", 1.0, 0.0, 0.5)
    lifted = list(world.strokes(0))
    assert len(lifted) <= drawn + 1
    world.set_pen("turtle1", Pen(255, 0, 0, 0))
    world.teleport_by("turtle1", 2.0, math.pi / 2)
    _, newest = list(world.strokes(lifted[-1][1].number))[-1]
    assert (newest.pen.r, newest.pen.width) == (255, 3)
    assert math.dist(newest.start, newest.end) == pytest.approx(2.0)
    world.clear()
    assert list(world.strokes(0)) == []


def test_lines_are_bounded() -> None:
    world = World()
    world.spawn(1, 5, 0)
    for number in range(TRAIL + 50):
        world.teleport("turtle1", 1 + number % 2, 5, 0)
    assert len(list(world.strokes(0))) == TRAIL


def test_a_page_gets_what_is_new() -> None:
    world = World()
    world.spawn(1, 1, 0)
    picture = Picture(world, (0, 0, 0))
    world.teleport("turtle1", 2, 1, 0)
    assert [line[:4] for line in picture.state()["lines"]] == [[1, 1, 2, 1]]
    assert picture.state()["lines"] == []
    world.teleport("turtle1", 2, 3, 0)
    first = picture.state()
    assert [line[:4] for line in first["lines"]] == [[2, 1, 2, 3]]
    assert not first["wipe"]
    world.clear()
    assert picture.state()["wipe"]
    assert not picture.state()["wipe"]
    world.spawn(4, 4, 0)
    world.teleport("turtle2", 4, 5, 0)
    world.kill("turtle1")
    gone = picture.state()
    assert gone["wipe"]
    assert [line[:4] for line in gone["lines"]] == [[4, 4, 4, 5]]


def test_markers_show_turtles_and_lines() -> None:
    world = World()
    world.spawn(1, 1, math.pi / 2)
    world.teleport("turtle1", 2, 1, math.pi / 2)
    world.set_pen("turtle1", Pen(255, 0, 0, 5))
    world.teleport("turtle1", 2, 2, math.pi / 2)
    array = markers(world, (69, 86, 255))
    by_type = {marker.type: marker for marker in array.markers[1:]}
    assert set(by_type) == {CUBE, ARROW, LINE_LIST}
    assert by_type[ARROW].pose.orientation.z == pytest.approx(math.sin(math.pi / 4))
    line = by_type[LINE_LIST]
    assert len(line.points) == len(line.colors) == 4
    assert line.colors[3].r == pytest.approx(1.0)


def loop(delay: int, rate: int, seconds: float = 30.0) -> tuple[float, float]:
    """Error and progress of a slipping turtle whose poses come some ticks late and is told each so many ticks."""
    world = World(Slip(0.3, 0.3, partial(Random(1).gauss, 0.0, 1.0)))
    turtle = world.spawn(7.544, 5.544, math.pi / 2)
    controller = CircleController(Circle(5.544, 5.544, 2.0), 1.0)
    poses: list[tuple[float, float, float]] = []
    for tick in range(round(seconds / TICK_S)):
        now_s = tick * TICK_S
        poses.append((turtle.x, turtle.y, turtle.theta))
        if len(poses) > delay:
            controller.pose_came(*poses.pop(0), now_s)
        if tick % rate == 0:
            command = controller.command(now_s)
            world.command("turtle1", command.linear, 0.0, command.angular, now_s)
        world.step(TICK_S, now_s + TICK_S)
    tracking = controller.tracking(seconds)
    return tracking.error_m, tracking.progress_mps


def test_the_loop_follows_the_circle() -> None:
    error_m, progress = loop(0, 1)
    assert error_m < 0.05
    assert progress == pytest.approx(1.0, rel=0.03)


def test_delay_harms_the_loop() -> None:
    errors = [loop(delay, 3)[0] for delay in (0, 12, 40)]
    assert errors[0] < errors[1] < errors[2]
    assert errors[0] < 0.05
    assert errors[2] > 0.2


def test_without_poses_the_turtle_is_stopped() -> None:
    controller = CircleController(Circle(0, 0, 1))
    assert controller.command(0.0).linear == 0
    assert controller.tracking(0.0).pose_age_s == math.inf
    controller.pose_came(1, 0, math.pi / 2, 0.0)
    assert controller.command(0.1).linear > 0
    assert controller.command(1.2).linear == 0


def test_a_circle_has_a_radius() -> None:
    with pytest.raises(ConfigError, match="radius"):
        Circle(0, 0, 0)
