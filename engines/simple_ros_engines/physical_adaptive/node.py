"""The Physical Adaptive Engine as a node."""

from __future__ import annotations

import asyncio
import logging
import math
import random
import time
from typing import ClassVar, Literal, cast

from simple_ros.aio import ServerGoal
from simple_ros.msg.std_msgs import Float32, String, UInt32
from simple_ros.msg.wireless_ros_msgs import (
    ActuationReport,
    ChannelState,
    Constraint,
    OptimizeStrategy,
    OptimizeStrategyFeedback,
    OptimizeStrategyGoal,
    OptimizeStrategyResult,
    PhyLayerMetrics,
    ResourceGrants,
    TransmissionStrategy,
)
from simple_ros.node import NodeHandle
from simple_ros.qos import LATCHED
from simple_ros_engines.base import NAMESPACE, WirelessEngine, outlet
from simple_ros_engines.health import report_health
from simple_ros_engines.mapping_parameter import declare_mapping
from simple_ros_engines.own_link import OwnLink
from simple_ros_engines.physical_adaptive.actuators import Actuator, RrmPolicyFile
from simple_ros_engines.physical_adaptive.core import (
    Demand,
    LinkView,
    PhysicalAdaptive,
    PhysicalSettings,
)
from simple_ros_engines.physical_adaptive.parameter_actuator import (
    STRATEGY_FIELDS,
    ParameterActuator,
)
from simple_ros_engines.physical_adaptive.q_learning import QSettings
from simple_ros_engines.physical_adaptive.sending import applied_by, report_of
from simple_ros_engines.physical_adaptive.strategy import Strategy
from simple_ros_engines.radio.carrier import Carrier, resource_blocks
from simple_ros_engines.radio_information.record import link_id_of

__all__ = ["PhysicalAdaptiveEngine"]

logger = logging.getLogger(__name__)

_GONE_S = 60.0
_FORGET_S = 3600.0


