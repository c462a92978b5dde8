"""The demo as an app sees it that connects to its bridge and imports its layout."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import re
import signal
import socket
import struct
from collections.abc import AsyncIterator
from itertools import pairwise
from operator import attrgetter
from typing import Any
from urllib.parse import parse_qs, urlsplit

import psutil
import pytest
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf import descriptor_pb2
from rich.console import Console
from support.processes import python
from websockets.asyncio.client import ClientConnection, connect

from simple_ros.demos.quad_demo_view import DemoState, screen
from simple_ros.foxglove.layouts import layout_names, layout_text
from simple_ros.msg.definitions import message_class

PROGRAM = ("-m", "simple_ros.cli.main", "demo")
FLIGHT = (*PROGRAM, "--plain", "--master-port", "0")


class App:
    """What an app knows of a server: channels by topic."""

    def __init__(self, connection: ClientConnection) -> None:
        self.channels: dict[str, dict[str, Any]] = {}
        self._connection = connection

    async def _read(self) -> bytes | None:
        """The next frame: noted if it is text, given if it is binary."""
        frame = await self._connection.recv()
        if isinstance(frame, bytes):
            return frame
        message = json.loads(frame)
        if message["op"] == "advertise":
            self.channels |= {channel["topic"]: channel for channel in message["channels"]}
        return None

    async def find(self, topics: set[str]) -> None:
        """Wait until all topics are offered."""
        while not topics <= self.channels.keys():
            await self._read()

    async def messages(self, topic: str, number: int) -> AsyncIterator[bytes]:
        """Subscribe under a number, and hear."""
        wish = {"id": number, "channelId": self.channels[topic]["id"]}
        await self._connection.send(json.dumps({"op": "subscribe", "subscriptions": [wish]}))
        while True:
            frame = await self._read()
            if frame and frame[0] == 1 and struct.unpack_from("<I", frame, 1) == (number,):
                yield frame[13:]

    def decoded(self, topic: str, payload: bytes) -> Any:
        """A message, by what the server told about its type."""
        channel = self.channels[topic]
        schema = base64.b64decode(channel["schema"])
        files = descriptor_pb2.FileDescriptorSet.FromString(schema)
        return message_class(files, channel["schemaName"]).FromString(payload)


def paths_of(layout: dict[str, Any]) -> list[tuple[str, str]]:
    """Every topic a layout shows, with the path to a part of its messages, or an empty one."""
    paths: list[tuple[str, str]] = []
    for config in layout["configById"].values():
        shown = [path["value"] for path in config.get("paths", ())]
        shown += config.get("topics", ())
        shown += [config["topicPath"]] if "topicPath" in config else []
        for text in shown:
            topic, _, path = text.partition(".")
            paths.append((topic, path))
    return paths


def panels_of(layout: Any) -> list[str]:
    if isinstance(layout, str):
        return [layout]
    return [*panels_of(layout["first"]), *panels_of(layout["second"])]


@pytest.mark.parametrize("name", layout_names())
def test_a_layout_is_whole(name: str) -> None:
    layout = json.loads(layout_text(name))
    assert sorted(panels_of(layout["layout"])) == sorted(layout["configById"])
    assert all("!" in panel for panel in layout["configById"])
    assert paths_of(layout)


async def test_the_layout_is_printed() -> None:
    async with python(*PROGRAM, "--layout") as demo:
        lines = [await demo.line()]
        while lines[-1] != "}":
            lines.append(await demo.line())
        assert await demo.wait() == 0
    assert "\n".join(lines) == layout_text("quadrotor")


async def test_the_flight_in_an_app() -> None:
    paths = paths_of(json.loads(layout_text("quadrotor")))
    async with python(*FLIGHT, "--foxglove-port", "0") as demo:
        while not (said := await demo.line()).startswith("in Foxglove: open "):
            pass
        match = re.match(r"in Foxglove: open (\S+);", said)
        assert match is not None
        (url,) = parse_qs(urlsplit(match[1]).query)["ds.url"]
        async with connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as connection:
            app = App(connection)
            await app.find({topic for topic, _ in paths})
            await see_the_quadrotor(app)
            await see_the_way(app)
            async for payload in app.messages("/quad_odometry", 3):
                odometry = app.decoded("/quad_odometry", payload)
                break
    plotted = [path for topic, path in paths if topic == "/quad_odometry" and path]
    assert len(plotted) == 6
    for path in plotted:
        assert isinstance(attrgetter(path)(odometry), float)


async def see_the_quadrotor(app: App) -> None:
    topic = "/quad_marker_array/scene"
    assert app.channels[topic]["schemaName"] == "foxglove.SceneUpdate"
    turns: set[float] = set()
    async for payload in app.messages(topic, 1):
        scene = app.decoded(topic, payload)
        assert [entity.id for entity in scene.entities] == [f"quadrotor_{n}" for n in range(9)]
        assert {entity.frame_id for entity in scene.entities} == {"world"}
        assert len(scene.entities[0].cubes) == 1
        body, propeller = scene.entities[0].cubes[0].pose, scene.entities[5].cylinders[0].pose
        # How far it is turned against the body is all in the angle between the two.
        q, p = body.orientation, propeller.orientation
        turns.add(round(q.x * p.x + q.y * p.y + q.z * p.z + q.w * p.w, 3))
        if len(turns) == 5:
            return


async def see_the_way(app: App) -> None:
    topic = "/quad_path_incremental/scene"
    counts = []
    async for payload in app.messages(topic, 2):
        scene = SceneUpdate.FromString(payload)
        counts.append(sum(len(entity.lines[0].points) for entity in scene.entities))
        if len(counts) == 5:
            break
    # Each scene has the whole way so far; a client that is slow may miss one.
    assert all(later > earlier for earlier, later in pairwise(counts))


async def test_the_bridge_ends_with_the_demo() -> None:
    async with python(*FLIGHT, "--foxglove-port", "0") as demo:
        while not (await demo.line()).startswith("in Foxglove: "):
            pass
        children = psutil.Process(demo.pid).children(recursive=True)
        assert any("foxglove" in child.cmdline() for child in children)
        demo.signal(signal.SIGINT)
        assert await demo.wait() == 0
        assert await demo.errors() == ""
    assert not any(child.is_running() for child in children)


async def test_a_taken_port_is_left_alone() -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        taken = holder.getsockname()[1]
        async with python(*FLIGHT, "--foxglove-port", str(taken)) as demo:
            async with asyncio.timeout(60):
                while not (said := await demo.line()).startswith("in Foxglove: open "):
                    pass
    assert str(taken) not in said


def test_the_screen_says_where_it_is() -> None:
    state = DemoState(
        "127.0.0.1:50051",
        "simple-ros",
        1.0,
        "",
        (),
        None,
        (),
        (),
        "ws://localhost:8765",
        "https://a",
    )
    console = Console(width=80, height=24, force_terminal=True, file=io.StringIO())
    console.print(screen(state, 80, 24))
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    assert "in Foxglove: ws://localhost:8765, layout: simple-ros demo --layout" in text
    assert ";https://a\x1b\\" in text
