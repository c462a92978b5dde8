"""Parameters of nodes: sets written by node name, and the words a node program gets. Pure.

A set is a mapping from node names to parameters, as in a parameter file::

    /**:
      rate: 10.0
    robot1/camera:
      exposure: {auto: true}

``*`` in a name stands for one part of it and ``**`` for any number; a name with no leading slash fits
the end of a node's name. ROS 2's level ``ros__parameters`` may stand between name and parameters.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from simple_ros.launch.errors import LaunchFileError
from simple_ros.launch.source import Entry, Value

__all__ = ["NODE_LEVEL", "check_set", "fits", "merged", "parameter_words", "parameters_for"]

NODE_LEVEL = "ros__parameters"


def check_set(entry: Entry) -> None:
    """See whether something is a set of parameters by node name.

    Raises:
        LaunchFileError: It is not.
    """
    if not isinstance(entry.value, dict):
        raise LaunchFileError(entry.place, f"must be node names with parameters, not {entry.kind}")
    for name, parameters in entry.value.items():
        inner = parameters.value
        if isinstance(inner, dict) and NODE_LEVEL in inner:
            parameters = inner[NODE_LEVEL]
        if not isinstance(parameters.value, dict):
            raise LaunchFileError(
                parameters.place,
                f"under the node name {name!r} (or /** for all) parameters must stand, "
                f"not {parameters.kind}",
            )


def fits(pattern: str, name: str) -> bool:
    """Whether a node's canonical name is meant by a name in a set."""
    parts = name.split("/")
    if not pattern.startswith("/"):
        pattern = f"**/{pattern}"
    return _fits(pattern.lstrip("/").split("/"), parts)


def _fits(pattern: Sequence[str], parts: Sequence[str]) -> bool:
    if not pattern:
        return not parts
    if pattern[0] == "**":
        return any(_fits(pattern[1:], parts[skipped:]) for skipped in range(len(parts) + 1))
    return bool(parts) and pattern[0] in ("*", parts[0]) and _fits(pattern[1:], parts[1:])


def parameters_for(name: str, parameter_set: Mapping[str, Any]) -> dict[str, Value]:
    """What a set says for a node; names with wildcards yield to others."""
    result: dict[str, Value] = {}
    for pattern in sorted(parameter_set, key=lambda pattern: "*" not in pattern):
        if fits(pattern, name):
            parameters = parameter_set[pattern]
            result = merged(result, parameters.get(NODE_LEVEL, parameters))
    return result


def merged(one: Mapping[str, Value], other: Mapping[str, Value]) -> dict[str, Value]:
    """Both, the other's where both have a value; mappings in them are merged, too."""
    result = dict(one)
    for key, value in other.items():
        before = result.get(key)
        both = isinstance(before, Mapping) and isinstance(value, Mapping)
        result[key] = merged(before, value) if both else value  # type: ignore[arg-type]
    return result


def parameter_words(parameters: Mapping[str, Value], prefix: str = "_") -> list[str]:
    """``_name:=value`` words, the values as YAML on one line; ``_a.b:=1`` for what is nested."""
    words: list[str] = []
    for key, value in parameters.items():
        if isinstance(value, Mapping) and value:
            words += parameter_words(value, f"{prefix}{key}.")
        else:
            words.append(f"{prefix}{key}:={_yaml(value)}")
    return words


def _yaml(value: Value) -> str:
    text = yaml.safe_dump(value, default_flow_style=True, width=math.inf, allow_unicode=True)
    text = text.removesuffix("\n...\n").removesuffix("\n")
    # YAML breaks lines in text at those of the text; JSON is YAML and does not.
    return json.dumps(value, ensure_ascii=False) if "\n" in text else text
