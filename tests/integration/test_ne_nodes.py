from __future__ import annotations

import asyncio
import json
import signal
import socket
import ssl
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from support.certificates import made_in, server_tls
from support.cli import run, run_json
from support.engines import at_work, user
from support.openapi import Recorder
from support.processes import program
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.engine import Engine, engine_named
from simple_ros.errors import ConfigError
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.network_exposure_msgs import (
    FlowQos,
    FlowQosArray,
    Locator,
    QosAdvice,
    QosNotification,
    Serialized,
    Throttle,
    TunnelSelect,
    UniqueTopicFlow,
    UniqueTopicFlows,
    UniqueTopicFlowStats,
)
from simple_ros.msg.std_msgs import String
from simple_ros.qos import Durability, QosProfile, Reliability
from simple_ros_engines.network_exposure import watcher_settings
from simple_ros_engines.network_exposure.exposure.http import StandardTransport, client_tls
from simple_ros_engines.network_exposure.mock.core import MockSettings
from simple_ros_engines.network_exposure.mock.server import MockServer
from simple_ros_engines.network_exposure.qci import QCI
from simple_ros_engines.network_exposure.relay import FLOWS_TOPIC, STATS_TOPIC, FlowRelay
from simple_ros_engines.network_exposure.topic_watcher import TopicWatcher
from simple_ros_master import Master


@asynccontextmanager
async def user_named(name: str, master: Master) -> AsyncIterator[NodeHandle]:
    async with NodeHandle(name, master=master.address, arguments=Arguments()) as node:
        yield node


class Listener:
    """What relays and watchers say."""

    def __init__(self) -> None:
        self.flows: dict[str, UniqueTopicFlows] = {}
        self.changes: list[UniqueTopicFlow] = []
        self.stats: dict[str, Any] = {}
        self.tunnel_stats: dict[str, Any] = {}
        self.states: list[FlowQosArray] = []
        self.told: list[QosNotification] = []

    async def start(self, node: NodeHandle) -> None:
        await node.subscribe(FLOWS_TOPIC, UniqueTopicFlows, self._flows)
        await node.subscribe(STATS_TOPIC, UniqueTopicFlowStats, self._stats)
        await node.subscribe("/network_flow_state", FlowQosArray, self.states.append)
        await node.subscribe("/qos_notifications", QosNotification, self.told.append)

    def _flows(self, message: UniqueTopicFlows) -> None:
        self.flows[message.relay] = message
        self.changes += message.changed

    def _stats(self, message: UniqueTopicFlowStats) -> None:
        self.stats |= {stat.topic: stat for stat in message.stats}
        self.tunnel_stats |= {stat.topic: stat for stat in message.tunnel_stats}

    def of(self, topic: str) -> list[UniqueTopicFlow]:
        return [flow for told in self.flows.values() for flow in told.flows if flow.topic == topic]

    def state(self, topic: str = "cmd_vel") -> FlowQos:
        flows = self.states[-1].flows if self.states else ()
        return next((flow for flow in flows if flow.topic == topic), FlowQos())


@asynccontextmanager
async def listener(master: Master) -> AsyncIterator[tuple[NodeHandle, Listener]]:
    async with user(master) as node:
        told = Listener()
        await told.start(node)
        yield node, told


async def refused(engine: Engine, master: Master, parameters: dict[str, Any]) -> None:
    """An engine does not start with parameters that make no sense."""
    async with NodeHandle(engine.node_name, master=master.address, arguments=Arguments()) as node:
        await node.set_parameters({f"~{name}": value for name, value in parameters.items()})
        with pytest.raises(ConfigError):
            async with asyncio.timeout(30):
                await engine.run(node)


