"""Nouns that other packages add to ``simple-ros``.

A package names them in the entry point group ``simple_ros.cli``: the name is the noun, the object a
function (one command) or a `typer.Typer` (a command with commands below it). A plug-in is imported
when its noun is used or help is asked for, so the others cost nothing.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

__all__ = ["GROUP", "Nouns"]

GROUP = "simple_ros.cli"


class Nouns(TyperGroup):
    """The commands of ``simple-ros``: its own, then those of plug-ins."""

    def list_commands(self, ctx: Any) -> list[str]:
        """All nouns; those of plug-ins in the order of the alphabet."""
        own = super().list_commands(ctx)
        return [*own, *sorted(_entry_points().keys() - set(own))]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of a noun, or None; a plug-in that cannot be loaded is told on stderr."""
        own = super().get_command(ctx, cmd_name)
        if own is not None or (entry_point := _entry_points().get(cmd_name)) is None:
            return own
        try:
            command = _command(cmd_name, entry_point.load())
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            where = f"{cmd_name!r} ({entry_point.value})"
            print(f"warning: plug-in {where} cannot be loaded: {reason}", file=sys.stderr)
            return None
        self.add_command(command, cmd_name)
        return command


def _entry_points() -> dict[str, EntryPoint]:
    from importlib.metadata import entry_points

    return {entry_point.name: entry_point for entry_point in entry_points(group=GROUP)}


def _command(name: str, plugin: Any) -> Any:
    app = plugin
    if not isinstance(plugin, typer.Typer):
        app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
        app.command(name)(plugin)
    command = typer.main.get_command(app)
    command.name = name
    return command
