"""Services: on one loop, over real connections, between processes that die."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import AsyncIterator

import pytest
from support.foreign_master import ForeignMaster as CppMaster
from support.processes import master_process, program
from support.waiting import Stopwatch, until

from simple_ros import (
    HandleClosed,
    InvalidName,
    MasterUnavailable,
    RegistrationRefused,
    RemoteServiceError,
    ServiceTimeout,
    ServiceTypeMismatch,
    ServiceUnavailable,
    UnknownMessageType,
)
from simple_ros.aio import AdaptiveTimeout, NodeHandle
from simple_ros.graph import ChangeKind, GraphChange, GraphService
from simple_ros.msg.example import SensorData
from simple_ros.msg.example_interfaces import AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse
from simple_ros.msg.interfaces import ServiceType
from simple_ros.msg.std_srvs import SetBool, Trigger, TriggerRequest, TriggerResponse
from simple_ros.net.master_client import ForeignMaster
from simple_ros.rpc import methods
from simple_ros.rpc import services_pb2 as srv
from simple_ros.testing import FakeMaster
from simple_ros_master.server import Master

SERVER = """
    import asyncio
    from simple_ros import aio
    from simple_ros.msg.example_interfaces import AddTwoInts, AddTwoIntsResponse

    async def add(request):
        if request.a < 0:
            print("began", flush=True)
            try:
                await asyncio.Event().wait()
            finally:
                print("ended", flush=True)
        return AddTwoIntsResponse(sum=request.a + request.b)

    async def main():
        async with aio.NodeHandle("server") as node:
            await node.advertise_service("add", AddTwoInts, add)
            print("ready", flush=True)
            await node.spin()
    aio.run(main())
