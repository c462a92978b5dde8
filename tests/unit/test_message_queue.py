from __future__ import annotations

import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros.message_queue import MessageQueue


def test_every_callback_of_a_topic_gets_every_message_in_order() -> None:
    queue, got = MessageQueue(), []
    queue.add_subscriber("/t", lambda m: got.append(("a", m)))
    queue.add_subscriber("t", lambda m: got.append(("b", m)))
    queue.push("t", 1)
    queue.push("/t", 2)
    assert queue.process_callbacks() == 4
    assert [m for who, m in got if who == "a"] == [1, 2]
    assert [m for who, m in got if who == "b"] == [1, 2]
    assert queue.process_callbacks() == 0


def test_the_oldest_fall_at_the_bound() -> None:
    queue, got = MessageQueue(), []
    queue.set_topic_max_queue_size("t", 3)
    token = queue.add_subscriber("t", got.append)
    for i in range(1, 6):
        queue.push("t", i)
    queue.process_callbacks()
    assert got == [3, 4, 5]
    assert token.dropped == 2


def test_a_hundred_wait_by_default() -> None:
    queue, got = MessageQueue(), []
    queue.add_subscriber("t", got.append)
    for i in range(150):
        queue.push("t", i)
    queue.process_callbacks()
    assert got == list(range(50, 150))


def test_a_registered_topic_keeps_messages_for_its_first_subscriber() -> None:
    queue, got = MessageQueue(), []
    queue.register_topic("t")
    queue.push("t", 1)
    queue.add_subscriber("t", got.append)
    queue.process_callbacks()
    assert got == [1]


def test_an_unregistered_topic_drops_and_says_so(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    MessageQueue().push("nowhere", 1)
    assert "'nowhere'" in caplog.text


def test_removing_one_subscriber_leaves_the_others_and_by_name_removes_all() -> None:
    queue, got = MessageQueue(), []
    first = queue.add_subscriber("t", lambda m: got.append(("first", m)))
    queue.add_subscriber("t", lambda m: got.append(("second", m)))
    queue.push("t", 1)
    queue.remove_subscriber(first)
    queue.process_callbacks()
    assert got == [("second", 1)]
    queue.push("t", 2)
    queue.remove_subscriber("/t")
    assert queue.process_callbacks() == 0


def test_callbacks_may_push_subscribe_and_remove() -> None:
    queue, got = MessageQueue(), []

    def callback(message: int) -> None:
        got.append(message)
        if message == 1:
            queue.push("t", 2)
            queue.add_subscriber("t", lambda m: got.append(m * 10))
        if message == 3:
            queue.remove_subscriber(token)

    token = queue.add_subscriber("t", callback)
    queue.push("t", 1)
    assert queue.process_callbacks() == 1
    assert queue.process_callbacks() == 1
    assert got == [1, 2]
    for message in (3, 4):
        queue.push("t", message)
    queue.process_callbacks()
    assert got == [1, 2, 3, 30, 40]


def test_a_callback_that_raises_takes_nobody_along() -> None:
    queue, got = MessageQueue(), []

    def bad(message: int) -> None:
        raise ZeroDivisionError

    token = queue.add_subscriber("t", bad)
    queue.add_subscriber("t", got.append)
    queue.push("t", 1)
    assert queue.process_callbacks() == 2
    assert got == [1]
    assert token.guard.errors == 1


def test_a_bound_below_one_has_no_meaning() -> None:
    with pytest.raises(ConfigError, match="at least 1"):
        MessageQueue().set_topic_max_queue_size("t", 0)


@given(st.lists(st.tuples(st.sampled_from("ab"), st.booleans()), max_size=60), st.integers(1, 5))
def test_nothing_is_lost_uncounted(steps: list[tuple[str, bool]], depth: int) -> None:
    queue = MessageQueue()
    got: dict[str, list[int]] = {"a": [], "b": []}
    pushed = {"a": 0, "b": 0}
    tokens = {topic: queue.add_subscriber(topic, got[topic].append, depth=depth) for topic in "ab"}
    for topic, process in steps:
        if process:
            queue.process_callbacks()
        else:
            queue.push(topic, pushed[topic])
            pushed[topic] += 1
    queue.process_callbacks()
    for topic in "ab":
        assert got[topic] == sorted(got[topic])
        assert len(got[topic]) + tokens[topic].dropped == pushed[topic]
