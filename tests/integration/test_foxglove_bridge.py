from __future__ import annotations

import asyncio
import contextlib
import json
import time
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pb2
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from support.cli import flowing, register
from support.foreign_master import ForeignMaster
from support.foxglove import bridged, connected
from support.waiting import Stopwatch, until

from simple_ros import aio
from simple_ros.bag import Bag
from simple_ros.foxglove import Access, AssetRoots, BridgeOptions, Recording, ServerOptions
from simple_ros.foxglove.bridge import Bridge
from simple_ros.foxglove.convert.ros_names import ros_definition, ros_name
from simple_ros.msg.definitions import message_class
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.example_interfaces import AddTwoInts
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.rosgraph_msgs import Clock
from simple_ros.msg.sensor_msgs import Image, LaserScan
from simple_ros.msg.std_msgs import Bool, String
from simple_ros.msg.std_srvs import SetBool
from simple_ros.qos import LATCHED
from simple_ros_master import Master


def subscribers(master: Master, topic: str) -> list[str]:
    return list(master.graph.subscribers_of(topic))


# -- topics ----------------------------------------------------------------------------------------


async def test_a_topic(master: Master) -> None:
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        publisher = await node.advertise("chatter", String)
        watch = Stopwatch()
        channel = await client.channel("/chatter")
        assert watch.seconds < 1
        assert channel["encoding"] == channel["schemaEncoding"] == "protobuf"
        assert channel["schemaName"] == "std_msgs.String"
        assert publisher.subscriber_count == 0
        await client.subscribe("/chatter")
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(String(data="hello"))
        await until(lambda: client.on("/chatter"))
        decoded = client.decoder("/chatter").FromString(client.on("/chatter")[0])
        assert decoded.data == "hello"  # type: ignore[attr-defined]
        await client.say("unsubscribe", subscriptionIds=[0])
        await until(lambda: publisher.subscriber_count == 0, "unsubscribed at the publisher")
        await publisher.close()
        await until(lambda: "/chatter" not in client.topics)


async def test_a_type_that_only_its_node_knows(master: Master) -> None:
    file = descriptor_pb2.FileDescriptorProto(name="t.proto", package="their_msgs", syntax="proto3")
    field = file.message_type.add(name="Thing").field.add(name="size", number=1)
    field.type, field.label = field.TYPE_INT32, field.LABEL_OPTIONAL
    thing = message_class(descriptor_pb2.FileDescriptorSet(file=[file]), "their_msgs.Thing")
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        publisher = await node.advertise("things", thing, qos=LATCHED)
        publisher.publish(thing(size=7))
        await client.subscribe("/things")
        await until(lambda: client.on("/things"))
        assert client.decoder("/things").FromString(client.on("/things")[0]).size == 7  # type: ignore[attr-defined]


