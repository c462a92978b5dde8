"""The Flux that is understood: pure.

Two shapes, those of WirelessROS, with any spacing:
``from(bucket) |> range(start[, stop]) |> filter(...) |> last()`` and
``from(bucket) |> range(...) |> filter(...) |> group(columns: ["t"]) |> distinct(column: "t")``. Filters
are conjunctions of comparisons with ``==`` of ``r._measurement``, ``r._field`` and tags.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import datetime

from simple_ros.errors import SimpleRosError

__all__ = ["BadFlux", "FluxQuery", "parse_flux"]

_UNITS_NS = {
    "ns": 1,
    "us": 1000,
    "µs": 1000,
    "ms": 10**6,
    "s": 10**9,
    "m": 60 * 10**9,
    "h": 3600 * 10**9,
    "d": 86_400 * 10**9,
    "w": 7 * 86_400 * 10**9,
}
_LATEST_NS = (1 << 63) - 1
_DURATION = re.compile(r"(-?)((?:\d+(?:ns|us|µs|ms|s|m|h|d|w))+)")
_PART = re.compile(r"(\d+)(ns|us|µs|ms|s|m|h|d|w)")
_CALL = re.compile(r"(\w+)\s*\((.*)\)", re.DOTALL)
_SHAPES = "range, filter, then last() or group and distinct"


class BadFlux(SimpleRosError, ValueError):
    """A query is none of those understood; the message says what is not."""


@dataclass(frozen=True, slots=True)
class FluxQuery:
    """What a query asks.

    Attributes:
        bucket: Name of the bucket.
        start_ns: First moment, ns since 1970.
        stop_ns: First moment not asked for.
        equals: What ``_measurement``, ``_field`` and tags must be.
        distinct: Tag whose values are asked for; None asks for the last value of each field.
    """

    bucket: str
    start_ns: int
    stop_ns: int
    equals: dict[str, str] = field(default_factory=dict)
    distinct: str | None = None


def parse_flux(text: str, now_ns: int) -> FluxQuery:
    """Read a query.

    Raises:
        BadFlux: It is none of those understood.
    """
    calls = [_call(step) for step in _steps(text)]
    if not calls or calls[0][0] != "from":
        raise BadFlux('a query begins with from(bucket: "...")')
    bucket = _quoted(calls[0][1], "bucket")
    start_ns, stop_ns = None, now_ns
    equals: dict[str, str] = {}
    ends: list[tuple[str, str]] = []
    for name, inside in calls[1:]:
        if name == "range":
            start_ns, stop_ns = _range(inside, now_ns)
        elif name == "filter":
            equals.update(_conditions(inside))
        else:
            ends.append((name, inside))
    if start_ns is None:
        raise BadFlux("a query needs range(start: ...)")
    if max(abs(start_ns), abs(stop_ns)) > _LATEST_NS:
        raise BadFlux("range reaches beyond the years 1677 to 2262")
    return FluxQuery(bucket, start_ns, stop_ns, equals, _end(ends))


def _steps(text: str) -> list[str]:
    return [step.strip() for step in text.strip().split("|>")]


def _call(step: str) -> tuple[str, str]:
    found = _CALL.fullmatch(step)
    if found is None:
        raise BadFlux(f"{step!r} is no call; understood are {_SHAPES}")
    return found[1], found[2].strip()


def _end(calls: list[tuple[str, str]]) -> str | None:
    names = [name for name, _ in calls if name not in ("group", "yield")]
    if names == ["last"]:
        return None
    if names == ["distinct"]:
        return _quoted(dict(calls)["distinct"], "column")
    raise BadFlux(f"a query that ends in {names or 'nothing'} is not understood, but {_SHAPES}")


def _quoted(inside: str, name: str) -> str:
    found = re.search(rf'{name}\s*:\s*"((?:\\.|[^"\\])*)"', inside)
    if found is None:
        raise BadFlux(f'{name}: "..." is missing in ({inside})')
    return found[1].replace('\\"', '"').replace("\\\\", "\\")


def _range(inside: str, now_ns: int) -> tuple[int, int]:
    parts = dict(re.findall(r"(start|stop)\s*:\s*([^,\s]+)", inside))
    if "start" not in parts:
        raise BadFlux(f"start is missing in range({inside})")
    stop = _moment(parts["stop"], now_ns) if "stop" in parts else now_ns + 1
    return _moment(parts["start"], now_ns), stop


def _moment(text: str, now_ns: int) -> int:
    if text == "now()":
        return now_ns
    duration = _DURATION.fullmatch(text)
    if duration is not None:
        span = sum(int(count) * _UNITS_NS[unit] for count, unit in _PART.findall(duration[2]))
        return now_ns - span if duration[1] else now_ns + span
    if re.fullmatch(r"-?\d+", text):
        return int(text) * 10**9
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise BadFlux(
            f"{text!r} is no moment: a duration, a time of RFC 3339, or seconds"
        ) from None
    if moment.tzinfo is None:
        raise BadFlux(f"{text!r} needs a time zone, such as Z")
    return int(moment.timestamp()) * 10**9 + moment.microsecond * 1000


_CONDITION = re.compile(
    r"""\s*\(?\s*r(?:\.(\w+)|\[\s*"([^"]+)"\s*\])\s*==\s*"((?:\\.|[^"\\])*)"\s*\)?\s*"""
)


def _conditions(inside: str) -> dict[str, str]:
    found = re.fullmatch(r"fn\s*:\s*\(\s*r\s*\)\s*=>\s*(.*)", inside, re.DOTALL)
    if found is None:
        raise BadFlux(f"filter({inside}) is no filter(fn: (r) => ...)")
    equals = {}
    for part in re.split(r"\band\b", found[1]):
        condition = _CONDITION.fullmatch(part)
        if condition is None:
            raise BadFlux(f'{part.strip()!r} is no comparison r.name == "value"')
        equals[condition[1] or condition[2]] = condition[3].replace('\\"', '"')
    return equals
