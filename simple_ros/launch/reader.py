"""From launch files to a description: arguments, scopes, conditions, includes. Pure.

Files come through `Files`, the environment as a value; so the same reader serves YAML, Python and
tests.
"""

from __future__ import annotations

import contextlib
import posixpath
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from simple_ros.launch.arguments import TYPES, Argument, bound, converted, type_of
from simple_ros.launch.description import LaunchDescription, ProcessDescription, check_processes
from simple_ros.launch.errors import LaunchFileError, Place, nearest
from simple_ros.launch.fields import Fields
from simple_ros.launch.node_entry import NODE_KEYS, read_node
from simple_ros.launch.scope import (
    SCOPE_KEYS,
    Files,
    LaunchSource,
    Scope,
    full_name,
    is_wanted,
    path_from,
)
from simple_ros.launch.source import Entry, Value
from simple_ros.launch.substitutions import Context, substituted

__all__ = ["RESERVED_NAME", "Reader"]

RESERVED_NAME = "master"
"""The process of the Master, where the launch starts one."""

_KINDS = ("node", "group", "include", "parameters")
_CONDITIONS = ("if", "unless")
_FILE_KEYS = ("args", "launch", *SCOPE_KEYS)
_GROUP_KEYS = ("group", *SCOPE_KEYS, *_CONDITIONS)
_INCLUDE_KEYS = ("include", "args", *SCOPE_KEYS, *_CONDITIONS)
_PARAMETERS_KEYS = ("parameters", *_CONDITIONS)


@dataclass(slots=True)
class _Found:
    """What was read so far."""

    processes: list[tuple[ProcessDescription, Scope]] = field(default_factory=list)
    unwanted: set[str] = field(default_factory=set)
    files: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Inside:
    """Where reading is: the context of the file, and the files that include it."""

    context: Context
    chain: tuple[str, ...]


class Reader:
    """Reads launch files.

    Args:
        files: Where they come from.
        environment: For ``$(env ...)``.
        python: The interpreter that runs modules and scripts.
        directory: Where paths of launch files begin.
    """

    def __init__(
        self, files: Files, environment: Mapping[str, str], python: str, directory: str
    ) -> None:
        self._files = files
        self._environment = environment
        self._python = python
        self._directory = directory
        self._found = _Found()

    def arguments(self, path: str) -> tuple[Argument, ...]:
        """What a file declares.

        Raises:
            LaunchFileError: A declaration has no meaning.
        """
        return self._declared(self._files.launch_file(path, Place(path)), path)

    def describe(self, path: str, given: Mapping[str, str]) -> LaunchDescription:
        """What a file comes to with these arguments.

        Raises:
            LaunchFileError: The file, one it includes, or an argument has no meaning.
        """
        self._found = _Found()
        where = Place("command line")
        self._file(
            path, {name: (value, where) for name, value in given.items()}, Scope(), Place(path)
        )
        processes = self._with_known_order()
        check_processes(processes)
        return LaunchDescription(
            path, self.arguments(path), processes, tuple(dict.fromkeys(self._found.files))
        )

    # -- files ---------------------------------------------------------------------------------

    def _file(
        self,
        path: str,
        given: Mapping[str, tuple[Value, Place]],
        scope: Scope,
        asked_at: Place,
        chain: tuple[str, ...] = (),
    ) -> Scope:
        """Read a file; returns what holds behind the entry that includes it."""
        if path in chain:
            raise LaunchFileError(asked_at, f"{path} includes itself")
        source = self._files.launch_file(path, asked_at)
        self._found.files.append(path)
        values = bound(self._declared(source, path), given, asked_at)
        context = self._context(path, values)
        fields = Fields(source.body(values), _FILE_KEYS, context)
        inner = scope.inside(fields, self._files)
        self._entries(fields.items("launch"), inner, _Inside(context, (*chain, path)))
        if "launch" in fields:
            return scope
        return scope.with_sets(inner.parameter_sets[len(scope.parameter_sets) :])

    def _context(self, path: str, values: Mapping[str, Value]) -> Context:
        directory = posixpath.normpath(posixpath.join(self._directory, posixpath.dirname(path)))
        return Context(values, self._environment, directory, self._files.find_package)

    def _declared(self, source: LaunchSource, path: str) -> tuple[Argument, ...]:
        head = source.head
        if not isinstance(head.value, dict):
            raise LaunchFileError(head.place, f"a launch file must be a mapping, not {head.kind}")
        declarations = head.value.get("args")
        if declarations is None or declarations.value is None:
            return ()
        if not isinstance(declarations.value, dict):
            raise LaunchFileError(
                declarations.place, f"must be arguments by name, not {declarations.kind}"
            )
        context = self._context(path, {})
        return tuple(_argument(name, entry, context) for name, entry in declarations.value.items())

    # -- entries -------------------------------------------------------------------------------

    def _entries(self, entries: list[Entry], scope: Scope, inside: _Inside) -> None:
        for entry in entries:
            scope = self._entry(entry, scope, inside)

    def _entry(self, entry: Entry, scope: Scope, inside: _Inside) -> Scope:
        """Read an entry; returns the scope of those that follow."""
        match _kind(entry):
            case "node":
                self._node(Fields(entry, NODE_KEYS, inside.context), scope)
            case "group":
                self._group(Fields(entry, _GROUP_KEYS, inside.context), scope, inside)
            case "include":
                fields = Fields(entry, _INCLUDE_KEYS, inside.context)
                if is_wanted(fields):
                    return self._include(fields, scope, inside)
                self._skip_include(fields, scope, inside)
            case _:
                fields = Fields(entry, _PARAMETERS_KEYS, inside.context)
                if is_wanted(fields):
                    return scope.inside(fields, self._files)
        return scope

    def _node(self, fields: Fields, scope: Scope) -> None:
        name = full_name(fields, "node", full_name(fields, "namespace", scope.namespace))
        if not is_wanted(fields):
            self._found.unwanted.add(name)
            return
        if name == RESERVED_NAME:
            raise fields.error("node", f"the name {name!r} is that of the Master's process")
        self._found.processes.append((read_node(fields, scope, self._files, self._python), scope))

    def _group(self, fields: Fields, scope: Scope, inside: _Inside) -> None:
        if is_wanted(fields):
            inner = scope.inside(fields, self._files)
            self._entries(fields.items("group"), inner, inside)
        else:
            namespace = full_name(fields, "namespace", scope.namespace)
            self._skip(fields.items("group"), Scope(namespace), inside)

    def _skip(self, entries: list[Entry], scope: Scope, inside: _Inside) -> None:
        """Note the names of nodes that are not wanted: others may come ``after`` them."""
        for entry in entries:
            kind = _kind(entry)
            if kind == "group":
                fields = Fields(entry, _GROUP_KEYS, inside.context)
                inner = Scope(full_name(fields, "namespace", scope.namespace))
                self._skip(fields.items("group"), inner, inside)
            elif kind == "node":
                fields = Fields(entry, NODE_KEYS, inside.context)
                namespace = full_name(fields, "namespace", scope.namespace)
                self._found.unwanted.add(full_name(fields, "node", namespace))

    def _include(self, fields: Fields, scope: Scope, inside: _Inside) -> Scope:
        given: dict[str, tuple[Value, Place]] = {}
        entry = fields.get("args")
        if entry is not None and entry.value is not None:
            if not isinstance(entry.value, dict):
                raise fields.error("args", f"must be arguments by name, not {entry.kind}")
            for name, item in entry.value.items():
                given[name] = (substituted(item, inside.context), item.place)
        path = path_from(fields, fields.text("include"))
        asked_at = fields.entry.place.under("include")
        inner = scope.inside(fields, self._files)
        behind = self._file(path, given, inner, asked_at, inside.chain)
        return scope.with_sets(behind.parameter_sets[len(inner.parameter_sets) :])

    def _skip_include(self, fields: Fields, scope: Scope, inside: _Inside) -> None:
        """Note the names of the nodes in a file that is not wanted, as far as it can be read."""
        found, self._found = self._found, _Found()
        # What is not wanted may not even be on this host.
        with contextlib.suppress(LaunchFileError):
            self._include(fields, scope, inside)
        skipped, self._found = self._found, found
        found.unwanted |= skipped.unwanted | {process.name for process, _ in skipped.processes}

    # -- order ---------------------------------------------------------------------------------

    def _with_known_order(self) -> tuple[ProcessDescription, ...]:
        """The processes, with full names in ``after`` and without those that are not wanted."""
        names = {process.name for process, _ in self._found.processes}
        result = []
        for process, scope in self._found.processes:
            after = [self._resolved(word, process, scope, names) for word in process.after]
            result.append(replace(process, after=tuple(name for name in after if name)))
        return tuple(result)

    def _resolved(
        self, word: str, process: ProcessDescription, scope: Scope, names: set[str]
    ) -> str:
        """The full name meant by a word, searched from the innermost namespace outwards."""
        candidates = _outwards(word, process.name.rpartition("/")[0] or scope.namespace)
        for name in candidates:
            if name in names:
                return name
            if name in self._found.unwanted:
                return ""
        known = nearest(word, names - {process.name})
        raise LaunchFileError(process.place.under("after"), f"there is no node {word!r}{known}")


