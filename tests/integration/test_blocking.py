"""The blocking face: SystemManager, NodeHandle and what they make."""

from __future__ import annotations

import inspect
import logging
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future

import pytest
from support.processes import master_process, program
from support.waiting import LIMIT_S, Stopwatch, until

from simple_ros import aio
from simple_ros.blocking import ActionClient as BlockingActionClient
from simple_ros.blocking import ActionServer as BlockingActionServer
from simple_ros.blocking import BlockingNode
from simple_ros.blocking import ClientGoal as BlockingClientGoal
from simple_ros.blocking import Publisher as BlockingPublisher
from simple_ros.blocking import ServerGoal as BlockingServerGoal
from simple_ros.blocking import ServiceClient as BlockingServiceClient
from simple_ros.blocking import ServiceServer as BlockingServiceServer
from simple_ros.blocking import Subscriber as BlockingSubscriber
from simple_ros.blocking import Timer as BlockingTimer
from simple_ros.errors import (
    ConfigError,
    HandleClosed,
    NodeNameTaken,
    QueueFull,
    RemoteServiceError,
    ServiceTimeout,
    ServiceUnavailable,
    TopicTypeMismatch,
)
from simple_ros.events import IncompatibleQos, QosEvent
from simple_ros.message_queue import CallbackGroup
from simple_ros.msg.example import ControlCommand, SensorData
from simple_ros.msg.example_interfaces import AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse
from simple_ros.net.loop import BackgroundLoop
from simple_ros.qos import DEFAULT, SENSOR_DATA
from simple_ros.system_manager import NodeHandle, SystemManager
from simple_ros_master import Master


@pytest.fixture
def address() -> Iterator[str]:
    """A Master on a loop and thread of its own."""
    loop = BackgroundLoop()
    master = Master(host="127.0.0.1", port=0)
    loop.run(master.start())
    yield master.address
    loop.run(master.stop())
    loop.stop()


@pytest.fixture
def system(address: str) -> Iterator[SystemManager]:
    manager = SystemManager.instance()
    manager.init("blocking", master=address)
    yield manager
    manager.shutdown()


def spin_until(system: SystemManager, condition: object, limit: float = LIMIT_S) -> None:
    end = time.monotonic() + limit
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "not within the limit"
        system.spin_once(0.05)


@pytest.mark.parametrize(
    ("blocking", "asynchronous"),
    [
        (BlockingNode, aio.NodeHandle),
        (BlockingPublisher, aio.Publisher),
        (BlockingSubscriber, aio.Subscriber),
        (BlockingTimer, aio.Timer),
        (BlockingServiceServer, aio.ServiceServer),
        (BlockingServiceClient, aio.ServiceClient),
        (BlockingActionServer, aio.ActionServer),
        (BlockingActionClient, aio.ActionClient),
        (BlockingServerGoal, aio.ServerGoal),
        (BlockingClientGoal, aio.ClientGoal),
    ],
)
def test_both_faces_offer_the_same(blocking: type, asynchronous: type) -> None:
    """Every public method of a user's asyncio handle is in the blocking one, with its parameters."""
    internal = {
        *("start", "spin", "forget_publisher", "forget_subscriber", "forget_timer", "local_peer"),
        *(
            *("master_lost", "registering", "flush_allowance", "is_closed", "has_received"),
            *("close_sparing", "guard", "router", "is_waited_for", "room_made"),
            "node_info",
            "master_changed",
            "subscribers_known",
        ),
        *("failed", "wait_ended", "subscribe_batches", "targets", "targets_update", "reregistered"),
        *(
            "report",
            "abandon",
            "check_open",
            "check_type",
            "publish_async",
            "publish_bytes_async",
            "publish_batch",
        ),
        *(
            "take_batch",
            "take_payloads",
            "lone_taker",
            "room",
            "call_when_room",
            "sources_changed",
            "receive_within",
        ),
        *("dropped_messages", "provide", "forget_service", "providers", "lanes", "resolve_name"),
        *("give_up", "info", "take", "provider", "limit_s", "level", "serialised"),
        *("open", "finish", "end", "send_feedback", "listen", "fetch", "cancel_goal", "goal_ended"),
        *("heard", "sent", "accepted", "feedback_came", "take_feedback_by"),
        # Of advertise_action: a thread cannot be interrupted.
        "interrupt",
    }

    def public(cls: type) -> set[str]:
        return {name for name, _ in inspect.getmembers(cls) if not name.startswith("_")} - internal

    assert public(asynchronous) <= public(blocking)
    for name in public(asynchronous):
        theirs, ours = getattr(asynchronous, name), getattr(blocking, name)
        if inspect.isfunction(theirs) and name != "receive":
            expected = [p for p in inspect.signature(theirs).parameters if p not in internal]
            assert [p for p in inspect.signature(ours).parameters if p in expected] == expected


