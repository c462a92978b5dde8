"""Metrics in an InfluxDB 3 server, by SQL over HTTP: one query for all devices. Never run on a real server."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, ClassVar

from simple_ros_engines.radio_information.sources.field_maps import (
    NewestPoints,
    RawPoint,
    preset,
)
from simple_ros_engines.radio_information.sources.http import HttpServer
from simple_ros_engines.radio_information.sources.polled import PolledDatabase
from simple_ros_engines.store.annotated_csv import stamp_of_text

__all__ = ["Influx3Source", "parse_rows", "sql_of_newest"]

_RANK = "newest_first"


class Influx3Source(PolledDatabase):
    """A table of an InfluxDB 3 server, such as that of srsRAN's containers.

    Args:
        url: Of the server.
        database: Its name.
        token: Sent as it is; give it by a parameter file that only you can read.
        fields: Field map: ``srsran``, ``wirelessros_oai``, ``flexric_mac``.
        measurement: Instead of the field map's.
        period_s: Between queries.
        window_s: How far back a point may lie.
    """

    summary: ClassVar[str] = "InfluxDB 3 by SQL (never run on a real server)"

    def __init__(
        self,
        url: str = "http://127.0.0.1:8181",
        database: str = "srsran",
        token: str = "",
        fields: str = "srsran",
        measurement: str = "",
        period_s: float = 0.5,
        window_s: float = 3.0,
    ) -> None:
        mapping = preset(fields)
        super().__init__(NewestPoints(mapping, "influx3"), period_s)
        name = measurement or mapping.measurement
        self._tag = mapping.rnti_tag
        self._last = _body(database, sql_of_newest(name, self._tag, window_s))
        self._minute = _body(database, sql_of_newest(name, self._tag, 60.0))
        headers = {"Content-Type": "application/json", "Accept": "application/jsonl"}
        if token:
            headers["Authorization"] = f"Bearer {token}"
        self._server = HttpServer(url, headers)

    async def last_points(self) -> list[RawPoint]:
        """Ask for them."""
        return await self._points(self._last)

    async def points_of_a_minute(self) -> list[RawPoint]:
        """Ask for them."""
        return await self._points(self._minute)

    async def _points(self, body: bytes) -> list[RawPoint]:
        found = []
        for point in parse_rows(await self._server.ask("/api/v3/query_sql", body=body), self._tag):
            if point is None:
                self.malformed += 1
            else:
                found.append(point)
        return found


def _body(database: str, sql: str) -> bytes:
    return json.dumps({"db": database, "q": sql, "format": "jsonl"}).encode()


def sql_of_newest(table: str, tag: str, window_s: float) -> str:
    """The query for the newest row of each device."""
    since = f"now() - INTERVAL '{max(1, round(1000 * window_s))} milliseconds'"
    rank = f"ROW_NUMBER() OVER (PARTITION BY {_quoted(tag)} ORDER BY time DESC) AS {_RANK}"
    inner = " ".join(("SELECT *,", rank, "FROM", _quoted(table), "WHERE time >=", since))
    return " ".join(("SELECT * FROM (", inner, ") AS devices WHERE", _RANK, "= 1"))


def parse_rows(text: str, tag: str) -> Iterator[RawPoint | None]:
    """The points of an answer in JSON lines, whose times are UTC; None for a line that is none."""
    for line in text.splitlines():
        if not line.strip():
            continue
        try:
            row: Any = json.loads(line)
            yield RawPoint(str(row[tag]), stamp_of_text(row["time"]), row)
        except (ValueError, KeyError, TypeError, AttributeError):
            yield None


def _quoted(name: str) -> str:
    """A name of SQL."""
    escaped = name.replace('"', '""')
    return f'"{escaped}"'
