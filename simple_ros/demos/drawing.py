"""A way seen from above, drawn with characters: pure.

Braille characters are two dots wide and four high, so a terminal gets eight dots where it has one
letter, about as far apart sideways as up and down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

__all__ = ["Cell", "drawn_way"]

_BRAILLE = 0x2800
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""The bit of a dot, by row and column in its character."""


@dataclass(slots=True)
class Cell:
    """One character of a drawing.

    Attributes:
        character: What to print; a space where the way does not lead.
        newest: Position in the way of its newest point here; -1 where it does not lead.
        is_end: Whether the way ends here.
    """

    character: str = " "
    newest: int = -1
    is_end: bool = False


def drawn_way(
    points_m: Sequence[tuple[float, float]],
    rows: int,
    columns: int,
    reach_m: float,
    *,
    braille: bool = True,
) -> list[list[Cell]]:
    """A way as rows of cells, top row first; x grows to the right, y up.

    Args:
        points_m: x and y, oldest first, joined by straight lines; what is more than twice as
            far out as fits is left out.
        rows: Lines of the drawing.
        columns: Characters in each.
        reach_m: What must fit, from the origin in the middle to each side.
        braille: Eight dots per character; else one ``.``.
    """
    canvas = [[Cell() for _ in range(columns)] for _ in range(rows)]
    high, wide = 4 * rows, 2 * columns
    dots_per_m = (min(high, wide) - 1) / (2 * reach_m)
    dots = [
        (index, (wide - 1) / 2 + x * dots_per_m, (high - 1) / 2 - y * dots_per_m)
        for index, (x, y) in enumerate(points_m)
        if abs(x) <= 2 * reach_m and abs(y) <= 2 * reach_m
    ]
    cell = Cell()
    for index, across, down in _joined(dots):
        if 0 <= across < wide and 0 <= down < high:
            cell = canvas[down // 4][across // 2]
            cell.newest = index
            cell.character = _with_dot(cell.character, across, down) if braille else "."
    cell.is_end = True
    return canvas


def _joined(dots: Sequence[tuple[int, float, float]]) -> Iterator[tuple[int, int, int]]:
    """Every dot on the way, each with the index of the point it leads to."""
    for index, x, y in dots[:1]:
        yield index, round(x), round(y)
    for (_, from_x, from_y), (index, to_x, to_y) in pairwise(dots):
        steps = max(1, round(max(abs(to_x - from_x), abs(to_y - from_y))))
        for step in range(1, steps + 1):
            part = step / steps
            yield (
                index,
                round(from_x + part * (to_x - from_x)),
                round(from_y + part * (to_y - from_y)),
            )


def _with_dot(character: str, across: int, down: int) -> str:
    before = _BRAILLE if character == " " else ord(character)
    return chr(before | _DOTS[down % 4][across % 2])
