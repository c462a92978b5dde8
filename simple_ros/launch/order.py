"""Start order: whether it is possible. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from graphlib import CycleError, TopologicalSorter

__all__ = ["circle"]


def circle(after: Mapping[str, Sequence[str]]) -> list[str]:
    """Names each of which waits for the next and the last for the first; empty if there is none.

    Args:
        after: For each name, those it waits for.
    """
    try:
        TopologicalSorter(after).prepare()
    except CycleError as error:
        names: list[str] = error.args[1]
        return names[:0:-1]
    return []
