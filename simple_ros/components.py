"""Components: several nodes in one process, on one event loop, that share messages by reference.

A component is a coroutine function that is given a started node and works until it is cancelled::

    async def talker(node):
        publisher = await node.advertise("chatter", String)
        node.create_timer(1.0, lambda event: publisher.publish(String(data="hello")))
        await node.spin()

An `Engine`, or a class that makes one, is a component, too. ``python -m simple_ros.components
robot.nodes:talker listen=robot.nodes:listener`` runs them; launch does the same. Between components nothing is
serialised: who publishes a message must not change it afterwards, nor may who receives it.
"""

from __future__ import annotations

import argparse
import asyncio
import importlib
import inspect
import logging
import sys
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simple_ros.arguments import BadArgument, parse_arguments
from simple_ros.engine import Engine
from simple_ros.errors import ConfigError, HandleClosed, NodeNameTaken, SimpleRosError
from simple_ros.net.transport import InProcess, TransportChoice
from simple_ros.node import NodeHandle

__all__ = ["DEFAULT_TRANSPORTS", "Component", "component", "main", "run_components"]

logger = logging.getLogger(__name__)

DEFAULT_TRANSPORTS = (InProcess.REFERENCE.value, "shm", "unix", "tcp")


@dataclass(frozen=True, slots=True)
class Component:
    """A node to be: its name and what it does."""

    name: str
    run: Callable[[NodeHandle], Awaitable[Any]]


def component(spec: str) -> Component:
    """A component from ``module:function`` or ``name=module:function``.

    Without a name, the node is called like the function, or as the engine says.

    Raises:
        ConfigError: It is not written so, there is no such thing, or it is no component.
    """
    name, separator, where = spec.rpartition("=")
    module, colon, attribute = where.partition(":")
    if not (module and colon and attribute) or (separator and not name):
        raise ConfigError(
            f"{spec!r} is no component; write module:function or name=module:function"
        )
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"component {spec!r} cannot be loaded: {error}") from error
    return _made(name, attribute.rpartition(".")[2], found, spec)


def _made(name: str, attribute: str, found: Any, spec: str) -> Component:
    if isinstance(found, type) and issubclass(found, Engine):
        found = found()
    if isinstance(found, Engine):
        return Component(name or found.node_name, found.run)
    if inspect.iscoroutinefunction(found):
        return Component(name or attribute, found)
    raise ConfigError(
        f"component {spec!r} is {found!r}: neither a coroutine function nor an Engine"
    )


async def run_components(
    components: Sequence[Component],
    *,
    master: str | None = None,
    transports: TransportChoice = DEFAULT_TRANSPORTS,
) -> int:
    """Run components until all have ended; one that fails ends by itself only.

    Args:
        components: Which; their names must differ.
        master: ``host:port`` of the Master.
        transports: As of `NodeHandle`.

    Returns:
        How many ended with an exception.

    Raises:
        ConfigError: Two have the same name.
    """
    names = [item.name for item in components]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(f"two components are called {twice[0]!r}; write name=module:function")
    results = await asyncio.gather(*(_run(item, master, transports) for item in components))
    return results.count(False)


async def _run(item: Component, master: str | None, transports: TransportChoice) -> bool:
    """Run one; whether it ended well."""
    try:
        async with NodeHandle(item.name, master=master, transports=transports) as node:
            problem = await _worked(item, node) or node.failure
    except (OSError, SimpleRosError) as error:
        problem = error
    if problem is None or isinstance(problem, HandleClosed):
        logger.info("component %r ended", item.name)
        return True
    if isinstance(problem, NodeNameTaken):
        logger.error("component %r ends: %s", item.name, problem)
    else:
        logger.error("component %r failed; the others go on", item.name, exc_info=problem)
    return False


async def _worked(item: Component, node: NodeHandle) -> Exception | None:
    """Let it work until it or its node ends; how it failed, if it did."""
    work = asyncio.ensure_future(item.run(node))
    ended = asyncio.create_task(node.wait_ended())
    results: list[object] = []
    try:
        await asyncio.wait((work, ended), return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (work, ended):
            task.cancel()
        results += await asyncio.gather(work, return_exceptions=True)
    return results[0] if isinstance(results[0], Exception) else None


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``python -m simple_ros.components``; return its exit code."""
    from simple_ros import aio

    parser = argparse.ArgumentParser(
        prog="python -m simple_ros.components",
        description="Run several nodes in one process.",
        epilog="Words with := are for the nodes: name:from:=to, name:_parameter:=value.",
    )
    parser.add_argument("components", nargs="+", metavar="[NAME=]MODULE:FUNCTION")
    parser.add_argument("--master", metavar="HOST:PORT", help="where the Master is")
    parser.add_argument(
        "--transports",
        metavar="NAMES",
        default=",".join(DEFAULT_TRANSPORTS),
        help="how messages travel (default: %(default)s)",
    )
    words = sys.argv[1:] if argv is None else argv
    options = parser.parse_args([word for word in words if ":=" not in word])
    sys.path.insert(0, str(Path.cwd()))
    try:
        parse_arguments([word for word in words if ":=" in word])  # told once, not by each node
        found = [component(spec) for spec in options.components]
        transports = tuple(name.strip() for name in options.transports.split(",") if name.strip())
        failed = aio.run(run_components(found, master=options.master, transports=transports))
    except (BadArgument, ConfigError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
