"""What every command that listens to a topic or publishes needs: a node, a type, a subscription."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

from simple_ros.cli.lookup import find_topic
from simple_ros.errors import HandleClosed, UnknownMessageType

if TYPE_CHECKING:
    from google.protobuf.message import Message

    from simple_ros.node import NodeHandle
    from simple_ros.subscriber import Subscriber

__all__ = ["class_of", "cli_node", "subscribe_bytes", "type_of", "while_running"]

_QUEUE_DEPTH = 1000


class _UnknownHere(UnknownMessageType):
    """A topic carries a type for which this program has no class."""

    def __init__(self, topic: str, error: UnknownMessageType) -> None:
        super().__init__(error.type_name, error.suggestions)
        self.args = (f"topic {topic!r} carries {error.type_name}, a type that is unknown here",)


@asynccontextmanager
async def cli_node(verb: str, master: str | None) -> AsyncIterator[NodeHandle]:
    """A node for one command; its name is taken by nobody else on this host."""
    from simple_ros.node import NodeHandle

    async with NodeHandle(f"cli_{verb}_{os.getpid()}", master=master) as node:
        yield node


async def while_running(node: NodeHandle, work: Coroutine[Any, Any, None]) -> None:
    """Do something until it is done, or until the node ends, which ``node kill`` may want.

    Raises:
        NodeNameTaken: A newer node runs under this node's name.
    """
    doing = asyncio.create_task(work)
    spinning = asyncio.create_task(node.spin())
    try:
        await asyncio.wait((doing, spinning), return_when=asyncio.FIRST_COMPLETED)
        if not spinning.done():
            try:
                await doing
                return
            except HandleClosed:
                if not node.is_closed:
                    raise
        await spinning
    finally:
        for task in (doing, spinning):
            task.cancel()
        await asyncio.gather(doing, spinning, return_exceptions=True)


async def type_of(topic: str, master: str | None) -> tuple[str, str]:
    """The name under which to subscribe to a topic, and its type.

    Raises:
        UnknownName: The Master knows no such topic.
    """
    from simple_ros.names import topic_name
    from simple_ros.net.master_client import MasterClient

    name = topic_name(topic)
    async with MasterClient(master) as client:
        _, found = await find_topic(client, name)
    return name, found.msg_type


async def class_of(topic: str, master: str | None) -> tuple[str, type[Message]]:
    """The name under which to subscribe to a topic, and the class of its messages.

    Raises:
        UnknownName: The Master knows no such topic.
        UnknownMessageType: Its type is known neither here nor to the Master.
    """
    from simple_ros.net.master_client import MasterClient

    name, msg_type = await type_of(topic, master)
    async with MasterClient(master) as client:
        try:
            return name, await client.message_class(msg_type)
        except UnknownMessageType as error:
            raise _UnknownHere(name, error) from None


async def subscribe_bytes(
    node: NodeHandle,
    topic: str,
    msg_type: str,
    callback: Callable[[bytes], None] | None = None,
) -> Subscriber[bytes]:
    """A subscription that every publisher can serve, as it requests nothing; for bytes."""
    from simple_ros.qos import QosProfile, Reliability

    qos = QosProfile(depth=_QUEUE_DEPTH, reliability=Reliability.BEST_EFFORT)
    return await node.subscribe(topic, msg_type, callback, qos=qos, raw=True)
