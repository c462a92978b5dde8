"""Services of a board and services for a board, without the line between."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from support.waiting import until

from simple_ros import aio
from simple_ros.errors import RemoteServiceError
from simple_ros.msg import std_srvs
from simple_ros_firmware_bridge import cdr, services
from simple_ros_firmware_bridge.mapping import TopicMap
from simple_ros_firmware_bridge.services import BoardServices
from simple_ros_firmware_bridge.xrce.creation import ObjectId
from simple_ros_firmware_bridge.xrce.events import (
    Endpoint,
    EndpointGone,
    ServiceCalled,
    ServiceOffered,
    ServiceReplied,
    ServiceWanted,
    SessionClosed,
)
from simple_ros_master import Master

SetBoolRequest, SetBoolResponse = std_srvs.SetBool.request, std_srvs.SetBool.response
ID = ObjectId(b"\x00\x18")
ENDPOINT = Endpoint(
    ID,
    "/switch",
    "std_srvs::srv::dds_::SetBool_Request_",
    reply_type="std_srvs::srv::dds_::SetBool_Response_",
)


class Line:
    """What would go to the board."""

    def __init__(self) -> None:
        self.replies: list[tuple[bytes, bytes]] = []
        self.requests: list[tuple[int, bytes]] = []

    def reply(self, requester: ObjectId, call: bytes, data: bytes, name: str) -> None:
        self.replies.append((call, data))

    def request(self, replier: ObjectId, call: int, data: bytes, name: str) -> None:
        self.requests.append((call, data))


@asynccontextmanager
async def board(master: Master) -> AsyncIterator[tuple[BoardServices, Line, aio.NodeHandle]]:
    line = Line()
    async with (
        aio.NodeHandle("pico_bridge", master=master.address) as node,
        aio.NodeHandle("other", master=master.address) as other,
    ):
        made = BoardServices(node, TopicMap(prefix="left"), line)
        yield made, line, other
        await made.close()


def reply_to(line: Line, index: int, message: str) -> ServiceReplied:
    call, data = line.requests[index]
    request = cdr.decode(data, SetBoolRequest)
    response: Any = SetBoolResponse(success=request.data, message=message)
    return ServiceReplied(ID, call, cdr.encode(response), "<")


async def test_the_graph_calls_the_board(master: Master) -> None:
    async with board(master) as (made, line, other):
        made.take(ServiceOffered(ENDPOINT))
        client = other.service_client("left/switch", std_srvs.SetBool)
        await client.wait_for_service(30)
        calls = [asyncio.create_task(client.call(SetBoolRequest(data=on))) for on in (True, False)]
        await until(lambda: len(line.requests) == 2, "the requests")
        made.take(reply_to(line, 1, "second"))
        made.take(reply_to(line, 0, "first"))
        answers = [(await call).message for call in calls]
        assert sorted(answers) == ["first", "second"]
        made.take(EndpointGone(ID))
        await until(lambda: "left/switch" not in master.graph.to_readable_string(), "its end")


async def test_a_board_that_does_not_answer(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(services, "_BOARD_LIMIT_S", 0.05)
    async with board(master) as (made, _, other):
        made.take(ServiceOffered(ENDPOINT))
        client = other.service_client("left/switch", std_srvs.SetBool)
        await client.wait_for_service(30)
        with pytest.raises(RemoteServiceError, match="the board did not answer within"):
            await client.call(SetBoolRequest())


async def test_the_board_calls_the_graph(master: Master) -> None:
    async with board(master) as (made, line, other):

        def handle(request: Any) -> Any:
            return SetBoolResponse(success=request.data, message="done")

        await other.advertise_service("left/switch", std_srvs.SetBool, handle)
        made.take(ServiceWanted(ENDPOINT))
        made.take(ServiceCalled(ID, b"call", cdr.encode(SetBoolRequest(data=True)), "<"))
        await until(lambda: line.replies, "the reply")
        ((call, data),) = line.replies
        assert call == b"call"
        assert cdr.decode(data, SetBoolResponse).message == "done"
        made.take(SessionClosed("over"))


async def test_a_call_that_cannot_be_answered_is_told(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    async with board(master) as (made, line, _):
        made.take(ServiceWanted(ENDPOINT))
        made.take(ServiceCalled(ID, b"call", b"", "<"))
        await until(lambda: "gets no answer" in caplog.text, "the warning")
        assert line.replies == []
