"""``simple-ros node kill`` ends real processes."""

from __future__ import annotations

import asyncio
import json
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import grpc
import pytest
from support.cli import PROGRAM, register, run
from support.processes import Process, program, python

from simple_ros.aio import NodeHandle
from simple_ros.msg.std_msgs import String
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master

pytestmark = pytest.mark.usefixtures("patient_master")

SPINNER = """
    import sys
    from simple_ros import aio

    async def main():
        async with aio.NodeHandle(sys.argv[1]) as node:
            await node.wait_for_master(30)
            print("ready", flush=True)
            await node.spin()
        print("left", flush=True)

    aio.run(main())
"""
STUBBORN = """
    import asyncio, signal, socket, sys
    sys.argv[1] == "deaf" and signal.signal(signal.SIGTERM, signal.SIG_IGN)

    async def main():
        server = await asyncio.start_server(lambda reader, writer: None, "127.0.0.1", 0)
        print(server.sockets[0].getsockname()[1], flush=True)
        await server.serve_forever()

    asyncio.run(main())
"""


@asynccontextmanager
async def spinner(name: str, master: Master) -> AsyncIterator[Process]:
    async with program(SPINNER, name, master=master.address) as process:
        assert await process.line() == "ready"
        yield process


@asynccontextmanager
async def foreign(name: str, master: Master, kind: str = "plain") -> AsyncIterator[Process]:
    """A process that listens and that the Master takes for a C++ node."""
    async with program(STUBBORN, kind) as process:
        port = int(await process.line())
        await register(master.address, ros.NodeInfo(node_name=name, ip="127.0.0.1", port=port))
        yield process


class TestNodesOfOurs:
    async def test_by_name(self, master: Master) -> None:
        at = ("--master", master.address)
        async with spinner("one", master) as one, spinner("two", master) as two:
            assert await run("node", "kill", "/one", *at) == (0, "killed one\n", "")
            assert await one.line() == "left"
            assert await one.wait() == 0
            assert two.process.returncode is None
            code, stdout, stderr = await run("node", "list", *at)
            assert (code, stdout.split()[0], stderr) == (0, "two", "")

    async def test_all_also_commands_of_other_terminals(self, master: Master) -> None:
        at = ("--master", master.address)
        async with (
            spinner("one", master),
            spinner("two", master),
            python(*PROGRAM, "topic", "pub", "x", "String", *at) as pub,
        ):
            name = f"cli_pub_{pub.pid}"
            async with NodeHandle("seer", master=master.address) as seer:
                subscriber = await seer.subscribe("x", "std_msgs.String", raw=True)
                await subscriber.receive_within(30)
            code, stdout, stderr = await run("node", "kill", "--all", "--json", *at)
            assert (code, stderr) == (0, "")
            assert json.loads(stdout) == [
                {"name": each, "killed": True, "pid": None, "error": None}
                for each in (name, "one", "two")
            ]
            assert await pub.wait() == 0
        assert await run("node", "kill", "--all", *at) == (0, "", "")

    async def test_commands_that_listen_end_with_code_0(self, master: Master) -> None:
        at = ("--master", master.address)
        async with NodeHandle("robot", master=master.address) as node:
            publisher = await node.advertise("chatter", String)
            async with (
                python(*PROGRAM, "topic", "hz", "chatter", *at) as hz,
                python(*PROGRAM, "topic", "echo", "chatter", *at) as echo,
            ):
                await publisher.wait_for_subscribers(2)
                names = [f"cli_hz_{hz.pid}", f"cli_echo_{echo.pid}"]
                code, stdout, _ = await run("node", "kill", *names, *at)
                assert (code, sorted(stdout.splitlines())) == (
                    0,
                    sorted(f"killed {name}" for name in names),
                )
                assert await hz.wait() == await echo.wait() == 0

    async def test_one_that_hangs_is_told(self, master: Master) -> None:
        async with spinner("stuck", master) as stuck:
            stuck.signal(signal.SIGSTOP)
            shown = await run(
                "node", "kill", "stuck", "--timeout", "0.3", "--master", master.address
            )
            stuck.signal(signal.SIGCONT)
        assert shown == (1, "", "error: stuck did not end within 0.3 s\n")

    async def test_an_unknown_name_ends_none(self, master: Master) -> None:
        async with NodeHandle("robot", master=master.address) as node:
            await node.wait_for_master(30)
            shown = await run("node", "kill", "robot", "robto", "--master", master.address)
            assert shown == (1, "", "error: no node 'robto'; did you mean 'robot'?\n")
            assert not node.is_closed

    async def test_a_later_node_at_the_same_port_is_spared(self, master: Master) -> None:
        async with NodeHandle("robot", master=master.address) as node:
            await node.wait_for_master(30)
            info = ros.NodeInfo(
                node_name="former", ip="127.0.0.1", port=node.port, instance_id="gone"
            )
            await register(master.address, info)
            shown = await run(
                "node", "kill", "former", "--timeout", "0.3", "--master", master.address
            )
            assert shown[0] == 1
            assert not node.is_closed

    async def test_names_or_all(self) -> None:
        for arguments in ((), ("--all", "robot")):
            code, _, stderr = await run("node", "kill", *arguments)
            assert code == 2
            assert "give the names of nodes, or --all" in stderr


