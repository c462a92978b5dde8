"""What the hub looks after, as values, and how that is read. Pure."""

from __future__ import annotations

import difflib
import json
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros.launch import Limits, Respawn
from simple_ros.launch.description import NO_LIMITS
from simple_ros.launch.order import circle
from simple_ros.parameters.errors import BadParameterText
from simple_ros.parameters.text import parse_value

__all__ = [
    "ENGINES",
    "NAMESPACE",
    "RESPAWN",
    "Component",
    "Kind",
    "check_components",
    "components_of",
    "default_components",
    "with_parameters",
]

NAMESPACE = "wireless_ros"
RESPAWN = Respawn(delay_s=0.2)


class Kind(Enum):
    """What a component is."""

    ENGINE = "engine"
    CELL = "cell"


@dataclass(frozen=True, slots=True)
class Component:
    """One process that the hub looks after.

    Attributes:
        name: As the hub calls it.
        kind: Engine or cell.
        command: Program and arguments.
        parameters: Of its node.
        required: Whether the whole is degraded without it.
        priority: 1 lowest to 5; under strain the lowest give up first.
        after: Components that must work first, if they can.
        start_timeout_s: Until its first sign of life.
        respawn: When and how often it is started again.
        limits: What its process may take.
        environment: Variables to set.
    """

    name: str
    kind: Kind
    command: tuple[str, ...]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    required: bool = True
    priority: int = 5
    after: tuple[str, ...] = ()
    start_timeout_s: float = 20.0
    respawn: Respawn = RESPAWN
    limits: Limits = NO_LIMITS
    environment: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.name.replace("_", "a").isalnum() or not self.name.isascii():
            raise ConfigError(f"component name {self.name!r} has more than letters, digits and _")
        if not self.command:
            raise ConfigError(f"component {self.name!r} has no command")
        if not 1 <= self.priority <= 5:
            raise ConfigError(f"component {self.name!r} has priority {self.priority}, not 1..5")

    @property
    def node(self) -> str:
        """Name of its node."""
        return f"{NAMESPACE}/{self.name}"

    @property
    def words(self) -> tuple[str, ...]:
        """Name and parameters, for ``SIMPLE_ROS_ARGS``."""
        own = (f"_{name}:={_text(value)}" for name, value in self.parameters.items())
        return (f"__name:={self.name}", f"__ns:=/{NAMESPACE}", *own)

    @property
    def variables(self) -> dict[str, str]:
        """What its environment has besides ours."""
        return {**self.environment, "SIMPLE_ROS_ARGS": shlex.join(self.words)}


def _text(value: object) -> str:
    # JSON is YAML: a text that looks like a number or a group stays a text.
    return json.dumps(value)


def _value(text: str) -> object:
    """A parameter as typed: a mapping stays a text, since some parameters are JSON objects."""
    try:
        value = parse_value(text)
    except BadParameterText:
        return text
    return text if isinstance(value, dict) else value


def _program(noun: str, name: str) -> tuple[str, ...]:
    return (sys.executable, "-m", "simple_ros_hub.runner", noun, name)


ENGINES: Mapping[str, tuple[str, int]] = {
    "radio_info_engine": ("radio-information", 5),
    "cross_domain_engine": ("cross-domain", 4),
    "physical_adaptive_engine": ("physical-adaptive", 4),
}
"""Engines in the order of their start, by their names here: entry point, priority."""


def default_components() -> tuple[Component, ...]:
    """The three engines, each after the one before."""
    found: list[Component] = []
    for name, (plugin, priority) in ENGINES.items():
        after = (found[-1].name,) if found else ()
        command = _program("engine", plugin)
        found.append(Component(name, Kind.ENGINE, command, priority=priority, after=after))
    return tuple(found)


_KEYS = {item.name for item in fields(Component)} - {"name", "kind", "command"} | {
    "engine",
    "cell",
    "command",
    "kind",
}


