"""What the commands print: pure functions from messages and numbers to text.

Only `say` does anything.
"""

from __future__ import annotations

import base64
import datetime as dt
import json
import math
import os
import statistics
import struct
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from enum import Enum
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.errors import SimpleRosError

if TYPE_CHECKING:
    from google.protobuf.message import Message

# Their stubs know two unrelated classes for each of these.
Descriptor = Any
FieldDescriptor = Any

__all__ = [
    "BadMessageText",
    "JsonOption",
    "MasterOption",
    "Spread",
    "Style",
    "StyleOption",
    "UnknownField",
    "UnknownName",
    "bandwidth_facts",
    "bandwidth_line",
    "check_path",
    "columns",
    "cpp_text",
    "delay_facts",
    "delay_line",
    "duration_text",
    "field_json",
    "field_text",
    "json_line",
    "message_json",
    "message_of",
    "rate_facts",
    "rate_line",
    "say",
    "size_text",
    "split_path",
    "spread",
    "stamp_path",
    "yaml_text",
]

_TIMESTAMP = "google.protobuf.Timestamp"
_WELL_KNOWN = "google.protobuf."
_MAX_ELEMENTS = 64
_MAX_BYTES = 16


class Style(Enum):
    """How something is written."""

    READABLE = "readable"
    CPP = "cpp"


MasterOption = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT",
        help="Where the Master is.",
        show_default="$SIMPLE_ROS_MASTER, else localhost:50051",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="JSON, for programs.")]
StyleOption = Annotated[
    Style, typer.Option("--format", help="For people, or as the tools of C++ simple_ros.")
]