def _outwards(word: str, namespace: str) -> list[str]:
    if word.startswith("/"):
        return [word.lstrip("/")]
    parts = namespace.split("/") if namespace else []
    return ["/".join([*parts[:count], word]) for count in range(len(parts), -1, -1)]


def _kind(entry: Entry) -> str:
    if not isinstance(entry.value, dict):
        raise LaunchFileError(entry.place, f"must be a mapping, not {entry.kind}")
    kinds = [key for key in _KINDS if key in entry.value]
    # A node, group or include may have parameters, too.
    if len(kinds) > 1 and "parameters" in kinds:
        kinds.remove("parameters")
    if len(kinds) == 1:
        return kinds[0]
    keys = ", ".join(entry.value) or "nothing"
    raise LaunchFileError(
        entry.place, f"must have exactly one of {', '.join(_KINDS)}; it has {keys}"
    )


def _argument(name: str, entry: Entry, context: Context) -> Argument:
    if not name.isidentifier():
        raise LaunchFileError(entry.place, f"{name!r} is no name of an argument")
    if not isinstance(entry.value, dict):
        default = substituted(entry, context)
        known = default is not None
        kind = type_of(default) if known else "str"
        return Argument(name, kind, default, "", (), not known, entry.place)
    fields = Fields(entry, ("type", "default", "description", "choices"), context)
    default = fields.value("default")
    kind = fields.text("type", type_of(default))
    if kind not in TYPES:
        raise fields.error("type", f"cannot be {kind!r}; it is one of {', '.join(TYPES)}")
    place = fields.entry.place
    choices = [
        converted(substituted(item, context), kind, item.place, "a choice")
        for item in fields.items("choices")
    ]
    argument = Argument(
        name, kind, None, fields.text("description"), tuple(choices), "default" not in fields, place
    )
    if argument.is_required:
        return argument
    return replace(argument, default=argument.value_of(default, place.under("default")))
