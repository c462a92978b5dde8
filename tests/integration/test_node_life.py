"""How nodes start, wait, move between Masters, and end."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket

import pytest
from support.peers import ForeignListener
from support.processes import master_process, program
from support.waiting import STALL_S, Stopwatch, until

from simple_ros.aio import MasterClient, NodeHandle
from simple_ros.errors import (
    AddressInUse,
    ConfigError,
    InvalidName,
    MasterUnavailable,
    NodeNameTaken,
    TopicTypeMismatch,
)
from simple_ros.msg.example import ControlCommand, SensorData
from simple_ros.net import addresses
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master

RECEIVER = """
    from simple_ros import aio
    from simple_ros.msg.example import SensorData

    async def main():
        async with aio.NodeHandle("receiver") as node:
            subscription = await node.subscribe("sensor", SensorData)
            print("ready")
            await subscription.receive()

    aio.run(main())
"""

TALKER = """
    import logging, sys
    from simple_ros import aio
    from simple_ros.msg.example import SensorData

    logging.basicConfig()

    async def main():
        async with aio.NodeHandle("talker") as node:
            publisher = await node.advertise("sensor", SensorData)
            count = 0
            def tick(event):
                nonlocal count
                publisher.publish(SensorData(sensor_id=count))
                count += 1
            node.create_timer(0.01, tick)
            print("ready", flush=True)
            await node.spin()

    aio.run(main())
