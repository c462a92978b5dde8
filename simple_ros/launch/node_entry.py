"""The entry of one node in a launch file. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros.launch.description import Limits, LogTo, ProcessDescription, Ready, ReadyWhen
from simple_ros.launch.errors import LaunchFileError
from simple_ros.launch.fields import Fields
from simple_ros.launch.parameters import check_set, merged, parameter_words, parameters_for
from simple_ros.launch.restart import Respawn
from simple_ros.launch.scope import Files, Scope, full_name, path_from
from simple_ros.launch.source import Entry, Value, plain
from simple_ros.launch.substitutions import substituted

__all__ = ["NODE_KEYS", "read_node"]

_WAYS = ("module", "script", "program", "components")
NODE_KEYS = (
    "node",
    *_WAYS,
    "args",
    "namespace",
    "env",
    "remap",
    "parameters",
    "cwd",
    "ready",
    "ready_timeout",
    "after",
    "respawn",
    "required",
    "limits",
    "log",
    "if",
    "unless",
)
_MODULE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*")
_COMPONENT = re.compile(rf"([^\W\d]\w*=)?{_MODULE.pattern}:{_MODULE.pattern}")
_COMPONENTS_MODULE = "simple_ros.components"


def read_node(fields: Fields, scope: Scope, files: Files, python: str) -> ProcessDescription:
    """The process an entry describes.

    Args:
        fields: The entry, with `NODE_KEYS`.
        scope: What it inherits.
        files: For scripts and parameter files.
        python: The interpreter for modules and scripts.

    Raises:
        LaunchFileError: A value has no meaning.
    """
    namespace = full_name(fields, "namespace", scope.namespace)
    name = full_name(fields, "node", namespace)
    way = _way(fields)
    command, is_python = _command(fields, way, files, python)
    unbuffered = {"PYTHONUNBUFFERED": "1"} if is_python else {}
    return ProcessDescription(
        name=name,
        command=tuple(command),
        words=tuple(_words(fields, scope, files, name, way)),
        environment={**unbuffered, **scope.environment, **fields.pairs("env")},
        cwd=path_from(fields, fields.text("cwd")) if "cwd" in fields else None,
        ready=_ready(fields, way),
        ready_timeout_s=fields.seconds("ready_timeout", 10.0),
        after=tuple(fields.texts("after")),
        respawn=_respawn(fields),
        required=fields.flag("required", default=False),
        limits=_limits(fields),
        log=fields.choice("log", LogTo.FILE),
        place=fields.entry.place,
    )


def _way(fields: Fields) -> str:
    ways = [way for way in _WAYS if way in fields]
    if len(ways) != 1:
        found = " and ".join(ways) if ways else "none"
        raise LaunchFileError(
            fields.entry.place,
            f"node {fields.text('node')!r} must have one of {', '.join(_WAYS)}; it has {found}",
        )
    return ways[0]


def _command(fields: Fields, way: str, files: Files, python: str) -> tuple[list[str], bool]:
    """The words of the command, and whether it is Python."""
    arguments = fields.texts("args")
    if way == "components":
        return [python, "-m", _COMPONENTS_MODULE, *_components(fields), *arguments], True
    target = fields.text(way)
    if not target:
        raise fields.error(way, "is empty")
    if way == "module":
        if not _MODULE.fullmatch(target):
            raise fields.error(way, f"{target!r} is no name of a Python module, as my_robot.camera")
        return [python, "-m", target, *arguments], True
    if way == "program":
        path = path_from(fields, target) if "/" in target else target
        return [path, *arguments], False
    path = path_from(fields, target)
    if not files.is_file(path):
        raise fields.error(way, f"there is no file {path}")
    return [python, path, *arguments], True


def _components(fields: Fields) -> list[str]:
    components = fields.texts("components")
    for component in components:
        if not _COMPONENT.fullmatch(component):
            raise fields.error(
                "components", f"{component!r} is not MODULE:FUNCTION or NAME=MODULE:FUNCTION"
            )
    if not components:
        raise fields.error("components", "is empty")
    return components


# -- the words of the node --------------------------------------------------------------------


def _words(fields: Fields, scope: Scope, files: Files, name: str, way: str) -> list[str]:
    namespace, _, base = name.rpartition("/")
    # The nodes that share a process have names of their own.
    words = [] if way == "components" else [f"__name:={base}"]
    if namespace:
        words.append(f"__ns:=/{namespace}")
    for old, new in {**scope.remaps, **fields.pairs("remap")}.items():
        if not old or old.startswith("_") or not new:
            raise LaunchFileError(
                fields.entry.place.under("remap"), f"cannot remap {old!r} to {new!r}"
            )
        words.append(f"{old}:={new}")
    parameters = merged(scope.parameters(name), _own_parameters(fields, files, name))
    return words + parameter_words(parameters)


def _own_parameters(fields: Fields, files: Files, name: str) -> dict[str, Value]:
    entry = fields.get("parameters")
    if entry is None or entry.value is None:
        return {}
    result: dict[str, Value] = {}
    for item in entry.value if isinstance(entry.value, list) else [entry]:
        result = merged(result, _parameters(item, fields, files, name))
    return result


def _parameters(item: Entry, fields: Fields, files: Files, name: str) -> Mapping[str, Any]:
    if isinstance(item.value, str):
        path = path_from(fields, substituted(item, fields.context))
        read = files.parameter_file(path, item.place)
        check_set(read)
        return parameters_for(name, plain(read))
    if not isinstance(item.value, dict):
        raise LaunchFileError(item.place, f"must be parameters by name, or a file, not {item.kind}")
    values: dict[str, Value] = substituted(item, fields.context)
    return values


# -- how it runs ------------------------------------------------------------------------------


def _ready(fields: Fields, way: str) -> Ready:
    if "ready" not in fields:
        is_node = way in ("module", "script")
        return Ready(ReadyWhen.REGISTERED if is_node else ReadyWhen.STARTED)
    kind, colon, text = fields.text("ready").partition(":")
    known = [when.value for when in ReadyWhen]
    if kind not in known or (kind == "output") != bool(text) or (colon and not text):
        shown = ", ".join("output:TEXT" if word == "output" else word for word in known)
        raise fields.error("ready", f"cannot be {fields.text('ready')!r}; it is one of {shown}")
    return Ready(ReadyWhen(kind), text)


def _respawn(fields: Fields) -> Respawn | None:
    entry = fields.get("respawn")
    if entry is None or not isinstance(entry.value, dict):
        return Respawn() if fields.flag("respawn", default=False) else None
    inner = Fields(entry, ("limit", "within", "delay", "max_delay", "when"), fields.context)
    usual = Respawn()
    when = inner.text("when", "failure")
    if when not in ("failure", "always"):
        raise inner.error("when", f"cannot be {when!r}; it is failure or always")
    limit = inner.integer("limit")
    delay_s = inner.seconds("delay", usual.delay_s)
    try:
        return Respawn(
            usual.limit if limit is None else limit,
            inner.seconds("within", usual.within_s),
            delay_s,
            inner.seconds("max_delay", max(usual.max_delay_s, delay_s)),
            when == "always",
        )
    except ConfigError as error:
        raise LaunchFileError(entry.place, str(error)) from None


def _limits(fields: Fields) -> Limits:
    entry = fields.get("limits")
    if entry is None:
        return Limits()
    inner = Fields(entry, ("memory", "cpu_seconds", "files", "nice"), fields.context)
    return Limits(
        inner.size_bytes("memory"),
        inner.integer("cpu_seconds", lowest=1),
        inner.integer("files", lowest=8),
        inner.integer("nice", lowest=-20, highest=19),
    )
