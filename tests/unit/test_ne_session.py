from __future__ import annotations

import math
from dataclasses import replace

import pytest

from simple_ros.errors import ConfigError
from simple_ros.msg.network_exposure_msgs import (
    Locator,
    QosAdvice,
    UniqueTopicFlow,
    UniqueTopicFlows,
    UniqueTopicFlowStat,
    UniqueTopicFlowStats,
)
from simple_ros_engines.network_exposure.exposure.model import Event, Notification, Session
from simple_ros_engines.network_exposure.flow_session import (
    Action,
    Command,
    FlowSession,
    SessionSettings,
    State,
)
from simple_ros_engines.network_exposure.qci import ResourceType
from simple_ros_engines.network_exposure.qos_mapper import Mode, Requirement, Selection, select
from simple_ros_engines.network_exposure.watcher_core import (
    Identities,
    WatcherCore,
    WatcherSettings,
)


def wants(delay_ms: float = 100, bit_rate: float = 1e6) -> Selection:
    return select(Requirement(ResourceType.GBR, delay_ms, 1e-2, 100, bit_rate))


def run(session: FlowSession, now_s: float, **answer: str) -> list[Action]:
    """Carry out what is due, all of it with success."""
    done = []
    while (command := session.next_command(now_s)) is not None:
        done.append(command.action)
        made = {Action.REQUEST: "one", Action.UPDATE: "two", Action.RENEW: command.session_id}
        name = made.get(command.action)
        session.done(now_s, None if name is None else Session(name, 1))
    return done


