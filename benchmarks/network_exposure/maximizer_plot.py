"""Training curves as SVG, as Fig. 14 of the paper shows them. Readable on light and dark pages.

`python benchmarks/network_exposure/maximizer_plot.py OUT.svg NAME=CURVE.json [...]` draws what the scripts in
examples/learning write with --curve: reward and entropy of the policy.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import dataclass
from html import escape
from pathlib import Path

WIDTH, PANEL, LEFT, RIGHT, TOP, BOTTOM = 900, 230, 70, 30, 58, 44
STYLE = """
text { font: 13px system-ui, sans-serif; fill: #1f2328 }
.title { font-size: 15px; font-weight: 600 } .small { font-size: 11px; fill: #59636e }
.page { fill: #ffffff } .grid { stroke: #d8dee4 } .level { stroke: #8c959f; stroke-dasharray: 5 4 }
.a { stroke: #0969da } .b { stroke: #bc4c00 } .line { fill: none; stroke-width: 2 }
.band { fill: #0969da; fill-opacity: 0.18 }
@media (prefers-color-scheme: dark) {
text { fill: #e6edf3 } .small { fill: #9198a1 } .page { fill: #0d1117 } .grid { stroke: #30363d }
.level { stroke: #6e7681 } .a { stroke: #4493f8 } .b { stroke: #db8a4a } .band { fill: #4493f8 }
}
"""
CLASSES = ("a", "b")


@dataclass(frozen=True)
class Series:
    """A line, with a band around it if there is one."""

    name: str
    xs: list[float]
    ys: list[float]
    lows: list[float] | None = None
    highs: list[float] | None = None


@dataclass(frozen=True)
class Panel:
    """One diagram: lines, and levels to compare them with."""

    title: str
    series: list[Series]
    levels: dict[str, float]


def svg(title: str, panels: list[Panel], x_title: str) -> str:
    """The whole picture, panels below each other."""
    height = TOP + len(panels) * (PANEL + BOTTOM)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img">',
        f"<title>{escape(title)}</title><style>{STYLE}</style>",
        f'<rect class="page" width="{WIDTH}" height="{height}" rx="6"/>',
        f'<text class="title" x="14" y="24">{escape(title)}</text>',
    ]
    names = [one.name for one in panels[0].series]
    for index, name in enumerate(names):
        x = LEFT + 230 * index
        parts.append(
            f'<path class="line {CLASSES[index % 2]}" d="M{x} 40h22"/>'
            f'<text class="small" x="{x + 28}" y="44">{escape(name)}</text>'
        )
    for index, panel in enumerate(panels):
        parts += drawn(panel, TOP + index * (PANEL + BOTTOM), x_title)
    return "\n".join([*parts, "</svg>"]) + "\n"


def drawn(panel: Panel, top: float, x_title: str) -> list[str]:
    """One diagram."""
    values = [
        value
        for one in panel.series
        for column in (one.ys, one.lows or [], one.highs or [])
        for value in column
    ]
    values = [value for value in (*values, *panel.levels.values()) if math.isfinite(value)]
    low, high = min(values), max(values)
    room = (high - low) * 0.08 or 1.0
    low, high = low - room, high + room
    most = max(max(one.xs) for one in panel.series)
    bottom = top + PANEL - 20

    def px(x: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * x / most

    def py(y: float) -> float:
        return bottom - (bottom - top - 20) * (y - low) / (high - low)

    parts = [f'<text class="small" x="{LEFT}" y="{top + 12}">{escape(panel.title)}</text>']
    parts += [tick_y(py(value), value) for value in ticks(low, high)]
    parts += [tick_x(px(value), value, bottom) for value in ticks(0.0, most)]
    for index, one in enumerate(panel.series):
        if one.lows and one.highs:
            way = [*zip(one.xs, one.highs, strict=True)]
            way += reversed([*zip(one.xs, one.lows, strict=True)])
            around = " ".join(f"{px(x):.1f},{py(y):.1f}" for x, y in way)
            parts.append(f'<polygon class="band" points="{around}"/>')
        pairs = [(x, y) for x, y in zip(one.xs, one.ys, strict=True) if math.isfinite(y)]
        points = " ".join(f"{px(x):.1f},{py(y):.1f}" for x, y in pairs)
        parts.append(f'<polyline class="line {CLASSES[index % 2]}" points="{points}"/>')
    for name, value in panel.levels.items():
        y = py(value)
        parts.append(
            f'<line class="level" x1="{LEFT}" y1="{y:.1f}" x2="{WIDTH - RIGHT}" y2="{y:.1f}"/>'
            f'<text class="small" x="{WIDTH - RIGHT - 4}" y="{y - 4:.1f}" text-anchor="end">'
            f"{escape(name)}</text>"
        )
    parts.append(
        f'<text class="small" x="{WIDTH - RIGHT}" y="{bottom + 32}" text-anchor="end">'
        f"{escape(x_title)}</text>"
    )
    return parts


def tick_y(y: float, value: float) -> str:
    return (
        f'<line class="grid" x1="{LEFT}" y1="{y:.1f}" x2="{WIDTH - RIGHT}" y2="{y:.1f}"/>'
        f'<text class="small" x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>'
    )


def tick_x(x: float, value: float, bottom: float) -> str:
    told = f"{value / 1000:g}k" if value >= 1000 else f"{value:g}"
    return f'<text class="small" x="{x:.1f}" y="{bottom + 16}" text-anchor="middle">{told}</text>'


def ticks(low: float, high: float) -> list[float]:
    """Round figures, about five."""
    step = 10 ** math.floor(math.log10((high - low) / 4))
    step *= next(part for part in (1, 2, 5, 10) if (high - low) / (step * part) <= 6)
    first = math.ceil(low / step)
    return [round(index * step, 9) for index in range(first, math.floor(high / step) + 1)]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("curves", nargs="+", help="NAME=FILE, at most two")
    options = parser.parse_args()
    read = {
        name: json.loads(Path(file).read_text())
        for name, _, file in (one.partition("=") for one in options.curves)
    }
    panels = [
        Panel(
            title,
            [
                Series(name, [p["decisions"] for p in points], [p[key] for p in points])
                for name, points in read.items()
            ],
            {},
        )
        for title, key in (
            ("mean reward of a decision", "reward"),
            ("entropy of the policy (nat): how random its decisions are", "entropy"),
        )
    ]
    text = svg("Training by PPO on simulated turtles", panels, "decisions of all topics together")
    options.out.write_text(text)


if __name__ == "__main__":
    main()
