"""Event loops: which one a program gets, and one in a thread of its own, for programs that have none."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from typing import Any, TypeVar

from simple_ros.errors import ConfigError
from simple_ros.net import quick_loop
from simple_ros.net.quick_loop import QuickLoop

__all__ = ["BackgroundLoop", "NoSuchLoop", "new_loop"]

Result = TypeVar("Result")

_STOP_S = 2.0


class NoSuchLoop(ConfigError):
    """``SIMPLE_ROS_LOOP`` names an event loop that is not to be had."""


def new_loop() -> asyncio.AbstractEventLoop:
    """A loop as ``SIMPLE_ROS_LOOP`` wants it: ``quick`` (or nothing), ``asyncio`` or ``uvloop``.

    The quick one is asyncio's, made to hand on what came with less in between (`simple_ros.net.quick_loop`); where
    the system has no epoll, it is asyncio's as it is.

    Raises:
        NoSuchLoop: It names another, or uvloop is not installed.
    """
    wanted = os.environ.get("SIMPLE_ROS_LOOP", "") or "quick"
    if wanted == "quick" and quick_loop.is_available():
        return QuickLoop()
    if wanted in ("quick", "asyncio"):
        return asyncio.new_event_loop()
    if wanted != "uvloop":
        raise NoSuchLoop(f"SIMPLE_ROS_LOOP={wanted}: there are 'quick', 'asyncio' and 'uvloop'")
    try:
        import uvloop
    except ImportError:
        raise NoSuchLoop(
            "SIMPLE_ROS_LOOP=uvloop needs one more package: pip install 'simple-ros[uvloop]'"
        ) from None
    return uvloop.new_event_loop()


class BackgroundLoop:
    """Runs coroutines for other threads. A daemon thread: it keeps no program alive."""

    def __init__(self) -> None:
        self._loop = new_loop()
        self._tasks: set[asyncio.Task[object]] = set()
        self._thread = threading.Thread(target=self._run, name="simple_ros loop", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
        finally:
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
            self._loop.close()

    @property
    def is_current(self) -> bool:
        """Whether the caller runs on this loop's thread."""
        return threading.get_ident() == self._thread.ident

    def run(self, coroutine: Coroutine[Any, Any, Result], timeout: float | None = None) -> Result:
        """Run to the end and return the result, blocking the calling thread.

        If the wait is interrupted (a signal, the timeout) the coroutine is cancelled.

        Raises:
            RuntimeError: Called on the loop's own thread, which would wait for itself.
            TimeoutError: Not within ``timeout`` seconds.
        """
        if self.is_current:
            coroutine.close()
            raise RuntimeError("a blocking call was made on the thread of the event loop")
        future: Future[Result] = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return future.result(timeout)
        except BaseException:
            future.cancel()
            raise

    def submit(self, coroutine: Coroutine[Any, Any, Result]) -> Future[Result]:
        """Run in the background; the result is the future's."""
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    def call_soon(self, function: Callable[..., object], *args: Any) -> None:
        """Call on the loop's thread, soon; nothing is returned."""
        self._loop.call_soon_threadsafe(function, *args)

    def start(self, coroutine: Coroutine[Any, Any, object]) -> None:
        """Run in the background; nothing is returned. An exception is reported by asyncio."""
        self._loop.call_soon_threadsafe(self._start, coroutine)

    def _start(self, coroutine: Coroutine[Any, Any, object]) -> None:
        task = self._loop.create_task(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def stop(self) -> None:
        """End the loop and its thread; what still runs on it is cancelled."""
        if self._thread.is_alive() and not self.is_current:
            self.run(_cancel_others(), _STOP_S)
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(_STOP_S)


async def _cancel_others() -> None:
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
