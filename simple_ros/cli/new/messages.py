"""Which message a new node is about: a shipped one, or one of the user's own in a file beside it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from simple_ros.cli.msg import INSTALL_COMPILER, compiled
from simple_ros.cli.new.writing import rendered, snake_case, write_all
from simple_ros.errors import ConfigError, UnknownMessageType

__all__ = ["OWN_PACKAGE", "NodeMessage", "message_for", "own_type"]

OWN_PACKAGE = "my_msgs"
_TYPE = re.compile(r"[A-Z][A-Za-z0-9]*")
_FIELDS = {"String": 'data=f"hello {next(numbers)}"'}
_OWN_FIELDS = 'name="sensor", value=next(numbers)'


@dataclass(frozen=True, slots=True)
class NodeMessage:
    """A message as a program uses it.

    Attributes:
        type: Name of the class.
        module: Where it is imported from.
        fields: Arguments that make one worth sending; empty if nothing is known of it.
        part: What of it is printed, as ``.data``.
        made: Files that were made for it.
        before: What must be typed before it can be imported.
    """

    type: str
    module: str
    fields: str = ""
    part: str = ""
    made: tuple[Path, ...] = ()
    before: tuple[str, ...] = ()


def message_for(spelling: str) -> NodeMessage:
    """A shipped message, or one of a ``.proto`` file here, which is made and compiled if need be.

    Raises:
        UnknownMessageType: It is neither known nor a name for a type of one's own.
    """
    shipped = _shipped(spelling)
    if shipped is None:
        return _own(own_type(spelling))
    package, _, name = shipped.rpartition(".")
    part = ".data" if name == "String" else ""
    return NodeMessage(name, f"simple_ros.msg.{package}", _FIELDS.get(name, ""), part)


def own_type(name: str) -> str:
    """A name for a message type.

    Raises:
        ConfigError: It is none.
    """
    if not _TYPE.fullmatch(name):
        raise ConfigError(f"{name!r} is no name for a message type: letters and digits, as Reading")
    return name


def _shipped(spelling: str) -> str | None:
    from simple_ros.msg.registry import resolve_type_name, shipped_packages

    try:
        found = resolve_type_name(spelling)
    except UnknownMessageType as error:
        alike = any(name.endswith(f".{spelling}") for name in error.suggestions)
        if alike or not _TYPE.fullmatch(spelling):
            raise
        return None
    modules = shipped_packages().get(found.rpartition(".")[0], ())
    if not any(module.startswith("simple_ros.msg.") for module in modules):
        raise UnknownMessageType(spelling)
    return found


def _own(name: str) -> NodeMessage:
    stem = snake_case(name)
    file, module = Path(f"{stem}.proto"), Path(f"{stem}_pb2.py")
    is_new = not file.exists()
    made: list[Path] = []
    if is_new:
        write_all({file: rendered("message.proto", type=name, package=OWN_PACKAGE)})
        made.append(file)
    before: tuple[str, ...] = ()
    if not module.exists() or module.stat().st_mtime < file.stat().st_mtime:
        try:
            (module,) = compiled([file], Path(), [Path()])
            made += [module, module.with_suffix(".pyi")]
        except ConfigError:
            before = (INSTALL_COMPILER, f"simple-ros msg compile {file}")
    return NodeMessage(name, module.stem, _OWN_FIELDS if is_new else "", "", tuple(made), before)
