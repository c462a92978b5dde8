"""How much of a board's samples comes through a bad line, in simulated time."""

from __future__ import annotations

import pytest
from support.pico_line import Line, Outcome, Run

FAST_S = 0.0005
SLOW_S = 20 * FAST_S
SEED = 20261122


def outcome(**line: float) -> Outcome:
    return Run(Line(**line), SEED).run(20)


@pytest.mark.parametrize("command_hz", [20, 100])
@pytest.mark.parametrize("delay_s", [FAST_S, SLOW_S])
def test_five_of_a_hundred_messages_lost_each_way(delay_s: float, command_hz: float) -> None:
    ideal = outcome(delay_s=delay_s, command_hz=command_hz)
    lossy = outcome(delay_s=delay_s, command_hz=command_hz, loss=0.05)
    assert lossy.published >= 0.85 * ideal.published
    assert lossy.failed == 0
    assert lossy.sends_per_message <= 1.3
    assert lossy.received in (lossy.published, lossy.published + 1)


@pytest.mark.parametrize("command_hz", [20, 100])
def test_one_of_a_hundred_chunks_with_a_flipped_bit(command_hz: float) -> None:
    ideal = outcome(command_hz=command_hz)
    bad = outcome(command_hz=command_hz, chunk_errors=0.01)
    assert bad.published >= 0.98 * ideal.published
    assert bad.failed == 0


@pytest.mark.parametrize("delay_s", [FAST_S, SLOW_S, 100 * FAST_S])
def test_a_clean_line_is_not_flooded(delay_s: float) -> None:
    clean = outcome(delay_s=delay_s)
    assert clean.failed == 0
    assert clean.sends_per_message <= 1.05
    assert clean.questions <= 0.1 * clean.answers


def test_a_quiet_board_is_not_asked_for_ever() -> None:
    run = Run(Line(), SEED)
    run.run(1)
    run.due = [1e9] * len(run.due)
    run.line.command_hz = 1e-6
    before = run.agent.session
    assert before is not None
    asked = before.streams.inputs[0].counters.asked
    end = run.now + 60
    while run.now < end:
        run.step(run.now + 1)
        run.pump()
    assert before.streams.inputs[0].counters.asked - asked <= 10
    assert run.agent.next_timeout() is None
