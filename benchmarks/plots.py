"""Plots of results as SVG: a row a peer, the best on top. Readable on light and dark pages. Pure but for `write`."""

from __future__ import annotations

import math
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

from simple_ros.benchmark.report import amount

WIDTH = 900
LABELS = 365
RIGHT = 90
ROW = 22
TOP = 58
BOTTOM = 44
LOG_FROM = 15.0
"""From this ratio of the largest to the smallest on, the scale is logarithmic and shows dots: bars would lie."""
STYLE = """
text { font: 13px system-ui, sans-serif; fill: #1f2328 }
.title { font-size: 15px; font-weight: 600 }
.small { font-size: 11px; fill: #59636e }
.page { fill: #ffffff }
.grid { stroke: #d8dee4 }
.range { stroke: #1f2328; stroke-width: 1.5 }
.ours { fill: #0969da } .limit { fill: #8c959f } .rival { fill: #bc4c00 }
@media (prefers-color-scheme: dark) {
text { fill: #e6edf3 } .small { fill: #9198a1 } .page { fill: #0d1117 } .grid { stroke: #30363d }
.range { stroke: #e6edf3 } .ours { fill: #4493f8 } .limit { fill: #6e7681 } .rival { fill: #db8a4a }
}
"""
LEGEND = (("ours", "simple_ros"), ("limit", "bare program"), ("rival", "other middleware"))


def plot(table: dict[str, Any], machine: str) -> str:
    """The SVG of one table; rows without a figure are left out."""
    rows = [row for row in table["peers"].values() if row["value"]]
    rows.sort(key=lambda row: row["value"]["median"], reverse=table["is_better_larger"])
    if not rows:
        return ""
    most = max(row["value"]["max"] for row in rows)
    least = min(row["value"]["min"] for row in rows)
    is_log = most / least > LOG_FROM
    low = 10 ** math.floor(math.log10(least)) if is_log else 0.0
    place = scale(low, most, is_log=is_log)
    height = TOP + ROW * len(rows) + BOTTOM
    ticks = log_ticks(low, most) if is_log else linear_ticks(most)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img">',
        f"<title>{escape(table['title'])}</title><style>{STYLE}</style>",
        f'<rect class="page" width="{WIDTH}" height="{height}" rx="6"/>',
        f'<text class="title" x="14" y="24">{escape(heading(table, is_log=is_log))}</text>',
        *legend(),
        *(axis(place(value), value, height) for value in ticks),
        *(
            part
            for index, row in enumerate(rows)
            for part in drawn(row, index, place, is_log=is_log)
        ),
        f'<text class="small" x="14" y="{height - 8}">{escape(machine)}</text>',
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def heading(table: dict[str, Any], *, is_log: bool) -> str:
    better = "more is better" if table["is_better_larger"] else "less is better"
    return f"{table['title']}: {table['unit']}, {better}{', logarithmic' if is_log else ''}"


def scale(low: float, most: float, *, is_log: bool) -> Callable[[float], float]:
    """From a figure to its x."""
    room = WIDTH - LABELS - RIGHT
    if is_log:
        decades = math.log10(most / low)
        return lambda value: LABELS + room * math.log10(value / low) / decades
    return lambda value: LABELS + room * value / most


def linear_ticks(most: float) -> list[float]:
    """Round figures from 0 on, four to eight of them."""
    step = 10 ** math.floor(math.log10(most))
    for part in (0.2, 0.5, 1.0):
        if most / (step * part) <= 7:
            step *= part
            break
    return [step * index for index in range(int(most / step) + 1)]


def log_ticks(low: float, most: float) -> list[float]:
    """The powers of ten."""
    return [low * 10**index for index in range(int(math.log10(most / low)) + 1)]


def axis(x: float, value: float, height: int) -> str:
    bottom = height - BOTTOM
    return (
        f'<line class="grid" x1="{x:.1f}" y1="{TOP - 6}" x2="{x:.1f}" y2="{bottom}"/>'
        f'<text class="small" x="{x:.1f}" y="{bottom + 14}" text-anchor="middle">{short(value)}</text>'
    )


def short(value: float) -> str:
    """A tick: 0, 50, 200k, 1.5M."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"


def legend() -> list[str]:
    parts = []
    for index, (group, name) in enumerate(LEGEND):
        x = 14 + 150 * index
        parts.append(f'<rect class="{group}" x="{x}" y="35" width="10" height="10" rx="2"/>')
        parts.append(f'<text class="small" x="{x + 15}" y="44">{name}</text>')
    return parts


def drawn(
    row: dict[str, Any], index: int, place: Callable[[float], float], *, is_log: bool
) -> list[str]:
    """A row: name, bar or dot, range over the rounds, median."""
    value, middle = row["value"], TOP + ROW * index + ROW / 2
    x, left, right = (place(value[key]) for key in ("median", "min", "max"))
    lost = f", lost {row['lost']:,}" if row["lost"] else ""
    name = escape(row["what"] + lost)
    weight = ' font-weight="600"' if row["group"] == "ours" else ""
    mark = (
        f'<circle class="{row["group"]}" cx="{x:.1f}" cy="{middle}" r="5.5"/>'
        if is_log
        else f'<rect class="{row["group"]}" x="{LABELS}" y="{middle - 7}" '
        f'width="{max(1.0, x - LABELS):.1f}" height="14" rx="2"/>'
    )
    line = f'<line class="range" x1="{left:.1f}" y1="{middle}" x2="{right:.1f}" y2="{middle}"/>'
    return [
        f'<text x="{LABELS - 10}" y="{middle + 4.5}" text-anchor="end"{weight}>{name}</text>',
        mark,
        line,
        f'<text class="small" x="{max(x, right) + 10:.1f}" y="{middle + 4}">{amount(value["median"])}</text>',
    ]


def write(document: dict[str, Any], directory: Path) -> list[Path]:
    """A file for each table; their paths."""
    directory.mkdir(parents=True, exist_ok=True)
    facts = document["machine"]
    machine = (
        f"{facts['cpu']}, {facts['cores']} cores, {facts['system'].split('-')[0]}, {facts['python']}; "
        f"medians, lines from least to most; rounds: {document['rounds']}"
    )
    written = []
    for name, table in document["tables"].items():
        text = plot(table, machine)
        if text:
            path = directory / f"{name}.svg"
            path.write_text(text)
            written.append(path)
    return written
