"""What the demo shows: rates, the drawing, and that a screen fits the terminal."""

from __future__ import annotations

import math

import pytest
from rich.console import Console

from simple_ros.demos.drawing import drawn_way
from simple_ros.demos.observer import TopicRow
from simple_ros.demos.processes import Usage
from simple_ros.demos.quad_demo_view import DemoState, ProcessRow, plain_line, screen
from simple_ros.demos.quadrotor import odometry, state_at
from simple_ros.demos.rates import RateMeter

NAMES = ("quad_odometry", "quad_marker_array", "quad_path_short", "quad_path_incremental")


class TestRateMeter:
    def test_nothing_has_no_rate(self) -> None:
        meter = RateMeter()
        assert (meter.messages, meter.rate_hz(5.0), meter.bytes_per_s(5.0)) == (0, 0.0, 0.0)
        meter.note(5.0, 100)
        assert (meter.messages, meter.rate_hz(5.0), meter.bytes_per_s(5.0)) == (1, 0.0, 0.0)

    @pytest.mark.parametrize("count", [2, 10, 1000])
    def test_a_steady_flow(self, count: int) -> None:
        meter = RateMeter()
        for i in range(count):
            meter.note(100 + i * 0.02, 30)
        now = 100 + (count - 1) * 0.02
        assert meter.messages == count
        assert meter.rate_hz(now + 0.015) == pytest.approx(50.0)
        assert meter.bytes_per_s(now) == pytest.approx(1500.0)

    def test_the_window_forgets_an_earlier_rate(self) -> None:
        meter = RateMeter(window_s=2.0)
        times = [i * 0.5 for i in range(10)] + [5 + i * 0.1 for i in range(31)]
        for time in times:
            meter.note(time, 1)
        assert meter.rate_hz(8.0) == pytest.approx(10.0)

    def test_silence_is_zero(self) -> None:
        meter = RateMeter(silent_after_s=1.0)
        meter.note(1.0, 1)
        meter.note(1.1, 1)
        assert meter.rate_hz(2.0) > 0
        assert meter.rate_hz(2.2) == 0


class TestDrawing:
    def test_x_goes_right_and_y_up(self) -> None:
        canvas = drawn_way([(-1.0, -1.0)], 5, 10, 1.0, braille=False)
        assert canvas[4][0].character == "."
        canvas = drawn_way([(1.0, 1.0)], 5, 10, 1.0, braille=False)
        assert canvas[0][9].character == "."

    def test_every_dot_of_a_character_can_be_seen(self) -> None:
        def character(x: float, y: float) -> str:
            return drawn_way([(x, y)], 1, 2, 1.0)[0][0].character

        third = 1 / 3
        left = [character(-1.0, y) for y in (1.0, third, -third, -1.0)]
        right = [character(-third, y) for y in (1.0, third, -third, -1.0)]
        assert left == ["⠁", "⠂", "⠄", "⡀"]
        assert right == ["⠈", "⠐", "⠠", "⢀"]

    def test_points_far_apart_are_joined(self) -> None:
        (row,) = drawn_way([(-1.0, 0.0), (1.0, 0.0)], 1, 40, 10.0, braille=False)
        text = "".join(cell.character for cell in row).strip()
        assert len(text) >= 2
        assert set(text) <= {"."}

    def test_the_end_is_marked_once(self) -> None:
        way = [(math.cos(i / 10), math.sin(i / 10)) for i in range(63)]
        cells = [cell for row in drawn_way(way, 11, 22, 1.2) for cell in row]
        (end,) = (cell for cell in cells if cell.is_end)
        assert end.newest == 62

    @pytest.mark.parametrize("far", [1e9, math.inf, -math.inf, math.nan])
    def test_what_is_far_out_is_left_out(self, far: float) -> None:
        rows = drawn_way([(0.0, 0.0), (far, 0.0), (0.0, far)], 5, 10, 1.0)
        assert sum(cell.newest >= 0 for row in rows for cell in row) == 1
        assert not any(cell.newest >= 0 for row in drawn_way([], 5, 10, 1.0) for cell in row)


def state(*, flying_s: float | None = 61.2, notice: str = "") -> DemoState:
    count = 0 if flying_s is None else 1_234_567
    rows = tuple(
        TopicRow(
            name, "visualization_msgs.MarkerArray", 50.0, count, 220_100.0, ("quad_visualizer",)
        )
        for name in NAMES
    )
    way = [odometry(state_at(i * 0.02)).pose.position for i in range(150)]
    processes = ("master", "quad_simulator", "quad_visualizer", "demo_view")
    return DemoState(
        "127.0.0.1:50051",
        ".venv/bin/simple-ros",
        flying_s,
        notice,
        rows,
        None if flying_s is None else odometry(state_at(3.0)),
        () if flying_s is None else tuple(way),
        tuple(
            ProcessRow(name, 4_194_304 - i, "running", Usage(100.0, 123_000_000))
            for i, name in enumerate(processes)
        ),
    )


def printed(state: DemoState, columns: int, rows: int, *, braille: bool = True) -> list[str]:
    console = Console(width=columns, height=rows, force_terminal=True, color_system=None)
    with console.capture() as capture:
        console.print(screen(state, columns, rows, braille=braille), end="")
    return capture.get().splitlines()


class TestScreen:
    @pytest.mark.parametrize("size", [(80, 24), (80, 50), (110, 24), (200, 60)])
    @pytest.mark.parametrize("notice", ["", "port 50051 is taken, so this Master is elsewhere"])
    def test_it_fits_and_cuts_nothing_off(self, size: tuple[int, int], notice: str) -> None:
        columns, rows = size
        lines = printed(state(notice=notice), columns, rows)
        assert len(lines) == rows
        assert max(map(len, lines)) == columns
        text = "\n".join(lines)
        for word in (*NAMES, "1,234,567", "220.1 kB/s", "quad_visualizer", "4194301", "123 MB"):
            assert word in text
        for word in ("yaw", "deg/s", "export SIMPLE_ROS_MASTER=127.0.0.1:50051", "graph", notice):
            assert word in text
        assert "…" not in text
        assert text.count("●") == 1

    @pytest.mark.parametrize("size", [(20, 5), (1, 1), (79, 12), (500, 10)])
    def test_a_terminal_made_too_small_shows_what_it_can(self, size: tuple[int, int]) -> None:
        assert len(printed(state(), *size)) <= size[1]

    def test_plain_letters_where_braille_is_unknown(self) -> None:
        text = "\n".join(printed(state(), 80, 24, braille=False))
        assert not any("\u2800" <= letter <= "\u28ff" for letter in text)
        assert "....." in text

    def test_before_the_first_message(self) -> None:
        text = "\n".join(printed(state(flying_s=None), 80, 24))
        assert "starting" in text
        assert "not heard of yet" in text
        assert "●" not in text


def test_plain_line() -> None:
    assert plain_line(state()) == (
        " 61.2 s  quad_odometry 50.0 Hz, quad_marker_array 50.0 Hz, quad_path_short 50.0 Hz, "
        "quad_path_incremental 50.0 Hz; at +1.92 -0.56 +0.70 m, 4.00 m/s"
    )
    assert plain_line(state(flying_s=None)) == f"waiting for messages on {', '.join(NAMES)}"
