"""The hub's picture of all links, and what it decides from it: grants, policy, degradation. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import fmean

from simple_ros.msg.wireless_ros_msgs import (
    ChannelState,
    Constraint,
    PhyLayerMetrics,
    TransmissionStrategy,
)
from simple_ros_hub.admission import Admission
from simple_ros_hub.degradation import Strain
from simple_ros_hub.performance import Performance, numbers_of
from simple_ros_hub.policy import Situation
from simple_ros_hub.resources import Allocation, Request, allocate, managed
from simple_ros_hub.routes import LinkHealth

__all__ = ["Coordinator", "ResourceLimits", "Shared", "wished_blocks"]

_FRESH_S = 5.0


@dataclass(frozen=True, slots=True)
class ResourceLimits:
    """What there is.

    Attributes:
        max_total_prbs: Blocks.
        max_total_bandwidth_mbps: Rate.
        max_users: Links.
        prb_floor: Blocks each link gets at least.
        rate_floor_kbps: Rate each link gets at least.
    """

    max_total_prbs: int = 100
    max_total_bandwidth_mbps: float = 1000.0
    max_users: int = 20
    prb_floor: int = 5
    rate_floor_kbps: int = 64


@dataclass(frozen=True, slots=True)
class Shared:
    """What all links may use.

    Attributes:
        blocks: Resource blocks.
        rates: Rates in kbit/s, of the same links.
        refused: Links that may use nothing, with reasons.
        rntis: By link.
    """

    blocks: Allocation
    rates: Allocation
    refused: dict[str, str]
    rntis: dict[str, int]


@dataclass(slots=True)
class _Wish:
    blocks: int
    rate_kbps: int
    priority: int
    rnti: int
    seen_s: float


def wished_blocks(strategy: TransmissionStrategy, constraint: Constraint | None) -> int:
    """Blocks that a link would use if it were granted all it wishes.

    A strategy that was cut down to a grant says so: its rate is below what the constraint allows. Going by the
    rates, the wish does not shrink with each grant.
    """
    blocks = int(strategy.target_prb)
    if constraint is None or strategy.rate_bps <= 0:
        return blocks
    factor = constraint.max_data_rate * 1e6 / strategy.rate_bps
    return max(blocks, math.ceil(blocks * factor - 1e-6)) if factor > 1 else blocks


class Coordinator:
    """Takes what the engines tell.

    Args:
        limits: What there is.

    Attributes:
        limits: What there is.
        performance: How well it goes.
        manages_priorities: Whether critical links rise and others give way under load.
    """

    def __init__(self, limits: ResourceLimits | None = None) -> None:
        self.limits = limits or ResourceLimits()
        self.performance = Performance(_FRESH_S)
        self.manages_priorities = True
        self._admission = Admission(self.limits.max_users)
        self._wishes: dict[str, _Wish] = {}
        self._constraints: dict[str, tuple[Constraint, float]] = {}
        self._metrics: dict[str, tuple[PhyLayerMetrics, float]] = {}
        self._carrier: dict[str, int] = {}
        self._load = 0.0

    def set_limits(self, limits: ResourceLimits) -> None:
        """From now on; who is admitted already stays."""
        self.limits = limits
        self._admission.max_users = limits.max_users

    def channel(self, message: ChannelState, now_s: float) -> None:
        """The state of a link."""
        self.performance.link(message.link_id, numbers_of(message), now_s)

    def metrics(self, message: PhyLayerMetrics, now_s: float) -> None:
        """How good a link is."""
        self._metrics[message.link_id] = (message, now_s)
        if message.prb_total:
            self._carrier[message.link_id] = message.prb_total

    def constraint(self, message: Constraint, now_s: float) -> None:
        """What a link is asked to carry at most."""
        self._constraints[message.link_id] = (message, now_s)

    def strategy(self, message: TransmissionStrategy, now_s: float) -> None:
        """How a link is to be used."""
        key = message.link_id
        priority = min(5, max(1, message.priority))
        constraint, _ = self._constraints.get(key, (None, 0.0))
        rate = message.rate_bps if constraint is None else constraint.max_data_rate * 1e6
        rate_kbps = math.ceil(max(rate, message.rate_bps) / 1000)
        blocks = wished_blocks(message, constraint)
        if not blocks and rate_kbps:
            # It may use nothing now, which does not tell what it would use if it might.
            before = self._wishes.get(key)
            blocks = before.blocks if before is not None else max(1, self.limits.prb_floor)
        self._wishes[key] = _Wish(blocks, rate_kbps, priority, message.rnti, now_s)
        self._admission.seen(key, priority, now_s)

    def share(self, now_s: float) -> Shared:
        """Share out what there is among those who are admitted."""
        self._forget(now_s)
        inside, refused = self._admission.decide(now_s)
        keys = [key for key in inside if key in self._wishes]
        total = self.total_blocks()
        self._load = sum(self._wishes[key].blocks for key in keys) / total if total else 0.0
        blocks = [
            # Nobody can use more than its carrier has; how much more it would like is load.
            replace(request, wanted=min(request.wanted, self._carrier.get(request.key, total)))
            for request in self._requests(keys, "blocks", self.limits.prb_floor)
        ]
        rates = self._requests(keys, "rate_kbps", self.limits.rate_floor_kbps)
        if self.manages_priorities:
            critical = {
                key: self._constraints[key][0].criticality
                for key in keys
                if key in self._constraints
            }
            blocks = managed(blocks, self._load, critical)
        kbps = int(1000 * self.limits.max_total_bandwidth_mbps)
        rntis = {key: wish.rnti for key, wish in self._wishes.items()}
        return Shared(allocate(blocks, total), allocate(rates, kbps), refused, rntis)

    def _requests(self, keys: list[str], what: str, floor: int) -> list[Request]:
        return [
            Request(key, getattr(self._wishes[key], what), self._wishes[key].priority, floor)
            for key in keys
        ]

    def total_blocks(self) -> int:
        """Blocks to share out: the limit, or those of the carrier if that has fewer."""
        carrier = max((self._carrier.get(key, 0) for key in self._metrics), default=0)
        return min(self.limits.max_total_prbs, carrier or self.limits.max_total_prbs)

    @property
    def load(self) -> float:
        """Blocks wished at the last `share` over blocks there are."""
        return self._load

    @property
    def users(self) -> int:
        """Links that wish something."""
        return len(self._wishes)

    @property
    def constraints_known(self) -> int:
        """Links with a constraint."""
        return len(self._constraints)

    def qualities(self, now_s: float) -> list[float]:
        """Quality of each link that is heard of, 0..1."""
        return [m.link_quality for m, seen in self._metrics.values() if now_s - seen <= _FRESH_S]

    def healths(self) -> dict[str, LinkHealth]:
        """How each link was when it was last heard of."""
        return {key: LinkHealth(m.link_quality, seen) for key, (m, seen) in self._metrics.items()}

    @property
    def newest_metrics(self) -> dict[str, PhyLayerMetrics]:
        """How good each link is."""
        return {key: message for key, (message, _) in self._metrics.items()}

    def has_data(self, now_s: float) -> bool:
        """Whether there is enough to decide a policy by."""
        return bool(self._wishes) and bool(self.qualities(now_s))

    def situation(self, now_s: float) -> Situation:
        """What the policy is decided by."""
        qualities = self.qualities(now_s) or [1.0]
        links = self.performance.present(now_s).values()
        blers = [link.bler for link in links if link.bler is not None] or [0.0]
        return Situation(self._load, self.users, fmean(blers), fmean(qualities), min(qualities))

    def strain(self, now_s: float, engines_down: tuple[str, ...], hub_load: float) -> Strain:
        """What the degradation is decided by."""
        best = max(self.qualities(now_s), default=None)
        return Strain(self._load, best, engines_down, hub_load)

    def _forget(self, now_s: float) -> None:
        for key in [k for k, wish in self._wishes.items() if now_s - wish.seen_s > 2 * _FRESH_S]:
            del self._wishes[key]
        # A link comes back under another key: what nobody wishes any more must not stay.
        for key in [k for k, (_, seen) in self._constraints.items() if now_s - seen > 2 * _FRESH_S]:
            if key not in self._wishes:
                del self._constraints[key]
        for key in [k for k, (_, seen) in self._metrics.items() if now_s - seen > 2 * _FRESH_S]:
            del self._metrics[key]
            self._carrier.pop(key, None)
