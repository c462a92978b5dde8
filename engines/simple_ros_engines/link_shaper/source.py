"""Metrics of the link shaper's simulated links, as a source of the Radio Information Engine."""

from __future__ import annotations

import asyncio
import os
from typing import ClassVar

from simple_ros.net.addresses import split_address
from simple_ros_engines.link_shaper.hello import Hello
from simple_ros_engines.link_shaper.transport import DEFAULT_SHAPER, WHERE, dial_shaper
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.record_json import BadRecord, from_json

__all__ = ["ShaperSource"]

_SILENCE_S = 2.0


class ShaperSource(MetricsSource):
    """Links of a running link shaper; every field is marked simulated.

    Args:
        shaper: Its address; empty takes ``SIMPLE_ROS_LINK_SHAPER``, else 127.0.0.1:7310.
    """

    summary: ClassVar[str] = "links of the link shaper (no radio is behind them)"
    period_s = 0.1

    def __init__(self, shaper: str = "") -> None:
        self._shaper = shaper or os.environ.get(WHERE, DEFAULT_SHAPER)

    async def run(self, emit: Emit) -> None:
        """Give records.

        Raises:
            SourceDown: The shaper does not answer, or left.
        """
        try:
            sock = await dial_shaper(split_address(self._shaper), Hello())
            reader, writer = await asyncio.open_connection(sock=sock)
            try:
                while True:
                    async with asyncio.timeout(_SILENCE_S):
                        line = await reader.readline()
                    if not line:
                        break
                    try:
                        emit(from_json(line.decode()))
                    except (BadRecord, UnicodeDecodeError):
                        self.malformed += 1
            finally:
                writer.close()
        except TimeoutError as error:
            raise SourceDown(f"link shaper at {self._shaper} does not answer") from error
        except OSError as error:
            raise SourceDown(f"link shaper at {self._shaper}: {error}") from error
        raise SourceDown(f"link shaper at {self._shaper} closed the connection")
