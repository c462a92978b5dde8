r"""InfluxDB line protocol: pure.

``measurement,tag=value field=1.5,other=2i,text="a b" 1700000000000000000``. A backslash takes the meaning
from commas, spaces and equals signs; text fields are quoted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from simple_ros.errors import SimpleRosError

__all__ = [
    "PRECISIONS_NS",
    "BadLine",
    "FieldValue",
    "Point",
    "flexric_line",
    "newest_fields",
    "parse_fields",
    "parse_line",
    "parse_lines",
    "parse_tags",
    "tag_text",
]

FieldValue = float | int | bool | str

PRECISIONS_NS = {"ns": 1, "n": 1, "u": 1000, "us": 1000, "ms": 1_000_000, "s": 1_000_000_000}
"""Nanoseconds in a unit of time."""

_LONGEST = 64 * 1024
_LONGEST_INTEGER = 40
_LATEST_NS = (1 << 63) - 1
# Possessive where it repeats a character: what was read is never read again in another way. Not where it repeats
# a group: early versions of CPython 3.11 match those wrongly, and each group begins with a sign of its own.
_NAME = r"[^,= \\\n]*+(?:\\.[^,= \\\n]*+)*"
_NUMBER = r"[-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d++)?[iu]?+"
_TEXT = r'"[^"\\]*(?:\\.[^"\\]*)*"'
_FIELD = rf"{_NAME}=(?:{_NUMBER}|{_TEXT}|true|True|TRUE|false|False|FALSE|[tTfF])"
_LINE = re.compile(
    rf"(?P<measurement>[^, \\\n]*(?:\\.[^, \\\n]*)*)(?P<tags>(?:,{_NAME}={_NAME})*) +"
    rf"(?P<fields>{_FIELD}(?:,{_FIELD})*)(?: +(?P<stamp>-?\d+))?\s*"
)
_ONE_FIELD = re.compile(rf"({_NAME})=({_TEXT}|[^,]+)")
_ONE_TAG = re.compile(rf",({_NAME})=({_NAME})")
_ESCAPE = re.compile(r"\\(.)")
_TRUE = {"t", "T", "true", "True", "TRUE"}
_FALSE = {"f", "F", "false", "False", "FALSE"}


class BadLine(SimpleRosError, ValueError):
    """A line is no line protocol.

    Attributes:
        number: Which, from 1.
    """

    def __init__(self, number: int, line: str) -> None:
        self.number = number
        shown = line if len(line) <= 80 else f"{line[:77]}..."
        super().__init__(f"line {number} is no line protocol: {shown!r}")


@dataclass(frozen=True, slots=True)
class Point:
    """One line.

    Attributes:
        measurement: Name of the measurement.
        tags: As written, with a comma before each, unsorted; `parse_tags` reads them.
        fields: As written; `parse_fields` reads them.
        stamp_ns: ns since 1970; None if the line has none.
    """

    measurement: str
    tags: str
    fields: str
    stamp_ns: int | None


def parse_line(line: str, number: int = 1, unit_ns: int = 1) -> Point:
    """Check a line and cut it into parts.

    Raises:
        BadLine: It is none, is longer than 64 KiB, or its stamp is beyond 64 bits of nanoseconds.
    """
    found = _LINE.fullmatch(line) if len(line) <= _LONGEST else None
    if found is None or not found["measurement"]:
        raise BadLine(number, line)
    text = found["stamp"]
    stamp_ns = None if text is None else int(text[:_LONGEST_INTEGER]) * unit_ns
    if stamp_ns is not None and abs(stamp_ns) > _LATEST_NS:
        raise BadLine(number, line)
    return Point(_plain(found["measurement"]), found["tags"], found["fields"], stamp_ns)


def parse_lines(text: str, unit_ns: int = 1) -> Iterator[Point | BadLine]:
    """The points of a text; in place of a bad line, what is wrong with it. Comments are left out."""
    for number, line in enumerate(text.split("\n"), 1):
        if line and not line.isspace() and not line.startswith("#"):
            try:
                yield parse_line(line, number, unit_ns)
            except BadLine as error:
                yield error


def parse_tags(text: str) -> dict[str, str]:
    """Tags by name, sorted."""
    return dict(sorted((_plain(name), _plain(value)) for name, value in _ONE_TAG.findall(text)))


def tag_text(tags: dict[str, str]) -> str:
    """Tags in their one normal form, as `parse_tags` reads it."""
    return "".join(f",{_escaped(name)}={_escaped(tags[name])}" for name in sorted(tags))


def parse_fields(text: str) -> dict[str, FieldValue]:
    """Fields by name; of one that comes twice, the last."""
    return {_plain(name): _value(value) for name, value in _ONE_FIELD.findall(text)}


def newest_fields(text: str) -> str:
    """Fields as written, of one that comes twice only the last."""
    return ",".join(f"{name}={value}" for name, value in dict(_ONE_FIELD.findall(text)).items())


def _value(text: str) -> FieldValue:
    if text[0] == '"':
        return _ESCAPE.sub(r"\1", text[1:-1])
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if text[-1] in "iu" and len(text) <= _LONGEST_INTEGER:
        return int(text[:-1].split(".")[0])
    return float(text.rstrip("iu"))


def _plain(text: str) -> str:
    return _ESCAPE.sub(r"\1", text) if "\\" in text else text


def _escaped(text: str) -> str:
    return re.sub(r"([,= \\])", r"\\\1", text)


def flexric_line(text: str) -> str:
    """What FlexRIC's xApp sends (``mac_stats: tstamp=..,rnti=4601,...``) as line protocol.

    The RNTI becomes a tag; the stamp, microseconds, becomes the line's. Other text comes back as it is.
    """
    name, colon, rest = text.partition(":")
    if not colon or " " in name or "=" in name:
        return text
    pairs = [part.partition("=") for part in rest.strip().split(",")]
    values = {key.strip(): value.strip() for key, _, value in pairs}
    rnti, stamp = values.pop("rnti", ""), values.pop("tstamp", "")
    fields = ",".join(f"{key}={value}" for key, value in values.items() if value)
    tag = f",rnti={rnti}" if rnti else ""
    when = f" {stamp}000" if stamp.isdigit() else ""
    return f"{name}{tag} {fields}{when}"