class UnknownName(SimpleRosError, LookupError):
    """The Master knows no such node or topic.

    Attributes:
        kind: ``"node"`` or ``"topic"``.
        name: The name asked for.
        near: Known names that look like it.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str] = ()) -> None:
        self.kind = kind
        self.name = name
        names = sorted(set(known))
        alike = get_close_matches(name, names, n=3, cutoff=0.6)
        holding = [other for other in names if name and name in other]
        self.near = tuple(dict.fromkeys(alike + holding))[:3]
        near = " or ".join(map(repr, self.near))
        hint = f"did you mean {near}?" if near else f"see 'simple-ros {kind} list'"
        super().__init__(f"no {kind} {name!r}; {hint}")


class UnknownField(SimpleRosError, LookupError):
    """A message type has no such field.

    Attributes:
        field: The name asked for.
        type_name: The type that should have it.
        where: Path of the part of the message that has this type, empty for the whole.
        known: The fields it has.
    """

    def __init__(self, field: str, type_name: str, where: str, known: Iterable[str]) -> None:
        self.field = field
        self.type_name = type_name
        self.where = where
        self.known = tuple(known)
        place = f" (at {where!r})" if where else ""
        has = f"its fields are {', '.join(self.known)}" if self.known else "it has no fields"
        super().__init__(f"{type_name}{place} has no field {field!r}; {has}")


class BadMessageText(SimpleRosError, ValueError):
    """A text does not describe a message of the wanted type; the message says why."""


def say(text: str) -> None:
    """Print at once; end quietly when nobody reads any more (``| head``)."""
    try:
        print(text.removesuffix("\n"), flush=True)
    except BrokenPipeError:
        # Otherwise the interpreter complains when it flushes once more at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit from None


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as text in which every column begins at the same place."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
    return "\n".join(lines)


def json_line(value: Any) -> str:
    """A JSON document in one line."""
    return json.dumps(value, ensure_ascii=False)


# -- fields ----------------------------------------------------------------------------------------


def _is_repeated(field: FieldDescriptor) -> bool:
    return bool(field.is_repeated)


def _is_map(field: FieldDescriptor) -> bool:
    return field.message_type is not None and field.message_type.GetOptions().map_entry


def split_path(path: str) -> tuple[str, ...]:
    """``poses[0].x`` and ``poses.0.x`` as ``("poses", "0", "x")``."""
    return tuple(path.replace("[", ".").replace("]", "").split("."))


def check_path(descriptor: Descriptor, path: Sequence[str]) -> None:
    """See that messages of a type can have what a path leads to.

    Raises:
        UnknownField: A part of it is no field.
        SimpleRosError: It goes into a single value, or into a list without an index.
    """
    inner: Descriptor | None = descriptor
    listed = False
    for depth, part in enumerate(path):
        where = ".".join(path[:depth])
        if listed:
            if not part.isdigit():
                raise SimpleRosError(f"{where!r} is a list: {where}[0] is its first element")
            listed = False
        elif inner is None:
            raise SimpleRosError(f"{where!r} is a single value: it has no field {part!r}")
        else:
            field = _named(inner, part, where)
            listed = _is_repeated(field) and not _is_map(field)
            inner = None if _is_map(field) else field.message_type


def _named(descriptor: Descriptor, name: str, where: str) -> FieldDescriptor:
    field = descriptor.fields_by_name.get(name)
    if field is None:
        raise UnknownField(name, descriptor.full_name, where, descriptor.fields_by_name)
    return field


def _resolved(message: Message, path: Sequence[str]) -> tuple[Message, FieldDescriptor, int | None]:
    """The part of a message that has the last named field of a checked path; an index if that ends it.

    Raises:
        IndexError: A list of this message is shorter than the path wants.
    """
    parent, value = message, message
    field: FieldDescriptor = None
    index: int | None = None
    for part in path:
        if field is not None and _is_repeated(field) and index is None:
            index = int(part)
            value = value[index]  # type: ignore[index]
        else:
            parent, index = value, None
            field = parent.DESCRIPTOR.fields_by_name[part]
            value = getattr(parent, part)
    return parent, field, index


def field_text(message: Message, path: Sequence[str], *, full: bool = False) -> str:
    """What a checked path leads to, as readable text.

    Raises:
        IndexError: A list of this message is shorter than the path wants.
    """
    parent, field, index = _resolved(message, path)
    value = getattr(parent, field.name)
    if index is not None:
        return _value_text(field, value[index], full=full)
    if _is_repeated(field):
        return "\n".join(_repeated_lines("", field, value, full=full)).removeprefix(": ")
    return _value_text(field, value, full=full)


def field_json(message: Message, path: Sequence[str]) -> Any:
    """What a checked path leads to, as a value for JSON.

    Raises:
        IndexError: A list of this message is shorter than the path wants.
    """
    parent, field, index = _resolved(message, path)
    if parent.DESCRIPTOR.full_name.startswith(_WELL_KNOWN):
        return getattr(parent, field.name)
    value = message_json(parent).get(field.name)
    return value if index is None or value is None else value[index]


def message_json(message: Message) -> Any:
    """A message as a value for JSON: field names as in the .proto file, zeros written.

    Raises:
        ValueError: It cannot be written, such as a time after the year 9999.
    """
    from google.protobuf import json_format

    try:
        return json_format.MessageToDict(
            message,
            preserving_proto_field_name=True,
            always_print_fields_with_no_presence=True,
        )
    except json_format.SerializeToJsonError as error:
        raise ValueError(str(error)) from None


def stamp_path(descriptor: Descriptor) -> tuple[str, ...]:
    """Where messages of a type carry their time: ``header.stamp`` or ``stamp``.

    Raises:
        SimpleRosError: Nowhere.
    """
    for path in (("header", "stamp"), ("stamp",)):
        inner: Descriptor | None = descriptor
        for name in path:
            field = inner.fields_by_name.get(name) if inner is not None else None
            inner = None if field is None or _is_repeated(field) else field.message_type
        if inner is not None and inner.full_name == _TIMESTAMP:
            return path
    raise SimpleRosError(
        f"{descriptor.full_name} has neither header.stamp nor stamp of type {_TIMESTAMP}: "
        "its messages do not tell their delay"
    )


# -- messages as text ------------------------------------------------------------------------------


def yaml_text(message: Message, *, full: bool = False) -> str:
    """A message as YAML-like text: all fields, also zeros; long lists and bytes cut unless ``full``."""
    return "\n".join(_message_lines(message, full=full)) or "{}"


def _message_lines(message: Message, *, full: bool) -> list[str]:
    lines: list[str] = []
    for field in message.DESCRIPTOR.fields:
        name = field.name
        if field.containing_oneof is not None and not message.HasField(name):
            continue
        if _is_repeated(field):
            lines += _repeated_lines(name, field, getattr(message, name), full=full)
        elif field.message_type is not None and not message.HasField(name):
            lines.append(f"{name}: {{}}")
        else:
            lines += _entry_lines(f"{name}:", field, getattr(message, name), full=full)
    return lines


def _entry_lines(start: str, field: FieldDescriptor, value: Any, *, full: bool) -> list[str]:
    text = _value_text(field, value, full=full)
    if "\n" not in text and not (field.message_type is not None and ": " in text):
        return [f"{start} {text}"]
    return [start, *(f"  {line}" for line in text.split("\n"))]


def _repeated_lines(name: str, field: FieldDescriptor, values: Any, *, full: bool) -> list[str]:
    if _is_map(field):
        return _map_lines(name, field, values, full=full)
    shown = values if full else values[:_MAX_ELEMENTS]
    missing = len(values) - len(shown)
    if field.message_type is None or not values:
        texts = [_value_text(field, value, full=full) for value in shown]
        if missing:
            texts.append(f"... {missing} more")
        return [f"{name}: [{', '.join(texts)}]"]
    lines = [f"{name}:"] if name else []
    for value in shown:
        first, *rest = _value_text(field, value, full=full).split("\n")
        lines += [f"- {first}", *(f"  {line}" for line in rest)]
    return [*lines, f"# ... {missing} more"] if missing else lines


def _map_lines(name: str, field: FieldDescriptor, values: Any, *, full: bool) -> list[str]:
    key, value = (field.message_type.fields_by_name[part] for part in ("key", "value"))
    if not values:
        return [f"{name}: {{}}"]
    lines = [f"{name}:"] if name else []
    for item in sorted(values):
        start = f"  {_value_text(key, item, full=full)}:"
        first, *rest = _entry_lines(start, value, values[item], full=full)
        lines += [first, *(f"  {line}" for line in rest)]
    return lines


def _value_text(field: FieldDescriptor, value: Any, *, full: bool) -> str:
    if field.message_type is not None:
        return _inner_text(value, full=full)
    if field.enum_type is not None:
        return _enum_text(field, value)
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False)
        case bytes():
            return _bytes_text(value, full=full)
        case float():
            return _float_text(value, single=field.type == field.TYPE_FLOAT)
        case _:
            return str(value)


def _inner_text(value: Any, *, full: bool) -> str:
    if value.DESCRIPTOR.full_name in (_TIMESTAMP, _WELL_KNOWN + "Duration"):
        try:
            return str(value.ToJsonString())
        except ValueError:
            pass  # out of range: the two numbers are shown
    return yaml_text(value, full=full)


def _enum_text(field: FieldDescriptor, value: int) -> str:
    known = field.enum_type.values_by_number.get(value)
    return str(value) if known is None else known.name


def _bytes_text(value: bytes, *, full: bool) -> str:
    shown = value if full else value[:_MAX_BYTES]
    more = " ..." if len(shown) < len(value) else ""
    return f"<{len(value)} bytes{' ' if value else ''}{shown.hex(' ')}{more}>"


def _float_text(value: float, *, single: bool) -> str:
    if not math.isfinite(value):
        return ".nan" if math.isnan(value) else (".inf" if value > 0 else "-.inf")
    if not single:
        return repr(value)
    for digits in range(6, 9):
        near = float(f"{value:.{digits}g}")
        if struct.pack("f", near) == struct.pack("f", value):
            return repr(near)
    return repr(float(f"{value:.9g}"))


def cpp_text(message: Message) -> str:
    """What ``rostopic echo`` of C++ simple_ros prints for a message, with its blank line.

    Numbers as protobuf's C++ ``SimpleDtoa`` writes them, which Python's text_format does not: 15 or
    17 digits (6 or 9 in single precision), no ``.0``.
    """
    lines = _cpp_lines(message)
    return "".join(f"{line}\n" for line in (f"[{message.DESCRIPTOR.full_name}]", *lines, ""))


def _cpp_lines(message: Message) -> list[str]:
    from google.protobuf import message_factory

    lines: list[str] = []
    for field, value in message.ListFields():
        if _is_map(field):
            pair: Descriptor = field.message_type
            entry = message_factory.GetMessageClass(pair)
            values = [entry(key=key, value=value[key]) for key in sorted(value)]
        else:
            values = value if _is_repeated(field) else [value]
        for item in values:
            if field.message_type is None:
                lines.append(f"{field.name}: {_cpp_value(field, item)}")
            else:
                inner = (f"  {line}" for line in _cpp_lines(item))
                lines += [f"{field.name} {{", *inner, "}"]
    return lines


def _cpp_value(field: FieldDescriptor, value: Any) -> str:
    from google.protobuf import text_encoding

    if field.enum_type is not None:
        return _enum_text(field, value)
    match value:
        case bool():
            return "true" if value else "false"
        case str() | bytes():
            raw = value.encode() if isinstance(value, str) else value
            return f'"{text_encoding.CEscape(raw, as_utf8=False)}"'
        case float():
            return _cpp_float(value, single=field.type == field.TYPE_FLOAT)
        case _:
            return str(value)


def _cpp_float(value: float, *, single: bool) -> str:
    short, long, code = (6, 9, "f") if single else (15, 17, "d")
    text = f"{value:.{short}g}"
    if not math.isfinite(value) or struct.pack(code, float(text)) == struct.pack(code, value):
        return text
    return f"{value:.{long}g}"


# -- text as a message -----------------------------------------------------------------------------


def message_of(message_class: type[Message], text: str) -> Message:
    """The message that YAML or JSON describes.

    Raises:
        UnknownField: The type has no field of a given name.
        BadMessageText: The text is no YAML or a value does not fit its field.
    """
    import yaml
    from google.protobuf import json_format

    descriptor = message_class.DESCRIPTOR
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        reason = getattr(error, "problem", None) or str(error)
        mark = getattr(error, "problem_mark", None)
        place = f", line {mark.line + 1}, column {mark.column + 1}" if mark is not None else ""
        raise BadMessageText(f"the message is not YAML: {_one_line(reason)}{place}") from None
    if value is None:
        value = {}
    if not isinstance(value, dict):
        fields = ", ".join(f"{name}: ..." for name in descriptor.fields_by_name)
        raise BadMessageText(
            f"{descriptor.full_name} is written as {{{fields}}}, not as {_one_line(text)!r}"
        )
    prepared = _prepared(descriptor, value, "")
    try:
        return json_format.ParseDict(prepared, message_class())
    except json_format.ParseError as error:
        reason = _one_line(str(error)).rstrip(".")
        raise BadMessageText(f"not a {descriptor.full_name}: {reason}") from None


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _prepared(descriptor: Descriptor, value: Any, where: str) -> Any:
    """A value of YAML as json_format wants it.

    Raises:
        UnknownField: The type has no field of a given name.
        BadMessageText: Something else stands where a message belongs.
    """
    if descriptor.full_name.startswith(_WELL_KNOWN):
        return _prepared_well_known(descriptor, value, where)
    if not isinstance(value, dict):
        raise BadMessageText(f"{where!r} is a {descriptor.full_name}, not {_one_line(str(value))}")
    fields = {field.json_name: field for field in descriptor.fields}
    fields |= {field.name: field for field in descriptor.fields}
    prepared = {}
    for name, item in value.items():
        if name not in fields:
            raise UnknownField(str(name), descriptor.full_name, where, descriptor.fields_by_name)
        field = fields[name]
        prepared[name] = _prepared_field(field, item, f"{where}.{name}" if where else name)
    return prepared


def _prepared_field(field: FieldDescriptor, value: Any, where: str) -> Any:
    if _is_map(field) and isinstance(value, dict):
        inner = field.message_type.fields_by_name["value"]
        return {
            _map_key(key): _prepared_field(inner, item, f"{where}.{key}")
            for key, item in value.items()
        }
    if _is_repeated(field) and isinstance(value, list):
        return [_prepared_item(field, item, f"{where}.{i}") for i, item in enumerate(value)]
    return _prepared_item(field, value, where)


def _map_key(key: Any) -> str:
    return str(key).lower() if isinstance(key, bool) else str(key)


def _prepared_item(field: FieldDescriptor, value: Any, where: str) -> Any:
    if field.message_type is None or value is None:
        return _plain(value)
    return _prepared(field.message_type, value, where)


def _prepared_well_known(descriptor: Descriptor, value: Any, where: str) -> Any:
    """Times may also be given by their two numbers, as in ROS."""
    pair = isinstance(value, dict) and value.keys() <= {"seconds", "nanos"}
    if not pair or descriptor.name not in ("Timestamp", "Duration"):
        return _plain(value)
    from google.protobuf import duration_pb2, timestamp_pb2

    made = duration_pb2.Duration if descriptor.name == "Duration" else timestamp_pb2.Timestamp
    try:
        return made(**value).ToJsonString()
    except (TypeError, ValueError) as error:
        raise BadMessageText(f"{where!r} is no time: {_one_line(str(error))}") from None


def _plain(value: Any) -> Any:
    """YAML knows more than JSON: times, bytes and numbers that are none."""
    match value:
        case dt.datetime():
            zoned = value if value.tzinfo else value.replace(tzinfo=dt.UTC)
            return zoned.isoformat()
        case dt.date():
            return value.isoformat()
        case bytes():
            return base64.b64encode(value).decode()
        case float() if not math.isfinite(value):
            return "NaN" if math.isnan(value) else ("Infinity" if value > 0 else "-Infinity")
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list():
            return [_plain(item) for item in value]
        case _:
            return value


# -- measurements ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean, smallest, largest and standard deviation (of the population) of some numbers."""

    mean: float
    minimum: float
    maximum: float
    deviation: float


