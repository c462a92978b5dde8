"""Why a transform cannot be given, by the names of tf2.

::

    TransformError                SimpleRosError
    ├── LookupException           LookupError   no such frame, or the tree is a loop
    ├── ConnectivityException     LookupError   the frames are not in one tree
    ├── ExtrapolationException    ValueError    the time lies outside of what is stored
    ├── InvalidArgument           ValueError    the question, or a transform, makes no sense
    └── TransformTimeout          TimeoutError  it did not become available in time
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from simple_ros.errors import SimpleRosError
from simple_ros.time import Time

__all__ = [
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgument",
    "LookupException",
    "TransformError",
    "TransformTimeout",
]


class TransformError(SimpleRosError):
    """Root of the errors of transforms."""


class InvalidArgument(TransformError, ValueError):
    """A question, or a transform that is to be stored, makes no sense.

    Attributes:
        reason: What is wrong.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


class LookupException(TransformError, LookupError):
    """There is no such frame, or following its parents leads in a circle.

    Attributes:
        frame: The frame asked for.
        known: The frames there are.
        loop: The frames of the circle; empty if the frame is unknown.
    """

    def __init__(self, frame: str, known: Iterable[str] = (), loop: tuple[str, ...] = ()) -> None:
        self.frame = frame
        self.known = tuple(sorted(known))
        self.loop = loop
        super().__init__(self._circle() if loop else self._unknown())

    def _circle(self) -> str:
        return (
            f"the frames {' -> '.join(self.loop)} form a circle; "
            "stop the broadcaster of one of these transforms"
        )

    def _unknown(self) -> str:
        if not self.known:
            return f"frame {self.frame!r} does not exist: no transform has come yet"
        near = get_close_matches(self.frame, self.known, n=3, cutoff=0.6)
        shown = ", ".join(map(repr, near or self.known[:8]))
        more = "" if near or len(self.known) <= 8 else f" and {len(self.known) - 8} more"
        hint = f"did you mean {shown}?" if near else f"there are {shown}{more}"
        return f"frame {self.frame!r} does not exist; {hint}"


class ConnectivityException(TransformError, LookupError):
    """Two frames are not in one tree.

    Attributes:
        target: Frame to transform to.
        source: Frame to transform from.
        target_root: Root of the target's tree.
        source_root: Root of the source's tree.
    """

    def __init__(self, target: str, source: str, target_root: str, source_root: str) -> None:
        self.target = target
        self.source = source
        self.target_root = target_root
        self.source_root = source_root
        super().__init__(
            f"{target!r} and {source!r} are not connected: {target!r} is in the tree of "
            f"{target_root!r}, {source!r} in that of {source_root!r}; "
            "a transform between the two trees is missing"
        )


class ExtrapolationException(TransformError, ValueError):
    """A time lies outside of what is stored for a frame.

    Attributes:
        parent: Parent of the frame, as last known.
        child: The frame whose transform is not known at that time.
        requested: The time asked for.
        earliest: The first time that is known.
        latest: The last time that is known.
    """

    def __init__(
        self, parent: str, child: str, requested: Time, earliest: Time, latest: Time
    ) -> None:
        self.parent = parent
        self.child = child
        self.requested = requested
        self.earliest = earliest
        self.latest = latest
        super().__init__(f"the transform from {parent!r} to {child!r} {self._where()}")

    def _where(self) -> str:
        requested = f"is needed at {self.requested}"
        known = f"known from {self.earliest} to {self.latest}"
        if self.earliest == self.latest:
            known = f"known at {self.latest} alone"
        if self.requested > self.latest:
            by = self.requested - self.latest
            return f"{requested}, {by} after the last; {known}; wait for it, or ask for the latest"
        by = self.earliest - self.requested
        return f"{requested}, {by} before the first; {known}; ask for a later time"


class TransformTimeout(TransformError, TimeoutError):
    """A transform did not become available in time.

    Attributes:
        timeout_s: How long was waited, in seconds.
        reason: Why it was not available at the end.
    """

    def __init__(self, timeout_s: float, reason: TransformError) -> None:
        self.timeout_s = timeout_s
        self.reason = reason
        super().__init__(f"not within {timeout_s:g} s: {reason}")
