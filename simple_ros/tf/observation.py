"""What was seen of a frame tree: rates, ages, and what is broken. Pure; times are in seconds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from simple_ros.msg.geometry_msgs import TransformStamped
from simple_ros.tf.core import BufferCore
from simple_ros.tf.errors import InvalidArgument
from simple_ros.time import Time

__all__ = ["Edge", "Observation", "Problem", "Row"]

_OLD_S = 1.0
_AHEAD_S = 0.1


@dataclass(frozen=True, slots=True)
class Edge:
    """How a frame was sent.

    Attributes:
        frame: Its name.
        parent: Its latest parent.
        is_static: Whether it was sent as static.
        count: Transforms that came.
        rate_hz: How many a second; None for static or fewer than two.
        age_s: How long ago its latest stamp is; None for static.
        delay_s: Mean of arrival minus stamp; None for static.
        max_delay_s: The largest of them; None for static.
        parents: All parents it had, the latest last.
    """

    frame: str
    parent: str
    is_static: bool
    count: int
    rate_hz: float | None
    age_s: float | None
    delay_s: float | None
    max_delay_s: float | None
    parents: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Problem:
    """Something about the tree that will make lookups fail or lie.

    Attributes:
        frame: The frame it is about; empty if it is about the whole.
        text: One line.
    """

    frame: str
    text: str


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the tree as it is drawn: a frame, and its place below the one before."""

    prefix: str
    frame: str
    edge: Edge | None


@dataclass(slots=True)
class _Seen:
    is_static: bool = False
    count: int = 0
    first_s: float = 0.0
    last_s: float = 0.0
    stamp_s: float = 0.0
    delay_sum_s: float = 0.0
    delay_max_s: float = float("-inf")
    parents: dict[str, None] = field(default_factory=dict)


class Observation:
    """Takes transforms as they arrive and tells what tree they make."""

    def __init__(self) -> None:
        self._seen: dict[str, _Seen] = {}
        self._refused: dict[str, str] = {}
        self._core = BufferCore()

    def receive(self, transform: TransformStamped, now_s: float, *, is_static: bool) -> None:
        """Take a transform that arrived at ``now_s``, on the clock of the stamps."""
        child = transform.child_frame_id.lstrip("/")
        try:
            self._core.set_transform(transform, is_static=is_static)
        except InvalidArgument as error:
            if len(self._refused) < 100:
                self._refused[child] = str(error)
            return
        seen = self._seen.setdefault(child, _Seen(first_s=now_s))
        parent = transform.header.frame_id.lstrip("/")
        seen.parents.pop(parent, None)
        seen.parents[parent] = None
        seen.is_static = is_static
        seen.count += 1
        seen.last_s = now_s
        if not is_static:
            stamp_s = Time.from_msg(transform.header.stamp).seconds
            delay_s = now_s - stamp_s
            seen.stamp_s = max(seen.stamp_s, stamp_s)
            seen.delay_sum_s += delay_s
            seen.delay_max_s = max(seen.delay_max_s, delay_s)

    def edges(self, now_s: float) -> tuple[Edge, ...]:
        """Every frame that has a parent, by name."""
        return tuple(_edge(frame, seen, now_s) for frame, seen in sorted(self._seen.items()))

    def roots(self) -> tuple[str, ...]:
        """Frames without a parent, sorted: one for each tree."""
        return tuple(sorted(self._parents().keys() - self._seen.keys()))

    def rows(self, now_s: float) -> tuple[Row, ...]:
        """The trees, line by line; circles come last, each frame once."""
        edges = {edge.frame: edge for edge in self.edges(now_s)}
        children = self._parents()
        rows: list[Row] = []
        drawn: set[str] = set()
        for root in (*self.roots(), *sorted(edges)):
            if root not in drawn:
                rows += _below(root, edges, children, drawn)
        return tuple(rows)

    def problems(self, now_s: float) -> tuple[Problem, ...]:
        """What is broken."""
        found = [Problem(frame, text) for frame, text in sorted(self._refused.items())]
        roots = self.roots()
        if len(roots) > 1:
            found.append(
                Problem("", f"there are {len(roots)} trees, with the roots {_list(roots)}")
            )
        found += [Problem(circle[0], _circle_text(circle)) for circle in self._circles()]
        for edge in self.edges(now_s):
            found += _edge_problems(edge)
        return tuple(found)

    def _parents(self) -> dict[str, list[str]]:
        """The children of every frame that has some."""
        children: dict[str, list[str]] = {}
        for frame, seen in sorted(self._seen.items()):
            children.setdefault(_latest(seen), []).append(frame)
        return children

    def _circles(self) -> Iterator[tuple[str, ...]]:
        done: set[str] = set()
        for start in sorted(self._seen):
            way: list[str] = []
            frame = start
            while frame in self._seen and frame not in done:
                done.add(frame)
                way.append(frame)
                frame = _latest(self._seen[frame])
            if frame in way:
                yield (*way[way.index(frame) :], frame)


def _latest(seen: _Seen) -> str:
    return next(reversed(seen.parents))


def _edge(frame: str, seen: _Seen, now_s: float) -> Edge:
    moves = not seen.is_static
    spanned_s = seen.last_s - seen.first_s
    return Edge(
        frame,
        _latest(seen),
        seen.is_static,
        seen.count,
        (seen.count - 1) / spanned_s if moves and seen.count > 1 and spanned_s > 0 else None,
        now_s - seen.stamp_s if moves else None,
        seen.delay_sum_s / seen.count if moves else None,
        seen.delay_max_s if moves else None,
        tuple(seen.parents),
    )


def _below(
    root: str, edges: dict[str, Edge], children: dict[str, list[str]], drawn: set[str]
) -> Iterator[Row]:
    # A stack, as deep trees would be too deep for recursion.
    todo = [(root, "", "")]
    while todo:
        frame, prefix, indent = todo.pop()
        yield Row(prefix, frame, edges.get(frame))
        drawn.add(frame)
        below = [child for child in children.get(frame, ()) if child not in drawn]
        for number, child in enumerate(reversed(below)):
            last = number == 0
            todo.append(
                (child, indent + ("└─ " if last else "├─ "), indent + ("   " if last else "│  "))
            )


def _edge_problems(edge: Edge) -> Iterator[Problem]:
    if len(edge.parents) > 1:
        yield Problem(
            edge.frame,
            f"{edge.frame!r} is sent with the parents {_list(edge.parents)}; "
            "two programs may send it",
        )
    if edge.age_s is not None and edge.age_s > _OLD_S:
        yield Problem(
            edge.frame, f"{edge.frame!r} is old: its last stamp is {edge.age_s:.1f} s ago"
        )
    if edge.age_s is not None and edge.age_s < -_AHEAD_S:
        yield Problem(
            edge.frame,
            f"{edge.frame!r} is stamped {-edge.age_s:.1f} s ahead of the time here; "
            "do the clocks agree?",
        )


def _circle_text(circle: tuple[str, ...]) -> str:
    return f"the frames {' -> '.join(circle)} form a circle"


def _list(names: Iterable[str]) -> str:
    return ", ".join(map(repr, names))
