"""How to send on each link: everything the Physical Adaptive Engine decides. Pure.

Per link: an adapter that learns how the radio differs from the model, a watch for congestion, and a learner
of corrections. What is learnt is learnt from the strategy that was reported as applied; while nothing
applies strategies, the learner stands still.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from statistics import fmean, pstdev
from typing import Literal

from simple_ros_engines.physical_adaptive.congestion import CongestionWatch, prevent
from simple_ros_engines.physical_adaptive.congestion_learning import CongestionLearner
from simple_ros_engines.physical_adaptive.goodput import SampledGoodput
from simple_ros_engines.physical_adaptive.harq import advised_retransmissions
from simple_ros_engines.physical_adaptive.link_adaptation import LinkAdapter, OuterLoop
from simple_ros_engines.physical_adaptive.q_learning import (
    Generator,
    QLearner,
    QSettings,
    discretize_state,
)
from simple_ros_engines.physical_adaptive.resources import resource_need
from simple_ros_engines.physical_adaptive.strategy import (
    STRATEGY_TYPES,
    UNKNOWN_TYPE,
    Bounds,
    Strategy,
    recommended,
    score,
    validated,
)
from simple_ros_engines.radio.bler import best_mcs, block_error_rate
from simple_ros_engines.radio.carrier import Carrier
from simple_ros_engines.radio.mcs import McsTable, mcs_entry, mcs_table

__all__ = ["ACTIONS", "Demand", "LinkView", "PhysicalAdaptive", "PhysicalSettings"]

ACTIONS = [(mcs, compression) for mcs in range(-3, 4) for compression in (-1, 0, 1)]
"""Corrections of the heuristic: schemes up or down, compression ratio times 0.8, 1 or 1.25."""
_HEURISTIC = ACTIONS.index((0, 0))
_REVIEW_AFTER = 100
_BURST_S = 0.05
"""What a link sends within this time is no queue."""
_EXPLORED = {
    "best": "USING_RL_RECOMMENDATION",
    "heuristic": "EXPLOITING_PREVIOUS_STRATEGY",
    "other": "EXPLORING_NEW_STRATEGY",
}


@dataclass(frozen=True, slots=True)
class PhysicalSettings:
    """Settings.

    Attributes:
        carrier: The direction of the carrier.
        table: MCS table of the links.
        target_bler: Share of first transmissions that may be lost.
        max_harq_retx: Most repetitions.
        learn: Whether corrections are learnt.
        q: How.
        adaptation: How the scheme is chosen: ``threshold``, the highest whose modelled loss keeps the target, or
            ``goodput``, the one that should bring most (`goodput`).
        learn_congestion: Whether a link that is about to congest is recognised by what came before earlier
            congestion of it.
    """

    carrier: Carrier = field(default_factory=Carrier)
    table: McsTable = McsTable.QAM64
    target_bler: float = 0.1
    max_harq_retx: int = 4
    learn: bool = True
    q: QSettings = field(default_factory=QSettings)
    adaptation: Literal["threshold", "goodput"] = "threshold"
    learn_congestion: bool = False


@dataclass(frozen=True, slots=True)
class LinkView:
    """What is known of a link.

    Attributes:
        snr_db: Ratio; None where the link has no radio numbers.
        bler: Share of blocks lost, of the same direction.
        mcs: Scheme in use, of the same direction.
        rtt_ms: Round trip.
        buffer_bytes: What waits.
        carried_bps: What goes through.
        available_bps: What could.
        prb_total: Blocks of the carrier; 0 if the source does not tell.
    """

    snr_db: float | None
    bler: float | None
    mcs: int | None
    rtt_ms: float | None
    buffer_bytes: float | None
    carried_bps: float | None
    available_bps: float | None
    prb_total: int = 0


@dataclass(frozen=True, slots=True)
class Demand:
    """What is wanted of a link.

    Attributes:
        kind: Type of the constraint.
        rate_bps: What may be sent.
        criticality: Of the task, 0..1.
        recommendation: One of `strategy.RECOMMENDATIONS`; empty: none.
        granted_prb: Blocks the hub granted; None: all there are.
    """

    kind: str
    rate_bps: float
    criticality: float
    recommendation: str = ""
    granted_prb: int | None = None


class _Link:
    def __init__(self, settings: PhysicalSettings) -> None:
        self.adapter: LinkAdapter | SampledGoodput = (
            SampledGoodput(settings.target_bler, settings.table)
            if settings.adaptation == "goodput"
            else LinkAdapter(settings.table, OuterLoop(settings.target_bler))
        )
        self.congestion = CongestionWatch()
        self.foresight = CongestionLearner() if settings.learn_congestion else None
        self.will_congest = False
        self.learner = QLearner(ACTIONS, _HEURISTIC, settings.q)
        self.snrs: deque[float] = deque(maxlen=10)
        self.blers: deque[float] = deque(maxlen=10)
        self.pending: tuple[tuple[int, int, int, int], int] | None = None
        self.applied = False
        self.scores: deque[float] = deque(maxlen=50)

    def stability(self, values: deque[float], scale: float) -> float:
        return 1 - min(1.0, scale * pstdev(values)) if len(values) >= 5 else 0.5


class PhysicalAdaptive:
    """Decides for all links.

    Args:
        settings: Settings.
        generator: Randomness for exploring.
    """

    def __init__(self, settings: PhysicalSettings, generator: Generator) -> None:
        self.settings = settings
        self._generator = generator
        self._links: dict[str, _Link] = {}

    def link_count(self) -> int:
        """How many links it knows."""
        return len(self._links)

    def forget(self, link_id: str) -> None:
        """Keep nothing of a link that is gone."""
        self._links.pop(link_id, None)

    def change(self, *, target_bler: float, max_harq_retx: int) -> None:
        """Aim at another error rate, allow another number of repetitions, on all links.

        Raises:
            ConfigError: The rate does not lie between 0 and 1.
        """
        for link in self._links.values():
            link.adapter.aim(target_bler)
        self.settings = replace(self.settings, target_bler=target_bler, max_harq_retx=max_harq_retx)

    def observe(self, link_id: str, view: LinkView) -> bool:
        """Take the newest view of a link. Tells whether the link congests."""
        link = self._link(link_id)
        if view.snr_db is not None:
            link.snrs.append(view.snr_db)
        if view.bler is not None:
            link.blers.append(view.bler)
            # The network may have chosen another scheme than was asked for: it is that one that counts.
            is_known = view.mcs is not None and view.mcs < len(mcs_table(self.settings.table))
            if is_known and view.snr_db is not None and view.mcs is not None:
                link.adapter.calibrate(view.snr_db, view.mcs, view.bler)
        queued = _standing_bytes(view)
        congests = link.congestion.sample(queued, view.rtt_ms)
        if link.foresight is not None:
            link.will_congest = link.foresight.sample(queued, view.rtt_ms)
        return congests or link.will_congest

    def applied(self, link_id: str) -> None:
        """An actuator has applied the newest strategy of a link, if that is known."""
        link = self._links.get(link_id)
        if link is not None:
            link.applied = True

    def decide(self, link_id: str, view: LinkView, demand: Demand) -> Strategy:
        """The strategy for a link, within bounds."""
        link = self._link(link_id)
        self._learn(link, view, demand)
        base, action = self._choose(link, view, demand)
        strategy, action = self._strategy(link, view, demand, base, action)
        if self.settings.learn and view.snr_db is not None:
            link.pending = (self._state(view, demand), action)
        link.applied = False
        return strategy

    def _strategy(
        self, link: _Link, view: LinkView, demand: Demand, base: int, action: int
    ) -> tuple[Strategy, int]:
        """What a scheme and a correction of it come to, and which correction is left of it."""
        carrier = self._carrier(view)
        last = len(mcs_table(self.settings.table)) - 1
        mcs = max(0, min(last, base + ACTIONS[action][0]))
        entry = mcs_entry(self.settings.table, mcs)
        bler = fmean(link.blers) if link.blers else 0.0
        need = resource_need(
            demand.rate_bps, entry, carrier, available_prb=demand.granted_prb, bler=bler
        )
        congests = link.congestion.is_congested or link.will_congest
        if not congests:
            # Where nothing waits, sending less brings nothing that could be learnt, and costs quality.
            action = ACTIONS.index((ACTIONS[action][0], 0))
        priority, retx, kind = STRATEGY_TYPES.get(demand.kind, UNKNOWN_TYPE)
        draft = Strategy(
            mcs,
            need.prb,
            need.compression_ratio * 1.25 ** ACTIONS[action][1],
            priority,
            retx > 0,
            self._retransmissions(link, retx, bler, demand),
            kind,
            need.rate_bps,
            self._named(link, view, demand, action),
        )
        if congests:
            ratio, lower = prevent(draft.compression_ratio, draft.priority)
            draft = replace(draft, compression_ratio=ratio, priority=lower)
        granted = carrier.n_prb if demand.granted_prb is None else demand.granted_prb
        bounds = Bounds(last, min(carrier.n_prb, granted), self.settings.max_harq_retx)
        kept, _ = validated(recommended(draft, demand.recommendation), bounds)
        return kept, action

    def _retransmissions(self, link: _Link, retx: int, bler: float, demand: Demand) -> int:
        return advised_retransmissions(
            retx,
            enabled=retx > 0,
            bler=bler,
            bler_stability=link.stability(link.blers, 10.0),
            criticality=demand.criticality,
            most=self.settings.max_harq_retx,
        )

    def _choose(self, link: _Link, view: LinkView, demand: Demand) -> tuple[int, int]:
        """Scheme of the heuristic, and which correction."""
        if view.snr_db is None:
            # No radio numbers: nothing to choose a scheme by.
            return view.mcs or 0, _HEURISTIC
        base = link.adapter.choose(view.snr_db)
        if not self.settings.learn:
            return base, _HEURISTIC
        return base, link.learner.choose(self._state(view, demand), self._generator)

    def _named(self, link: _Link, view: LinkView, demand: Demand, action: int) -> str:
        """What a correction is called."""
        if action == _HEURISTIC:
            return _EXPLORED["heuristic"]
        state = self._state(view, demand)
        return _EXPLORED["best" if action == link.learner.best(state) else "other"]

    def _learn(self, link: _Link, view: LinkView, demand: Demand) -> None:
        if view.bler is None or view.mcs is None:
            return
        index = min(view.mcs, len(mcs_table(self.settings.table)) - 1)
        efficiency = mcs_entry(self.settings.table, index).efficiency
        reward = score(view.bler, efficiency, view.carried_bps or 0.0, self._offered(view))
        link.scores.append(reward)
        if link.pending is not None and link.applied and view.snr_db is not None:
            state, action = link.pending
            link.learner.learn(state, action, reward, self._state(view, demand))
        link.pending = None

    def _offered(self, view: LinkView) -> float | None:
        """What there was to send: what went through and what waits still."""
        if view.carried_bps is None:
            return None
        return view.carried_bps + 8 * (view.buffer_bytes or 0.0)

    def _state(self, view: LinkView, demand: Demand) -> tuple[int, int, int, int]:
        snr = -10.0 if view.snr_db is None else view.snr_db
        buffer = view.buffer_bytes or 0.0
        return discretize_state(snr, view.bler or 0.0, buffer, demand.criticality)

    def _carrier(self, view: LinkView) -> Carrier:
        if view.prb_total and view.prb_total != self.settings.carrier.n_prb:
            return replace(self.settings.carrier, n_prb=view.prb_total)
        return self.settings.carrier

    def learning_status(self, link_id: str) -> str:
        """In words."""
        learner = self._link(link_id).learner
        mean = learner.mean_reward()
        reward = "none" if mean is None else f"{mean:.3f}"
        return (
            f"{link_id}: {learner.episodes} experiences, {learner.states_seen()} states, "
            f"mean reward {reward}, exploring {learner.exploration_rate():.2f}"
        )

    def review(self) -> None:
        """Adapt learning rates: up by a fifth where the last rewards were below 0.3, down where above 0.7.

        The design's rule. A faster rate on low rewards is no way to convergence, so it is not the default.
        """
        for link in self._links.values():
            reward = link.learner.mean_reward()
            if reward is None or link.learner.episodes < _REVIEW_AFTER:
                continue
            settings = link.learner.settings
            rate = settings.learning_rate
            if reward < 0.3:
                rate = min(0.5, rate * 1.2)
            elif reward > 0.7:
                rate = max(0.01, rate * 0.8)
            link.learner.settings = replace(settings, learning_rate=rate)

    def search(
        self, link_id: str, view: LinkView, demand: Demand, iterations: int, target_bler: float
    ) -> tuple[Strategy, float, list[float]]:
        """Try schemes in the model of the link; the best strategy, its score, the best score so far by step.

        Nothing is learnt from it, since nothing of it was applied.

        Args:
            link_id: Key of the link.
            view: Of the link; its ratio must be known.
            demand: What is wanted.
            iterations: How many schemes to try, from the heuristic's outward.
            target_bler: Schemes that lose more than twice this are left out.
        """
        link = self._link(link_id)
        entries = mcs_table(self.settings.table)
        snr = (view.snr_db or 0.0) + link.adapter.offset_db
        scheme = best_mcs(self.settings.table, snr, target_bler).index
        base, _ = self._strategy(link, view, demand, scheme, _HEURISTIC)
        order = sorted(range(len(entries)), key=lambda index: abs(index - base.mcs))
        best, best_score, trail = base, -math.inf, []
        for index in order[: max(1, iterations)]:
            bler = block_error_rate(entries[index], snr)
            carrier = self._carrier(view)
            need = resource_need(
                demand.rate_bps,
                entries[index],
                carrier,
                available_prb=demand.granted_prb,
                bler=bler,
            )
            reward = score(bler, entries[index].efficiency, need.rate_bps, demand.rate_bps)
            if bler <= 2 * target_bler and reward > best_score:
                best_score = reward
                best = replace(
                    base,
                    mcs=index,
                    prb=need.prb,
                    rate_bps=need.rate_bps,
                    compression_ratio=need.compression_ratio,
                )
            trail.append(max(0.0, best_score))
        return best, max(0.0, best_score), trail

    def _link(self, link_id: str) -> _Link:
        link = self._links.get(link_id)
        if link is None:
            link = self._links[link_id] = _Link(self.settings)
        return link


def _standing_bytes(view: LinkView) -> float | None:
    """What waits longer than a message that was just handed over does: one large cloud is no queue."""
    if view.buffer_bytes is None or view.available_bps is None:
        return view.buffer_bytes
    return max(0.0, view.buffer_bytes - view.available_bps / 8 * _BURST_S)
