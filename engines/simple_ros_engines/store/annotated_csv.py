"""Answers to Flux as InfluxDB 2 writes them: annotated CSV. Pure."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from simple_ros_engines.store.line_protocol import FieldValue

__all__ = [
    "LastValue",
    "distinct_csv",
    "last_csv",
    "parse_distinct_csv",
    "parse_last_csv",
    "stamp_of_text",
]


@dataclass(frozen=True, slots=True)
class LastValue:
    """The newest value of one field of one series.

    Attributes:
        measurement: Name of the measurement.
        tags: Of the series.
        name: Of the field.
        value: Its value.
        stamp_ns: When.
    """

    measurement: str
    tags: dict[str, str]
    name: str
    value: FieldValue
    stamp_ns: int


def last_csv(values: Iterable[LastValue], start_ns: int, stop_ns: int) -> str:
    """The answer to ``last()``: a table for each series and field."""
    blocks: dict[tuple[str, tuple[str, ...]], list[LastValue]] = {}
    for value in values:
        blocks.setdefault((_type(value.value), tuple(value.tags)), []).append(value)
    span = [_time(start_ns), _time(stop_ns)]
    out, table = [], 0
    for (kind, names), rows in blocks.items():
        types = ["string", "long", *["dateTime:RFC3339"] * 3, kind, *["string"] * (2 + len(names))]
        group = ["false", "false", "true", "true", "false", "false", *["true"] * (2 + len(names))]
        header = ["result", "table", "_start", "_stop", "_time", "_value", "_field", "_measurement"]
        lines = []
        for row in rows:
            shown = _text(row.value)
            tags = [row.tags[name] for name in names]
            lines.append(
                [
                    "",
                    str(table),
                    *span,
                    _time(row.stamp_ns),
                    shown,
                    row.name,
                    row.measurement,
                    *tags,
                ]
            )
            table += 1
        out.append(_block(types, group, [*header, *names], lines))
    return "\r\n".join(out)


def distinct_csv(column: str, values: Sequence[str]) -> str:
    """The answer to ``group(columns: [c]) |> distinct(column: c)``: a table for each value."""
    if not values:
        return ""
    lines = [["", str(table), value, value] for table, value in enumerate(values)]
    return _block(
        ["string", "long", "string", "string"],
        ["false", "false", "true", "false"],
        ["result", "table", column, "_value"],
        lines,
    )


def _block(types: list[str], group: list[str], header: list[str], lines: list[list[str]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\r\n")
    writer.writerow(["#datatype", *types])
    writer.writerow(["#group", *group])
    writer.writerow(["#default", "_result", *[""] * (len(types) - 1)])
    writer.writerow(["", *header])
    writer.writerows([["", *line] for line in lines])
    return text.getvalue()


def _type(value: FieldValue) -> str:
    if isinstance(value, bool):
        return "boolean"
    return {int: "long", float: "double", str: "string"}[type(value)]


def _text(value: FieldValue) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _time(stamp_ns: int) -> str:
    seconds, rest = divmod(stamp_ns, 10**9)
    moment = datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return f"{moment}.{rest:09d}Z"


_NOT_TAGS = {"", "result", "table", "_start", "_stop", "_time", "_value", "_field", "_measurement"}


def parse_last_csv(text: str) -> Iterator[LastValue]:
    """The values of an answer to ``last()``; rows that have not what it takes are left out."""
    for row, kinds in _rows(text):
        value = _read(row, kinds.get("_value", "string"))
        if value is not None:
            yield value


def parse_distinct_csv(text: str) -> Iterator[str]:
    """The values of an answer to ``distinct()``."""
    return (row["_value"] for row, _ in _rows(text) if row.get("_value"))


def _rows(text: str) -> Iterator[tuple[dict[str, str], dict[str, str]]]:
    """Rows and the types of their columns, by name."""
    types: list[str] = []
    header: list[str] = []
    for row in csv.reader(io.StringIO(text)):
        if row and row[0] == "#datatype":
            types, header = row, []
        elif not row or row[0].startswith("#"):
            continue
        elif not header:
            header = row
        else:
            yield (
                dict(zip(header, row, strict=False)),
                dict(zip(header, types, strict=False)),
            )


def _read(row: Mapping[str, str], kind: str) -> LastValue | None:
    try:
        stamp_ns = stamp_of_text(row["_time"])
        value = _parsed(row["_value"], kind)
        tags = {name: text for name, text in row.items() if name not in _NOT_TAGS}
        return LastValue(row["_measurement"], tags, row["_field"], value, stamp_ns)
    except (KeyError, ValueError):
        return None


def _parsed(text: str, kind: str) -> FieldValue:
    if kind == "double":
        return float(text)
    if kind in ("long", "unsignedLong"):
        return int(text)
    return text == "true" if kind == "boolean" else text


def stamp_of_text(text: str) -> int:
    """Nanoseconds of a time of RFC 3339; `datetime` knows no parts below microseconds."""
    whole, dot, rest = text.removesuffix("Z").partition(".")
    digits = rest[: len(rest) - len(rest.lstrip("0123456789"))] if dot else ""
    zone = rest[len(digits) :] or "+00:00"
    moment = datetime.fromisoformat(f"{whole}{zone}" if "+" not in whole else whole)
    return int(moment.timestamp()) * 10**9 + int(f"{digits:0<9}"[:9])
