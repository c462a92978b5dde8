"""When the Master dials a node, what it sends after a break, and when it gives a node up."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.names import MAX_NAME_BYTES
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import link as link_module
from simple_ros_master.link import PushLink, frame_of


def refusals_until_dead(link: PushLink, limit: int = 100) -> list[float]:
    """Dial as often as the link wants until it gives up; the times at which it was refused."""
    times = []
    for _ in range(limit):
        times.append(link.dial_at)
        if link.failed(link.dial_at, refused=True):
            return times
    raise AssertionError("never given up")


# -- frames ----------------------------------------------------------------------------------------


def test_an_update_without_a_topic_travels_under_a_stand_in():
    frame = frame_of(ros.TopicTargetsUpdate())
    assert frame == (b"\x00\x15__master_topic_update\x00\x12TopicTargetsUpdate\x00\x00\x00\x00")


def test_a_topic_too_long_for_the_header_is_only_in_the_update():
    topic = "x" * (MAX_NAME_BYTES + 1)
    frame = frame_of(ros.TopicTargetsUpdate(topic=topic))
    assert frame.startswith(b"\x00\x15__master_topic_update")
    assert topic.encode() in frame


def test_frames_leave_in_order_and_about_as_many_as_wanted():
    link = PushLink(0.0)
    for number in range(5):
        link.push(b"%d." % number, 0.0)
    assert link.take(3) == b"0.1."
    assert link.take(100) == b"2.3.4."
    assert link.take(100) == b""


@given(st.lists(st.binary(min_size=1, max_size=9), max_size=30), st.integers(1, 20))
def test_nothing_is_lost_whatever_the_writes(frames, limit):
    link = PushLink(0.0)
    for frame in frames:
        link.push(frame, 0.0)
    written = b""
    while data := link.take(limit):
        written += data
    assert written == b"".join(frames)


def test_frames_that_were_never_handed_over_survive_a_break():
    link = PushLink(0.0)
    link.connected(0.0)
    link.lost(0.1)
    link.push(b"a", 0.2)
    link.connected(0.3)
    assert not link.needs_resync
    assert link.take(10) == b"a"


def test_after_a_break_that_may_have_lost_frames_everything_is_said_anew():
    link = PushLink(0.0)
    link.push(b"a", 0.0)
    link.connected(0.0)
    assert link.take(10) == b"a"
    link.lost(0.1)
    assert link.needs_resync
    link.push(b"part of the resync", 0.2)
    link.connected(0.3)
    link.resync([b"all", b"of it"])
    link.push(b"later", 0.4)
    assert link.take(100) == b"allof itlater"


@pytest.mark.parametrize(("limit", "frame"), [("MAX_FRAMES", b"x"), ("MAX_BYTES", b"x" * 10)])
def test_a_node_that_takes_nothing_costs_bounded_memory(monkeypatch, limit, frame):
    monkeypatch.setattr(link_module, limit, 20)
    link = PushLink(0.0)
    for _ in range(100):
        link.push(frame, 0.0)
    assert link.needs_resync
    assert link.take(100) == b""
    link.resync([b"all"])
    assert link.take(100) == b"all"


# -- dialling --------------------------------------------------------------------------------------


def test_a_node_that_never_listens_has_three_seconds():
    link = PushLink(10.0)
    link.watch(10.0)
    times = refusals_until_dead(link)
    assert times == pytest.approx([10.0, 10.1, 10.3, 10.7, 11.5, 12.5, 13.0])


def test_each_registration_starts_the_patience_anew():
    link = PushLink(0.0)
    link.watch(0.0)
    assert not link.failed(2.9, refused=True)
    link.watch(2.95)
    assert link.dial_at == 2.95
    assert not link.failed(3.5, refused=True)
    assert link.failed(5.95, refused=True)


def test_a_node_that_did_listen_is_given_up_after_two_refusals():
    link = PushLink(0.0)
    link.watch(0.0)
    link.connected(0.0)
    link.lost(100.0)
    assert link.dial_at == 100.0
    assert refusals_until_dead(link) == pytest.approx([100.0, 100.3])


def test_a_node_that_accepts_again_lives():
    link = PushLink(0.0)
    link.watch(0.0)
    link.connected(0.0)
    link.lost(50.0)
    assert not link.failed(50.0, refused=True)
    link.connected(50.3)
    link.lost(100.0)
    assert not link.failed(100.0, refused=True)
    assert link.failed(100.3, refused=True)


def test_a_node_that_closes_every_connection_lives_and_is_dialled_ever_slower():
    link = PushLink(0.0)
    link.watch(0.0)
    delays = []
    for _ in range(7):
        now = link.dial_at
        link.connected(now)
        link.lost(now)
        delays.append(link.dial_at - now)
    assert delays == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.0, 1.0, 1.0])


def test_a_push_need_not_wait_for_a_node_that_only_hung_up():
    link = PushLink(0.0)
    link.connected(0.0)
    link.lost(0.01)
    link.push(b"a", 0.02)
    assert link.dial_at == 0.02
    link.failed(0.02, refused=True)
    link.push(b"b", 0.03)
    assert link.dial_at > 0.1


def test_nobody_is_given_up_who_is_not_watched():
    link = PushLink(0.0)
    with pytest.raises(AssertionError, match="never given up"):
        refusals_until_dead(link)
    link.watch(link.dial_at)
    link.unwatch()
    with pytest.raises(AssertionError, match="never given up"):
        refusals_until_dead(link)


def test_trouble_of_our_own_is_no_verdict():
    link = PushLink(0.0)
    link.watch(0.0)
    link.connected(0.0)
    link.lost(5.0)
    assert not any(link.failed(5.0 + n, refused=False) for n in range(20))


def test_a_verdict_is_given_once():
    link = PushLink(0.0)
    link.watch(0.0)
    refusals_until_dead(link)
    assert not link.failed(link.dial_at, refused=True)
