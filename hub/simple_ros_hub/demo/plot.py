"""The plot of both runs, one above the other by where the robot was: an SVG. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

__all__ = ["Second", "plot", "runs_of"]

_WIDTH, _HEIGHT, _LEFT, _GAP = 860, 130, 60, 46
_STYLE = """
text { font: 13px system-ui, sans-serif; fill: #1f2328 } .small { font-size: 11px; fill: #59636e }
.title { font-size: 15px; font-weight: 600 } .page { fill: #fff } .grid { stroke: #d8dee4 }
.zone { fill: #8882 }
path { fill: none; stroke-width: 2 } .off { stroke: #bc4c00; fill: #bc4c00 } .on { stroke: #0969da; fill: #0969da }
path.off, path.on { fill: none } text.off, text.on { stroke: none }
@media (prefers-color-scheme: dark) {
text { fill: #e6edf3 } .small { fill: #9198a1 } .page { fill: #0d1117 } .grid { stroke: #30363d }
.off { stroke: #db8a4a; fill: #db8a4a } .on { stroke: #4493f8; fill: #4493f8 } }
"""


@dataclass(frozen=True, slots=True)
class Second:
    """What one second brought.

    Attributes:
        time_s: When, since the epoch.
        laps: Rounds driven.
        engines: Whether they were on.
        pose_age_ms: 95th percentile of the age of poses at the operator; None if none came.
        pictures_hz: Pictures that came within 0.5 s.
        lost_percent: Of all messages, those that were late, dropped, lost or too old to be sent.
        sensor_mbps: Pictures and points that came.
    """

    time_s: float
    laps: float
    engines: bool
    pose_age_ms: float | None
    pictures_hz: float
    lost_percent: float
    sensor_mbps: float


def runs_of(seconds: Sequence[Second]) -> dict[bool, list[Second]]:
    """The newest round, as far as it was driven, without engines (False) and with them (True)."""
    found: dict[bool, list[Second]] = {}
    for is_on in (False, True):
        laps = [math.floor(item.laps) for item in seconds if item.engines is is_on]
        # A round that has only just begun shows less than the whole one before.
        counts = {lap: laps.count(lap) for lap in laps}
        full = [lap for lap, count in counts.items() if 2 * count >= max(counts.values())]
        newest = max(full, default=-1)
        found[is_on] = [s for s in seconds if s.engines is is_on and math.floor(s.laps) == newest]
    return found


def plot(seconds: Sequence[Second], dead_zone: tuple[float, float]) -> str:
    """The SVG.

    Args:
        seconds: All there are, in order.
        dead_zone: Between which shares of a round little arrives.
    """
    runs = runs_of(seconds)
    panels: list[tuple[str, Callable[[Second], float | None], bool]] = [
        ("Age of the robot's pose at the operator, 95th percentile (ms)", _age, True),
        ("Messages that did not come in time (%)", lambda s: s.lost_percent, False),
        ("Pictures in time (1/s)", lambda s: s.pictures_hz, False),
        ("Pictures and points (Mbit/s)", lambda s: s.sensor_mbps, False),
    ]
    height = 50 + len(panels) * (_HEIGHT + _GAP)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH + _LEFT + 20} {height}">',
        f"<style>{_STYLE}</style>",
        f'<rect class="page" width="{_WIDTH + _LEFT + 20}" height="{height}"/>',
        f'<text class="title" x="{_LEFT}" y="22">One round with 30 % of the radio, simulated</text>',
        f'<text class="off" x="{_LEFT + 420}" y="22">engines off</text>',
        f'<text class="on" x="{_LEFT + 540}" y="22">engines on</text>',
    ]
    begin, end = (_LEFT + _WIDTH * share for share in dead_zone)
    parts += [
        f'<rect class="zone" x="{begin:.1f}" y="40" width="{end - begin:.1f}" height="{height - 50}"/>',
        f'<text class="small" x="{begin + 4:.1f}" y="{height - 14}">dead zone</text>',
    ]
    for index, (title, value, is_log) in enumerate(panels):
        parts += _panel(runs, title, value, 50 + index * (_HEIGHT + _GAP), is_log=is_log)
    return "\n".join([*parts, "</svg>", ""])


def _age(second: Second) -> float | None:
    return second.pose_age_ms


def _panel(
    runs: dict[bool, list[Second]],
    title: str,
    value: Callable[[Second], float | None],
    top: float,
    *,
    is_log: bool,
) -> list[str]:
    values = [v for run in runs.values() for s in run if (v := value(s)) is not None]
    most = _rounded_up(max([*values, 1.0]))
    low = math.floor(math.log10(max(1.0, min(values, default=1.0)))) if is_log else 0
    high = max(low + 1, math.ceil(math.log10(most))) if is_log else most

    def y(number: float) -> float:
        part = math.log10(max(number, 1.0)) if is_log else number
        return top + 14 + _HEIGHT * (1 - (min(max(part, low), high) - low) / (high - low))

    marks = [10.0**power for power in range(int(low), int(high) + 1)] if is_log else [0.0, most]
    parts = [f'<text x="{_LEFT}" y="{top + 6}">{escape(title)}</text>']
    for mark in marks:
        at = f'y1="{y(mark):.1f}" y2="{y(mark):.1f}"'
        parts.append(f'<line class="grid" x1="{_LEFT}" x2="{_LEFT + _WIDTH}" {at}/>')
        parts.append(f'<text class="small" x="4" y="{y(mark) + 4:.1f}">{mark:g}</text>')
    for is_on, run in runs.items():
        parts.append(f'<path class="{"on" if is_on else "off"}" d="{_line(run, value, y)}"/>')
    return parts


def _rounded_up(number: float) -> float:
    """1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(number))
    return next(step * power for step in (1, 2, 5, 10) if number <= step * power * (1 + 1e-9))


def _line(
    run: Sequence[Second], value: Callable[[Second], float | None], y: Callable[[float], float]
) -> str:
    """A line through the round, broken where nothing came."""
    words, pen = [], "M"
    for second in run:
        number = value(second)
        if number is None:
            pen = "M"
            continue
        words.append(f"{pen}{_LEFT + _WIDTH * (second.laps % 1):.1f} {y(number):.1f}")
        pen = "L"
    return " ".join(words)
