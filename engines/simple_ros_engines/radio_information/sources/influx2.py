"""Metrics in an InfluxDB 2 server, by Flux: one query for all devices."""

from __future__ import annotations

import asyncio
import json
from typing import ClassVar

from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource
from simple_ros_engines.radio_information.sources.field_maps import NewestPoints, preset
from simple_ros_engines.radio_information.sources.http import HttpServer
from simple_ros_engines.store.annotated_csv import parse_distinct_csv, parse_last_csv

__all__ = ["Influx2Source", "flux_of_devices", "flux_of_last"]


class Influx2Source(MetricsSource):
    """A measurement of an InfluxDB 2 server, or of whatever answers like one.

    Args:
        url: Of the server.
        org: Organisation.
        bucket: Bucket.
        token: Sent as it is; give it by a parameter file that only you can read.
        fields: Field map: ``wirelessros_oai``, ``srsran``, ``flexric_mac``.
        measurement: Instead of the field map's.
        period_s: Between queries.
        window_s: How far back a point may lie.
    """

    summary: ClassVar[str] = "InfluxDB 2 by Flux"

    def __init__(
        self,
        url: str = "http://127.0.0.1:8086",
        org: str = "my_org",
        bucket: str = "my_bucket",
        token: str = "",
        fields: str = "wirelessros_oai",
        measurement: str = "",
        period_s: float = 0.2,
        window_s: float = 2.0,
    ) -> None:
        self.period_s = period_s
        mapping = preset(fields)
        name = measurement or mapping.measurement
        self._newest = NewestPoints(mapping, "influx2")
        self._last = _body(flux_of_last(bucket, name, window_s))
        self._devices = _body(flux_of_devices(bucket, name, mapping.rnti_tag))
        self._query = {"org": org}
        headers = {"Content-Type": "application/json", "Accept": "application/csv"}
        if token:
            headers["Authorization"] = f"Token {token}"
        self._server = HttpServer(url, headers)

    async def run(self, emit: Emit) -> None:
        """Give each device's newest point once.

        Raises:
            SourceDown: The server does not answer, or refuses.
        """
        while True:
            text = await self._server.ask("/api/v2/query", self._query, self._last)
            for item in self._newest.of_values(parse_last_csv(text)):
                if item is None:
                    self.malformed += 1
                else:
                    emit(item)
            await asyncio.sleep(self.period_s)

    async def discover(self) -> frozenset[str]:
        """Devices with a point in the last minute.

        Raises:
            SourceDown: The server does not answer, or refuses.
        """
        text = await self._server.ask("/api/v2/query", self._query, self._devices)
        return self._newest.links(parse_distinct_csv(text))


def _body(flux: str) -> bytes:
    return json.dumps({"query": flux, "type": "flux"}).encode()


def flux_of_last(bucket: str, measurement: str, window_s: float) -> str:
    """The query for the newest value of each field of each device."""
    return (
        f"from(bucket: {_quoted(bucket)}) |> range(start: -{max(1, round(1000 * window_s))}ms)"
        f" |> filter(fn: (r) => r._measurement == {_quoted(measurement)}) |> last()"
    )


def flux_of_devices(bucket: str, measurement: str, tag: str) -> str:
    """The query for the devices of the last minute."""
    return (
        f"from(bucket: {_quoted(bucket)}) |> range(start: -1m)"
        f" |> filter(fn: (r) => r._measurement == {_quoted(measurement)})"
        f" |> group(columns: [{_quoted(tag)}]) |> distinct(column: {_quoted(tag)})"
    )


def _quoted(text: str) -> str:
    """A string of Flux; ``${`` would begin an expression."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("${", "\\${")
    return f'"{escaped}"'
