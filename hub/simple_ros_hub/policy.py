"""The global policy: what all engines should care for now. Pure.

The decision is that of WirelessROS: load first, then how the links are, then how many there are. A value near
a threshold does not make the policy flap: thresholds have a margin that must be crossed to go back, and a
policy is kept for a while. Only CONGESTION_CONTROL comes at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from simple_ros.errors import ConfigError

__all__ = [
    "CONGESTION_CONTROL",
    "INITIAL_POLICY",
    "POLICIES",
    "POLICY_PARAMETERS",
    "Decision",
    "PolicyKeeper",
    "Situation",
    "changes_for",
    "determine_global_policy",
]

INITIAL_POLICY: Final = "BALANCED_OPERATION"
CONGESTION_CONTROL: Final = "CONGESTION_CONTROL"
POLICIES: Final = (
    CONGESTION_CONTROL,
    "HIGH_EFFICIENCY",
    "BALANCED_OPERATION",
    "RELIABILITY_FOCUS",
    "PERFORMANCE_FOCUS",
)

Values = Mapping[str, float | int | str]

POLICY_PARAMETERS: Final[Mapping[str, Mapping[str, Values]]] = {
    CONGESTION_CONTROL: {
        "radio_info_engine": {"mode": "optimized", "update_interval": 0.1, "budget": 20},
        "cross_domain_engine": {"mode": "optimized", "update_interval": 0.1, "budget": 20},
        "physical_adaptive_engine": {"update_interval": 0.1, "target_bler": 0.05},
    },
    "HIGH_EFFICIENCY": {
        "radio_info_engine": {"mode": "optimized", "update_interval": 0.2, "budget": 20},
        "cross_domain_engine": {"mode": "optimized", "update_interval": 0.2, "budget": 20},
        "physical_adaptive_engine": {"target_bler": 0.1},
    },
    "BALANCED_OPERATION": {},
    "RELIABILITY_FOCUS": {
        "cross_domain_engine": {"update_interval": 0.05},
        "physical_adaptive_engine": {"update_interval": 0.05, "target_bler": 0.01},
    },
    "PERFORMANCE_FOCUS": {
        "radio_info_engine": {"update_interval": 0.05, "budget": 100},
        "cross_domain_engine": {"update_interval": 0.05, "budget": 100},
        "physical_adaptive_engine": {"update_interval": 0.05, "budget": 100},
    },
}
"""What a policy sets, by engine; what it does not name has the value it had without any policy."""


@dataclass(frozen=True, slots=True)
class Situation:
    """What is decided by.

    Attributes:
        load: Blocks wished over blocks there are.
        users: Links that wish something.
        avg_bler: Mean block error rate, 0..1.
        avg_quality: Mean link quality, 0..1.
        min_quality: Worst link quality, 0..1.
    """

    load: float
    users: int
    avg_bler: float
    avg_quality: float
    min_quality: float


def determine_global_policy(situation: Situation, *, current: str = "", margin: float = 0.0) -> str:
    """The policy for a situation.

    Args:
        situation: Now.
        current: The policy there is; the thresholds that led to it are moved away by ``margin``.
        margin: Share of a threshold.
    """
    up = 1 - margin
    is_high = situation.load > 0.9 * (
        up if current in (CONGESTION_CONTROL, "HIGH_EFFICIENCY") else 1
    )
    if is_high:
        ease = 1 - margin if current == CONGESTION_CONTROL else 1
        if situation.avg_bler > 0.1 * ease or situation.min_quality < 0.3 / ease:
            return CONGESTION_CONTROL
        return "HIGH_EFFICIENCY"
    if situation.load > 0.6 * (up if current == "RELIABILITY_FOCUS" else 1):
        ease = 1 + margin if current == "RELIABILITY_FOCUS" else 1
        return "BALANCED_OPERATION" if situation.avg_quality > 0.7 * ease else "RELIABILITY_FOCUS"
    return "PERFORMANCE_FOCUS" if situation.users < 3 else "BALANCED_OPERATION"


@dataclass(frozen=True, slots=True)
class Decision:
    """A policy and why."""

    policy: str
    reason: str


class PolicyKeeper:
    """Holds the policy.

    Args:
        dwell_s: How long a policy stays at least.
        margin: See `determine_global_policy`.

    Attributes:
        policy: Now.
        since_s: When it came.
        pinned: Whether somebody chose it.
    """

    def __init__(self, dwell_s: float = 10.0, margin: float = 0.1) -> None:
        self.policy: str = INITIAL_POLICY
        self.since_s = 0.0
        self.pinned = False
        self._dwell_s = dwell_s
        self._margin = margin

    def update(self, situation: Situation, now_s: float) -> Decision | None:
        """A new situation; gives the new policy if it changes."""
        if self.pinned:
            return None
        wanted = determine_global_policy(situation, current=self.policy, margin=self._margin)
        is_urgent = wanted == CONGESTION_CONTROL
        if wanted == self.policy or (now_s - self.since_s < self._dwell_s and not is_urgent):
            return None
        reason = (
            f"load {situation.load:.2f}, {situation.users} users, block errors "
            f"{situation.avg_bler:.3f}, link quality {situation.avg_quality:.2f} "
            f"(worst {situation.min_quality:.2f})"
        )
        return self._take(wanted, reason, now_s)

    def pin(self, policy: str, now_s: float) -> Decision | None:
        """Somebody chooses; the hub decides again after `release`.

        Raises:
            ConfigError: There is no such policy.
        """
        if policy not in POLICIES:
            raise ConfigError(f"policy {policy!r} is none of {', '.join(POLICIES)}")
        self.pinned = True
        return None if policy == self.policy else self._take(policy, "chosen by hand", now_s)

    def release(self) -> None:
        """The hub decides again."""
        self.pinned = False

    def _take(self, policy: str, reason: str, now_s: float) -> Decision:
        self.policy, self.since_s = policy, now_s
        return Decision(policy, reason)


def changes_for(
    policy: str, engine: str, base: Values, now: Values
) -> dict[str, float | int | str]:
    """What to set at an engine so that it behaves as a policy says.

    Args:
        policy: Which.
        engine: Which.
        base: Its values without any policy, for all parameters that any policy names.
        now: Its present values.
    """
    wanted = {**base, **POLICY_PARAMETERS[policy].get(engine, {})}
    return {
        name: value for name, value in wanted.items() if name in base and now.get(name) != value
    }
