"""Scores: estimated, given, which of them counts."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.mos.board import MOST_GROUPS, Board
from simple_ros_engines.network_exposure.mos.estimator import BEST, WORST, Estimator, is_score
from simple_ros_engines.network_exposure.mos.judgements import Judge, Judgements

numbers = st.floats(allow_nan=True, allow_infinity=True)


@given(numbers, numbers, st.floats(0, 100), st.floats(0, 10))
def test_a_score_is_one_to_five(error: float, progress: float, wanted: float, age: float) -> None:
    assert is_score(Estimator().score(error, progress, wanted, age))


def test_who_is_exact_and_fast_gets_five_and_who_crawls_does_not() -> None:
    judge = Estimator(0.15)
    assert judge.score(0.0, 1.0, 1.0) == BEST
    assert judge.score(0.0, 0.01, 1.0) == pytest.approx(1.04)
    assert judge.score(0.15, 1.0, 1.0) == pytest.approx(3.0)
    assert judge.score(0.0, 3.0, 1.0) == BEST
    assert judge.score(0.0, -1.0, 1.0) == WORST
    assert judge.score(0.0, 1.0, 1.0, age_s=1.5) == WORST
    assert judge.score(math.nan, 1.0, 1.0) == WORST
    # Two that both crawl are both judged to crawl.
    assert judge.score(0.0, 0.1, 1.0) < 1.5


def test_an_estimator_needs_numbers() -> None:
    with pytest.raises(ConfigError, match="positive"):
        Estimator(tolerance_m=0)


def test_people_win_over_programs() -> None:
    known = Judgements(timeout_s=5)
    topics = ["/turtle1/pose", "turtle1/cmd_vel"]
    assert known.came("turtle1", topics, 4.9, Judge.AUTOMATIC, 0.0)
    assert known.came("left one", topics[:1], 2.0, Judge.HUMAN, 1.0)
    assert known.came("turtle1", topics, 5.0, Judge.AUTOMATIC, 2.0)
    first = known.of("turtle1/pose", 3.0)
    assert first is not None
    assert (first.judge, first.score) == (Judge.HUMAN, 2.0)
    other = known.of("/turtle1/cmd_vel", 3.0)
    assert other is not None
    assert other.judge is Judge.AUTOMATIC
    assert known.of("turtle2/pose", 3.0) is None


def test_scores_end() -> None:
    known = Judgements(timeout_s=5)
    known.came("g", ["a"], 3.0, Judge.HUMAN, 0.0)
    known.came("g", ["a"], 0.0, Judge.HUMAN, 1.0)
    assert known.of("a", 1.0) is None
    known.came("g", ["a"], 3.0, Judge.HUMAN, 1.0)
    assert known.of("a", 6.0) is not None
    assert known.of("a", 6.1) is None
    assert not known.came("g", ["a"], 5.1, Judge.HUMAN, 7.0)
    assert not known.came("g", ["a"], math.nan, Judge.HUMAN, 7.0)


def board() -> Board:
    made = Board()
    made.flows_are(["a", "b", "c"])
    return made


def test_a_topic_is_in_one_group() -> None:
    made = board()
    made.command({"op": "group", "name": " one ", "topics": ["a", "b", "a"]}, 0.0)
    assert made.groups["one"].topics == ("a", "b")
    made.command({"op": "group", "name": "two", "topics": ["b", "c"]}, 0.0)
    assert made.groups["one"].topics == ("a",)
    made.command({"op": "group", "name": "three", "topics": ["a"]}, 0.0)
    assert "one" not in made.groups


def test_stars_are_given_and_taken_back() -> None:
    made = board()
    made.command({"op": "group", "name": "one", "topics": ["a"]}, 0.0)
    assert made.command({"op": "rate", "name": "one", "stars": 4}, 7.0) == "one has 4 stars"
    assert (made.groups["one"].stars, made.groups["one"].rated_s) == (4.0, 7.0)
    made.command({"op": "withdraw", "name": "one"}, 8.0)
    assert made.groups["one"].stars == 0
    made.command({"op": "ungroup", "name": "one"}, 9.0)
    assert made.groups == {}


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ({"op": "group", "name": "", "topics": ["a"]}, "name"),
        ({"op": "group", "name": 3, "topics": ["a"]}, "name"),
        ({"op": "group", "name": "x" * 65, "topics": ["a"]}, "name"),
        ({"op": "group", "name": "n", "topics": []}, "needs topics"),
        ({"op": "group", "name": "n", "topics": "a"}, "needs topics"),
        ({"op": "group", "name": "n", "topics": ["a", "z"]}, "hands on z"),
        ({"op": "group", "name": "n", "topics": [["a"]]}, "hands on"),
        ({"op": "rate", "name": "g", "stars": 6}, "1 to 5"),
        ({"op": "rate", "name": "g", "stars": True}, "1 to 5"),
        ({"op": "rate", "name": "g"}, "1 to 5"),
        ({"op": "rate", "name": "other", "stars": 3}, "no group 'other'"),
        ({"op": "ungroup", "name": "other"}, "no group"),
        ({"op": "fly", "name": "g"}, "unknown operation"),
    ],
)
def test_nonsense_is_told(said: dict[str, object], why: str) -> None:
    made = board()
    made.command({"op": "group", "name": "g", "topics": ["a"]}, 0.0)
    with pytest.raises(ConfigError, match=why):
        made.command(said, 0.0)
    assert made.groups["g"].stars == 0


def test_groups_are_bounded() -> None:
    made = Board()
    made.flows_are([f"t{n}" for n in range(MOST_GROUPS + 1)])
    for number in range(MOST_GROUPS):
        made.command({"op": "group", "name": f"g{number}", "topics": [f"t{number}"]}, 0.0)
    with pytest.raises(ConfigError, match="already"):
        made.command({"op": "group", "name": "more", "topics": [f"t{MOST_GROUPS}"]}, 0.0)


def test_silent_topics_stay() -> None:
    made = board()
    made.measured("a", 10.0, 100.0, 0.01)
    made.flows_are(["b"])
    assert not made.topics["a"].is_flowing
    assert made.topics["b"].is_flowing
