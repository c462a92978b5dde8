"""What a robot should keep to, from how its link is: pure.

A task says what latency it needs; what the link does is told beside it. Precedence: a critical task keeps
its data whatever the link (``CRITICAL_``), also where an ordinary one would be cut (``EMERGENCY_``).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["LEVELS", "LevelJudge", "Limits", "TaskCriticality", "constrain", "network_score"]

LEVELS = ("EXCELLENT", "GOOD", "FAIR", "POOR", "BAD")
_BOUNDS = (0.8, 0.6, 0.4, 0.2)
CRITICAL = 0.8
UNRELIABLE = 0.3


def network_score(quality: float, reliability: float) -> float:
    """``0.6 quality + 0.4 reliability``."""
    return 0.6 * quality + 0.4 * reliability


class LevelJudge:
    """The level of network quality of a link, which does not flutter.

    A level is left downwards at once, upwards only when the score is a margin above its bound.

    Args:
        margin: That margin.
    """

    def __init__(self, margin: float = 0.03) -> None:
        self.level: str | None = None
        self._margin = margin

    def judge(self, score: float) -> str:
        """The level at a score of 0..1."""
        plain = _index(score)
        if self.level is None or plain > LEVELS.index(self.level):
            self.level = LEVELS[plain]
        elif plain < LEVELS.index(self.level):
            held = LEVELS.index(self.level)
            self.level = LEVELS[min(held, _index(score - self._margin))]
        return self.level


def _index(score: float) -> int:
    return next((i for i, bound in enumerate(_BOUNDS) if score > bound), len(_BOUNDS))


@dataclass(frozen=True, slots=True)
class Limits:
    """A constraint.

    Attributes:
        max_rate_bps: What may be sent.
        min_quality: Of pictures and the like, per cent.
        max_latency_ms: What the task needs.
        expected_latency_ms: What the link is believed to do.
        drop_non_essential: Whether what is not essential should be left out.
        frame_rate: Pictures per second.
        resolution_scale: Per cent.
        kind: Type of the constraint.
    """

    max_rate_bps: float
    min_quality: float
    max_latency_ms: float
    expected_latency_ms: float
    drop_non_essential: bool
    frame_rate: float
    resolution_scale: float
    kind: str


# Share of the bandwidth, quality, factor of latency, drop, frame rate, resolution, type.
_TEMPLATES: dict[str, tuple[float, float, float, bool, float, float, str]] = {
    "EXCELLENT": (1.0, 90, 1.0, False, 30, 100, "HIGH_QUALITY"),
    "GOOD": (0.8, 80, 1.2, False, 30, 80, "STANDARD"),
    "FAIR": (0.6, 70, 1.5, False, 20, 70, "BALANCED"),
    "POOR": (0.4, 50, 2.0, True, 15, 50, "REDUCED"),
    "BAD": (0.2, 30, 3.0, True, 10, 30, "MINIMUM"),
}


def constrain(
    level: str,
    *,
    bandwidth_bps: float,
    latency_ms: float,
    reliability: float,
    criticality: float,
    deadline_ms: float | None = None,
) -> Limits:
    """The constraint at a level of network quality.

    Args:
        level: One of `LEVELS`.
        bandwidth_bps: What the link can carry.
        latency_ms: What it does.
        reliability: 0..1; below 0.3 what is not essential is dropped and the frame rate halved.
        criticality: Of the task, 0..1; above 0.8 quality rises by 10 and nothing is dropped.
        deadline_ms: Latency the task needs; None: it takes the link's times the level's factor.
    """
    share, quality, factor, drop, frame_rate, scale, kind = _TEMPLATES[level]
    is_critical = criticality > CRITICAL
    if reliability < UNRELIABLE:
        frame_rate = max(5.0, frame_rate // 2)
        drop = True
    if is_critical:
        quality, drop, kind = min(95.0, quality + 10), False, f"CRITICAL_{kind}"
    elif reliability < UNRELIABLE:
        kind = f"EMERGENCY_{kind}"
    expected = latency_ms * factor
    return Limits(
        bandwidth_bps * share,
        quality,
        expected if deadline_ms is None else deadline_ms,
        expected,
        drop,
        frame_rate,
        scale,
        kind,
    )


_STATUS = {"EMERGENCY": 1.0, "CRITICAL": 0.9, "NORMAL": 0.5, "LOW_PRIORITY": 0.3}


class TaskCriticality:
    """How critical the present task is, 0..1: 0.5 at first."""

    def __init__(self) -> None:
        self._base = 0.5
        self._levels: deque[str] = deque(maxlen=5)

    def status(self, text: str) -> None:
        """The task says how it is: EMERGENCY, CRITICAL, NORMAL, LOW_PRIORITY; anything else counts 0.1."""
        self._base = _STATUS.get(text.strip().upper(), 0.1)

    def level(self, level: str) -> None:
        """The network got this level."""
        self._levels.append(level)

    @property
    def value(self) -> float:
        """Now: 1.2 times as much when three of the last five levels were POOR or BAD."""
        bad: Sequence[str] = [level for level in self._levels if level in ("POOR", "BAD")]
        return min(1.0, self._base * (1.2 if len(bad) >= 3 else 1.0))
