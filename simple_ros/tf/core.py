"""The tree of frames over time, by the rules of tf2: pure, no clock, no locks.

A stored transform says where a child frame stands in its parent. A frame has one parent at a time and
may get another one. What is looked up maps coordinates of the *source* frame to those of the *target*
frame. Time 0, or none, means the latest time at which every transform between the two is known.
"""

from __future__ import annotations

from typing import NamedTuple

from simple_ros.msg.geometry_msgs import TransformStamped
from simple_ros.tf.cache import FrameCache, OutsideCache, StaticCache, TimeCache
from simple_ros.tf.checks import checked
from simple_ros.tf.errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgument,
    LookupException,
    TransformError,
)
from simple_ros.tf.rigid import IDENTITY, Rigid, to_message
from simple_ros.time import Duration, Time

__all__ = ["DEFAULT_CACHE", "BufferCore", "FrameFacts"]

DEFAULT_CACHE = Duration.of(10)


class FrameFacts(NamedTuple):
    """What is known of a frame now.

    Attributes:
        frame: Its name.
        parent: Its latest parent.
        is_static: Whether it was sent as static.
        earliest: First stored time; None if static.
        latest: Last stored time; None if static.
        authority: Who sent the latest transform, if known.
    """

    frame: str
    parent: str
    is_static: bool
    earliest: Time | None
    latest: Time | None
    authority: str


class _Step(NamedTuple):
    """A frame on the way up, and what maps coordinates of the start to it."""

    frame: str
    rigid: Rigid


class _Way(NamedTuple):
    """The way from a frame up to its root, or to where the time is not known any more."""

    steps: list[_Step]
    broken: ExtrapolationException | None

    @property
    def top(self) -> str:
        return self.steps[-1].frame


