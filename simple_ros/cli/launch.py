"""``simple-ros launch``: start everything a launch file describes."""

from __future__ import annotations

import shlex
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.options import JsonOption
from simple_ros.cli.text import columns, json_line, say

if TYPE_CHECKING:
    from simple_ros.launch import LaunchDescription, ProcessDescription
    from simple_ros.launch.arguments import Argument

__all__ = ["command"]


class _Master(Enum):
    AUTO = "auto"
    START = "start"
    REQUIRE = "require"


def command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Launch file, YAML or Python.")],
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ARG:=VALUE]...", help="Arguments of the launch file."),
    ] = None,
    show: Annotated[
        bool, typer.Option("--show", "--dry-run", help="What would be started, and end.")
    ] = False,
    args: Annotated[
        bool, typer.Option("--args", help="The arguments of the file, and end.")
    ] = False,
    as_json: JsonOption = False,
    master: Annotated[
        _Master,
        typer.Option(help="Use a running Master or start one (auto), start one, or require one."),
    ] = _Master.AUTO,
    plain: Annotated[bool, typer.Option("--plain", help="One line an event, no table.")] = False,
) -> None:
    """Start the processes of a launch file, and end them together on Ctrl-C.

    Exit code 0 after Ctrl-C or when all ended well, 1 when a required process failed or one was
    given up.
    """
    from simple_ros.launch import LaunchFailed, arguments_of, describe
    from simple_ros.launch.arguments import split_words

    if args:
        declared = arguments_of(file)
        say(json_line(list(map(_argument_json, declared))) if as_json else _arguments(declared))
        return
    description = describe(file, split_words(words or []))
    if show or as_json:
        say(_as_json(description) if as_json else _shown(description))
        return
    if not description.processes:
        raise LaunchFailed(f"{file} describes no process")
    _run(description, master, plain=plain)


def _run(description: LaunchDescription, master: _Master, *, plain: bool) -> None:
    from simple_ros import aio
    from simple_ros.launch import Launcher, MasterChoice
    from simple_ros.launch.display import suitable_display

    with suitable_display(plain=plain) as display:
        launcher = Launcher(description, display, MasterChoice(master.value))
        aio.run(launcher.run())
    if launcher.has_failed:
        raise typer.Exit(1)


def _as_json(description: LaunchDescription) -> str:
    from simple_ros.launch.description import to_json

    return json_line(to_json(description))


def _argument_json(argument: Argument) -> dict[str, object]:
    return {
        "name": argument.name,
        "type": argument.type,
        "required": argument.is_required,
        "default": argument.default,
        "choices": list(argument.choices),
        "description": argument.description,
    }


def _arguments(declared: tuple[Argument, ...]) -> str:
    from simple_ros.launch.substitutions import as_text

    if not declared:
        return "no arguments"
    rows = []
    for argument in declared:
        default = "must be given" if argument.is_required else f"= {as_text(argument.default)}"
        one_of = (
            f" (one of {', '.join(map(as_text, argument.choices))})" if argument.choices else ""
        )
        rows.append((argument.name, argument.type, default, f"{argument.description}{one_of}"))
    return columns(rows)


def _shown(description: LaunchDescription) -> str:
    lines = [f"file: {name}" for name in description.files]
    for process in description.processes:
        lines += ["", *_process_lines(process)]
    return "\n".join(lines)


def _process_lines(process: ProcessDescription) -> list[str]:
    respawn, limits = process.respawn, process.limits
    wanted = {
        "command": shlex.join(process.command),
        "words": " ".join(process.words),
        "environment": " ".join(
            f"{name}={shlex.quote(value)}" if value is not None else f"(no {name})"
            for name, value in process.environment.items()
        ),
        "directory": process.cwd or "",
        "after": ", ".join(process.after),
        "ready": f"{process.ready}, within {process.ready_timeout_s:g} s",
        "respawn": ""
        if respawn is None
        else f"{'always' if respawn.always else 'on failure'}, {respawn.limit} times within "
        f"{respawn.within_s:g} s, after {respawn.delay_s:g} s to {respawn.max_delay_s:g} s",
        "required": "yes" if process.required else "",
        "limits": ", ".join(
            f"{name} {value}"
            for name, value in (
                ("memory", limits.memory_bytes and f"{limits.memory_bytes} bytes"),
                ("computing", limits.cpu_seconds and f"{limits.cpu_seconds} s"),
                ("files", limits.files),
                ("nice", limits.nice),
            )
            if value is not None
        ),
        "log": process.log.value,
    }
    head = f"{process.name}  ({process.place.file}:{process.place.line})"
    return [head, *(f"  {name}: {value}" for name, value in wanted.items() if value)]
