"""Engines: programs of other packages that are one node, found and run by name.

An engine is what WirelessROS calls its building blocks: a node that observes something and acts on it.
The entry point group ``simple_ros.engines`` names a class or function that makes an `Engine`;
``simple-ros engine list`` shows them and ``simple-ros engine run NAME`` runs one as a node.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from simple_ros import plugins
from simple_ros.errors import ConfigError
from simple_ros.node import NodeHandle

__all__ = ["Engine", "engine_named"]


class Engine(ABC):
    """The contract.

    Attributes:
        node_name: Name of its node, unless the user gives another.
        summary: What it does, in one line.
    """

    node_name: ClassVar[str]
    summary: ClassVar[str]

    @abstractmethod
    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends.

        Args:
            node: Started; closed by the caller afterwards.
        """


def engine_named(name: str) -> Engine:
    """A new engine.

    Raises:
        UnknownPlugin: No installed package offers it.
        BrokenPlugin: It cannot be imported.
        ConfigError: What the entry point names makes no engine.
    """
    factory = plugins.load(plugins.ENGINES, name)
    engine = factory()
    if not isinstance(engine, Engine):
        raise ConfigError(f"engine {name!r} is {engine!r}, no simple_ros.engine.Engine")
    return engine
