"""The link shaper between real nodes, in real processes."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import socket
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from support.processes import python
from support.shaper import at, environment, shaper
from support.waiting import LIMIT_S, Stopwatch, until

from simple_ros.errors import ConfigError
from simple_ros.msg.example import ControlCommand
from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.link_shaper_msgs import (
    GetStatistics,
    GetStatisticsRequest,
    LinkStatistics,
    ShaperStatistics,
)
from simple_ros.net.addresses import split_address
from simple_ros.net.transport import chosen_transports
from simple_ros.node import NodeHandle
from simple_ros.qos import QosProfile
from simple_ros.wire.framing import encode_frame, encode_header
from simple_ros_engines.link_shaper import relay as relay_module
from simple_ros_engines.link_shaper.hello import Hello
from simple_ros_engines.link_shaper.relay import Relay
from simple_ros_engines.link_shaper.source import ShaperSource
from simple_ros_engines.link_shaper.transport import ShapedTransport, dial_shaper
from simple_ros_engines.radio_information.record import LinkRecord, Quality
from simple_ros_engines.radio_information.sources.base import SourceDown
from simple_ros_engines.simulator.shaper_reading import read_settings
from simple_ros_master import Master

OPEN: dict[str, Any] = {"links": {"robot": {}}}
CLASSES = [
    {"name": "command", "topics": ["/command"], "priority": 5, "dscp": 46},
    {"name": "bulk", "topics": ["/bulk"], "priority": 1, "queue_bytes": 800_000},
]
CAMERA = """
    import sys
    from simple_ros import QosProfile, aio
    from simple_ros.msg.example import ControlCommand

    async def main():
        async with aio.NodeHandle("camera") as node:
            patient = QosProfile(overflow="block")
            publisher = await node.advertise("bulk", ControlCommand, qos=patient)
            await publisher.wait_for_subscribers(1, timeout=30)
            for number in range(int(sys.argv[1])):
                await publisher.publish_async(ControlCommand(cmd_id=number, cmd="x" * int(sys.argv[2])))
            await publisher.flush()
            print("sent", flush=True)
            await node.spin()

    aio.run(main())