def test_callbacks_run_in_the_thread_that_spins_and_none_before(system: SystemManager) -> None:
    got: list[tuple[int, str]] = []
    node = NodeHandle()
    node.subscribe(
        "/sensor",
        SensorData,
        lambda m: got.append((m.sensor_id, threading.current_thread().name)),
    )
    publisher = node.advertise("sensor", SensorData)
    for i in range(5):
        publisher.publish(SensorData(sensor_id=i))
    publisher.flush(5)
    assert got == []
    spin_until(system, lambda: len(got) == 5)
    assert got == [(i, "MainThread") for i in range(5)]


def test_spin_once_handles_all_that_is_due_and_spin_wakes_on_arrival(
    system: SystemManager,
) -> None:
    node = NodeHandle()
    got: list[int] = []
    subscriber = node.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
    publisher = node.advertise("sensor", SensorData)
    for i in range(50):
        publisher.publish(SensorData(sensor_id=i))
    while subscriber.statistics.waiting < 50:
        time.sleep(0.001)
    assert system.spin_once() == 50
    assert system.spin_once() == 0
    begun = time.process_time()
    threading.Timer(0.3, lambda: publisher.publish(SensorData(sensor_id=7))).start()
    assert system.spin_once(5.0) == 1
    assert time.process_time() - begun < 0.1, "it slept"


def test_timers_run_in_the_spinning_thread(system: SystemManager) -> None:
    calls: list[str] = []
    timer = NodeHandle().create_timer(
        0.01, lambda event: calls.append(threading.current_thread().name)
    )
    once = NodeHandle().create_timer(0.001, lambda event: calls.append("once"), oneshot=True)
    spin_until(system, lambda: len(calls) >= 5)
    assert set(calls) == {"MainThread", "once"}
    assert calls.count("once") == 1
    assert not once.is_running
    timer.pause()
    count = len(calls)
    once.start()
    spin_until(system, lambda: calls.count("once") == 2)
    assert len(calls) == count + 1
    timer.resume()
    timer.period = 0.001
    spin_until(system, lambda: len(calls) > count + 3)
    timer.close()
    with pytest.raises(HandleClosed):
        timer.start()


def test_receive_and_iteration_without_callback(system: SystemManager) -> None:
    node = NodeHandle()
    subscriber = node.subscribe("sensor", SensorData)
    publisher = node.advertise("sensor", SensorData)
    with pytest.raises(TimeoutError):
        subscriber.receive(timeout=0.01)
    for i in range(3):
        publisher.publish(SensorData(sensor_id=i))
    assert subscriber.receive(timeout=30).sensor_id == 0
    found = []
    for message in subscriber:
        found.append(message.sensor_id)
        if len(found) == 2:
            subscriber.close()
    assert found == [1, 2]


def test_a_full_queue_drops_its_oldest(system: SystemManager) -> None:
    node = NodeHandle()
    got: list[int] = []
    subscriber = node.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id), qos=3)
    publisher = node.advertise("sensor", SensorData)
    for i in range(1, 6):
        publisher.publish(SensorData(sensor_id=i))
    while subscriber.statistics.received < 5:
        time.sleep(0.001)
    system.spin_once()
    assert got == [3, 4, 5]
    assert subscriber.statistics.dropped == 2


