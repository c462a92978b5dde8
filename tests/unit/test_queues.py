from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from simple_ros.wire.queues import BoundedQueue


def test_oldest_is_dropped_and_counted() -> None:
    queue: BoundedQueue[int] = BoundedQueue(3, 1000)
    assert [queue.push(i, 1) for i in range(1, 6)] == [0, 0, 0, 1, 1]
    assert queue.take(0.0, 1000) == [3, 4, 5]
    assert queue.dropped == 2


def test_bytes_bound_but_one_large_item_is_held() -> None:
    queue: BoundedQueue[str] = BoundedQueue(100, 10)
    queue.push("small", 4)
    queue.push("huge", 50)
    assert (len(queue), queue.size_bytes, queue.dropped) == (1, 50, 1)
    assert queue.pop(0.0) == "huge"


def test_what_is_too_old_is_not_handed_out() -> None:
    queue: BoundedQueue[str] = BoundedQueue(10, 1000)
    queue.push("old", 1, expires_at=5.0)
    queue.push("new", 1, expires_at=9.0)
    assert queue.pop(6.0) == "new"
    assert (queue.expired, queue.pop(6.0)) == (1, None)


def test_take_stops_at_the_byte_budget_but_gives_at_least_one() -> None:
    queue: BoundedQueue[int] = BoundedQueue(10, 1000)
    for i in range(4):
        queue.push(i, 40)
    assert queue.take(0.0, 100) == [0, 1]
    assert queue.take(0.0, 1) == [2]


@given(
    st.integers(1, 5),
    st.integers(1, 40),
    st.lists(st.one_of(st.integers(0, 30), st.none()), max_size=60),
)
def test_nothing_is_lost_uncounted_and_bounds_hold(
    depth: int, max_bytes: int, steps: list[int | None]
) -> None:
    queue: BoundedQueue[int] = BoundedQueue(depth, max_bytes)
    pushed = popped = 0
    for size in steps:
        if size is None:
            popped += queue.pop(0.0) is not None
            continue
        room = queue.has_room(size)
        dropped = queue.push(pushed, size)
        pushed += 1
        assert not (room and dropped)
        assert len(queue) <= depth
        assert queue.size_bytes <= max_bytes or len(queue) == 1
    assert pushed == popped + queue.dropped + len(queue)
    assert queue.clear() + popped + queue.dropped >= pushed
    assert queue.size_bytes == 0


@given(
    st.lists(st.lists(st.integers(1, 40), max_size=8), max_size=6),
    st.integers(1, 10),
    st.integers(1, 200),
)
def test_pushing_all_is_pushing_one_after_the_other(
    batches: list[list[int]], depth: int, max_bytes: int
) -> None:
    together: BoundedQueue[int] = BoundedQueue(depth, max_bytes)
    singly: BoundedQueue[int] = BoundedQueue(depth, max_bytes)
    for batch in batches:
        dropped = together.push_all(batch, batch, 5.0)
        assert dropped == sum(singly.push(size, size, 5.0) for size in batch)
        assert together.size_bytes == singly.size_bytes
        assert together.dropped == singly.dropped
    assert together.take(0.0, 10**6) == singly.take(0.0, 10**6)
    assert together.size_bytes == 0
