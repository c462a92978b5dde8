"""Commands that other packages add to ``simple-ros``.

A package names them in an entry point group: ``simple_ros.cli`` for nouns, ``simple_ros.demos`` for
demos. The name is the word to type, the object a function (one command) or a `typer.Typer` (a command
with commands below it). A plug-in is imported when it is used or help is asked for, so the others cost
nothing.
"""

from __future__ import annotations

import sys
from typing import Any, ClassVar

import typer
from typer.core import TyperGroup

from simple_ros import plugins

__all__ = ["Demos", "Nouns"]


class _Plugged(TyperGroup):
    """A group's own commands, then those of plug-ins."""

    entry_points: ClassVar[str]

    def list_commands(self, ctx: Any) -> list[str]:
        """All of them; those of plug-ins in the order of the alphabet."""
        own = super().list_commands(ctx)
        return [*own, *(name for name in plugins.names(self.entry_points) if name not in own)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command, or None; a plug-in that cannot be loaded is told on stderr."""
        own = super().get_command(ctx, cmd_name)
        if own is not None:
            return own
        try:
            command = _command(cmd_name, plugins.load(self.entry_points, cmd_name))
        except plugins.UnknownPlugin:
            return None
        except plugins.BrokenPlugin as error:
            print(f"warning: {error}", file=sys.stderr)
            return None
        self.add_command(command, cmd_name)
        return command


class Nouns(_Plugged):
    """The commands of ``simple-ros``."""

    entry_points = plugins.CLI


class Demos(_Plugged):
    """The demos of ``simple-ros demo``."""

    entry_points = plugins.DEMOS


def _command(name: str, plugin: Any) -> Any:
    app = plugin
    if not isinstance(plugin, typer.Typer):
        app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
        app.command(name)(plugin)
    command = typer.main.get_command(app)
    command.name = name
    return command
