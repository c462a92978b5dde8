"""A client of the Foxglove protocol for tests, on the library ``websockets``."""

from __future__ import annotations

import asyncio
import base64
import json
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from simple_ros import aio
from simple_ros.foxglove import Bridge, BridgeOptions
from simple_ros.msg.definitions import message_class
from support.waiting import LIMIT_S, until

BOTH = ("foxglove.websocket.v1", "foxglove.sdk.v1")


class FoxClient:
    """Keeps all that a server says."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.ops: list[dict[str, Any]] = []
        self.channels: dict[int, dict[str, Any]] = {}
        self.services: dict[int, dict[str, Any]] = {}
        self.messages: list[tuple[int, int, bytes]] = []
        self.times: list[int] = []
        self.binary: list[bytes] = []
        self.first: str | bytes | None = None
        self.closed: ConnectionClosed | None = None
        self.paused = asyncio.Event()
        self.paused.set()
        self._ids: dict[int, str] = {}
        self._next = 0

    async def listen(self) -> None:
        try:
            while True:
                await self.paused.wait()
                self._take(await self.socket.recv())
        except ConnectionClosed as closed:
            self.closed = closed

    def _take(self, frame: str | bytes) -> None:
        self.first = self.first or frame
        if isinstance(frame, str):
            self._take_text(json.loads(frame))
        elif frame[0] == 1:
            subscription, stamp = struct.unpack_from("<IQ", frame, 1)
            self.messages.append((subscription, stamp, frame[13:]))
        elif frame[0] == 2:
            self.times += struct.unpack_from("<Q", frame, 1)
        else:
            self.binary.append(frame)

    def _take_text(self, document: dict[str, Any]) -> None:
        self.ops.append(document)
        match document["op"]:
            case "advertise":
                for channel in document["channels"]:
                    # Offered once more is only what is offered already, after a new session.
                    assert self.channels.get(channel["id"], channel) == channel
                    self.channels[channel["id"]] = channel
            case "unadvertise":
                for number in document["channelIds"]:
                    del self.channels[number]
            case "advertiseServices":
                self.services |= {item["id"]: item for item in document["services"]}
            case "unadvertiseServices":
                for number in document["serviceIds"]:
                    del self.services[number]

    # -- what it says --------------------------------------------------------------------------

    async def say(self, op: str, **fields: Any) -> None:
        await self.socket.send(json.dumps({"op": op, **fields}))

    async def channel(self, topic: str) -> dict[str, Any]:
        """The channel of a topic, when it is there."""
        await until(lambda: topic in self.topics, f"channel of {topic}")
        return next(item for item in self.channels.values() if item["topic"] == topic)

    @property
    def topics(self) -> list[str]:
        return [channel["topic"] for channel in self.channels.values()]

    async def subscribe(self, topic: str) -> int:
        """Subscribe to a topic when it is there; gives the subscription's id."""
        channel = await self.channel(topic)
        number, self._next = self._next, self._next + 1
        self._ids[number] = topic
        subscription = {"id": number, "channelId": channel["id"]}
        await self.say("subscribe", subscriptions=[subscription])
        return number

    def subscription_channel(self, topic: str) -> int:
        """Id of the channel of a topic that is there."""
        return next(item["id"] for item in self.channels.values() if item["topic"] == topic)

    def on(self, topic: str) -> list[bytes]:
        """Messages of a topic so far."""
        return [data for number, _, data in self.messages if self._ids[number] == topic]

    def decoder(self, topic: str) -> type[Message]:
        """The class that the advertised schema describes."""
        channel = next(item for item in self.channels.values() if item["topic"] == topic)
        files = FileDescriptorSet.FromString(base64.b64decode(channel["schema"], validate=True))
        return message_class(files, channel["schemaName"])

    async def advertise(self, number: int, topic: str, schema: str, encoding: str = "json") -> None:
        channel = {"id": number, "topic": topic, "encoding": encoding, "schemaName": schema}
        await self.say("advertise", channels=[channel])

    async def publish(self, number: int, payload: bytes) -> None:
        await self.socket.send(b"\x01" + struct.pack("<I", number) + payload)

    async def call(self, name: str, call: int, request: Any) -> None:
        await until(lambda: name in [item["name"] for item in self.services.values()], name)
        number = next(item["id"] for item in self.services.values() if item["name"] == name)
        head = struct.pack("<BIII", 2, number, call, 4) + b"json"
        await self.socket.send(head + json.dumps(request).encode())

    # -- what it heard -------------------------------------------------------------------------

    def heard(self, op: str) -> list[dict[str, Any]]:
        return [document for document in self.ops if document["op"] == op]

    def statuses(self) -> list[tuple[int, str]]:
        return [(item["level"], item["message"]) for item in self.heard("status")]

    def answer(self, call: int) -> Any:
        """The answer to a call of a service, if it has come."""
        for frame in self.binary:
            if frame[0] == 3 and struct.unpack_from("<I", frame, 5)[0] == call:
                return json.loads(frame[17:])
        return None

    def parameters(self, request: str | None = None) -> list[dict[str, Any]]:
        """What the last parameterValues with that id holds."""
        found = [item for item in self.heard("parameterValues") if item.get("id") == request]
        return found[-1]["parameters"] if found else []


@asynccontextmanager
async def connected(
    port: int, subprotocols: tuple[str, ...] = BOTH, **options: Any
) -> AsyncIterator[FoxClient]:
    """A client of the server on a port of this host."""
    offered = [Subprotocol(name) for name in subprotocols]
    settings: dict[str, Any] = {
        "compression": None,
        "max_size": None,
        "proxy": None,
        "open_timeout": LIMIT_S,
    } | options
    async with connect(f"ws://127.0.0.1:{port}", subprotocols=offered, **settings) as socket:
        client = FoxClient(socket)
        task = asyncio.create_task(client.listen())
        await until(lambda: client.heard("serverInfo"), "serverInfo")
        try:
            yield client
        finally:
            client.paused.set()
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


@asynccontextmanager
async def bridged(master: str, options: BridgeOptions | None = None) -> AsyncIterator[Bridge]:
    """A bridge in this process."""
    async with aio.NodeHandle("bridge", master=master) as node:
        bridge = Bridge(node, options or BridgeOptions())
        async with bridge.server.listening(port=0):
            running = asyncio.create_task(bridge.run())
            try:
                yield bridge
            finally:
                running.cancel()
                await asyncio.gather(running, return_exceptions=True)