class TestRelay:
    async def test_a_topic_has_a_flow_of_its_own(self, master: Master) -> None:
        got: list[Twist] = []
        async with (
            listener(master) as (node, told),
            at_work(FlowRelay(), master, stats_period_s=0.05),
        ):
            best = QosProfile(reliability=Reliability.BEST_EFFORT, lifespan_s=30)
            publisher = await node.advertise("cmd_vel_qos", Twist, qos=best)
            await node.subscribe("cmd_vel", Twist, got.append, qos=best)
            await until(lambda: told.of("cmd_vel") and told.of("cmd_vel")[0].subscriber)
            (flow,) = told.of("cmd_vel")
            assert flow.source.kind == flow.destination.kind == Locator.TCPV4
            assert (flow.source.address, flow.destination.port) == ("127.0.0.1", node.port)
            assert (flow.subscriber, flow.source_topic) == (node.name, "cmd_vel_qos")
            assert flow.msg_type == "geometry_msgs.Twist"
            assert (flow.is_reliable, flow.lifespan_ms) == (False, 30_000)
            await until(lambda: publisher.subscriber_count)
            for n in range(5):
                publisher.publish(Twist(linear={"x": n}))
            await until(lambda: len(got) == 5)
            assert [message.linear.x for message in got] == [0, 1, 2, 3, 4]
            await until(
                lambda: told.stats.get("cmd_vel") and told.stats["cmd_vel"].num_messages == 5
            )

    async def test_late_listeners_are_told_and_ends_are(self, master: Master) -> None:
        async with user(master) as app, at_work(FlowRelay(), master):
            await app.advertise("cmd_vel_qos", Twist)
            subscriber = await app.subscribe("cmd_vel", Twist, lambda message: None)
            other = await app.subscribe("pose", Twist, lambda message: None)
            told = Listener()
            async with NodeHandle("late", master=master.address) as late:
                await told.start(late)
                await until(lambda: told.of("cmd_vel"))
                await subscriber.close()
                await until(lambda: not told.of("cmd_vel"))
                events = [flow.event_type for flow in told.changes if flow.topic == "cmd_vel"]
                assert events[-1] == UniqueTopicFlow.REMOVED
            await other.close()

    async def test_types_nobody_here_knows(self, master: Master) -> None:
        from simple_ros_engines.network_exposure.raw import raw_class

        unknown = raw_class("strange.Thing")
        got: list[Any] = []
        async with user(master) as node, at_work(FlowRelay(), master):
            publisher = await node.advertise("thing_qos", unknown)
            await node.subscribe("thing", "strange.Thing", got.append, raw=True)
            await until(lambda: publisher.subscriber_count)
            large = bytes(range(256)) * 1000
            await until(lambda: (publisher.publish(unknown(large)), got)[1])
            assert got[0] == large

    async def test_marks_and_budgets(self, master: Master) -> None:
        relay = FlowRelay()
        settings = {"dscp": ["/cmd_vel=46"], "latency_budgets": ["cmd_vel=80"]}
        async with listener(master) as (node, told), at_work(relay, master, **settings):
            await node.advertise("cmd_vel_qos", Twist)
            await node.subscribe("cmd_vel", Twist, lambda message: None)
            await until(lambda: told.of("cmd_vel"))
            (flow,) = told.of("cmd_vel")
            assert (flow.dscp, flow.latency_budget_ms) == (46, 80)
            (topic,) = relay.relayed.values()
            (way,) = topic._ways
            assert (way.marks.check().marked, way.marks.check().connections) == (1, 1)

    async def test_throttle(self, master: Master) -> None:
        got: list[str] = []
        async with (
            listener(master) as (node, told),
            at_work(FlowRelay(), master, stats_period_s=0.05),
        ):
            publisher = await node.advertise("text_qos", String)
            throttle = await node.advertise("/throttle", Throttle)
            await node.subscribe("text", String, lambda message: got.append(message.data))
            await until(lambda: told.of("text") and throttle.subscriber_count)
            await until(lambda: publisher.subscriber_count)
            throttle.publish(Throttle(topic="/text", drop_every_nth=2, message_delay=1))
            await until(lambda: told.stats.get("text") and told.stats["text"].drop_every_nth == 2)
            for n in range(6):
                publisher.publish(String(data=str(n)))
            await until(
                lambda: told.stats["text"].throttled == 3 and told.stats["text"].delayed == 1
            )
            await until(lambda: len(got) >= 2)
            assert got == ["0", "2"]
            throttle.publish(Throttle(topic="text", drop_every_nth=0))
            await until(lambda: got == ["0", "2", "4"])
            throttle.publish(Throttle(topic="text", delay_ms=1e9))
            throttle.publish(Throttle(topic="text", delay_ms=40))
            await until(lambda: told.stats["text"].delay_ms == 40)
            publisher.publish(String(data="late"))
            await until(lambda: got[-1] == "late")

    async def test_a_throttle_ends_with_who_asked_for_it(self, master: Master) -> None:
        relay = FlowRelay()
        async with (
            listener(master) as (node, told),
            at_work(relay, master, stats_period_s=0.05, throttle_valid_s=1.5),
        ):
            got: list[str] = []
            publisher = await node.advertise("text_qos", String)
            await node.subscribe("text", String, lambda message: got.append(message.data))
            async with throttler(master) as process:
                await until(lambda: told.stats.get("text") and told.stats["text"].delayed)
                process.send_signal(signal.SIGKILL)
                await process.wait()
            publisher.publish(String(data="held, then sent"))
            await until(lambda: told.stats["text"].delay_ms == 0)
            await until(lambda: "held, then sent" in got)
            throttle = await node.advertise("/throttle", Throttle)
            await throttle.wait_for_subscribers(1, 30)
            # Its sender's own time goes before the relay's.
            throttle.publish(Throttle(topic="text", drop_every_nth=1, valid_s=3600))
            (topic,) = relay.relayed.values()
            loop = asyncio.get_running_loop()
            await until(lambda: (topic.throttle.ends_s or 0) > loop.time() + 3000)
            throttle.publish(Throttle(topic="text", drop_every_nth=7, valid_s=-1))
            throttle.publish(Throttle(topic="text", drop_every_nth=3))
            await until(lambda: topic.throttle.settings.drop_every_nth == 3)
            await until(lambda: topic.throttle.settings.drop_every_nth == 0)

    async def test_what_a_later_publisher_offers_counts(self, master: Master) -> None:
        got: list[str] = []
        anything = QosProfile(reliability=Reliability.BEST_EFFORT)
        async with (
            listener(master) as (node, told),
            user_named("second", master) as second,
            at_work(FlowRelay(), master),
        ):
            first = await node.advertise("text_qos", String, qos=QosProfile(liveliness_lease_s=5))
            await node.subscribe(
                "text", String, lambda message: got.append(message.data), qos=anything
            )
            await until(lambda: told.of("text") and told.of("text")[0].subscriber)
            await first.wait_for_subscribers(1, 30)
            (before,) = told.of("text")
            assert (before.is_reliable, before.lease_ms) == (True, 5000)
            # Only what the network is asked for: connections stay.
            longer = await second.advertise(
                "text_qos", String, qos=QosProfile(liveliness_lease_s=9)
            )
            await until(lambda: [flow.lease_ms for flow in told.of("text")] == [9000])
            assert told.of("text")[0].source == before.source
            await longer.close()
            await until(lambda: [flow.lease_ms for flow in told.of("text")] == [5000])
            # What is promised to subscribers: connections are made anew, and nothing is lost.
            sent: list[str] = []

            def send(_: object) -> None:
                sent.append(str(len(sent)))
                first.publish(String(data=sent[-1]))

            sending = node.create_timer(0.005, send)
            await until(lambda: len(got) > 20)
            await second.advertise("text_qos", String, qos=anything)
            await until(lambda: [flow.is_reliable for flow in told.of("text")] == [False])
            await until(lambda: told.of("text")[0].source.port != before.source.port)
            far = len(sent) + 20
            await until(lambda: len(sent) > far)
            sending.stop()
            await until(lambda: got and got[-1] == sent[-1])
            assert got == sent

    async def test_latched_messages_survive_another_offer(self, master: Master) -> None:
        got: list[str] = []
        latched = QosProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
        async with (
            listener(master) as (node, told),
            user_named("second", master) as second,
            at_work(FlowRelay(), master),
        ):
            first = await node.advertise("text_qos", String, qos=latched)
            first.publish(String(data="kept"))
            await node.subscribe("text", String, lambda message: None, qos=latched)
            await until(lambda: told.of("text"))
            (before,) = told.of("text")
            await second.advertise("text_qos", String, qos=latched.replace(depth=2))
            await until(lambda: [f.source for f in told.of("text")] not in ([], [before.source]))
            await second.subscribe("text", String, lambda m: got.append(m.data), qos=latched)
            await until(lambda: got == ["kept"])

    async def test_two_relays(self, master: Master, caplog: pytest.LogCaptureFixture) -> None:
        """At once, and one after the other: one of them hands on what it can, the other stands by."""
        got: list[str] = []
        relays = [FlowRelay(), FlowRelay()]

        def taken() -> list[list[str]]:
            return [
                sorted([*(want.source for want in relay.relayed), *relay.ends]) for relay in relays
            ]

        everything = ["more", "more_qos_out", "text_qos"]
        async with user(master) as node, at_work(relays[1], master, name="relay_b"):
            async with at_work(relays[0], master, name="relay_a"):
                publisher = await node.advertise("text_qos", String)
                await node.advertise("more_qos_out", String)
                await node.subscribe("more_qos_in", String, lambda message: None)
                await node.subscribe("text", String, lambda message: got.append(message.data))
                # Each topic is taken up once, by whichever of them.
                await until(lambda: sorted(taken()[0] + taken()[1]) == everything)
                await until(lambda: "already" in caplog.text)
                await publisher.wait_for_subscribers(1, 30)
                await until(lambda: (publisher.publish(String(data="x")), got)[1])
                publisher.publish(String(data="once"))
                await until(lambda: "once" in got)
                assert got.count("once") == 1
            await until(lambda: taken()[1] == everything)
            await until(lambda: (publisher.publish(String(data="y")), "y" in got)[1])

    async def test_does_not_publish_what_others_publish(
        self, master: Master, caplog: pytest.LogCaptureFixture
    ) -> None:
        relay = FlowRelay()
        async with user(master) as node:
            await node.advertise("pose", Twist)
            async with at_work(relay, master):
                await node.advertise("pose_qos", Twist)
                await until(lambda: "published by user already" in caplog.text)
                assert not relay.relayed

    async def test_parameters_that_make_no_sense(self, master: Master) -> None:
        for wrong in ({"roles": ["up"]}, {"tag": "_qos_in"}, {"dscp": ["pose"]}):
            await refused(FlowRelay(), master, wrong)


