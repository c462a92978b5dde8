"""From radio to navigation, from tasks to quality of service, from metrics to control limits: pure."""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros.errors import ConfigError
from simple_ros_engines.cross_domain.constraints import Limits

__all__ = [
    "ControlLimits",
    "NavParams",
    "TaskQos",
    "convert_network_metrics_to_control_limits",
    "map_task_priority_to_qos",
    "translate_constraints_to_nav_params",
]


@dataclass(frozen=True, slots=True)
class NavParams:
    """Parameters of a navigation stack.

    Attributes:
        max_vel_mps: Largest speed.
        inflation_radius_m: Distance kept from obstacles.
        comm_cost_weight: What coverage is worth to the planner (`path.PathWeights.weight`).
        planner_frequency_hz: How often to plan anew.
    """

    max_vel_mps: float
    inflation_radius_m: float
    comm_cost_weight: float
    planner_frequency_hz: float


def translate_constraints_to_nav_params(
    limits: Limits,
    *,
    max_vel_mps: float = 1.5,
    inflation_radius_m: float = 0.3,
    reaction_s: float = 0.2,
) -> NavParams:
    """Navigation parameters under a constraint.

    A robot that hears of things later drives slower by ``reaction / (reaction + latency)`` and keeps away
    by what it drives blind, a quarter of it.

    Args:
        limits: The constraint.
        max_vel_mps: With a perfect link.
        inflation_radius_m: With a perfect link.
        reaction_s: How long the robot itself takes to react.
    """
    late_s = limits.expected_latency_ms / 1000
    speed = max_vel_mps * reaction_s / (reaction_s + late_s)
    worse = 1 - limits.min_quality / 100
    return NavParams(
        speed,
        inflation_radius_m + 0.25 * speed * late_s,
        1.0 + 4.0 * worse,
        max(0.2, min(5.0, 0.5 / max(0.05, late_s))),
    )


@dataclass(frozen=True, slots=True)
class TaskQos:
    """Quality of service of a task.

    Attributes:
        five_qi: 5G QoS identifier (TS 23.501, table 5.7.4-1).
        qci: The like of LTE (TS 23.203, table 6.1.7-A).
        dscp: Differentiated services code point (RFC 4594).
        reliable: Whether lost messages are sent again.
        depth: Messages that may wait.
        deadline_s: Age at which a message is of no use.
    """

    five_qi: int
    qci: int
    dscp: int
    reliable: bool
    depth: int
    deadline_s: float


_QOS = {
    5: TaskQos(82, 3, 46, True, 10, 0.05),
    4: TaskQos(3, 3, 34, True, 20, 0.1),
    3: TaskQos(2, 2, 26, True, 50, 0.2),
    2: TaskQos(7, 7, 18, False, 20, 0.5),
    1: TaskQos(9, 9, 8, False, 5, 2.0),
}


def map_task_priority_to_qos(priority: int) -> TaskQos:
    """Quality of service of a priority, 1 lowest to 5.

    Raises:
        ConfigError: There is no such priority.
    """
    found = _QOS.get(priority)
    if found is None:
        raise ConfigError(f"priority {priority} is not 1..5")
    return found


@dataclass(frozen=True, slots=True)
class ControlLimits:
    """Limits of a control loop that runs over a link.

    Attributes:
        max_speed_mps: Largest speed.
        max_rate_hz: Largest rate of commands.
        hold_timeout_s: Silence after which to stop.
    """

    max_speed_mps: float
    max_rate_hz: float
    hold_timeout_s: float


def convert_network_metrics_to_control_limits(
    rtt_ms: float,
    loss: float = 0.0,
    *,
    safe_distance_m: float = 1.0,
    reaction_s: float = 0.2,
    margin: float = 0.8,
) -> ControlLimits:
    """Limits from round trip and loss.

    A command and what it caused are seen half a round trip late each; with loss one more round trip for
    each repetition that is expected. ``v = margin d / (latency + reaction)``; commands come at most twice
    per round trip.

    Args:
        rtt_ms: Round trip.
        loss: Share lost, 0..1.
        safe_distance_m: What may be driven blind.
        reaction_s: Of the robot itself.
        margin: Share of the bound to use.
    """
    rtt_s = max(1e-3, rtt_ms / 1000)
    late_s = rtt_s / max(0.05, 1 - loss)
    return ControlLimits(
        margin * safe_distance_m / (late_s + reaction_s),
        1 / (2 * rtt_s),
        max(0.2, 3 * late_s),
    )
