"""Every transition of the depletion protocol, with and without the messages that should cause it; lower requests."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros_engines.network_exposure.maximizer.depletion import Depletion, Measure, lowered
from simple_ros_engines.network_exposure.maximizer.knobs import DELAYS, START, Setting
from simple_ros_engines.network_exposure.maximizer.resource import TopicTraffic, request_of
from simple_ros_engines.network_exposure.maximizer.source_rate import SourceRate

POSE = TopicTraffic(62.5, 130.0, 1e-2)
COMMAND = TopicTraffic(20.0, 140.0, 1e-5)


def at_level(level: int, settle_s: float = 1.0, patience_s: float = 10.0) -> Depletion:
    """A process that got there at 0 s, and is short."""
    state = Depletion(settle_s, patience_s)
    for step in range(level):
        state.downgraded("a", (step + 1 - level) * 100.0)
    assert state.level == level
    return state


# -- what the network says ---------------------------------------------------------------------------


def test_nothing_is_done_while_all_is_served() -> None:
    state = Depletion()
    assert state.granted("a", 0.0) is None
    assert state.recovered("a", 1.0) is None
    assert state.tick(1000.0) is None
    assert (state.level, state.is_short, state.is_alert) == (0, False, False)


def test_the_first_downgrade_lowers_the_request_at_once() -> None:
    state = Depletion(settle_s=60.0)
    assert state.downgraded("a", 0.0) is Measure.LOWER_REQUEST
    assert (state.level, state.is_short, state.is_alert) == (1, True, True)


def test_what_comes_before_the_lower_request_can_be_answered_is_no_second_downgrade() -> None:
    state = at_level(1, settle_s=5.0)
    assert state.downgraded("b", 4.9) is None
    assert state.downgraded("b", 5.0) is Measure.ADAPT


def test_the_second_downgrade_slows_down_and_there_is_no_third_measure() -> None:
    state = at_level(1)
    state.granted("a", 1.0)
    assert state.downgraded("a", 2.0) is Measure.ADAPT
    assert state.downgraded("a", 50.0) is None
    assert state.level == 2


def test_a_lower_request_that_is_granted_is_a_new_operation_point() -> None:
    state = at_level(1)
    assert state.granted("a", 1.0) is None
    assert (state.level, state.is_short) == (1, False)


@pytest.mark.parametrize("level", [1, 2])
def test_when_the_network_has_recovered_all_is_taken_back(level: int) -> None:
    state = at_level(level)
    state.downgraded("b", 0.1)
    assert state.recovered("a", 5.0) is None
    assert state.granted("b", 6.0) is Measure.RESTORE
    assert (state.level, state.is_short) == (0, False)


def test_a_recovery_that_is_followed_by_a_downgrade_is_none() -> None:
    state = at_level(1)
    state.downgraded("b", 0.1)
    state.recovered("a", 0.2)
    state.downgraded("a", 0.3)
    assert state.granted("a", 0.4) is None
    assert state.granted("b", 0.5) is None
    assert state.level == 1


# -- what nobody says --------------------------------------------------------------------------------


def test_without_an_answer_to_the_lower_request_the_application_slows_down() -> None:
    state = at_level(1, patience_s=10.0)
    assert state.tick(9.9) is None
    assert state.tick(10.0) is Measure.ADAPT


def test_without_word_of_a_recovery_more_is_tried_step_by_step() -> None:
    state = at_level(2)
    state.granted("a", 1.0)
    assert state.tick(10.0) is Measure.RESTORE
    assert (state.level, state.is_trying) == (1, True)
    assert state.tick(20.0) is Measure.RAISE_REQUEST
    assert (state.level, state.is_alert) == (0, True)
    assert state.tick(30.0) is None
    assert not state.is_alert


def test_an_attempt_that_fails_is_taken_back_at_once_and_made_more_rarely() -> None:
    state = at_level(1, settle_s=8.0)
    state.granted("a", 1.0)
    assert state.tick(10.0) is Measure.RAISE_REQUEST
    assert state.downgraded("a", 10.5) is Measure.LOWER_REQUEST
    state.granted("a", 11.0)
    assert state.tick(30.0) is None
    assert state.tick(30.5) is Measure.RAISE_REQUEST


def test_who_is_slow_without_any_news_for_very_long_tries_more_too() -> None:
    state = at_level(2, patience_s=10.0)
    assert state.tick(159.0) is None
    assert state.tick(160.0) is Measure.RESTORE
    assert state.downgraded("a", 161.0) is Measure.ADAPT


def test_attempts_become_no_rarer_than_every_sixteenth_time() -> None:
    state, now_s = at_level(1), 0.0
    waits = []
    for _ in range(7):
        state.granted("a", now_s)
        began_s = now_s
        while state.tick(now_s) is None:
            now_s += 1.0
        waits.append(now_s - began_s)
        state.downgraded("a", now_s)
    assert waits == [10, 20, 40, 80, 160, 160, 160]


EVENTS = st.lists(
    st.tuples(
        st.sampled_from(["downgraded", "granted", "recovered", "tick"]),
        st.sampled_from(["a", "b"]),
        st.floats(0, 30),
    ),
    max_size=60,
)


@given(EVENTS)
def test_whatever_comes_and_gets_lost_the_levels_are_in_order_and_it_ends_well(
    events: list[tuple[str, str, float]],
) -> None:
    state, now_s = Depletion(1.0, 10.0), 0.0
    for what, topic, later_s in events:
        now_s, before = now_s + later_s, state.level
        measure = state.tick(now_s) if what == "tick" else getattr(state, what)(topic, now_s)
        moved = state.level - before
        match measure:
            case None:
                assert moved == 0
            case Measure.LOWER_REQUEST | Measure.ADAPT:
                assert (moved, state.level) == (1, 1 + (measure is Measure.ADAPT))
            case Measure.RAISE_REQUEST:
                assert (before, state.level) == (1, 0)
            case Measure.RESTORE:
                assert moved < 0
    # Then silence: nobody stays slow because a message is missing.
    for _ in range(6):
        now_s += 160.0
        state.tick(now_s)
        state.tick(now_s)
    assert (state.level, state.is_short) == (0, False)


# -- lower requests ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("traffic", "setting", "budget_ms", "qci"),
    [
        (POSE, START, 32.0, 84),
        (COMMAND, START, 200.0, 71),
        (POSE, Setting(3, 8, 2), 64.0, 75),
        (COMMAND, Setting(1, 3, 2), 200.0, 71),
    ],
)
def test_a_lower_request_is_one_for_another_class(
    traffic: TopicTraffic, setting: Setting, budget_ms: float, qci: int
) -> None:
    lower = lowered(traffic, setting)
    assert lower.delay_ms(traffic.rate_hz) == pytest.approx(budget_ms)
    assert request_of(traffic, lower).qci == qci
    assert request_of(traffic, setting).qci != qci
    assert (lower.drop, lower.speed) == (setting.drop, setting.speed)


def test_who_has_the_least_class_goes_one_notch_on() -> None:
    slow = TopicTraffic(0.5, 100.0, 1e-2)
    assert lowered(slow, START) == Setting(1, 0, 2)
    last = Setting(len(DELAYS) - 1, 0, 2)
    assert lowered(slow, last) == last


# -- the rate before the throttle --------------------------------------------------------------------


def test_the_rate_of_a_topic_is_counted_while_messages_are_left_out() -> None:
    rate = SourceRate(window_s=3.0)
    assert [rate.counted(20 * second, float(second)) for second in range(4)] == [0, 0, 0, 20]
    slow = [rate.counted(60 + 10 * second, 3.0 + second) for second in range(1, 5)]
    assert slow[-1] == pytest.approx(10)
    assert rate.counted(5, 8.0) == 0, "another relay counts anew"
    assert rate.counted(9, 8.0) == 0, "and nothing is divided by no time"