class TestTunnel:
    @pytest.mark.parametrize("reorder", ["drop_late", "hold"])
    async def test_end_to_end(self, master: Master, reorder: str) -> None:
        got: list[str] = []
        start, end = FlowRelay(), FlowRelay()
        async with (
            listener(master) as (node, told),
            at_work(start, master, name="start", roles=["out"], stats_period_s=0.05, qcis=[8, 84]),
            at_work(end, master, name="end", roles=["in"], stats_period_s=0.05, reorder=reorder),
        ):
            publisher = await node.advertise("text_qos_out", String)
            select = await node.advertise("/tunnel_select", TunnelSelect)
            throttle = await node.advertise("/throttle", Throttle)
            await node.subscribe("text_qos_in", String, lambda message: got.append(message.data))
            await until(lambda: told.of("text_QCI_8") and told.of("text_QCI_84"))
            assert {flow.tunnel_qci for flow in told.flows["start"].flows} == {8, 84}
            assert told.of("text_QCI_84")[0].dscp == 18
            await until(lambda: select.subscriber_count >= 2 and throttle.subscriber_count >= 2)
            await until(lambda: publisher.subscriber_count)
            for n in range(10):
                publisher.publish(String(data=str(n)))
            await until(lambda: len(got) == 10)
            select.publish(TunnelSelect(topic="/text_qos_in", qci=84))
            throttle.publish(Throttle(topic="text", drop_every_nth=2))
            (topic,) = start.relayed.values()
            await until(lambda: topic._chosen == 1 and topic.throttle.settings.drop_every_nth)
            for n in range(10, 20):
                publisher.publish(String(data=str(n)))
            expected = [*map(str, range(10)), *map(str, range(10, 20, 2))]
            await until(lambda: got == expected)
            publisher.publish(String(data="last"))
            await until(lambda: got[-1] == "last")

            def seen() -> Any:
                return told.tunnel_stats.get("text_qos_in")

            await until(lambda: seen() and seen().received == 16)
            assert (seen().lost, seen().throttled, seen().qci) == (0, 5, 84)
            assert 0 < seen().measured_latency < 5
            assert seen().throttle_rate > 0
            assert seen().measured_droprate == 0

    async def test_strangers_in_the_tunnel_are_left_out(self, master: Master) -> None:
        got: list[String] = []
        relay = FlowRelay()
        async with user(master) as node, at_work(relay, master):
            tunnel = await node.advertise("text_qos_tunnel", Serialized)
            await node.subscribe("text_qos_in", String, got.append)
            await until(lambda: tunnel.subscriber_count)

            def send(number: int, msg_type: str) -> None:
                data = String(data=str(number)).SerializeToString()
                tunnel.publish(
                    Serialized(
                        message_type=msg_type, msg_num=number, session=1, serialized_msg=data
                    )
                )

            for number, kind in enumerate(["", "no type!", "std_msgs.String", "std_msgs.Bool"]):
                send(number, kind)
            send(4, "std_msgs.String")
            await until(lambda: len(got) == 2)
            assert [message.data for message in got] == ["2", "4"]
            assert relay.ends["text"].malformed == 3

    async def test_one_relay_plays_both_ends(self, master: Master) -> None:
        got: list[Twist] = []
        async with user(master) as node, at_work(FlowRelay(), master):
            publisher = await node.advertise("cmd_qos_out", Twist)
            await node.subscribe("cmd_qos_in", Twist, got.append)
            await until(lambda: (publisher.publish(Twist()), got)[1])