class TestSession:
    def test_step_by_step(self) -> None:
        session = FlowSession()
        assert session.next_command(0) is None
        assert session.state is State.WAITING
        session.want(wants(), 0)
        assert session.next_command(0) == Command(Action.GROUP)
        assert session.state is State.GROUPING
        assert session.next_command(0) is None
        session.done(0)
        assert session.next_command(0) == Command(Action.JOIN)
        session.done(0)
        command = session.next_command(0)
        assert command is not None
        assert (command.action, command.selection) == (Action.REQUEST, session.wanted)
        assert session.state is State.REQUESTING
        session.done(0, Session("one", None, True))
        assert session.state is State.PENDING
        assert session.next_command(1) is None
        session.told(Event.GRANTED, None, 1)
        assert (session.state, session.applied_qci) == (State.ACTIVE, 1)
        assert run(session, 1) == [Action.MONITOR]
        session.release()
        assert run(session, 2) == [Action.RELEASE]
        assert session.is_over

    def test_without_a_confirmation_it_goes_on(self) -> None:
        session = FlowSession(SessionSettings(pending_s=3))
        session.want(wants(), 0)
        for _ in range(2):
            session.next_command(0)
            session.done(0)
        session.next_command(0)
        session.done(0, Session("one", None, True))
        assert run(session, 3) == [Action.MONITOR]
        assert session.state is State.ACTIVE

    def test_asks_anew_when_something_else_is_wanted_long_enough(self) -> None:
        session = FlowSession(SessionSettings(dwell_s=5, monitors=False))
        session.want(wants(100), 0)
        run(session, 0)
        session.want(wants(20), 1)
        session.want(wants(100), 3)
        session.want(wants(20), 4)
        assert run(session, 8) == []
        assert run(session, 9) == [Action.UPDATE]
        assert (session.session_id, session.requests) == ("two", 2)

    def test_a_rate_that_changes_much_is_another_request(self) -> None:
        session = FlowSession(SessionSettings(dwell_s=0, monitors=False))
        session.want(wants(bit_rate=1e6), 0)
        run(session, 0)
        session.want(wants(bit_rate=1.2e6), 1)
        assert run(session, 1) == []
        session.want(wants(bit_rate=1.5e6), 2)
        assert run(session, 2) == [Action.UPDATE]

    def test_static_never_changes(self) -> None:
        session = FlowSession(SessionSettings(mode=Mode.STATIC, dwell_s=0, monitors=False))
        session.want(wants(100), 0)
        run(session, 0)
        session.want(wants(20), 1)
        assert run(session, 100) == []
        assert run(session, 300) == [Action.RENEW]
        assert run(session, 301) == []

    def test_failures_are_tried_again_ever_more_rarely(self) -> None:
        session = FlowSession(SessionSettings(retry_s=1, retry_most_s=3))
        session.want(wants(), 0)
        moments = []
        now_s = 0.0
        while len(moments) < 5:
            if session.next_command(now_s) is not None:
                moments.append(now_s)
                session.failed(now_s, "no")
                assert session.state is State.FAILED
            now_s += 0.5
        assert moments == [0, 1, 3, 6, 9]
        assert session.detail == "no"
        session.next_command(20)
        session.failed(20, "later", 30)
        assert session.next_command(49) is None
        assert session.next_command(50) is not None

    def test_terminated_sessions_are_asked_for_again(self) -> None:
        session = FlowSession(SessionSettings(monitors=False))
        session.want(wants(), 0)
        run(session, 0)
        session.told(Event.DOWNGRADED, 9, 1, "less")
        assert (session.state, session.applied_qci, session.detail) == (State.DEGRADED, 9, "less")
        session.told(Event.RECOVERED, None, 2)
        assert (session.state, session.applied_qci) == (State.ACTIVE, 1)
        session.told(Event.TERMINATED, None, 3, "over")
        assert session.state is State.FAILED
        assert run(session, 3) == []
        assert run(session, 4) == [Action.REQUEST]

    def test_what_the_network_has_forgotten(self) -> None:
        session = FlowSession(SessionSettings(monitors=False, duration_s=10))
        session.want(wants(), 0)
        run(session, 0)
        command = session.next_command(5)
        assert command is not None
        assert command.action is Action.RENEW
        session.lost(5, "404")
        assert session.session_id == ""
        assert run(session, 6) == [Action.REQUEST]
        session.release()
        session.next_command(7)
        session.lost(7, "404")
        assert session.is_over

    def test_failed_monitoring_harms_nothing(self) -> None:
        session = FlowSession()
        session.want(wants(), 0)
        for _ in range(3):
            session.next_command(0)
            session.done(0, Session("one", 1))
        session.next_command(0)
        session.failed(0, "no measurements")
        assert session.state is State.ACTIVE
        assert session.next_command(0) is None

    def test_released_and_wanted_again(self) -> None:
        session = FlowSession(SessionSettings(monitors=False))
        session.want(wants(), 0)
        run(session, 0)
        session.release()
        run(session, 1)
        session.want(wants(), 2)
        assert run(session, 2) == [Action.REQUEST]


def flow(topic: str = "pose", port: int = 1000, **more: object) -> UniqueTopicFlow:
    return UniqueTopicFlow(
        topic=topic,
        source_topic=f"{topic}_qos",
        source=Locator(kind=Locator.TCPV4, address="10.0.0.1", port=port),
        destination=Locator(kind=Locator.TCPV4, address="10.0.0.2", port=7),
        is_reliable=True,
        **more,  # type: ignore[arg-type]
    )


def flows(*items: UniqueTopicFlow) -> UniqueTopicFlows:
    return UniqueTopicFlows(relay="relay", flows=items)


def stats(topic: str = "pose", messages: int = 50, rate_hz: float = 10) -> UniqueTopicFlowStats:
    return UniqueTopicFlowStats(
        relay="relay",
        stats=[
            UniqueTopicFlowStat(
                topic=topic,
                num_messages=messages,
                window_duration_s=5,
                window_rate=rate_hz,
                window_bandwidth=rate_hz * 100,
                window_burst=100,
            )
        ],
    )


def carry_out(core: WatcherCore, now_s: float) -> list[tuple[str, Action]]:
    done = []
    while due := core.look(now_s):
        for item in due:
            done.append((item.key[0], item.command.action))
            is_asked = item.command.action in (Action.REQUEST, Action.UPDATE)
            core.done(item.key, now_s, Session(f"s-{item.key[0]}", 1) if is_asked else None)
    return done