def components_of(document: object, source: str) -> tuple[Component, ...]:
    """The components of a configuration: a mapping of names to what they are.

    Args:
        document: As read from YAML.
        source: For messages.

    Raises:
        ConfigError: It makes no sense; the message has source and key.
    """
    if not isinstance(document, Mapping) or not isinstance(document.get("components"), Mapping):
        raise ConfigError(f"{source}: there is no mapping `components:`")
    unknown = sorted(set(document) - {"components"})
    if unknown:
        raise ConfigError(f"{source}: there is no key {unknown[0]!r} here; only 'components'")
    found = tuple(
        _component(str(name), said, f"{source}: components.{name}")
        for name, said in document["components"].items()
    )
    engines = tuple(item.name for item in found if item.kind is Kind.ENGINE)
    # Cells come last: behind all engines, unless told otherwise.
    ordered = tuple(
        replace(item, after=engines) if item.kind is Kind.CELL and not item.after else item
        for item in found
    )
    check_components(ordered)
    return ordered


def _component(name: str, said: object, where: str) -> Component:
    if not isinstance(said, Mapping):
        raise ConfigError(f"{where}: is no mapping")
    for key in said:
        if key not in _KEYS:
            near = difflib.get_close_matches(str(key), _KEYS, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ConfigError(f"{where}: there is no key {key!r}{hint}")
    kind, command = _what(said, where)
    rest = {key: said[key] for key in said if key not in ("engine", "cell", "command", "kind")}
    try:
        for key, make in _MAKERS.items():
            if key in rest:
                rest[key] = make(rest[key])
        return Component(name, kind, command, **rest)
    except (TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"{where}: {error}") from error


def _what(said: Mapping[str, Any], where: str) -> tuple[Kind, tuple[str, ...]]:
    given = [key for key in ("engine", "cell", "command") if key in said]
    if len(given) != 1:
        raise ConfigError(f"{where}: needs one of engine, cell and command, has {given or 'none'}")
    if "command" in said:
        words = said["command"]
        command = tuple(shlex.split(words) if isinstance(words, str) else map(str, words))
        try:
            return Kind(said.get("kind", "engine")), command
        except ValueError:
            raise ConfigError(f"{where}: kind {said['kind']!r} is not engine or cell") from None
    return Kind(given[0]), _program(given[0], str(said[given[0]]))


_MAKERS: Mapping[str, Callable[[Any], Any]] = {
    "after": lambda value: tuple(map(str, [value] if isinstance(value, str) else value)),
    "respawn": lambda value: Respawn(**value),
    "limits": lambda value: Limits(**value),
    "priority": int,
    "start_timeout_s": float,
    "parameters": dict,
    "environment": lambda value: {str(key): str(text) for key, text in value.items()},
}


def check_components(components: Sequence[Component]) -> None:
    """See whether names are unique and the order is possible.

    Raises:
        ConfigError: They are not, or it is not.
    """
    names = [item.name for item in components]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"there are two components {name!r}")
    for item in components:
        for other in item.after:
            if other not in names:
                raise ConfigError(
                    f"component {item.name!r} comes after {other!r}, which is unknown"
                )
    waiting = circle({item.name: item.after for item in components})
    if waiting:
        raise ConfigError(" waits for ".join([*waiting, waiting[0]]))


def with_parameters(components: Sequence[Component], words: Sequence[str]) -> tuple[Component, ...]:
    """Components with further parameters.

    Args:
        components: As they are.
        words: Each ``component.parameter=value``; later ones win.

    Raises:
        ConfigError: A word makes no sense, or there is no such component.
    """
    known = {item.name: item for item in components}
    for word in words:
        key, sign, value = word.partition("=")
        name, dot, parameter = key.partition(".")
        if not sign or not dot or not parameter:
            raise ConfigError(f"{word!r} is not of the form component.parameter=value")
        if name not in known:
            raise ConfigError(f"{word!r}: there is no component {name!r}, only {', '.join(known)}")
        item = known[name]
        known[name] = replace(item, parameters={**item.parameters, parameter: _value(value)})
    return tuple(known.values())
