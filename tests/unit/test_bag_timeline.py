"""When messages are due, with time as an argument."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.bag import PlayOptions
from simple_ros.bag.timeline import Timeline
from simple_ros.errors import ConfigError

S = 10**9


def test_runs_at_its_rate() -> None:
    timeline = Timeline(100 * S, now=5.0, rate=2.0)
    assert timeline.position_ns(6.0) == 102 * S
    assert timeline.due(104 * S) == 7.0
    assert timeline.due(98 * S) == 4.0


def test_stands_still_while_paused() -> None:
    timeline = Timeline(0, now=0.0, paused=True)
    assert timeline.is_paused
    assert timeline.position_ns(50.0) == 0
    assert timeline.due(1) == math.inf
    timeline.resume(50.0)
    timeline.resume(51.0)
    assert timeline.position_ns(52.0) == 2 * S
    timeline.pause(53.0)
    timeline.pause(60.0)
    assert timeline.position_ns(70.0) == 3 * S


def test_seeks_and_changes_its_rate_in_its_course() -> None:
    timeline = Timeline(0, now=0.0)
    timeline.set_rate(4.0, now=1.0)
    assert timeline.position_ns(1.0) == S
    assert timeline.position_ns(2.0) == 5 * S
    timeline.seek(100 * S, now=2.0)
    assert timeline.due(104 * S) == 3.0
    assert timeline.rate == 4.0


@pytest.mark.parametrize("rate", [0.0, -1.0, math.inf, math.nan])
def test_a_rate_is_a_positive_number(rate: float) -> None:
    with pytest.raises(ConfigError):
        Timeline(0, 0.0, rate=rate)
    with pytest.raises(ConfigError):
        Timeline(0, 0.0).set_rate(rate, 0.0)


@given(
    st.integers(0, 2 * 10**18),
    st.floats(0.01, 100),
    st.lists(st.tuples(st.floats(0, 10), st.sampled_from(["pause", "resume", "rate"]))),
)
def test_never_runs_backwards_and_agrees_with_itself(
    start: int, rate: float, deeds: list[tuple[float, str]]
) -> None:
    timeline, now = Timeline(start, 0.0, rate=rate), 0.0
    before = start
    for wait, deed in deeds:
        now += wait
        if deed == "rate":
            timeline.set_rate(rate, now)
        else:
            getattr(timeline, deed)(now)
        position = timeline.position_ns(now)
        assert position >= before
        before = position
    if not timeline.is_paused:
        assert timeline.due(before + S) == pytest.approx(now + 1 / rate, abs=1e-6)


class TestOptions:
    def test_new_names(self) -> None:
        options = PlayOptions(remap={"/a": "b", "c": "/d/e"})
        assert [options.new_name(name) for name in ("a", "c", "x")] == ["b", "d/e", "x"]

    @pytest.mark.parametrize(
        "wrong", [{"rate": 0.0}, {"clock_hz": -1.0}, {"duration_s": 0.0}, {"start_offset_s": -1.0}]
    )
    def test_out_of_range(self, wrong: dict[str, float]) -> None:
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            PlayOptions(**wrong)  # type: ignore[arg-type]
