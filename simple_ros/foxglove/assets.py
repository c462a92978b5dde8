"""Files for clients: robot descriptions and meshes, from directories that were named for it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote, urlsplit

from simple_ros.bag.plan import pattern_of
from simple_ros.errors import ConfigError
from simple_ros.foxglove.errors import AssetRefused

__all__ = ["AssetRoots"]

_MAX_BYTES = 256 * 1024 * 1024


class AssetRoots:
    """Finds ``package://NAME/path`` below the directory of NAME, and nowhere else.

    Args:
        roots: Directories by package name.
        pattern: Only files whose URI fits, somewhere in it; None for all.

    Raises:
        ConfigError: One is no directory.
    """

    def __init__(self, roots: Mapping[str, Path], pattern: re.Pattern[str] | None = None) -> None:
        for name, root in roots.items():
            if not root.is_dir():
                raise ConfigError(f"the asset root of {name!r}, {root}, is no directory")
        self._roots = {name: root.resolve() for name, root in roots.items()}
        self._pattern = pattern

    @classmethod
    def made(cls, texts: Sequence[str], pattern: str | None = None) -> AssetRoots:
        """Roots as a user writes them.

        Args:
            texts: ``NAME=DIRECTORY`` each.
            pattern: Regular expression of the URIs that are served; None for all.

        Raises:
            ConfigError: A text is none, or names no directory, or the pattern is no regular expression.
        """
        roots = {}
        for text in texts:
            name, there, directory = text.partition("=")
            if not (name and there and directory):
                raise ConfigError(f"--asset-root wants NAME=DIRECTORY, not {text!r}")
            roots[name] = Path(directory).expanduser()
        return cls(roots, pattern_of(pattern, "the pattern of assets"))

    def __bool__(self) -> bool:
        return bool(self._roots)

    def read(self, uri: str) -> bytes:
        """The content of a file; blocks meanwhile.

        Raises:
            AssetRefused: It is not below its root, not there, or cannot be read.
        """
        path = self._path_of(uri)
        try:
            if not path.is_file():
                raise AssetRefused(uri, "there is no such file")
            if path.stat().st_size > _MAX_BYTES:
                raise AssetRefused(uri, f"the file is larger than {_MAX_BYTES} bytes")
            return path.read_bytes()
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise AssetRefused(uri, reason) from None

    def _path_of(self, uri: str) -> Path:
        try:
            parts = urlsplit(uri)
        except ValueError as error:
            raise AssetRefused(uri, f"no URI ({error})") from None
        if parts.scheme != "package":
            raise AssetRefused(uri, "only package:// is served")
        if self._pattern is not None and not self._pattern.search(uri):
            raise AssetRefused(uri, "it is not among the assets that are served")
        root = self._roots.get(parts.netloc)
        if root is None:
            known = ", ".join(sorted(self._roots)) or "none"
            raise AssetRefused(uri, f"there is no package {parts.netloc!r} here; there is {known}")
        try:
            path = (root / unquote(parts.path).lstrip("/")).resolve()
        except (OSError, ValueError, RuntimeError) as error:
            raise AssetRefused(uri, f"no path ({error})") from None
        if not path.is_relative_to(root):
            raise AssetRefused(uri, "it leads out of its package")
        return path