"""


async def test_real_processes_talk_through_the_shaper_both_ways(
    master: Master, tmp_path: Path
) -> None:
    answer = """
        from simple_ros import aio
        from simple_ros.msg.example import ControlCommand

        async def main():
            async with aio.NodeHandle("robot") as node:
                back = await node.advertise("back", ControlCommand)
                await node.subscribe("forth", ControlCommand, back.publish)
                print("ready", flush=True)
                await node.spin()

        aio.run(main())
    """
    links = {"links": {"robot": {"up": {"delay_ms": 60}, "down": {"delay_ms": 40}}}}
    got: list[ControlCommand] = []
    async with shaper(tmp_path, links) as (_, where):
        async with (
            python_program(answer, environment("robot", where, master.address)) as robot,
            at("edge", where, "edge", master.address) as edge,
        ):
            assert await robot.line() == "ready"
            await edge.subscribe("back", ControlCommand, got.append)
            forth = await edge.advertise("forth", ControlCommand)
            await forth.wait_for_subscribers(1, timeout=30)
            loop = asyncio.get_running_loop()
            begun: list[float] = []
            while not got:
                # The robot's own link back may not stand yet.
                begun.append(loop.time())
                forth.publish(ControlCommand(cmd_id=len(begun) - 1))
                with contextlib.suppress(AssertionError):
                    await until(lambda: got, limit=1.0)
            assert loop.time() - begun[got[0].cmd_id] >= 0.1


def python_program(text: str, env: dict[str, str], *args: str) -> Any:
    master = env.pop("SIMPLE_ROS_MASTER")
    import textwrap

    return python("-c", textwrap.dedent(text), *args, SIMPLE_ROS_MASTER=master, **env)


async def statistics(node: NodeHandle) -> ShaperStatistics:
    client = node.service_client("/link_shaper/get_statistics", GetStatistics, timeout=30)
    await client.wait_for_service(30)
    answer = await client.call(GetStatisticsRequest())
    return answer.statistics


async def test_a_rate_is_kept_drops_are_whole_and_the_books_balance(
    master: Master, tmp_path: Path
) -> None:
    data = {
        "links": {"robot": {"up": {"rate_mbps": 16, "max_share": 0.5}}},
        "classes": [*CLASSES, {"name": "rest"}],
    }
    got: list[tuple[float, int]] = []
    loop = asyncio.get_running_loop()
    async with shaper(tmp_path, data, master.address) as (_, where):
        async with (
            at("edge", where, "edge", master.address) as edge,
            NodeHandle("tool", master=master.address) as tool,
        ):
            await edge.subscribe(
                "bulk", ControlCommand, lambda m: got.append((loop.time(), len(m.cmd)))
            )
            env = environment("robot", where, master.address)
            async with python_program(CAMERA, env, "20", "100000") as camera:
                assert await camera.line() == "sent"
                watch = Stopwatch()
                await until(lambda: len(got) >= 3)
                settled = await idle(tool)
                (item,) = [c for c in settled.links[0].classes if c.name == "bulk"]
                await until(lambda: len(got) == item.delivered, "what was delivered has come")
                hindered = watch.hindered
    assert item.offered == 20
    assert item.delivered + item.dropped == 20
    assert item.dropped > 5
    assert {size for _, size in got} == {100_000}
    # 8 Mbit/s carry a message of 100 kB in a tenth of a second.
    gaps = [b[0] - a[0] for a, b in pairwise(got)]
    assert sum(gaps) / len(gaps) == pytest.approx(0.1, abs=0.02 + hindered / len(gaps))


async def told(tool: NodeHandle, condition: Callable[[LinkStatistics], bool]) -> LinkStatistics:
    """The statistics of the first link once they are as they should be."""
    while True:
        link = (await statistics(tool)).links[0]
        if condition(link):
            return link


async def idle(tool: NodeHandle) -> ShaperStatistics:
    """Statistics once nothing waits any more."""
    while True:
        found = await statistics(tool)
        classes = [item for link in found.links for item in link.classes]
        if all(c.offered == c.delivered + c.dropped + c.lost + c.expired for c in classes):
            return found


async def test_a_command_overtakes_bulk_on_the_same_link(master: Master, tmp_path: Path) -> None:
    # The bulk takes a second: time for the command to set out.
    data = {"links": {"robot": {"up": {"rate_mbps": 1.6}}}, "classes": CLASSES}
    order: list[str] = []
    async with shaper(tmp_path, data) as (_, where):
        async with (
            at("robot", where, "robot", master.address) as robot,
            at("edge", where, "edge", master.address) as edge,
        ):
            await edge.subscribe("bulk", ControlCommand, lambda _: order.append("bulk"))
            await edge.subscribe("command", ControlCommand, lambda _: order.append("command"))
            bulk = await robot.advertise("bulk", ControlCommand)
            command = await robot.advertise("command", ControlCommand)
            await bulk.wait_for_subscribers(1, timeout=30)
            await command.wait_for_subscribers(1, timeout=30)
            bulk.publish(ControlCommand(cmd="x" * 200_000))
            await bulk.flush()
            command.publish(ControlCommand(cmd="stop"))
            await until(lambda: len(order) == 2)
    assert order == ["command", "bulk"]


async def test_a_held_class_holds_its_publisher_back_and_loses_nothing(
    master: Master, tmp_path: Path
) -> None:
    classes = [{"name": "all", "overflow": "hold", "queue_bytes": 50_000}]
    data = {"links": {"robot": {"up": {"rate_mbps": 80}}}, "classes": classes}
    got: list[int] = []
    async with shaper(tmp_path, data) as (_, where):
        async with at("edge", where, "edge", master.address) as edge:
            await edge.subscribe("bulk", ControlCommand, lambda m: got.append(m.cmd_id))
            env = environment("robot", where, master.address)
            async with python_program(CAMERA, env, "200", "20000") as camera:
                assert await camera.line() == "sent"
                await until(lambda: len(got) == 200)
    assert got == list(range(200))


async def test_who_waits_for_room_is_let_in_whoever_looked_at_the_link_meanwhile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Telling records, too, hands on what has arrived: nothing is due then, and there is room."""
    monkeypatch.setattr(relay_module, "_RECORDS_S", 0.0)
    classes = [{"name": "all", "overflow": "hold", "queue_bytes": 50_000}]
    data = {"links": {"robot": {"up": {"rate_mbps": 800}}}, "classes": classes}
    frame = encode_frame(encode_header("x", "example.Blob"), bytes(20_000))
    loop = asyncio.get_running_loop()

    async def read(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        for _ in range(200):
            await reader.readexactly(len(frame))
        writer.close()
        done.set()

    done = asyncio.Event()
    async with (
        await asyncio.start_server(read, "127.0.0.1", 0) as server,
        Relay(read_settings(data | {"listen": "127.0.0.1:0"})) as relay,
    ):
        target = f"127.0.0.1:{server.sockets[0].getsockname()[1]}"
        hello = Hello("robot", "edge", target)
        with await dial_shaper(split_address(relay.address), hello) as publisher:
            async with asyncio.timeout(LIMIT_S):
                await loop.sock_sendall(publisher, 200 * frame)
                await done.wait()


async def test_what_is_under_way_arrives_after_its_publisher_is_gone(
    master: Master, tmp_path: Path
) -> None:
    data = {"links": {"robot": {"up": {"delay_ms": 400}}}}
    got: list[int] = []
    async with shaper(tmp_path, data) as (_, where):
        async with at("edge", where, "edge", master.address) as edge:
            await edge.subscribe("bulk", ControlCommand, lambda m: got.append(m.cmd_id))
            env = environment("robot", where, master.address)
            async with python_program(CAMERA, env, "3", "10") as camera:
                assert await camera.line() == "sent"
                await camera.kill()
                await until(lambda: len(got) == 3)


async def test_a_link_is_changed_while_it_runs_and_bad_changes_are_refused(
    master: Master, tmp_path: Path
) -> None:
    async with shaper(tmp_path, OPEN, master.address):
        async with NodeHandle("tool", master=master.address) as tool:
            await statistics(tool)
            await link_command(master, "set", "robot", "max_share=0.3", "rate_mbps=20", "--way=up")
            up, down = (await statistics(tool)).links
            assert (up.rate_bps, up.max_share) == (20e6, pytest.approx(0.3))
            assert down.max_share == 1
            assert "there is no link 'nobody'" in await link_command(
                master, "set", "nobody", "loss=1", code=1
            )
            assert "between 0 and 1" in await link_command(master, "set", "robot", "loss=2", code=1)
            text = await link_command(master, "stats")
            assert text.startswith("robot up: 20 Mbit/s, share 0 to 0.3")
            found = json.loads(await link_command(master, "stats", "--json"))
            assert found["links"][0]["link"] == "robot"


async def link_command(master: Master, *words: str, code: int = 0) -> str:
    command = ("-m", "simple_ros.cli.main", "link", *words, "--master", master.address)
    async with python(*command) as process:
        output, errors = await process.process.communicate()
        assert process.process.returncode == code, errors.decode()
        return (output + errors).decode()


async def test_the_code_point_a_node_sets_on_its_socket_decides(
    master: Master, tmp_path: Path
) -> None:
    data = {"links": {"robot": {}}, "classes": CLASSES}
    async with shaper(tmp_path, data, master.address) as (_, where):
        async with (
            at("robot", where, "robot", master.address) as robot,
            at("edge", where, "edge", master.address) as edge,
            NodeHandle("tool", master=master.address) as tool,
        ):
            await edge.subscribe("plain", ControlCommand, lambda _: None)
            publisher = await robot.advertise("plain", ControlCommand)
            await publisher.wait_for_subscribers(1, timeout=30)
            for sock in sockets_of(publisher):
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, 46 << 2)
            urgent = 0
            while not urgent:
                publisher.publish(ControlCommand())
                await asyncio.sleep(0)
                classes = {c.name: c for c in (await statistics(tool)).links[0].classes}
                urgent = classes["command"].offered


