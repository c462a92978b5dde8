"""``simple-ros doctor`` as a user runs it: with a Master, without, and with things that are wrong."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Iterator
from contextlib import AsyncExitStack, ExitStack, closing
from importlib.metadata import version
from pathlib import Path

import pytest
from support.cpp_master import cpp_master
from support.processes import Process, master_process, python
from support.waiting import Stopwatch

from simple_ros import Durability, QosProfile
from simple_ros.aio import NodeHandle
from simple_ros.doctor.looking import Unknown, in_thread, output_of, within
from simple_ros.graph import GraphNode
from simple_ros.msg.example import SensorData
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.net.master_client import MasterClient
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros

LIMIT_S = 5.0
# As the installed command does, do not look for modules in the current folder.
PROGRAM = ("-P", "-m", "simple_ros.cli.main", "doctor")


async def doctor(
    *arguments: str, **environment: str
) -> tuple[int, dict[str, list[dict[str, str]]]]:
    """Exit code and findings by check."""
    async with python(*PROGRAM, "--json", *arguments, **environment) as process:
        assert process.process.stdout is not None
        report = json.loads(await process.process.stdout.read())
        code = await process.wait()
        assert await process.errors() == ""
    found: dict[str, list[dict[str, str]]] = {}
    for finding in report["findings"]:
        found.setdefault(finding["check"], []).append(finding)
    assert code == (1 if report["errors"] else 0)
    return code, found


def levels(found: dict[str, list[dict[str, str]]], check: str) -> list[str]:
    return [finding["level"] for finding in found.get(check, [])]


@pytest.fixture
def nobody() -> Iterator[str]:
    with socket.socket() as holder:  # bound and not listening: nobody answers
        holder.bind(("127.0.0.1", 0))
        yield f"127.0.0.1:{holder.getsockname()[1]}"


class TestMaster:
    async def test_all_is_well(self) -> None:
        async with AsyncExitStack() as stack:
            _, address = await stack.enter_async_context(master_process())
            node = await stack.enter_async_context(NodeHandle("planner", master=address))
            await node.advertise("cmd_vel", Twist)
            _, found = await doctor("--master", address)
            assert found["master"][0]["text"] == f"answers at {address}"
            assert (
                found["master version"][0]["text"] == f"simple-ros {version('simple-ros')}, as here"
            )
            assert found["nodes"][0]["text"] == "1 of 1 take connections: planner"
            assert found["types"][0]["text"] == "1 topic, each of one type"
            for check in (
                "master",
                "master version",
                "nodes",
                "types",
                "QoS",
                "loopback",
                "protobuf",
            ):
                assert levels(found, check) == ["ok"], check
            port = address.rsplit(":", 1)[1]
            assert "simple_ros_master" in found[f"port {port}"][0]["text"]
            async with MasterClient(address) as client:
                left = [info.node_name for info in await client.get_nodes()]
            assert left == ["planner"]

    async def test_nobody(self, nobody: str) -> None:
        code, found = await doctor(SIMPLE_ROS_MASTER=nobody)
        assert code == 1
        assert found["master"] == [
            {
                "check": "master",
                "level": "error",
                "text": f"no Master answers at {nobody}: nobody listens",
                "fix": "start one with 'simple-ros-master', or point SIMPLE_ROS_MASTER at the one "
                "that runs",
            }
        ]

    async def test_somebody_who_says_nothing(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as silent:
            address = f"127.0.0.1:{silent.getsockname()[1]}"
            watch = Stopwatch()
            code, found = await doctor("--master", address)
            assert watch.seconds < LIMIT_S
        assert code == 1
        assert "does not answer as a Master" in found["master"][0]["text"]

    async def test_no_address(self) -> None:
        code, found = await doctor(SIMPLE_ROS_MASTER="robot:port")
        assert code == 1
        assert found["master address"][0]["text"] == (
            "SIMPLE_ROS_MASTER: 'robot:port' is not an address; write host:port or [v6]:port"
        )
        assert "master" not in found

    async def test_no_such_host(self) -> None:
        _, found = await doctor("--master", "no-such-host.invalid:50051")
        assert "'no-such-host.invalid' does not resolve" in found["master"][0]["text"]

    async def test_two_on_one_port(self) -> None:
        code = """if True:
            import signal, socket, sys
            s = socket.socket()
            s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            s.bind(("127.0.0.1", int(sys.argv[1])))
            s.listen()
            print(s.getsockname()[1], flush=True)
            signal.pause()
        """
        async with python("-c", code, "0") as first:
            port = await first.line()
            async with python("-c", code, port) as second:
                await second.line()
                _, found = await doctor("--master", f"127.0.0.1:{port}")
        assert levels(found, f"port {port}") == ["error"]
        assert str(first.pid) in found[f"port {port}"][0]["text"]
        assert str(second.pid) in found[f"port {port}"][0]["text"]


LISTENER = """if True:
    import socket, sys
    s = socket.create_server(("127.0.0.1", 0))
    print(s.getsockname()[1], flush=True)
    while True:
        s.accept()
