"""Tracks, commands and budgets of cells: pure."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros_engines.cross_domain.mappings import ControlLimits
from simple_ros_hub.cells.teleop import HOLD, CommandGuard, Velocity
from simple_ros_hub.cells.topic_cell import Budget
from simple_ros_hub.cells.track import Track

LIMITS = ControlLimits(1.0, 20.0, 0.5)


@given(st.lists(st.integers(), max_size=300), st.integers(4, 50))
def test_a_track_keeps_order_begin_and_end(items: list[int], limit: int) -> None:
    track: Track[tuple[int, int]] = Track(limit)
    for pair in enumerate(items):
        track.add(pair)
    kept = track.take()
    assert len(kept) <= limit
    assert len(kept) + track.thinned == len(items)
    assert kept == sorted(kept)
    if items:
        assert kept[0][0] == 0
        assert kept[-1][0] == len(items) - 1
    assert len(track) == 0


def test_commands_are_limited_in_speed_but_keep_their_curve() -> None:
    guard = CommandGuard(LIMITS)
    kept = guard.command(Velocity(3.0, 4.0, 1.0), 0)
    assert kept is not None
    assert math.hypot(kept.forward, kept.left) == pytest.approx(1.0)
    assert kept.turn / kept.forward == pytest.approx(1.0 / 3.0)
    assert guard.limited == 1
    assert guard.command(Velocity(0.2, 0, 2.0), 1) == Velocity(0.2, 0, 2.0)


def test_commands_that_come_too_often_are_thinned_but_never_a_stop() -> None:
    guard = CommandGuard(LIMITS)
    passed = [guard.command(Velocity(0.5, 0, 0), at / 100) for at in range(100)]
    assert 18 <= sum(item is not None for item in passed) <= 24
    assert guard.command(HOLD, 0.991) == HOLD


def test_silence_holds_once() -> None:
    guard = CommandGuard(LIMITS)
    assert guard.tick(0) is None
    guard.command(Velocity(0.5, 0, 0), 0)
    assert guard.tick(0.4) is None
    assert guard.tick(0.6) == HOLD
    assert guard.tick(0.7) is None
    assert guard.holds == 1
    guard.command(Velocity(0.5, 0, 0), 1.0)
    assert not guard.is_holding
    assert guard.hold() == HOLD
    assert guard.hold() is None


def test_no_number_holds() -> None:
    guard = CommandGuard(LIMITS)
    guard.command(Velocity(0.5, 0, 0), 0)
    assert guard.command(Velocity(math.nan, 0, 0), 0.2) == HOLD


def test_a_budget_is_a_share_of_the_narrowest_limit() -> None:
    budget = Budget(0.5)
    assert budget.bytes_per_s == 0
    budget.limit("constraint", 8e6)
    budget.limit("grant", 4e6)
    assert budget.bytes_per_s == 250_000
    budget.limit("grant", 0)
    assert budget.bytes_per_s == 500_000
    budget.min_priority = 4
    assert not budget.allows(3)
    assert budget.allows(4)
