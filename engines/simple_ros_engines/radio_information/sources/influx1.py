"""Metrics in an InfluxDB 1 server, by InfluxQL: one query for all devices."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from simple_ros.errors import SimpleRosError
from simple_ros_engines.radio_information.sources.base import SourceDown
from simple_ros_engines.radio_information.sources.field_maps import (
    NewestPoints,
    RawPoint,
    preset,
)
from simple_ros_engines.radio_information.sources.http import HttpServer, basic_authorization
from simple_ros_engines.radio_information.sources.polled import PolledDatabase

__all__ = ["BadAnswer", "Influx1Source", "influxql_of_newest", "parse_series"]


class BadAnswer(SimpleRosError, ValueError):
    """What a server said is no answer to the question."""


class Influx1Source(PolledDatabase):
    """A measurement of an InfluxDB 1 server.

    Args:
        url: Of the server.
        database: Its name.
        user: Empty: the server asks for none.
        password: Give it by a parameter file that only you can read.
        fields: Field map: ``wirelessros_oai``, ``srsran``, ``flexric_mac``.
        measurement: Instead of the field map's.
        period_s: Between queries.
        window_s: How far back a point may lie.
    """

    summary: ClassVar[str] = "InfluxDB 1 by InfluxQL"

    def __init__(
        self,
        url: str = "http://127.0.0.1:8086",
        database: str = "my_bucket",
        user: str = "",
        password: str = "",
        fields: str = "wirelessros_oai",
        measurement: str = "",
        period_s: float = 0.2,
        window_s: float = 2.0,
    ) -> None:
        mapping = preset(fields)
        super().__init__(NewestPoints(mapping, "influx1"), period_s)
        name = measurement or mapping.measurement
        self._tag = mapping.rnti_tag
        self._common = {"db": database, "epoch": "ns"}
        self._last = influxql_of_newest(name, self._tag, window_s)
        self._minute = influxql_of_newest(name, self._tag, 60.0)
        headers = {"Accept": "application/json"}
        if user:
            headers["Authorization"] = basic_authorization(user, password)
        self._server = HttpServer(url, headers)

    async def last_points(self) -> list[RawPoint]:
        """Ask for them."""
        return await self._points(self._last)

    async def points_of_a_minute(self) -> list[RawPoint]:
        """Ask for them."""
        return await self._points(self._minute)

    async def _points(self, query: str) -> list[RawPoint]:
        text = await self._server.ask("/query", {**self._common, "q": query})
        try:
            return list(parse_series(text, self._tag))
        except BadAnswer as error:
            raise SourceDown(f"the server's answer: {error}") from error


def influxql_of_newest(measurement: str, tag: str, window_s: float) -> str:
    """The query for the newest point of each device."""
    since = f"now() - {max(1, round(1000 * window_s))}ms"
    words = ("SELECT * FROM", _quoted(measurement), "WHERE time >", since)
    return " ".join((*words, "GROUP BY", _quoted(tag), "ORDER BY time DESC LIMIT 1"))


def parse_series(text: str, tag: str) -> Iterator[RawPoint]:
    """The points of an answer in JSON with times in nanoseconds; devices without an RNTI are left out.

    Raises:
        BadAnswer: It is no such answer, or tells of an error.
    """
    try:
        answer: Any = json.loads(text)
    except ValueError as error:
        raise BadAnswer(f"no JSON: {text[:200]!r}") from error
    results = answer.get("results") if isinstance(answer, dict) else None
    if not isinstance(results, list):
        raise BadAnswer(f"no results in {text[:200]!r}")
    for result in results:
        if not isinstance(result, dict) or "error" in result:
            raise BadAnswer(str(result)[:200])
        for series in result.get("series", ()):
            yield from _points(series, tag)


def _points(series: Mapping[str, Any], tag: str) -> Iterator[RawPoint]:
    rnti = str(series.get("tags", {}).get(tag, ""))
    names = series.get("columns", [])
    for row in series.get("values", ()) if rnti else ():
        fields = dict(zip(names, row, strict=False))
        stamp_ns = fields.pop("time", None)
        if isinstance(stamp_ns, int):
            yield RawPoint(rnti, stamp_ns, fields)


def _quoted(name: str) -> str:
    """A name of InfluxQL."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
