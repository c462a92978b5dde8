from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from simple_ros.foxglove.frames import Level
from simple_ros.foxglove.queue import OVERHEAD_BYTES, FairQueue
from simple_ros.foxglove.rates import RateLimit
from simple_ros.foxglove.slowness import BUFFER_FULL, SlowNotice

SMALL, IMAGES, MAP = 1, 2, 3
BIG = 100_000


def queue(max_bytes: int = 1_000_000) -> FairQueue[str]:
    made: FairQueue[str] = FairQueue(max_bytes)
    for key in (SMALL, IMAGES, MAP):
        made.open(key)
    return made


def all_of(made: FairQueue[str]) -> list[tuple[int, str]]:
    found = []
    while made:
        found += made.take(1)
    return found


def test_order_within_a_channel() -> None:
    made = queue()
    for number in range(5):
        made.push(SMALL, str(number), 10)
    assert [item for _, item in made.take(10**6)] == list("01234")
    assert not made
    assert made.size_bytes == 0


def test_small_messages_do_not_stand_in_line() -> None:
    made = queue()
    for number in range(5):
        made.push(IMAGES, f"image {number}", BIG)
    for number in range(3):
        made.push(SMALL, f"small {number}", 10)
    order = [item for _, item in all_of(made)]
    assert order.index("small 2") <= 6
    assert order[-1] == "image 4"


def test_the_largest_gives_first() -> None:
    made = queue(10 * BIG)
    for number in range(1000):
        made.push(SMALL, str(number), 50)
    dropped = sum(made.push(IMAGES, str(number), BIG) for number in range(50))
    assert made.size_bytes <= 10 * BIG
    assert dropped > 40
    assert made.dropped == {IMAGES: dropped}
    kept = [(key, item) for key, item in all_of(made)]
    assert [item for key, item in kept if key == SMALL] == [str(n) for n in range(1000)]
    assert [item for key, item in kept if key == IMAGES][-1] == "49"  # the newest stay


def test_latched_ones_give_last() -> None:
    made = queue(3 * BIG)
    made.spare(MAP)
    made.push(MAP, "map", 2 * BIG)
    for number in range(10):
        made.push(IMAGES, str(number), BIG // 2)
    assert ("map") in [item for _, item in all_of(made)]


def test_when_all_are_spared_something_falls_all_the_same() -> None:
    made = queue(10_000)
    for number in range(1000):
        made.push(SMALL, str(number), 10)
    assert made.size_bytes <= 10_000
    assert all_of(made)[-1] == (SMALL, "999")


def test_more_than_the_budget_never_waits() -> None:
    made = queue(1000)
    assert made.push(IMAGES, "image", 2000) == 1
    assert not made
    assert made.dropped == {IMAGES: 1}


def test_only_the_newest() -> None:
    made: FairQueue[str] = FairQueue(10**6)
    made.open(IMAGES, limit=1)
    for number in range(5):
        assert made.push(IMAGES, str(number), 10) == 0
    assert all_of(made) == [(IMAGES, "4")]


def test_a_closed_channel_takes_its_messages_along() -> None:
    made = queue()
    made.push(SMALL, "a", 10)
    made.push(IMAGES, "b", 10)
    made.close(SMALL)
    made.close(SMALL)
    assert made.size_bytes == 10 + OVERHEAD_BYTES
    assert all_of(made) == [(IMAGES, "b")]


def test_clear() -> None:
    made = queue()
    made.push(SMALL, "a", 10)
    made.clear()
    assert (bool(made), made.size_bytes, made.waiting) == (False, 0, 0)
    made.push(SMALL, "b", 10)
    assert all_of(made) == [(SMALL, "b")]


@given(
    st.lists(
        st.tuples(st.sampled_from(["push", "take"]), st.integers(1, 3), st.integers(0, 3000)),
        max_size=100,
    )
)
def test_the_budget_holds_and_sums_are_right(steps: list[tuple[str, int, int]]) -> None:
    made = queue(5000)
    pushed = fell = taken = 0
    for what, key, size in steps:
        if what == "push":
            pushed += 1
            fell += made.push(key, "x", size)
        else:
            taken += len(made.take(size))
        assert 0 <= made.size_bytes <= 5000
        assert bool(made) == (made.waiting > 0)
        assert pushed == fell + taken + made.waiting


# -- what slow clients are told --------------------------------------------------------------------


def test_told_at_once_then_rarely_then_taken_back() -> None:
    notice = SlowNotice()
    assert notice.tick(0.0) is None
    first = notice.dropped(10.0)
    assert first is not None
    assert BUFFER_FULL in first
    assert f'"level":{int(Level.WARNING)}' in first
    assert notice.dropped(11.0) is None
    assert notice.dropped(12.4) is None
    assert notice.dropped(12.6) == first
    assert notice.tick(17.5) is None
    assert notice.tick(17.6) == '{"op":"removeStatus","statusIds":["slow-client"]}'
    assert notice.tick(20.0) is None
    assert notice.dropped(20.0) == first


# -- rates -----------------------------------------------------------------------------------------


def test_a_rate_that_divides() -> None:
    limit = RateLimit(10)
    passed = [n for n in range(1000) if limit.passes(n / 1000)]
    assert len(passed) in (10, 11)


def test_a_rate_above_the_flow_changes_nothing() -> None:
    limit = RateLimit(60)
    assert all(limit.passes(n / 50) for n in range(500))


def test_after_a_pause_nothing_is_caught_up() -> None:
    limit = RateLimit(10)
    assert limit.passes(0.0)
    assert limit.passes(100.0)
    assert not limit.passes(100.01)