"""


def added(request: AddTwoIntsRequest) -> AddTwoIntsResponse:
    return AddTwoIntsResponse(sum=request.a + request.b)


def ask(a: int, b: int) -> AddTwoIntsRequest:
    return AddTwoIntsRequest(a=a, b=b)


@contextlib.asynccontextmanager
async def nodes(master: Master, where: str) -> AsyncIterator[tuple[NodeHandle, NodeHandle]]:
    """A provider and a client: on one loop directly, or with a connection between them."""
    async with (
        NodeHandle("server", master=master.address) as server,
        NodeHandle("client", master=master.address) as client,
    ):
        if where == "connected":
            client.providers._local_lanes = lambda _: None
        yield server, client


both_ways = pytest.mark.parametrize("where", ["local", "connected"])


@both_ways
async def test_calls_are_answered_in_any_number_at_a_time(master: Master, where: str) -> None:
    async with nodes(master, where) as (server, client):
        provided = await server.advertise_service("add", AddTwoInts, added)
        add = client.service_client("/add", "example_interfaces/srv/AddTwoInts")
        assert (await add.call(ask(1, 2))).sum == 3
        answers = await asyncio.gather(*(add.call(ask(i, i)) for i in range(500)))
        assert [answer.sum for answer in answers] == [2 * i for i in range(500)]
        assert provided.statistics.calls == 501
        assert add.rtt.srtt_s is not None


@both_ways
async def test_an_exception_of_the_handler_is_raised_at_the_client(
    master: Master, where: str
) -> None:
    async def fails(request: TriggerRequest) -> TriggerResponse:
        raise LookupError("no such thing")

    def wrong(request: TriggerRequest) -> TriggerResponse:
        return SensorData()  # type: ignore[return-value]

    async with nodes(master, where) as (server, client):
        await server.advertise_service("fails", Trigger, fails)
        await server.advertise_service("wrong", Trigger, wrong)
        with pytest.raises(RemoteServiceError) as caught:
            await client.service_client("fails", Trigger).call(TriggerRequest())
        error = caught.value
        assert (error.type, error.message, error.node) == ("LookupError", "no such thing", "server")
        with pytest.raises(RemoteServiceError, match=r"returned example\.SensorData, not std_srvs"):
            await client.service_client("wrong", Trigger).call(TriggerRequest())


@both_ways
async def test_a_call_that_takes_too_long_is_given_up_on_both_sides(
    master: Master, where: str
) -> None:
    cancelled = asyncio.Event()
    stuck = asyncio.Event()

    async def never(request: TriggerRequest) -> TriggerResponse:
        if not stuck.is_set():
            return TriggerResponse()
        try:
            await asyncio.Event().wait()
        finally:
            cancelled.set()
        return TriggerResponse()

    async with nodes(master, where) as (server, client):
        provided = await server.advertise_service("never", Trigger, never)
        # Linked already, and time enough for the handler to begin although a process stands still.
        caller = client.service_client("never", Trigger, timeout=1.0)
        await caller.call(TriggerRequest(), timeout=30)
        stuck.set()
        with pytest.raises(ServiceTimeout):
            await caller.call(TriggerRequest())
        await cancelled.wait()
        cancelled.clear()
        task = asyncio.create_task(caller.call(TriggerRequest(), timeout=None))
        await until(lambda: provided.statistics.running == 1)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await cancelled.wait()
        await until(lambda: provided.statistics.running == 0)
        assert provided.statistics.expired == 2
        assert provided.statistics.errors == 0


@both_ways
async def test_waiting_calls_go_by_priority_and_too_many_are_refused(
    master: Master, where: str
) -> None:
    gate, order = asyncio.Event(), []

    async def slow(request: AddTwoIntsRequest) -> AddTwoIntsResponse:
        await gate.wait()
        order.append(request.a)
        return AddTwoIntsResponse()

    async with nodes(master, where) as (server, client):
        provided = await server.advertise_service(
            "slow", AddTwoInts, slow, max_concurrent=1, queue_limit=3
        )
        caller = client.service_client("slow", AddTwoInts)
        first = asyncio.create_task(caller.call(ask(0, 0)))
        await until(lambda: provided.statistics.running == 1)
        tasks = []
        for number, priority in [(1, 0), (2, 9), (3, 0)]:
            tasks.append(asyncio.create_task(caller.call(ask(number, 0), priority=priority)))
            waiting = number
            await until(lambda waiting=waiting: provided.statistics.waiting == waiting)
        with pytest.raises(ServiceUnavailable, match="too many calls"):
            await caller.call(ask(4, 0))
        gate.set()
        await asyncio.gather(first, *tasks)
        assert order == [0, 2, 1, 3]
        assert provided.statistics.refused == 1


@both_ways
async def test_a_service_that_ends_refuses_what_waits(master: Master, where: str) -> None:
    async def never(request: TriggerRequest) -> TriggerResponse:
        await asyncio.Event().wait()
        return TriggerResponse()

    async with nodes(master, where) as (server, client):
        provided = await server.advertise_service("never", Trigger, never)
        caller = client.service_client("never", Trigger)
        task = asyncio.create_task(caller.call(TriggerRequest()))
        await until(lambda: provided.statistics.running == 1)
        await provided.close()
        await provided.close()
        with pytest.raises(ServiceUnavailable, match="does not provide it any more"):
            await task
        with pytest.raises(ServiceUnavailable):
            await caller.call(TriggerRequest())
        again = await server.advertise_service(
            "never", Trigger, lambda _: TriggerResponse(message="now")
        )
        assert (await caller.call(TriggerRequest())).message == "now"
        await again.close()
        assert not (
            await client.client.call(methods.GET_SERVICES, srv.GetServicesRequest())
        ).services


async def test_wrong_uses_are_told(master: Master) -> None:
    async with nodes(master, "connected") as (server, client):
        await server.advertise_service("add", AddTwoInts, added)
        with pytest.raises(
            ServiceTypeMismatch, match=r"has type .*AddTwoInts.*, not std_srvs\.SetB"
        ):
            await client.service_client("add", SetBool).call(SetBool.request())
        with pytest.raises(
            RegistrationRefused, match="node 'server' provides service 'add' already"
        ):
            await client.advertise_service("add", AddTwoInts, added)
        with pytest.raises(RegistrationRefused, match="this node provides service 'add' already"):
            await server.advertise_service("/add", AddTwoInts, added)
        with pytest.raises(ServiceUnavailable, match="service 'none': no node provides it"):
            await client.service_client("none", Trigger).call(TriggerRequest())
        with pytest.raises(TypeError, match=r"takes std_srvs\.TriggerRequest, not example\.Sen"):
            await client.service_client("x", Trigger).call(SensorData())  # type: ignore[arg-type]
        with pytest.raises(InvalidName):
            client.service_client("a b", Trigger)
        with pytest.raises(UnknownMessageType):
            client.service_client("x", "std_srvs.Nothing")
        with pytest.raises(ValueError, match="between 0 and 255"):
            client.service_client("x", Trigger, priority=256)
        with pytest.raises(ValueError, match="a timeout is 0 s or more, or None, not -1"):
            client.service_client("x", Trigger, timeout=-1)
        closed = client.service_client("add", AddTwoInts)
        await closed.close()
        with pytest.raises(HandleClosed):
            await closed.call(ask(1, 1))


async def test_any_two_messages_make_a_service(master: Master) -> None:
    kind = ServiceType(SensorData, TriggerResponse)
    assert kind.name == "example.SensorData -> std_srvs.TriggerResponse"
    async with nodes(master, "connected") as (server, client):
        await server.advertise_service(
            "odd",
            (SensorData, TriggerResponse),
            lambda m: TriggerResponse(message=str(m.sensor_id)),
        )
        caller = client.service_client("odd", ("example.SensorData", "std_srvs.TriggerResponse"))
        assert (await caller.call(SensorData(sensor_id=4))).message == "4"


async def test_the_graph_shows_services(master: Master) -> None:
    async with nodes(master, "local") as (server, client):
        first = await server.advertise_service("add", AddTwoInts, added)
        events = client.client.watch_graph()
        snapshot = await anext(events)
        expected = GraphService("add", "example_interfaces.AddTwoInts", "server")
        assert snapshot.services == (expected,)  # type: ignore[union-attr]
        await first.close()
        await server.advertise_service("flip", SetBool, lambda _: SetBool.response())
        await server.close()
        seen = []
        async for event in events:
            assert isinstance(event, GraphChange)
            seen.append((event.kind, event.key and event.key.topic))
            if event.kind is ChangeKind.NODE_REMOVED:
                break
        assert seen[:3] == [
            (ChangeKind.SERVICE_REMOVED, "add"),
            (ChangeKind.SERVICE_ADDED, "flip"),
            (ChangeKind.SERVICE_REMOVED, "flip"),
        ]


async def test_a_client_may_wait_for_the_service(master: Master) -> None:
    async with nodes(master, "connected") as (server, client):
        caller = client.service_client("add", AddTwoInts)
        with pytest.raises(TimeoutError):
            await caller.wait_for_service(0.05)
        waiting = asyncio.create_task(caller.wait_for_service(30))
        await server.advertise_service("add", AddTwoInts, added)
        await waiting
        assert (await caller.call(ask(2, 2))).sum == 4


async def test_services_with_a_fake_master() -> None:
    master = FakeMaster()
    async with NodeHandle("a", master=master) as a, NodeHandle("b", master=master) as b:
        caller = b.service_client("add", AddTwoInts)
        waiting = asyncio.create_task(caller.wait_for_service(30))
        await a.advertise_service("add", AddTwoInts, added)
        await waiting
        assert (await caller.call(ask(2, 3))).sum == 5
        with pytest.raises(ServiceUnavailable):
            await b.service_client("none", AddTwoInts).call(ask(1, 1))


async def test_a_cpp_master_knows_no_services() -> None:
    async with CppMaster() as cpp, NodeHandle("node", master=cpp.address) as node:
        with pytest.raises(ForeignMaster):
            await node.advertise_service("add", AddTwoInts, added)
        with pytest.raises(ForeignMaster):
            await node.service_client("add", AddTwoInts).call(ask(1, 1))


# -- faults ----------------------------------------------------------------------------------------


async def test_a_provider_killed_in_the_middle_of_a_call_answers_at_once(master: Master) -> None:
    async with NodeHandle("client", master=master.address) as client:
        caller = client.service_client("add", AddTwoInts)
        async with program(SERVER, master=master.address) as server:
            await caller.wait_for_service(30)
            assert await server.line() == "ready"
            calls = [asyncio.create_task(caller.call(ask(-1, 0))) for _ in range(3)]
            for _ in calls:
                assert await server.line() == "began"
            watch = Stopwatch()
            server.signal(signal.SIGKILL)
            for call in calls:
                with pytest.raises(ServiceUnavailable, match="node 'server' is gone"):
                    await call
            assert watch.seconds < 2
        with pytest.raises(ServiceUnavailable):
            await caller.call(ask(1, 1), timeout=30)
        await until(lambda: "server" not in {node.name for node in master.graph.snapshot().nodes})
        async with program(SERVER, master=master.address):
            await caller.wait_for_service(30)
            assert (await caller.call(ask(1, 1), timeout=30)).sum == 2


async def test_a_client_killed_in_the_middle_of_a_call_ends_its_handler(master: Master) -> None:
    text = """
        from simple_ros import aio
        from simple_ros.msg.example_interfaces import AddTwoInts, AddTwoIntsRequest

        async def main():
            async with aio.NodeHandle("client") as node:
                caller = node.service_client("add", AddTwoInts)
                await caller.call(AddTwoIntsRequest(a=-1))
        aio.run(main())
    """
    async with program(SERVER, master=master.address) as server:
        assert await server.line() == "ready"
        async with program(text, master=master.address) as client:
            assert await server.line() == "began"
            client.signal(signal.SIGKILL)
            assert await server.line() == "ended"


async def test_calls_go_on_without_a_master_and_services_come_back_with_it() -> None:
    async with master_process() as (process, address):
        port = int(address.rpartition(":")[2])
        async with (
            program(SERVER, master=address) as server,
            NodeHandle("client", master=address) as client,
        ):
            assert await server.line() == "ready"
            caller = client.service_client("add", AddTwoInts)
            assert (await caller.call(ask(1, 1))).sum == 2
            await process.kill()
            for number in range(20):
                assert (await caller.call(ask(number, 1))).sum == number + 1
            with pytest.raises((MasterUnavailable, ServiceUnavailable)):
                await client.service_client("other", AddTwoInts).call(ask(1, 1))
            async with master_process(port):
                fresh = client.service_client("add", AddTwoInts)
                await fresh.wait_for_service(30)
                assert (await fresh.call(ask(2, 2))).sum == 4


async def test_an_adaptive_timeout_follows_the_provider(master: Master) -> None:
    stalls = False

    async def sometimes(request: TriggerRequest) -> TriggerResponse:
        if stalls:
            await asyncio.Event().wait()
        return TriggerResponse()

    async with nodes(master, "connected") as (server, client):
        await server.advertise_service("t", Trigger, sometimes)
        # Never less than a process may stand still.
        policy = AdaptiveTimeout(min_s=1.0, initial_s=30)
        caller = client.service_client("t", Trigger, timeout=policy)
        for _ in range(50):
            await caller.call(TriggerRequest())
        short = caller.rtt.timeout_s(policy)
        assert short < 10
        stalls = True
        with pytest.raises(ServiceTimeout):
            await caller.call(TriggerRequest())
        assert caller.rtt.timeout_s(policy) == pytest.approx(2 * short)


async def test_garbage_on_a_service_connection_harms_nobody(master: Master) -> None:
    from simple_ros.wire.calls import CANCEL_TYPE, REQUEST_TYPE, pack_request
    from simple_ros.wire.framing import encode_frame, encode_header

    async with nodes(master, "connected") as (server, client):
        await server.advertise_service("add", AddTwoInts, added)
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        request = encode_header("add", REQUEST_TYPE)
        for data in (b"", b"short", pack_request(7, None, 0, b"\xff\xff\xff")):
            writer.write(encode_frame(request, data))
        writer.write(encode_frame(encode_header("add", CANCEL_TYPE), b"x"))
        writer.write(
            encode_frame(encode_header("nothing", REQUEST_TYPE), pack_request(8, 1, 0, b""))
        )
        refusals = await reader.readuntil(b"ServiceResponse")
        assert b"add" in refusals
        caller = client.service_client("add", AddTwoInts)
        assert (await caller.call(ask(1, 1))).sum == 2
        writer.close()
        await writer.wait_closed()


async def test_a_client_that_reads_no_answers_is_held_back(master: Master) -> None:
    """Its answers must not pile up in the provider's memory."""
    from simple_ros.wire.calls import REQUEST_TYPE, pack_request
    from simple_ros.wire.framing import encode_frame, encode_header

    async with nodes(master, "connected") as (server, client):
        provided = await server.advertise_service(
            "big", Trigger, lambda _: TriggerResponse(message="x" * 100_000)
        )
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        frame = encode_frame(encode_header("big", REQUEST_TYPE), pack_request(1, None, 0, b""))
        writer.write(frame * 20_000)
        await until(lambda: any(link._answers_wait for link in server._server.links))  # type: ignore[union-attr]
        held = provided.statistics.calls
        caller = client.service_client("big", Trigger)
        for _ in range(20):
            assert len((await caller.call(TriggerRequest())).message) == 100_000
        assert provided.statistics.calls == held + 20
        writer.close()
        with contextlib.suppress(ConnectionError):
            await writer.wait_closed()
        del reader
