"""Layouts for Foxglove and Lichtblick: which panels show what. To be imported in the app."""

from __future__ import annotations

from importlib.resources import files

__all__ = ["layout_names", "layout_text"]

_ENDING = ".json"


def layout_names() -> tuple[str, ...]:
    """The layouts there are."""
    names = (item.name for item in files(__name__).iterdir())
    return tuple(sorted(name.removesuffix(_ENDING) for name in names if name.endswith(_ENDING)))


def layout_text(name: str) -> str:
    """A layout as JSON.

    Args:
        name: One of `layout_names`.

    Raises:
        FileNotFoundError: There is none of that name.
    """
    return files(__name__).joinpath(name + _ENDING).read_text(encoding="utf-8").rstrip("\n")
