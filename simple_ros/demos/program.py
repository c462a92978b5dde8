"""A node as a program: one option, ends on a signal, says its errors in one line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Coroutine
from typing import Any

from simple_ros import aio
from simple_ros.errors import SimpleRosError

__all__ = ["run_node"]


def run_node(description: str, main: Callable[[str | None], Coroutine[Any, Any, None]]) -> None:
    """Run ``main`` with the value of ``--master`` until SIGINT or SIGTERM.

    Raises:
        SystemExit: With code 1, after an error of this project was printed.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--master",
        metavar="HOST:PORT",
        help="where the Master is; otherwise $SIMPLE_ROS_MASTER, else localhost:50051",
    )
    try:
        aio.run(main(parser.parse_args().master))
    except SimpleRosError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
