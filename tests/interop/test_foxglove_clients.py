"""Clients that nobody here wrote look at the bridge: npm's @foxglove/ws-protocol, in Node and in a browser, and pymcap-cli."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import shutil
import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pb2
from support.bags import texts
from support.browser import BROWSER, OTHER_HOST, told_by
from support.foxglove import bridged

from simple_ros import aio
from simple_ros.bag import Bag
from simple_ros.foxglove import (
    Access,
    AssetRoots,
    Bridge,
    BridgeOptions,
    FoxgloveServer,
    ServerOptions,
)
from simple_ros.msg.definitions import message_class
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.sensor_msgs import LaserScan
from simple_ros.msg.std_msgs import String
from simple_ros.msg.std_srvs import SetBool
from simple_ros.qos import LATCHED
from simple_ros_master import Master

FOLDER = Path(__file__).parent / "foxglove"
NODE = shutil.which("node")
PYMCAP = shutil.which("pymcap-cli", path=str(Path(sys.executable).parent))

needs_node = pytest.mark.skipif(
    NODE is None or not (FOLDER / "node_modules").is_dir(),
    reason=f"needs node and 'npm install --no-package-lock' in {FOLDER.name}/",
)
needs_browser = pytest.mark.skipif(
    BROWSER is None or not (FOLDER / "node_modules").is_dir(),
    reason=f"needs chromium, and of node 'npm install --no-package-lock' in {FOLDER.name}/",
)
needs_pymcap = pytest.mark.skipif(
    PYMCAP is None or importlib.util.find_spec("robo_ws_bridge") is None,
    reason="pymcap-cli[bridge] is not installed",
)


def their_type() -> Any:
    """A type that only its node knows."""
    file = descriptor_pb2.FileDescriptorProto(name="t.proto", package="their_msgs", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    thing = file.message_type.add(name="Thing")
    for number, (name, kind) in enumerate([("size", 5), ("big_number", 3)], 1):
        thing.field.add(name=name, number=number, type=kind, label=1)  # type: ignore[arg-type]
    stamp = thing.field.add(name="made_at", number=3, type=11, label=1)  # type: ignore[arg-type]
    stamp.type_name = ".google.protobuf.Timestamp"
    from google.protobuf import timestamp_pb2

    files = descriptor_pb2.FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    files.file.append(file)
    return message_class(files, "their_msgs.Thing")


@asynccontextmanager
async def robot(
    master: Master, tmp_path: Path, server: ServerOptions | None = None
) -> AsyncIterator[tuple[Bridge, list[Twist]]]:
    """Something of everything, and a bridge."""
    (tmp_path / "robot.urdf").write_text("<robot/>")
    drives: list[Twist] = []

    def switch(request: Any) -> Any:
        if not request.data:
            raise RuntimeError("stays on")
        return SetBool.response(success=True, message="on")

    options = BridgeOptions(server or ServerOptions(), AssetRoots({"robot": tmp_path}))
    async with (
        aio.NodeHandle("robot", master=master.address) as node,
        bridged(master.address, options) as bridge,
    ):

        async def drive(message: Twist) -> None:
            if not drives:
                await node.advertise("heard", String)
            drives.append(message)

        thing = their_type()
        for topic, message in [
            ("map", String(data="a map")),
            ("scan", LaserScan(ranges=[1.5, 2.5], angle_max=1.0)),
            ("things", thing(size=7, big_number=2**60, made_at={"seconds": 5, "nanos": 6})),
        ]:
            publisher = await node.advertise(topic, type(message), qos=LATCHED)
            publisher.publish(message)
        await node.subscribe("cmd_vel", Twist, drive)
        await node.declare_parameter("~gain", 2.5)
        await node.advertise_service("switch", SetBool, switch)
        yield bridge, drives


async def output_of(*command: str) -> str:
    process = await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    try:
        out, err = await asyncio.wait_for(process.communicate(), 30)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    assert process.returncode == 0, out.decode() + err.decode()
    return out.decode()


@needs_node
@pytest.mark.parametrize("subprotocol", ["foxglove.websocket.v1", "foxglove.sdk.v1"])
async def test_the_client_of_foxglove(master: Master, tmp_path: Path, subprotocol: str) -> None:
    assert NODE is not None
    async with robot(master, tmp_path) as (bridge, drives):
        url = f"ws://127.0.0.1:{bridge.server.port}"
        heard = json.loads(await output_of(NODE, str(FOLDER / "client.mjs"), url, subprotocol))
    assert heard["subprotocol"] == subprotocol
    check(heard, drives)


def check(heard: dict[str, Any], drives: list[Twist]) -> None:
    """What the conversation is to come to, wherever it is held."""
    assert "json" in heard["serverInfo"]["supportedEncodings"]
    assert heard["messages"]["/map"] == [{"data": "a map"}]
    assert heard["messages"]["/scan"][0]["ranges"] == [1.5, 2.5]
    assert heard["messages"]["/scan/scan"][0]["ranges"] == [1.5, 2.5]
    (thing,) = heard["messages"]["/things"]
    assert thing["size"] == 7
    assert thing["made_at"]["nanos"] == 6
    gain = {"name": "/robot/gain", "value": 2.5, "type": "float64"}
    assert heard["parameters"] == [gain]
    assert heard["parametersSet"] == heard["parameterUpdates"] == [gain | {"value": 3}]
    assert heard["service"]["type"] == "std_srvs.SetBool"
    assert heard["calls"][0] == ["json", {"success": True, "message": "on"}]
    assert heard["calls"][1][0] == "failure"
    assert "stays on" in heard["calls"][1][1]
    assert {"name": "/map", "publisherIds": ["/robot"]} in heard["graph"][0]["publishedTopics"]
    assert {"name": "/switch", "providerIds": ["/robot"]} in heard["graph"][0]["advertisedServices"]
    assert heard["assets"][0] == "<robot/>"
    assert "no such file" in heard["assets"][1]
    assert [(twist.linear.x, twist.angular.z) for twist in drives] == [(0.5, 1.0)]
    assert sorted(level for level, _ in heard["statuses"]) == [1, 2]


@needs_browser
@pytest.mark.parametrize("compress", [False, True])
async def test_a_page_in_a_browser(master: Master, tmp_path: Path, *, compress: bool) -> None:
    server = ServerOptions(compress=compress)
    async with robot(master, tmp_path, server) as (bridge, drives):
        url = f"ws://localhost:{bridge.server.port}"
        heard = json.loads(await told_by(FOLDER, f"page.html#talk={url}", tmp_path / "profile"))
    assert "error" not in heard, heard
    assert heard["subprotocol"] == "foxglove.sdk.v1"
    check(heard, drives)


@needs_browser
async def test_which_pages_may_connect(tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        urls = []
        for origins, token in [((), None), (("*",), None), (("*",), "geheim")]:
            access = Access.made(origins=origins, token=token)
            server = FoxgloveServer(ServerOptions(access=access), ())
            await stack.enter_async_context(server.listening(port=0))
            urls.append(f"ws://127.0.0.1:{server.port}/")
        urls.append(f"{urls[-1]}?token=geheim")
        page = f"page.html#try={','.join(urls)}"
        near = json.loads(await told_by(FOLDER, page, tmp_path / "near"))
        far = json.loads(await told_by(FOLDER, page, tmp_path / "far", OTHER_HOST))
    accepted, refused = ["open", "foxglove.sdk.v1"], ["refused", 1006]
    assert near == [accepted, accepted, refused, accepted]
    assert far == [refused, accepted, refused, accepted]


@needs_pymcap
async def test_pymcap(master: Master, tmp_path: Path) -> None:
    assert PYMCAP is not None
    async with robot(master, tmp_path) as (bridge, _):
        url = f"ws://127.0.0.1:{bridge.server.port}"

        async def bridge_command(command: str, *words: str) -> str:
            return await output_of(PYMCAP or "", "bridge", command, url, *words)

        info, parameters, answer, asset = await asyncio.gather(
            bridge_command("info", "--json"),
            bridge_command("params", "--set", "/robot/gain:=7"),
            bridge_command("call", "/switch", "data:=true"),
            bridge_command("fetch", "package://robot/robot.urdf"),
        )
        path = tmp_path / "recorded.mcap"
        await bridge_command("record", "-o", str(path), "--all", "--limit", "4", "--no-progress")
    assert {"/map", "/things", "/scan/scan"} <= set(_topics_in(json.loads(info)))
    assert "/robot/gain" in parameters
    assert "7" in parameters
    assert "on" in answer
    assert "<robot/>" in asset
    assert texts(path, "map") == ["a map"]
    with Bag(path) as bag:
        assert {"map", "things", "scan"} <= {topic.name for topic in bag.topics.values()}


def _topics_in(value: Any) -> list[str]:
    """Every ``topic`` or ``name`` in what it printed."""
    if isinstance(value, dict):
        inner = [name for item in value.values() for name in _topics_in(item)]
        return [value[key] for key in ("topic", "name") if isinstance(value.get(key), str)] + inner
    return [name for item in value for name in _topics_in(item)] if isinstance(value, list) else []
