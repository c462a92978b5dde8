"""What an action server keeps of its goals: policies, cancel requests, results and their bounds."""

from __future__ import annotations

import pytest

from simple_ros.actions.book import GoalBook, GoalPolicy, GoalRecord
from simple_ros.actions.states import GoalEvent, GoalState
from simple_ros.errors import ConfigError, InvalidGoalTransition


def goal_id(number: int) -> bytes:
    return number.to_bytes(16, "big")


def accepted(book: GoalBook, *numbers: int) -> list[GoalRecord]:
    found = []
    for number in numbers:
        assert book.refusal(goal_id(number)) == ""
        found.append(book.accept(goal_id(number), 1000 * number))
    return found


def ended(book: GoalBook, record: GoalRecord, now: float = 0.0) -> None:
    if record.state is GoalState.ACCEPTED:
        book.step(record, GoalEvent.EXECUTE, now)
    book.step(record, GoalEvent.SUCCEED, now)


def test_an_id_is_16_bytes_that_nobody_else_has() -> None:
    book = GoalBook("parallel")
    for wrong in (b"", bytes(16), b"x" * 15, b"x" * 17):
        assert "16 bytes" in book.refusal(wrong)
    (record,) = accepted(book, 1)
    assert "already" in book.refusal(goal_id(1))
    ended(book, record)
    assert "already" in book.refusal(goal_id(1))


@pytest.mark.parametrize(
    "wrong", [{"policy": "latest"}, {"result_timeout_s": -1.0}, {"max_goals": 0}]
)
def test_settings_without_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        GoalBook(**({"policy": "queue"} | wrong))  # type: ignore[arg-type]


class TestPolicies:
    def test_parallel_starts_every_goal_at_once(self) -> None:
        book = GoalBook("parallel")
        goals = accepted(book, 1, 2, 3)
        assert book.start_next() == goals
        assert {goal.state for goal in goals} == {GoalState.EXECUTING}
        assert book.superseded(goals[2]) == []

    def test_queue_starts_one_after_the_other(self) -> None:
        book = GoalBook("queue")
        first, second, third = accepted(book, 1, 2, 3)
        assert book.start_next() == [first]
        assert book.start_next() == []
        book.step(second, GoalEvent.CANCEL_GOAL, 0.0)
        book.step(second, GoalEvent.CANCELED, 0.0)
        assert book.start_next() == []
        ended(book, first)
        assert book.start_next() == [third]

    def test_reject_takes_one_at_a_time(self) -> None:
        book = GoalBook("reject")
        (first,) = accepted(book, 1)
        assert f"goal {goal_id(1).hex()} is under way" in book.refusal(goal_id(2))
        ended(book, first)
        assert book.refusal(goal_id(2)) == ""

    def test_preempt_lets_the_newest_go_first_once_the_others_have_ended(self) -> None:
        book = GoalBook("preempt")
        (first,) = accepted(book, 1)
        assert book.start_next() == [first]
        (second,) = accepted(book, 2)
        assert book.superseded(second) == [first]
        book.step(first, GoalEvent.CANCEL_GOAL, 0.0)
        (third,) = accepted(book, 3)
        assert book.superseded(third) == [second]
        book.step(second, GoalEvent.CANCEL_GOAL, 0.0)
        book.step(second, GoalEvent.CANCELED, 0.0)
        assert book.start_next() == []
        book.step(first, GoalEvent.CANCELED, 0.0)
        assert book.start_next() == [third]

    @pytest.mark.parametrize("policy", ["parallel", "queue", "preempt"])
    def test_goals_under_way_are_bounded(self, policy: GoalPolicy) -> None:
        book = GoalBook(policy, max_goals=2)
        accepted(book, 1, 2)
        assert "2 goals are under way" in book.refusal(goal_id(3))


class TestCancelRequests:
    """As `action_msgs/CancelGoal` of ROS 2 has it."""

    def book(self) -> tuple[GoalBook, list[GoalRecord]]:
        book = GoalBook("parallel")
        records = accepted(book, 1, 2, 3)
        ended(book, records[1])
        return book, records

    def test_nothing_named_means_all(self) -> None:
        book, (first, _, third) = self.book()
        assert book.to_cancel(b"", 0) == ([first, third], "")
        assert book.to_cancel(bytes(16), 0) == ([first, third], "")

    def test_a_goal_means_that_one(self) -> None:
        book, (_, _, third) = self.book()
        assert book.to_cancel(goal_id(3), 0) == ([third], "")
        assert book.to_cancel(goal_id(2), 0) == ([], "terminated")
        assert book.to_cancel(goal_id(9), 0) == ([], "unknown")

    def test_a_time_means_those_accepted_until_then(self) -> None:
        book, (first, _, third) = self.book()
        assert book.to_cancel(b"", 2999) == ([first], "")
        assert book.to_cancel(b"", 3000) == ([first, third], "")
        assert book.to_cancel(b"", 1) == ([], "")

    def test_both_mean_both(self) -> None:
        book, (first, _, third) = self.book()
        assert book.to_cancel(goal_id(3), 1000) == ([first, third], "")
        assert book.to_cancel(goal_id(1), 1000) == ([first], "")


class TestResults:
    def test_they_are_kept_for_their_time(self) -> None:
        book = GoalBook("parallel", result_timeout_s=10.0)
        first, second = accepted(book, 1, 2)
        ended(book, first, 5.0)
        ended(book, second, 8.0)
        assert book.expire(14.9) == 15.0
        assert book.find(goal_id(1)) is first
        assert book.expire(15.0) == 18.0
        assert book.find(goal_id(1)) is None
        assert book.expire(18.0) is None
        assert book.refusal(goal_id(1)) == ""

    def test_of_too_many_the_fetched_go_first_then_the_oldest(self) -> None:
        book = GoalBook("parallel", max_results=2)
        records = accepted(book, 1, 2, 3, 4)
        ended(book, records[0])
        ended(book, records[1])
        records[1].fetched = True
        ended(book, records[2])
        assert [book.find(goal_id(n)) is not None for n in (1, 2, 3)] == [True, False, True]
        ended(book, records[3])
        assert [book.find(goal_id(n)) is not None for n in (1, 2, 3, 4)] == [
            *(False, False),
            *(True, True),
        ]
        assert list(book.last_ended(1)) == [records[3]]

    def test_a_goal_ends_once(self) -> None:
        book = GoalBook("parallel")
        (record,) = accepted(book, 1)
        ended(book, record)
        with pytest.raises(InvalidGoalTransition):
            book.step(record, GoalEvent.ABORT, 0.0)
        assert book.active == ()