class TestForeignNodes:
    async def test_without_signal_it_is_told_what_would_do(self, master: Master) -> None:
        async with foreign("theirs", master) as theirs:
            code, stdout, stderr = await run("node", "kill", "theirs", "--master", master.address)
            assert (code, stdout) == (1, "")
            assert stderr.startswith(
                "error: theirs is a C++ node and cannot be asked to end; with --signal, the "
                "process that listens at 127.0.0.1:"
            )
            assert theirs.process.returncode is None

    async def test_with_signal_its_process_ends(self, master: Master) -> None:
        async with foreign("theirs", master) as theirs:
            shown = await run("node", "kill", "theirs", "--signal", "--master", master.address)
            line = f"killed theirs (SIGTERM to process {theirs.pid})\n"
            assert shown == (0, line, "")
            assert await theirs.wait() == -signal.SIGTERM

    async def test_one_that_ignores_the_signal(self, master: Master) -> None:
        async with foreign("theirs", master, "deaf") as theirs:
            command = ("node", "kill", "theirs", "--signal", "--timeout", "0.3")
            shown = await run(*command, "--master", master.address)
        reason = f"theirs did not end within 0.3 s of SIGTERM to process {theirs.pid}"
        assert shown == (1, "", f"error: {reason}\n")

    async def test_on_another_host(self, master: Master) -> None:
        info = ros.NodeInfo(node_name="far", ip="192.0.2.1", port=60000)
        await register(master.address, info)
        shown = await run("node", "kill", "far", "--signal", "--master", master.address)
        reason = (
            "far is a C++ node and cannot be asked to end; it listens at 192.0.2.1:60000, on "
            "another host: end its process there"
        )
        assert shown == (1, "", f"error: {reason}\n")


@asynccontextmanager
async def cpp_master(node: NodeHandle) -> AsyncIterator[str]:
    """A stand-in for a C++ Master: it lists a node of ours, without its instance, until it ends."""

    async def get_nodes(_: ros.GetNodesRequest, __: object) -> ros.GetNodesResponse:
        info = ros.NodeInfo(node_name=node.name, ip="127.0.0.1", port=node.port)
        return ros.GetNodesResponse(success=True, nodes=[] if node.is_closed else [info])

    method = methods.GET_NODES
    handler = grpc.unary_unary_rpc_method_handler(
        get_nodes, method.request.FromString, method.response.SerializeToString
    )
    server = grpc.aio.server(options=[("grpc.so_reuseport", 0)])
    table = grpc.method_handlers_generic_handler(methods.ROS_RPC_SERVICE, {method.name: handler})
    server.add_generic_rpc_handlers((table,))
    port = server.add_insecure_port("127.0.0.1:0")
    await server.start()
    try:
        yield f"127.0.0.1:{port}"
    finally:
        await server.stop(0)


class TestAtACppMaster:
    async def test_a_node_of_ours_obeys(self, master: Master) -> None:
        async with NodeHandle("robot", master=master.address) as node, cpp_master(node) as address:
            shown = await run("node", "kill", "--all", "--master", address)
            assert shown == (0, "killed robot\n", "")
            await asyncio.wait_for(node.wait_ended(), 30)
