"""Parameters as YAML text.

Plain words mean what YAML 1.2 says: ``1e3`` is a float, ``yes`` a string, ``010`` ten. What is
wrong is told with its line.
"""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from simple_ros.errors import InvalidName
from simple_ros.names import parameter_name
from simple_ros.parameters.errors import BadParameterText, ParameterError
from simple_ros.parameters.tree import groups_of, nested
from simple_ros.parameters.values import Value, normalised

__all__ = [
    "FileItem",
    "parse_node_file",
    "parse_tree",
    "parse_value",
    "value_text",
    "written",
]

_ROS2_LEVEL = "ros__parameters"
_ANY_NODE = ("/**", "**")
_BREAKS = re.compile("[\n\r\x85\u2028\u2029\ufeff]")
_RESOLVERS = (
    ("tag:yaml.org,2002:bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("tag:yaml.org,2002:null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("tag:yaml.org,2002:int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "tag:yaml.org,2002:float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
)


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012  (as PyYAML has it)


class _Dumper(yaml.SafeDumper):
    yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


def _integer(loader: _Loader, node: yaml.ScalarNode) -> int:
    text = str(loader.construct_scalar(node))
    base = {"0o": 8, "0x": 16}.get(text[:2], 10)
    return int(text[2:] if base != 10 else text, base)


def _number(loader: _Loader, node: yaml.ScalarNode) -> float:
    text = str(loader.construct_scalar(node)).lower()
    return float(text.replace(".inf", "inf").replace(".nan", "nan"))


for _tag, _pattern, _first in _RESOLVERS:
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(_tag, re.compile(rf"^(?:{_pattern})$"), list(_first))
_Loader.add_constructor("tag:yaml.org,2002:int", _integer)
_Loader.add_constructor("tag:yaml.org,2002:float", _number)


def _binary(dumper: _Dumper, value: bytes) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:binary", b64encode(value).decode())


def _string(dumper: _Dumper, value: str) -> yaml.ScalarNode:
    # In any other style PyYAML takes these for line breaks, which are folded when read.
    style = '"' if _BREAKS.search(value) else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style)


_Dumper.add_representer(bytes, _binary)
_Dumper.add_representer(str, _string)


@dataclass(frozen=True, slots=True)
class FileItem:
    """One parameter of a file for nodes.

    Attributes:
        node: Which node, canonical; empty for every node.
        name: Of the parameter, relative to the node.
        value: Its value.
    """

    node: str
    name: str
    value: Value


# -- reading ---------------------------------------------------------------------------------------


def parse_value(text: str, name: str = "value") -> Value | dict[str, Value]:
    """A value given as text: what YAML makes of it. A mapping is a group, by relative name.

    Raises:
        BadParameterText: It is no YAML, or no parameter can have it.
    """
    node = _composed(text, "")
    if isinstance(node, yaml.MappingNode):
        return {key: value for key, value, _ in _leaves(node, "", "")}
    return _value(node, name, "", text) if node is not None else ""


def parse_tree(text: str, source: str) -> dict[str, Value]:
    """Parameters of a file by name; mappings are groups.

    Args:
        text: Of the file.
        source: Its name, for errors.

    Raises:
        BadParameterText: With the line where it is wrong.
    """
    root = _composed(text, source)
    if _is_nothing(root):
        return {}
    values: dict[str, Value] = {}
    lines: dict[str, int] = {}
    groups: dict[str, str] = {}
    for name, value, line in _leaves(_mapping(root, source), "", source):
        taken = [name, *groups_of(name)]
        other = next((other for other in taken if other in values), None) or groups.get(name)
        if other is not None:
            reason = f"{name!r} and {other!r} of line {lines[other]} cannot both be parameters"
            raise BadParameterText(source, line, reason)
        values[name], lines[name] = value, line
        groups.update(dict.fromkeys(groups_of(name), name))
    return values


def parse_node_file(text: str, source: str) -> list[FileItem]:
    """Parameters of a file that says whose they are: node names, or ``/**`` for every node.

    Node names may be groups (``robot1: {driver: ...}``) where the level ``ros__parameters`` says
    which of the groups are nodes. What is for every node comes first.

    Raises:
        BadParameterText: With the line where it is wrong.
    """
    root = _composed(text, source)
    if _is_nothing(root):
        return []
    found = list(_node_items(_mapping(root, source), "", source))
    return sorted(found, key=lambda item: item.node != "")


def _node_items(mapping: yaml.MappingNode, prefix: str, source: str) -> Iterator[FileItem]:
    for key_node, value_node in mapping.value:
        key, line = _key(key_node, source), key_node.start_mark.line + 1
        inside = _mapping(value_node, source, f"parameters of {key!r} must be a mapping")
        node = "" if key in _ANY_NODE else _below(prefix, _named(key, line, source))
        if not _has_level(inside):
            for name, value, _ in _leaves(inside, "", source):
                yield FileItem(node, name, value)
        elif _ROS2_LEVEL in (_key(item, source) for item, _ in inside.value):
            for below, parameters in inside.value:
                if _key(below, source) == _ROS2_LEVEL:
                    for name, value, _ in _leaves(_mapping(parameters, source), "", source):
                        yield FileItem(node, name, value)
                else:
                    line = below.start_mark.line + 1
                    reason = f"{below.value!r} stands beside {_ROS2_LEVEL!r}; put it inside"
                    raise BadParameterText(source, line, reason)
        else:
            yield from _node_items(inside, node, source)


def _has_level(mapping: yaml.MappingNode) -> bool:
    return any(
        key.value == _ROS2_LEVEL or (isinstance(value, yaml.MappingNode) and _has_level(value))
        for key, value in mapping.value
    )


def _composed(text: str, source: str) -> yaml.Node | None:
    try:
        node: yaml.Node | None = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        problem = error.problem or error.context or "no YAML"
        raise BadParameterText(source, line, f"no YAML: {problem}") from None
    except yaml.YAMLError as error:
        raise BadParameterText(source, 1, f"no YAML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise BadParameterText(source, 1, "is nested too deeply") from None
    return node


def _is_nothing(root: yaml.Node | None) -> bool:
    return root is None or (isinstance(root, yaml.ScalarNode) and root.tag.endswith(":null"))


def _mapping(node: yaml.Node | None, source: str, reason: str = "") -> yaml.MappingNode:
    if not isinstance(node, yaml.MappingNode):
        line = node.start_mark.line + 1 if node is not None else 1
        reason = reason or "must be a mapping of names to values"
        raise BadParameterText(source, line, reason)
    return node


def _leaves(
    mapping: yaml.MappingNode, prefix: str, source: str
) -> Iterator[tuple[str, Value, int]]:
    """Every value with its name and line; a group that repeats, or a name that does, is an error."""
    seen: dict[str, int] = {}
    for key_node, value_node in mapping.value:
        line = key_node.start_mark.line + 1
        key = _named(_key(key_node, source), line, source)
        if key in seen:
            raise BadParameterText(source, line, f"{key!r} was given already in line {seen[key]}")
        seen[key] = line
        name = _below(prefix, key)
        if isinstance(value_node, yaml.MappingNode):
            yield from _leaves(value_node, name, source)
        else:
            yield name, _value(value_node, name, source), line


def _below(prefix: str, name: str) -> str:
    return f"{prefix}/{name}" if prefix else name


def _key(node: yaml.Node, source: str) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise BadParameterText(source, node.start_mark.line + 1, "a name must be plain text")
    return str(node.value)


def _named(key: str, line: int, source: str) -> str:
    try:
        return parameter_name(key)
    except InvalidName as error:
        reason = f"name {key!r} {error.reason}"
        raise BadParameterText(source, line, reason) from None


def _value(node: yaml.Node, name: str, source: str, text: str = "") -> Value:
    line = node.start_mark.line + 1
    try:
        # Of a node that was composed on its own; its constructor needs no text.
        return normalised(name, _Loader("").construct_document(node))
    except ParameterError as error:
        raise BadParameterText(source, line, str(error) if source else error.reason) from None
    except (yaml.YAMLError, ValueError) as error:
        problem = getattr(error, "problem", None) or error
        shown = f" {text!r}" if text else ""
        raise BadParameterText(source, line, f"{name!r} is no value{shown}: {problem}") from None


# -- writing ---------------------------------------------------------------------------------------


def written(values: Mapping[str, Value]) -> str:
    """Values by name as a file that `parse_tree` reads."""
    if not values:
        return ""
    return _dumped(nested(values), default_flow_style=None)


def value_text(value: Any) -> str:
    """One value in one line."""
    text = _dumped(value, default_flow_style=True, width=2**31)
    return text.removesuffix("...\n").removesuffix("\n")


def _dumped(value: Any, **style: Any) -> str:
    text: str = yaml.dump(value, Dumper=_Dumper, sort_keys=True, allow_unicode=True, **style)
    return text
