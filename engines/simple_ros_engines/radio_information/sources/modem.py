"""Modems of this host by ModemManager, and the statistics file of a gNB. Never run on hardware."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import ClassVar

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.modem_text import (
    parse_mmcli_signal,
    parse_oai_stats,
)
from simple_ros_engines.radio_information.sources.programs import output_of

__all__ = ["ModemManagerSource", "OaiStatsSource"]


class ModemManagerSource(MetricsSource):
    """A modem that ModemManager manages.

    Args:
        modem: Its number.
        period_s: Between looks; the modem measures once a second at most.
    """

    summary: ClassVar[str] = "4G and 5G modems by ModemManager (never run on hardware)"

    def __init__(self, modem: int = 0, period_s: float = 1.0) -> None:
        if modem < 0 or period_s < 1:
            raise ConfigError("modem must not be negative, period_s not below 1")
        self.period_s = period_s
        self._modem = str(modem)

    async def run(self, emit: Emit) -> None:
        """Give records.

        Raises:
            SourceDown: There is no such modem, or no ModemManager.
        """
        rate = f"--signal-setup={round(self.period_s)}"
        if await output_of("mmcli", "-m", self._modem, rate) is None:
            raise SourceDown(f"mmcli does not know modem {self._modem}")
        while True:
            words = ("mmcli", "-m", self._modem, "--signal-get", "--output-keyvalue")
            text = await output_of(*words)
            if text is None:
                raise SourceDown(f"modem {self._modem} is gone")
            found = parse_mmcli_signal(text, time.time_ns(), f"modem{self._modem}")
            if found is None:
                self.malformed += 1
            else:
                emit(found)
            await asyncio.sleep(self.period_s)


class OaiStatsSource(MetricsSource):
    """Devices of an OpenAirInterface gNB on this host.

    Args:
        path: Of its ``nrMAC_stats.log``, written anew each second.
        period_s: Between looks.
    """

    summary: ClassVar[str] = "nrMAC_stats.log of OpenAirInterface (never run on hardware)"

    def __init__(self, path: str = "nrMAC_stats.log", period_s: float = 1.0) -> None:
        self.period_s = period_s
        self._path = Path(path)
        self._seen_ns = 0

    async def run(self, emit: Emit) -> None:
        """Give records whenever the file was written.

        Raises:
            SourceDown: The file cannot be read.
        """
        while True:
            try:
                written_ns = self._path.stat().st_mtime_ns
                text = await asyncio.to_thread(self._path.read_text, "utf-8", "replace")
            except OSError as error:
                raise SourceDown(f"{self._path} cannot be read: {error.strerror}") from error
            if written_ns != self._seen_ns:
                self._seen_ns = written_ns
                for item in parse_oai_stats(text, written_ns):
                    emit(item)
            await asyncio.sleep(self.period_s)
