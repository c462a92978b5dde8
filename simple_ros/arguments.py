"""What a node is told from outside: name, namespace, remaps and parameters, in words.

The words are those of ROS 1, each with ``:=`` in it::

    __name:=talker            the name of the process's first node
    __ns:=/robot1             the namespace of its nodes
    __log_level:=debug        of the library's log
    __params:=robot.yaml      a file of parameters
    _gain:=1.5                a parameter of the node's own; the value is YAML
    chatter:=/other/chatter   use that name instead

With the name of a node before it (as its program gives it), a word is for that node only:
``talker:chatter:=news``. They come from the environment variable ``SIMPLE_ROS_ARGS``, where launch puts
them, and then from the command line; what comes later wins.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

from simple_ros import names
from simple_ros.errors import ConfigError, InvalidName, SimpleRosError
from simple_ros.parameters.errors import BadParameterText
from simple_ros.parameters.values import Value

__all__ = [
    "ENVIRONMENT",
    "Arguments",
    "BadArgument",
    "NodeArguments",
    "argv",
    "parse_arguments",
    "process_arguments",
    "use_environment_only",
]

ENVIRONMENT = "SIMPLE_ROS_ARGS"
_SIGN = ":="
_LEVELS = ("debug", "info", "warning", "warn", "error", "fatal", "critical")


class BadArgument(SimpleRosError, ValueError):
    """A word with ``:=`` makes no sense; the message points at the character.

    Attributes:
        word: The word as given.
        position: Index of the offending character.
        reason: What is wrong with it.
    """

    def __init__(self, word: str, position: int, reason: str) -> None:
        self.word = word
        self.position = position
        self.reason = reason
        caret = " " * (len(repr(word[:position])) - 1) + "^"
        super().__init__(f"argument {reason}:\n  {word!r}\n  {caret}")


@dataclass(frozen=True, slots=True)
class Remap:
    """Use another name.

    Attributes:
        source: The name that a program uses.
        target: The one used instead.
    """

    source: str
    target: str


@dataclass(frozen=True, slots=True)
class Assignment:
    """A parameter of a node is given its value.

    Attributes:
        name: Relative to the node.
        value: Its value.
    """

    name: str
    value: Value


@dataclass(frozen=True, slots=True)
class Setting:
    """A word like ``__ns:=/robot1``.

    Attributes:
        key: ``"name"``, ``"ns"`` or ``"log_level"``.
        value: What it says.
    """

    key: str
    value: str


@dataclass(frozen=True, slots=True)
class Item:
    """What one word says, and for whom.

    Attributes:
        node: The node it is for; empty for every node.
        what: What it says.
    """

    node: str
    what: Remap | Assignment | Setting


@dataclass(frozen=True, slots=True)
class NodeArguments:
    """What one node is told.

    Attributes:
        scope: Its full name, its namespace and its remaps.
        overrides: Values for parameters, by full name.
        log_level: For the library's log; empty to leave it.
    """

    scope: names.Scope
    overrides: Mapping[str, Value] = field(default_factory=dict)
    log_level: str = ""


@dataclass(frozen=True, slots=True)
class Arguments:
    """What the nodes of a process are told, in the order in which it was said.

    Attributes:
        items: Later ones win.
    """

    items: tuple[Item, ...] = ()

    @classmethod
    def parse(cls, words: str | Iterable[str]) -> Arguments:
        """What words say; a text is split as a shell does. Raises as `parse_arguments`."""
        return parse_arguments(shlex.split(words) if isinstance(words, str) else words)

    def without_name(self) -> Arguments:
        """The same for further nodes of a process, which keep their names."""
        kept = [item for item in self.items if not _names_any(item)]
        return Arguments(tuple(kept))

    def of(self, name: str, namespace: str = "") -> NodeArguments:
        """What the node is told whose program gives it this name and namespace.

        Raises:
            InvalidName: One of these breaks the rules.
        """
        own = names.node_name(name)
        heard = [item for item in self.items if item.node in ("", own)]
        said = {item.what.key: item.what.value for item in heard if isinstance(item.what, Setting)}
        space = names.namespace_name(said.get("ns", namespace))
        full = names.resolve(said.get("name", name), kind="node", namespace=space)
        aliases = {own, full, full.removeprefix(f"{space}/")}
        heard = [item for item in self.items if item.node in ("", *aliases)]
        remaps, overrides = {}, {}
        for item in heard:
            match item.what:
                case Remap(source, target):
                    source = names.resolve(source, namespace=space, node=full)
                    remaps[source] = names.resolve(target, namespace=space, node=full)
                case Assignment(parameter, value):
                    overrides[f"{full}/{parameter}"] = value
        scope = names.Scope(full, space, remaps)
        return NodeArguments(scope, overrides, said.get("log_level", ""))


def _names_any(item: Item) -> bool:
    """Whether it names whichever node comes first."""
    return not item.node and isinstance(item.what, Setting) and item.what.key == "name"


# -- reading words ---------------------------------------------------------------------------------


def _read(path: str) -> str:
    return Path(path).read_text(encoding="utf-8")


def parse_arguments(words: Iterable[str], read: Callable[[str], str] = _read) -> Arguments:
    """What words say.

    Args:
        words: Each with ``:=``.
        read: Gives the text of a file of parameters.

    Raises:
        BadArgument: A word makes no sense.
        BadParameterText: A file of parameters is wrong.
    """
    return Arguments(tuple(item for word in words for item in _Word(word, read).items()))


class _Word:
    """One word, taken apart."""

    def __init__(self, word: str, read: Callable[[str], str]) -> None:
        self._word = word
        self._read = read
        left, sign, self._right = word.partition(_SIGN)
        if not sign:
            raise BadArgument(word, len(word), "has no ':='")
        self._value_at = len(left) + len(_SIGN)
        prefix, colon, key = left.rpartition(":")
        self._key_at = len(prefix) + len(colon)
        self._key = key
        self._node = self._checked(names.node_name, prefix, 0) if colon else ""

    def items(self) -> list[Item]:
        """What it says."""
        key = self._key
        if key.startswith("__"):
            found = self._special(key[2:])
            return [Item(node or self._node, what) for node, what in found if self._is_for(node)]
        if key.startswith("_"):
            return [Item(self._node, what) for what in self._assignments(key[1:])]
        return [Item(self._node, self._remap())]

    def _is_for(self, node: str) -> bool:
        """Whether what a file says for a node may be for the one before this word."""
        last = node.rpartition("/")[2]
        return not node or not self._node or last == self._node.rpartition("/")[2]

    def _checked(self, check: Callable[[str], str], text: str, at: int) -> str:
        try:
            return check(text)
        except InvalidName as error:
            reason = f"names a {error.kind} that {error.reason}"
            raise BadArgument(self._word, at + error.position, reason) from None

    def _remap(self) -> Remap:
        def check(name: str) -> str:
            names.resolve(name, kind="name", node="node")
            return name

        source = self._checked(check, self._key, self._key_at)
        return Remap(source, self._checked(check, self._right, self._value_at))

    def _assignments(self, key: str) -> list[Assignment]:
        from simple_ros.parameters.text import parse_value

        name = self._checked(names.parameter_name, key.replace(".", "/"), self._key_at + 1)
        try:
            value = parse_value(self._right, name)
        except BadParameterText as error:
            raise BadArgument(
                self._word, self._value_at, f"has a value that {_why(error)}"
            ) from None
        if isinstance(value, dict):
            return [Assignment(f"{name}/{below}", item) for below, item in value.items()]
        return [Assignment(name, value)]

    def _special(self, key: str) -> list[tuple[str, Setting | Assignment]]:
        match key:
            case "name":
                self._checked(names.node_name, self._right, self._value_at)
            case "ns":
                self._checked(names.namespace_name, self._right, self._value_at)
            case "log_level":
                if self._right.lower() not in _LEVELS:
                    reason = f"has a level that is none of {', '.join(_LEVELS)}"
                    raise BadArgument(self._word, self._value_at, reason)
                return [("", Setting(key, self._right.lower()))]
            case "params":
                return self._file()
            case _:
                raise self._unknown(key)
        return [("", Setting(key, self._right))]

    def _unknown(self, key: str) -> BadArgument:
        known = ("name", "ns", "log_level", "params")
        near = get_close_matches(key, known, n=1)
        hint = f"did you mean '__{near[0]}'?" if near else f"there are __{', __'.join(known)}"
        return BadArgument(self._word, self._key_at, f"'__{key}' is unknown; {hint}")

    def _file(self) -> list[tuple[str, Setting | Assignment]]:
        from simple_ros.parameters.text import parse_node_file

        try:
            text = self._read(self._right)
        except (OSError, UnicodeDecodeError) as error:
            reason = f"names a file that cannot be read ({getattr(error, 'strerror', error)})"
            raise BadArgument(self._word, self._value_at, reason) from None
        return [
            (item.node, Assignment(item.name, item.value))
            for item in parse_node_file(text, self._right)
        ]


def _why(error: BadParameterText) -> str:
    reason = error.reason
    return f"is {reason}" if reason.startswith("no YAML") else reason


# -- those of this process -------------------------------------------------------------------------


class _Process:
    """What the words of this process are, and whether its first node took its name."""

    def __init__(self) -> None:
        self.reads_argv = True
        self.has_first = False


_process = _Process()


def use_environment_only() -> None:
    """For programs whose own command line may have words with ``:=`` in it."""
    _process.reads_argv = False


def process_arguments() -> Arguments:
    """What this process is told, for the node that asks; only the first that does is given a name.

    Raises:
        BadArgument: A word makes no sense.
        BadParameterText: A file of parameters is wrong.
    """
    try:
        words = shlex.split(os.environ.get(ENVIRONMENT, ""))
    except ValueError as error:
        raise ConfigError(f"{ENVIRONMENT} cannot be split into words: {error}") from None
    if _process.reads_argv:
        words += [word for word in sys.argv[1:] if _SIGN in word]
    if not words:
        return Arguments()
    found = parse_arguments(words)
    if _process.has_first:
        return found.without_name()
    _process.has_first = True
    return found


def argv() -> list[str]:
    """``sys.argv`` without the words for nodes, for a program's own arguments.

    ::

        options = argparse.ArgumentParser().parse_args(simple_ros.argv()[1:])
    """
    return sys.argv[:1] + [word for word in sys.argv[1:] if _SIGN not in word]
