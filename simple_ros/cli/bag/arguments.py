"""Options of several ``bag`` commands, and what users write in them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from simple_ros.errors import ConfigError

__all__ = [
    "ChunkSizeOption",
    "CompressionName",
    "CompressionOption",
    "ExcludeOption",
    "InArgument",
    "OutArgument",
    "RegexOption",
    "bag_files",
    "counted",
    "pairs_of",
    "remaps_of",
    "size_of",
]

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "ki": 2**10, "mi": 2**20, "gi": 2**30}
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([kmg]i?)?b?", re.IGNORECASE)


class CompressionName(Enum):
    """How chunks are compressed."""

    ZSTD = "zstd"
    LZ4 = "lz4"
    NONE = "none"


InArgument = Annotated[Path, typer.Argument(metavar="IN", help="The bag.")]
OutArgument = Annotated[Path, typer.Argument(metavar="OUT", help="The new bag.")]
RegexOption = Annotated[
    str | None,
    typer.Option("-e", "--regex", metavar="REGEX", help="Topics whose name fits."),
]
ExcludeOption = Annotated[
    str | None,
    typer.Option("-x", "--exclude-regex", metavar="REGEX", help="But not topics that fit this."),
]
CompressionOption = Annotated[
    CompressionName,
    typer.Option("--compression", help="zstd: small; lz4: little work for the CPU."),
]
ChunkSizeOption = Annotated[
    str, typer.Option("--chunk-size", metavar="SIZE", help="Size of chunks before compression.")
]


def counted(count: int, noun: str = "message") -> str:
    """``1 message``, ``2 messages``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def size_of(text: str) -> int:
    """A size in bytes: ``4096``, ``100MB`` (of 1000), ``4MiB`` (of 1024).

    Raises:
        ConfigError: It is none, or 0.
    """
    match = _SIZE.fullmatch(text.strip())
    size = round(float(match[1]) * _UNITS[(match[2] or "").lower()]) if match else 0
    if size < 1:
        raise ConfigError(f"{text!r} is no size; write 4096, 100MB or 4MiB")
    return size


def pairs_of(texts: Sequence[str], option: str) -> dict[str, str]:
    """``KEY=VALUE`` texts.

    Raises:
        ConfigError: One has no ``=``.
    """
    return _split(texts, "=", f"{option} KEY=VALUE")


def remaps_of(texts: Sequence[str]) -> dict[str, str]:
    """``OLD:=NEW`` texts.

    Raises:
        ConfigError: One has no ``:=``.
    """
    return _split(texts, ":=", "--remap OLD:=NEW")


def _split(texts: Sequence[str], separator: str, usage: str) -> dict[str, str]:
    found = {}
    for text in texts:
        key, there, value = text.partition(separator)
        if not (key and there):
            raise ConfigError(f"{text!r} is not as in {usage}")
        found[key] = value
    return found


def bag_files(paths: Sequence[Path]) -> list[Path]:
    """The files that are meant; a directory stands for the bags in it.

    Raises:
        ConfigError: A directory holds no bags.
    """
    found: list[Path] = []
    for path in paths:
        inside = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        if not inside:
            raise ConfigError(f"{path} holds no .mcap files")
        found += inside
    return found