def test_errors_come_to_the_caller(system: SystemManager) -> None:
    node = NodeHandle()
    publisher = node.advertise("sensor", SensorData)
    with pytest.raises(TypeError, match="ControlCommand"):
        publisher.publish(ControlCommand())  # type: ignore[arg-type]
    with pytest.raises(TopicTypeMismatch):
        NodeHandle("other", master=system.get_poll_manager().master).subscribe(
            "sensor", ControlCommand, print
        )
    publisher.close()
    publisher.close()
    with pytest.raises(HandleClosed):
        publisher.publish(SensorData())


def test_a_callback_that_raises_or_takes_long_hurts_nobody(
    system: SystemManager, caplog: pytest.LogCaptureFixture
) -> None:
    """The network runs in a thread of its own: while a callback blocks, messages still arrive."""
    node = NodeHandle()
    got: list[int] = []
    arrived: list[int] = []

    def slow(message: SensorData) -> None:
        if message.sensor_id == 0:
            end = time.monotonic() + LIMIT_S
            while subscriber.statistics.received < 20 and time.monotonic() < end:
                time.sleep(0.001)
            arrived.append(subscriber.statistics.received)
            raise ZeroDivisionError("boom")
        got.append(message.sensor_id)

    subscriber = node.subscribe("sensor", SensorData, slow)
    publisher = node.advertise("sensor", SensorData)

    def publish() -> None:
        for i in range(20):
            publisher.publish(SensorData(sensor_id=i))

    threading.Thread(target=publish).start()
    spin_until(system, lambda: len(got) == 19)
    assert arrived == [20]
    assert subscriber.statistics.errors == 1
    assert "ZeroDivisionError: boom" in caplog.text


def test_block_waits_in_the_callers_thread_and_loses_nothing(system: SystemManager) -> None:
    node = NodeHandle()
    qos = DEFAULT.replace(depth=10, overflow="block")
    publisher = node.advertise("sensor", SensorData, qos=qos)
    other = NodeHandle("other", master=system.get_poll_manager().master)
    subscriber = other.subscribe("sensor", SensorData, qos=qos)
    sender = threading.Thread(
        target=lambda: [publisher.publish(SensorData(sensor_id=i)) for i in range(5000)]
    )
    sender.start()
    for i in range(5000):
        assert subscriber.receive(timeout=30).sensor_id == i
    sender.join(30)
    assert publisher.statistics.dropped == 0


def test_a_blocking_subscription_with_callback_loses_nothing(system: SystemManager) -> None:
    node = NodeHandle()
    qos = DEFAULT.replace(depth=10, overflow="block")
    other = NodeHandle("other", master=system.get_poll_manager().master)
    got: list[int] = []
    subscriber = other.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id), qos=qos)
    publisher = node.advertise("sensor", SensorData, qos=qos)
    sender = threading.Thread(
        target=lambda: [publisher.publish(SensorData(sensor_id=i)) for i in range(5000)]
    )
    sender.start()
    spin_until(system, lambda: len(got) == 5000)
    sender.join(30)
    assert got == list(range(5000))
    assert subscriber.statistics.dropped == publisher.statistics.dropped == 0


