"""``simple-ros msg``: message types, those of this installation and those that nodes brought."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.completion import complete_types
from simple_ros.errors import ConfigError, SimpleRosError, UnknownMessageType

if TYPE_CHECKING:
    from google.protobuf.message import Message

__all__ = ["INSTALL_COMPILER", "app", "compiled"]

INSTALL_COMPILER = "pip install grpcio-tools"

app = typer.Typer(help="Message types: list them, show their fields, compile your own.")

_MasterOption = Annotated[
    str | None,
    typer.Option("--master", metavar="HOST:PORT", help="Ask this Master for types unknown here."),
]


@app.command("list")
def list_types(
    filter: Annotated[str, typer.Argument(help="Only names that contain this.")] = "",  # noqa: A002
    as_json: Annotated[bool, typer.Option("--json", help="A JSON list.")] = False,
) -> None:
    """List the message types of this installation."""
    from simple_ros.msg.registry import message_types

    names = [name for name in message_types() if filter in name]
    if as_json:
        import json

        typer.echo(json.dumps(names))
        return
    for name in names:
        typer.echo(name)


@app.command("show")
def show(
    type_name: Annotated[
        str,
        typer.Argument(
            help="geometry_msgs.Twist or geometry_msgs/Twist.", autocompletion=complete_types
        ),
    ],
    master: _MasterOption = None,
) -> None:
    """Show the fields of a message type and of what it consists of."""
    from simple_ros.msg.definitions import definition_of, shown
    from simple_ros.msg.registry import MsgFactory, resolve_type_name

    try:
        name = resolve_type_name(type_name)
        message_class = MsgFactory.instance().get_class(name)
    except UnknownMessageType as unknown:
        message_class = asyncio.run(_from_master(type_name, master, unknown))
        name = message_class.DESCRIPTOR.full_name
    typer.echo(shown(definition_of(message_class), name), nl=False)


async def _from_master(
    type_name: str, master: str | None, unknown: UnknownMessageType
) -> type[Message]:
    """A class made of what some node declared; without a Master, the first error stands."""
    from simple_ros.errors import MasterUnavailable
    from simple_ros.net.master_client import MasterClient

    try:
        async with MasterClient(master) as client:
            return await client.message_class(type_name.replace("/", "."))
    except MasterUnavailable:
        if master is not None:
            raise
        raise unknown from None


@app.command("compile")
def compile_files(
    files: Annotated[list[Path], typer.Argument(help="Your .proto files.", exists=True)],
    out: Annotated[Path, typer.Option("--out", "-o", help="Directory for the modules.")] = Path(),
    include: Annotated[
        list[Path] | None, typer.Option("--include", "-I", help="Where imports are looked for.")
    ] = None,
) -> None:
    """Make importable Python modules of .proto files; they may import the shipped messages.

    ``mine.proto`` becomes ``mine_pb2.py``. In it, ``import "simple_ros/msg/geometry_msgs.proto";``
    gives ``geometry_msgs.Pose``.
    """
    roots = include or sorted({file.parent for file in files})
    for made in compiled(files, out, roots):
        typer.echo(f"made {made} and {made.with_suffix('.pyi')}")


def compiled(files: Sequence[Path], out: Path, roots: Sequence[Path]) -> list[Path]:
    """Make modules, and stubs beside them, of .proto files, which may import the shipped messages.

    Args:
        files: The .proto files.
        out: Directory for the modules; it is made if it is not there.
        roots: Where imports are looked for; a file keeps its path below one of them.

    Returns:
        The modules.

    Raises:
        ConfigError: The compiler is not installed.
        SimpleRosError: They do not compile; the compiler has said why on stderr.
    """
    try:
        from grpc_tools import protoc
    except ImportError:
        raise ConfigError(f"compiling needs the protobuf compiler: {INSTALL_COMPILER}") from None
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(prefix="simple_ros_msg_") as shipped:
        shipped.write(_shipped_definitions())
        shipped.flush()
        arguments = [
            *(f"-I{root}" for root in roots),
            f"--descriptor_set_in={shipped.name}",
            f"--python_out={out}",
            f"--pyi_out={out}",
            *(str(file) for file in files),
        ]
        if protoc.main(["protoc", *arguments]) != 0:
            raise SimpleRosError("not compiled; what is wrong is said above")
    return [_module(out, file, roots) for file in files]


def _module(out: Path, file: Path, roots: Sequence[Path]) -> Path:
    root = next((root for root in roots if file.is_relative_to(root)), file.parent)
    relative = file.relative_to(root)
    return out / relative.with_name(f"{relative.stem}_pb2.py")


def _shipped_definitions() -> bytes:
    """Every shipped message and what it needs, as the compiler takes them."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    from simple_ros.msg.definitions import definition_of
    from simple_ros.msg.registry import MsgFactory, message_types

    files = {
        file.name: file
        for name in message_types()
        for file in definition_of(MsgFactory.instance().get_class(name)).file
    }
    return FileDescriptorSet(file=files.values()).SerializeToString()
