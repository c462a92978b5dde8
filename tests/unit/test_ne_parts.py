from __future__ import annotations

import math
from typing import Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros.graph import GraphNode, GraphSnapshot, TopicKey
from simple_ros_engines.network_exposure.mock.faults import sorted_out
from simple_ros_engines.network_exposure.raw import RawCodec, raw_class
from simple_ros_engines.network_exposure.relay_plan import PlanSettings, Wanted, plan
from simple_ros_engines.network_exposure.reorder import (
    Arrival,
    DropLate,
    HoldBack,
    Reorder,
    TunnelMeter,
)
from simple_ros_engines.network_exposure.statistics import FlowMeter
from simple_ros_engines.network_exposure.tags import Role, Tagged, TagRules
from simple_ros_engines.network_exposure.throttle import Throttle, ThrottleSettings


class TestTags:
    @pytest.mark.parametrize(
        ("topic", "found"),
        [
            ("turtle1/pose_qos", ("turtle1/pose", Role.RELAY, 0)),
            ("image_qos_out", ("image", Role.TUNNEL_START, 0)),
            ("image_qos_in", ("image", Role.TUNNEL_END, 0)),
            ("image_qos_tunnel", ("image", Role.TUNNEL, 0)),
            ("image_QCI_84", ("image", Role.TUNNEL, 84)),
            ("a_qos_out_qos", ("a_qos_out", Role.RELAY, 0)),
            ("pose", None),
            ("pose_QoS", None),
            ("qos_pose", None),
            ("a_qos/pose", None),
            ("image_QCI_999", None),
            ("image_QCI_", None),
            ("_qos", None),
            ("robot/_qos", None),
        ],
    )
    def test_only_the_end_counts(self, topic: str, found: tuple[str, Role, int] | None) -> None:
        tagged = TagRules().parse(topic)
        assert tagged == (None if found is None else Tagged(topic, *found))

    def test_other_tags(self) -> None:
        rules = TagRules(relay="_touf", start="_to", end="_from", tunnel="_t", per_qci="_c<n>")
        assert rules.parse("chatter_touf") == Tagged("chatter_touf", "chatter", Role.RELAY)
        assert rules.tunnel_topic("chatter", 8) == "chatter_c8"
        assert rules.parse("chatter_c8") == Tagged("chatter_c8", "chatter", Role.TUNNEL, 8)
        assert rules.parse("pose_qos") is None

    @pytest.mark.parametrize(
        "tags", [{"relay": ""}, {"relay": "_qos_in"}, {"per_qci": "_QCI"}, {"start": "_a/b"}]
    )
    def test_tags_that_make_no_sense(self, tags: dict[str, str]) -> None:
        with pytest.raises(ConfigError, match="tag"):
            TagRules(**tags)