"""


async def foreign_node(process: Process, name: str) -> GraphNode:
    return GraphNode(name, "127.0.0.1", int(await process.line()))


class TestNodes:
    async def test_a_killed_node_that_a_cpp_master_still_lists(self) -> None:
        async with python("-c", LISTENER) as dead, python("-c", LISTENER) as living:
            nodes = [await foreign_node(dead, "dead"), await foreign_node(living, "living")]
            await dead.kill()
            async with cpp_master(nodes) as address:
                code, found = await doctor("--master", address)
        assert code == 1
        assert "C++ simple_ros" in found["master version"][0]["text"]
        assert found["nodes"][0]["text"] == "1 of 2 take connections: living"
        (finding,) = found["node"]
        assert finding["text"] == (
            f"dead is listed at 127.0.0.1:{nodes[0].port}, but nobody listens: it is dead"
        )

    async def test_a_node_with_no_address(self) -> None:
        async with cpp_master([GraphNode("odd", "localhost", 1)]) as address:
            _, found = await doctor("--master", address)
        assert "nobody can connect to that address" in found["node"][0]["text"]

    async def test_a_hundred_that_never_answer_take_no_longer(self) -> None:
        with socket.create_server(("127.0.0.1", 0), backlog=0) as full, ExitStack() as stack:
            port = full.getsockname()[1]
            while fills(port, stack):
                pass
            names = [f"n{index:03}" for index in range(100)]
            nodes = [GraphNode(name, "127.0.0.1", port) for name in names]
            async with cpp_master(nodes) as address:
                watch = Stopwatch()
                code, found = await doctor("--master", address)
                assert watch.seconds < LIMIT_S
        assert code == 1
        assert len(found["node"]) == 100
        assert "there is no answer within" in found["node"][0]["text"]


def fills(port: int, stack: ExitStack) -> bool:
    """Whether the queue of a listening socket had room for one more, which then stays in it."""
    client = stack.enter_context(socket.socket())
    client.settimeout(0.3)
    try:
        client.connect(("127.0.0.1", port))
    except TimeoutError:
        return False
    return True


class TestGraph:
    async def test_type_and_qos_conflicts(self) -> None:
        async with AsyncExitStack() as stack:
            _, address = await stack.enter_async_context(master_process())
            first, second = [
                await stack.enter_async_context(NodeHandle(name, master=address))
                for name in ("first", "second")
            ]
            await first.advertise("map", SensorData)
            await second.subscribe(
                "map",
                SensorData,
                lambda _: None,
                qos=QosProfile(durability=Durability.TRANSIENT_LOCAL),
            )
            async with MasterClient(address) as client:
                await client.call(  # as a C++ node does, which is not refused
                    methods.SUBSCRIBE,
                    ros.SubscribeRequest(
                        topic_name="map",
                        msg_type="geometry_msgs.Twist",
                        node_info=ros.NodeInfo(
                            node_name="foreign", ip="127.0.0.1", port=first.port
                        ),
                    ),
                )
            code, found = await doctor("--master", address)
        assert code == 1
        assert "no messages on 'map' from first to second" in found["QoS"][0]["text"]
        assert (
            "example.SensorData (first, second), geometry_msgs.Twist (foreign)"
            in (found["types"][0]["text"])
        )


class TestHere:
    async def test_a_folder_that_hides_the_library(
        self, nobody: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        fake = tmp_path / "simple_ros"
        fake.mkdir()
        (fake / "__init__.py").touch()
        (tmp_path / "random.py").touch()
        (tmp_path / "proto").mkdir()
        monkeypatch.chdir(tmp_path)
        code, found = await doctor("--master", nobody)
        assert code == 1
        assert levels(found, "shadowing") == ["error", "ok", "warning"]
        assert f"{fake} in this folder hides the library itself" in found["shadowing"][0]["text"]

    async def test_pythonpath_of_a_ros_installation(self, nobody: str, tmp_path: Path) -> None:
        (tmp_path / "geometry_msgs").mkdir()
        _, found = await doctor("--master", nobody, PYTHONPATH=str(tmp_path))
        assert any("ROS installation" in one["text"] for one in found["shadowing"])
        assert "error" not in levels(found, "shadowing")

    async def test_proxies_are_named_and_not_shown(self, nobody: str) -> None:
        secret = "http://user:secret@proxy:3128"
        arguments = {"http_proxy": secret, "no_proxy": "", "no_grpc_proxy": ""}
        _, found = await doctor("--master", nobody, **arguments)
        assert levels(found, "proxy") == ["warning"]
        assert "secret" not in json.dumps(found)
        _, found = await doctor("--master", nobody, **(arguments | {"no_grpc_proxy": "127.0.0.1"}))
        assert levels(found, "proxy") == ["ok"]

    async def test_for_people(self, nobody: str) -> None:
        async with python(*PROGRAM, "--master", nobody) as process:
            first = await process.line()
            assert process.process.stdout is not None
            rest = (await process.process.stdout.read()).decode()
            assert await process.wait() == 1
        assert "ok       " not in first + rest
        assert (
            f"error    master: no Master answers at {nobody}: nobody listens\n"
            in f"{first}\n{rest}"
        )
        assert rest.splitlines()[-1].endswith("; --verbose shows all")

    async def test_a_broken_grpc_is_a_finding_and_no_traceback(
        self, nobody: str, tmp_path: Path
    ) -> None:
        (tmp_path / "grpc.py").write_text("raise ImportError('broken wheel')\n")
        code, found = await doctor("--master", nobody, PYTHONPATH=str(tmp_path))
        assert code == 1
        assert "cannot be imported: ImportError: broken wheel" in found["grpcio"][0]["text"]
        assert any("hides gRPC" in finding["text"] for finding in found["shadowing"])
        assert "could not be examined: ImportError" in found["master"][0]["text"]


class TestLooking:
    async def test_what_takes_too_long_is_given_up(self) -> None:
        assert await within(0.01, asyncio.sleep(60)) == Unknown("it took longer than 0.01 s")

    async def test_what_fails_is_told(self) -> None:
        assert await within(5, in_thread(int, "x")) == Unknown(
            "ValueError: invalid literal for int() with base 10: 'x'"
        )
        assert await within(5, in_thread(int, "7")) == 7

    async def test_a_thread_that_hangs_is_left_behind(self) -> None:
        left, right = socket.socketpair()
        with closing(left), closing(right):
            assert isinstance(await within(0.01, in_thread(left.recv, 1)), Unknown)
            right.send(b"x")  # lets the thread end

    async def test_programs(self) -> None:
        assert await output_of("echo", "hello") == "hello\n"
        assert await output_of("false") is None
        assert await output_of("no-such-program") is None
