"""How often to repeat what was lost: pure.

Only the network can set HARQ; without control over it the number is advice, and what an application can
set is how often it repeats by itself.
"""

from __future__ import annotations

__all__ = ["advised_retransmissions", "residual_loss"]


def advised_retransmissions(
    current: int,
    *,
    enabled: bool,
    bler: float,
    bler_stability: float,
    criticality: float,
    most: int = 4,
) -> int:
    """Repetitions to allow.

    Args:
        current: What the strategy has now.
        enabled: Whether repetitions are on at all; if not, nothing changes.
        bler: Mean share of first transmissions lost; above 0.15 one more, below 0.01 one less if stable.
        bler_stability: 0..1; stable above 0.8.
        criticality: Of the task, 0..1; above 0.8 one more.
        most: Never more than this.
    """
    if not enabled:
        return current
    advised = current
    if bler > 0.15:
        advised += 1
    elif bler < 0.01 and bler_stability > 0.8:
        advised -= 1
    if criticality > 0.8:
        advised += 1
    return max(0, min(most, advised))


def residual_loss(bler: float, retransmissions: int, combining: float = 0.25) -> float:
    """Share of blocks lost after all repetitions.

    Args:
        bler: Of the first transmission.
        retransmissions: Repetitions allowed.
        combining: What each repetition multiplies the loss by, relative to the one before, because the
            receiver adds up what it got.
    """
    loss, chance = bler, bler
    for _ in range(retransmissions):
        chance *= combining
        loss *= chance
    return loss