class BufferCore:
    """Transforms of the last seconds, and answers about them.

    Args:
        cache_time: How long a transform is kept after a newer one came.

    Raises:
        InvalidArgument: The cache time is not positive.
    """

    def __init__(self, cache_time: Duration = DEFAULT_CACHE) -> None:
        if cache_time <= Duration():
            raise InvalidArgument(f"the cache time is more than 0, not {cache_time}")
        self.cache_time = cache_time
        self._caches: dict[str, FrameCache] = {}
        self._parents: set[str] = set()

    # -- storing -------------------------------------------------------------------------------

    def set_transform(
        self, transform: TransformStamped, authority: str = "", *, is_static: bool = False
    ) -> bool:
        """Store a transform.

        Args:
            transform: Leading slashes of frame names are dropped.
            authority: Who says so.
            is_static: It holds for all times; its stamp means nothing.

        Returns:
            False if it was left out: older than the cache reaches, or its stamp is there already.

        Raises:
            InvalidArgument: A name is missing, parent and child are one, a number is not finite, the
                rotation is not of length 1 (by more than 1 %), or the stamp is negative.
        """
        child, entry = checked(transform, authority)
        cache = self._caches.get(child)
        if cache is None or cache.is_static is not is_static:
            cache = StaticCache() if is_static else TimeCache(self.cache_time.nanoseconds)
        if not cache.insert(entry):
            return False
        self._caches[child] = cache
        self._parents.add(entry.parent)
        return True

    def clear(self) -> None:
        """Forget all but static transforms."""
        for cache in self._caches.values():
            cache.clear()

    # -- what there is -------------------------------------------------------------------------

    def frames(self) -> tuple[str, ...]:
        """Names of all frames, sorted."""
        return tuple(sorted(self._caches.keys() | self._parents))

    def has_frame(self, frame: str) -> bool:
        """Whether a transform named the frame."""
        return frame in self._caches or frame in self._parents

    def facts(self) -> tuple[FrameFacts, ...]:
        """What is known of every frame that has a parent, by name."""
        found = []
        for frame, cache in sorted(self._caches.items()):
            latest = cache.latest
            if latest is not None:
                span = cache.span_ns if isinstance(cache, TimeCache) else None
                earliest, last = (Time(span[0]), Time(span[1])) if span else (None, None)
                found.append(
                    FrameFacts(
                        frame, latest.parent, cache.is_static, earliest, last, latest.authority
                    )
                )
        return tuple(found)

    # -- looking up ----------------------------------------------------------------------------

    def lookup_transform(
        self, target: str, source: str, time: Time | None = None
    ) -> TransformStamped:
        """What maps coordinates of the source frame to the target frame: the source's pose in it.

        Args:
            target: Frame to transform to.
            source: Frame to transform from.
            time: When; None or 0 is the latest time that is known all the way.

        Returns:
            ``header.frame_id`` is the target, ``child_frame_id`` the source, the stamp that time (0 if
            all the way is static).

        Raises:
            LookupException: There is no such frame, or the parents form a circle.
            ConnectivityException: The frames are not in one tree.
            ExtrapolationException: The time lies outside of what is stored.
            InvalidArgument: A name is empty or begins with a slash.
        """
        self._check_frames(target, source)
        stamp_ns = time.nanoseconds if time else self._latest_common_ns(target, source)
        return _answer(target, source, stamp_ns, self._between(target, source, stamp_ns))

    def lookup_transform_full(
        self,
        target: str,
        target_time: Time | None,
        source: str,
        source_time: Time | None,
        fixed: str,
    ) -> TransformStamped:
        """As `lookup_transform`, from the source at one time to the target at another.

        In between, things are taken to stand still in the frame ``fixed``. Raises as
        `lookup_transform`. The stamp of the answer is the target's time.
        """
        self._check_frames(target, source, fixed)
        source_ns = (
            source_time.nanoseconds if source_time else self._latest_common_ns(fixed, source)
        )
        target_ns = (
            target_time.nanoseconds if target_time else self._latest_common_ns(target, fixed)
        )
        first = self._between(fixed, source, source_ns)
        second = self._between(target, fixed, target_ns)
        return _answer(target, source, target_ns, second.after(first))

    def can_transform(self, target: str, source: str, time: Time | None = None) -> bool:
        """Whether `lookup_transform` would answer."""
        return self.why_not(target, source, time) is None

    def why_not(self, target: str, source: str, time: Time | None = None) -> TransformError | None:
        """The error that `lookup_transform` would raise."""
        try:
            self.lookup_transform(target, source, time)
        except TransformError as error:
            return error
        return None

    def latest_common_time(self, target: str, source: str) -> Time:
        """The latest time at which all the way between two frames is known; 0 if it is static.

        Raises as `lookup_transform`.
        """
        self._check_frames(target, source)
        return Time(self._latest_common_ns(target, source))

    def path(self, target: str, source: str) -> tuple[str, ...]:
        """The frames from source to target, both included, as they are connected now.

        Raises as `lookup_transform`.
        """
        self._check_frames(target, source)
        up, down = self._chain(source), self._chain(target)
        common = self._common(target, source, up, down)
        return tuple(up[: up.index(common) + 1] + down[: down.index(common)][::-1])

    def _check_frames(self, *frames: str) -> None:
        for frame in frames:
            if not frame:
                raise InvalidArgument("a frame name is empty")
            if frame.startswith("/"):
                raise InvalidArgument(f"frame {frame!r}: names of frames begin with no slash")
            if not self.has_frame(frame):
                raise LookupException(frame, self.frames())

    def _chain(self, frame: str) -> list[str]:
        """A frame and its ancestors, by their latest parents."""
        chain = [frame]
        seen = {frame}
        while (cache := self._caches.get(chain[-1])) is not None and cache.latest is not None:
            parent = cache.latest.parent
            if parent in seen:
                raise LookupException(frame, loop=(*chain[chain.index(parent) :], parent))
            seen.add(parent)
            chain.append(parent)
        return chain

    def _common(self, target: str, source: str, up: list[str], down: list[str]) -> str:
        below = set(down)
        for frame in up:
            if frame in below:
                return frame
        raise ConnectivityException(target, source, down[-1], up[-1])

    def _latest_common_ns(self, target: str, source: str) -> int:
        if target == source:
            own = self._caches.get(target)
            return own.latest.stamp_ns if own and own.latest and not own.is_static else 0
        up, down = self._chain(source), self._chain(target)
        common = self._common(target, source, up, down)
        stamps = []
        for frame in up[: up.index(common)] + down[: down.index(common)]:
            cache = self._caches[frame]
            if not cache.is_static and cache.latest is not None:
                stamps.append(cache.latest.stamp_ns)
        return min(stamps, default=0)

    def _between(self, target: str, source: str, stamp_ns: int) -> Rigid:
        if target == source:
            return IDENTITY
        up = self._way(source, stamp_ns, stop=target)
        if up.top == target:
            return up.steps[-1].rigid
        down = self._way(target, stamp_ns, stop=source)
        above_target = {step.frame: step.rigid for step in down.steps}
        for frame, rigid in up.steps:
            if frame in above_target:
                return above_target[frame].inverse().after(rigid)
        broken = up.broken or down.broken
        if broken is not None:
            # Raised from where the frames may well be connected at another time.
            self._common(target, source, self._chain(source), self._chain(target))
            raise broken
        raise ConnectivityException(target, source, down.top, up.top)

    def _way(self, frame: str, stamp_ns: int, stop: str) -> _Way:
        """Up from a frame at a time, to its root, to ``stop``, or as far as that time is known."""
        steps = [_Step(frame, IDENTITY)]
        seen = {frame}
        while (cache := self._caches.get(steps[-1].frame)) is not None and steps[-1].frame != stop:
            below = steps[-1]
            try:
                entry = cache.at(stamp_ns)
            except OutsideCache:
                return _Way(steps, self._outside(below.frame, cache, stamp_ns))
            if entry.parent in seen:
                raise LookupException(frame, loop=(*(step.frame for step in steps), entry.parent))
            seen.add(entry.parent)
            steps.append(_Step(entry.parent, entry.rigid.after(below.rigid)))
        return _Way(steps, None)

    def _outside(
        self, child: str, cache: FrameCache, stamp_ns: int
    ) -> ExtrapolationException | None:
        latest = cache.latest
        if latest is None or not isinstance(cache, TimeCache) or cache.span_ns is None:
            return None  # cleared: as if it had no parent
        first, last = cache.span_ns
        return ExtrapolationException(latest.parent, child, Time(stamp_ns), Time(first), Time(last))


def _answer(target: str, source: str, stamp_ns: int, rigid: Rigid) -> TransformStamped:
    answer = TransformStamped(child_frame_id=source, transform=to_message(rigid))
    answer.header.frame_id = target
    answer.header.stamp.CopyFrom(Time(stamp_ns).to_msg())
    return answer
