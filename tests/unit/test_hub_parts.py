"""Breaker, rates, queues, journal, watchdog, performance, components: pure."""

from __future__ import annotations

import base64

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.diagnostics.status import ERROR, OK, WARN
from simple_ros.errors import ConfigError
from simple_ros.msg.nav_msgs import OccupancyGrid
from simple_ros.msg.wireless_ros_msgs import (
    ChannelState,
    Constraint,
    EngineStatus,
    FieldQuality,
    PhyLayerMetrics,
    TransmissionStrategy,
)
from simple_ros_engines.modes import Intake, Mode
from simple_ros_hub.breaker import BreakerState, CircuitBreaker
from simple_ros_hub.components import (
    Kind,
    check_components,
    components_of,
    default_components,
    with_parameters,
)
from simple_ros_hub.coordination import Coordinator, ResourceLimits, wished_blocks
from simple_ros_hub.flow import PriorityGate, TokenBucket
from simple_ros_hub.journal import Journal
from simple_ros_hub.performance import LinkNumbers, Performance, numbers_of
from simple_ros_hub.picture import map_json
from simple_ros_hub.signs import Signs
from simple_ros_hub.watchdog import TopicWatchdog

# -- circuit breaker ---------------------------------------------------------------------------


def test_a_breaker_opens_tries_once_and_closes() -> None:
    breaker = CircuitBreaker(failures=2, retry_s=1, max_retry_s=3)
    assert not breaker.failed(0, "no answer")
    assert breaker.failed(0)
    assert not breaker.allows(0.5)
    assert breaker.allows(1.0)
    assert breaker.state is BreakerState.HALF_OPEN
    assert not breaker.allows(1.0)
    assert breaker.failed(1.0)
    assert not breaker.allows(2.9)
    assert breaker.allows(3.0)
    assert breaker.failed(3.0)
    assert breaker.allows(6.0)
    assert breaker.succeeded()
    assert not breaker.succeeded()
    assert breaker.allows(6.0)


def test_single_failures_never_open_it() -> None:
    breaker = CircuitBreaker(failures=2)
    for now in range(10):
        assert not breaker.failed(now)
        breaker.succeeded()


# -- rates and queues --------------------------------------------------------------------------


@given(
    st.floats(1, 1000),
    st.floats(0, 1000),
    st.lists(st.tuples(st.floats(0, 500), st.floats(0, 3)), max_size=50),
)
def test_a_bucket_never_gives_more_than_its_rate_and_burst(
    rate: float, burst: float, tries: list[tuple[float, float]]
) -> None:
    bucket = TokenBucket(rate, burst, 0.0)
    now = given_out = 0.0
    largest = 0.0
    for units, step in tries:
        now += step
        if bucket.takes(units, now):
            given_out += units
            largest = max(largest, units)
        # What is larger than a burst is paid off afterwards.
        assert given_out <= rate * now + burst + largest + 1e-6


def test_a_bucket_says_when() -> None:
    bucket = TokenBucket(100, 50, 0)
    assert bucket.takes(50, 0)
    assert not bucket.takes(20, 0)
    assert bucket.wait_s(20, 0) == pytest.approx(0.2)
    assert bucket.takes(20, 0.2)
    bucket.set_rate(0, 0, 0.2)
    assert bucket.takes(1e9, 0.2)


def test_the_highest_priority_goes_first_and_the_old_fall() -> None:
    gate: PriorityGate[str] = PriorityGate(TokenBucket(100, 100, 0))
    for name, priority, until in (("a", 1, 9), ("b", 5, 9), ("old", 5, 0.5), ("c", 1, 9)):
        gate.put(name, 50, priority, until)
    assert gate.take(1.0) == ["b", "a"]
    assert gate.expired == 1
    assert gate.wait_s(1.0) == pytest.approx(0.5)
    assert gate.take(1.5) == ["c"]
    assert gate.wait_s(1.5) is None


