"""What the wireless demo is made of: course, scenery, plot. Pure."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from simple_ros_hub.demo.plot import Second, plot, runs_of
from simple_ros_hub.demo.scenery import (
    DEAD_ZONE,
    Course,
    cloud,
    dead_shares,
    floor_map,
    lap_m,
    picture,
    planned_path,
)


def second(laps: float, *, engines: bool, age_ms: float | None = 20.0) -> Second:
    return Second(0.0, laps, engines, age_ms, 10.0, 0.0, 5.0)


def test_a_round_ends_where_it_began() -> None:
    course = Course()
    begin = course.place()
    course.drive(10.0, 7.0)
    assert course.place()[:2] == pytest.approx((80.0, 5.0))
    course.drive(-5.0, 1.0)
    course.drive(lap_m() - 70, 1.0)
    assert course.laps == pytest.approx(1.0)
    assert course.place() == pytest.approx(begin)


def test_the_dead_zone_lies_on_the_way_and_is_no_wall() -> None:
    begin, end = dead_shares()
    assert 0.5 < begin < end < 0.8
    assert (end - begin) * lap_m() == pytest.approx(2 * DEAD_ZONE[2], abs=1.1)
    grid = floor_map()
    for share in (begin, end):
        course = Course()
        course.way_m = share * lap_m()
        x, y, _ = course.place()
        column = int((x - grid.info.origin.position.x) / grid.info.resolution)
        row = int((y - grid.info.origin.position.y) / grid.info.resolution)
        assert grid.data[row * grid.info.width + column] == 0
    assert len(planned_path().poses) == 5


def test_what_is_seen_changes_and_is_the_same_again() -> None:
    here, there = (1.0, 2.0, 0.0), (4.0, 2.0, 0.0)
    assert picture(here, 1) == picture(here, 1)
    assert picture(here, 1) != picture(there, 1)
    assert len(picture(here, 1).data) == 320 * 240 * 3
    assert cloud(here, 1).width == 3000


def test_the_newest_whole_round_of_each_kind_is_shown() -> None:
    off = [second(0.1 * i, engines=False) for i in range(10)]
    on = [second(1 + 0.1 * i, engines=True) for i in range(10)]
    begun = [second(2.0, engines=True), second(2.1, engines=True)]
    runs = runs_of([*off, *on, *begun])
    assert runs == {False: off, True: on}
    assert runs_of(off) == {False: off, True: []}


def test_the_plot_breaks_lines_where_nothing_came() -> None:
    run = [second(0.1, engines=False), second(0.2, engines=False, age_ms=None)]
    run += [second(0.3, engines=False, age_ms=900.0), second(1.1, engines=True)]
    root = ET.fromstring(plot(run, (0.6, 0.7)))
    space = "{http://www.w3.org/2000/svg}"
    lines = [one.get("d", "") for one in root.iter(f"{space}path") if one.get("class") == "off"]
    assert len(lines) == 4
    assert lines[0].count("M") == 2
    assert lines[1].count("M") == 1
    texts = [one.text for one in root.iter(f"{space}text")]
    assert "dead zone" in texts
    assert "engines on" in texts
    assert plot([], (0.6, 0.7)).endswith("</svg>\n")
