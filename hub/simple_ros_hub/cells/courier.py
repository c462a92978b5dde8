"""The courier cell: one of several ways for a topic."""

from __future__ import annotations

from typing import Any, ClassVar

from simple_ros.errors import ConfigError
from simple_ros.msg.registry import resolve_type_name
from simple_ros.msg.std_msgs import String
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_hub.cells.topic_cell import TopicCell
from simple_ros_hub.components import NAMESPACE

__all__ = ["CourierCell"]


class CourierCell(TopicCell):
    """Hands a topic on while the hub's route is its link.

    There is one for each link, in a process that is bound to that network from outside. Parameters: ``source``,
    ``sink`` (topics), ``type`` (of their messages), ``link`` (its own), ``first`` (whether it is the one that works
    while no hub has told a route).
    """

    cell_name: ClassVar[str] = "courier_cell"
    summary: ClassVar[str] = "One of several ways for a topic, taken while the hub says so."
    priority: int = 3
    share: ClassVar[float] = 1.0

    def __init__(self) -> None:
        super().__init__()
        self.route = ""
        self._is_first = False
        self._publisher: Publisher[Any] | None = None

    @property
    def is_taken(self) -> bool:
        """Whether messages go its way."""
        return self.route == self._link if self.route else self._is_first

    async def set_up(self, node: NodeHandle) -> None:
        """Join source and sink."""
        get = node.declare_parameter
        words = {
            name: str(await get(f"~{name}", "", read_only=True))
            for name in ("source", "sink", "type")
        }
        for name, value in {**words, "link": self._link}.items():
            if not value:
                raise ConfigError(f"a courier needs the parameter {name!r}")
        self._is_first = bool(await get("~first", False, read_only=True))
        type_name = resolve_type_name(words["type"])
        message_class = await node.client.message_class(type_name)
        self._publisher = await node.advertise(words["sink"], message_class)
        await node.subscribe(f"/{NAMESPACE}/route", String, self._told, qos=LATCHED)
        await node.subscribe(
            words["source"], type_name, self._came, raw=True, qos=QosProfile(depth=20)
        )

    def _told(self, message: String) -> None:
        self.route = message.data

    def _came(self, data: bytes) -> None:
        self.came(len(data))
        if self.is_taken:
            self.execute(data)

    def _execute(self, data: bytes) -> int:
        assert self._publisher is not None
        return len(data) if self.send(self._publisher, data) else 0