class TestThrottle:
    def test_drops_every_nth(self) -> None:
        throttle: Throttle[int] = Throttle(ThrottleSettings(drop_every_nth=3))
        sent = [item for n in range(1, 10) for item in throttle.put(n, 0)]
        assert sent == [1, 2, 4, 5, 7, 8]
        assert throttle.dropped == 3
        assert ThrottleSettings(drop_every_nth=4).drop_rate == 0.25
        assert ThrottleSettings().drop_rate == 0

    def test_delays_by_messages(self) -> None:
        throttle: Throttle[int] = Throttle(ThrottleSettings(delay_messages=2))
        assert [throttle.put(n, n) for n in range(4)] == [[], [], [0], [1]]
        assert throttle.next_due_s() is None
        throttle.settings = ThrottleSettings()
        assert throttle.due(4) == [2, 3]

    def test_delays_by_time(self) -> None:
        throttle: Throttle[int] = Throttle(ThrottleSettings(delay_ms=50))
        assert throttle.put(1, 1.0) == []
        assert throttle.next_due_s() == pytest.approx(1.05)
        assert throttle.due(1.04) == []
        assert throttle.put(2, 1.05) == [1]
        assert throttle.held == 1

    def test_ends_by_itself_unless_it_is_said_again(self) -> None:
        throttle: Throttle[int] = Throttle()
        throttle.ask(ThrottleSettings(drop_every_nth=1, delay_messages=3), 10, 2)
        assert throttle.ends_s == 12
        assert not throttle.lapse(11.9)
        throttle.ask(ThrottleSettings(delay_messages=3), 11.9, 2)
        assert throttle.put(7, 12) == []
        assert not throttle.lapse(13.8)
        assert throttle.lapse(13.9)
        assert throttle.settings == ThrottleSettings()
        assert throttle.due(13.9) == [7]
        assert not throttle.lapse(20)
        throttle.ask(ThrottleSettings(drop_every_nth=2), 20)
        assert throttle.ends_s is None
        throttle.ask(ThrottleSettings(), 20, 5)
        assert throttle.ends_s is None
        for wrong in (-1, float("nan"), float("inf")):
            with pytest.raises(ConfigError, match="valid_s"):
                throttle.ask(ThrottleSettings(), 20, wrong)

    @pytest.mark.parametrize(
        "wrong", [{"drop_every_nth": -1}, {"delay_messages": 1001}, {"delay_ms": float("nan")}]
    )
    def test_limits(self, wrong: dict[str, float]) -> None:
        with pytest.raises(ConfigError):
            ThrottleSettings(**wrong)  # type: ignore[arg-type]

    @given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 3), st.floats(0, 30)), max_size=20))
    def test_nothing_is_lost_or_reordered(self, changes: list[tuple[int, int, float]]) -> None:
        throttle: Throttle[int] = Throttle()
        sent: list[int] = []
        for n, change in enumerate(changes):
            throttle.settings = ThrottleSettings(*change)
            sent += throttle.put(n, n / 100)
        throttle.settings = ThrottleSettings()
        sent += throttle.due(1e9)
        assert sent == sorted(sent)
        assert len(sent) + throttle.dropped == len(changes)


def feed(
    order: Reorder[int], numbers: list[int], session: int = 1, now_s: float = 0.0
) -> list[int]:
    return [item for n in numbers for item in order.put(Arrival(session, n, n), now_s)]


class TestReorder:
    def test_newest_first(self) -> None:
        order: DropLate[int] = DropLate()
        assert feed(order, [5, 6, 8, 7, 8, 9]) == [5, 6, 8, 9]
        assert (order.late, order.discarded, order.duplicates, order.restarts) == (1, 1, 1, 0)

    def test_hold_back_waits_for_what_is_missing(self) -> None:
        order: HoldBack[int] = HoldBack(0.05)
        assert feed(order, [5, 7, 8]) == [5]
        assert order.next_due_s() == pytest.approx(0.05)
        assert feed(order, [6], now_s=0.02) == [6, 7, 8]
        assert feed(order, [11, 12], now_s=1.0) == []
        assert order.due(1.04) == []
        assert order.due(1.06) == [11, 12]
        assert feed(order, [10], now_s=1.1) == []
        assert (order.late, order.discarded) == (2, 1)

    def test_hold_back_is_bounded(self) -> None:
        order: HoldBack[int] = HoldBack(10.0, most=3)
        assert feed(order, [1, 3, 4, 5, 6]) == [1, 3, 4, 5, 6]

    @pytest.mark.parametrize("kind", [DropLate, HoldBack])
    def test_a_sender_that_begins_anew(self, kind: type[Reorder[int]]) -> None:
        order = kind()
        assert feed(order, [100, 101]) == [100, 101]
        assert feed(order, [1, 2], session=2) == [1, 2]
        assert order.restarts == 1

    @given(st.permutations(list(range(30))))
    def test_hold_back_gives_all_in_order(self, numbers: list[int]) -> None:
        order: HoldBack[int] = HoldBack(1.0)
        begun = [0, *(n for n in numbers if n)]
        assert feed(order, begun) == sorted(numbers)


