"""Launch files on disk, in YAML and in Python."""

from __future__ import annotations

import importlib.util
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simple_ros.errors import SimpleRosError
from simple_ros.launch.arguments import Argument
from simple_ros.launch.description import LaunchDescription
from simple_ros.launch.errors import LaunchFileError, Place
from simple_ros.launch.reader import Reader
from simple_ros.launch.scope import LaunchSource
from simple_ros.launch.source import Entry, Value, entry_of, parse_yaml

__all__ = ["DiskFiles", "arguments_of", "describe"]


def describe(
    path: str | os.PathLike[str], given: Mapping[str, str] | None = None
) -> LaunchDescription:
    """What a launch file comes to on this host.

    Args:
        path: The file; ``.py`` is a Python launch file, anything else is YAML.
        given: Arguments by name, as text.

    Raises:
        LaunchFileError: The file, one it includes, or an argument has no meaning.
    """
    return _reader().describe(os.fspath(path), given or {})


def arguments_of(path: str | os.PathLike[str]) -> tuple[Argument, ...]:
    """The arguments a launch file declares.

    Raises:
        LaunchFileError: A declaration has no meaning.
    """
    return _reader().arguments(os.fspath(path))


def _reader() -> Reader:
    return Reader(DiskFiles(), os.environ, sys.executable, str(Path.cwd()))


class DiskFiles:
    """Files of this host; see `simple_ros.launch.scope.Files`."""

    def launch_file(self, path: str, asked_at: Place) -> LaunchSource:
        """A launch file, its language by the end of its name."""
        text = _text(path, asked_at)
        if path.endswith(".py"):
            return _PythonFile(path, text)
        return _YamlFile(parse_yaml(text, path))

    def parameter_file(self, path: str, asked_at: Place) -> Entry:
        """A YAML file."""
        return parse_yaml(_text(path, asked_at), path)

    def is_file(self, path: str) -> bool:
        """Whether there is one."""
        return Path(path).is_file()

    def find_package(self, module: str) -> str | None:
        """The directory of a package, without importing it."""
        try:
            spec = importlib.util.find_spec(module)
        except (ImportError, ValueError):
            return None
        if spec is None or not spec.submodule_search_locations:
            return None
        return next(iter(spec.submodule_search_locations))


def _text(path: str, asked_at: Place) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise LaunchFileError(asked_at, f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise LaunchFileError(asked_at, f"cannot read {path}: it is not UTF-8 text") from None


@dataclass(frozen=True, slots=True)
class _YamlFile:
    head: Entry

    def body(self, arguments: Mapping[str, Value]) -> Entry:  # noqa: ARG002  (substituted later)
        return self.head


class _PythonFile:
    """A module with ``launch(args)``, which returns entries, and perhaps ``ARGS``."""

    def __init__(self, path: str, text: str) -> None:
        self._path = path
        self._names: dict[str, Any] = {"__name__": "__launch__", "__file__": path}
        self._call(lambda: exec(compile(text, path, "exec"), self._names))  # noqa: S102
        place = Place(path)
        declared = entry_of(self._names.get("ARGS", {}), Place(path, 0, "ARGS"))
        self.head = Entry({"args": declared}, place)

    def body(self, arguments: Mapping[str, Value]) -> Entry:
        """What ``launch(args)`` returns."""
        function = self._names.get("launch")
        if not callable(function):
            raise LaunchFileError(Place(self._path), "must define launch(args)")
        entries = self._call(lambda: function(dict(arguments)))
        if isinstance(entries, Mapping | str) or not hasattr(entries, "__iter__"):
            raise LaunchFileError(Place(self._path), "launch(args) must return a list of entries")
        listed = entry_of(list(entries), Place(self._path, 0, "launch"))
        return Entry({"launch": listed}, Place(self._path))

    def _call(self, code: Callable[[], Any]) -> Any:
        """Run a part of the file; what it raises becomes an error that names the line."""
        try:
            return code()
        except SimpleRosError:
            raise
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            lines = [frame.lineno for frame in frames if frame.filename == self._path]
            line = error.lineno if isinstance(error, SyntaxError) else lines[-1] if lines else 0
            reason = error.msg if isinstance(error, SyntaxError) else error
            raise LaunchFileError(
                Place(self._path, line or 0), f"{type(error).__name__}: {reason}"
            ) from error
