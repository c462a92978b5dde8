"""The parameters of the hub's node."""

from __future__ import annotations

from dataclasses import dataclass, field

from simple_ros.node import NodeHandle
from simple_ros_hub.conditions import SupervisionSettings
from simple_ros_hub.coordination import ResourceLimits
from simple_ros_hub.routes import routes_of

__all__ = ["LIVE_LIMITS", "HubSettings", "declare_settings", "resource_limits"]

LIVE_LIMITS = (
    "max_total_prbs",
    "max_total_bandwidth",
    "max_users",
    "prb_floor",
    "rate_floor",
    "priority_management_enabled",
)
"""Parameters that may change while the hub runs."""


@dataclass(frozen=True, slots=True)
class HubSettings:
    """What the hub goes by.

    Attributes:
        supervision: Health and restarts.
        check_interval_s: Between reports.
        resource_interval_s: Between allocations.
        optimization_interval_s: Between decisions about the policy.
        policy_dwell_s: How long a policy stays at least.
        flow_period_s: Expected between messages of the engines.
        routes: Links to choose among, most preferred first; empty for no choice.
    """

    supervision: SupervisionSettings = field(default_factory=SupervisionSettings)
    check_interval_s: float = 1.0
    resource_interval_s: float = 0.5
    optimization_interval_s: float = 10.0
    policy_dwell_s: float = 10.0
    flow_period_s: float = 1.0
    routes: tuple[str, ...] = ()


async def declare_settings(node: NodeHandle) -> HubSettings:
    """Declare all parameters, with limits and descriptions; their values."""

    async def number(name: str, default: float, low: float, high: float, what: str) -> float:
        value = await node.declare_parameter(
            f"~{name}", default, minimum=low, maximum=high, description=what, read_only=True
        )
        return float(value)

    await _declare_limits(node)
    recovery = await node.declare_parameter(
        "~recovery_enabled", True, description="Start what failed again", read_only=True
    )
    routes = await node.declare_parameter(
        "~routes", "", description="Links to choose among, the most preferred first", read_only=True
    )
    return HubSettings(
        SupervisionSettings(
            await number("hung_after", 2.0, 0.6, 60, "Silence after which it is killed, s"),
            await number("inactive_after", 5.0, 1, 600, "The same for processes of others, s"),
            await number("discovery_time", 1.2, 0, 60, "To listen for what runs already, s"),
            await number("discovery_timeout", 5.0, 0.1, 600, "Discovery phase, s"),
            await number("initialization_timeout", 30.0, 1, 600, "Initialization phase, s"),
            bool(recovery),
        ),
        await number("check_interval", 1.0, 0.1, 60, "Between reports, s"),
        await number("resource_interval", 0.5, 0.05, 60, "Between allocations, s"),
        await number("global_optimization_interval", 10.0, 0.1, 3600, "Between policies, s"),
        await number("policy_dwell", 10.0, 0, 3600, "A policy stays at least, s"),
        await number("flow_period", 1.0, 0.01, 60, "Expected between engines' messages, s"),
        routes_of(str(routes)),
    )


async def _declare_limits(node: NodeHandle) -> None:
    declare = node.declare_parameter
    await declare(
        "~max_total_prbs", 100, minimum=1, maximum=100_000, description="Resource blocks there are"
    )
    await declare("~max_total_bandwidth", 1000.0, minimum=0.1, description="Rate there is, Mbit/s")
    await declare("~max_users", 20, minimum=1, maximum=100_000, description="Links at a time")
    await declare(
        "~prb_floor", 5, minimum=0, maximum=1000, description="Blocks each link gets at least"
    )
    await declare("~rate_floor", 64, minimum=0, description="Rate each link gets at least, kbit/s")
    await declare(
        "~priority_management_enabled", True, description="Critical links rise, others give way"
    )


def resource_limits(node: NodeHandle) -> ResourceLimits:
    """The present values."""
    known = node.parameters
    return ResourceLimits(
        int(known["~max_total_prbs"]),
        float(known["~max_total_bandwidth"]),
        int(known["~max_users"]),
        int(known["~prb_floor"]),
        int(known["~rate_floor"]),
    )
