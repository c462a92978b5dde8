"""``simple-ros param``: the parameters of the graph."""

from __future__ import annotations

import base64
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.cli.completion import complete_parameters
from simple_ros.cli.lookup import ask
from simple_ros.cli.options import CountOption, JsonOption, MasterOption
from simple_ros.cli.text import columns, json_line, put, say
from simple_ros.errors import ConfigError

if TYPE_CHECKING:
    from simple_ros.net.master_client import MasterClient
    from simple_ros.parameters.convert import ParameterInfo
    from simple_ros.parameters.values import Value

__all__ = ["app"]

app = typer.Typer(
    help="Look at parameters, and set them. Values are written as in YAML.", no_args_is_help=True
)

NameArgument = Annotated[
    str,
    typer.Argument(
        metavar="NAME",
        help="Name of a parameter, or of a group of them.",
        autocompletion=complete_parameters,
    ),
]
GroupArgument = Annotated[
    str,
    typer.Argument(
        metavar="[GROUP]", help="Only what is in this group.", autocompletion=complete_parameters
    ),
]


def _calls(client: MasterClient) -> Any:
    from simple_ros.parameters.calls import ParameterCalls

    return ParameterCalls(client)


# -- looking ---------------------------------------------------------------------------------------


@app.command("list")
def list_parameters(
    group: GroupArgument = "",
    values: Annotated[bool, typer.Option("--values", help="With types and values.")] = False,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print the names of the parameters."""
    prefix = group.strip("/")
    if not values and not json:
        names = ask(master, lambda client: _calls(client).list(prefix))
        if names:
            say("\n".join(names))
        return
    infos = ask(master, lambda client: _all_in(client, prefix))
    if json:
        say(json_line([_info_json(info) for info in infos]))
    elif infos:
        say(columns([(info.name, _type_text(info), _text(info.value)) for info in infos]))


async def _all_in(client: MasterClient, prefix: str) -> Sequence[ParameterInfo]:
    """What is known of all parameters of a group, which may be empty."""
    calls = _calls(client)
    names: Sequence[str] = await calls.list(prefix)
    infos: Sequence[ParameterInfo] = await calls.describe(prefix) if names else []
    return infos


@app.command()
def get(name: NameArgument, json: JsonOption = False, master: MasterOption = None) -> None:
    """Print the value of a parameter, or all of a group."""
    from simple_ros.names import parameter_name
    from simple_ros.parameters.text import written
    from simple_ros.parameters.tree import nested

    full = parameter_name(name)
    found = ask(master, lambda client: _calls(client).get(full))
    if full in found:
        say(json_line(_json(found[full])) if json else _text(found[full]))
        return
    inside = {key.removeprefix(f"{full}/"): value for key, value in found.items()}
    say(json_line(_json(nested(inside))) if json else written(inside))


@app.command()
def describe(name: NameArgument, json: JsonOption = False, master: MasterOption = None) -> None:
    """Print type, limits, description and origin of a parameter, or of each in a group."""
    from simple_ros.names import parameter_name

    full = parameter_name(name)
    infos = ask(master, lambda client: _calls(client).describe(full))
    if json:
        found = [_info_json(info) for info in infos]
        say(json_line(found[0] if infos[0].name == full else found))
    else:
        say("\n\n".join(_described(info) for info in infos))


def _described(info: ParameterInfo) -> str:
    lines = [f"Parameter: {info.name}"]
    said = info.descriptor
    if said is not None and said.description:
        lines.append(f"Description: {said.description}")
    lines += [f"Type: {_type_text(info)}", f"Value: {_text(info.value)} ({info.origin.value})"]
    if said is not None:
        limits = {"Minimum": said.minimum, "Maximum": said.maximum, "Step": said.step}
        lines += [f"{word}: {limit!r}" for word, limit in limits.items() if limit is not None]
        if said.choices:
            lines.append(f"Choices: {', '.join(map(_text, said.choices))}")
        if said.read_only:
            lines.append("Read-only")
    lines.append(f"Declared by: {', '.join(info.nodes) or 'no node that lives'}")
    return "\n".join(lines)


# -- changing --------------------------------------------------------------------------------------


@app.command("set", context_settings={"ignore_unknown_options": True})
def set_parameters(
    name: NameArgument,
    value: Annotated[str, typer.Argument(metavar="VALUE", help="Its value, in YAML.")],
    more: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME VALUE]...", help="Further ones, set together or not at all."),
    ] = None,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Set parameters: all of them, or none.

    A mapping as value sets a group.
    """
    words = [name, value, *(more or [])]
    if len(words) % 2:
        raise typer.BadParameter(f"{words[-1]!r} has no value; give pairs of NAME VALUE")
    pairs = list(zip(words[::2], words[1::2], strict=True))
    found = ask(master, lambda client: _set(client, pairs))
    if json:
        say(json_line({key: _json(item) for key, item in found.items()}))


async def _set(client: MasterClient, pairs: list[tuple[str, str]]) -> dict[str, Value]:
    from simple_ros.names import parameter_name
    from simple_ros.parameters.errors import BadParameterText
    from simple_ros.parameters.text import parse_value

    calls = _calls(client)
    values: dict[str, Value] = {}
    for given, text in pairs:
        name = parameter_name(given)
        if await _is_text(client, name):
            value: Any = _as_text(text)
        else:
            try:
                value = parse_value(text, name)
            except BadParameterText as error:
                raise ConfigError(f"value of {name!r}: {error.reason}") from None
        if isinstance(value, dict):
            values |= {f"{name}/{below}": item for below, item in value.items()}
        else:
            values[name] = value
    done: dict[str, Value] = (await calls.set(values))[0]
    return done


async def _is_text(client: MasterClient, name: str) -> bool:
    """Whether a parameter is declared to be text, so that ``1`` is no number there."""
    infos = await _all_in(client, name)
    said = infos[0].descriptor if infos and infos[0].name == name else None
    return said is not None and said.type == "string"


def _as_text(text: str) -> str:
    """Text as typed; of YAML only quotes are understood."""
    from simple_ros.parameters.errors import BadParameterText
    from simple_ros.parameters.text import parse_value

    if text[:1] in ("'", '"'):
        try:
            value = parse_value(text)
        except BadParameterText:
            return text
        return value if isinstance(value, str) else text
    return text


@app.command()
def delete(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME...",
            help="Names of parameters or groups.",
            autocompletion=complete_parameters,
        ),
    ],
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Delete parameters that no live node declares: all of them, or none."""
    from simple_ros.names import parameter_name

    full = [parameter_name(name) for name in names]
    gone = ask(master, lambda client: _calls(client).delete(*full))
    if json:
        say(json_line(list(gone)))


# -- files -----------------------------------------------------------------------------------------


@app.command()
def dump(
    group: GroupArgument = "",
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", dir_okay=False, help="Write it there."),
    ] = None,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print parameters as YAML that 'load' reads; names are relative to the group."""
    from simple_ros.parameters.text import written
    from simple_ros.parameters.tree import nested

    prefix = group.strip("/")
    infos = ask(master, lambda client: _all_in(client, prefix))
    start = f"{prefix}/" if prefix else ""
    if prefix and infos and infos[0].name == prefix:
        raise ConfigError(f"{prefix!r} is a parameter, not a group; see 'simple-ros param get'")
    values = {info.name.removeprefix(start): info.value for info in infos}
    text = json_line(_json(nested(values))) + "\n" if json else written(values)
    if output is None:
        put(text)
        return
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{output} cannot be written: {error.strerror}") from None


