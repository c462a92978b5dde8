"""Metrics of an srsRAN gNB over its WebSocket. Never run on hardware."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from typing import Any, ClassVar

from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.field_maps import PRESETS, read_fields

__all__ = ["SrsranSource", "parse_metrics"]


class SrsranSource(MetricsSource):
    """Devices of an srsRAN gNB.

    Args:
        url: Of its metrics.
    """

    summary: ClassVar[str] = "srsRAN gNB over WebSocket (never run on hardware)"

    def __init__(self, url: str = "ws://127.0.0.1:8001") -> None:
        self._url = url

    async def run(self, emit: Emit) -> None:
        """Subscribe and give records.

        Raises:
            SourceDown: The gNB does not answer, or left.
        """
        try:
            async with connect(self._url, open_timeout=5) as socket:
                await socket.send(json.dumps({"cmd": "metrics_subscribe"}))
                async for text in socket:
                    for item in parse_metrics(text, time.time_ns()):
                        if item is None:
                            self.malformed += 1
                        else:
                            emit(item)
        except (OSError, WebSocketException, TimeoutError) as error:
            raise SourceDown(f"{self._url}: {error}") from error
        raise SourceDown(f"{self._url} closed the connection")


def parse_metrics(text: str | bytes, now_ns: int) -> Iterator[LinkRecord | None]:
    """The records of one message; None for what cannot be read."""
    try:
        message: Any = json.loads(text)
    except ValueError:
        yield None
        return
    cells = message.get("cells") if isinstance(message, dict) else None
    for cell in cells if isinstance(cells, list) else ():
        devices = cell.get("ue_list") if isinstance(cell, dict) else None
        for device in devices if isinstance(devices, list) else ():
            if not isinstance(device, dict):
                yield None
                continue
            inner = device.get("ue_container", device)
            rnti = str(inner.get("rnti", "")) if isinstance(inner, dict) else ""
            yield read_fields(PRESETS["srsran"], rnti, now_ns, "srsran", inner) if rnti else None