class TestWatcherCore:
    def core(self, **settings: object) -> WatcherCore:
        session = SessionSettings(monitors=False, dwell_s=0, **settings)  # type: ignore[arg-type]
        return WatcherCore(WatcherSettings(session, idle_s=30))

    def test_asks_when_two_windows_are_known(self) -> None:
        core = self.core()
        core.flows_came(flows(flow()), 0)
        core.stats_came(stats(messages=50), 1)
        assert carry_out(core, 1) == []
        core.stats_came(stats(messages=70), 3)
        steps = [Action.GROUP, Action.JOIN, Action.REQUEST]
        assert carry_out(core, 3) == [("pose", step) for step in steps]
        (status,) = core.status()
        assert (status.state, status.qci, status.is_gbr) == ("active", 84, True)
        assert list(status.alternatives) == [85]
        assert status.bit_rate == 16_000

    def test_each_subscriber_has_a_session(self) -> None:
        core = self.core()
        core.flows_came(flows(flow(port=1), flow(port=2)), 0)
        core.stats_came(stats(messages=50), 1)
        core.stats_came(stats(messages=70), 3)
        assert carry_out(core, 3).count(("pose", Action.REQUEST)) == 2

    def test_a_flow_that_ends_is_released(self) -> None:
        core = self.core()
        core.flows_came(flows(flow()), 0)
        core.stats_came(stats(messages=50), 1)
        core.stats_came(stats(messages=70), 3)
        carry_out(core, 3)
        core.flows_came(flows(), 4)
        assert carry_out(core, 4) == [("pose", Action.RELEASE)]
        core.look(4)
        assert not core.flows

    def test_silence_releases_and_messages_bring_it_back(self) -> None:
        core = self.core()
        core.flows_came(flows(flow(lease_ms=4000)), 0)
        core.stats_came(stats(messages=50), 1)
        core.stats_came(stats(messages=70), 3)
        carry_out(core, 3)
        core.stats_came(stats(messages=70), 6)
        assert carry_out(core, 6) == []
        assert carry_out(core, 7.5) == [("pose", Action.RELEASE)]
        core.stats_came(stats(messages=80), 9)
        assert carry_out(core, 9) == [("pose", Action.REQUEST)]

    def test_flows_of_a_relay_that_is_gone_are_forgotten(self) -> None:
        core = self.core()
        core.flows_came(flows(flow()), 0)
        core.stats_came(stats(messages=50), 1)
        core.stats_came(stats(messages=70), 3)
        carry_out(core, 3)
        assert carry_out(core, 33) == []
        assert carry_out(core, 33.5) == [("pose", Action.RELEASE)]
        core.look(34)
        assert not core.flows
        # It was only slow: it tells its flows every ten seconds.
        core.flows_came(flows(flow()), 40)
        assert core.flows

    def test_notifications_find_their_flow(self) -> None:
        core = self.core()
        core.flows_came(flows(flow()), 0)
        core.stats_came(stats(messages=50), 1)
        core.stats_came(stats(messages=70), 3)
        carry_out(core, 3)
        assert core.told(Notification(Event.DOWNGRADED, "s-pose", 9), 4) is not None
        assert core.status()[0].state == "degraded"
        assert core.told(Notification(Event.DOWNGRADED, "other", 9), 4) is None

    def test_advice_counts_in_mode_ai_only(self) -> None:
        for mode, qci in ((Mode.AI, 9), (Mode.DYNAMIC, 84)):
            core = self.core(mode=mode)
            core.advised(QosAdvice(topic="/pose", qci=9), 0)
            core.flows_came(flows(flow()), 0)
            core.stats_came(stats(messages=50), 1)
            core.stats_came(stats(messages=70), 3)
            carry_out(core, 3)
            assert core.status()[0].qci == qci
            core.advised(QosAdvice(topic="pose", clear=True), 4)
            core.stats_came(stats(messages=90), 5)
            carry_out(core, 5)
            assert core.status()[0].qci == 84

    def test_advice_ends_by_itself_unless_it_is_said_again(self) -> None:
        core = self.core(mode=Mode.AI)
        core.flows_came(flows(flow()), 0)
        asked = []
        for now_s, messages in ((1, 50), (3, 70), (5, 90), (7, 110)):
            if now_s < 5:
                core.advised(QosAdvice(topic="pose", qci=9, valid_s=3), now_s)
            core.stats_came(stats(messages=messages), now_s)
            carry_out(core, now_s)
            asked.append(core.status()[0].qci)
        assert asked[1:] == [9, 9, 84]
        assert core.advice == {}

    @pytest.mark.parametrize(
        "numbers",
        [
            {"latency_budget_ms": -1.0},
            {"latency_budget_ms": math.nan},
            {"latency_budget_ms": math.inf},
            {"error_rate": 1.0},
            {"error_rate": -0.1},
            {"valid_s": -1.0},
            {"valid_s": math.nan},
        ],
    )
    def test_advice_without_sense_changes_nothing(self, numbers: dict[str, float]) -> None:
        core = self.core(mode=Mode.AI)
        core.advised(QosAdvice(topic="pose", qci=9), 0)
        before = dict(core.advice)
        with pytest.raises(ConfigError, match="must be"):
            core.advised(QosAdvice(topic="pose", **numbers), 1)  # type: ignore[arg-type]
        assert core.advice == before

    def test_tunnels_are_asked_for_before_they_are_used(self) -> None:
        core = self.core()
        tunnels = [
            UniqueTopicFlow(
                topic=f"image_QCI_{qci}",
                source_topic="image_qos_out",
                tunnel_qci=qci,
                source=Locator(kind=Locator.TCPV4, address="10.0.0.1", port=qci),
                destination=Locator(kind=Locator.TCPV4, address="10.0.0.2", port=7),
            )
            for qci in (8, 84)
        ]
        core.flows_came(flows(*tunnels), 0)
        for now_s, messages in ((1, 50), (3, 70), (5, 90)):
            told = stats("image_QCI_8", messages)
            told.stats.append(UniqueTopicFlowStat(topic="image_QCI_84"))
            core.stats_came(told, now_s)
        carry_out(core, 5)
        assert {item.qci for item in core.status()} == {8, 84}
        assert [(told.topic, told.qci) for told in core.steering] == [("image_qos_out", 84)]

    def test_tunnels_are_steered_by_what_the_mapper_selects(self) -> None:
        core = self.core()
        item = flow("image_QCI_84", tunnel_qci=84)
        core.flows_came(flows(item), 0)
        for now_s, messages in ((1, 50), (3, 70), (5, 90)):
            core.stats_came(stats("image_QCI_84", messages), now_s)
        assert [(told.topic, told.qci) for told in core.steering] == [("image_QCI_84_qos", 84)]

    def test_the_end(self) -> None:
        core = self.core()
        core.flows_came(flows(flow()), 0)
        core.stats_came(stats(messages=50), 1)
        core.stats_came(stats(messages=70), 3)
        carry_out(core, 3)
        core.end()
        assert carry_out(core, 4) == [("pose", Action.RELEASE)]
        assert [item.state for item in core.status()] == ["released"]

    def test_identities(self) -> None:
        who = Identities({"10.0.0.2": "msisdn-491700000001"}, "extid-r@x.org")
        (known,) = self._known(flow())
        found = who.of(known)
        assert (found.is_uplink, found.phone_number) == (False, "+491700000001")
        other = who.of(replace(known, destination_ip="10.9.9.9"))
        assert (other.is_uplink, other.external_id, other.ip) == (True, "r@x.org", "10.0.0.1")

    def _known(self, item: UniqueTopicFlow) -> list[object]:
        core = self.core()
        core.flows_came(flows(item), 0)
        return [key[1] for key in core.flows]
