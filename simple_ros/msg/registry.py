"""Find message classes by name.

The name of a message on the wire is its protobuf full name, ``geometry_msgs.Twist``. A shipped
message is found without an import by the user: the package part of its name tells the module to
import, so a process pays only for the packages it meets. Messages of the user are found once their
generated module is imported, because that puts them into protobuf's default pool, or once they are
registered.
"""

from __future__ import annotations

import pkgutil
from collections import defaultdict
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.message import Message

from simple_ros.errors import UnknownMessageType

__all__ = ["MsgFactory", "message_types", "resolve_type_name", "shipped_packages"]

M = TypeVar("M", bound=Message)

_GENERATED = "_pb2"
_MSG = "simple_ros.msg"
_RPC = "simple_ros.rpc"
_RPC_PACKAGE = "simple_ros"
_WELL_KNOWN_PACKAGE = "google.protobuf"
_WELL_KNOWN = ("any", "duration", "empty", "field_mask", "struct", "timestamp", "wrappers")
_FOREIGN_PREFIXES = ("simple_ros.msg.", "ros.")
_MAX_SUGGESTIONS = 3


class MsgFactory:
    """Makes messages from their full names.

    ``MsgFactory.instance()`` serves the process; a factory of one's own shares nothing with it but
    protobuf's default pool. All methods may be called from any thread.
    """

    def __init__(self) -> None:
        self._registered: dict[str, type[Message]] = {}
        self._found: dict[str, type[Message]] = {}

    @staticmethod
    def instance() -> MsgFactory:
        """Return the factory of this process."""
        return _INSTANCE

    def register_message(self, cls: type[M]) -> type[M]:
        """Make ``cls`` known under its full name; the latest registration of a name counts.

        Returns:
            ``cls``, so that this works as a class decorator as well.

        Raises:
            TypeError: ``cls`` is not a generated message class.
        """
        # The base class itself has a DESCRIPTOR too, which is None.
        if not (isinstance(cls, type) and issubclass(cls, Message) and cls.DESCRIPTOR):
            raise TypeError(
                f"register_message() needs a generated message class, got {cls!r}; "
                "pass the class itself, such as geometry_msgs.Twist"
            )
        name = cls.DESCRIPTOR.full_name
        self._registered[name] = cls
        self._found[name] = cls
        return cls

    def create_message(self, full_name: str) -> Message | None:
        """Return a new, empty message, or None if no message has exactly this full name."""
        cls = self.find_class(full_name)
        return None if cls is None else cls()

    def make_shared_message(self, message: M) -> M:
        """Return ``message``, as every reference is shared in Python; for code ported from C++."""
        return message

    def find_class(self, full_name: str) -> type[Message] | None:
        """Return the class with exactly this full name, or None.

        What is found is remembered; what is not found is looked up again the next time, so a module
        imported in between counts and names from the network cannot fill the memory.
        """
        cls = self._found.get(full_name)
        if cls is None:
            cls = _class_in_pool(full_name)
            if cls is not None:
                # A registration made by another thread meanwhile must win over the pool.
                cls = self._found.setdefault(full_name, cls)
        return cls

    def get_class(self, full_name: str) -> type[Message]:
        """Return the class with exactly this full name.

        Raises:
            UnknownMessageType: There is none; the error carries the names that look like it.
        """
        cls = self.find_class(full_name)
        if cls is None:
            raise UnknownMessageType(full_name, _suggestions(full_name, self.message_types()))
        return cls

    def message_types(self) -> list[str]:
        """Return the full names of all shipped and all registered messages, sorted.

        Imports every shipped message package. Control messages (``simple_ros.*``) are not listed,
        as they do not travel on topics.
        """
        return sorted(_shipped_types() | self._registered.keys())

    def resolve_type_name(self, spelling: str) -> str:
        """Return the full name that a person means by ``spelling``.

        Understands ``geometry_msgs/Twist``, ``geometry_msgs/msg/Twist``,
        ``geometry_msgs.msg.Twist``, ``geometry_msgs::msg::Twist``, ``ros.geometry_msgs.Twist``, the
        full name itself, and ``Twist`` alone where one package only has it. For people and tools;
        names on the wire are taken as they are.

        Raises:
            UnknownMessageType: No message, or more than one, is meant.
        """
        name = _canonical(spelling)
        for full_name in (spelling, name):
            if self.find_class(full_name) is not None:
                return full_name
        known = self.message_types()
        candidates = [full for full in known if full.rpartition(".")[2] == name]
        if len(candidates) == 1:
            return candidates[0]
        raise UnknownMessageType(spelling, candidates or _suggestions(name, known))


