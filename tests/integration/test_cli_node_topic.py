"""``simple-ros node`` and ``simple-ros topic`` as a user runs them."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
from collections.abc import AsyncIterator
from typing import Any

import pytest
from google.protobuf import descriptor_pb2
from google.protobuf.message import Message
from support.cli import PROGRAM, flowing, following, register, run, run_json
from support.processes import python
from support.waiting import until

from simple_ros.aio import NodeHandle, Subscriber
from simple_ros.msg.definitions import message_class
from simple_ros.msg.geometry_msgs import Twist, Vector3
from simple_ros.msg.std_msgs import String
from simple_ros.qos import LATCHED, SENSOR_DATA
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master

pytestmark = pytest.mark.usefixtures("patient_master")


def lines(*texts: str) -> str:
    return "".join(f"{text}\n" for text in texts)


@pytest.fixture
async def node(master: Master) -> AsyncIterator[NodeHandle]:
    async with NodeHandle("robot", master=master.address) as node:
        yield node


class TestNode:
    async def test_list_and_info(self, master: Master, node: NodeHandle) -> None:
        await node.advertise("cmd_vel", Twist)
        await node.subscribe("chatter", String, lambda _: None)
        at = ("--master", master.address)
        where = f"127.0.0.1:{node.port}"
        async with NodeHandle("other", master=master.address) as other:
            await other.advertise("chatter", String)
            listed, filtered, whole, cpp_list = await asyncio.gather(
                run("node", "list", *at),
                run("node", "list", "rob", *at),
                run("node", "info", "/robot", *at),
                run("node", "list", "rob", "--format", "cpp", *at),
            )
            as_json, info_json = await asyncio.gather(
                run_json("node", "list", *at), run_json("node", "info", "robot", *at)
            )
            assert listed == (0, f"other  127.0.0.1:{other.port}\nrobot  {where}\n", "")
        assert filtered == (0, f"robot  {where}\n", "")
        assert whole == (
            0,
            lines(
                "Node: robot",
                f"Address: {where}",
                "Publishes:",
                "  cmd_vel  geometry_msgs.Twist",
                "Subscribes:",
                "  chatter  std_msgs.String",
            ),
            "",
        )
        assert cpp_list == (0, f"Active nodes:\n * robot ({where})\nTotal nodes: 1\n", "")
        assert [entry["name"] for entry in as_json] == ["other", "robot"]
        assert info_json == {
            "name": "robot",
            "ip": "127.0.0.1",
            "port": node.port,
            "addresses": [item for item in info_json["addresses"] if "127.0.0.1" not in item],
            "publishes": [{"topic": "cmd_vel", "msg": "geometry_msgs.Twist"}],
            "subscribes": [{"topic": "chatter", "msg": "std_msgs.String"}],
        }

    async def test_ping(self, master: Master, node: NodeHandle) -> None:
        await node.advertise("cmd_vel", Twist)
        at = ("--master", master.address)
        code, stdout, stderr = await run("node", "ping", "robot", "-n", "2", "--interval", "0", *at)
        assert (code, stderr) == (0, "")
        first, _, summary = stdout.splitlines()
        assert first.startswith(f"robot at 127.0.0.1:{node.port}: ")
        assert first.endswith(" ms")
        assert summary.startswith("2 of 2 answered: mean ")
        async with following("node", "ping", "robot", "--interval", "0.01", "--json", *at) as ping:
            for _ in range(3):
                assert json.loads(await ping.line())["listens"] is True

    async def test_ping_says_that_nobody_listens(self, master: Master) -> None:
        with socket.socket() as holder:  # bound and not listening: nobody answers
            holder.bind(("127.0.0.1", 0))
            port = holder.getsockname()[1]
            await register(
                master.address, ros.NodeInfo(node_name="ghost", ip="127.0.0.1", port=port)
            )
            command = ("node", "ping", "ghost", "-n", "1", "--master", master.address)
            shown, in_json = await asyncio.gather(run(*command), run(*command, "--json"))
        assert shown == (1, f"ghost at 127.0.0.1:{port}: nobody listens\n0 of 1 answered\n", "")
        assert (in_json[0], in_json[2]) == (1, "")
        assert json.loads(in_json[1]) == {
            "name": "ghost",
            "ip": "127.0.0.1",
            "port": port,
            "addresses": [],
            "listens": False,
            "connect_ms": None,
            "problem": "nobody listens",
        }


class TestTopic:
    async def test_list_info_and_find(self, master: Master, node: NodeHandle) -> None:
        at = ("--master", master.address)
        await node.advertise("cmd_vel", Twist)
        await node.advertise("chatter", String)
        where = f"robot  127.0.0.1:{node.port}"
        listed, whole, cpp, found = await asyncio.gather(
            run("topic", "list", *at),
            run("topic", "info", "/cmd_vel", *at),
            run("topic", "info", "cmd_vel", "--format", "cpp", *at),
            run("topic", "find", "geometry_msgs/msg/Twist", *at),
        )
        as_json, info_json, found_json = await asyncio.gather(
            run_json("topic", "list", *at),
            run_json("topic", "info", "cmd_vel", *at),
            run_json("topic", "find", "std_msgs::String", *at),
        )
        assert listed == (0, "chatter  std_msgs.String\ncmd_vel  geometry_msgs.Twist\n", "")
        title = "Topic: cmd_vel\nType: geometry_msgs.Twist\n"
        assert whole == (0, f"{title}Publishers:\n  {where}\nSubscribers: none\n", "")
        entry = f"  * robot (127.0.0.1:{node.port})"
        assert cpp == (0, f"{title}Publishers: \n{entry}\nSubscribers: None\n", "")
        assert found == (0, "cmd_vel\n", "")
        assert as_json[0] == {"topic": "chatter", "msg": "std_msgs.String"}
        assert info_json == {
            "topic": "cmd_vel",
            "msg": "geometry_msgs.Twist",
            "publishers": [{"name": "robot", "ip": "127.0.0.1", "port": node.port}],
            "subscribers": [],
        }
        assert found_json == ["chatter"]

    async def test_echo_follows_until_ctrl_c(self, master: Master, node: NodeHandle) -> None:
        publisher = await node.advertise("chatter", String)
        async with following("topic", "echo", "/chatter", "--master", master.address) as echo:
            await publisher.wait_for_subscribers(1)
            for text in ("one", "two"):
                publisher.publish(String(data=text))
                assert await echo.line() == f'data: "{text}"'
                assert await echo.line() == "---"
        await until(lambda: publisher.subscriber_count == 0, "the subscription has ended")

    async def test_echo_ends_by_itself_in_every_style(
        self, master: Master, node: NodeHandle
    ) -> None:
        publisher = await node.advertise("cmd_vel", Twist, qos=LATCHED)
        publisher.publish(Twist(linear=Vector3(x=0.5)))
        command = ("topic", "echo", "cmd_vel", "--once", "--master", master.address)
        readable, in_json, cpp, part, part_json = await asyncio.gather(
            run(*command),
            run_json(*command),
            run(*command, "--format", "cpp"),
            run(*command, "--field", "linear.x"),
            run_json(*command, "--field", "linear"),
        )
        text = "linear:\n  x: 0.5\n  y: 0.0\n  z: 0.0\nangular: {}\n---\n"
        assert readable == (0, text, "")
        linear = {"x": 0.5, "y": 0.0, "z": 0.0}
        assert in_json == {"linear": linear}
        assert cpp == (0, "[geometry_msgs.Twist]\nlinear {\n  x: 0.5\n}\n\n", "")
        assert part == (0, "0.5\n---\n", "")
        assert part_json == linear

    async def test_echo_takes_what_offers_little(self, master: Master, node: NodeHandle) -> None:
        publisher = await node.advertise("chatter", String, qos=SENSOR_DATA)
        command = ("topic", "echo", "chatter", "-n", "2", "--json", "--master", master.address)
        async with python(*PROGRAM, *command) as echo:
            await publisher.wait_for_subscribers(1)
            for text in ("one", "two", "three"):
                publisher.publish(String(data=text))
            assert [json.loads(await echo.line()) for _ in range(2)] == [
                {"data": "one"},
                {"data": "two"},
            ]
            assert await echo.wait() == 0

    async def test_echo_ends_quietly_when_nobody_reads(
        self, master: Master, node: NodeHandle
    ) -> None:
        publisher = await node.advertise("chatter", String)
        command = ("topic", "echo", "chatter", "--json", "--master", master.address)
        async with python(*PROGRAM, *command) as echo:
            await publisher.wait_for_subscribers(1)
            transport = echo.process._transport.get_pipe_transport(1)  # type: ignore[attr-defined]
            transport.close()
            async with flowing(publisher, String(data="x")):
                assert await echo.wait() == 0
            assert await echo.errors() == ""

    async def test_unknown_types_can_be_measured_and_not_shown(
        self, master: Master, node: NodeHandle
    ) -> None:
        # Another name than the fixture's, which it would take over.
        info = ros.NodeInfo(node_name="foreign_robot", ip="127.0.0.1", port=node.port)
        await register(master.address, info)
        command = ("things", "--master", master.address)
        expected = "error: topic 'things' carries their_msgs.Thing, a type that is unknown here\n"
        echo, delay = await asyncio.gather(
            run("topic", "echo", *command), run("topic", "delay", *command)
        )
        assert echo == delay == (1, "", expected)
        async with following("topic", "hz", *command) as hz:
            assert await hz.line() == "no new messages"

    async def test_a_type_that_the_master_defines_is_shown_and_published(
        self, master: Master, node: NodeHandle
    ) -> None:
        mine = beacon()
        publisher = await node.advertise("beacons", mine, qos=LATCHED)
        publisher.publish(mine(name="north"))
        at = ("--master", master.address)
        assert await run("topic", "echo", "beacons", "--once", *at) == (
            0,
            'name: "north"\n---\n',
            "",
        )
        subscriber = await node.subscribe("more", mine)
        shown = await run("topic", "pub", "more", "lab/Beacon", "name: south", "--once", *at)
        assert shown == (0, "", "")
        assert await subscriber.receive_within(30) == mine(name="south")


def beacon() -> type[Message]:
    """What a generated module of a user would hold."""
    kinds = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    file.message_type.add(name="Beacon").field.add(
        name="name", number=1, type=kinds.TYPE_STRING, label=kinds.LABEL_OPTIONAL
    )
    return message_class(descriptor_pb2.FileDescriptorSet(file=[file]), "lab.Beacon")


class TestPub:
    async def received(self, node: NodeHandle) -> tuple[list[str], Subscriber[String]]:
        texts: list[str] = []
        subscriber = await node.subscribe("chatter", String, lambda msg: texts.append(msg.data))
        return texts, subscriber

    async def test_once_and_count(self, master: Master, node: NodeHandle) -> None:
        texts, _ = await self.received(node)
        command = ("topic", "pub", "/chatter", "std_msgs/String", "--master", master.address)
        once, three = await asyncio.gather(
            run(*command, "data: once", "--once"),
            run(*command, '{"data": "many"}', "-n", "3", "--rate", "200"),
        )
        assert once == three == (0, "", "")
        await until(lambda: len(texts) == 4)
        assert sorted(texts) == ["many", "many", "many", "once"]

    async def test_what_was_sent_in_json(self, master: Master, node: NodeHandle) -> None:
        _, subscriber = await self.received(node)
        command = ("topic", "pub", "/chatter", "String", "data: a", "--rate", "200")
        at = ("--json", "--master", master.address)
        counted, followed = await asyncio.gather(
            run(*command, "-n", "3", *at), self.followed(subscriber, *command, *at)
        )
        told = {"topic": "chatter", "msg": "std_msgs.String", "dropped": 0, "waiting": 0}
        assert (counted[0], counted[2]) == (0, "")
        assert json.loads(counted[1]) == told | {"published": 3, "sent": 3}
        assert followed.pop("published") >= followed.pop("sent") > 3
        assert followed == told

    async def followed(self, subscriber: Subscriber[String], *command: str) -> dict[str, Any]:
        """What it tells after Ctrl-C."""
        async with python(*PROGRAM, *command) as pub:
            await until(lambda: subscriber.statistics.received > 10)
            pub.signal(signal.SIGINT)
            told: dict[str, Any] = json.loads(await pub.line())
            assert await pub.wait() == 0
            return told

    async def test_it_goes_on_until_ctrl_c(self, master: Master, node: NodeHandle) -> None:
        texts, _ = await self.received(node)
        command = ("topic", "pub", "chatter", "String", "{data: a}", "--rate", "100")
        async with following(*command, "--master", master.address):
            await until(lambda: len(texts) >= 5)

    async def test_latched_stays_for_late_subscribers(
        self, master: Master, node: NodeHandle
    ) -> None:
        first = await node.subscribe("chatter", String)
        command = ("topic", "pub", "chatter", "String", "{data: a}", "--once", "--latch")
        async with following(*command, "--master", master.address):
            assert await first.receive_within(30) == String(data="a")
            async with NodeHandle("late", master=master.address) as late:
                second = await late.subscribe("chatter", String)
                assert await second.receive_within(30) == String(data="a")

    async def test_nobody_subscribes(self, master: Master) -> None:
        code, stdout, stderr = await run(
            "topic", "pub", "chatter", "String", "data: a", "--once", "--master", master.address
        )
        assert (code, stdout) == (0, "")
        assert stderr == "warning: nobody has subscribed to 'chatter' within 2 s\n"

    async def test_another_type_is_one_line(self, master: Master, node: NodeHandle) -> None:
        await node.advertise("chatter", String)
        code, _, stderr = await run(
            "topic", "pub", "chatter", "Twist", "{}", "--once", "--master", master.address
        )
        assert code == 1
        assert stderr.startswith("error: topic 'chatter': node 'cli_pub_")
        assert stderr.count("\n") == 1


class TestErrors:
    async def test_unknown_names_are_one_line_with_near_ones(
        self, master: Master, node: NodeHandle
    ) -> None:
        await node.advertise("odometry", Twist)
        at = ("--master", master.address)
        for_topic = (1, "", "error: no topic 'odometri'; did you mean 'odometry'?\n")
        for_node = (1, "", "error: no node 'robto'; did you mean 'robot'?\n")
        nodes = [run("node", verb, "robto", *at) for verb in ("info", "ping")]
        topics = [run("topic", verb, "odometri", *at) for verb in ("info", "echo", "hz")]
        assert await asyncio.gather(*nodes) == [for_node] * 2
        assert await asyncio.gather(*topics) == [for_topic] * 3

    async def test_wrong_fields_are_one_line(self, master: Master, node: NodeHandle) -> None:
        await node.advertise("cmd_vel", Twist)
        at = ("--master", master.address)
        echo, pub, delay, find = await asyncio.gather(
            run("topic", "echo", "cmd_vel", "--field", "linear.q", *at),
            run("topic", "pub", "cmd_vel", "Twist", "{linear: {q: 1}}", *at),
            run("topic", "delay", "cmd_vel", *at),
            run("topic", "find", "Twits", *at),
        )
        line = (
            "error: geometry_msgs.Vector3 (at 'linear') has no field 'q'; its fields are x, y, z\n"
        )
        assert echo == pub == (1, "", line)
        for code, stdout, stderr in (delay, find):
            assert (code, stdout, stderr.count("\n")) == (1, "", 1)
        assert "geometry_msgs.Twist has neither header.stamp" in delay[2]

    async def test_no_master_is_one_line(self) -> None:
        with socket.socket() as holder:  # bound and not listening: nobody answers
            holder.bind(("127.0.0.1", 0))
            at = ("--master", f"127.0.0.1:{holder.getsockname()[1]}")
            shown = await asyncio.gather(
                run("node", "list", *at),
                run("node", "ping", "x", *at),
                run("topic", "echo", "x", *at),
                run("topic", "hz", "x", *at),
                run("topic", "pub", "x", "String", "data: a", *at),
            )
        for code, stdout, stderr in shown:
            assert (code, stdout, stderr.count("\n")) == (1, "", 1)
            assert stderr.startswith("error: no Master answers at 127.0.0.1:")