def test_a_full_queue_gives_up_the_least_important() -> None:
    gate: PriorityGate[str] = PriorityGate(TokenBucket(1, 0, 0), limit=2)
    gate.put("low", 10, 1, 9)
    gate.put("high", 10, 5, 9)
    gate.put("middle", 10, 3, 9)
    assert gate.overflowed == 1
    gate.bucket.set_rate(0, 0, 0)
    assert gate.take(0) == ["high", "middle"]


@given(st.lists(st.tuples(st.integers(1, 5), st.integers(1, 100)), max_size=40))
def test_nothing_is_lost_without_being_counted(items: list[tuple[int, int]]) -> None:
    gate: PriorityGate[int] = PriorityGate(TokenBucket(50, 100, 0), limit=8)
    sent = 0
    for number, (priority, size) in enumerate(items):
        gate.put(number, size, priority, number / 10 + 0.5)
        sent += len(gate.take(number / 10))
    assert sent + gate.expired + gate.overflowed + len(gate) == len(items)


# -- journal -----------------------------------------------------------------------------------


SECOND = 1_000_000_000


def test_a_condition_is_logged_when_it_begins_and_when_it_ends() -> None:
    journal = Journal()
    for text in ("conflict 120/100", "conflict 121/100", "conflict 122/100"):
        journal.condition("conflict", text, 1, over="over")
    journal.condition("conflict", "", 2, over="over")
    journal.condition("conflict", "conflict 123/100", 3 * SECOND, over="over")
    for second in (4, 8, 9, 10):
        journal.condition("conflict", "", second * SECOND, over="over")
    assert [entry.text for entry in journal.system_events] == ["conflict 120/100", "over"]
    assert [entry.text for entry in journal.error_logs] == ["conflict 120/100"]


def test_the_journal_keeps_the_newest_and_hands_out_each_once() -> None:
    journal = Journal(keep=3)
    for number in range(5):
        journal.log_system_event(str(number), number)
    assert [entry.text for entry in journal.system_events] == ["2", "3", "4"]
    journal.log_error("bad", 9, "camera")
    fresh = journal.take_fresh()
    assert [entry.number for entry in fresh] == [4, 5, 6]
    assert journal.take_fresh() == []


# -- watchdog ----------------------------------------------------------------------------------


def fed(dog: TopicWatchdog, numbers: list[int], start: float = 0.0, step: float = 0.1) -> float:
    now = start
    for number in numbers:
        now += step
        dog.message(100, now, number, several=False)
    return now


def test_a_topic_that_flows_is_well() -> None:
    dog = TopicWatchdog("/a", 0.1, 0)
    now = fed(dog, list(range(10)))
    assert dog.look(now).level == OK


def test_silence_is_an_error_only_where_somebody_ought_to_send() -> None:
    dog = TopicWatchdog("/a", 0.1, 0)
    assert dog.look(10, needed=False).level == OK
    assert dog.look(10.2).level == OK
    found = dog.look(11)
    assert found.level == ERROR
    assert found.text == "/a is silent for 1.0 s"


def test_gaps_and_duplicates_are_told_once() -> None:
    dog = TopicWatchdog("/a", 0.1, 0)
    now = fed(dog, [1, 2, 3, 9, 10, 10])
    found = dog.look(now)
    assert found.level == WARN
    assert found.text == "/a lost 5 of 11"
    assert (dog.gaps, dog.duplicates) == (5, 1)
    now = fed(dog, [11, 12], now)
    assert dog.look(now).level == OK


def test_a_publisher_that_begins_anew_is_no_fault() -> None:
    dog = TopicWatchdog("/a", 0.1, 0)
    now = fed(dog, [1, 2, 3, 4, 5])
    now = fed(dog, [0, 1, 2, 3, 4, 5, 6], now)
    dog.begins_anew()
    now = fed(dog, [3, 4, 5, 6], now)
    assert dog.look(now).level == OK
    assert (dog.gaps, dog.duplicates) == (0, 0)


