"""Looks with a deadline."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

__all__ = ["Unknown", "in_thread", "output_of", "within"]

Fact = TypeVar("Fact")


@dataclass(frozen=True, slots=True)
class Unknown(Generic[Fact]):
    """A fact that could not be found out, and why."""

    reason: str


async def within(limit_s: float, look: Coroutine[Any, Any, Fact]) -> Fact | Unknown[Fact]:
    """What a look found; never an error, and never later than ``limit_s`` seconds."""
    try:
        async with asyncio.timeout(limit_s):
            return await look
    except TimeoutError:
        return Unknown(f"it took longer than {limit_s:g} s")
    except Exception as error:
        # Of any kind: a doctor has to go on where everything else has failed, and says what it was.
        return Unknown(f"{type(error).__name__}: {error}")


async def in_thread(function: Callable[..., Fact], *args: Any) -> Fact:
    """Run what may block. When this is cancelled the thread goes on, and dies with the process.

    (The event loop's own threads would be waited for, however long a name server keeps silent.)
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[Fact] = loop.create_future()

    def settle(method: Callable[[Any], None], value: Any) -> None:
        def settle_here() -> None:
            if not done.done():
                method(value)

        if not loop.is_closed():
            loop.call_soon_threadsafe(settle_here)

    def run() -> None:
        try:
            settle(done.set_result, function(*args))
        except Exception as error:
            settle(done.set_exception, error)

    threading.Thread(target=run, name=f"doctor {function.__name__}", daemon=True).start()
    return await done


async def output_of(*command: str) -> str | None:
    """What a program prints; None if it is not there or fails."""
    try:
        process = await asyncio.create_subprocess_exec(
            *command,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
        )
    except OSError:
        return None
    try:
        text, _ = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return text.decode(errors="replace") if process.returncode == 0 else None