"""


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as sock:
        return int(sock.getsockname()[1])


async def test_a_node_started_first_waits_for_the_master(caplog: pytest.LogCaptureFixture) -> None:
    port = free_port()
    async with NodeHandle("early", master=f"127.0.0.1:{port}") as node:
        advertising = asyncio.create_task(node.advertise("sensor", SensorData))
        with pytest.raises(TimeoutError):
            await node.wait_for_master(timeout=0.05)
        await until(lambda: "waiting for a Master at" in caplog.text)
        async with Master(host="127.0.0.1", port=port) as master:
            publisher = await asyncio.wait_for(advertising, 30)
            assert publisher.topic == "sensor"
            assert "found the Master at" in caplog.text
            async with MasterClient(master.address) as client:
                (info,) = await client.get_nodes("early")
                assert (info.ip, info.port) == ("127.0.0.1", node.port)


async def test_a_tool_says_clearly_that_no_master_is_there() -> None:
    async with MasterClient(f"127.0.0.1:{free_port()}") as client:
        with pytest.raises(MasterUnavailable, match="SIMPLE_ROS_MASTER"):
            await client.get_nodes()


async def test_master_restart_all_register_again_and_links_never_stop() -> None:
    got: list[int] = []
    async with ForeignListener() as cpp, master_process() as (first, address):
        port = int(address.rsplit(":", 1)[1])
        async with (
            NodeHandle("source", master=address) as source,
            NodeHandle("sink", master=address) as sink,
        ):
            publisher = await source.advertise("sensor", SensorData)
            await sink.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
            target = ros.NodeInfo(ip="127.0.0.1", port=cpp.port, node_name="cpp")
            request = ros.SubscribeRequest(
                topic_name="sensor", msg_type="example.SensorData", node_info=target
            )
            await source.client.call(methods.SUBSCRIBE, request)
            await publisher.wait_for_subscribers(2, timeout=30)
            first.signal(signal.SIGKILL)
            await first.wait()
            for i in range(10):
                publisher.publish(SensorData(sensor_id=i))
            await until(lambda: len(got) == len(cpp.frames) == 10, "carried without a Master")
            async with master_process(port), MasterClient(address) as client:
                returned = Stopwatch()

                async def registered() -> bool:
                    info = await client.get_topic_info("sensor")
                    return len(info.publishers) == 1 and len(info.subscribers) == 1

                while True:
                    try:
                        if await registered():
                            break
                    except (LookupError, MasterUnavailable):
                        pass
                    assert returned.seconds < 2.0 + STALL_S, "within 2 s of the Master's return"
                    await asyncio.sleep(0.01)
                publisher.publish(SensorData(sensor_id=10))
                await until(lambda: len(got) == len(cpp.frames) == 11)
                assert len(cpp.carriers) == 1, "the same link all along"
                late: list[int] = []
                await sink.subscribe("late", SensorData, lambda m: late.append(m.sensor_id))
                other = await source.advertise("late", SensorData)
                other.publish(SensorData(sensor_id=1))
                await until(lambda: late == [1])


async def test_a_newer_node_takes_the_name_and_the_old_one_says_why(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    got: list[int] = []
    async with NodeHandle("sink", master=master.address) as sink:
        await sink.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        old = await NodeHandle("robot", master=master.address).start()
        old_publisher = await old.advertise("sensor", SensorData)
        spinning = asyncio.create_task(old.spin())
        async with NodeHandle("/robot", master=master.address) as new:
            publisher = await new.advertise("sensor", SensorData)
            with pytest.raises(NodeNameTaken, match="robot") as caught:
                await asyncio.wait_for(spinning, 30)
            assert caught.value.taken_by == f"127.0.0.1:{new.port}"
            assert "'robot' was taken over by a newer node" in caplog.text
            with pytest.raises(NodeNameTaken):
                old_publisher.publish(SensorData(sensor_id=1))
            with pytest.raises(NodeNameTaken):
                await old.advertise("other", SensorData)
            await old.close()
            (info,) = await new.client.get_nodes("robot")
            assert info.port == new.port, "the old node's goodbye removed nothing"
            publisher.publish(SensorData(sensor_id=2))
            await until(lambda: got == [2])


async def test_a_replaced_node_that_lost_contact_learns_it_when_it_is_back(master: Master) -> None:
    """It was away (a dead zone, say) while its successor came, so nobody could tell it."""
    old = await NodeHandle("robot", master=master.address).start()
    await old.wait_for_master(timeout=30)
    registrar = old._registrar
    assert registrar is not None
    registrar._task.cancel()
    await asyncio.gather(registrar._task, return_exceptions=True)
    async with NodeHandle("robot", master=master.address) as new:
        await new.wait_for_master(timeout=30)
        registrar._task = asyncio.create_task(registrar._run())
        with pytest.raises(NodeNameTaken, match=str(new.port)):
            await asyncio.wait_for(old.spin(), 30)
    await old.close()


async def test_type_conflict_found_after_a_restart_is_logged_and_survived(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Both registered with Masters that did not know the other; nobody may be thrown out."""
    caplog.set_level(logging.WARNING)
    port = free_port()
    address = f"127.0.0.1:{port}"
    async with Master(host="127.0.0.1", port=port), NodeHandle("a", master=address) as a:
        await a.advertise("sensor", SensorData)
        async with Master(host="127.0.0.1", port=0) as other:
            async with NodeHandle("b", master=other.address) as b:
                await b.advertise("sensor", ControlCommand)
                b._registrar._address = address  # type: ignore[union-attr]
                b._registrar.client = MasterClient(address, keepalive=True)  # type: ignore[union-attr]
                await other.stop()
                await until(lambda: caplog.text.count("TopicTypeMismatch") >= 2)
                assert a.failure is None
                assert b.failure is None
        with pytest.raises(TopicTypeMismatch):
            await a.advertise("sensor", ControlCommand)


async def test_bad_arguments_are_refused_at_once() -> None:
    with pytest.raises(InvalidName):
        NodeHandle("my node")
    with pytest.raises(ConfigError, match="host:port"):
        NodeHandle("node", master="nowhere:port")
    with pytest.raises(RuntimeError, match="not started"):
        await NodeHandle("node").advertise("sensor", SensorData)


async def test_a_taken_port_is_named(master: Master) -> None:
    with socket.create_server(("127.0.0.1", 0)) as sock:
        port = sock.getsockname()[1]
        with pytest.raises(AddressInUse, match=str(port)):
            await NodeHandle("node", master=master.address, port=port).start()