def test_a_slow_topic() -> None:
    dog = TopicWatchdog("/a", 0.1, 0)
    now = fed(dog, [1, 2, 3], step=0.4)
    assert dog.look(now).text == "/a comes at 2.5 Hz only"


# -- performance -------------------------------------------------------------------------------


def channel(link: str, **values: float) -> ChannelState:
    message = ChannelState(link_id=link, rnti=int(link, 16))
    for name, value in values.items():
        setattr(message, name, value)
        message.field_quality[name] = FieldQuality.MEASURED
    return message


def test_only_what_was_measured_counts() -> None:
    message = channel("4601", dl_bler=0.1, ul_bler=0.3, dl_thr=5, rtt_ms=20)
    message.ul_thr = 99
    message.field_quality["ul_thr"] = FieldQuality.OUT_OF_RANGE
    found = numbers_of(message)
    assert found.bler == pytest.approx(0.2)
    assert (found.throughput_mbps, found.rtt_ms, found.blocks) == (5, 20, None)


def test_means_over_fresh_links_and_nothing_invented() -> None:
    performance = Performance()
    performance.link("a", LinkNumbers(bler=0.1, rtt_ms=10), 0)
    performance.link("b", LinkNumbers(bler=0.3), 4)
    found = performance.metrics(4.5, granted_share=0.4, came=90, missing=10)
    assert found.avg_bler == pytest.approx(0.2)
    assert found.avg_latency == 10
    assert "avg_throughput" not in found.known
    assert found.resource_utilization == pytest.approx(0.4)
    assert (found.successful_transmissions, found.failed_transmissions) == (90, 10)
    assert found.counted == "messages of topics"
    later = performance.metrics(7, granted_share=None, came=90, missing=10)
    assert later.avg_bler == pytest.approx(0.3)


def test_blocks_are_counted_by_their_rise() -> None:
    performance = Performance()
    for session, sent, failed in ((1, 1000, 10), (1, 1100, 15), (2, 40, 1), (2, 60, 2)):
        numbers = LinkNumbers(blocks=sent, block_errors=failed, session=session)
        performance.link("a", numbers, 0)
    found = performance.metrics(0, granted_share=None, came=1, missing=1)
    assert (found.successful_transmissions, found.failed_transmissions) == (95 + 19, 5 + 1)
    assert found.counted == "radio blocks"


# -- coordination ------------------------------------------------------------------------------


def strategy(link: str, prb: int, rate: float = 0.0, priority: int = 3) -> TransmissionStrategy:
    return TransmissionStrategy(
        link_id=link, rnti=int(link, 16), target_prb=prb, rate_bps=rate, priority=priority
    )


def test_a_wish_does_not_shrink_with_its_grant() -> None:
    wide = Constraint(link_id="1", max_data_rate=20)
    assert wished_blocks(strategy("1", 50, 20e6), wide) == 50
    # Cut down to 10 blocks, it may send 4 Mbit/s of the 20 it could.
    assert wished_blocks(strategy("1", 10, 4e6), wide) == 50
    assert wished_blocks(strategy("1", 10, 4e6), None) == 10


def test_one_link_alone_is_no_conflict_however_much_it_wishes() -> None:
    coordinator = Coordinator()
    coordinator.metrics(PhyLayerMetrics(link_id="a", prb_total=51, link_quality=1), 0.0)
    coordinator.strategy(TransmissionStrategy(link_id="a", target_prb=130, priority=3), 0.0)
    shared = coordinator.share(0.0)
    assert (shared.blocks.requested, shared.blocks.granted) == (51, 51)
    assert not shared.blocks.is_conflict
    # How much it would like is load all the same.
    assert coordinator.load == pytest.approx(130 / 51)


