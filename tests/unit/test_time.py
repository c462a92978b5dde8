from __future__ import annotations

import pytest
from google.protobuf.duration_pb2 import Duration as DurationMsg
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.msg import builtin_interfaces
from simple_ros.schedule import RateSchedule
from simple_ros.sim_time import ClockChange, SimTime, wants_sim_time
from simple_ros.time import (
    ClockType,
    ClockTypeMismatch,
    Duration,
    NegativeTime,
    Time,
    TimeOverflow,
)

S = 1_000_000_000
INT64 = st.integers(-(2**63), 2**63 - 1)
POSITIVE = st.integers(0, 2**63 - 1)


def test_from_seconds_keeps_every_digit_a_float_has() -> None:
    assert Time.of(1.5, 7).nanoseconds == 1_500_000_007
    assert Time.of(1_700_000_000, 1).nanoseconds == 1_700_000_000 * S + 1
    assert Duration.of(-0.25).nanoseconds == -250_000_000
    assert str(Duration.of(-1.5)) == "-1.500000000 s"
    assert Duration.of(2).seconds == 2.0


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), float("-inf")])
def test_seconds_that_are_none(seconds: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        Duration.of(seconds)


def test_arithmetic() -> None:
    begin, span = Time.of(10), Duration.of(2.5)
    assert begin + span == span + begin == Time.of(12.5)
    assert begin - span == Time.of(7.5)
    assert Time.of(12.5) - begin == span
    assert begin - Time.of(12.5) == -span
    assert span + span == span * 2 == 2 * span == Duration.of(5)
    assert span / 2 == Duration.of(1.25)
    assert span / Duration.of(0.5) == 5.0
    assert span * 0.1 == Duration.of(0.25)
    assert abs(-span) == span
    assert bool(span)
    assert not Duration()
    assert max(Time.of(1), Time.of(2)) == Time.of(2)
    assert Time.of(1) >= Time.of(1)
    assert Duration.of(1) < Duration.of(2)


def test_what_makes_no_sense_is_a_type_error() -> None:
    with pytest.raises(TypeError):
        Time.of(1) + Time.of(2)  # type: ignore[operator]
    with pytest.raises(TypeError):
        Time.of(1) + 1  # type: ignore[operator]
    with pytest.raises(TypeError):
        Duration.of(1) - Time.of(1)  # type: ignore[operator]
    with pytest.raises(TypeError):
        Duration.of(1) < 1  # type: ignore[operator]  # noqa: B015
    with pytest.raises(TypeError, match="whole nanoseconds"):
        Time(1.5)  # type: ignore[arg-type]


def test_a_time_is_never_negative() -> None:
    with pytest.raises(NegativeTime) as caught:
        Time.of(1) - Duration.of(2)
    assert caught.value.nanoseconds == -S
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, SimpleRosError)
    with pytest.raises(NegativeTime):
        Time.from_msg(Timestamp(seconds=-1))


def test_overflow() -> None:
    last = Duration(2**63 - 1)
    for attempt in (
        lambda: last + Duration(1),
        lambda: last * 2,
        lambda: Duration(1) * 1e300,
        lambda: Duration(1) * float("inf"),
        lambda: -Duration(-(2**63)),
        lambda: Time(2**63 - 1) + Duration(1),
        lambda: Duration.from_msg(DurationMsg(seconds=2**62)),
    ):
        with pytest.raises(TimeOverflow) as caught:
            attempt()
        assert isinstance(caught.value, OverflowError)
    with pytest.raises(ZeroDivisionError):
        last / 0


def test_clocks_are_not_mixed() -> None:
    ros, steady = Time.of(1), Time.of(1, clock_type=ClockType.STEADY_TIME)
    assert ros != steady
    for attempt in (lambda: ros < steady, lambda: ros >= steady, lambda: ros - steady):
        with pytest.raises(ClockTypeMismatch, match=r"ROS_TIME.*STEADY_TIME|STEADY_TIME.*ROS_TIME"):
            attempt()
    assert (steady + Duration.of(1)).clock_type is ClockType.STEADY_TIME


def test_they_are_values() -> None:
    time = Time.of(1)
    with pytest.raises(AttributeError):
        time.nanoseconds = 3  # type: ignore[misc]
    assert len({Time.of(1), Time.of(1.0), Time.of(2)}) == 2
    assert len({Duration.of(1), Duration.of(1.0)}) == 1


