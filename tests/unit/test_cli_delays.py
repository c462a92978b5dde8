"""Delays, and what they tell of two clocks."""

from __future__ import annotations

import pytest
import typer

from simple_ros.cli.delays import Clocks, Way, delay_facts, delay_line, judge_clocks, offset_of
from simple_ros.cli.topic.delaying import parse_offset

HERE = Way(is_local=True)
NEAR = Way(round_trip_s=0.002)
HIDDEN = Way(problem="publishers are on several hosts")
TRUE = (0.004, 0.001, 0.002)
"""What messages on the way `NEAR` really take; the luckiest one half the round trip."""


def seen(ahead_s: float) -> list[float]:
    """The delays that a receiver sees whose clock is ahead by so much."""
    return [delay + ahead_s for delay in TRUE]


class TestJudgement:
    @pytest.mark.parametrize("ahead", [0.0, 7200.0, -7200.0, 0.25, -0.002])
    def test_the_offset_is_found(self, ahead: float) -> None:
        assert offset_of(seen(ahead), 0.002) == pytest.approx(ahead, abs=1e-9)

    @pytest.mark.parametrize(
        ("delays", "way", "clocks"),
        [
            (seen(0), NEAR, Clocks.AGREE),
            (seen(0.09), NEAR, Clocks.AGREE),  # a camera keeps a picture as long
            (seen(0.11), NEAR, Clocks.DIFFER),
            (seen(7200), NEAR, Clocks.DIFFER),
            (seen(-7200), NEAR, Clocks.DIFFER),
            (seen(-0.0015), NEAR, Clocks.AGREE),  # stamps are rounded
            (seen(-0.0025), NEAR, Clocks.DIFFER),
            ([1.0], Way(round_trip_s=0.1), Clocks.AGREE),  # a slow way has long queues
            ([2.2], Way(round_trip_s=0.1), Clocks.DIFFER),
            (seen(7200), HERE, Clocks.SAME),
            (seen(-7200), HERE, Clocks.SAME),
            (seen(7200), HIDDEN, Clocks.UNKNOWN),
            (seen(-7200), HIDDEN, Clocks.DIFFER),
        ],
    )
    def test_clocks(self, delays: list[float], way: Way, clocks: Clocks) -> None:
        assert judge_clocks(delays, way) is clocks

    def test_one_lucky_message_is_enough(self) -> None:
        assert judge_clocks([5.0, 9.0, 0.002], NEAR) is Clocks.AGREE


def line(delays: list[float], way: Way, offset: float | str = "none") -> str:
    facts = delay_facts(delays, way, offset)
    assert facts is not None
    return delay_line(facts, way.problem)


class TestLines:
    def test_none(self) -> None:
        assert delay_facts([], HERE) is None

    @pytest.mark.parametrize("offset", ["none", "auto"])
    def test_one_host_has_one_clock(self, offset: str) -> None:
        expected = "delay mean 2.000 ms min 1.000 ms max 3.000 ms, window 2"
        assert line([0.001, 0.003], HERE, offset) == expected

    def test_clocks_that_agree_are_not_spoken_of(self) -> None:
        assert line(seen(0), NEAR) == "delay mean 2.333 ms min 1.000 ms max 4.000 ms, window 3"

    def test_clocks_that_differ_are_told_with_both_readings(self) -> None:
        first, second = line(seen(7200), NEAR).splitlines()
        assert first == "delay mean 7200.002 s min 7200.001 s max 7200.004 s, window 3"
        assert second == (
            "  clocks differ by about 7200.000 s, this one is ahead, or stamps are that old when "
            "they are sent (min delay less half the round trip of 2.000 ms); without that: "
            "mean 2.333 ms min 1.000 ms max 4.000 ms"
        )
        other = line(seen(-7200), NEAR).splitlines()[1]
        assert other.startswith("  clocks differ by about 7200.000 s, this one is behind (min")

    def test_auto_subtracts_the_estimate_and_says_so(self) -> None:
        assert line(seen(-7200), NEAR, "auto") == (
            "delay mean 2.333 ms min 1.000 ms max 4.000 ms, window 3, "
            "less -7200.000 s between the clocks (estimated), raw mean -7199.998 s"
        )

    def test_a_known_offset(self) -> None:
        assert line(seen(0.5), NEAR, 0.5) == (
            "delay mean 2.333 ms min 1.000 ms max 4.000 ms, window 3, "
            "less 500.000 ms between the clocks, raw mean 502.333 ms"
        )

    def test_negative_without_a_way_to_tell_by_how_much(self) -> None:
        assert line([-0.5], HIDDEN).splitlines()[1] == (
            "  negative: the clocks differ, this is not valid "
            "(by how much is not known: publishers are on several hosts)"
        )
        assert "\n" not in line([0.5], HIDDEN, "auto")

    def test_stamps_in_the_future_on_one_host(self) -> None:
        assert line([-0.5], HERE).endswith("negative: messages are stamped with a time to come")


class TestFacts:
    def test_every_key_is_always_there(self) -> None:
        ways = (HERE, NEAR, HIDDEN)
        found = [delay_facts(seen(9), way, offset) for way in ways for offset in ("none", "auto")]
        keys = {tuple(facts) for facts in found if facts is not None}
        assert keys == {
            (
                "mean_ms",
                "min_ms",
                "max_ms",
                "window",
                "clocks",
                "round_trip_ms",
                "offset_estimate_ms",
                "offset",
                "offset_applied_ms",
                "corrected_mean_ms",
                "corrected_min_ms",
                "corrected_max_ms",
            )
        }

    def test_raw_values_stay_raw(self) -> None:
        facts = delay_facts(seen(9), NEAR, "auto")
        assert facts is not None
        assert facts["min_ms"] == pytest.approx(9001)
        assert facts["offset_applied_ms"] == facts["offset_estimate_ms"] == pytest.approx(9000)
        assert facts["corrected_min_ms"] == pytest.approx(1)


class TestOffsetOption:
    def test_words_and_seconds(self) -> None:
        assert parse_offset("none") == "none"
        assert parse_offset("auto") == "auto"
        assert parse_offset("-0.25") == -0.25

    @pytest.mark.parametrize("text", ["", "chrony", "nan", "inf", "1s"])
    def test_anything_else(self, text: str) -> None:
        with pytest.raises(typer.BadParameter):
            parse_offset(text)