def test_a_steady_link_is_told_of_in_mode_optimized_too() -> None:
    intake: Intake[int] = Intake(Mode.OPTIMIZED, differs=lambda a, b: a != b, refresh_ticks=5)
    told = []
    for _ in range(50):
        intake.offer("a", 7)
        told += intake.tick()
    # Whoever is behind takes a silent link for a dead one.
    assert told == [7] * 10
    # What says nothing any more is not told of.
    for _ in range(50):
        assert intake.tick() == []


def test_sharing_among_links() -> None:
    hub = Coordinator(ResourceLimits(max_total_prbs=100, max_users=2))
    for key, prb in (("1", 80), ("2", 80), ("3", 80)):
        hub.strategy(strategy(key, prb), 0)
    shared = hub.share(0.1)
    assert [grant.granted for grant in shared.blocks.grants] == [50, 50]
    assert list(shared.refused) == ["3"]
    assert shared.rntis == {"1": 1, "2": 2, "3": 3}
    assert hub.load == pytest.approx(1.6)


def test_a_link_that_may_use_nothing_still_wishes() -> None:
    hub = Coordinator(ResourceLimits(max_total_prbs=10))
    hub.constraint(Constraint(link_id="1", max_data_rate=5), 0)
    hub.strategy(strategy("1", 8, 5e6), 0)
    hub.strategy(strategy("1", 0, 0), 1)
    hub.constraint(Constraint(link_id="2", max_data_rate=5), 1)
    hub.strategy(strategy("2", 0, 0), 1)
    assert [grant.wanted for grant in hub.share(1).blocks.grants] == [8, 5]
    hub.constraint(Constraint(link_id="1", max_data_rate=0), 2)
    hub.strategy(strategy("1", 0, 0), 2)
    assert hub.share(2).blocks.grants[0].wanted == 0


def test_a_carrier_with_fewer_blocks_limits() -> None:
    hub = Coordinator(ResourceLimits(max_total_prbs=100))
    hub.metrics(PhyLayerMetrics(link_id="1", prb_total=51, link_quality=0.5), 0)
    hub.strategy(strategy("1", 80), 0)
    assert hub.share(0).blocks.granted == 51
    hub.set_limits(ResourceLimits(max_total_prbs=20))
    assert hub.share(0).blocks.granted == 20


def test_links_that_fall_silent_give_their_share_back() -> None:
    hub = Coordinator(ResourceLimits(max_total_prbs=100))
    hub.strategy(strategy("1", 80), 0)
    hub.strategy(strategy("2", 80), 0)
    hub.strategy(strategy("2", 80), 11)
    shared = hub.share(11)
    assert [(grant.key, grant.granted) for grant in shared.blocks.grants] == [("2", 80)]


def test_links_that_come_under_ever_new_keys_leave_nothing() -> None:
    # Each time a link attaches anew it has another number. The physical engine may be down meanwhile, so that
    # there is a constraint and never a wish.
    hub = Coordinator()
    most = 0
    for number in range(1, 500):
        now_s, key = float(number), f"{number:x}"
        hub.channel(ChannelState(link_id=key), now_s)
        hub.metrics(PhyLayerMetrics(link_id=key, prb_total=51), now_s)
        hub.constraint(Constraint(link_id=key, max_data_rate=5), now_s)
        if number % 2:
            hub.strategy(strategy(key, 8), now_s)
        hub.share(now_s)
        known = (hub.constraints_known, hub.users, len(hub.healths()))
        most = max(most, *known, len(hub.performance.present(now_s)))
    assert most <= 11
    hub.share(511)
    assert (hub.constraints_known, hub.users, hub.healths()) == (0, 0, {})


def test_a_constraint_stays_while_its_link_wishes() -> None:
    hub = Coordinator()
    hub.constraint(Constraint(link_id="1", max_data_rate=20), 0)
    for now_s in (0, 8, 16):
        hub.strategy(strategy("1", 10, 4e6), now_s)
        hub.share(now_s)
    assert hub.constraints_known == 1


