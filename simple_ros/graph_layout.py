"""Places for the vertices of a drawing, in layers from left to right.

The method of Sugiyama, Tagawa and Toda ("Methods for visual understanding of hierarchical system
structures", 1981) in its plainest form. Arrows that would close a cycle are set aside; each vertex goes
one layer to the right of what points at it; within a layer, sweeps of barycentres put neighbours at
about the same height. Where everything is linked with everything that would give one long thread, so
layers then are distances from the sources instead. A layer too high for the drawing is folded into
several columns. Arrows are curves that may pass behind vertices, so no place is spent on them. The same
input always gives the same drawing, and no two vertices overlap.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

__all__ = ["Box", "Layout", "layered"]

Links = Mapping[str, Sequence[str]]

_SWEEPS = 6
_WIDTH_TO_HEIGHT = 1.6
_MIN_ROWS = 12
_LAYERS_AT_LEAST = 6


@dataclass(frozen=True, slots=True)
class Box:
    """Where a vertex is drawn: its left upper corner and its size, in pixels."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Layout:
    """A place for each vertex, and the size of the whole drawing in pixels."""

    boxes: Mapping[str, Box]
    width: float
    height: float


def layered(
    sizes: Mapping[str, tuple[float, float]],
    arrows: Sequence[tuple[str, str]],
    *,
    layer_gap: float = 90.0,
    gap: float = 14.0,
) -> Layout:
    """Give each vertex a place.

    Args:
        sizes: Width and height of each vertex in pixels; their order decides where nothing else does.
        arrows: Pairs of vertices, source first.
        layer_gap: Pixels between two layers.
        gap: Pixels between two vertices, and between two columns of a folded layer.
    """
    names = list(sizes)
    forward = _without_cycles(names, arrows)
    layers = _layers(names, forward)
    if len(layers) > _LAYERS_AT_LEAST + 2 * math.sqrt(len(names)):
        layers = _distances(names, arrows)
    layers = _in_order(layers, forward)
    rows = _rows(layers, sizes, gap)
    columns = [
        [layer[start : start + rows] for start in range(0, len(layer), rows)] for layer in layers
    ]
    return _placed(columns, sizes, layer_gap, gap)


def _links(pairs: Sequence[tuple[str, str]]) -> Links:
    found = defaultdict(list)
    for src, dst in pairs:
        found[src].append(dst)
    return found


def _sources(names: Sequence[str], arrows: Sequence[tuple[str, str]]) -> list[str]:
    entered = {dst for src, dst in arrows if src != dst}
    return [name for name in names if name not in entered]


def _without_cycles(
    names: Sequence[str], arrows: Sequence[tuple[str, str]]
) -> list[tuple[str, str]]:
    """The arrows without those that lead back to where a depth-first walk came from."""
    after = _links(arrows)
    open_now: set[str] = set()
    done: set[str] = set()
    kept: list[tuple[str, str]] = []
    for start in (*_sources(names, arrows), *names):
        walk = [] if start in done else [(start, iter(after.get(start, ())))]
        open_now.update(name for name, _ in walk)
        while walk:
            name, further = walk[-1]
            following = next(further, None)
            if following is None:
                walk.pop()
                open_now.discard(name)
                done.add(name)
            elif following not in open_now:
                kept.append((name, following))
                if following not in done:
                    open_now.add(following)
                    walk.append((following, iter(after.get(following, ()))))
    return kept


def _layers(names: Sequence[str], forward: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Vertices by layer: right of all that point at them, sources as far right as they may."""
    after, before = _links(forward), _links([(dst, src) for src, dst in forward])
    depth: dict[str, int] = {}
    waiting = {name: len(before.get(name, ())) for name in names}
    ready = [name for name in names if not waiting[name]]
    for name in ready:  # grows while it is walked
        depth[name] = 1 + max((depth[other] for other in before.get(name, ())), default=-1)
        for other in after.get(name, ()):
            waiting[other] -= 1
            if not waiting[other]:
                ready.append(other)
    for name in names:
        if not before.get(name) and after.get(name):
            depth[name] = min(depth[other] for other in after[name]) - 1
    return _by_depth(names, depth)


def _distances(names: Sequence[str], arrows: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Vertices by the number of arrows from the nearest source."""
    after = _links(arrows)
    depth: dict[str, int] = {}
    for starts in (_sources(names, arrows), *([name] for name in names)):
        reached = [name for name in starts if name not in depth]
        depth |= dict.fromkeys(reached, 0)
        for name in reached:  # grows while it is walked
            for other in after.get(name, ()):
                if other not in depth:
                    depth[other] = depth[name] + 1
                    reached.append(other)
    return _by_depth(names, depth)


def _by_depth(names: Sequence[str], depth: Mapping[str, int]) -> list[list[str]]:
    layers: list[list[str]] = [[] for _ in range(1 + max(depth.values(), default=-1))]
    for name in names:
        layers[depth[name]].append(name)
    return layers


def _in_order(layers: list[list[str]], forward: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Layers sorted by where the neighbours of each vertex are, from both sides in turns."""
    after, before = _links(forward), _links([(dst, src) for src, dst in forward])
    height = {
        name: (index + 0.5) / len(layer) for layer in layers for index, name in enumerate(layer)
    }

    def barycentre(name: str, links: Links) -> float:
        others = links.get(name)
        return fmean(height[other] for other in others) if others else height[name]

    for sweep in range(_SWEEPS):
        links, sweeping = (before, layers) if sweep % 2 == 0 else (after, layers[::-1])
        for layer in sweeping:
            centres = {name: barycentre(name, links) for name in layer}
            layer.sort(key=centres.__getitem__)
            height |= {name: (index + 0.5) / len(layer) for index, name in enumerate(layer)}
    return layers


def _rows(
    layers: Sequence[Sequence[str]], sizes: Mapping[str, tuple[float, float]], gap: float
) -> int:
    """How many vertices a column may have, so that the drawing is about as wide as a screen."""
    highest = max(map(len, layers), default=0)
    if highest <= _MIN_ROWS:
        return max(1, highest)
    mean_width = fmean(width for width, _ in sizes.values()) + gap
    mean_height = fmean(height for _, height in sizes.values()) + gap
    area = len(sizes) * mean_width * mean_height
    fitting = math.sqrt(area / _WIDTH_TO_HEIGHT) / mean_height
    return max(_MIN_ROWS, math.ceil(fitting))


def _placed(
    columns: Sequence[Sequence[Sequence[str]]],
    sizes: Mapping[str, tuple[float, float]],
    layer_gap: float,
    gap: float,
) -> Layout:
    """Boxes column by column, each centred in the height of the whole."""

    def high(column: Sequence[str]) -> float:
        return sum(sizes[name][1] for name in column) + gap * (len(column) - 1)

    total = max((high(column) for layer in columns for column in layer), default=0.0)
    boxes: dict[str, Box] = {}
    x = 0.0
    for layer in columns:
        for column in layer:
            width = max(sizes[name][0] for name in column)
            y = (total - high(column)) / 2
            for name in column:
                own_width, own_height = sizes[name]
                boxes[name] = Box(x + (width - own_width) / 2, y, own_width, own_height)
                y += own_height + gap
            x += width + gap
        x += layer_gap - gap
    return Layout(boxes, max(0.0, x - layer_gap), total)
