"""From templates to files, of which none is ever overwritten."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

from simple_ros.cli.graph import CannotWrite
from simple_ros.errors import ConfigError, SimpleRosError

__all__ = ["FileIsThere", "free", "module_name", "rendered", "snake_case", "write_all"]


class FileIsThere(SimpleRosError, FileExistsError):
    """A file that should be written is there already; nothing was written.

    Attributes:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(f"{path} is there already and stays as it is; give another name")


def rendered(template: str, **values: str) -> str:
    """A template, named by its path without ``.in``, with its ``$names`` filled in."""
    text = files("simple_ros.cli.new").joinpath("templates", f"{template}.in")
    return Template(text.read_text(encoding="utf-8")).substitute(values)


def free(path: Path) -> Path:
    """A path at which nothing is.

    Raises:
        FileIsThere: Something is.
    """
    if path.exists():
        raise FileIsThere(path)
    return path


def write_all(texts: Mapping[Path, str]) -> None:
    """Write files, all or none.

    Raises:
        FileIsThere: One of them exists.
        CannotWrite: The folder or the disk takes none.
    """
    for path in texts:
        free(path)
    written: list[Path] = []
    for path, text in texts.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8") as file:
                written.append(path)
                file.write(text)
        except OSError as error:
            for half_done in written:
                half_done.unlink(missing_ok=True)
            reason = error.strerror or error
            raise CannotWrite(f"cannot write {str(path)!r}: {reason}") from None


def module_name(name: str, *, package: bool = False) -> str:
    """A name under which Python can run a file or import a package.

    Raises:
        ConfigError: It is none, or it would hide a module that others need.
    """
    if not (name.isidentifier() and name.isascii() and name == name.lower()):
        raise ConfigError(f"{name!r} is no name for a Python file: small letters, digits and _")
    taken = name in sys.stdlib_module_names or name == "simple_ros"
    if taken or (package and find_spec(name) is not None and not Path(name).exists()):
        raise ConfigError(f"{name!r} would hide the Python module of that name; take another one")
    return name


def snake_case(name: str) -> str:
    """``LaserReading`` as ``laser_reading``."""
    parts = [
        f"_{char.lower()}" if char.isupper() and index and not name[index - 1].isupper() else char
        for index, char in enumerate(name)
    ]
    return "".join(parts).lower()
