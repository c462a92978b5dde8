"""Strategies: how to send on a link, what is allowed, how well it went. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace

__all__ = [
    "RECOMMENDATIONS",
    "STRATEGY_TYPES",
    "Bounds",
    "Strategy",
    "recommended",
    "score",
    "validated",
]


@dataclass(frozen=True, slots=True)
class Strategy:
    """How to send.

    Attributes:
        mcs: Scheme to ask for.
        prb: Resource blocks to ask for.
        compression_ratio: Bytes out per byte in; small is strong.
        priority: 1 lowest to 5.
        retransmission_enabled: Whether lost blocks are repeated.
        max_harq_retx: How often at most.
        strategy_type: Name of the trade-off.
        rate_bps: What the application may send.
        action: How it was chosen.
    """

    mcs: int
    prb: int
    compression_ratio: float
    priority: int
    retransmission_enabled: bool
    max_harq_retx: int
    strategy_type: str
    rate_bps: float
    action: str = ""


@dataclass(frozen=True, slots=True)
class Bounds:
    """What a strategy may say.

    Attributes:
        max_mcs: Last index of the link's table.
        n_prb: Blocks of the carrier, or what the hub granted.
        max_retx: Most repetitions.
    """

    max_mcs: int = 28
    n_prb: int = 51
    max_retx: int = 4


STRATEGY_TYPES: dict[str, tuple[int, int, str]] = {
    "HIGH_QUALITY": (5, 4, "HIGH_THROUGHPUT"),
    "STANDARD": (4, 3, "BALANCED"),
    "BALANCED": (3, 2, "RELIABILITY"),
    "REDUCED": (2, 1, "LOW_LATENCY"),
    "MINIMUM": (1, 0, "EMERGENCY"),
    "CRITICAL_HIGH_QUALITY": (5, 4, "CRITICAL_THROUGHPUT"),
    "CRITICAL_STANDARD": (5, 4, "CRITICAL_BALANCED"),
    "CRITICAL_BALANCED": (5, 3, "CRITICAL_RELIABILITY"),
    "CRITICAL_REDUCED": (4, 2, "CRITICAL_LOW_LATENCY"),
    "CRITICAL_MINIMUM": (3, 1, "CRITICAL_EMERGENCY"),
    "EMERGENCY_HIGH_QUALITY": (5, 3, "EMERGENCY_THROUGHPUT"),
    "EMERGENCY_STANDARD": (4, 2, "EMERGENCY_BALANCED"),
    "EMERGENCY_BALANCED": (3, 2, "EMERGENCY_RELIABILITY"),
    "EMERGENCY_REDUCED": (2, 1, "EMERGENCY_LOW_LATENCY"),
    "EMERGENCY_MINIMUM": (1, 0, "CRITICAL_EMERGENCY"),
}
"""Priority, repetitions and type of a strategy, by type of constraint."""

UNKNOWN_TYPE = (3, 2, "BALANCED")

RECOMMENDATIONS = {
    "EXCELLENT": "MAXIMIZE_DATA_COLLECTION",
    "GOOD": "NORMAL_OPERATION",
    "FAIR": "MODERATE_CONSERVATION",
    "POOR": "SIGNIFICANT_REDUCTION",
    "BAD": "EMERGENCY_CONSERVATION",
}
"""What to do at a level of network quality; without one: MAINTAIN_CURRENT."""

# Change of scheme, blocks, compression ratio, repetitions, priority; least ratio.
_EFFECTS: dict[str, tuple[int, int, float, int, int, float]] = {
    "MAXIMIZE_DATA_COLLECTION": (1, 10, 0.1, 0, 0, 0.05),
    "MODERATE_CONSERVATION": (-1, 0, 0.0, 1, 0, 0.05),
    "SIGNIFICANT_REDUCTION": (-2, -20, -0.2, 0, 0, 0.3),
    "EMERGENCY_CONSERVATION": (-4, -30, -0.3, 0, -2, 0.2),
}


def recommended(strategy: Strategy, recommendation: str) -> Strategy:
    """The strategy after a recommendation; unknown ones change nothing."""
    effect = _EFFECTS.get(recommendation)
    if effect is None:
        return strategy
    mcs, prb, ratio, retx, priority, least = effect
    return replace(
        strategy,
        mcs=max(0, strategy.mcs + mcs),
        prb=max(5 if prb < 0 else 1, strategy.prb + prb),
        compression_ratio=min(1.0, max(least, strategy.compression_ratio + ratio)),
        max_harq_retx=strategy.max_harq_retx + retx,
        priority=max(1, strategy.priority + priority),
    )


def validated(strategy: Strategy, bounds: Bounds) -> tuple[Strategy, tuple[str, ...]]:
    """The nearest strategy that is allowed, and the names of what had to change."""
    kept = replace(
        strategy,
        mcs=_within(strategy.mcs, 0, bounds.max_mcs),
        prb=_within(strategy.prb, 0, bounds.n_prb),
        compression_ratio=min(1.0, max(0.05, strategy.compression_ratio)),
        priority=_within(strategy.priority, 1, 5),
        max_harq_retx=_within(strategy.max_harq_retx, 0, bounds.max_retx),
        rate_bps=max(0.0, strategy.rate_bps),
    )
    names = ("mcs", "prb", "compression_ratio", "priority", "max_harq_retx", "rate_bps")
    return kept, tuple(name for name in names if getattr(kept, name) != getattr(strategy, name))


def _within(value: int, low: int, high: int) -> int:
    return max(low, min(high, value))


def score(bler: float, efficiency: float, carried_bps: float, offered_bps: float | None) -> float:
    """How well a strategy did, 0..1: 0.4 reliability, 0.3 efficiency, 0.3 throughput.

    Args:
        bler: Share of blocks lost; 0.1 and more earn nothing.
        efficiency: Bits per resource element; 5 and more are full marks.
        carried_bps: What went through.
        offered_bps: What there was to send; a robot that sends nothing loses nothing. None: unknown, then
            20 Mbit/s are full marks.
    """
    reliability = 1 - min(1.0, bler * 10)
    wanted = 20e6 if offered_bps is None else offered_bps
    throughput = 1.0 if wanted <= 0 else min(1.0, carried_bps / wanted)
    return 0.4 * reliability + 0.3 * min(1.0, efficiency / 5) + 0.3 * throughput
