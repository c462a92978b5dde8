"""Options and arguments that many commands share."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

import typer

from simple_ros.cli.completion import complete_nodes, complete_topics, complete_types

__all__ = [
    "CountOption",
    "FilterArgument",
    "JsonOption",
    "MasterOption",
    "NodeArgument",
    "Style",
    "StyleOption",
    "TopicArgument",
    "TypeArgument",
    "WindowOption",
]


class Style(Enum):
    """How something is written."""

    READABLE = "readable"
    CPP = "cpp"


MasterOption = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT",
        help="Where the Master is.",
        show_default="$SIMPLE_ROS_MASTER, else localhost:50051",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="JSON, for programs.")]
StyleOption = Annotated[
    Style, typer.Option("--format", help="For people, or as the tools of C++ simple_ros.")
]
CountOption = Annotated[int | None, typer.Option("-n", "--count", min=1, help="End after so many.")]
FilterArgument = Annotated[
    str, typer.Argument(metavar="[FILTER]", help="Only names that contain this.")
]
NodeArgument = Annotated[
    str,
    typer.Argument(metavar="NODE", help="Name of the node.", autocompletion=complete_nodes),
]
TopicArgument = Annotated[
    str,
    typer.Argument(metavar="TOPIC", help="Name of the topic.", autocompletion=complete_topics),
]
TypeArgument = Annotated[
    str,
    typer.Argument(metavar="TYPE", help="Type, in any spelling.", autocompletion=complete_types),
]
WindowOption = Annotated[
    int, typer.Option("--window", min=2, help="Over how many messages it is computed.")
]