async def test_a_type_that_nobody_knows_is_said(master: Master) -> None:
    async with (
        aio.NodeHandle("other", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        await register(master.address, node.node_info(), "their_msgs.Strange", "things")
        await until(
            lambda: any("/things (their_msgs.Strange)" in text for _, text in client.statuses())
        )
        assert "/things" not in client.topics
        async with connected(bridge.server.port) as later:
            await until(lambda: later.statuses(), "a client that comes later is told, too")


async def test_another_type_is_another_channel(master: Master) -> None:
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        async with await node.advertise("x", String):
            first = await client.channel("/x")
            await client.subscribe("/x")
            await until(lambda: subscribers(master, "x"))
        await until(lambda: "/x" not in client.topics)
        async with await node.advertise("x", Bool):
            second = await client.channel("/x")
            assert second["schemaName"] == "std_msgs.Bool"
            assert second["id"] != first["id"]


async def test_latched_messages_reach_every_subscriber(master: Master) -> None:
    async with (
        aio.NodeHandle("a", master=master.address) as a,
        aio.NodeHandle("b", master=master.address) as b,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as first,
        connected(bridge.server.port) as second,
    ):
        for node in (a, b):
            publisher = await node.advertise("map", String, qos=LATCHED)
            publisher.publish(String(data=node.name))
        wanted = {String(data=name).SerializeToString() for name in "ab"}
        await first.subscribe("/map")
        await until(lambda: set(first.on("/map")) == wanted, "both publishers' messages")
        await second.subscribe("/map")
        await until(lambda: set(second.on("/map")) == wanted, "again for the second client")
        await first.say("unsubscribe", subscriptionIds=[0])
        first.messages.clear()
        await first.subscribe("/map")
        await until(lambda: set(first.on("/map")) == wanted, "again after unsubscribing")


async def test_latched_messages_of_many_publishers(master: Master) -> None:
    count = 40
    async with contextlib.AsyncExitStack() as stack:
        for number in range(count):
            node = await stack.enter_async_context(
                aio.NodeHandle(f"n{number}", master=master.address)
            )
            publisher = await node.advertise("tf_static", String, qos=LATCHED)
            publisher.publish(String(data=str(number)))
        bridge = await stack.enter_async_context(bridged(master.address))
        first = await stack.enter_async_context(connected(bridge.server.port))
        second = await stack.enter_async_context(connected(bridge.server.port))
        await first.subscribe("/tf_static")
        await until(lambda: len(first.on("/tf_static")) == count, "all for the first client")
        await second.subscribe("/tf_static")
        await until(lambda: len(second.on("/tf_static")) == count, "all for the second client")


async def test_derived_channels(master: Master) -> None:
    async with (
        aio.NodeHandle("laser", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        publisher = await node.advertise("scan", LaserScan, qos=LATCHED)
        publisher.publish(LaserScan(ranges=[1, 2, 3], angle_max=1.0))
        channel = await client.channel("/scan/scan")
        assert channel["schemaName"] == "foxglove.LaserScan"
        await client.subscribe("/scan/scan")
        await until(lambda: client.on("/scan/scan"))
        shown = client.decoder("/scan/scan").FromString(client.on("/scan/scan")[0])
        assert list(shown.ranges) == [1, 2, 3]  # type: ignore[attr-defined]
        assert client.on("/scan") == [] if "/scan" in client.topics else False
        async with connected(bridge.server.port) as later:
            await later.subscribe("/scan/scan")
            await until(lambda: later.on("/scan/scan"), "the latched message, converted")
        # A topic of that name comes first: one channel per topic.
        async with await node.advertise("scan/scan", String):
            await until(lambda: (client.topics.count("/scan/scan")) == 1)
            await until(
                lambda: (
                    [
                        item["schemaName"]
                        for item in client.channels.values()
                        if item["topic"] == "/scan/scan"
                    ]
                    == ["std_msgs.String"]
                )
            )


async def test_why_a_panel_stays_empty_is_said_once(master: Master) -> None:
    async with (
        aio.NodeHandle("camera", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        publisher = await node.advertise("cam", Image)
        number = await client.subscribe("/cam/image")
        await publisher.wait_for_subscribers(1, timeout=30)
        for height in (4, 5):
            publisher.publish(Image(width=4, height=height, encoding="mono8", step=4))
        publisher.publish(Image(width=2, height=1, encoding="mono8", step=2, data=b"ab"))
        await until(lambda: client.on("/cam/image"), "the image that can be shown")
        (status,) = client.statuses()
        assert status[1].startswith("/cam/image: a message on /cam cannot be shown: ")
        await client.say("unsubscribe", subscriptionIds=[number])
        await until(lambda: publisher.subscriber_count == 0)
        await client.subscribe("/cam/image")
        await until(lambda: client.heard("removeStatus"))


# -- what clients publish --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "schema", ["geometry_msgs/Twist", "geometry_msgs/msg/Twist", "ros.geometry_msgs.Twist", ""]
)
async def test_json_from_a_panel(master: Master, schema: str) -> None:
    got: list[Twist] = []
    async with (
        aio.NodeHandle("base", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        await node.subscribe("cmd_vel", Twist, got.append)
        await until(lambda: bridge._graph.type_of("cmd_vel"))
        await client.advertise(7, "/cmd_vel", schema)
        await client.publish(7, b'{"linear": {"x": 0.5}, "angular": {"z": 1}, "more": 1}')
        await until(lambda: got)
        assert (got[0].linear.x, got[0].angular.z) == (0.5, 1.0)
        await client.say("unadvertise", channelIds=[7])
        await until(lambda: not master.graph.publishers_of("cmd_vel"))


async def test_protobuf_from_a_client(master: Master) -> None:
    got: list[String] = []
    async with (
        aio.NodeHandle("listener", master=master.address) as node,
        bridged(master.address) as bridge,
    ):
        await node.subscribe("chatter", String, got.append)
        async with connected(bridge.server.port) as client:
            await client.advertise(1, "/chatter", "std_msgs.String", "protobuf")
            await client.publish(1, String(data="hi").SerializeToString())
            await until(lambda: got)
            await client.publish(1, b"\xff\xff")
            await until(lambda: client.statuses())
            assert client.statuses()[0][0] == 2
        await until(lambda: not master.graph.publishers_of("chatter"), "closed with the client")


@pytest.mark.parametrize(
    ("topic", "schema", "reason"),
    [
        ("/a b", "std_msgs.String", "must not contain"),
        ("/x", "", "no schemaName"),
        ("/x", "nothing/Known", "nothing"),
        ("/chatter", "std_msgs.Bool", "carries std_msgs.String"),
        ("/secret/x", "std_msgs.String", "does not let"),
    ],
)
async def test_what_cannot_be_published(
    master: Master, topic: str, schema: str, reason: str
) -> None:
    options = BridgeOptions(ServerOptions(access=Access.made(exclude="^secret")))
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        bridged(master.address, options) as bridge,
        connected(bridge.server.port) as client,
    ):
        await node.advertise("chatter", String)
        await client.channel("/chatter")
        await client.advertise(1, topic, schema, "protobuf")
        await until(lambda: client.statuses())
        level, text = client.statuses()[0]
        assert level == 2
        assert reason in text
        assert topic in text


async def test_a_type_that_is_really_called_as_panels_call_it(
    master: Master, tmp_path: Path
) -> None:
    definition = FileDescriptorSet.FromString(ros_definition(DiagnosticArray))
    theirs: Any = message_class(definition, ros_name(DiagnosticArray))
    path = tmp_path / "seen.mcap"
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        bridge.server.tap(recording := Recording(path))
        heard: list[Any] = []
        await node.subscribe("diagnostics", theirs, heard.append)
        publisher = await node.advertise("diagnostics", theirs)
        await client.subscribe("/diagnostics")
        await until(lambda: subscribers(master, "diagnostics")[1:])
        assert (await client.channel("/diagnostics"))["schemaName"] == ros_name(DiagnosticArray)
        message = theirs(status=[{"name": "motor"}])
        async with flowing(publisher, message):
            await until(lambda: client.on("/diagnostics"))
        bridge.server.tap(None)
        await recording.finish()
        heard.clear()
        await client.advertise(1, "/diagnostics", ros_name(DiagnosticArray), "protobuf")
        await client.publish(1, message.SerializeToString())
        await until(lambda: heard == [message])
        assert not client.statuses()
    with Bag(path) as bag:
        assert [topic.msg_type for topic in bag.topics.values()] == [ros_name(DiagnosticArray)]


async def test_latched_topics_are_recorded_as_such(master: Master, tmp_path: Path) -> None:
    path = tmp_path / "seen.mcap"
    async with (
        aio.NodeHandle("a", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        bridge.server.tap(recording := Recording(path))
        latched = await node.advertise("map", String, qos=LATCHED)
        latched.publish(String(data="here"))
        plain = await node.advertise("chatter", String)
        for topic in ("/map", "/chatter"):
            await client.subscribe(topic)
        async with flowing(plain, String(data="hello")):
            await until(lambda: client.on("/map") and client.on("/chatter"))
        bridge.server.tap(None)
        await recording.finish()
    with Bag(path) as bag:
        found = {topic.name: topic.is_latched for topic in bag.topics.values()}
    assert found == {"map": True, "chatter": False}


async def test_the_frame_of_messages_that_name_none(master: Master) -> None:
    options = BridgeOptions(ServerOptions(frame_id="map"))
    async with (
        aio.NodeHandle("laser", master=master.address) as node,
        bridged(master.address, options) as bridge,
        connected(bridge.server.port) as client,
    ):
        publisher = await node.advertise("scan", LaserScan, qos=LATCHED)
        publisher.publish(LaserScan(ranges=[1.0]))
        await client.subscribe("/scan/scan")
        await until(lambda: client.on("/scan/scan"))
        scan = client.decoder("/scan/scan").FromString(client.on("/scan/scan")[0])
        assert scan.frame_id == "map"  # type: ignore[attr-defined]


# -- services --------------------------------------------------------------------------------------


async def test_services(master: Master) -> None:
    async def switch(request: SetBool.request) -> SetBool.response:  # type: ignore[valid-type]
        if not request.data:  # type: ignore[attr-defined]
            raise RuntimeError("stays on")
        return SetBool.response(success=True, message="on")

    async with (
        aio.NodeHandle("server", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        async with await node.advertise_service("switch", SetBool, switch):
            await client.call("/switch", 1, {"data": True})
            await until(lambda: client.answer(1))
            assert client.answer(1) == {"success": True, "message": "on"}
            (offered,) = client.services.values()
            assert offered["type"] == "std_srvs.SetBool"
            for side in ("request", "response"):
                assert offered[side]["encoding"] == "json"
                assert offered[side]["schemaEncoding"] == "jsonschema"
                assert json.loads(offered[side]["schema"])["type"] == "object"
            await client.call("/switch", 2, {"data": False})
            await until(lambda: client.heard("serviceCallFailure"))
            assert "stays on" in client.heard("serviceCallFailure")[0]["message"]
            await until(lambda: client.statuses())
            assert client.statuses()[0][0] == 2
            assert client.statuses()[0][1].startswith("Service /switch: ")
            await client.call("/switch", 3, {"data": "nonsense"})
            await until(lambda: len(client.heard("serviceCallFailure")) == 2)
        await until(lambda: not client.services)


async def test_a_provider_that_never_answers(master: Master) -> None:
    async def forever(_: object) -> object:
        await asyncio.Event().wait()
        return None

    options = BridgeOptions(service_timeout_s=0.1)
    async with (
        aio.NodeHandle("server", master=master.address) as node,
        bridged(master.address, options) as bridge,
        connected(bridge.server.port) as client,
    ):
        await node.advertise_service("add", AddTwoInts, forever)  # type: ignore[arg-type]
        await client.call("/add", 1, {"a": 1, "b": "2"})
        await until(lambda: client.heard("serviceCallFailure"))


async def test_a_client_that_leaves_takes_its_calls_along(master: Master) -> None:
    cancelled = asyncio.Event()
    begun = asyncio.Event()

    async def forever(_: object) -> object:
        begun.set()
        try:
            await asyncio.Event().wait()
        finally:
            cancelled.set()
        return None

    async with (
        aio.NodeHandle("server", master=master.address) as node,
        bridged(master.address) as bridge,
    ):
        await node.advertise_service("add", AddTwoInts, forever)  # type: ignore[arg-type]
        async with connected(bridge.server.port) as client:
            await client.call("/add", 1, {})
            await asyncio.wait_for(begun.wait(), 30)
        await asyncio.wait_for(cancelled.wait(), 30)


# -- parameters ------------------------------------------------------------------------------------


async def test_parameters(master: Master) -> None:
    async with (
        aio.NodeHandle("motor", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
        connected(bridge.server.port) as other,
    ):
        await node.declare_parameter("~gain", 2.5)
        await node.declare_parameter("~name", "left", read_only=True)
        await client.say("getParameters", parameterNames=[], id="all")
        await until(lambda: client.parameters("all"))
        gain = {"name": "/motor/gain", "value": 2.5, "type": "float64"}
        assert client.parameters("all") == [gain, {"name": "/motor/name", "value": "left"}]
        await other.say("subscribeParameterUpdates", parameterNames=["/motor/gain"])
        sessions = [item.session for item in bridge.server.clients]
        await until(lambda: any(item.wants_parameter("motor/gain") for item in sessions))
        await client.say("getParameters", parameterNames=["/nothing"], id="none")
        await until(lambda: any(i.get("id") == "none" for i in client.heard("parameterValues")))
        assert client.parameters("none") == []
        # Without a type, as 3: it stays a float.
        await client.say("setParameters", parameters=[{"name": "/motor/gain", "value": 3}], id="s")
        await until(lambda: client.parameters("s"))
        assert client.parameters("s") == [gain | {"value": 3.0}]
        assert node.parameters["~gain"] == 3.0
        await until(lambda: other.parameters(), "the other client is told")
        assert other.parameters() == [gain | {"value": 3.0}]
        await client.say(
            "setParameters",
            parameters=[{"name": "/motor/name", "value": "x"}, {"name": "/new", "value": 1}],
            id="t",
        )
        await until(lambda: client.parameters("t"))
        assert client.parameters("t") == [
            {"name": "/motor/name", "value": "left"},
            {"name": "/new", "value": 1},
        ]
        (status,) = client.statuses()
        assert status[0] == 2
        assert status[1].startswith("Parameter /motor/name is not set: ")
        before = len(other.heard("parameterValues"))
        await client.say("setParameters", parameters=[{"name": "/motor/gain", "value": "loud"}])
        await until(lambda: len(other.heard("parameterValues")) > before, "told what it still is")
        assert other.parameters() == [gain | {"value": 3.0}]
        await client.say("setParameters", parameters=[{"name": "/new"}], id="u")
        await until(lambda: any(item.get("id") == "u" for item in client.heard("parameterValues")))
        assert client.parameters("u") == []
        assert not await node.has_parameter("/new")


# -- graph, assets, time ---------------------------------------------------------------------------


async def test_the_graph(master: Master) -> None:
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        await node.advertise("chatter", String)
        await client.channel("/chatter")
        await client.say("subscribeConnectionGraph")
        await until(lambda: client.heard("connectionGraphUpdate"))
        whole = client.heard("connectionGraphUpdate")[0]
        assert {"name": "/chatter", "publisherIds": ["/talker"]} in whole["publishedTopics"]
        async with aio.NodeHandle("listener", master=master.address) as listener:
            await listener.subscribe("chatter", String, lambda _: None)
            wanted = {"name": "/chatter", "subscriberIds": ["/listener"]}
            await until(
                lambda: wanted in client.heard("connectionGraphUpdate")[-1]["subscribedTopics"]
            )
        gone = {"name": "/chatter", "subscriberIds": []}
        await until(lambda: gone in client.heard("connectionGraphUpdate")[-1]["subscribedTopics"])


async def test_assets(master: Master, tmp_path: Path) -> None:
    (tmp_path / "arm.stl").write_bytes(b"mesh")
    options = BridgeOptions(assets=AssetRoots({"robot": tmp_path}))
    async with (
        bridged(master.address, options) as bridge,
        connected(bridge.server.port) as client,
    ):
        assert "assets" in client.heard("serverInfo")[0]["capabilities"]
        await client.say("fetchAsset", uri="package://robot/arm.stl", requestId=1)
        await client.say("fetchAsset", uri="package://robot/../x", requestId=2)
        await until(lambda: len(client.binary) == 2)
        assert client.binary[0] == b"\x04\x01\x00\x00\x00\x00\x00\x00\x00\x00mesh"
        assert client.binary[1][:6] == b"\x04\x02\x00\x00\x00\x01"
        await until(lambda: client.statuses(), "it is said, too: apps only draw nothing")
        assert client.statuses()[0][0] == 1
        assert "package://robot/../x" in client.statuses()[0][1]


async def test_time(master: Master) -> None:
    async with bridged(master.address) as bridge, connected(bridge.server.port) as client:
        await until(lambda: len(client.times) > 2, "times with no messages at all")
        assert client.times == sorted(client.times)
        assert abs(client.times[-1] - time.time_ns()) < 5e9
        assert isinstance(client.first, str)
        assert '"serverInfo"' in client.first


async def test_simulated_time(master: Master, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMPLE_ROS_USE_SIM_TIME", "1")
    async with (
        aio.NodeHandle("sim", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        publisher = await node.advertise("clock", Clock)
        await publisher.wait_for_subscribers(1, timeout=30)
        for seconds in (100, 50):
            clock = Clock()
            clock.clock.seconds = seconds
            async with flowing(publisher, clock):
                await until(lambda wanted=seconds: wanted * 10**9 in client.times)  # type: ignore[misc]
        sessions = [info["sessionId"] for info in client.heard("serverInfo")]
        assert len(set(sessions)) == 2, "time went back: a new session"
        ops = [document["op"] for document in client.ops]
        again = client.ops[len(ops) - ops[::-1].index("serverInfo") :]
        offered = {channel["id"] for item in again for channel in item.get("channels", ())}
        assert offered == set(client.channels), "apps forget types with a session"


# -- access, and a Master that is away -------------------------------------------------------------


async def test_read_only(master: Master) -> None:
    options = BridgeOptions(ServerOptions(access=Access(read_only=True)))
    async with (
        aio.NodeHandle("motor", master=master.address) as node,
        bridged(master.address, options) as bridge,
        connected(bridge.server.port) as client,
    ):
        await node.declare_parameter("~gain", 2.5)
        await node.advertise_service("switch", SetBool, lambda _: SetBool.response())
        await node.advertise("chatter", String)
        await client.channel("/chatter")
        capabilities = client.heard("serverInfo")[0]["capabilities"]
        assert not {"clientPublish", "services"}.intersection(capabilities)
        await client.advertise(1, "/x", "std_msgs.String")
        await client.say(
            "setParameters", parameters=[{"name": "/motor/gain", "value": 9.0}], id="s"
        )
        await until(lambda: client.parameters("s"))
        assert client.parameters("s")[0]["value"] == 2.5
        assert len(client.statuses()) == 2
        assert not client.services


async def test_selected_services_and_parameters_only(master: Master) -> None:
    access = Access.made(client_topics="^/cmd", services="^/switch$", parameters="^/motor/")
    async with (
        aio.NodeHandle("motor", master=master.address) as node,
        bridged(master.address, BridgeOptions(ServerOptions(access=access))) as bridge,
        connected(bridge.server.port) as client,
    ):
        await node.declare_parameter("~gain", 2.5)
        await node.declare_parameter("/secret", 1)
        for name in ("reboot", "switch"):
            await node.advertise_service(name, SetBool, lambda _: SetBool.response())
        await until(lambda: client.services)
        assert [item["name"] for item in client.services.values()] == ["/switch"]
        await client.say("subscribeConnectionGraph")
        await until(lambda: client.heard("connectionGraphUpdate"))
        for update in client.heard("connectionGraphUpdate"):
            assert "/reboot" not in [item["name"] for item in update["advertisedServices"]]
        await client.say("subscribeParameterUpdates", parameterNames=[])
        for names in ([], ["/secret", "/motor/gain"]):
            await client.say("getParameters", parameterNames=names, id=str(names))
            await until(lambda names=names: client.parameters(str(names)))
            assert [item["name"] for item in client.parameters(str(names))] == ["/motor/gain"]
        await client.say("setParameters", parameters=[{"name": "/secret", "value": 2}], id="s")
        await until(lambda: client.statuses())
        assert "not shown here" in client.statuses()[0][1]
        await until(lambda: bridge._parameters._watch, "changes are told to the bridge")
        await node.set_parameters({"/secret": 3})
        await node.set_parameters({"~gain": 3.5})
        await until(lambda: client.parameters())
        told = [item for heard in client.heard("parameterValues") for item in heard["parameters"]]
        assert {item["name"] for item in told} == {"/motor/gain"}
        await client.advertise(1, "/chatter", "std_msgs.String")
        await until(lambda: client.statuses()[1:])
        assert "/chatter" in client.statuses()[1][1]


async def test_capabilities_that_are_not_offered(master: Master) -> None:
    access = Access.made(without=["services", "parameters"])
    async with (
        aio.NodeHandle("motor", master=master.address) as node,
        bridged(master.address, BridgeOptions(ServerOptions(access=access))) as bridge,
        connected(bridge.server.port) as client,
    ):
        await node.advertise_service("switch", SetBool, lambda _: SetBool.response())
        offered = client.heard("serverInfo")[0]["capabilities"]
        assert offered == ["clientPublish", "connectionGraph", "time"]
        await client.say("getParameters", parameterNames=[], id="all")
        await until(lambda: client.statuses() == [(2, "This server does not offer parameters")])
        await node.advertise("chatter", String)
        await client.channel("/chatter")
        assert not client.services


async def test_selected_topics_only(master: Master) -> None:
    options = BridgeOptions(ServerOptions(access=Access.made("^/cam", "raw")))
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        bridged(master.address, options) as bridge,
        connected(bridge.server.port) as client,
    ):
        for topic in ("odom", "cam/raw", "cam/info"):
            await node.advertise(topic, String)
        await client.channel("/cam/info")
        await client.say("subscribeConnectionGraph")
        await until(lambda: client.heard("connectionGraphUpdate"))
        graph = client.heard("connectionGraphUpdate")[0]
        assert [item["name"] for item in graph["publishedTopics"]] == ["/cam/info"]
        assert client.topics == ["/cam/info"]


async def test_a_master_that_comes_later() -> None:
    async with Master(host="127.0.0.1", port=0) as first:
        address = first.address
        port = int(address.rsplit(":", 1)[1])
    async with bridged(address) as bridge, connected(bridge.server.port) as client:
        await until(lambda: client.statuses())
        assert "No Master answers" in client.statuses()[0][1]
        async with (
            Master(host="127.0.0.1", port=port),
            aio.NodeHandle("talker", master=address) as node,
        ):
            await node.advertise("chatter", String)
            await client.channel("/chatter")
            await until(lambda: client.heard("removeStatus"))


async def test_a_master_without_parameters() -> None:
    async with (
        ForeignMaster() as master,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        await client.say("getParameters", parameterNames=[], id="all")
        await until(lambda: client.heard("parameterValues"))
        assert client.parameters("all") == []
        assert 2 not in [level for level, _ in client.statuses()], client.statuses()
        await client.say("setParameters", parameters=[{"name": "/a", "value": 1}])
        await until(lambda: any("/a is not set" in text for _, text in client.statuses()))


async def test_a_master_that_is_restarted() -> None:
    async with Master(host="127.0.0.1", port=0) as first:
        address = first.address
        port = int(address.rsplit(":", 1)[1])
        node = aio.NodeHandle("talker", master=address)
        await node.start()
        publisher = await node.advertise("chatter", String)
        opened = contextlib.AsyncExitStack()
        bridge = await opened.enter_async_context(bridged(address))
        client = await opened.enter_async_context(connected(bridge.server.port))
        before = await client.channel("/chatter")
        await client.subscribe("/chatter")
        await publisher.wait_for_subscribers(1, timeout=30)
    async with opened, node:
        await until(lambda: client.statuses(), "the Master is missed")
        async with Master(host="127.0.0.1", port=port) as second:
            await until(lambda: second.graph.subscribers_of("chatter"))
            await until(lambda: client.heard("removeStatus"))
            other = await node.advertise("other", String)
            await client.channel("/other")
            assert client.heard("unadvertise") == []
            assert await client.channel("/chatter") == before
            publisher.publish(String(data="still here"))
            await until(lambda: client.on("/chatter"))
            await other.close()
            await until(lambda: "/other" not in client.topics)


async def test_the_bridge_as_a_library_is_what_the_docs_say(master: Master) -> None:
    async with aio.NodeHandle("bridge", master=master.address) as node:
        bridge = Bridge(node, BridgeOptions())
        async with bridge.server.listening(port=0):
            assert bridge.server.port