def sockets_of(publisher: Any) -> list[socket.socket]:
    links = publisher._links.all
    return [link._transport.get_extra_info("socket") for link in links]


async def test_nodes_find_each_other_again_after_the_shaper_was_killed(
    master: Master, tmp_path: Path
) -> None:
    got: list[int] = []
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    data = OPEN | {"listen": f"127.0.0.1:{port}"}
    where = data["listen"]
    async with (
        at("robot", where, "robot", master.address) as robot,
        at("edge", where, "edge", master.address) as edge,
    ):
        await edge.subscribe("x", ControlCommand, lambda m: got.append(m.cmd_id))
        publisher = await robot.advertise("x", ControlCommand, qos=QosProfile(depth=1))
        for number in (1, 2):
            async with shaper(tmp_path, data) as (process, _):
                while number not in got:
                    publisher.publish(ControlCommand(cmd_id=number))
                    with contextlib.suppress(AssertionError):
                        await until(lambda number=number: number in got, limit=0.3)
                process.signal(signal.SIGKILL)
                await process.wait()
            await until(lambda: publisher.subscriber_count == 0)


async def test_within_a_site_and_for_an_observer_no_shaper_is_needed(master: Master) -> None:
    nobody = "127.0.0.1:1"
    got: list[str] = []
    async with (
        at("robot", nobody, "a", master.address) as a,
        at("robot", nobody, "b", master.address) as b,
        at("observer", nobody, "c", master.address) as c,
        at("edge", nobody, "d", master.address) as d,
    ):
        for node in (b, c, d):
            await node.subscribe("x", ControlCommand, lambda _, name=node.name: got.append(name))
        publisher = await a.advertise("x", ControlCommand)
        await publisher.wait_for_subscribers(2, timeout=30)
        publisher.publish(ControlCommand())
        await until(lambda: len(got) == 2)
        assert set(got) == {"b", "c"}


