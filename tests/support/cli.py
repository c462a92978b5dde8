"""``simple-ros`` as a user runs it."""

from __future__ import annotations

import asyncio
import json
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from google.protobuf.message import Message

from simple_ros.aio import Publisher
from simple_ros.net.master_client import MasterClient
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from support.processes import Process, python

PROGRAM = ("-m", "simple_ros.cli.main")


async def run(*arguments: str, **environment: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of ``simple-ros`` with these arguments."""
    async with python(*PROGRAM, *arguments, **environment) as process:
        assert process.process.stdout is not None
        stdout = (await process.process.stdout.read()).decode()
        return await process.wait(), stdout, await process.errors()


async def run_json(*arguments: str) -> Any:
    code, stdout, stderr = await run(*arguments, "--json")
    assert (code, stderr) == (0, "")
    return json.loads(stdout)


@asynccontextmanager
async def following(*arguments: str) -> AsyncIterator[Process]:
    """A command that goes on until Ctrl-C, which has to end it with code 0 and no word."""
    async with python(*PROGRAM, *arguments) as process:
        yield process
        process.signal(signal.SIGINT)
        assert await process.wait() == 0
        assert await process.errors() == ""


async def register(
    address: str, info: ros.NodeInfo, msg_type: str = "their_msgs.Thing", topic: str = "things"
) -> None:
    """Make the Master at an address know a publisher without a node of ours."""
    request = ros.RegisterPublisherRequest(topic_name=topic, msg_type=msg_type, node_info=info)
    async with MasterClient(address) as client:
        await client.call(methods.REGISTER_PUBLISHER, request)


async def _flow(publisher: Publisher[Any], message: Message) -> None:
    """A steady flow of one message, until cancelled."""
    while True:
        publisher.publish(message)
        await asyncio.sleep(0.01)


@asynccontextmanager
async def flowing(publisher: Publisher[Any], message: Message) -> AsyncIterator[None]:
    """A steady flow of one message meanwhile."""
    task = asyncio.create_task(_flow(publisher, message))
    try:
        yield
    finally:
        task.cancel()
        await asyncio.wait([task])