@asynccontextmanager
async def system(
    master: Master, mock: MockServer, rate_hz: float = 50.0, **parameters: Any
) -> AsyncIterator[tuple[Listener, list[Twist], TopicWatcher]]:
    """An application with a tagged topic, a relay and a watcher that asks a mock network."""
    got: list[Twist] = []
    watcher = TopicWatcher()
    quick = {"url": mock.url, "min_window_s": 0.2, "dwell_s": 0.2, "retry_s": 0.1}
    async with listener(master) as (node, told), at_work(FlowRelay(), master, stats_period_s=0.05):
        publisher = await node.advertise("cmd_vel_qos", Twist)
        await node.subscribe("cmd_vel", Twist, got.append)
        node.create_timer(1 / rate_hz, lambda _: publisher.publish(Twist(linear={"x": 1})))
        async with at_work(watcher, master, **quick | parameters):
            yield told, got, watcher


@asynccontextmanager
async def throttler(master: Master) -> AsyncIterator[asyncio.subprocess.Process]:
    """Says again and again that each message is to be held back for a minute, and publishes some."""
    text = """
        import asyncio
        from simple_ros.aio import NodeHandle
        from simple_ros.msg.network_exposure_msgs import Throttle
        from simple_ros.msg.std_msgs import String

        async def main():
            async with NodeHandle("throttler") as node:
                publisher = await node.advertise("/throttle", Throttle)
                texts = await node.advertise("text_qos", String)
                await publisher.wait_for_subscribers(1)
                await texts.wait_for_subscribers(1)
                while True:
                    publisher.publish(Throttle(topic="text", delay_ms=60_000))
                    await asyncio.sleep(0.1)
                    texts.publish(String(data="held"))

        asyncio.run(main())
    """
    async with program(text, master=master.address) as process:
        yield process.process


