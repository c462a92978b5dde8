"""An asyncio event loop that hands a readable socket to its reader within the wait for it.

asyncio's own loop makes a list of what is readable, turns it into handles, queues these and runs the queue. For a
message that comes alone this is most of what happens between the kernel and its callback, on a core that
has just woken up and whose caches are cold. Here the readers that `add_quick_reader` was told are called straight
from the poll. All else is asyncio's.
"""

from __future__ import annotations

import asyncio
import contextvars
import math
import select
import selectors
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVarTuple, Unpack

if TYPE_CHECKING:
    from _typeshed import HasFileno

__all__ = ["QuickLoop", "add_quick_reader", "is_available"]

Ts = TypeVarTuple("Ts")
Ready = list[tuple[selectors.SelectorKey, int]]


def is_available() -> bool:
    """Whether this system polls as this loop does: Linux."""
    return hasattr(select, "epoll") and hasattr(selectors, "EpollSelector")


if is_available():

    class _QuickSelector(selectors.EpollSelector):
        """Calls the readers it knows of itself, and lists the other descriptors that are ready.

        Attributes:
            readers: What to call when there is something to read, by descriptor.
            failed: Called with what a reader raises.
        """

        def __init__(self) -> None:
            super().__init__()
            self.readers: dict[int, Callable[[], object]] = {}
            self.failed: Callable[[int, BaseException], None]

        def select(self, timeout: float | None = None) -> Ready:
            if timeout is None:
                wait_s = -1.0
            elif timeout <= 0:
                wait_s = 0.0
            else:
                # The kernel counts in milliseconds here; nobody is to be woken too early.
                wait_s = math.ceil(timeout * 1e3) * 1e-3
            keys: dict[int, selectors.SelectorKey] = self._fd_to_key  # type: ignore[attr-defined]
            ready: Ready = []
            try:
                found = self._selector.poll(wait_s, len(keys) or 1)  # type: ignore[attr-defined]
            except InterruptedError:
                return ready
            reader_of = self.readers.get
            for fd, event in found:
                if event == _READABLE and (reader := reader_of(fd)) is not None:
                    try:
                        reader()
                    except (SystemExit, KeyboardInterrupt):
                        raise
                    except BaseException as error:
                        self.failed(fd, error)
                elif (key := keys.get(fd)) is not None:
                    events = selectors.EVENT_WRITE if event & ~_READABLE else 0
                    if event & ~_WRITABLE:
                        events |= selectors.EVENT_READ
                    ready.append((key, events & key.events))
            return ready

        def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
            key = super().register(fileobj, events, data)
            self.readers.pop(key.fd, None)
            return key

        def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
            key = super().modify(fileobj, events, data)
            if not events & selectors.EVENT_READ:
                self.readers.pop(key.fd, None)
            return key

        def unregister(self, fileobj: Any) -> selectors.SelectorKey:
            key = super().unregister(fileobj)
            self.readers.pop(key.fd, None)
            return key

    _READABLE = select.EPOLLIN
    _WRITABLE = select.EPOLLOUT


class QuickLoop(asyncio.SelectorEventLoop):
    """See the module. Only where `is_available`."""

    def __init__(self) -> None:
        self._quick = _QuickSelector()
        super().__init__(self._quick)
        self._quick.failed = self._reader_failed

    def add_quick_reader(self, fd: int, callback: Callable[[], object]) -> None:
        """As ``add_reader``; the callback runs in the context of this call, earlier than others."""
        super().add_reader(fd, callback)
        self._quick.readers[fd] = partial(contextvars.copy_context().run, callback)

    def add_reader(
        self, fd: int | HasFileno, callback: Callable[[Unpack[Ts]], Any], *args: *Ts
    ) -> None:
        """As ever."""
        self._quick.readers.pop(fd if isinstance(fd, int) else fd.fileno(), None)
        super().add_reader(fd, callback, *args)

    def _reader_failed(self, fd: int, error: BaseException) -> None:
        self.call_exception_handler(
            {"message": f"Exception in the reader of descriptor {fd}", "exception": error}
        )


def add_quick_reader(
    loop: asyncio.AbstractEventLoop, fd: int, callback: Callable[[], object]
) -> None:
    """Call back whenever a descriptor is readable: at once on a `QuickLoop`, else as ``add_reader`` does."""
    if isinstance(loop, QuickLoop):
        loop.add_quick_reader(fd, callback)
    else:
        loop.add_reader(fd, callback)
