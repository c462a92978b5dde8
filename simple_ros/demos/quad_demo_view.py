"""How ``simple-ros demo`` looks: pure functions from what is known to a line or a screen."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.style import Style
from rich.table import Table
from rich.text import Text

from simple_ros.demos.drawing import drawn_way
from simple_ros.demos.observer import TopicRow
from simple_ros.demos.processes import Usage
from simple_ros.demos.quadrotor import euler_angles_rad
from simple_ros.msg.geometry_msgs import Odometry, Point

__all__ = ["DemoState", "ProcessRow", "plain_line", "screen"]

_REACH_M = 2.3
_TOPICS_WITH_TYPE_COLUMNS = 108
_LEFT_COLUMNS = 54
_FRAME = 4
"""Columns a panel takes to the sides of what is in it."""


@dataclass(frozen=True, slots=True)
class ProcessRow:
    """What is known about a process; no usage if it cannot be measured."""

    name: str
    pid: int
    state: str
    usage: Usage | None


@dataclass(frozen=True, slots=True)
class DemoState:
    """Everything there is to show.

    Attributes:
        master: ``host:port``.
        command: How ``simple-ros`` is called here.
        flying_s: Time since messages flow on all topics; None before.
        notice: Something the user should know, or empty.
        odometry: The newest message of ``quad_odometry``.
        way: The points of the newest message of ``quad_path_short``, oldest first.
        foxglove: Where apps connect to, or empty.
        app_link: What opens an app that does, or empty.
    """

    master: str
    command: str
    flying_s: float | None
    notice: str
    topics: tuple[TopicRow, ...]
    odometry: Odometry | None
    way: tuple[Point, ...]
    processes: tuple[ProcessRow, ...]
    foxglove: str = ""
    app_link: str = ""


def plain_line(state: DemoState) -> str:
    """All that matters on one line."""
    if state.flying_s is None:
        missing = ", ".join(topic.name for topic in state.topics if not topic.messages)
        return f"waiting for messages on {missing}"
    rates = ", ".join(f"{topic.name} {topic.rate_hz:.1f} Hz" for topic in state.topics)
    line = f"{state.flying_s:5.1f} s  {rates}"
    if state.odometry is not None:
        at = state.odometry.pose.position
        line += f"; at {at.x:+.2f} {at.y:+.2f} {at.z:+.2f} m, {_speed_m_s(state.odometry):.2f} m/s"
    return line


def screen(state: DemoState, columns: int, rows: int, *, braille: bool = True) -> RenderableType:
    """A whole terminal of that size; made for 80 x 24 and more.

    Args:
        state: What to show.
        columns: Characters in a line.
        rows: Lines.
        braille: Whether the terminal knows braille characters.
    """
    footer = _footer(state)
    topics_rows = len(state.topics) + 1 + 2
    middle_rows = max(5, rows - 1 - topics_rows - len(footer))
    drawing_rows = middle_rows - 2
    drawing_columns = max(8, min(2 * drawing_rows, columns - _LEFT_COLUMNS - _FRAME))
    middle = Layout(size=middle_rows)
    left = Layout()
    left.split_column(Layout(_quadrotor(state), size=6), Layout(_processes(state), minimum_size=7))
    right = Layout(
        _flight(state, drawing_rows, drawing_columns, braille=braille),
        size=drawing_columns + _FRAME,
    )
    middle.split_row(left, right)
    whole = Layout()
    whole.split_column(
        Layout(_header(state, columns), size=1),
        Layout(_topics(state, wide=columns >= _TOPICS_WITH_TYPE_COLUMNS), size=topics_rows),
        middle,
        Layout(Group(*footer), size=len(footer)),
    )
    return whole


def _header(state: DemoState, columns: int) -> RenderableType:
    running = "starting" if state.flying_s is None else f"flying for {state.flying_s:.0f} s"
    left, right = " simple_ros demo", f"{running}, Ctrl-C ends it "
    middle = f"  Master at {state.master}  ".center(max(0, columns - len(left) - len(right)))
    return Text(left + middle + right, style="bold reverse", no_wrap=True)


def _footer(state: DemoState) -> list[RenderableType]:
    lines: list[RenderableType] = [
        Text.assemble(
            (" In another terminal:  ", "dim"), f"export SIMPLE_ROS_MASTER={state.master}"
        ),
        Text.assemble(" " * 23, f"{state.command} graph --watch"),
    ]
    if state.notice:
        lines.insert(0, Text(f" {state.notice}", style="yellow", no_wrap=True, overflow="ellipsis"))
    return lines


def _topics(state: DemoState, *, wide: bool) -> RenderableType:
    table = _table()
    table.add_column("topic", style="cyan", min_width=21)
    if wide:
        table.add_column("type", style="dim", min_width=30)
    for title in ("rate", "messages", "bandwidth"):
        table.add_column(title, justify="right", min_width=10)
    table.add_column("  from", ratio=1)
    for topic in state.topics:
        cells = [topic.name, topic.msg_type] if wide else [topic.name]
        rate = f"{topic.rate_hz:.1f} Hz" if topic.messages else "-"
        bandwidth = f"{topic.bytes_per_s / 1000:.1f} kB/s" if topic.messages else "-"
        publishers = ", ".join(topic.publishers) or "nobody yet"
        table.add_row(*cells, rate, f"{topic.messages:,}", bandwidth, f"  {publishers}")
    where = Text(f"in Foxglove: {state.foxglove}, layout: {state.command} demo --layout")
    where.stylize(Style(link=state.app_link or None))
    return Panel(
        table,
        title="topics",
        title_align="left",
        subtitle=where if state.foxglove else None,
        subtitle_align="right",
        border_style="blue",
    )


def _quadrotor(state: DemoState) -> RenderableType:
    table = Table.grid(padding=(0, 1))
    table.add_column(style="dim", width=9)
    table.add_column()
    for label, text in _quadrotor_lines(state.odometry):
        table.add_row(label, text)
    return Panel(table, title="quadrotor", title_align="left", border_style="blue")


def _quadrotor_lines(odometry: Odometry | None) -> list[tuple[str, str]]:
    if odometry is None:
        return [("", "not heard of yet")]
    at, q = odometry.pose.position, odometry.pose.orientation
    turn = odometry.angular_velocity
    angles = euler_angles_rad((q.x, q.y, q.z, q.w))
    roll, pitch, yaw = (round(math.degrees(angle)) for angle in angles)
    rate = math.degrees(math.hypot(turn.x, turn.y, turn.z))
    return [
        ("position", f"x {at.x:+6.2f}   y {at.y:+6.2f}   z {at.z:+6.2f} m"),
        ("speed", f"{_speed_m_s(odometry):8.2f} m/s"),
        ("attitude", f"roll {roll:+4}  pitch {pitch:+4}  yaw {yaw:+4} deg"),
        ("turning", f"{rate:8.0f} deg/s"),
    ]


def _processes(state: DemoState) -> RenderableType:
    table = _table()
    table.add_column("process", ratio=1)
    table.add_column("pid", justify="right")
    table.add_column("state")
    table.add_column("CPU", justify="right", min_width=6)
    table.add_column("memory", justify="right", min_width=8)
    for row in state.processes:
        cpu, memory = ("-", "-") if row.usage is None else _usage_texts(row.usage)
        style = "green" if row.state == "running" else "red"
        table.add_row(row.name, str(row.pid), Text(row.state, style=style), cpu, memory)
    return Panel(table, title="processes", title_align="left", border_style="blue")


def _usage_texts(usage: Usage) -> tuple[str, str]:
    return f"{usage.cpu_percent:.0f} %", f"{usage.memory_bytes / 1e6:.0f} MB"


def _flight(state: DemoState, rows: int, columns: int, *, braille: bool) -> RenderableType:
    points = [(point.x, point.y) for point in state.way]
    canvas = drawn_way(points, rows, columns, _REACH_M, braille=braille)
    text = Text(no_wrap=True)
    for line in canvas:
        for cell in line:
            if cell.is_end:
                text.append("●" if braille else "o", style="bold bright_yellow")
            else:
                text.append(cell.character, style=_age_style(cell.newest, len(points)))
        text.append("\n")
    text.rstrip()
    subtitle = f"{2 * _REACH_M:.1f} m, x right, y up" if columns >= 22 else None
    return Panel(
        text,
        title="from above",
        title_align="left",
        subtitle=subtitle,
        subtitle_align="right",
        border_style="blue",
    )


def _age_style(newest: int, count: int) -> str:
    age = 1 - newest / max(1, count - 1)
    return "bright_red" if age < 1 / 3 else "red" if age < 2 / 3 else "dim red"


def _table() -> Table:
    return Table(box=None, expand=True, padding=(0, 1, 0, 0), pad_edge=False, header_style="dim")


def _speed_m_s(odometry: Odometry) -> float:
    velocity = odometry.linear_velocity
    return math.hypot(velocity.x, velocity.y, velocity.z)