async def test_a_subscriber_that_does_not_read_stops_its_publisher_and_fills_no_memory() -> None:
    settings = read_settings(OPEN | {"listen": "127.0.0.1:0"})
    loop = asyncio.get_running_loop()
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        target = f"127.0.0.1:{deaf.getsockname()[1]}"
        async with Relay(settings) as relay:
            hello = Hello("robot", "edge", target)
            publisher = await dial_shaper(split_address(relay.address), hello)
            frame = encode_frame(encode_header("x", "example.Blob"), bytes(100_000))
            written = 0
            with pytest.raises(TimeoutError):
                while written < 200_000_000:
                    await asyncio.wait_for(loop.sock_sendall(publisher, frame), 1.0)
                    written += len(frame)
            (incoming,) = relay.incoming
            assert written < 40_000_000
            assert incoming.pending_count <= 20
            taken, _ = deaf.accept()
            taken.close()
            await until(lambda: not relay.incoming, "the end of both sides")
            publisher.close()


async def test_a_trace_file_drives_a_link(master: Master, tmp_path: Path) -> None:
    (tmp_path / "drive.csv").write_text("t_s,way,rate_mbps\n0,,10\n0.2,up,2\n")
    data = {"links": {"robot": {"channel": {"kind": "trace", "file": "drive.csv"}}}}
    async with shaper(tmp_path, data, master.address):
        async with NodeHandle("tool", master=master.address) as tool:
            up = await told(tool, lambda link: link.rate_bps == 2e6)
            down = (await statistics(tool)).links[1]
    assert (up.direction, down.direction, down.rate_bps) == ("up", "down", 10e6)


