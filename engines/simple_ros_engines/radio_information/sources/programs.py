"""Running other programs for what they print."""

from __future__ import annotations

import asyncio

__all__ = ["output_of"]

_LIMIT_S = 5.0


async def output_of(*words: str) -> str | None:
    """What a program prints; None if it is not there, fails, or takes longer than 5 s."""
    try:
        process = await asyncio.create_subprocess_exec(
            *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL
        )
    except OSError:
        return None
    try:
        async with asyncio.timeout(_LIMIT_S):
            out, _ = await process.communicate()
    except TimeoutError:
        return None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return out.decode("utf-8", "replace") if process.returncode == 0 else None
