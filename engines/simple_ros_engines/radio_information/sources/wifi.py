"""Wi-Fi links by ``iw``, else by ``/proc/net/wireless``. Never run on hardware."""

from __future__ import annotations

import asyncio
import re
import time
from pathlib import Path
from typing import ClassVar

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.programs import output_of
from simple_ros_engines.radio_information.sources.wifi_text import (
    parse_proc_wireless,
    parse_station_dump,
    parse_survey_noise,
)

__all__ = ["WifiSource"]


class WifiSource(MetricsSource):
    """Stations of one interface.

    Args:
        interface: Such as ``wlan0``.
        period_s: Between looks.
        proc: What is read where there is no ``iw``.
    """

    summary: ClassVar[str] = "Wi-Fi stations by iw or /proc/net/wireless (never run on hardware)"

    def __init__(
        self, interface: str = "wlan0", period_s: float = 0.5, proc: str = "/proc/net/wireless"
    ) -> None:
        if not re.fullmatch(r"[\w.@-]{1,15}", interface):
            raise ConfigError(f"{interface!r} is no name of an interface")
        self.period_s = period_s
        self._interface = interface
        self._proc = Path(proc)
        self._before: dict[str, tuple[int, int]] = {}

    async def run(self, emit: Emit) -> None:
        """Give records.

        Raises:
            SourceDown: There is no such interface.
        """
        while True:
            for item in await self._look():
                emit(item)
            await asyncio.sleep(self.period_s)

    async def _look(self) -> list[LinkRecord]:
        stations = await output_of("iw", "dev", self._interface, "station", "dump")
        if stations is None:
            return self._from_proc()
        survey = await output_of("iw", "dev", self._interface, "survey", "dump")
        noise = parse_survey_noise(survey or "")
        records, self._before = parse_station_dump(stations, time.time_ns(), noise, self._before)
        return records

    def _from_proc(self) -> list[LinkRecord]:
        try:
            text = self._proc.read_text(encoding="ascii", errors="replace")
        except OSError as error:
            raise SourceDown(f"neither iw nor {self._proc} tell of {self._interface}") from error
        records = parse_proc_wireless(text, time.time_ns())
        found = [item for item in records if item.link_id == self._interface]
        if not found:
            raise SourceDown(f"there is no Wi-Fi interface {self._interface}")
        return found