def test_a_node_must_say_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMPLE_ROS_SITE", raising=False)
    with pytest.raises(ConfigError, match="set SIMPLE_ROS_SITE"):
        chosen_transports("shaped")
    monkeypatch.setenv("SIMPLE_ROS_SITE", "robot")
    (transport,) = chosen_transports("shaped")
    assert isinstance(transport, ShapedTransport)


async def test_strangers_are_told_off_and_nothing_breaks(tmp_path: Path, master: Master) -> None:
    async with shaper(tmp_path, OPEN) as (_, where):
        host, port = where.split(":")
        for rubbish in (b"GET / HTTP/1.1\r\n\r\n", b"[]\n", b"\xff\xfe\n", b"x" * 10_000):
            reader, writer = await asyncio.open_connection(host, int(port))
            writer.write(rubbish)
            answer = await reader.readline()
            assert b"error" in answer
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()
        dead = ShapedTransport("robot", where)
        with pytest.raises(ConnectionRefusedError, match="does not answer"):
            await dead.dial("shaped://127.0.0.1:1/edge", asyncio.Protocol())


async def test_the_engines_get_records_of_the_simulated_links(tmp_path: Path) -> None:
    channel = {"kind": "radio", "route_m": [[40, 0]]}
    data = {"links": {"robot": {"rnti": 0x4601, "channel": channel}}}
    records: list[LinkRecord] = []
    async with shaper(tmp_path, data) as (process, where):
        source = ShaperSource(where)
        task = asyncio.create_task(source.run(records.append))
        await until(lambda: len(records) >= 3)
        process.signal(signal.SIGINT)
        with pytest.raises(SourceDown, match="link shaper at"):
            await task
        assert await process.wait() == 0
    assert records[0].link_id == "4601"
    assert records[0].quality_of("ul_snr_db") is Quality.SIMULATED
    assert source.malformed == 0


async def test_a_robots_pose_moves_it_in_the_radio_map(master: Master, tmp_path: Path) -> None:
    channel = {"kind": "radio", "route_m": [[30, 0]], "dead_zones": [[200, 0, 20]]}
    data = {"links": {"robot": {"channel": channel, "pose_topic": "/robot/pose"}}}
    async with shaper(tmp_path, data, master.address) as (_, where):
        async with (
            at("robot", where, "robot", master.address) as robot,
            NodeHandle("tool", master=master.address) as tool,
        ):
            before = (await statistics(tool)).links[0].rate_bps
            publisher = await robot.advertise("/robot/pose", PoseStamped)
            await publisher.wait_for_subscribers(1, timeout=30)
            pose = PoseStamped()
            pose.pose.position.x = 200.0
            publisher.publish(pose)
            after = await told(tool, lambda link: link.x_m == 200)
            assert before > 1e6
            assert after.rate_bps < 1e5
            assert after.snr_db < 0


async def test_the_gnbs_slice_policy_file_is_obeyed(master: Master, tmp_path: Path) -> None:
    policy = tmp_path / "rrmPolicy_sub.json"
    policy.write_text("{half a fi")
    data = {"links": {"robot": {"rnti": 0x4601}}, "rrm_policy_file": str(policy)}
    async with shaper(tmp_path, data, master.address):
        async with NodeHandle("tool", master=master.address) as tool:
            assert (await statistics(tool)).links[0].min_share == 0
            from simple_ros_engines.physical_adaptive.actuators import rrm_policy

            policy.write_text(json.dumps(rrm_policy({0x4601: (5, 40, 100)})))
            await told(tool, lambda link: link.min_share > 0.39)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("links: {robot: {up: {rate: 3}}}", "unknown key 'rate'"),
        ("links: [", "shaper.yaml"),
        ("links: {robot: {channel: {kind: trace, file: none.csv}}}", "none.csv"),
    ],
)
async def test_a_wrong_file_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "shaper.yaml"
    file.write_text(text)
    async with python("-m", "simple_ros.cli.main", "link", "shape", str(file)) as process:
        _, errors = await process.process.communicate()
        assert process.process.returncode == 1
        assert words in errors.decode()
        assert len(errors.decode().strip().splitlines()) == 1
