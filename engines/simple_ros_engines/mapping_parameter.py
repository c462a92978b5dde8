"""A parameter that is a JSON object, which people also write as a map, on the command line and in launch files."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.node import NodeHandle

__all__ = ["declare_mapping", "object_of"]


async def declare_mapping(node: NodeHandle, name: str, keys: Iterable[str]) -> dict[str, Any]:
    """What a parameter says, as JSON text or as a group of parameters below its name.

    Args:
        node: Declares the text, unless there is a group.
        name: Such as ``~source_options``.
        keys: Those that a group can have; it is only asked for them.

    Raises:
        ConfigError: The text is no JSON object.
    """
    group = {}
    for key in keys:
        try:
            value = await node.get_parameter(f"{name}/{key}", None)
        except SimpleRosError:
            # A Master that keeps no parameters of ours: what the command line says was found before it was asked.
            value = None
        if value is not None:
            group[key] = value
    if group:
        return group
    text = str(await node.declare_parameter(name, "", type="string", read_only=True))
    try:
        return object_of(text)
    except ConfigError as error:
        raise ConfigError(f"parameter {name.removeprefix('~')}: {error}") from None


def object_of(text: str) -> dict[str, Any]:
    """The JSON object of a text; an empty one is an empty object.

    Raises:
        ConfigError: It is none.
    """
    try:
        found = json.loads(text or "{}")
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{text!r} is no JSON: {error}") from None
    if not isinstance(found, dict):
        raise ConfigError(f"{text!r} is no JSON object")
    return found
