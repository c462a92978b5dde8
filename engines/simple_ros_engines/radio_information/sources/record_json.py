"""Records as lines of JSON, to record and replay: pure."""

from __future__ import annotations

import json
import math
from typing import Any

from simple_ros.errors import SimpleRosError
from simple_ros_engines.radio_information.record import (
    FIELDS,
    LinkRecord,
    Quality,
    parse_rnti,
    record,
)

__all__ = ["BadRecord", "from_json", "to_json"]


_LATEST_NS = (1 << 63) - 1


class BadRecord(SimpleRosError, ValueError):
    """A line is no record."""


def to_json(item: LinkRecord) -> str:
    """One line."""
    quality = {name: value.name.lower() for name, value in item.quality.items()}
    line: dict[str, Any] = {"link": item.link_id, "stamp_ns": item.stamp_ns, "source": item.source}
    if item.rnti is not None:
        line["rnti"] = item.rnti
    return json.dumps({**line, "values": dict(item.values), "quality": quality})


def from_json(text: str) -> LinkRecord:
    """The record of a line. Unknown fields are left out, impossible values withheld.

    Raises:
        BadRecord: It is none.
    """
    try:
        line = json.loads(text)
        link, stamp_ns, values = str(line["link"]), int(line["stamp_ns"]), dict(line["values"])
        known = {name: float(value) for name, value in values.items() if name in FIELDS}
        told = dict(line.get("quality", {}))
        marks = {name: Quality[str(mark).upper()] for name, mark in told.items()}
        rnti = None if line.get("rnti") is None else int(line["rnti"])
        _check(link, stamp_ns, rnti)
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise BadRecord(f"no record: {error!r} in {text[:80]!r}") from error
    source = str(line.get("source", "replay"))
    checked = record(link, stamp_ns, source, known, rnti=rnti)
    said = {
        name: mark
        for name, mark in marks.items()
        if name in FIELDS and (name in checked.values or mark is Quality.OUT_OF_RANGE)
    }
    finite = {name: value for name, value in checked.values.items() if math.isfinite(value)}
    quality = {**checked.quality, **said}
    return LinkRecord(link, stamp_ns, source, checked.rnti, finite, quality)


def _check(link: str, stamp_ns: int, rnti: int | None) -> None:
    """What a message about a record can hold.

    Raises:
        ValueError: It cannot hold this.
    """
    if not link:
        raise ValueError("the link has no name")
    if not 0 <= stamp_ns <= _LATEST_NS:
        raise ValueError(f"stamp_ns is {stamp_ns}")
    if rnti is not None and parse_rnti(rnti) is None:
        raise ValueError(f"rnti is {rnti}")