def test_strangers_are_forgotten_and_ours_are_not() -> None:
    signs = Signs({"camera"}, forget_after_s=60)
    signs.came("camera", EngineStatus(state="active"), 0)
    for now_s in range(1000):
        signs.came(f"engine_{now_s}", EngineStatus(state="active"), now_s)
        signs.forget(now_s)
        assert len(signs.newest) <= 62
    signs.forget(2000)
    assert list(signs.newest) == ["camera"]


# -- components --------------------------------------------------------------------------------


def test_engines_come_in_the_order_of_the_design() -> None:
    names = [item.name for item in default_components()]
    assert names == ["radio_info_engine", "cross_domain_engine", "physical_adaptive_engine"]
    check_components(default_components())


def test_components_from_a_document() -> None:
    found = components_of(
        {
            "components": {
                "eye": {"cell": "camera", "priority": 2, "limits": {"memory_bytes": 10**9}},
                "radio_info_engine": {"engine": "radio-information", "parameters": {"budget": 3}},
            }
        },
        "robot.yaml",
    )
    eye, radio = found
    assert (eye.kind, eye.after, eye.limits.memory_bytes) == (Kind.CELL, (radio.name,), 10**9)
    assert radio.command[-2:] == ("engine", "radio-information")
    assert "_budget:=3" in radio.words
    assert radio.node == "wireless_ros/radio_info_engine"


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ([], "no mapping `components:`"),
        ({"components": {"a": {"engine": "x", "cell": "y"}}}, "one of engine, cell and command"),
        ({"components": {"a": {"cell": "x", "prioritee": 2}}}, "did you mean 'priority'"),
        ({"components": {"a": {"cell": "x", "priority": 9}}}, "priority 9"),
        ({"components": {"a b": {"cell": "x"}}}, "letters, digits and _"),
        ({"components": {"a": {"cell": "x", "after": ["b"]}}}, "'b', which is unknown"),
        ({"components": {"a": {"cell": "x", "respawn": {"limits": 2}}}}, "limits"),
        ({"components": {"a": {"command": "x", "kind": "thing"}}}, "not engine or cell"),
        (
            {"components": {"a": {"cell": "x", "after": "b"}, "b": {"cell": "x", "after": "a"}}},
            "waits for",
        ),
        ({"components": {}, "more": 1}, "no key 'more'"),
    ],
)
def test_documents_that_make_no_sense(document: object, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        components_of(document, "robot.yaml")


def test_parameters_by_words() -> None:
    found = with_parameters(default_components(), ["cross_domain_engine.mode=burst"])
    assert found[1].parameters == {"mode": "burst"}
    typed = with_parameters(
        found, ["radio_info_engine.budget=3", 'radio_info_engine.source_options={"links": 3}']
    )
    assert typed[0].parameters == {"budget": 3, "source_options": '{"links": 3}'}
    assert typed[0].words[2:] == ("_budget:=3", '_source_options:="{\\"links\\": 3}"')
    empty = with_parameters(found, ["radio_info_engine.link="])
    assert empty[0].words[-1] == '_link:=""'
    for bad in ("cross_domain_engine.mode", "mode=burst", "eye.mode=burst"):
        with pytest.raises(ConfigError):
            with_parameters(default_components(), [bad])


# -- dashboard ---------------------------------------------------------------------------------


def test_maps_are_made_small_enough_for_a_page() -> None:
    grid = OccupancyGrid(data=bytes([255, 0, 49, 100]) * 90_000)
    grid.info.width, grid.info.height, grid.info.resolution = 600, 600, 0.1
    shown = map_json(grid)
    assert shown is not None
    assert (shown["width"], shown["height"]) == (200, 200)
    assert shown["resolution"] == pytest.approx(0.3)
    assert set(base64.b64decode(shown["cells"])) == {0, 1, 50, 101}
    grid.info.width = 601
    assert map_json(grid) is None