def spread(values: Sequence[float]) -> Spread:
    """How some numbers, at least one, are spread."""
    mean = statistics.fmean(values)
    return Spread(mean, min(values), max(values), statistics.pstdev(values, mean))


def rate_facts(times_s: Sequence[float]) -> dict[str, Any] | None:
    """Rate and periods of messages that arrived at these times; None if they are too few."""
    if len(times_s) < 2 or times_s[-1] <= times_s[0]:
        return None
    periods = spread([late - early for early, late in pairwise(times_s)])
    return {
        "rate_hz": (len(times_s) - 1) / (times_s[-1] - times_s[0]),
        "min_s": periods.minimum,
        "max_s": periods.maximum,
        "stddev_s": periods.deviation,
        "window": len(times_s),
    }


def rate_line(facts: dict[str, Any]) -> str:
    """Rate and periods for people."""
    low, high, deviation = (duration_text(facts[name]) for name in ("min_s", "max_s", "stddev_s"))
    return (
        f"rate {facts['rate_hz']:.2f} Hz, period min {low} max {high} stddev {deviation}, "
        f"window {facts['window']}"
    )


def bandwidth_facts(times_s: Sequence[float], sizes: Sequence[int]) -> dict[str, Any] | None:
    """Bytes a second and sizes of messages that arrived at these times; None if they are too few."""
    if len(times_s) < 2 or times_s[-1] <= times_s[0]:
        return None
    return {
        # The first message begins the time that is measured: its own bytes came before.
        "bytes_per_s": sum(sizes[1:]) / (times_s[-1] - times_s[0]),
        "mean_bytes": statistics.fmean(sizes),
        "min_bytes": min(sizes),
        "max_bytes": max(sizes),
        "window": len(times_s),
    }