def is_steady(told: Listener) -> bool:
    """A bit rate is reserved: on a busy machine timers may make the rate unsteady at first."""
    return told.state().state == "active" and told.state().qci == 85


async def has_come(told: Listener, event: QosNotification.Event.ValueType) -> None:
    """Notifications and states are told on topics of their own."""
    await until(lambda: any(item.event == event for item in told.told))


async def flows_on(got: list[Twist]) -> None:
    """The topic flows, whatever else does not."""
    before = len(got)
    await until(lambda: len(got) > before + 5)


@pytest.fixture
async def judged(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[None]:
    """All that watchers say to the network, and its answers, by the official files where they are."""
    recorders: list[Recorder] = []

    def recording(tls: ssl.SSLContext | None = None) -> Recorder:
        recorders.append(Recorder(StandardTransport(tls)))
        return recorders[-1]

    monkeypatch.setattr(watcher_settings, "StandardTransport", recording)
    yield
    assert recorders
    for recorder in recorders:
        assert recorder.exchanges
        assert await asyncio.to_thread(recorder.complaints) == []


class TestWatcher:
    @pytest.mark.usefixtures("judged")
    @pytest.mark.parametrize("backend", ["seal", "nef", "camara"])
    async def test_asks_watches_and_releases(self, master: Master, backend: str) -> None:
        async with MockServer(MockSettings(setup_s=0.05)) as mock:
            async with system(master, mock, backend=backend, gpsi="extid-r1@example.com") as (
                told,
                got,
                _,
            ):
                await until(lambda: is_steady(told))
                state = told.state()
                assert (state.is_gbr, state.is_unmet) == (True, False)
                said = [text for one in told.states for flow in one.flows for text in flow.warnings]
                assert any("2000 ms" in text for text in said)
                assert told.states[-1].is_simulated
                assert told.states[-1].backend == backend
                await until(lambda: len(mock.network.bearers) == 1)
                (bearer,) = mock.network.bearers.values()
                assert str(state.source.port) in bearer.flow
                assert [group["members"] for group in mock.seal.groups.values()] == (
                    [[{"valUeId": "r1@example.com"}]] if backend == "seal" else []
                )
                if backend == "seal":
                    # Group, adaptation and monitoring: all three of SEAL, and what is measured is told.
                    await until(lambda: mock.seal.monitors)
                    await until(lambda: any(item.measurements["ul_delay_ms"] for item in told.told))
                await until(lambda: any(flow.dscp == 18 for flow in told.of("cmd_vel")))
                await flows_on(got)
            assert not mock.network.bearers
            assert not mock.seal.groups

    @pytest.mark.usefixtures("judged")
    @pytest.mark.parametrize("backend", ["seal", "nef"])
    async def test_downgrade_and_recovery(self, master: Master, backend: str) -> None:
        async with MockServer(MockSettings(setup_s=0.0)) as mock:
            async with system(master, mock, backend=backend) as (told, got, _):
                await until(lambda: is_steady(told))
                await until(lambda: backend == "nef" or mock.seal.monitors)
                mock.control({"capacity_bps": 0})
                await until(lambda: told.state().state == "degraded")
                await has_come(told, QosNotification.DOWNGRADED)
                mock.control({"capacity_bps": 1e8})
                await until(lambda: told.state().state == "active")
                assert told.told[-1].topic == "cmd_vel"
                await flows_on(got)

    async def test_the_smallest_window_is_enough(self, master: Master) -> None:
        """A relay that measures over 2 s, and a watcher that wants 2 s, with nothing else set."""
        async with MockServer(MockSettings(setup_s=0.0)) as mock:
            async with (
                listener(master) as (node, told),
                at_work(FlowRelay(), master, window_s=2.0),
                at_work(TopicWatcher(), master, url=mock.url),
            ):
                publisher = await node.advertise("cmd_vel_qos", Twist)
                await node.subscribe("cmd_vel", Twist, lambda message: None)
                node.create_timer(0.05, lambda _: publisher.publish(Twist()))
                await until(lambda: told.state().state == "active")
                await until(lambda: told.stats["cmd_vel"].window_duration_s == 2)
                assert list(told.state().warnings) == []

    @pytest.mark.usefixtures("judged")
    async def test_asks_anew_when_the_rate_changes(self, master: Master) -> None:
        async with MockServer(MockSettings(setup_s=0.0)) as mock:
            async with (
                listener(master) as (node, told),
                at_work(FlowRelay(), master, stats_period_s=0.05, window_s=2.0),
            ):
                publisher = await node.advertise("cmd_vel_qos", Twist)
                await node.subscribe("cmd_vel", Twist, lambda message: None)
                fast = node.create_timer(0.02, lambda _: publisher.publish(Twist()))
                quick = {"url": mock.url, "min_window_s": 0.2, "dwell_s": 0.1}
                async with at_work(TopicWatcher(), master, **quick):
                    await until(lambda: told.state().state == "active")
                    first = told.state()
                    fast.stop()
                    node.create_timer(0.2, lambda _: publisher.publish(Twist()))
                    await until(lambda: told.state().requests > 1 and told.state().qci != first.qci)
                    await until(lambda: len(mock.network.bearers) == 1)

    @pytest.mark.parametrize(
        "faults",
        [
            {"is_down": True},
            {"delay_s": 3.0},
            {"status": 401},
            {"status": 429},
            {"status": 500},
            {"malformed": True},
        ],
        ids=str,
    )
    async def test_topics_flow_whatever_the_network_does(
        self, master: Master, faults: dict[str, Any]
    ) -> None:
        async with MockServer(MockSettings(setup_s=0.0)) as mock:
            mock.control(faults)
            async with system(master, mock, timeout_s=0.7) as (told, got, _):
                await until(lambda: told.state().state == "failed", limit=60)
                assert told.state().detail
                await flows_on(got)
                mock.control({name: type(value)(0) for name, value in faults.items()})
                await until(lambda: told.state().state == "active", limit=60)

    async def test_advice_goes_first_in_mode_ai(self, master: Master) -> None:
        async with MockServer(MockSettings(setup_s=0.0)) as mock:
            async with (
                system(master, mock, mode="ai") as (told, got, _),
                user_named("policy", master) as policy,
            ):
                await until(lambda: is_steady(told))
                advice = await policy.advertise("/qos_advice", QosAdvice)
                await advice.wait_for_subscribers(1, 30)
                advice.publish(QosAdvice(topic="/cmd_vel", latency_budget_ms=100, error_rate=1e-2))
                await until(lambda: told.state().qci == 1 and told.state().state == "active")
                assert list(told.state().alternatives) == [75, 3, 84]
                assert told.states[-1].mode == "ai"
                await flows_on(got)

    @pytest.mark.usefixtures("judged")
    async def test_tunnels_are_asked_for_and_steered(self, master: Master) -> None:
        got: list[String] = []
        async with MockServer(MockSettings(setup_s=0.0)) as mock:
            async with (
                listener(master) as (node, told),
                at_work(FlowRelay(), master, stats_period_s=0.05, qcis=[9, 85]),
                at_work(TopicWatcher(), master, url=mock.url, min_window_s=0.2, dwell_s=0.1),
            ):
                publisher = await node.advertise("text_qos_out", String)
                await node.subscribe("text_qos_in", String, got.append)
                node.create_timer(0.02, lambda _: publisher.publish(String(data="x")))
                await until(
                    lambda: (
                        {bearer.wanted.qci for bearer in mock.network.bearers.values()} == {9, 85}
                    )
                )
                await until(
                    lambda: (
                        told.tunnel_stats.get("text_qos_in")
                        and told.tunnel_stats["text_qos_in"].qci == 85
                    )
                )
                await until(
                    lambda: all(told.state(f"text_QCI_{qci}").requests == 1 for qci in (9, 85))
                )

    async def test_lost_notifications(self, master: Master) -> None:
        async with MockServer(MockSettings(setup_s=0.0)) as mock:
            mock.faults.loses_notifications = True
            async with system(master, mock, session_s=2.0) as (told, got, _):
                await until(lambda: told.state().state == "pending")
                await flows_on(got)
                # Its end is not told either: renewing finds out.
                (bearer,) = mock.network.bearers
                mock.terminate(bearer)
                await until(lambda: mock.network.bearers and bearer not in mock.network.bearers)

    async def test_what_was_left_open_is_released(self, master: Master, tmp_path: Path) -> None:
        journal = tmp_path / "open.json"
        async with MockServer(MockSettings(setup_s=0.0)) as mock:
            left = mock.nef.answer.__self__
            async with system(master, mock, journal=str(journal)) as (told, _, _watcher):
                await until(lambda: told.state().state == "active")
                saved = journal.read_text()
                assert len(json.loads(saved)) == 1
            assert json.loads(journal.read_text()) == []
            kept = mock.network.ask("old", "old", 9, (), 0, 1000, 0)
            left._desk.records["old"] = {"self": "x"}
            left._owners["old"] = "simple_ros"
            assert kept is mock.network.bearers["old"]
            url = f"{mock.url}/3gpp-as-session-with-qos/v1/simple_ros/subscriptions/old"
            journal.write_text(json.dumps([url, f"{mock.url}/gone"]))
            async with system(master, mock, journal=str(journal)):
                await until(lambda: "old" not in mock.network.bearers)

    async def test_killed_with_a_session_open(self, master: Master, tmp_path: Path) -> None:
        journal = tmp_path / "open.json"
        async with MockServer(MockSettings(setup_s=0.0)) as mock:
            async with (
                listener(master) as (node, told),
                at_work(FlowRelay(), master, stats_period_s=0.05),
            ):
                publisher = await node.advertise("cmd_vel_qos", Twist)
                got: list[Twist] = []
                await node.subscribe("cmd_vel", Twist, got.append)
                node.create_timer(0.02, lambda _: publisher.publish(Twist()))
                said = {
                    "url": mock.url,
                    "min_window_s": 0.2,
                    "journal": str(journal),
                    "session_s": 60.0,
                }
                await node.set_parameters(
                    {f"/topic_watcher/{key}": item for key, item in said.items()}
                )
                async with watcher_process(master) as process:
                    await until(lambda: told.state().state == "active", limit=30)
                    first = set(mock.network.bearers)
                    process.send_signal(signal.SIGKILL)
                    await process.wait()
                await flows_on(got)
                assert set(mock.network.bearers) == first
                async with watcher_process(master) as process:
                    await until(lambda: not first & set(mock.network.bearers), limit=30)
                    process.terminate()
                    assert await process.wait() == 0
            assert not mock.network.bearers

    @pytest.mark.usefixtures("judged")
    async def test_camara_by_https_both_ways(self, master: Master, tmp_path: Path) -> None:
        """Its events are taken by https only; and the network wants to know who its clients are."""
        mine = made_in(tmp_path)
        async with MockServer(
            MockSettings(setup_s=0.2),
            client_id="robot",
            client_secret="hush",
            tls=server_tls(mine, wants_clients=True),
            notifies=StandardTransport(client_tls(str(mine))),
        ) as mock:
            secret = tmp_path / "secret"
            secret.write_text("hush")
            told_how = {
                "backend": "camara",
                "token_url": mock.token_url,
                "client_id": "robot",
                "secret_file": str(secret),
                "ca_file": str(mine),
                "cert_file": str(mine),
                "notify_cert": str(mine),
                "session_s": 60.0,
            }
            async with system(master, mock, **told_how) as (told, got, _watcher):
                await until(lambda: told.state().state == "active")
                await has_come(told, QosNotification.GRANTED)
                granted = [item for item in told.told if item.event == QosNotification.GRANTED]
                assert len(granted) == 1
                (first,) = mock.network.bearers
                mock.terminate(first)
                await until(lambda: set(mock.network.bearers) not in (set(), {first}))
                await has_come(told, QosNotification.TERMINATED)
                await until(lambda: told.state().state == "active")
                await flows_on(got)

    async def test_secrets_and_certificates(self, master: Master, tmp_path: Path) -> None:
        secret = tmp_path / "secret"
        secret.write_text("hush\n")
        async with MockServer(
            MockSettings(setup_s=0.0), client_id="robot", client_secret="hush"
        ) as mock:
            told_how = {
                "token_url": mock.token_url,
                "client_id": "robot",
                "secret_file": str(secret),
            }
            async with system(master, mock, **told_how) as (told, _, _watcher):
                await until(lambda: told.state().state == "active")

    async def test_parameters_that_make_no_sense(self, master: Master) -> None:
        for wrong in (
            {"url": "ftp://x"},
            {"qos_reference": "fixed"},
            {"authorised": [9]},
            {"secret_file": "/nowhere"},
            {"notify_cert": "/nowhere"},
            {"ca_file": "/nowhere"},
            {"profiles": ["QOS_S"]},
        ):
            await refused(TopicWatcher(), master, wrong)

    def test_by_name(self) -> None:
        assert isinstance(engine_named("flow-relay"), FlowRelay)
        assert isinstance(engine_named("topic-watcher"), TopicWatcher)


@asynccontextmanager
async def watcher_process(master: Master) -> AsyncIterator[asyncio.subprocess.Process]:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "simple_ros.cli.main", "engine", "run", "topic-watcher",
        "--master", master.address,
        stdout=asyncio.subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


async def test_mock_command_and_control() -> None:
    program = [sys.executable, "-m", "simple_ros.cli.main", "network"]
    mock = await asyncio.create_subprocess_exec(
        *program, "mock", "--port", "0", "--setup", "0.5", stdout=asyncio.subprocess.PIPE
    )
    try:
        assert mock.stdout is not None
        line = (await mock.stdout.readline()).decode()
        url = next(word for word in line.split() if word.startswith("http"))
        control = await asyncio.create_subprocess_exec(
            *program, "control", "capacity_bps=5", "is_down=true", "--url", url,
            stdout=asyncio.subprocess.PIPE,
        )  # fmt: skip
        out, _ = await control.communicate()
        state = json.loads(out)
        assert state["simulated"]
        assert state["settings"]["capacity_bps"] == 5
        assert state["faults"]["is_down"]
        for wrong in ("bogus=1", "setup_s=-1", "status=9999"):
            code, out_text, errors = await run("network", "control", wrong, "--url", url)
            assert (code, out_text) == (1, "")
            assert errors.startswith("error: ")
            assert wrong.partition("=")[0] in errors
        mock.send_signal(signal.SIGINT)
        assert await mock.wait() == 0
    finally:
        if mock.returncode is None:
            mock.kill()
            await mock.wait()


async def test_control_says_that_there_is_no_network() -> None:
    code, _, errors = await run("network", "control", "--url", "http://127.0.0.1:1")
    assert code == 1
    assert errors.strip().endswith("is 'simple-ros network mock' running there?")


async def test_classes_command() -> None:
    code, text, errors = await run("network", "classes", "84", "9", "86", "5")
    assert (code, errors) == (0, "")
    head, *rows = text.splitlines()
    assert head.split()[:4] == ["QCI", "type", "priority", "delay"]
    assert rows[0].startswith(
        "84   critical GBR  24        30 ms   1e-05   1354 B   18    intelligent"
    )
    assert rows[1].startswith(
        "9    Non-GBR       90        300 ms  1e-06   -        0     buffered"
    )
    assert rows[2].endswith("(5G only)")
    assert rows[3].endswith("(for who is authorised)")
    rows = await run_json("network", "classes")
    assert [row["qci"] for row in rows] == sorted(QCI)
    windows = {row["averaging_window_ms"] for row in rows if row["resource"] == "GBR"}
    assert windows == {2000}
    code, _, errors = await run("network", "classes", "11")
    assert code != 0
    assert "no QCI 11" in errors


async def test_mock_port_taken() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        with pytest.raises(OSError, match="in use"):
            await MockServer().start("127.0.0.1", taken.getsockname()[1])
