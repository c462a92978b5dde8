"""``simple-ros new talker``, ``listener``, ``msg``, ``service``, ``launch`` and ``package``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from simple_ros.cli.completion import complete_types
from simple_ros.cli.msg import INSTALL_COMPILER, compiled
from simple_ros.cli.new.messages import OWN_PACKAGE, NodeMessage, message_for, own_type
from simple_ros.cli.new.writing import free, module_name, rendered, snake_case, write_all
from simple_ros.cli.text import say
from simple_ros.errors import ConfigError

__all__ = ["launch", "listener", "message", "package", "service", "talker"]

MessageOption = Annotated[
    str,
    typer.Option(
        "--msg",
        "-m",
        metavar="TYPE",
        help="A shipped type, or the name of one of your own.",
        autocompletion=complete_types,
    ),
]
TopicOption = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Its topic.", show_default="chatter, or after the type"),
]
NameArgument = Annotated[
    str | None, typer.Argument(metavar="[NAME]", help="Of the node and its file.")
]


def talker(
    name: NameArgument = None, msg: MessageOption = "String", topic: TopicOption = None
) -> None:
    """Begin a node that publishes.

    With -m Reading it is about a type of your own: reading.proto is made, too, if it is not there.
    """
    _new_node("talker", name, msg, topic)


def listener(
    name: NameArgument = None, msg: MessageOption = "String", topic: TopicOption = None
) -> None:
    """Begin a node that subscribes.

    With -m Reading it is about a type of your own: reading.proto is made, too, if it is not there.
    """
    _new_node("listener", name, msg, topic)


def _new_node(kind: str, name: str | None, msg: str, topic: str | None) -> None:
    from simple_ros.names import topic_name

    stem = "" if msg == "String" else f"{snake_case(msg.replace('.', '/').rpartition('/')[2])}_"
    name = module_name(name or f"{stem}{kind}")
    on = topic_name(topic or stem.rstrip("_") or "chatter")
    path = free(Path(f"{name}.py"))
    about = message_for(msg)
    write_all({path: _node_text(kind, name, about, on)})
    _tell([*about.made, path], [*about.before, f"python {path}"])


def _node_text(kind: str, name: str, about: NodeMessage, topic: str) -> str:
    counts = kind == "talker" and bool(about.fields)
    gap = "" if about.module.startswith("simple_ros.") else "\n"
    ours = f"from simple_ros import NodeHandle{', TimerEvent' if kind == 'talker' else ''}"
    return rendered(
        f"{kind}.py",
        file=f"{name}.py",
        name=name,
        topic=topic,
        type=about.type,
        imports=f"{ours}\n{gap}from {about.module} import {about.type}",
        part=about.part,
        fields=about.fields,
        count="from itertools import count\n\n" if counts else "",
        numbers="numbers = count(1)\n" if counts else "",
    )


def message(
    type_name: Annotated[str, typer.Argument(metavar="TYPE", help="Its name, as Reading.")],
    package: Annotated[
        str, typer.Option(metavar="NAME", help="Package of the type.")
    ] = OWN_PACKAGE,
) -> None:
    """Begin a message type of your own, a .proto file."""
    path = Path(f"{snake_case(own_type(type_name))}.proto")
    text = rendered("message.proto", type=type_name, package=module_name(package))
    write_all({path: text})
    _tell([path], [f"simple-ros msg compile {path}"])


def service(
    name: Annotated[
        str, typer.Argument(metavar="[NAME]", help="Of the service, its node and its file.")
    ] = "lamp",
) -> None:
    """Begin a node that provides a service."""
    path = Path(f"{module_name(name)}.py")
    write_all({path: rendered("service.py", name=name, file=str(path))})
    _tell([path], [f"python {path}", f"simple-ros service call {name} 'data: true'"])


def launch(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="Of the file.")] = "robot",
) -> None:
    """Begin a launch file, for a talker and a listener, which are made, too, if they are not there."""
    path = Path(f"{module_name(name)}.launch.yaml")
    texts = {path: rendered("launch.yaml", file=str(path))}
    for kind in ("talker", "listener"):
        node = Path(f"{kind}.py")
        if not node.exists():
            texts[node] = _node_text(kind, kind, message_for("String"), "chatter")
    write_all(texts)
    _tell(list(texts), [f"simple-ros launch {path}"])


def package(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of the Python package.")],
) -> None:
    """Begin a package: a node, a message type, a launch file and a test, to be installed with pip."""
    name = module_name(name, package=True)
    values = {"name": name, "script": name.replace("_", "-")}
    root, module = free(Path(name)), Path(name) / name
    targets = {
        "pyproject.toml": root / "pyproject.toml",
        "README.md": root / "README.md",
        "gitignore": root / ".gitignore",
        "init.py": module / "__init__.py",
        "node.py": module / "node.py",
        "reading.proto": module / "reading.proto",
        "launch.yaml": module / f"{name}.launch.yaml",
        "test_node.py": root / "tests" / "test_node.py",
    }
    texts = {path: rendered(f"package/{file}", **values) for file, path in targets.items()}
    write_all(texts)
    made = list(texts)
    following = [f"pip install -e {name}", values["script"]]
    try:
        (reading,) = compiled([module / "reading.proto"], root, [root])
        made += [reading, reading.with_suffix(".pyi")]
    except ConfigError:
        compile_it = f"simple-ros msg compile {module}/reading.proto -I {name} -o {name}"
        following = [INSTALL_COMPILER, compile_it, *following]
    _tell(made, following)


def _tell(made: Sequence[Path], following: Sequence[str]) -> None:
    lines = [f"made {path}" for path in made]
    lines += [f"next: {command}" for command in following[:1]]
    lines += [f"      {command}" for command in following[1:]]
    say("\n".join(lines))