def test_several_threads_keep_exclusive_groups_apart(system: SystemManager) -> None:
    node = NodeHandle()
    exclusive, reentrant = CallbackGroup(), CallbackGroup(reentrant=True)
    running = {"exclusive": 0, "reentrant": 0}
    most = {"exclusive": 0, "reentrant": 0}
    lock = threading.Lock()
    # Nobody gets past it alone.
    meeting = threading.Barrier(2)
    handled = 0

    def work(kind: str) -> None:
        nonlocal handled
        with lock:
            running[kind] += 1
            most[kind] = max(most[kind], running[kind])
        if kind == "reentrant":
            meeting.wait(LIMIT_S)
        else:
            time.sleep(0.005)
        with lock:
            running[kind] -= 1
            handled += 1
            if handled == 30:
                system.get_message_queue()
                stopper.set()

    stopper = threading.Event()
    node.subscribe("a", SensorData, lambda m: work("exclusive"), group=exclusive)
    node.subscribe("b", SensorData, lambda m: work("exclusive"), group=exclusive)
    node.subscribe("c", SensorData, lambda m: work("reentrant"), group=reentrant)
    publishers = [node.advertise(topic, SensorData) for topic in "abc"]
    for publisher in publishers:
        for _ in range(10):
            publisher.publish(SensorData())

    def stop_when_done() -> None:
        stopper.wait(30)
        system.shutdown()

    threading.Thread(target=stop_when_done).start()
    system.spin(threads=4)
    assert handled == 30
    assert most["exclusive"] == 1
    assert most["reentrant"] > 1


def test_events_come_in_the_spinning_thread(system: SystemManager) -> None:
    events: list[tuple[QosEvent, str]] = []
    node = NodeHandle()
    node.advertise("sensor", SensorData, qos=SENSOR_DATA)
    node.subscribe(
        "sensor",
        SensorData,
        lambda m: None,
        on_event=lambda event: events.append((event, threading.current_thread().name)),
    )
    spin_until(system, lambda: events)
    event, thread = events[0]
    assert isinstance(event, IncompatibleQos)
    assert thread == "MainThread"


def test_getters_and_rpc_client(system: SystemManager) -> None:
    info = system.get_node_info()
    assert (info.node_name, info.ip) == ("blocking", "127.0.0.1")
    assert info.port == NodeHandle().port
    client = system.get_rpc_client()
    publisher = NodeHandle().advertise("/sensor", SensorData)
    (topic,) = client.get_topics("sens").topics
    assert (topic.topic_name, topic.msg_type) == (publisher.topic, publisher.msg_type)
    assert client.get_topic_info("sensor").publishers[0].node_name == "blocking"
    assert client.get_node_info("blocking").success
    assert not client.get_node_info("nobody").success
    assert [node.node_name for node in client.get_nodes().nodes] == ["blocking"]
    with pytest.raises(LookupError):
        client.get_topic_info("nothing")
    assert client.subscribe("x", "a.B", info).success
    assert client.unsubscribe("x", "a.B", info).success
    assert client.register_publisher("x", "a.B", info).success
    assert client.unregister_publisher("x", "a.B", info).success
    assert abs(system.now() - time.time()) < 1.0
    assert system.now() != int(system.now())
    with pytest.raises(ConfigError):
        system.get_message_queue().set_topic_max_queue_size("x", 0)


def test_init_again_after_shutdown(address: str) -> None:
    system = SystemManager.instance()
    assert SystemManager.instance() is system
    with pytest.raises(RuntimeError, match="init"):
        system.spin_once()
    for name in ("first", "second"):
        system.init(0, name, master=address)
        with pytest.raises(RuntimeError, match="before"):
            system.init("again", master=address)
        assert system.is_running
        assert NodeHandle().name == name
        system.shutdown()
        system.shutdown()
        assert not system.is_running


def test_a_node_without_a_name_gets_one(address: str) -> None:
    system = SystemManager.instance()
    system.init(master=address)
    assert system.get_node_info().node_name.startswith("node_")
    system.shutdown()


def test_a_lost_name_ends_the_spin(system: SystemManager, address: str) -> None:
    NodeHandle().wait_for_master(30)

    def take() -> None:
        loop = BackgroundLoop()
        thief = aio.NodeHandle("blocking", master=address)
        loop.run(_start(thief))
        thieves.append((loop, thief))

    thieves: list[tuple[BackgroundLoop, aio.NodeHandle]] = []
    thread = threading.Thread(target=take)
    thread.start()
    with pytest.raises(NodeNameTaken):
        system.spin()
    thread.join(30)
    for loop, thief in thieves:
        loop.run(thief.close())
        loop.stop()


