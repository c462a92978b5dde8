"""Names of topics and nodes.

One topic whatever the leading slash: the canonical form, used in print and on the wire, has none.
``/x`` is accepted everywhere and means ``x``. Two levels of strictness:

* what a user of this library writes is *validated* (`topic_name`, `node_name`);
* what a peer sends is only *canonicalised* (`canonical`), since other implementations accept any
  string and must still be served.

A node in a namespace says which name it means by how it begins (`resolve`): ``chatter`` is relative
to the namespace, ``/chatter`` is absolute, ``~gain`` belongs to the node. Without a namespace the
first two are the same.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from simple_ros.errors import InvalidName

__all__ = [
    "MAX_NAME_BYTES",
    "Scope",
    "canonical",
    "namespace_name",
    "node_name",
    "parameter_name",
    "resolve",
    "topic_name",
]

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


def parameter_name(name: str) -> str:
    """Validate the full name of a parameter and return its canonical form.

    Raises:
        InvalidName: With a caret under the first character that is wrong.
    """
    return _validated("parameter", name)


def namespace_name(name: str) -> str:
    """Validate a namespace and return its canonical form; ``/`` and nothing are the outermost one.

    Raises:
        InvalidName: With a caret under the first character that is wrong.
    """
    return "" if name in ("", "/") else _validated("namespace", name)


def resolve(name: str, *, kind: str = "topic", namespace: str = "", node: str = "") -> str:
    """The full canonical name that a name means in a node.

    Args:
        name: Relative, absolute (``/x``) or the node's own (``~x``, also written ``~/x``).
        kind: What is named, for the error.
        namespace: Canonical namespace of the node.
        node: Full canonical name of the node; with none, no name is the node's own.

    Raises:
        InvalidName: With a caret under the first character that is wrong.
    """
    if isinstance(name, str) and name.startswith("~") and node:
        return _joined(kind, node, name, 2 if name.startswith("~/") else 1)
    if isinstance(name, str) and not name.startswith("/") and namespace:
        return _joined(kind, namespace, name, 0)
    return _validated(kind, name)


@dataclass(frozen=True, slots=True)
class Scope:
    """What names mean in one node.

    Attributes:
        node: Full canonical name of the node.
        namespace: Its canonical namespace.
        remaps: Full canonical names by the full canonical names they replace.
    """

    node: str
    namespace: str = ""
    remaps: Mapping[str, str] = field(default_factory=dict)

    def resolve(self, name: str, kind: str = "topic") -> str:
        """The full canonical name that a name means, after remapping (which is done once).

        Raises:
            InvalidName: With a caret under the first character that is wrong.
        """
        full = resolve(name, kind=kind, namespace=self.namespace, node=self.node)
        return self.remaps.get(full, full)


def _joined(kind: str, prefix: str, name: str, start: int) -> str:
    full = f"{prefix}/{_checked(kind, name, start)}"
    if len(full.encode()) > MAX_NAME_BYTES:
        reason = f"is longer than {MAX_NAME_BYTES} bytes with its namespace {prefix!r}"
        raise InvalidName(kind, name, len(name), reason)
    return full


def _validated(kind: str, name: str) -> str:
    if not isinstance(name, str):
        raise TypeError(f"{kind} name must be a str, not {type(name).__name__}")
    return _checked(kind, name, 1 if name.startswith("/") else 0)


def _checked(kind: str, name: str, start: int) -> str:
    """What follows ``start``, if it is a name of tokens between slashes."""
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
    if char == "~":
        return "must not contain '~' (which begins a node's own name, as in '~gain')"
    return f"must not contain {char!r} (letters, digits, '_' and '/' only)"