def message_types() -> list[str]:
    """Return the full names of all messages; see `MsgFactory.message_types`."""
    return _INSTANCE.message_types()


def resolve_type_name(spelling: str) -> str:
    """Return the full name meant by ``spelling``; see `MsgFactory.resolve_type_name`."""
    return _INSTANCE.resolve_type_name(spelling)


@cache
def shipped_packages() -> Mapping[str, tuple[str, ...]]:
    """Map each shipped protobuf package to the modules that hold it, without importing one of them.

    Below ``simple_ros/msg`` a file carries the name of its package; below ``simple_ros/rpc`` all
    files belong to the package ``simple_ros``.
    """
    root = Path(__file__).resolve().parent
    modules: defaultdict[str, list[str]] = defaultdict(list)
    for stem in _generated_stems(root):
        modules[stem].append(f"{_MSG}.{stem}{_GENERATED}")
    for stem in _generated_stems(root.parent / "rpc"):
        modules[_RPC_PACKAGE].append(f"{_RPC}.{stem}{_GENERATED}")
    for stem in _WELL_KNOWN:
        modules[_WELL_KNOWN_PACKAGE].append(f"{_WELL_KNOWN_PACKAGE}.{stem}{_GENERATED}")
    return MappingProxyType({package: tuple(names) for package, names in modules.items()})


def _generated_stems(folder: Path) -> list[str]:
    names = (module.name for module in pkgutil.iter_modules([str(folder)]))
    return sorted(name.removesuffix(_GENERATED) for name in names if name.endswith(_GENERATED))


def _class_in_pool(full_name: str) -> type[Message] | None:
    if not full_name.isascii():  # no name in protobuf is; the pool raises TypeError for a surrogate
        return None
    package = full_name.rpartition(".")[0]
    for module in shipped_packages().get(package, ()):
        import_module(module)
    try:
        descriptor = descriptor_pool.Default().FindMessageTypeByName(full_name)
    except KeyError:
        return None
    # The pool may read less than all of the name, as far as a NUL or after a leading dot.
    if descriptor.full_name != full_name:
        return None
    return message_factory.GetMessageClass(descriptor)


@cache
def _shipped_types() -> frozenset[str]:
    modules = (name for names in shipped_packages().values() for name in names)
    files = (import_module(name).DESCRIPTOR for name in modules if name.startswith(f"{_MSG}."))
    return frozenset(name for file in files for name in _types_in(file))


def _types_in(file: FileDescriptor) -> list[str]:
    return [message.full_name for message in file.message_types_by_name.values()]


def _canonical(spelling: str) -> str:
    name = spelling.strip().replace("::", ".").replace("/", ".").lstrip(".")
    for prefix in _FOREIGN_PREFIXES:
        name = name.removeprefix(prefix)
    return name.replace(".msg.", ".")


def _suggestions(name: str, known: Iterable[str]) -> list[str]:
    """The names in ``known`` that look like ``name``, those with the same last part first."""
    candidates = list(known)
    wanted = _canonical(name)
    last = wanted.rpartition(".")[2].lower()
    same = [full for full in candidates if full.rpartition(".")[2].lower() == last]
    alike = get_close_matches(wanted, candidates, n=_MAX_SUGGESTIONS, cutoff=0.7)
    if not same + alike and "." not in wanted:
        named = {full.rpartition(".")[2].lower(): full for full in candidates}
        alike = [named[part] for part in get_close_matches(last, named, cutoff=0.7)]
    return list(dict.fromkeys(same + alike))[:_MAX_SUGGESTIONS]


_INSTANCE = MsgFactory()
