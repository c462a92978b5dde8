from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.wire.calls import (
    AdaptiveTimeout,
    CallQueue,
    Deadlines,
    RttEstimator,
    pack_cancel,
    pack_request,
    pack_response,
    unpack_cancel,
    unpack_request,
    unpack_response,
)

numbers = st.integers(0, 2**64 - 1)


@given(numbers, st.integers(1, 2**32 - 1), st.integers(0, 255), st.binary(max_size=50))
def test_a_request_comes_back_as_it_was(number: int, ms: int, priority: int, data: bytes) -> None:
    request = unpack_request(memoryview(pack_request(number, ms / 1000, priority, data)))
    assert (request.id, request.priority, bytes(request.payload)) == (number, priority, data)
    assert request.timeout_s == pytest.approx(ms / 1000)


def test_no_time_limit_is_none_and_the_shortest_is_not_for_ever() -> None:
    assert unpack_request(memoryview(pack_request(1, None, 0, b""))).timeout_s is None
    assert unpack_request(memoryview(pack_request(1, 1e-9, 0, b""))).timeout_s == 0.001
    assert unpack_request(memoryview(pack_request(1, 1e12, 0, b""))).timeout_s > 4e6


@given(numbers, st.integers(0, 255), st.binary(max_size=50))
def test_a_response_comes_back_as_it_was(number: int, status: int, data: bytes) -> None:
    found = unpack_response(memoryview(pack_response(number, status, data)))
    assert (found[0], found[1], bytes(found[2])) == (number, status, data)
    assert unpack_cancel(pack_cancel(number)) == number


@given(st.binary(max_size=8))
def test_what_is_too_short_is_told(data: bytes) -> None:
    with pytest.raises(ValueError, match=f"of {len(data)} bytes"):
        unpack_request(memoryview(data))
    with pytest.raises(ValueError, match=f"of {len(data)} bytes"):
        unpack_response(memoryview(data))
    if len(data) != 8:
        with pytest.raises(ValueError, match=f"of {len(data)} bytes"):
            unpack_cancel(data)


def test_the_round_trip_is_estimated_as_tcp_does() -> None:
    rtt = RttEstimator()
    policy = AdaptiveTimeout(min_s=0.01, max_s=10, initial_s=3, factor=1)
    assert rtt.timeout_s(policy) == 3
    rtt.measured(0.1)
    assert (rtt.srtt_s, rtt.rttvar_s) == (0.1, 0.05)
    assert rtt.timeout_s(policy) == pytest.approx(0.3)
    rtt.measured(0.2)
    assert rtt.rttvar_s == pytest.approx(0.75 * 0.05 + 0.25 * 0.1)
    assert rtt.srtt_s == pytest.approx(0.1125)
    before = rtt.timeout_s(policy)
    rtt.timed_out()
    rtt.timed_out()
    assert rtt.timeout_s(policy) == pytest.approx(4 * before)
    for _ in range(20):
        rtt.timed_out()
    assert rtt.timeout_s(policy) == 10
    rtt.measured(0.1)
    assert rtt.timeout_s(policy) < 1


def test_a_steady_round_trip_ends_at_the_minimum() -> None:
    rtt = RttEstimator()
    for _ in range(200):
        rtt.measured(0.001)
    assert rtt.timeout_s(AdaptiveTimeout(min_s=0.2)) == 0.2


@pytest.mark.parametrize("wrong", [{"min_s": 0}, {"max_s": 0.1}, {"factor": 0.5}])
def test_an_adaptive_timeout_that_makes_no_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="needs"):
        AdaptiveTimeout(**wrong)


@given(st.lists(st.tuples(st.floats(0, 100), st.booleans()), max_size=200))
def test_deadlines_come_in_order_and_removed_ones_never(calls: list[tuple[float, bool]]) -> None:
    deadlines = Deadlines()
    for number, (due, _) in enumerate(calls):
        deadlines.add(number, due)
    for number, (_, removed) in enumerate(calls):
        if removed:
            deadlines.remove(number)
    left = sorted((due, number) for number, (due, removed) in enumerate(calls) if not removed)
    assert deadlines.next_due == (left[0][0] if left else None)
    early = deadlines.overdue(50)
    assert early == [number for due, number in left if due <= 50]
    assert deadlines.overdue(1000) == [number for due, number in left if due > 50]
    assert deadlines.next_due is None


def test_calls_wait_by_priority_then_in_order() -> None:
    queue: CallQueue[str] = CallQueue(4)
    for item, priority in [("a", 0), ("b", 5), ("c", 0), ("d", 5)]:
        assert queue.push(item, priority)
    assert not queue.push("e", 9)
    assert [queue.pop() for _ in range(len(queue))] == ["b", "d", "a", "c"]
