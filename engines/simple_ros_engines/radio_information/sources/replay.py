"""Records from a file of JSON lines."""

from __future__ import annotations

import asyncio
import math
import time
from pathlib import Path
from typing import ClassVar

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.record_json import BadRecord, from_json

__all__ = ["ReplaySource"]


class ReplaySource(MetricsSource):
    """Replays a file.

    Args:
        path: Of the file.
        speed: How many times as fast as recorded; 0 for as fast as it goes.
        restamp: Whether records get the present time instead of their own.
        loop: Whether to begin anew at the end.
    """

    summary: ClassVar[str] = "records of a file of JSON lines"

    def __init__(
        self, path: str, speed: float = 1.0, restamp: bool = False, loop: bool = False
    ) -> None:
        if not path:
            raise ConfigError("path is empty: which file is to be replayed?")
        if not 0 <= speed < math.inf:
            raise ConfigError(f"speed is {speed}, must be a number that is not negative")
        self._path = Path(path)
        self._speed = speed
        self._restamp = restamp
        self._loop = loop
        self.period_s = 0.1
        self.live = restamp

    async def run(self, emit: Emit) -> None:
        """Give the records.

        Raises:
            SourceDown: The file cannot be read, or has no records.
        """
        while True:
            records = await asyncio.to_thread(self._read)
            if not records:
                raise SourceDown(f"{self._path} has no record in it")
            await self._play(records, emit)
            if not self._loop:
                return

    def _read(self) -> list[LinkRecord]:
        found = []
        try:
            text = self._path.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            raise SourceDown(f"{self._path} cannot be read: {error.strerror}") from error
        for line in text.splitlines():
            if line.strip():
                try:
                    found.append(from_json(line))
                except BadRecord:
                    self.malformed += 1
        return found

    async def _play(self, records: list[LinkRecord], emit: Emit) -> None:
        loop = asyncio.get_running_loop()
        begun = loop.time()
        for index, item in enumerate(records):
            if self._speed:
                due = (item.stamp_ns - records[0].stamp_ns) / 1e9 / self._speed
                await asyncio.sleep(max(0.0, begun + due - loop.time()))
            elif index % 100 == 0:
                await asyncio.sleep(0)
            if self._restamp:
                item = LinkRecord(
                    item.link_id, time.time_ns(), item.source, item.rnti, item.values, item.quality
                )
            emit(item)
