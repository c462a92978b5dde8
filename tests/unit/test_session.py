from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from simple_ros.qos import LATCHED
from simple_ros.wire.session import (
    Backoff,
    EndpointKey,
    EndpointKind,
    Expectation,
    Registrations,
    Target,
    TargetSet,
)

OURS = Target("10.0.0.1", 1000, "ours", instance_id="i1", topic="t")
FOREIGN = Target("10.0.0.2", 2000, "foreign", topic="t")


def test_backoff_grows_to_its_limit_and_starts_over() -> None:
    backoff = Backoff(0.1, 0.5)
    assert [backoff.next_delay() for _ in range(4)] == [0.1, 0.2, 0.4, 0.5]
    backoff.reset()
    assert backoff.next_delay() == 0.1


def test_targets_come_and_go() -> None:
    targets = TargetSet()
    assert targets.apply([OURS, FOREIGN]).opened == [OURS, FOREIGN]
    assert targets.apply([OURS]).opened == []
    assert targets.apply([], [FOREIGN]).closed == [FOREIGN]
    assert targets.apply([], [FOREIGN]).closed == []
    assert targets.targets == (OURS,)


def test_another_request_of_the_same_target_keeps_its_link() -> None:
    targets = TargetSet()
    targets.apply([OURS])
    demanding = replace(OURS, qos=LATCHED)
    changes = targets.apply([demanding])
    assert (changes.closed, changes.opened, changes.updated) == ([], [], [demanding])
    assert targets.targets == (demanding,)


def test_same_address_is_the_same_target_whatever_the_name() -> None:
    targets = TargetSet()
    targets.apply([FOREIGN])
    renamed = Target(FOREIGN.ip, FOREIGN.port, "other", topic="t")
    changes = targets.apply([renamed])
    assert (changes.closed, changes.opened) == ([FOREIGN], [renamed])
    assert len(targets) == 1


def test_a_late_goodbye_of_a_predecessor_leaves_its_successor() -> None:
    targets = TargetSet()
    successor = Target(OURS.ip, OURS.port, "ours", instance_id="i2", topic="t")
    targets.apply([successor])
    assert targets.apply([], [OURS]).closed == []
    assert targets.apply([], [successor]).closed == [successor]


def test_snapshot_is_everybody() -> None:
    targets = TargetSet()
    targets.apply([OURS, FOREIGN])
    changes = targets.apply([FOREIGN], snapshot=True)
    assert (changes.closed, changes.opened) == ([OURS], [])


def test_links_outlive_a_restart_of_the_master() -> None:
    targets = TargetSet()
    targets.apply([OURS, FOREIGN])
    targets.reregistered()
    assert targets.apply([]).closed == []
    changes = targets.drop_unconfirmed()
    assert changes.closed == [OURS], "ours would have registered again"
    assert targets.targets == (FOREIGN,), "a foreign node never does"


def test_a_confirmed_target_is_dialled_again_an_unconfirmed_one_given_up() -> None:
    targets = TargetSet()
    targets.apply([OURS, FOREIGN])
    targets.reregistered()
    targets.apply([OURS])
    assert targets.link_broke(OURS.key).closed == []
    assert targets.link_broke(FOREIGN.key).closed == [FOREIGN]


updates = st.lists(
    st.tuples(
        st.lists(st.sampled_from([OURS, FOREIGN]), max_size=2),
        st.lists(st.sampled_from([OURS, FOREIGN]), max_size=2),
        st.booleans(),
    ),
    max_size=10,
)


@given(updates)
def test_changes_always_add_up(steps: list[tuple[list[Target], list[Target], bool]]) -> None:
    targets, open_now = TargetSet(), set[Target]()
    for add, remove, snapshot in steps:
        changes = targets.apply(add, remove, snapshot=snapshot)
        for target in changes.closed:
            open_now.remove(target)
        for target in changes.opened:
            assert target not in open_now
            open_now.add(target)
        assert open_now == set(targets.targets)
        assert set(add) <= open_now


A = EndpointKey(EndpointKind.PUBLISHER, "a", "x.A")
B = EndpointKey(EndpointKind.SUBSCRIBER, "b", "x.B")


def test_every_master_is_told_everything_wanted() -> None:
    wishes = Registrations()
    wishes.want(A)
    wishes.want(B)
    told = []
    while (key := wishes.next_registration()) is not None:
        told.append(key)
        wishes.told(key)
    assert told == [A, B]
    wishes.master_changed()
    assert wishes.next_registration() == A


def test_farewell_only_if_told() -> None:
    wishes = Registrations()
    wishes.want(A)
    wishes.unwant(A)
    assert (wishes.next_registration(), wishes.next_farewell()) == (None, None)
    wishes.want(B)
    wishes.told(B)
    wishes.unwant(B)
    assert wishes.next_farewell() == B
    wishes.farewell_said(B)
    assert (wishes.next_farewell(), wishes.is_told(B)) == (None, False)


def test_a_wish_renewed_before_the_farewell_is_told_after_it() -> None:
    """Otherwise the newcomer would never be pushed its targets."""
    wishes = Registrations()
    wishes.want(A)
    wishes.told(A)
    wishes.unwant(A)
    wishes.want(A)
    assert not wishes.is_told(A)
    assert wishes.next_farewell() == A
    wishes.farewell_said(A)
    assert wishes.next_registration() == A


def test_a_wish_taken_back_while_it_was_told_is_due_a_farewell() -> None:
    wishes = Registrations()
    wishes.want(A)
    wishes.unwant(A)
    wishes.told(A)
    assert wishes.next_farewell() == A


def test_what_has_changed_is_told_anew() -> None:
    wishes = Registrations()
    wishes.want(A)
    wishes.told(A)
    wishes.want_anew(A)
    assert wishes.next_registration() == A


def test_expectation_counts_whole_periods() -> None:
    expectation = Expectation(1.0, now=0.0)
    assert expectation.overdue(0.9) == 0
    assert expectation.overdue(3.5) == 3
    assert expectation.overdue(3.6) == 0
    expectation.happened(3.7)
    assert expectation.due == 4.7
    assert expectation.misses == 3
