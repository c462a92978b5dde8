"""What a launch file in Python is written with: the entries of YAML as functions.

::

    from simple_ros.launch.entries import argument, group, node

    ARGS = {"robots": argument(type="int", default=2, description="How many robots.")}


    def launch(args):
        return [
            group([node("camera", module="my_robot.camera")], namespace=f"robot{number}")
            for number in range(args["robots"])
        ]

Keys and checks are those of YAML. An error names the line of the call.
"""

from __future__ import annotations

import sys
from typing import Any

from simple_ros.launch.errors import Place
from simple_ros.launch.source import Entry, entry_of

__all__ = ["argument", "group", "include", "node", "parameters"]

_KEYWORDS = {"if_": "if"}


def argument(**keys: Any) -> Entry:
    """A declaration: ``type``, ``default``, ``description``, ``choices``."""
    return _entry(keys)


def node(name: str, /, **keys: Any) -> Entry:
    """A node; the keys are those of YAML's ``- node:``."""
    return _entry({"node": name, **keys})


def group(entries: list[Entry], /, **keys: Any) -> Entry:
    """A group of entries; ``namespace``, ``env``, ``remap``, ``parameters``."""
    return _entry({"group": entries, **keys})


def include(file: str, /, **keys: Any) -> Entry:
    """Another launch file, in either language; ``args`` and the keys of a group."""
    return _entry({"include": file, **keys})


def parameters(by_node: Any, /) -> Entry:
    """Parameters by node name, or a file of them, for the entries that follow."""
    return _entry({"parameters": by_node})


def _entry(keys: dict[str, Any]) -> Entry:
    caller = sys._getframe(2)
    place = Place(caller.f_code.co_filename, caller.f_lineno)
    return entry_of({_KEYWORDS.get(key, key): value for key, value in keys.items()}, place)
