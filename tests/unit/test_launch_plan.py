"""Start order, readiness, restarts and giving up, with time as an argument."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros.launch.description import ProcessDescription, Ready, ReadyWhen
from simple_ros.launch.errors import UnknownProcess
from simple_ros.launch.events import Ended, Exit, GivenUp, IsReady, NotReady, Restarting, Started
from simple_ros.launch.output import LineSplitter
from simple_ros.launch.plan import Plan, State
from simple_ros.launch.restart import GiveUp, Respawn, RestartHistory, RestartIn

NOTIFY = Ready(ReadyWhen.NOTIFY)


def process(name: str, after: tuple[str, ...] = (), **more: object) -> ProcessDescription:
    return ProcessDescription(name, ("p",), after=after, **more)  # type: ignore[arg-type]


def plan_of(*processes: ProcessDescription) -> Plan:
    plan = Plan()
    for one in processes:
        plan.add(one)
    for one in processes:
        plan.start(one.name)
    return plan


class TestRestarts:
    def test_the_delay_doubles_up_to_a_maximum_and_then_it_is_given_up(self) -> None:
        history = RestartHistory(Respawn(limit=4, within_s=60, delay_s=1, max_delay_s=3))
        decisions = [history.failed(0.1) for _ in range(4)]
        assert [d.delay_s for d in decisions if isinstance(d, RestartIn)] == [1, 2, 3, 3]
        assert history.failed(0.1) == GiveUp("restarted 4 times within 60 s of running")
        history.forget()
        assert history.failed(0.1) == RestartIn(1, 1, 4)

    def test_rare_failures_are_never_given_up(self) -> None:
        history = RestartHistory(Respawn(limit=1, within_s=10, delay_s=0.5))
        assert all(history.failed(11.0) == RestartIn(0.5, 1, 1) for _ in range(100))

    def test_no_respawn(self) -> None:
        assert isinstance(RestartHistory(None).failed(5.0), GiveUp)
        with pytest.raises(ConfigError):
            Respawn(limit=-1)

    @given(st.integers(0, 20), st.floats(0, 100))
    def test_one_that_always_crashes_is_given_up(self, limit: int, delay_s: float) -> None:
        history = RestartHistory(Respawn(limit, 60.0, delay_s, 100.0))
        assert [isinstance(history.failed(0.0), GiveUp) for _ in range(limit + 1)].index(
            True
        ) == limit


def test_each_starts_when_those_before_it_are_ready() -> None:
    plan = plan_of(process("c", ("a", "b")), process("a", ready=NOTIFY), process("b"))
    assert plan.take_starts() == ["a", "b"]
    assert plan.status("c").detail == "for a, b"
    plan.started("a", 1, 0.0)
    plan.started("b", 2, 0.0)
    assert plan.status("c").detail == "for a"
    plan.ready("a", 0.5)
    assert plan.take_starts() == ["c"]
    assert plan.take_events() == [
        Started("a", 1, 0),
        Started("b", 2, 0),
        IsReady("b", 0.0),
        IsReady("a", 0.5),
    ]


def test_a_job_is_ready_when_it_has_ended_well() -> None:
    plan = plan_of(process("job", ready=Ready(ReadyWhen.ENDED)), process("a", ("job",)))
    plan.started("job", 1, 0.0)
    assert plan.next_timeout() is None
    assert plan.take_starts() == ["job"]
    plan.ended("job", Exit(0), 100.0)
    assert plan.take_starts() == ["a"]


def test_who_comes_after_what_is_given_up_is_given_up() -> None:
    plan = plan_of(process("c", ("b",)), process("b", ("a",)), process("a", ready=NOTIFY))
    plan.started("a", 1, 0.0)
    plan.ended("a", Exit(3), 1.0)
    given_up = [event.name for event in plan.take_events() if isinstance(event, GivenUp)]
    assert given_up == ["a", "b", "c"]
    verdict = plan.verdict()
    assert verdict is not None
    assert verdict.has_failed
    assert plan.has_failed


def test_restarts_wait_their_delay() -> None:
    plan = plan_of(process("a", respawn=Respawn(limit=1, delay_s=2.0)))
    plan.take_starts()
    plan.started("a", 1, 0.0)
    plan.ended("a", Exit(-9), 5.0)
    assert plan.take_events()[-2:] == [Ended("a", Exit(-9), False), Restarting("a", 2.0, 1, 1)]
    assert plan.next_timeout() == 7.0
    plan.handle_timeout(6.9)
    assert plan.take_starts() == []
    plan.handle_timeout(7.0)
    assert plan.take_starts() == ["a"]
    plan.started("a", 2, 7.1)
    assert plan.status("a").restarts == 1
    plan.ended("a", Exit(1, "no more processes"), 7.2)
    assert plan.status("a").state is State.GIVEN_UP
    assert "could not be started: no more processes" in plan.status("a").detail


def test_a_good_end_is_an_end_unless_it_shall_always_run() -> None:
    plan = plan_of(process("a", respawn=Respawn()), process("b", respawn=Respawn(always=True)))
    for name in plan.take_starts():
        plan.started(name, 1, 0.0)
        plan.ended(name, Exit(0), 1.0)
    assert [status.state for status in plan.statuses()] == [State.ENDED, State.RESTARTING]


def test_being_late_is_told_and_ends_all_if_required() -> None:
    plan = plan_of(
        process("a", ready=NOTIFY, ready_timeout_s=3.0, required=True), process("b", ("a",))
    )
    plan.started("a", 1, 1.0)
    assert plan.verdict() is None
    plan.handle_timeout(4.0)
    assert plan.take_events()[-1] == NotReady("a", 3.0, "notify", ("b",))
    verdict = plan.verdict()
    assert verdict is not None
    assert verdict.reason == "a, which is required, not ready after 3 s"
    plan.ready("a", 5.0)
    assert plan.verdict() is None


def test_required_ones_end_all_and_background_ones_are_not_waited_for() -> None:
    plan = plan_of(process("a", required=True), process("b"))
    plan.started("a", 1, 0.0)
    plan.ended("a", Exit(0), 1.0)
    verdict = plan.verdict()
    assert verdict is not None
    assert not verdict.has_failed
    plan = plan_of(process("master"), process("b"))
    plan.started("b", 1, 0.0)
    plan.ended("b", Exit(0), 1.0)
    assert plan.verdict() is None
    assert plan.verdict({"master"}) is not None


def test_stopping_is_no_failure_and_starting_meanwhile_is_remembered() -> None:
    plan = plan_of(process("a", respawn=Respawn()), process("b", ("a",)))
    plan.take_starts()
    plan.started("a", 1, 0.0)
    plan.stop("a")
    plan.start("a")
    plan.ended("a", Exit(-15), 1.0)
    assert "a" in plan.take_starts()
    plan.stop("b")
    assert plan.status("b").state in (State.ENDED, State.STOPPING)
    with pytest.raises(UnknownProcess, match=r"did you mean 'a'|known are a, b"):
        plan.start("x")


@given(st.lists(st.text("ab\n", max_size=5)))
def test_lines_do_not_depend_on_how_they_arrive(chunks: list[str]) -> None:
    splitter = LineSplitter()
    lines = [line for chunk in chunks for line in splitter.feed(chunk.encode())]
    text = "".join(chunks)
    expected = text.split("\n") if text else []
    assert lines + splitter.finish() == (
        expected[:-1] if expected and not expected[-1] else expected
    )


def test_a_line_without_end_is_cut() -> None:
    splitter = LineSplitter(limit=4)
    assert splitter.feed(b"abcdefghij") == ["abcd", "efgh"]
    assert splitter.finish() == ["ij"]