class TestTunnelMeter:
    def test_loss_latency_and_throttling_are_apart(self) -> None:
        meter = TunnelMeter(5.0)
        for n in range(1, 21):
            if n not in (5, 6):
                meter.came(1, n, n // 10, 0.01 if n % 2 else 0.03, n / 10)
        seen = meter.traffic(2.0)
        assert (seen.received, seen.lost, seen.throttled) == (18, 2, 2)
        assert seen.loss_rate == pytest.approx(0.1)
        assert seen.throttle_rate == pytest.approx(2 / 22)
        assert 0.01 < seen.latency_s < 0.03
        assert seen.latency_p95_s == 0.03
        assert seen.jitter_s > 0

    def test_late_messages_are_not_lost(self) -> None:
        meter = TunnelMeter()
        for n in (1, 3, 2, 4):
            meter.came(1, n, 0, 0.01, 0)
        assert meter.lost == 0

    def test_restart_is_no_loss(self) -> None:
        meter = TunnelMeter()
        for session, n in ((1, 5000), (1, 5002), (2, 1), (2, 2)):
            meter.came(session, n, 0, 0.01, 0)
        assert meter.lost == 1

    def test_nothing_came(self) -> None:
        assert TunnelMeter().traffic(0).loss_rate == 0


def graph(*nodes: tuple[str, str, list[str], list[str]]) -> GraphSnapshot:
    return GraphSnapshot(
        tuple(
            GraphNode(
                name,
                ip,
                1,
                tuple(TopicKey(topic, "t.T") for topic in out),
                tuple(TopicKey(topic, "t.T") for topic in into),
            )
            for name, ip, out, into in nodes
        )
    )


class TestPlan:
    def test_takes_up_tagged_topics(self) -> None:
        found = plan(
            graph(("app", "10.0.0.1", ["a_qos", "b_qos_out", "c"], [])), "relay", PlanSettings()
        )
        assert found.wanted == {
            Wanted(Role.RELAY, "a", "a_qos", "t.T"),
            Wanted(Role.TUNNEL_START, "b", "b_qos_out", "t.T"),
        }

    def test_ends_of_tunnels_need_somebody_who_listens(self) -> None:
        nodes = [("far", "10.0.0.1", ["b_QCI_8", "b_QCI_84", "d_qos_tunnel"], [])]
        assert not plan(graph(*nodes), "relay", PlanSettings()).wanted
        nodes.append(("app", "10.0.0.2", [], ["b_qos_in"]))
        found = plan(graph(*nodes), "relay", PlanSettings())
        assert found.wanted == {Wanted(Role.TUNNEL_END, "b", "b_qos_tunnel")}
        assert found.tunnels["b"] == {"b_QCI_8": 8, "b_QCI_84": 84}
        local = PlanSettings(local_ip="10.0.0.1")
        assert not plan(graph(*nodes), "relay", local).wanted

    def test_only_this_host(self) -> None:
        nodes = [("near", "10.0.0.1", ["a_qos"], []), ("far", "10.0.0.2", ["b_qos"], [])]
        found = plan(graph(*nodes), "relay", PlanSettings(local_ip="10.0.0.1"))
        assert {want.base for want in found.wanted} == {"a"}

    def test_only_some_topics_and_roles(self) -> None:
        nodes = graph(("app", "", ["a_qos", "b_qos", "c_qos_out"], []))
        some = PlanSettings(topics=frozenset({"b_qos", "c_qos_out"}), roles=frozenset({Role.RELAY}))
        assert {want.base for want in plan(nodes, "relay", some).wanted} == {"b"}

    def test_what_is_published_already_is_refused(self) -> None:
        nodes = graph(("app", "", ["a_qos"], []), ("other", "", ["a"], []))
        found = plan(nodes, "relay", PlanSettings())
        assert not found.wanted
        assert "other" in found.refused["a_qos"]
        assert plan(
            graph(("app", "", ["a_qos"], []), ("relay", "", ["a"], [])), "relay", PlanSettings()
        ).wanted


FLOWS = "/unique_network_flow"


class TestTwoRelays:
    """One relay for each topic."""

    APP = ("app", "10.0.0.1", ["a_qos", "b_qos_out"], ["b_qos_in"])
    TUNNELS: ClassVar[list[str]] = ["b_qos_tunnel"]

    def plan(self, own: str, *nodes: Any, held: set[Wanted] | None = None) -> tuple[set[str], str]:
        found = plan(graph(self.APP, *nodes), own, PlanSettings(), held or set())
        return {want.base for want in found.wanted}, " ".join(found.refused.values())

    def test_who_comes_second_leaves_it_alone(self) -> None:
        first = ("one", "", [FLOWS, "a", *self.TUNNELS, "b_qos_in"], ["a_qos", "b_qos_out"])
        taken, why = self.plan("two", first)
        assert taken == set()
        assert "relayed to a by one already" in why
        assert "relayed to b_qos_tunnel by one already" in why
        assert "relayed to b_qos_in by one already" in why
        quiet = ("one", "", [FLOWS, "a", *self.TUNNELS], ["a_qos", "b_qos_tunnel"])
        assert "one takes it out of its tunnel already" in self.plan("two", quiet)[1]

    def test_and_takes_over_when_the_first_is_gone(self) -> None:
        assert self.plan("two", ("one", "", [FLOWS], []))[0] == {"a", "b"}

    @pytest.mark.parametrize(("own", "goes_on"), [("one", True), ("two", False)])
    def test_of_two_at_once_the_first_by_name_goes_on(self, own: str, goes_on: bool) -> None:
        both = [
            (name, "", [FLOWS, "a", *self.TUNNELS, "b_qos_in"], ["a_qos", "b_qos_out"])
            for name in ("one", "two")
        ]
        wants = plan(graph(self.APP), own, PlanSettings()).wanted
        tunnel = Wanted(Role.TUNNEL_END, "b", "b_qos_tunnel")
        taken, why = self.plan(own, *both, held={*wants, tunnel})
        assert (taken == {"a", "b"}) == goes_on
        assert bool(why) != goes_on

    def test_somebody_who_is_no_relay_goes_first(self) -> None:
        wants = {Wanted(Role.RELAY, "a", "a_qos", "t.T")}
        taken, why = self.plan("a_relay", ("old", "", ["a"], ["a_qos"]), held=wants)
        assert "a" not in taken
        assert why == "a is published by old already"


class TestRaw:
    def test_passes_bytes_through(self) -> None:
        codec, kind = RawCodec(), raw_class("some.Type")
        assert raw_class("some.Type") is kind
        assert codec.type_name(kind) == "some.Type"
        small = codec.decode(memoryview(b"abc"), kind)
        assert isinstance(small.data, bytes)
        assert codec.encode(small) == b"abc"
        large = codec.decode(memoryview(bytearray(100_000)), kind)
        assert isinstance(large.data, memoryview)
        assert large.data.readonly
        assert len(large) == 100_000


def test_meter_window_has_limits() -> None:
    with pytest.raises(ConfigError, match="window_s"):
        FlowMeter(1.0)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"take_status": 1}, "take_status"),
        ({"setup_s": -1}, "setup_s"),
        ({"setup_s": math.nan}, "setup_s"),
        ({"capacity_bps": "5"}, "capacity_bps"),
        ({"max_bearers": 1.5}, "max_bearers"),
        ({"is_down": 1}, "is_down"),
        ({"delay_s": True}, "delay_s"),
        ({"status": 42}, "status"),
        ({"status_count": -2}, "status_count"),
        ({"least_delay_ms": None}, "least_delay_ms"),
    ],
)
def test_the_mock_network_is_not_set_to_nonsense(changes: dict[str, object], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        sorted_out(changes)


def test_settings_and_faults_of_the_mock_network_are_told_apart() -> None:
    changes = {"setup_s": 0, "least_delay_ms": 31.5, "status": 503, "status_count": -1}
    assert sorted_out(changes) == (
        {"setup_s": 0, "least_delay_ms": 31.5},
        {"status": 503, "status_count": -1},
    )
