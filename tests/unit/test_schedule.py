from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros.schedule import TimerSchedule

REAL = 1024.25


def fire(schedule: TimerSchedule, now: float, took: float = 0.0) -> float:
    event = schedule.fire(now, REAL + now)
    assert event is not None
    schedule.called(now + took, took)
    return event.expected_real - REAL


def test_first_call_after_one_period_then_in_phase() -> None:
    schedule = TimerSchedule(0.1)
    schedule.start(0.0)
    assert schedule.due == pytest.approx(0.1)
    assert schedule.fire(0.05, REAL) is None
    assert fire(schedule, 0.13) == pytest.approx(0.1)
    assert schedule.due == pytest.approx(0.2)


def test_slow_callback_skips_periods_without_a_burst() -> None:
    schedule = TimerSchedule(0.02)
    schedule.start(0.0)
    now, calls = 0.02, 0
    while now < 1.0:
        fire(schedule, now, took=0.1)
        calls += 1
        assert schedule.due is not None
        now = max(now + 0.1, schedule.due)
    assert calls == pytest.approx(10, abs=1)


def test_event_has_fractions_of_seconds() -> None:
    schedule = TimerSchedule(0.5)
    schedule.start(0.0)
    first = schedule.fire(0.5, REAL + 0.5)
    assert first is not None
    assert first.last_real == 0.0
    schedule.called(0.51, 0.0123)
    second = schedule.fire(1.25, REAL + 1.25)
    assert second is not None
    assert second.current_real == REAL + 1.25
    assert second.last_real == REAL + 0.5
    assert second.expected_real == pytest.approx(REAL + 1.0)
    assert second.last_duration == 0.0123


def test_one_shot_fires_once_and_is_armed_anew_by_start() -> None:
    schedule = TimerSchedule(1.0, oneshot=True)
    schedule.start(0.0)
    fire(schedule, 1.0)
    assert schedule.due is None
    schedule.start(5.0)
    assert schedule.due == 6.0


def test_pause_and_resume() -> None:
    periodic, once = TimerSchedule(1.0), TimerSchedule(1.0, oneshot=True)
    for schedule in (periodic, once):
        schedule.start(0.0)
        schedule.pause(0.7)
        assert schedule.due is None
        schedule.start(0.8)
        assert schedule.due is None, "start does not end a pause"
        schedule.resume(2.0)
    assert periodic.due == 3.0
    assert once.due == pytest.approx(2.3)
    periodic.stop()
    periodic.resume(4.0)
    assert periodic.due is None


def test_new_period_starts_over() -> None:
    schedule = TimerSchedule(1.0)
    schedule.set_period(2.0, 0.0)
    assert schedule.due is None
    schedule.start(0.0)
    schedule.set_period(0.5, 0.9)
    assert schedule.due == 1.4


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_period(period: float) -> None:
    with pytest.raises(ConfigError, match="period"):
        TimerSchedule(period)


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=50))
def test_never_earlier_than_its_phase_and_never_twice_in_a_period(durations: list[float]) -> None:
    schedule = TimerSchedule(0.1)
    schedule.start(0.0)
    slots = []
    now = 0.0
    for took in durations:
        assert schedule.due is not None
        now = max(now, schedule.due)
        slots.append(round(fire(schedule, now, took) / 0.1))
        now += took
    assert slots == sorted(set(slots))
