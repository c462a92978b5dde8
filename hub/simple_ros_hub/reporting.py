"""What the hub tells: status, resources, diagnostics, policy, grants, degradation."""

from __future__ import annotations

import time
from statistics import fmean
from typing import TYPE_CHECKING

from simple_ros.diagnostics.status import Status
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.std_msgs import String
from simple_ros.msg.wireless_ros_msgs import (
    ComponentStatus,
    Degradation,
    EngineStatus,
    ResourceOverview,
    SystemStatus,
    WirelessPerformance,
)
from simple_ros_hub.components import Kind
from simple_ros_hub.conditions import View
from simple_ros_hub.coordination import Shared
from simple_ros_hub.degradation import LIMITS
from simple_ros_hub.outlets import Outlets
from simple_ros_hub.report import (
    component_status,
    diagnose,
    diagnose_hub,
    grants_message,
    performance_facts,
    policy_message,
)

if TYPE_CHECKING:
    from simple_ros_hub.hub import Hub

__all__ = ["Reporter"]

_STALE_S = 5.0


class Reporter:
    """Publishes.

    Args:
        hub: What it tells of.
        outlets: Where.
    """

    def __init__(self, hub: Hub, outlets: Outlets) -> None:
        self._hub = hub
        self._outlets = outlets
        self._told_conflict = ""
        self._newest = SystemStatus()

    def status(self) -> SystemStatus:
        """The newest that was told."""
        return self._newest

    def report(self) -> None:
        """Status, resources and diagnostics."""
        now_s = time.monotonic()
        performance = self._performance(now_s)
        self._newest = self._status(now_s, performance)
        self._outlets.status.publish(self._newest)
        self._outlets.overview.publish(self._overview(performance))
        self._outlets.diagnostics.publish(self._diagnostics(now_s, performance))

    def tell_policy(self, policy: str, reason: str) -> None:
        """The policy, with what it sets."""
        hub = self._hub
        message = policy_message(
            policy,
            reason,
            pinned=hub.policy.pinned,
            parameters=hub.steering.parameters(policy),
        )
        self._outlets.policy.publish(message)

    def tell_degradation(self) -> None:
        """The level."""
        self._outlets.degradation.publish(self._degradation())

    def tell_grants(self, shared: Shared, *, changed: bool) -> None:
        """The grants if they changed; a conflict in words, too."""
        if not changed:
            return
        message = grants_message(shared.blocks, shared.rates, shared.refused, shared.rntis)
        self._outlets.grants.publish(message)
        if shared.blocks.is_conflict and message.text != self._told_conflict:
            self._told_conflict = message.text
            self._outlets.conflicts.publish(String(data=message.text))

    # -- inside --------------------------------------------------------------------------------

    def _performance(self, now_s: float) -> WirelessPerformance:
        hub = self._hub
        share = None
        if hub.shared is not None and hub.shared.blocks.total and hub.shared.blocks.grants:
            share = hub.shared.blocks.granted / hub.shared.blocks.total
        return hub.coordinator.performance.metrics(
            now_s, granted_share=share, came=hub.senses.came, missing=hub.senses.missing
        )

    def _degradation(self) -> Degradation:
        judge = self._hub.degradation
        limits = LIMITS[judge.level]
        return Degradation(
            level=int(judge.level),
            name=judge.level.name,
            min_priority=limits.min_priority,
            rate_factor=limits.rate_factor,
            reason=judge.reason,
        )

    def _status(self, now_s: float, performance: WirelessPerformance) -> SystemStatus:
        hub = self._hub
        reasons = hub.supervision.reasons()
        return SystemStatus(
            phase=hub.supervision.phase.value,
            degraded=bool(reasons),
            reasons=reasons,
            policy=hub.policy.policy,
            degradation=self._degradation(),
            components=[*self._components(now_s), *self._others()],
            performance=performance,
            loop_ms_mean=hub.work_ms[0],
            loop_ms_max=hub.work_ms[1],
        )

    def _components(self, now_s: float) -> list[ComponentStatus]:
        found = []
        for view in self._hub.supervision.views():
            name = view.component.name
            usage = self._hub.keeper.usage(name)
            numbers = None if usage is None else (usage.cpu_percent, usage.memory_bytes)
            found.append(component_status(view, now_s, self._heartbeat(name), numbers))
        return found

    def _others(self) -> list[ComponentStatus]:
        """Engines and cells that run without being the hub's."""
        ours = {view.component.name for view in self._hub.supervision.views()}
        stamp_ns = self._hub.node.clock.now().nanoseconds
        found = []
        for name, heartbeat in self._hub.senses.signs.newest.items():
            age_s = (stamp_ns - heartbeat.header.stamp.ToNanoseconds()) / 1e9
            if name not in ours:
                found.append(
                    ComponentStatus(
                        name=name,
                        kind=heartbeat.kind or Kind.ENGINE.value,
                        node=heartbeat.name,
                        state=heartbeat.state if age_s < _STALE_S else "inactive",
                        message="not looked after by the hub",
                        heartbeat_age_s=age_s,
                        mode=heartbeat.mode,
                        processed=heartbeat.processed,
                        errors=heartbeat.errors,
                    )
                )
        return found

    def _heartbeat(self, name: str) -> EngineStatus | None:
        return self._hub.senses.signs.newest.get(name)

    def _overview(self, performance: WirelessPerformance) -> ResourceOverview:
        hub = self._hub
        message = ResourceOverview(
            max_total_prbs=hub.coordinator.total_blocks(),
            max_total_bandwidth=hub.coordinator.limits.max_total_bandwidth_mbps,
            users=hub.coordinator.users,
            max_users=hub.coordinator.limits.max_users,
            performance=performance,
            jain_index=1.0,
        )
        if hub.shared is not None:
            message.requested_prbs = hub.shared.blocks.requested
            message.granted_prbs = hub.shared.blocks.granted
            message.granted_bandwidth = hub.shared.rates.granted / 1000
            message.jain_index = hub.shared.blocks.jain
        return message

    def _diagnostics(self, now_s: float, performance: WirelessPerformance) -> DiagnosticArray:
        hub = self._hub
        views = hub.supervision.views()
        statuses: list[Status] = [
            diagnose(view, now_s, self._heartbeat(view.component.name), self._facts(view, now_s))
            for view in views
        ]
        facts = {
            "Phase": hub.supervision.phase.value,
            "Total RNTIs": str(hub.coordinator.users),
            "Global Policy": hub.policy.policy,
            "Degradation": hub.degradation.level.name,
            **performance_facts(performance),
            "Resource Allocations": str(len(hub.shared.blocks.grants) if hub.shared else 0),
        }
        statuses.append(diagnose_hub(views, hub.supervision.phase, hub.supervision.late, facts))
        return DiagnosticArray(status=[status.to_message() for status in statuses])

    def _facts(self, view: View, now_s: float) -> dict[str, str]:
        """What WirelessROS shows of each engine, and what a cell says of itself."""
        links = self._hub.coordinator
        match view.component.name:
            case "radio_info_engine":
                qualities = links.qualities(now_s)
                facts = {"Active RNTIs": str(len(qualities))}
                if qualities:
                    facts["Avg Link Quality"] = f"{fmean(qualities):.3f}"
                return facts
            case "cross_domain_engine":
                return {"Active Constraints": str(links.constraints_known)}
            case "physical_adaptive_engine":
                return {"Active Strategies": str(links.users)}
        cell = self._hub.senses.cells.get(view.component.name)
        if cell is None:
            return {}
        return {
            "Execution Rate (Hz)": f"{cell.execution_rate:.2f}",
            "Error Rate": f"{cell.error_rate:.3f}",
            "Latest Adaptation": cell.constraint_type or "none",
        }