@app.command()
def load(
    file: Annotated[str, typer.Argument(metavar="FILE", help="YAML, as of 'dump'; - for stdin.")],
    group: Annotated[
        str,
        typer.Argument(
            metavar="[GROUP]", help="Put it in this group.", autocompletion=complete_parameters
        ),
    ] = "",
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Set the parameters of a file: all of them, or none."""
    from simple_ros.names import namespace_name
    from simple_ros.parameters.text import parse_tree

    prefix = namespace_name(group)
    start = f"{prefix}/" if prefix else ""
    values = {start + name: value for name, value in parse_tree(*_read(file)).items()}
    done = ask(master, lambda client: _calls(client).set(values))[0] if values else {}
    if json:
        say(json_line({key: _json(item) for key, item in done.items()}))


def _read(file: str) -> tuple[str, str]:
    """Text of a file, and what it is called."""
    try:
        if file == "-":
            return sys.stdin.read(), "stdin"
        return Path(file).read_text(encoding="utf-8"), file
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"{file} cannot be read: {reason}") from None


# -- watching --------------------------------------------------------------------------------------


@app.command()
def watch(
    group: GroupArgument = "",
    count: CountOption = None,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print parameters, and each change as it happens, until Ctrl-C.

    It goes on across restarts of the Master.
    """
    from simple_ros import aio

    aio.run(_watch(group.strip("/"), count, json, master))


async def _watch(prefix: str, count: int | None, as_json: bool, master: str | None) -> None:
    from simple_ros.net.master_client import MasterClient
    from simple_ros.parameters.watching import ParameterWatch

    async with MasterClient(master) as client:
        await _calls(client).list(prefix)  # says so if there is no Master
        async with ParameterWatch(lambda: client, prefix, None) as watching:
            await watching.wait_ready()
            left = count
            async for change in watching:
                if as_json:
                    value = {"value": _json(change.value), "previous": _json(change.previous)}
                    say(json_line({"name": change.name} | value))
                elif change.value is None:
                    say(f"{change.name} is gone")
                else:
                    say(f"{change.name}: {_text(change.value)}")
                left = None if left is None else left - 1
                if left == 0:
                    return


# -- text ------------------------------------------------------------------------------------------


def _text(value: Any) -> str:
    from simple_ros.parameters.text import value_text

    return value_text(value)


def _type_text(info: ParameterInfo) -> str:
    from simple_ros.parameters.values import type_of

    return info.descriptor.type if info.descriptor is not None else type_of(info.value)


def _json(value: Any) -> Any:
    """A value for JSON; bytes in base64."""
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if isinstance(value, list):
        return [_json(item) for item in value]
    if isinstance(value, dict):
        return {key: _json(item) for key, item in value.items()}
    return value


def _info_json(info: ParameterInfo) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": info.name,
        "type": _type_text(info),
        "value": _json(info.value),
        "origin": info.origin.value,
        "nodes": list(info.nodes),
    }
    said = info.descriptor
    if said is not None:
        found |= {
            "description": said.description,
            "minimum": said.minimum,
            "maximum": said.maximum,
            "step": said.step,
            "choices": [_json(choice) for choice in said.choices],
            "read_only": said.read_only,
        }
    return found
