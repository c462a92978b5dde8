"""What is said when a connection to the link shaper begins: one line of JSON each way. Pure."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from simple_ros.errors import SimpleRosError

__all__ = [
    "MAX_LINE_BYTES",
    "BadHello",
    "Hello",
    "answer_line",
    "hello_line",
    "parse_hello",
    "refusal",
]

MAX_LINE_BYTES = 4096


class BadHello(SimpleRosError, ValueError):
    """A first line is none of ours."""


@dataclass(frozen=True, slots=True)
class Hello:
    """Who comes, and what for.

    Attributes:
        source: Site of the publisher; empty for who only wants to watch.
        target: Site of the subscriber.
        address: Of the subscriber, ``host:port``.
    """

    source: str = ""
    target: str = ""
    address: str = ""

    @property
    def watches(self) -> bool:
        """Whether records of the links are wanted, not a connection."""
        return not self.address


def hello_line(hello: Hello) -> bytes:
    """The first line of who dials."""
    body = {"source": hello.source, "target": hello.target, "address": hello.address}
    return json.dumps({"link_shaper": 1, **body}).encode() + b"\n"


def parse_hello(line: bytes) -> Hello:
    """What a first line says.

    Raises:
        BadHello: It is none of ours.
    """
    data = _object(line)
    if data.get("link_shaper") != 1:
        raise BadHello("not a node that uses the transport 'shaped'")
    return Hello(*(str(data.get(name, "")) for name in ("source", "target", "address")))


def answer_line(error: str = "") -> bytes:
    """The answer: welcome, or why not."""
    return json.dumps({"error": error}).encode() + b"\n"


def refusal(line: bytes) -> str:
    """Why an answer says no; empty if it says yes.

    Raises:
        BadHello: It is no answer.
    """
    return str(_object(line).get("error", ""))


def _object(line: bytes) -> dict[str, Any]:
    try:
        data = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise BadHello(f"not a line of JSON: {error}") from None
    if not isinstance(data, dict):
        raise BadHello("not a JSON object")
    return data
