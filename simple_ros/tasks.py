"""Small things to do with asyncio tasks."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Coroutine, Iterable
from typing import Any

from simple_ros.errors import SimpleRosError

__all__ = ["first_of", "quietly", "run_all", "said_when_slow"]

logger = logging.getLogger(__name__)

_SAY_WAITING_AFTER_S = 1.0


async def run_all(coroutines: Iterable[Coroutine[Any, Any, None]]) -> None:
    """Run together until all have ended, then raise the first exception there was."""
    for result in await asyncio.gather(*coroutines, return_exceptions=True):
        if isinstance(result, BaseException):
            raise result


async def first_of(*coroutines: Coroutine[Any, Any, None]) -> None:
    """Run together until one ends; the others are cancelled, an exception is raised."""
    tasks = [asyncio.ensure_future(coroutine) for coroutine in coroutines]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


@contextlib.asynccontextmanager
async def said_when_slow(address: str) -> AsyncIterator[None]:
    """Log once if what is inside takes long, and once more when it is done after all."""
    said = False

    def say() -> None:
        nonlocal said
        said = True
        logger.warning("waiting for a Master at %s", address)

    handle = asyncio.get_running_loop().call_later(_SAY_WAITING_AFTER_S, say)
    try:
        yield
    finally:
        handle.cancel()
    if said:
        logger.warning("found the Master at %s", address)


async def quietly(coroutine: Coroutine[Any, Any, object]) -> None:
    """Run something that may fail because the node ends meanwhile; what goes wrong is logged."""
    try:
        await coroutine
    except SimpleRosError as error:
        logger.debug("given up: %s", error)
