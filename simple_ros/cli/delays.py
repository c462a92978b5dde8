"""How late messages are, and whether the clocks behind that number agree.

A delay is the receiver's clock at arrival less the publisher's clock in the stamp: the true delay
plus the difference of the clocks. One way alone cannot tell the two apart. What can be measured
without the publisher's help is the round trip to its host; of many messages the luckiest took about
half of it, if it was sent when it was stamped. So ::

    offset = least delay - round trip / 2

is the difference of the clocks, too large by the time that messages lie between stamp and sending
and by half the asymmetry of the way. It is the minimum filter of NTP (RFC 5905, section 10) with one
leg of the round trip missing, hence an estimate that is worth telling only when it is beyond what
publishers do by themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from simple_ros.cli.measurements import spread
from simple_ros.cli.text import duration_text

__all__ = ["Clocks", "Way", "delay_facts", "delay_line", "judge_clocks", "offset_of"]

_IMPOSSIBLE_S = 0.001
"""A delay below minus this is no rounding of stamps."""
_PLAUSIBLE_S = 0.1
"""Longer than this few publishers keep a message that they have stamped."""
_PLAUSIBLE_ROUND_TRIPS = 20
"""On a slow way messages queue; so many round trips of waiting are still no sign of a clock."""


class Clocks(Enum):
    """What is known of the clocks of publisher and receiver."""

    SAME = "same"
    """One host, one clock."""
    AGREE = "agree"
    """Nothing speaks against it."""
    DIFFER = "differ"
    """The delays cannot be, or hardly."""
    UNKNOWN = "unknown"
    """The round trip cannot be measured, or publishers are on several hosts."""


@dataclass(frozen=True, slots=True)
class Way:
    """The way from the publishers to the receiver.

    Attributes:
        is_local: Whether all publishers are on the receiver's host.
        round_trip_s: To the publishers' host and back; None if not known.
        problem: Why it is not known.
    """

    is_local: bool = False
    round_trip_s: float | None = None
    problem: str = ""


def offset_of(delays_s: Sequence[float], round_trip_s: float) -> float:
    """How far the receiver's clock is ahead of the publisher's, estimated, in seconds."""
    return min(delays_s) - round_trip_s / 2


def judge_clocks(delays_s: Sequence[float], way: Way) -> Clocks:
    """Whether delays, at least one, can be those of two clocks that agree."""
    if way.is_local:
        return Clocks.SAME
    if way.round_trip_s is None:
        return Clocks.DIFFER if min(delays_s) < -_IMPOSSIBLE_S else Clocks.UNKNOWN
    most = max(_PLAUSIBLE_S, _PLAUSIBLE_ROUND_TRIPS * way.round_trip_s)
    possible = min(delays_s) >= -_IMPOSSIBLE_S and offset_of(delays_s, way.round_trip_s) <= most
    return Clocks.AGREE if possible else Clocks.DIFFER


def delay_facts(
    delays_s: Sequence[float], way: Way, offset: float | str = "none"
) -> dict[str, Any] | None:
    """Delays as they are and less the offset of the clocks; None if there is none.

    Args:
        delays_s: Receiver's clock less stamp.
        way: Where the publishers are.
        offset: ``"none"``, ``"auto"`` for the estimate, or how far the receiver's clock is ahead
            in seconds.
    """
    if not delays_s:
        return None
    clocks = judge_clocks(delays_s, way)
    estimate = None
    if clocks is not Clocks.SAME and way.round_trip_s is not None:
        estimate = offset_of(delays_s, way.round_trip_s)
    applied = {"none": None, "auto": estimate}[offset] if isinstance(offset, str) else offset
    corrected = applied
    if offset == "none" and clocks is Clocks.DIFFER:
        corrected = estimate
    return {
        **_spread_ms("", delays_s),
        "window": len(delays_s),
        "clocks": clocks.value,
        "round_trip_ms": _ms(way.round_trip_s),
        "offset_estimate_ms": _ms(estimate),
        "offset": offset if isinstance(offset, str) else "given",
        "offset_applied_ms": _ms(applied),
        **_spread_ms(
            "corrected_", None if corrected is None else [d - corrected for d in delays_s]
        ),
    }


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else seconds * 1e3


def _spread_ms(start: str, values_s: Sequence[float] | None) -> dict[str, float | None]:
    names = [f"{start}{name}_ms" for name in ("mean", "min", "max")]
    if values_s is None:
        return dict.fromkeys(names)
    found = spread([value * 1e3 for value in values_s])
    return dict(zip(names, (found.mean, found.minimum, found.maximum), strict=True))


def delay_line(facts: dict[str, Any], problem: str = "") -> str:
    """Delays for people; a second line says what is wrong with them."""
    applied = facts["offset_applied_ms"]
    if applied is not None:
        how = " (estimated)" if facts["offset"] == "auto" else ""
        less = f"less {duration_text(applied / 1e3)} between the clocks{how}"
        raw = f"raw mean {duration_text(facts['mean_ms'] / 1e3)}"
        return f"{_spread_text(facts, 'corrected_')}, window {facts['window']}, {less}, {raw}"
    line = f"{_spread_text(facts, '')}, window {facts['window']}"
    warning = _warning(facts, problem)
    return f"{line}\n  {warning}" if warning else line


def _spread_text(facts: dict[str, Any], start: str) -> str:
    mean, low, high = (
        duration_text(facts[f"{start}{name}_ms"] / 1e3) for name in ("mean", "min", "max")
    )
    return f"delay mean {mean} min {low} max {high}"


def _warning(facts: dict[str, Any], problem: str) -> str:
    clocks = Clocks(facts["clocks"])
    if clocks is Clocks.SAME:
        future = facts["min_ms"] < -_IMPOSSIBLE_S * 1e3
        return "negative: messages are stamped with a time to come" if future else ""
    if clocks is not Clocks.DIFFER:
        return ""
    if facts["offset_estimate_ms"] is None:
        return (
            f"negative: the clocks differ, this is not valid (by how much is not known: {problem})"
        )
    ahead = facts["offset_estimate_ms"] > 0
    side = "ahead" if ahead else "behind"
    old = ", or stamps are that old when they are sent" if ahead else ""
    return (
        f"clocks differ by about {duration_text(abs(facts['offset_estimate_ms']) / 1e3)}, this one "
        f"is {side}{old} (min delay less half the round trip of "
        f"{duration_text(facts['round_trip_ms'] / 1e3)}); "
        f"without that: {_spread_text(facts, 'corrected_').removeprefix('delay ')}"
    )