async def test_ports_of_cpp_tools_are_left_free(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system hands out a reserved port (here one that is surely free): another is taken."""
    assert frozenset({50052, 50053, 60002}) == addresses.RESERVED_PORTS
    reserved = free_port()
    real = addresses._bind
    offered = [reserved]

    def bind(host: str, port: int) -> socket.socket:
        return real(host, offered.pop() if offered and not port else port)

    monkeypatch.setattr(addresses, "RESERVED_PORTS", frozenset({reserved}))
    monkeypatch.setattr(addresses, "_bind", bind)
    async with NodeHandle("node", master=master.address) as node:
        assert not offered
        assert node.port != reserved


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_signals_end_a_node_quietly_within_a_second(
    master: Master, number: signal.Signals
) -> None:
    async with program(TALKER, master=master.address) as talker:
        assert await talker.line() == "ready"
        assert "talker" in master.graph
        watch = Stopwatch()
        talker.signal(number)
        assert await talker.wait() == 0
        assert watch.seconds < 1.0 + STALL_S
        assert await talker.errors() == ""
        # It does not wait for long until its goodbye is heard.
        await until(lambda: "talker" not in master.graph, "its goodbye")


async def test_a_program_that_loses_its_name_ends_with_one_line(master: Master) -> None:
    async with program(TALKER, master=master.address) as talker:
        assert await talker.line() == "ready"
        async with NodeHandle("talker", master=master.address) as newer:
            await newer.wait_for_master(30)
            assert await talker.wait() == 1
            errors = await talker.errors()
        assert "Traceback" not in errors
        assert errors.rstrip().endswith(f"taken over by a newer node at 127.0.0.1:{newer.port}")


async def test_a_program_that_awaits_a_message_when_it_loses_its_name(master: Master) -> None:
    async with program(RECEIVER, master=master.address) as receiver:
        assert await receiver.line() == "ready"
        async with NodeHandle("receiver", master=master.address) as newer:
            await newer.wait_for_master(30)
            assert await receiver.wait() == 1
            errors = await receiver.errors()
        assert "Traceback" not in errors
        assert errors.rstrip().endswith(f"taken over by a newer node at 127.0.0.1:{newer.port}")


async def test_a_senseless_word_on_the_command_line_is_no_traceback(master: Master) -> None:
    async with program(RECEIVER, "__ns:=/r-2", master=master.address) as receiver:
        assert await receiver.wait() == 1
        errors = await receiver.errors()
    assert errors.startswith("argument names a namespace that must not contain '-'")
    assert errors.endswith("\n  '__ns:=/r-2'\n           ^\n")


async def test_a_signal_ends_a_node_that_waits_for_a_master() -> None:
    async with program(TALKER, master=f"127.0.0.1:{free_port()}") as talker:
        assert talker.process.stderr is not None
        line = await asyncio.wait_for(talker.process.stderr.readline(), 30)
        assert b"waiting for a Master" in line
        talker.signal(signal.SIGTERM)
        assert await talker.wait() == 0
        assert await talker.errors() == ""


async def test_timers_run_pause_and_end(master: Master) -> None:
    calls: list[str] = []
    async with NodeHandle("node", master=master.address) as node:

        async def later(event: object) -> None:
            await asyncio.sleep(0)
            calls.append("async")

        def failing(event: object) -> None:
            calls.append("failing")
            raise ValueError("boom")

        timer = node.create_timer(0.005, lambda event: calls.append("plain"))
        once = node.create_timer(0.001, lambda event: calls.append("once"), oneshot=True)
        node.create_timer(0.005, later)
        broken = node.create_timer(0.005, failing)
        await until(lambda: calls.count("plain") >= 3 and calls.count("async") >= 3)
        await until(lambda: broken.errors >= 3)
        assert calls.count("once") == 1
        timer.pause()
        paused_at = calls.count("plain")
        count = calls.count("async")
        await until(lambda: calls.count("async") >= count + 3)
        assert calls.count("plain") == paused_at
        timer.resume()
        await until(lambda: calls.count("plain") > paused_at)
        timer.period = 0.001
        assert timer.period == 0.001
        timer.set_one_shot(True)
        await until(lambda: not timer.is_running)
        once.start()
        await until(lambda: calls.count("once") == 2)
    assert not broken.is_running
