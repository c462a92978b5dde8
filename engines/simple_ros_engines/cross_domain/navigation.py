"""A client of the navigation stack: its parameters follow the constraints, its planner is asked for plans.

Which parameters and which service a stack has is for its user to say; what does not answer is told and does not
stop anything.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from typing import Any

from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.nav_msgs import GetPlan, GetPlanRequest, Path
from simple_ros.msg.wireless_ros_msgs import ActuationReport
from simple_ros.node import NodeHandle
from simple_ros_engines.cross_domain.constraints import Limits
from simple_ros_engines.cross_domain.mappings import NavParams, translate_constraints_to_nav_params

__all__ = ["NAV_FIELDS", "NavigationClient", "nav_parameter_names"]

NAME = "navigation"
NAV_FIELDS = [item.name for item in fields(NavParams)]
_MOVED = 0.05


def nav_parameter_names(names: Mapping[str, Any]) -> dict[str, str]:
    """Which parameter takes which of `NavParams`.

    Raises:
        ConfigError: A field is named that there is not.
    """
    unknown = sorted(set(names) - set(NAV_FIELDS))
    if unknown:
        raise ConfigError(f"navigation_parameters: {unknown[0]!r} is none of {NAV_FIELDS}")
    return {str(field): str(name) for field, name in names.items()}


class NavigationClient:
    """Speaks with a navigation stack.

    Args:
        node: Through which.
        names: From `nav_parameter_names`; empty: no parameters are set.
        plan_service: A service of type nav_msgs/GetPlan; empty: none.
        max_vel_mps: The stack's largest speed with a perfect link.
        report: Takes what became of it.
    """

    def __init__(
        self,
        node: NodeHandle,
        names: Mapping[str, str],
        plan_service: str,
        max_vel_mps: float,
        report: Callable[[ActuationReport], None],
    ) -> None:
        self._node = node
        self._names = dict(names)
        self._max_vel_mps = max_vel_mps
        self._report = report
        self._set: dict[str, float] = {}
        self._wanted: tuple[str, dict[str, float]] | None = None
        self._task: asyncio.Task[None] | None = None
        self._planner = (
            node.service_client(plan_service, GetPlan, timeout=2.0) if plan_service else None
        )

    def follow(self, link_id: str, limits: Limits) -> None:
        """Set the stack's parameters for a constraint, if they moved by more than 5 %."""
        params = asdict(translate_constraints_to_nav_params(limits, max_vel_mps=self._max_vel_mps))
        values = {name: float(params[field]) for field, name in self._names.items()}
        moved = any(abs(self._set.get(n, 0.0) - v) > _MOVED * abs(v) for n, v in values.items())
        if moved:
            self._wanted = (link_id, values)
            if self._task is None or self._task.done():
                self._task = asyncio.create_task(self._work())

    async def _work(self) -> None:
        while self._wanted is not None:
            (link_id, values), self._wanted = self._wanted, None
            report = ActuationReport(link_id=link_id, actuator=NAME)
            try:
                await self._node.set_parameters(values)
            except (SimpleRosError, ConnectionError) as error:
                report.detail = f"{type(error).__name__}: {error}"
            else:
                self._set, report.applied = values, True
                report.detail = ", ".join(f"{name} = {value:.3g}" for name, value in values.items())
            self._report(report)

    async def plan(self, start: PoseStamped, goal: PoseStamped) -> tuple[Path | None, str]:
        """The stack's own plan; None and why, if there is none."""
        if self._planner is None:
            return None, ""
        try:
            answer = await self._planner.call(GetPlanRequest(start=start, goal=goal))
        except (SimpleRosError, ConnectionError, TimeoutError) as error:
            return None, f"the planner {self._planner.name} gave no plan: {error}"
        if len(answer.plan.poses) < 2:
            return None, f"the planner {self._planner.name} found no plan"
        return answer.plan, ""
