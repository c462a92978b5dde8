"""The metrics store: points of series in SQLite, forgotten after a while."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from pathlib import Path

from simple_ros_engines.store.annotated_csv import LastValue
from simple_ros_engines.store.flux import FluxQuery
from simple_ros_engines.store.line_protocol import (
    FieldValue,
    Point,
    newest_fields,
    parse_fields,
    parse_tags,
    tag_text,
)

__all__ = ["MetricsStore"]

_SCHEMA = """
CREATE TABLE IF NOT EXISTS series(
    id INTEGER PRIMARY KEY, measurement TEXT NOT NULL, tags TEXT NOT NULL, UNIQUE(measurement, tags)
);
CREATE TABLE IF NOT EXISTS points(
    series INTEGER NOT NULL, stamp_ns INTEGER NOT NULL, fields TEXT NOT NULL,
    PRIMARY KEY(series, stamp_ns)
) WITHOUT ROWID;
"""
# Two points of one series and moment are one point with the fields of both.
_INSERT = """
INSERT INTO points VALUES(?, ?, ?)
ON CONFLICT DO UPDATE SET fields = merged(fields, excluded.fields)
"""
_SHORT = 4096
_FORGET_EVERY = 20_000
_FLUSH_EVERY = 5_000


class MetricsStore:
    """Points of series, newest readable at once.

    Fields are kept as they were written and read when asked for; a field that none of the newest 20 points
    of a series has is not found. One thread uses it.

    Args:
        path: File; None keeps all in memory.
        retention_s: Older points are forgotten.
    """

    def __init__(self, path: Path | str | None = None, retention_s: float = 3600.0) -> None:
        self._db = sqlite3.connect(":memory:" if path is None else str(path))
        self._db.executescript(_SCHEMA)
        self._db.create_function("merged", 2, _merged, deterministic=True)
        self._db.execute("PRAGMA journal_mode=WAL")
        self._db.execute("PRAGMA synchronous=NORMAL")
        self._retention_ns = int(retention_s * 1e9)
        self._ids: dict[tuple[str, str], int] = {}
        self._tags: dict[int, tuple[str, dict[str, str]]] = {}
        for number, measurement, tags in self._db.execute(
            "SELECT id, measurement, tags FROM series"
        ):
            self._ids[measurement, tags] = number
            self._tags[number] = (measurement, parse_tags(tags))
        self._since_forgetting = 0
        self._unwritten = 0
        self._fresh: dict[int, tuple[int, str]] = {}

    def write(self, points: Iterable[Point], now_ns: int) -> int:
        """Take points; those without a stamp get ``now_ns``. Gives how many.

        They can be read at once, and are in the file after `flush` or when many have come.
        """
        rows = [
            (
                self._series(point.measurement, point.tags),
                now_ns if point.stamp_ns is None else point.stamp_ns,
                point.fields,
            )
            for point in points
        ]
        self._db.executemany(_INSERT, rows)
        for number, stamp_ns, fields in rows:
            before_ns, before = self._fresh.get(number, (None, ""))
            both = _merged(before, fields) if before_ns == stamp_ns else fields
            self._fresh[number] = (stamp_ns, both)
        self._unwritten += len(rows)
        if self._unwritten >= _FLUSH_EVERY:
            self.flush()
        self._since_forgetting += len(rows)
        if self._since_forgetting >= _FORGET_EVERY:
            self.forget(now_ns)
        return len(rows)

    def flush(self) -> None:
        """Bring what was taken into the file."""
        if self._unwritten:
            self._db.commit()
            self._unwritten = 0

    def _series(self, measurement: str, tags: str) -> int:
        number = self._ids.get((measurement, tags))
        return self._new_series(measurement, tags) if number is None else number

    def _new_series(self, measurement: str, tags: str) -> int:
        parsed = parse_tags(tags)
        normal = tag_text(parsed)
        number = self._ids.get((measurement, normal))
        if number is None:
            with self._db:
                cursor = self._db.execute(
                    "INSERT INTO series(measurement, tags) VALUES(?, ?)", (measurement, normal)
                )
            assert cursor.lastrowid is not None
            number = self._ids[measurement, normal] = cursor.lastrowid
            self._tags[number] = (measurement, parsed)
        if len(self._ids) < 100_000:
            self._ids[measurement, tags] = number
        return number

    def forget(self, now_ns: int) -> None:
        """Drop points older than the retention."""
        self._since_forgetting = 0
        with self._db:
            for number in self._tags:
                self._db.execute(
                    "DELETE FROM points WHERE series = ? AND stamp_ns < ?",
                    (number, now_ns - self._retention_ns),
                )

    def fresh(self, measurement: str) -> list[tuple[dict[str, str], int, dict[str, FieldValue]]]:
        """Of each series of a measurement that was written since the last call, the point written last.

        Gives tags, stamp and fields. What the stamp says does not matter: the clock of a writer may be wrong.
        """
        points, self._fresh = self._fresh, {}
        return [
            (self._tags[number][1], stamp_ns, parse_fields(fields))
            for number, (stamp_ns, fields) in points.items()
            if self._tags[number][0] == measurement
        ]

    def matching(self, equals: dict[str, str]) -> list[int]:
        """Series whose measurement and tags are those; ``_field`` is not looked at."""
        wanted = {name: value for name, value in equals.items() if name != "_field"}
        measurement = wanted.pop("_measurement", None)
        return [
            number
            for number, (found, tags) in self._tags.items()
            if measurement in (None, found)
            and all(tags.get(name) == value for name, value in wanted.items())
        ]

    def last(self, query: FluxQuery) -> list[LastValue]:
        """The newest value of each field of each matching series in the span."""
        found = []
        only = query.equals.get("_field")
        for number in self.matching(query.equals):
            measurement, tags = self._tags[number]
            for name, (value, stamp_ns) in sorted(self._newest(number, query).items()):
                if only in (None, name):
                    found.append(LastValue(measurement, tags, name, value, stamp_ns))
        return found

    def _newest(
        self, number: int, query: FluxQuery
    ) -> dict[str, tuple[float | int | bool | str, int]]:
        rows = self._db.execute(
            "SELECT stamp_ns, fields FROM points WHERE series = ? AND stamp_ns >= ? AND stamp_ns < ?"
            " ORDER BY stamp_ns DESC LIMIT 20",
            (number, query.start_ns, query.stop_ns),
        )
        newest: dict[str, tuple[float | int | bool | str, int]] = {}
        texts: set[str] = set()
        for stamp_ns, text in rows:
            # Points of a series nearly always have the same fields: the newest has them all.
            names = ",".join(part.partition("=")[0] for part in text.split(","))
            if names not in texts:
                texts.add(names)
                for name, value in parse_fields(text).items():
                    newest.setdefault(name, (value, stamp_ns))
        return newest

    def distinct(self, query: FluxQuery) -> list[str]:
        """Values of a tag among matching series with points in the span."""
        assert query.distinct is not None
        values = set()
        for number in self.matching(query.equals):
            value = self._tags[number][1].get(query.distinct)
            if value is not None and value not in values and self._has_points(number, query):
                values.add(value)
        return sorted(values)

    def _has_points(self, number: int, query: FluxQuery) -> bool:
        row = self._db.execute(
            "SELECT 1 FROM points WHERE series = ? AND stamp_ns >= ? AND stamp_ns < ? LIMIT 1",
            (number, query.start_ns, query.stop_ns),
        ).fetchone()
        return row is not None

    def close(self) -> None:
        """Close the file."""
        self.flush()
        self._db.close()


def _merged(before: str, more: str) -> str:
    """Fields of both, as written. A writer that repeats one moment for ever must not fill the store."""
    both = f"{before},{more}"
    return both if len(both) <= _SHORT else newest_fields(both)
