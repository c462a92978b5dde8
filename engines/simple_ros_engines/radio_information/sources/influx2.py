"""Metrics in an InfluxDB 2 server, by Flux: one query for all devices."""

from __future__ import annotations

import asyncio
import json
import urllib.error
import urllib.parse
import urllib.request
from typing import ClassVar

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.field_maps import (
    NewestPoints,
    preset,
)
from simple_ros_engines.store.annotated_csv import parse_last_csv

__all__ = ["Influx2Source", "flux_of_last"]

_TIMEOUT_S = 5.0
_MAX_ANSWER = 16 * 1024 * 1024


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
        if not url.startswith(("http://", "https://")):
            raise ConfigError(f"url {url!r} is neither http:// nor https://")
        self.period_s = period_s
        mapping = preset(fields)
        name = measurement or mapping.measurement
        self._newest = NewestPoints(mapping, "influx2")
        query = urllib.parse.urlencode({"org": org})
        body = json.dumps({"query": flux_of_last(bucket, name, window_s), "type": "flux"}).encode()
        headers = {"Content-Type": "application/json", "Accept": "application/csv"}
        if token:
            headers["Authorization"] = f"Token {token}"
        target = f"{url.rstrip('/')}/api/v2/query?{query}"
        self._request = urllib.request.Request(target, body, headers, method="POST")  # noqa: S310
        self._url = url

    async def run(self, emit: Emit) -> None:
        """Give each device's newest point once.

        Raises:
            SourceDown: The server does not answer, or refuses.
        """
        while True:
            text = await asyncio.to_thread(self._ask)
            for item in self._newest.fresh(parse_last_csv(text)):
                if item is None:
                    self.malformed += 1
                else:
                    emit(item)
            await asyncio.sleep(self.period_s)

    def _ask(self) -> str:
        try:
            with urllib.request.urlopen(self._request, timeout=_TIMEOUT_S) as answer:  # noqa: S310
                data: bytes = answer.read(_MAX_ANSWER)
        except urllib.error.HTTPError as error:
            with error:
                told = error.read(500).decode("utf-8", "replace")
            raise SourceDown(f"{self._url} refuses the query ({error.code}): {told}") from error
        except OSError as error:
            raise SourceDown(f"{self._url} does not answer: {error}") from error
        return data.decode("utf-8", "replace")


def flux_of_last(bucket: str, measurement: str, window_s: float) -> str:
    """The query for the newest value of each field of each device."""
    return (
        f"from(bucket: {_quoted(bucket)}) |> range(start: -{max(1, round(1000 * window_s))}ms)"
        f" |> filter(fn: (r) => r._measurement == {_quoted(measurement)}) |> last()"
    )


def _quoted(text: str) -> str:
    """A string of Flux; ``${`` would begin an expression."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("${", "\\${")
    return f'"{escaped}"'