@given(POSITIVE)
def test_stamps_there_and_back(nanoseconds: int) -> None:
    time = Time(nanoseconds)
    message = time.to_msg()
    assert 0 <= message.nanos < S
    assert Time.from_msg(message) == time


@given(INT64)
def test_durations_there_and_back(nanoseconds: int) -> None:
    duration = Duration(nanoseconds)
    message = duration.to_msg()
    assert message.seconds * message.nanos >= 0, "both of one sign, as protobuf wants"
    assert abs(message.nanos) < S
    assert Duration.from_msg(message) == duration


@given(st.integers(-(2**31) * S, (2**31) * S - 1))
def test_ros2_form_there_and_back(nanoseconds: int) -> None:
    message = Duration(nanoseconds).to_builtin()
    assert 0 <= message.nanosec < S
    assert Duration.from_msg(message) == Duration(nanoseconds)
    if nanoseconds >= 0:
        assert Time.from_msg(Time(nanoseconds).to_builtin()) == Time(nanoseconds)


def test_ros2_form_ends_in_2038() -> None:
    assert Time.of(2**31 - 1, 999_999_999).to_builtin().sec == 2**31 - 1
    with pytest.raises(TimeOverflow, match="builtin_interfaces"):
        Time.of(2**31).to_builtin()
    with pytest.raises(TimeOverflow):
        Duration.of(-(2**31), -1).to_builtin()
    negative = Duration.of(-0.5).to_builtin()
    assert negative == builtin_interfaces.Duration(sec=-1, nanosec=500_000_000)


@given(POSITIVE, POSITIVE)
def test_difference_undoes_the_sum(left: int, right: int) -> None:
    first, second = Time(left), Time(right)
    assert second + (first - second) == first
    assert (first < second) is (left < right)
    assert (first <= second) is (left <= right)


def test_simulated_time_starts_goes_on_pauses_and_goes_back() -> None:
    sim = SimTime()
    assert (sim.nanoseconds, sim.seconds, sim.has_come) == (0, 0.0, False)
    assert sim.receive(1_700_000_000 * S) is ClockChange.STARTED
    assert sim.seconds == 0.0
    assert sim.receive(1_700_000_000 * S + 100_000_000) is ClockChange.TICK
    assert sim.seconds == 0.1
    assert sim.receive(sim.nanoseconds) is ClockChange.TICK
    assert sim.receive(1_699_999_999 * S) is ClockChange.JUMPED_BACK
    assert sim.seconds == -1.0
    assert [change for change in ClockChange if change.breaks] == [
        ClockChange.JUMPED_BACK,
        ClockChange.SWITCHED,
    ]


def test_simulated_time_may_start_at_zero() -> None:
    sim = SimTime()
    assert sim.receive(0) is ClockChange.STARTED
    assert sim.has_come


@pytest.mark.parametrize(
    ("setting", "wanted"),
    [(None, False), ("", False), ("0", False), (" No ", False), ("1", True), ("TRUE", True)],
)
def test_environment(setting: str | None, wanted: bool) -> None:
    assert wants_sim_time(setting, "X") is wanted


def test_environment_that_says_neither() -> None:
    with pytest.raises(ConfigError, match=r"SIM is 1 or 0 .* not 'maybe'"):
        wants_sim_time("maybe", "SIM")


def test_rate_keeps_its_phase_and_starts_over_when_late() -> None:
    rate = RateSchedule(10.0, 0.0)
    assert rate.turn_end(0.03) == pytest.approx(0.1)
    assert rate.turn_end(0.19) == pytest.approx(0.2)
    assert rate.turn_end(0.35) == pytest.approx(0.3), "late by less than a period: the phase stays"
    assert rate.turn_end(0.36) == pytest.approx(0.4)
    assert rate.turn_end(0.61) == pytest.approx(0.61), "late by more: starts over"
    assert rate.turn_end(0.62) == pytest.approx(0.71)


def test_rate_starts_over_when_its_clock_goes_back() -> None:
    rate = RateSchedule(10.0, 5.0)
    assert rate.turn_end(1.0) == pytest.approx(1.1)
    rate.restart(3.0)
    assert rate.turn_end(3.0) == pytest.approx(3.1)


@pytest.mark.parametrize("hz", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_rate(hz: float) -> None:
    with pytest.raises(ConfigError, match="rate"):
        RateSchedule(hz, 0.0)
