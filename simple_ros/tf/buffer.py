"""A `BufferCore` that threads and event loops share, and that can be waited on."""

from __future__ import annotations

import asyncio
import threading
import time as clocks
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from simple_ros.msg.geometry_msgs import TransformStamped
from simple_ros.tf.apply import do_transform
from simple_ros.tf.core import DEFAULT_CACHE, BufferCore, FrameFacts
from simple_ros.tf.errors import InvalidArgument, TransformError, TransformTimeout
from simple_ros.time import Duration, Time

if TYPE_CHECKING:
    from simple_ros.msg.std_msgs import Header

__all__ = ["Buffer"]


class _Stamped(Protocol):
    @property
    def header(self) -> Header: ...


StampedT = TypeVar("StampedT", bound=_Stamped)


class Buffer:
    """Transforms of the last seconds; fed by a `TransformListener`, asked from anywhere.

    Every method may be called from any thread. Waiting goes by the computer's clock.

    Args:
        cache_time: How long a transform is kept after a newer one came.
    """

    def __init__(self, cache_time: Duration = DEFAULT_CACHE) -> None:
        self._core = BufferCore(cache_time)
        self._changed = threading.Condition()
        self._wakers: dict[Callable[[], None], None] = {}

    # -- storing -------------------------------------------------------------------------------

    def set_transform(
        self, transform: TransformStamped, authority: str = "", *, is_static: bool = False
    ) -> bool:
        """Store a transform; see `BufferCore.set_transform`."""
        with self._changed:
            taken = self._core.set_transform(transform, authority, is_static=is_static)
            if taken:
                self._changed.notify_all()
                wakers = tuple(self._wakers)
        if taken:
            for wake in wakers:
                wake()
        return taken

    def clear(self) -> None:
        """Forget all but static transforms."""
        with self._changed:
            self._core.clear()

    # -- asking --------------------------------------------------------------------------------

    def lookup_transform(
        self, target: str, source: str, time: Time | None = None
    ) -> TransformStamped:
        """What maps coordinates of the source frame to the target frame, as far as known now.

        See `BufferCore.lookup_transform`.
        """
        with self._changed:
            return self._core.lookup_transform(target, source, time)

    def lookup_transform_full(
        self,
        target: str,
        target_time: Time | None,
        source: str,
        source_time: Time | None,
        fixed: str,
    ) -> TransformStamped:
        """From the source at one time to the target at another, with ``fixed`` standing still.

        See `BufferCore.lookup_transform_full`.
        """
        with self._changed:
            return self._core.lookup_transform_full(target, target_time, source, source_time, fixed)

    def can_transform(self, target: str, source: str, time: Time | None = None) -> bool:
        """Whether `lookup_transform` would answer now."""
        return self.why_not(target, source, time) is None

    def why_not(self, target: str, source: str, time: Time | None = None) -> TransformError | None:
        """The error that `lookup_transform` would raise now."""
        with self._changed:
            return self._core.why_not(target, source, time)

    def latest_common_time(self, target: str, source: str) -> Time:
        """The latest time at which all the way between two frames is known; 0 if it is static."""
        with self._changed:
            return self._core.latest_common_time(target, source)

    def frames(self) -> tuple[str, ...]:
        """Names of all frames, sorted."""
        with self._changed:
            return self._core.frames()

    def facts(self) -> tuple[FrameFacts, ...]:
        """What is known of every frame that has a parent, by name."""
        with self._changed:
            return self._core.facts()

    def transform(self, message: StampedT, target: str) -> StampedT:
        """A stamped message, moved to another frame at the time of its stamp.

        Raises:
            TypeError: There is no way to transform a message of that type.
            TransformError: As `lookup_transform`.
        """
        return do_transform(message, self._leading(message, target))

    def _leading(self, message: _Stamped, target: str) -> TransformStamped:
        header: Any = getattr(message, "header", None)
        if header is None:
            raise TypeError(f"{type(message).__name__} has no header that names its frame")
        return self.lookup_transform(target, header.frame_id, Time.from_msg(header.stamp))

    # -- waiting -------------------------------------------------------------------------------

    async def wait_for_transform(
        self, target: str, source: str, time: Time | None = None, timeout: float = 1.0
    ) -> TransformStamped:
        """As `lookup_transform`, waiting until it is known.

        Args:
            target: Frame to transform to.
            source: Frame to transform from.
            time: When; None or 0 is the latest.
            timeout: Seconds.

        Raises:
            TransformTimeout: Not in time; its ``reason`` says what was missing.
            InvalidArgument: A name is empty or begins with a slash.
        """
        try:
            async with asyncio.timeout(timeout):
                with self._woken() as arrived:
                    while self._missing(target, source, time) is not None:
                        arrived.clear()
                        await arrived.wait()
        except TimeoutError:
            reason = self.why_not(target, source, time)
            if reason is not None:
                raise TransformTimeout(timeout, reason) from None
        return self.lookup_transform(target, source, time)

    @contextmanager
    def _woken(self) -> Iterator[asyncio.Event]:
        """An event of this loop that every stored transform sets."""
        arrived = asyncio.Event()
        loop = asyncio.get_running_loop()

        def wake() -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(arrived.set)

        with self._changed:
            self._wakers[wake] = None
        try:
            yield arrived
        finally:
            with self._changed:
                self._wakers.pop(wake, None)

    def _missing(self, target: str, source: str, time: Time | None) -> TransformError | None:
        """Why there is no answer yet; a question that will never have one is raised."""
        reason = self.why_not(target, source, time)
        if isinstance(reason, InvalidArgument):
            raise reason
        return reason

    def wait_for_transform_blocking(
        self, target: str, source: str, time: Time | None = None, timeout: float = 1.0
    ) -> TransformStamped:
        """As `wait_for_transform`, for threads without an event loop."""
        end = clocks.monotonic() + timeout
        with self._changed:
            while (reason := self._missing(target, source, time)) is not None:
                left = end - clocks.monotonic()
                if left <= 0:
                    raise TransformTimeout(timeout, reason)
                self._changed.wait(left)
            return self._core.lookup_transform(target, source, time)