async def _start(node: aio.NodeHandle) -> None:
    await node.start()
    await node.wait_for_master(30)


BLOCKING_TALKER = """
    import sys, time
    from simple_ros.system_manager import NodeHandle, SystemManager
    from simple_ros.msg.example import SensorData

    system = SystemManager.instance()
    system.init("talker")
    publisher = NodeHandle().advertise("sensor", SensorData)
    NodeHandle().create_timer(0.01, lambda event: publisher.publish(SensorData(sensor_id=1)))
    print("ready", flush=True)
    if sys.argv[1] == "spin":
        system.spin()
    else:
        while True:
            time.sleep(0.01)
"""


@pytest.mark.parametrize("how", ["spin", "own loop"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_signals_end_a_blocking_program_quietly(how: str, number: signal.Signals) -> None:
    async with master_process() as (_, address):
        async with program(BLOCKING_TALKER, how, master=address) as talker:
            assert await talker.line() == "ready"
            watch = Stopwatch()
            talker.signal(number)
            assert await talker.wait() == 0
            assert watch.seconds < 1.0
            assert await talker.errors() == ""
        async with aio.MasterClient(address) as client:
            # A Master that stood still hears of the end after the process has ended.
            while await client.get_nodes():
                pass


async def test_a_callback_that_takes_long_delays_neither_lease_nor_links() -> None:
    text = """
        import signal
        from simple_ros.qos import LATCHED
        from simple_ros.system_manager import NodeHandle, SystemManager
        from simple_ros.msg.example import SensorData
        told = {signal.SIGUSR1}
        signal.pthread_sigmask(signal.SIG_BLOCK, told)

        def takes_long(event):
            print("blocked", flush=True)
            signal.sigwait(told)

        system = SystemManager.instance()
        system.init("slow")
        node = NodeHandle()
        # Latched: who subscribes may not be linked yet when it is published.
        echo = node.advertise("echo", SensorData, qos=LATCHED)
        node.create_timer(0.001, takes_long, oneshot=True)
        node.subscribe("sensor", SensorData, echo.publish)
        print("ready", flush=True)
        system.spin()
    """
    got: list[int] = []
    async with master_process() as (_, address), program(text, master=address) as slow:
        async with aio.NodeHandle("fast", master=address) as node:
            assert await slow.line() == "ready"
            assert await slow.line() == "blocked"
            publisher = await node.advertise("sensor", SensorData)
            await publisher.wait_for_subscribers(1, timeout=30)
            await node.subscribe("echo", SensorData, lambda m: got.append(m.sensor_id))
            publisher.publish(SensorData(sensor_id=1))
            assert {n.node_name for n in await node.client.get_nodes()} == {"slow", "fast"}
            assert got == []
            slow.signal(signal.SIGUSR1)
            await until(lambda: got == [1])


def test_publishing_faster_than_the_network_is_held_not_lost_uncounted(
    system: SystemManager, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    publisher = NodeHandle().advertise("sensor", SensorData)
    subscriber = NodeHandle().subscribe("sensor", SensorData, lambda m: None)
    for i in range(20_000):
        publisher.publish(SensorData(sensor_id=i))
    publisher.flush(10)
    statistics = publisher.statistics
    assert statistics.published == 20_000
    assert statistics.sent + statistics.dropped == 20_000
    while subscriber.statistics.received < statistics.sent:
        time.sleep(0.001)
    assert QueueFull.__name__ not in caplog.text


def test_services_are_answered_in_the_thread_that_spins(system: SystemManager) -> None:
    threads: list[int] = []
    server, client = NodeHandle(), NodeHandle("caller", master=system.get_poll_manager().master)

    def add(request: AddTwoIntsRequest) -> AddTwoIntsResponse:
        threads.append(threading.get_ident())
        if request.a < 0:
            raise ValueError("too small")
        return AddTwoIntsResponse(sum=request.a + request.b)

    provided = server.advertise_service("add", AddTwoInts, add)
    caller = client.service_client("add", AddTwoInts, timeout=30)
    caller.wait_for_service(30)
    done: list[Future[AddTwoIntsResponse]] = []
    futures = [
        caller.call_async(AddTwoIntsRequest(a=i, b=1), callback=done.append) for i in range(5)
    ]
    failed = caller.call_async(AddTwoIntsRequest(a=-1))
    spin_until(system, lambda: len(done) == 5 and failed.done())
    assert [future.result().sum for future in futures] == [1, 2, 3, 4, 5]
    assert set(threads) == {threading.get_ident()}
    with pytest.raises(RemoteServiceError, match="ValueError: too small"):
        failed.result()
    spinning = threading.Thread(target=system.spin)
    spinning.start()
    assert caller.call(AddTwoIntsRequest(a=20, b=3)).sum == 23
    provided.close()
    with pytest.raises(ServiceUnavailable):
        caller.call(AddTwoIntsRequest())
    system.shutdown()
    spinning.join(30)


def test_a_call_that_would_wait_for_itself_is_told(system: SystemManager) -> None:
    node = NodeHandle()
    node.advertise_service("add", AddTwoInts, lambda request: AddTwoIntsResponse())
    caller = node.service_client("add", AddTwoInts)
    problems: list[str] = []

    def on_timer(event: object) -> None:
        try:
            caller.call(AddTwoIntsRequest())
        except RuntimeError as error:
            problems.append(str(error))

    node.create_timer(0.01, on_timer, oneshot=True)
    spin_until(system, lambda: problems)
    assert "the only thread that could answer is the one that asks" in problems[0]


def test_direct_calls_time_out_lose_their_provider_and_find_the_next(
    system: SystemManager, address: str
) -> None:
    text = """
        import asyncio
        from simple_ros import aio
        from simple_ros.msg.example_interfaces import AddTwoInts, AddTwoIntsResponse

        async def add(request):
            if request.a < 0:
                print("asked", request.b, flush=True)
                await asyncio.Event().wait()
            return AddTwoIntsResponse(sum=request.a + request.b)

        async def main():
            async with aio.NodeHandle("server") as node:
                await node.advertise_service("add", AddTwoInts, add)
                print("ready", flush=True)
                await node.spin()
        aio.run(main())
    """
    caller = NodeHandle().service_client("add", AddTwoInts)
    loop = BackgroundLoop()

    def served() -> object:
        manager = program(text, master=address)
        process = loop.run(manager.__aenter__())
        assert loop.run(process.line(), 30) == "ready"
        return manager, process

    manager, process = served()
    assert caller.call(AddTwoIntsRequest(a=1, b=2)).sum == 3
    with pytest.raises(ServiceTimeout):
        caller.call(AddTwoIntsRequest(a=-1), timeout=0.05)
    assert [caller.call(AddTwoIntsRequest(a=i), timeout=30).sum for i in range(20)] == list(
        range(20)
    )

    def kill_when_asked() -> None:
        while loop.run(process.line(), 30) != "asked 7":
            pass
        process.signal(signal.SIGKILL)

    killer = threading.Thread(target=kill_when_asked)
    killer.start()
    with pytest.raises(ServiceUnavailable, match="is gone"):
        caller.call(AddTwoIntsRequest(a=-1, b=7), timeout=30)
    killer.join()
    loop.run(manager.__aexit__(None, None, None))
    manager, process = served()
    caller.wait_for_service(30)
    threads = [
        threading.Thread(target=lambda: sums.append(caller.call(AddTwoIntsRequest(a=1, b=1)).sum))
        for _ in range(8)
    ]
    sums: list[int] = []
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert sums == [2] * 8
    caller.close()
    with pytest.raises(HandleClosed):
        caller.call(AddTwoIntsRequest())
    loop.run(manager.__aexit__(None, None, None))
    loop.stop()