class PhysicalAdaptiveEngine(WirelessEngine[Constraint]):
    """Turns constraints into strategies, has them applied, and learns from what came of it.

    Parameters besides the common ones: ``use_reinforcement_learning``, ``learning_rate``,
    ``exploration_rate``, ``min_exploration_rate``, ``discount_factor``, ``seed``, ``target_bler``,
    ``max_harq_retx``, ``bandwidth_mhz``, ``scs_khz``, ``rrm_policy_file`` (empty: none is written),
    ``apply_parameters`` (JSON: field of a strategy to name of a parameter, in which ``{link}`` stands for
    the link), ``adapt_learning_rate``, ``learn_congestion``, ``link_adaptation`` (``threshold`` or
    ``goodput``).
    """

    node_name: ClassVar[str] = f"{NAMESPACE}/physical_adaptive_engine"
    summary: ClassVar[str] = "How to send on each radio link, and whether that was applied."

    def __init__(self) -> None:
        super().__init__()
        self.actuators: list[Actuator] = []
        self.strategies: dict[str, Strategy] = {}
        self.core = PhysicalAdaptive(PhysicalSettings(), random.Random(0))  # noqa: S311
        self._views: dict[str, LinkView] = {}
        self._demands: dict[str, Demand] = {}
        self._recommendation = ""
        self._grants: dict[str, tuple[int | None, float]] = {}
        self._newest: dict[str, TransmissionStrategy] = {}
        self._parameters: ParameterActuator | None = None
        self._setting: dict[str, asyncio.Task[None]] = {}
        self._own = OwnLink()
        self._heard: dict[str, tuple[float, int]] = {}

    async def set_up(self, node: NodeHandle) -> None:
        """Declare, advertise, subscribe, provide."""
        await self._declare(node)
        self._strategy = await outlet(node, "transmission_strategy", TransmissionStrategy, 100)
        self._reports = await outlet(node, "actuation_report", ActuationReport, 100)
        advertise = node.advertise
        self._mcs = await advertise(f"/{NAMESPACE}/target_mcs", UInt32)
        self._prb = await advertise(f"/{NAMESPACE}/target_prb", UInt32)
        self._ratio = await advertise(f"/{NAMESPACE}/compression_ratio", Float32)
        self._success = await advertise(f"/{NAMESPACE}/packet_success_rate", Float32)
        self._action = await advertise(f"/{NAMESPACE}/adaptive_action", String)
        self._learning = await advertise(f"/{NAMESPACE}/learning_status", String)
        await self.listen(node, "phy_layer_metrics", PhyLayerMetrics, self._metrics)
        await self.listen(node, "channel_state", ChannelState, self._channel)
        await self.listen(node, "constraints", Constraint, self._came)
        await node.subscribe(f"/{NAMESPACE}/adaptation_recommendation", String, self._recommended)
        await node.subscribe(
            f"/{NAMESPACE}/resource_grants", ResourceGrants, self._granted, qos=LATCHED
        )
        await node.subscribe(f"/{NAMESPACE}/actuation_report", ActuationReport, self._reported)
        await node.advertise_action(
            f"/{NAMESPACE}/optimize_strategy", OptimizeStrategy, self._optimize
        )
        node.create_timer(10.0, lambda _: self._tell_learning())
        node.create_timer(10.0, lambda _: self._forget_silent())
        if bool(await node.declare_parameter("~adapt_learning_rate", False, read_only=True)):
            node.create_timer(60.0, lambda _: self.core.review())
        await report_health(node, self)

    async def _declare(self, node: NodeHandle) -> None:
        get = node.declare_parameter

        async def share(name: str, default: float, least: float, most: float) -> float:
            return float(await get(name, default, minimum=least, maximum=most, read_only=True))

        learn = bool(await get("~use_reinforcement_learning", True, read_only=True))
        q = QSettings(
            learning_rate=await share("~learning_rate", 0.1, 0.001, 1),
            discount=await share("~discount_factor", 0.9, 0, 0.999),
            exploration=await share("~exploration_rate", 0.2, 0, 1),
            min_exploration=await share("~min_exploration_rate", 0.05, 0, 1),
        )
        scs = int(await get("~scs_khz", 30, choices=(15, 30, 60), read_only=True))
        n_prb = resource_blocks(scs, int(await get("~bandwidth_mhz", 20, read_only=True)))
        settings = PhysicalSettings(
            Carrier(scs, n_prb),
            target_bler=float(await get("~target_bler", 0.1, minimum=1e-6, maximum=0.5)),
            max_harq_retx=int(await get("~max_harq_retx", 4, minimum=0, maximum=16)),
            learn=learn,
            q=q,
            adaptation=cast(
                "Literal['threshold', 'goodput']",
                await get(
                    "~link_adaptation",
                    "threshold",
                    choices=("threshold", "goodput"),
                    read_only=True,
                ),
            ),
            learn_congestion=bool(await get("~learn_congestion", False, read_only=True)),
        )
        seed = int(await get("~seed", 0, read_only=True))
        self.core = PhysicalAdaptive(settings, random.Random(seed))  # noqa: S311
        for name in ("~target_bler", "~max_harq_retx"):
            node.on_parameter_changed(name, lambda _: self._change(node))
        path = str(await get("~rrm_policy_file", "", read_only=True))
        if path:
            self.actuators.append(RrmPolicyFile(path, n_prb))
        names = await declare_mapping(node, "~apply_parameters", STRATEGY_FIELDS)
        if names:
            self._parameters = ParameterActuator(node, {f: str(n) for f, n in names.items()})

    def _change(self, node: NodeHandle) -> None:
        wanted = node.parameters
        self.core.change(
            target_bler=float(wanted["~target_bler"]), max_harq_retx=int(wanted["~max_harq_retx"])
        )

    def link_count(self) -> int:
        """Links with a strategy."""
        return self.core.link_count()

    def _metrics(self, message: PhyLayerMetrics) -> None:
        has_radio = bool(message.channel_capacity)
        view = LinkView(
            message.snr_db if has_radio else None,
            message.bler if has_radio else None,
            message.mcs if has_radio else None,
            message.channel_response_time or None,
            message.buffer_bytes,
            message.throughput_bps,
            message.available_bps or None,
            message.prb_total,
        )
        self._views[message.link_id] = view
        now_s = time.monotonic()
        self._own.heard(message.link_id, now_s)
        self._heard[message.link_id] = (now_s, message.rnti)
        self.core.observe(message.link_id, view)

    def _channel(self, message: ChannelState) -> None:
        if self._success.subscriber_count and "ul_bler" in message.field_quality:
            self._success.publish(Float32(data=1 - message.ul_bler))

    def _recommended(self, message: String) -> None:
        self._recommendation = message.data

    def _granted(self, message: ResourceGrants) -> None:
        """The hub's word: a link that got its wish is not limited, one it refuses may use nothing."""
        self._grants = {
            grant.link_id: (
                grant.granted_prb if grant.granted_prb < grant.requested_prb else None,
                grant.granted_bps if grant.granted_bps < grant.requested_bps else math.inf,
            )
            for grant in message.grants
        }
        self._grants |= {link.link_id: (0, 0.0) for link in message.refused}

    def _reported(self, message: ActuationReport) -> None:
        newest = self._newest.get(message.link_id)
        stamp = message.header.stamp.ToNanoseconds()
        # A report with no stamp is of a program that does not say which strategy it means.
        if stamp and newest is not None and stamp != newest.header.stamp.ToNanoseconds():
            return
        if message.applied:
            self.core.applied(message.link_id)

    def _came(self, message: Constraint) -> None:
        self.offer(message.link_id, message)

    def priority(self, item: Constraint) -> float:
        """Critical tasks go first."""
        return item.criticality

    def differs(self, before: Constraint, now: Constraint) -> bool:
        """Whether type or rate moved."""
        moved = abs(before.max_data_rate - now.max_data_rate)
        return before.constraint_type != now.constraint_type or moved > 0.05 * before.max_data_rate

    def look_at(self, item: Constraint) -> None:
        """Decide for a link, tell, and have it applied."""
        view = self._views.get(item.link_id)
        if view is None:
            return
        prb, rate_bps = self._grants.get(item.link_id, (None, math.inf))
        demand = Demand(
            item.constraint_type,
            min(item.max_data_rate * 1e6, rate_bps),
            item.criticality,
            self._recommendation if self._own.link(time.monotonic()) == item.link_id else "",
            prb,
        )
        self._demands[item.link_id] = demand
        strategy = self.core.decide(item.link_id, view, demand)
        self.strategies[item.link_id] = strategy
        message = _message(item.link_id, item.rnti, strategy)
        message.header.stamp.CopyFrom(item.header.stamp)
        self._strategy.publish(message)
        self._newest[item.link_id] = message
        self._tell(strategy)
        for actuator in self.actuators:
            done = applied_by(actuator, item.link_id, item.rnti or None, strategy)
            self._reports.publish(report_of(actuator.name, done, message))
        if self._parameters is not None and item.link_id not in self._setting:
            # One at a time for a link: what comes meanwhile is taken up when it is done.
            task = asyncio.create_task(self._set_parameters(self._parameters, item.link_id))
            self._setting[item.link_id] = task
            task.add_done_callback(lambda _: self._setting.pop(item.link_id, None))

    async def _set_parameters(self, actuator: ParameterActuator, link_id: str) -> None:
        message: TransmissionStrategy | None = None
        while message is not self._newest[link_id]:
            message, strategy = self._newest[link_id], self.strategies[link_id]
            done = await actuator.apply(link_id, strategy)
            self._reports.publish(report_of(actuator.name, done, message))

    def _tell(self, strategy: Strategy) -> None:
        """The newest strategy on topics that know no links."""
        if self._mcs.subscriber_count:
            self._mcs.publish(UInt32(data=strategy.mcs))
        if self._prb.subscriber_count:
            self._prb.publish(UInt32(data=strategy.prb))
        if self._ratio.subscriber_count:
            self._ratio.publish(Float32(data=strategy.compression_ratio))
        if self._action.subscriber_count:
            self._action.publish(String(data=strategy.action))

    def _forget_silent(self) -> None:
        """Keep no blocks for devices that are gone, and in the end nothing at all."""
        now_s = time.monotonic()
        for link_id, (heard_s, rnti) in list(self._heard.items()):
            if rnti and now_s - heard_s > _GONE_S:
                for actuator in self.actuators:
                    actuator.forget(rnti)
            if now_s - heard_s > _FORGET_S and link_id not in self._setting:
                del self._heard[link_id]
                self.forget(link_id)
                self.core.forget(link_id)
                for known in (self._views, self._demands, self.strategies, self._newest):
                    known.pop(link_id, None)

    def _tell_learning(self) -> None:
        if self._learning.subscriber_count:
            for link_id in self._views:
                self._learning.publish(String(data=self.core.learning_status(link_id)))

    async def _optimize(
        self,
        goal: ServerGoal[OptimizeStrategyGoal, OptimizeStrategyResult, OptimizeStrategyFeedback],
    ) -> OptimizeStrategyResult:
        wanted = goal.goal
        link_id = wanted.link_id or link_id_of(wanted.rnti)
        view, demand = self._views.get(link_id), self._demands.get(link_id)
        if view is None or demand is None or view.snr_db is None:
            goal.abort(OptimizeStrategyResult(), f"nothing is known of the radio of {link_id!r}")
            return OptimizeStrategyResult()
        count = wanted.iterations or 10
        target = wanted.target_bler or self.core.settings.target_bler
        if not 0 < target < 1:
            goal.abort(OptimizeStrategyResult(), f"target_bler is {target:g}, not between 0 and 1")
            return OptimizeStrategyResult()
        best, score, trail = self.core.search(link_id, view, demand, count, target)
        for index, so_far in enumerate(trail, 1):
            goal.publish_feedback(OptimizeStrategyFeedback(iteration=index, best_score=so_far))
            await asyncio.sleep(0)
        message = _message(link_id, wanted.rnti, best)
        return OptimizeStrategyResult(best=message, score=score, iterations=len(trail))


def _message(link_id: str, rnti: int, strategy: Strategy) -> TransmissionStrategy:
    return TransmissionStrategy(
        rnti=rnti,
        link_id=link_id,
        target_mcs=strategy.mcs,
        target_prb=strategy.prb,
        compression_ratio=strategy.compression_ratio,
        priority=strategy.priority,
        retransmission_enabled=strategy.retransmission_enabled,
        max_harq_retx=strategy.max_harq_retx,
        strategy_type=strategy.strategy_type,
        rate_bps=strategy.rate_bps,
        action=strategy.action,
    )