def bandwidth_line(facts: dict[str, Any]) -> str:
    """Bytes a second and sizes for people."""
    mean, low, high = (size_text(facts[f"{name}_bytes"]) for name in ("mean", "min", "max"))
    return (
        f"{size_text(facts['bytes_per_s'])}/s, size mean {mean} min {low} max {high}, "
        f"window {facts['window']}"
    )


def delay_facts(delays_s: Sequence[float]) -> dict[str, Any] | None:
    """Mean, smallest and largest delay; None if there is none."""
    if not delays_s:
        return None
    delays = spread([delay * 1e3 for delay in delays_s])
    return {
        "mean_ms": delays.mean,
        "min_ms": delays.minimum,
        "max_ms": delays.maximum,
        "window": len(delays_s),
    }


def delay_line(facts: dict[str, Any]) -> str:
    """Delays for people, with a word on clocks when one is negative."""
    line = (
        f"delay mean {facts['mean_ms']:.3f} ms min {facts['min_ms']:.3f} ms "
        f"max {facts['max_ms']:.3f} ms, window {facts['window']}"
    )
    if facts["min_ms"] >= 0:
        return line
    return f"{line}; negative: the clocks of the two hosts differ, so this is not valid"


def duration_text(seconds: float) -> str:
    """Seconds in a handy unit."""
    if abs(seconds) >= 1:
        return f"{seconds:.3f} s"
    return f"{seconds * 1e3:.3f} ms"


def size_text(count: float) -> str:
    """Bytes in a handy unit, of 1000."""
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} B" if unit == "B" else f"{count:.2f} {unit}"
        count /= 1000
    return f"{count:.2f} GB"
