"""Other middleware that is measured, what of it is installed, and the servers it needs."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import shutil
import socket
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from peers_install import PACKAGES, python_of, result_of

from simple_ros.benchmark.calling import Caller
from simple_ros.benchmark.peers import Peer
from simple_ros.benchmark.running import end

PROGRAMS = Path(__file__).parent / "rivals"
PIXELS = frozenset({"mib", "mib30", "image30"})
_UP_LIMIT_S = 10.0


def _rival(
    name: str,
    what: str,
    *,
    venv: str = "",
    program: str = "",
    without: set[str] | None = None,
    only: set[str] | frozenset[str] | None = None,
    services: tuple[str, ...] = (),
    fractions: dict[str, float] | None = None,
    **options: str,
) -> Peer:
    venv = venv or name
    everything = {"latency", "small", "fanout", *PIXELS}
    return Peer(
        name,
        "rival",
        what,
        (str(python_of(venv)), str(PROGRAMS / f"{program or venv}_peer.py")),
        options,
        frozenset(only or everything) - (without or set()),
        services,
        fractions or {},
        options.get("form") == "raw",
        str(result_of(venv)["reason"]) or _missing_server(services),
    )


def _missing_server(services: tuple[str, ...]) -> str:
    for service, (program, package) in SERVERS.items():
        if service in services and not _found(program):
            return f"no {program}: apt-get install {package}"
    return ""


def _found(program: str) -> str | None:
    return shutil.which(program) or shutil.which(program, path="/usr/sbin:/usr/local/sbin")


SERVERS = {"nats": ("nats-server", "nats-server"), "ros1": ("rosmaster", "python3-rosmaster")}
_SLOW = {"small": 0.1, "fanout": 0.1, "mib": 0.1}
_ROS2_SLOW = {"small": 0.01, "fanout": 0.02, "mib": 0.2}


def rivals() -> dict[str, Peer]:
    """All of them by name; ``missing`` says why one cannot run."""
    peers = (
        _rival("zmq", "pyzmq, PUB/SUB, TCP", transport="tcp"),
        _rival("zmq_ipc", "pyzmq, PUB/SUB, ipc", venv="zmq", transport="ipc"),
        _rival(
            "zmq_raw",
            "pyzmq, raw bytes, not copied",
            venv="zmq",
            only=PIXELS,
            transport="tcp",
            form="raw",
        ),
        _rival("zenoh", "Zenoh, TCP, reliable, blocking"),
        _rival("zenoh_raw", "Zenoh, raw bytes, TCP", venv="zenoh", only=PIXELS, form="raw"),
        _rival("zenoh_shm", "Zenoh, shared memory", venv="zenoh", only=PIXELS, memory="auto"),
        _rival(
            "zenoh_raw_shm",
            "Zenoh, raw bytes, shared memory",
            venv="zenoh",
            only=PIXELS,
            form="raw",
            memory="shared",
        ),
        _rival("iceoryx2", "iceoryx2, shared memory", services=("iceoryx2",)),
        _rival(
            "iceoryx2_raw",
            "iceoryx2, raw bytes",
            venv="iceoryx2",
            only=PIXELS,
            services=("iceoryx2",),
            form="raw",
        ),
        _rival(
            "lcm",
            "LCM, UDP multicast, no flow control",
            services=("lcm",),
            fractions={"small": 0.5},
            max_hz="90000",
        ),
        _rival(
            "nats", "NATS, one server", services=("nats",), fractions={"small": 0.5, "fanout": 0.5}
        ),
        _rival("rospy", "rospy, its own messages", services=("ros1",), fractions={"small": 0.5}),
        _rival(
            "cyclonedds",
            "Cyclone DDS, reliable, keep all",
            services=("dds",),
            fractions=_SLOW,
            without={"image30"},
        ),
        _rival(
            "rclpy_kilted",
            "rclpy Kilted, reliable, its own messages",
            program="rclpy",
            services=("dds",),
            fractions=_ROS2_SLOW,
        ),
        _rival(
            "rclpy_jazzy",
            "rclpy Jazzy, reliable, its own messages",
            program="rclpy",
            services=("dds",),
            fractions=_ROS2_SLOW,
        ),
        _rival(
            "dora",
            "dora-rs, dynamic nodes of one dataflow",
            services=("dora",),
            fractions=_SLOW,
            without={"fanout"},
        ),
    )
    return {peer.name: peer for peer in peers}


def rival_callers() -> dict[str, Caller]:
    """Those whose services are measured."""
    program = str(PROGRAMS / "calls_peer.py")

    def caller(name: str, kind: str, what: str, services: tuple[str, ...] = ()) -> Caller:
        missing = str(result_of(name)["reason"]) or _missing_server(services)
        return Caller(name, what, (str(python_of(name)), program, kind), services, missing)

    callers = (
        caller("zmq", "zmq", "pyzmq, REQ/REP and DEALER, TCP"),
        caller("zenoh", "zenoh", "Zenoh, queryable, TCP"),
        Caller("grpc", "grpc.aio, unary", (sys.executable, program, "grpc")),
        caller("rospy", "rospy", "rospy, persistent", ("ros1",)),
        caller("rclpy_kilted", "rclpy", "rclpy Kilted", ("dds",)),
    )
    return {caller.name: caller for caller in callers}


def versions() -> dict[str, object]:
    return {name: result_of(name)["versions"] for name in PACKAGES}


# -- servers ---------------------------------------------------------------------------------------


@asynccontextmanager
async def servers(wanted: set[str]) -> AsyncIterator[dict[str, str]]:
    """What the peers need beside them, at places of their own; by name where each is."""
    number = random.randrange(1 << 16)
    found = {
        "dds": str(1 + number % 200),
        "iceoryx2": str(number),
        "lcm": str(20_000 + number % 10_000),
    }
    os.environ["BENCH_DDS_DOMAIN"] = found["dds"]
    async with contextlib.AsyncExitStack() as stack:
        if "nats" in wanted:
            found["nats"] = await stack.enter_async_context(_nats())
        if "ros1" in wanted:
            found["ros1"] = await stack.enter_async_context(_rosmaster())
        if "dora" in wanted:
            found["dora"] = await stack.enter_async_context(_dora())
        yield {name: place for name, place in found.items() if name in wanted}


@asynccontextmanager
async def _nats() -> AsyncIterator[str]:
    port = free_port()
    with tempfile.TemporaryDirectory() as directory:
        config = Path(directory) / "nats.conf"
        config.write_text(
            f'listen: "127.0.0.1:{port}"\nmax_payload: 16MB\nmax_pending: 1GB\n'
            'write_deadline: "60s"\n'
        )
        async with _server(_found("nats-server") or "nats-server", "-c", str(config), port=port):
            yield f"nats://127.0.0.1:{port}"


@asynccontextmanager
async def _rosmaster() -> AsyncIterator[str]:
    port = free_port()
    uri = f"http://127.0.0.1:{port}"
    os.environ.update(ROS_MASTER_URI=uri, ROS_IP="127.0.0.1")
    async with _server("rosmaster", "--core", "-p", str(port), port=port):
        yield uri


@asynccontextmanager
async def _dora() -> AsyncIterator[str]:
    """A coordinator and a daemon, at dora's own ports: dynamic nodes look nowhere else."""
    program = str(python_of("dora").parent / "dora")
    quiet = {"stdout": asyncio.subprocess.DEVNULL, "stderr": asyncio.subprocess.DEVNULL}
    up = await asyncio.create_subprocess_exec(program, "up", **quiet)
    await up.wait()
    try:
        yield "local"
    finally:
        down = await asyncio.create_subprocess_exec(program, "down", "--force", **quiet)
        await down.wait()


@asynccontextmanager
async def _server(*command: str, port: int) -> AsyncIterator[None]:
    quiet = asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(*command, stdout=quiet, stderr=quiet)
    try:
        async with asyncio.timeout(_UP_LIMIT_S):
            while True:
                try:
                    _, writer = await asyncio.open_connection("127.0.0.1", port)
                except OSError:
                    await asyncio.sleep(0.05)
                    continue
                writer.close()
                break
        yield
    finally:
        end(process)
        await process.wait()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        return int(listening.getsockname()[1])
