"""Names of topics and nodes.

One topic whatever the leading slash: the canonical form, used in print and on the wire, has none.
``/x`` is accepted everywhere and means ``x``. Two levels of strictness:

* what a user of this library writes is *validated* (`topic_name`, `node_name`);
* what a peer sends is only *canonicalised* (`canonical`), since other implementations accept any
  string and must still be served.
"""

from __future__ import annotations

import re

from simple_ros.errors import InvalidName

__all__ = ["MAX_NAME_BYTES", "canonical", "node_name", "topic_name"]

MAX_NAME_BYTES = 1024
"""Longest topic or type name a frame header may carry, in UTF-8 bytes."""

_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def canonical(name: str) -> str:
    """The form without leading slashes under which a peer's name is compared."""
    return name.lstrip("/")


def topic_name(name: str) -> str:
    """Validate a topic name and return its canonical form.

    Raises:
        InvalidName: With a caret under the first character that is wrong.
    """
    return _validated("topic", name)


def node_name(name: str) -> str:
    """Validate a node name and return its canonical form.

    Raises:
        InvalidName: With a caret under the first character that is wrong.
    """
    return _validated("node", name)


def _validated(kind: str, name: str) -> str:
    if not isinstance(name, str):
        raise TypeError(f"{kind} name must be a str, not {type(name).__name__}")
    start = 1 if name.startswith("/") else 0
    if len(name) == start:
        raise InvalidName(kind, name, 0, "is empty")
    position = start
    while True:
        match = _TOKEN.match(name, position)
        if match is None:
            raise InvalidName(kind, name, position, _why(name, position))
        position = match.end()
        if position == len(name):
            break
        if name[position] != "/":
            raise InvalidName(kind, name, position, _why(name, position))
        position += 1
    if len(name.encode()) > MAX_NAME_BYTES:
        raise InvalidName(kind, name, MAX_NAME_BYTES, f"is longer than {MAX_NAME_BYTES} bytes")
    return name[start:]


def _why(name: str, position: int) -> str:
    if position == len(name):
        return "ends with a slash"
    char = name[position]
    if char == "/":
        return "has an empty part between slashes"
    if char.isdigit():
        return "has a part that starts with a digit"
    return f"must not contain {char!r} (letters, digits, '_' and '/' only)"
