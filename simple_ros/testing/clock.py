"""An event loop whose time stands still until a test moves it."""

from __future__ import annotations

import asyncio
import contextvars
import heapq
from collections.abc import Callable, Coroutine
from typing import Any, Self, TypeVar, TypeVarTuple, Unpack

__all__ = ["ManualClock"]

Result = TypeVar("Result")
Ts = TypeVarTuple("Ts")

_MOST_TURNS = 10_000


class _ManualLoop(asyncio.SelectorEventLoop):
    """Takes its time from a number, and knows when it has nothing left to do."""

    def __init__(self) -> None:
        self.now = 0.0
        self.calls = 0
        self._due: list[tuple[float, int, asyncio.TimerHandle]] = []
        super().__init__()

    def time(self) -> float:
        return self.now

    def call_soon(
        self,
        callback: Callable[[Unpack[Ts]], object],
        *args: *Ts,
        context: contextvars.Context | None = None,
    ) -> asyncio.Handle:
        self.calls += 1
        return super().call_soon(callback, *args, context=context)

    def call_at(
        self,
        when: float,
        callback: Callable[[Unpack[Ts]], object],
        *args: *Ts,
        context: contextvars.Context | None = None,
    ) -> asyncio.TimerHandle:
        handle = super().call_at(when, callback, *args, context=context)
        heapq.heappush(self._due, (when, id(handle), handle))
        return handle

    def next_due(self) -> float | None:
        """When the next timer rings that was not cancelled."""
        while self._due:
            when, _, handle = self._due[0]
            if when > self.now and not handle.cancelled():
                return when
            heapq.heappop(self._due)
        return None


class ManualClock:
    """Runs coroutines on an event loop in which time passes only by `advance`.

    Timers, deadlines, lifespans, leases and every ``asyncio`` timeout of what runs inside follow it, in
    order and exactly; ten minutes take as long as what happens in them. Threads, processes and real
    sockets know nothing of it: use it with `FakeMaster` and `MemoryNetwork`.
    """

    def __init__(self) -> None:
        self._loop = _ManualLoop()
        self._runner = asyncio.Runner(loop_factory=lambda: self._loop)

    @property
    def now(self) -> float:
        """Seconds since it was made; ``loop.time()`` inside."""
        return self._loop.now

    def run(self, main: Coroutine[Any, Any, Result]) -> Result:
        """Run a coroutine to its end."""
        return self._runner.run(main)

    async def advance(self, seconds: float) -> None:
        """Let time pass: every timer due meanwhile rings at its own moment, one after the other.

        Args:
            seconds: How much, 0 or more.

        Raises:
            ValueError: Time does not run backwards.
        """
        if seconds < 0:
            raise ValueError(f"cannot advance by {seconds} s: time does not run backwards")
        target = self._loop.now + seconds
        await self.settle()
        while (due := self._loop.next_due()) is not None and due <= target:
            self._loop.now = due
            await self.settle()
        self._loop.now = target
        await self.settle()

    async def settle(self) -> None:
        """Let everything happen that needs no time to pass.

        Raises:
            RuntimeError: It never ends: something calls itself again and again at the same moment.
        """
        loop = self._loop
        for _ in range(_MOST_TURNS):
            before = loop.calls
            await asyncio.sleep(0)
            # Our own step is one call; sockets and threads wake the loop without one.
            if loop.calls - before <= 1:
                await asyncio.sleep(0)
                if loop.calls - before <= 2:
                    return
        raise RuntimeError(f"still busy after {_MOST_TURNS} turns of the loop at {loop.now} s")

    def close(self) -> None:
        """End the event loop."""
        self._runner.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
