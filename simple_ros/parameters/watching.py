"""A watch of parameters that outlives Masters."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Callable
from types import MappingProxyType
from typing import Any, Self, TypeAlias

import grpc

from simple_ros.callbacks import CALLBACK_ERRORS, CallbackGuard, is_async, is_being_cancelled
from simple_ros.errors import HandleClosed, MasterUnavailable
from simple_ros.net.master_client import MasterClient
from simple_ros.parameters.calls import ParameterCalls
from simple_ros.parameters.feed import ParameterChanged, ParameterMirror
from simple_ros.parameters.values import Value
from simple_ros.wire.session import Backoff

__all__ = ["ParameterWatch", "WatchCallback"]

logger = logging.getLogger(__name__)

WatchCallback: TypeAlias = Callable[[ParameterChanged], Any]


class ParameterWatch:
    """Tells what parameters there are in a group, and every change. Made by `NodeHandle.watch_parameters`.

    First comes each parameter there is, then changes as they happen. After a Master's restart only
    what is different comes. Changes that nobody takes are joined, so that the last one of each
    parameter waits.

    Args:
        client: Gives the present connection to the Master.
        prefix: Full name of the group; empty for all.
        callback: Called with each change, plain or a coroutine function; None leaves them to
            ``async for``.
        forget: Called with the watch when it is closed.
    """

    def __init__(
        self,
        client: Callable[[], MasterClient],
        prefix: str,
        callback: WatchCallback | None,
        forget: Callable[[ParameterWatch], None] = lambda _: None,
    ) -> None:
        self.prefix = prefix
        self._client = client
        self._forget = forget
        self._guard = CallbackGuard(f"the watch of parameters {prefix!r}")
        self._mirror = ParameterMirror()
        self._waiting: dict[str, ParameterChanged] = {}
        self._arrived = asyncio.Event()
        self._closed = False
        loop = asyncio.get_running_loop()
        self._ready: asyncio.Future[None] = loop.create_future()
        self._callback = callback if callback is None or not is_async(callback) else None
        self._tasks = [loop.create_task(self._follow(), name=f"watch of {prefix}")]
        if callback is not None and self._callback is None:
            self._tasks.append(loop.create_task(self._await_callbacks(callback)))

    async def wait_ready(self) -> None:
        """Return when the first snapshot has come (awaited by the node).

        Raises:
            ForeignMaster: It is a C++ Master.
        """
        await asyncio.shield(self._ready)

    @property
    def values(self) -> MappingProxyType[str, Value]:
        """The parameters as last told, by full name."""
        return MappingProxyType(self._mirror.values)

    @property
    def errors(self) -> int:
        """Exceptions of the callback so far."""
        return self._guard.errors

    # -- following -----------------------------------------------------------------------------

    async def _follow(self) -> None:
        backoff = Backoff(0.05, 0.5)
        while True:
            try:
                async with contextlib.aclosing(
                    ParameterCalls(self._client()).watch(self.prefix)
                ) as events:
                    async for event in events:
                        self._deliver(self._mirror.apply(event))
                        backoff.reset()
                        if not self._ready.done():
                            self._ready.set_result(None)
            except (MasterUnavailable, grpc.aio.AioRpcError) as error:
                logger.debug("watch of parameters %r: %s", self.prefix, error)
            except Exception as error:
                if self._ready.done():
                    # Nothing may end this task unseen: the watcher would wait for ever.
                    logger.exception("watch of parameters %r failed", self.prefix)
                else:
                    self._ready.set_exception(error)
                    return
            await asyncio.sleep(backoff.next_delay())

    def _deliver(self, changes: list[ParameterChanged]) -> None:
        for change in changes:
            if self._callback is not None:
                self._guard.call(self._callback, change)
            else:
                self._keep(change)

    def _keep(self, change: ParameterChanged) -> None:
        """Let a change wait; together with an earlier one of the same parameter it is one change."""
        earlier = self._waiting.pop(change.name, None)
        if earlier is not None:
            change = ParameterChanged(change.name, change.value, earlier.previous)
        if earlier is None or repr(change.value) != repr(change.previous):
            self._waiting[change.name] = change
            self._arrived.set()

    async def _await_callbacks(self, callback: WatchCallback) -> None:
        async for change in self:
            try:
                await callback(change)
            except CALLBACK_ERRORS as error:
                if is_being_cancelled():
                    raise
                self._guard.failed(error)

    # -- taking --------------------------------------------------------------------------------

    async def receive(self, timeout: float | None = None) -> ParameterChanged:
        """The next change (of a watch without callback).

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
            HandleClosed: The watch is closed.
        """
        async with asyncio.timeout(timeout):
            while not self._waiting:
                if self._closed:
                    raise HandleClosed(f"watch of parameters {self.prefix!r}")
                self._arrived.clear()
                await self._arrived.wait()
        return self._waiting.pop(next(iter(self._waiting)))

    async def __aiter__(self) -> AsyncIterator[ParameterChanged]:
        """Changes until the watch is closed."""
        with contextlib.suppress(HandleClosed):
            while True:
                yield await self.receive()

    # -- the end -------------------------------------------------------------------------------

    async def close(self) -> None:
        """Watch no more."""
        tasks = [task for task in self._tasks if task is not asyncio.current_task()]
        self.abandon()
        await asyncio.gather(*tasks, return_exceptions=True)

    def abandon(self) -> None:
        """The same at once (called by the node)."""
        self._closed = True
        self._waiting.clear()
        self._arrived.set()
        if not self._ready.done():
            self._ready.cancel()
        for task in self._tasks:
            if task is not asyncio.current_task():
                task.cancel()
        self._forget(self)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()
