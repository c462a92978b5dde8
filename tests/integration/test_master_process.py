"""The Master as a program: what it prints, how it ends."""

import asyncio
import os
import re
import signal
import sys
from contextlib import asynccontextmanager

import pytest
from support.waiting import STALL_S, Stopwatch

from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master
from simple_ros_master.testing import BareClient, BareNode

ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
READY = re.compile(rb"simple-ros-master: listening on (127\.0\.0\.1:\d+)\n")


@asynccontextmanager
async def program(*arguments: str):
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "simple_ros_master",
        *arguments,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=ENVIRONMENT,
    )
    try:
        async with asyncio.timeout(60):
            yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_it_says_where_it_listens_and_ends_quietly_on_a_signal(number):
    async with program("--port", "0") as process, BareNode("n") as node:
        address = READY.fullmatch(await process.stdout.readline())[1].decode()
        async with BareClient(address) as client:
            request = ros.RegisterPublisherRequest(
                topic_name="t", msg_type="a.A", node_info=node.info()
            )
            assert (await client.call(methods.REGISTER_PUBLISHER, request)).success
            await node.next_update()
            watch = Stopwatch()
            process.send_signal(number)
            stdout, stderr = await process.communicate()
        assert process.returncode == 0
        assert watch.seconds < 1 + STALL_S
        assert stdout == b""
        assert b"Traceback" not in stderr
        assert re.search(rb"INFO node 'n' at 127\.0\.0\.1:\d+\n", stderr)
        assert b"publisher_added" not in stderr


async def test_it_logs_topics_when_asked():
    async with program("--port", "0", "--verbose") as process:
        address = READY.fullmatch(await process.stdout.readline())[1].decode()
        async with BareClient(address) as client:
            await client.call(methods.SUBSCRIBE, ros.SubscribeRequest(topic_name="t"))
        process.terminate()
        _, stderr = await process.communicate()
        assert b"DEBUG subscriber_added: node ''" in stderr


@pytest.mark.parametrize(
    ("host", "reason"),
    [
        ("127.0.0.1", "in use by another program; is another Master running there?"),
        ("192.0.2.1", "cannot listen on 192.0.2.1"),
    ],
)
async def test_it_says_in_one_line_why_it_cannot_listen(host, reason):
    async with (
        Master(port=0) as master,
        program("--host", host, "--port", str(master.port)) as process,
    ):
        stdout, stderr = await process.communicate()
        assert process.returncode == 1
        assert stdout == b""
        assert stderr.count(b"\n") == 1
        assert stderr.startswith(b"simple-ros-master: error: ")
        assert reason.encode() in stderr


async def test_it_says_its_version():
    async with program("--version") as process:
        stdout, _ = await process.communicate()
        assert process.returncode == 0
        assert re.fullmatch(rb"simple-ros-master \S+\n", stdout)
