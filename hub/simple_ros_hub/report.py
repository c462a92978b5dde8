"""From the hub's state to diagnostics and messages. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from simple_ros.diagnostics.status import ERROR, OK, STALE, WARN, Level, Status
from simple_ros.msg.wireless_ros_msgs import (
    ComponentStatus,
    EngineStatus,
    GlobalPolicy,
    ResourceGrant,
    ResourceGrants,
    SystemEvent,
    WirelessPerformance,
)
from simple_ros_hub.components import Kind
from simple_ros_hub.conditions import Phase, State, View
from simple_ros_hub.journal import Entry
from simple_ros_hub.resources import Allocation

__all__ = [
    "component_status",
    "diagnose",
    "diagnose_hub",
    "event_message",
    "grants_message",
    "performance_facts",
    "policy_message",
]

_WORDS: dict[State, tuple[Level, str]] = {
    State.WAITING: (WARN, "{kind} waiting for others"),
    State.STARTING: (WARN, "{kind} starting"),
    State.ACTIVE: (OK, "{kind} running normally"),
    State.DEGRADED: (WARN, "{kind} running degraded"),
    State.HUNG: (ERROR, "{need} {kind_lower} inactive"),
    State.RESTARTING: (ERROR, "{need} {kind_lower} not running"),
    State.GIVEN_UP: (ERROR, "{need} {kind_lower} not running"),
    State.STOPPING: (WARN, "{kind} stopping"),
    State.STOPPED: (STALE, "{kind} stopped"),
}


def diagnose(
    view: View, now_s: float, heartbeat: EngineStatus | None, facts: dict[str, str]
) -> Status:
    """The status of an engine or cell, with the names of WirelessROS.

    Args:
        view: What supervision knows of it.
        now_s: When.
        heartbeat: Its last sign of life.
        facts: More to show.
    """
    component = view.component
    kind = component.kind.value.capitalize()
    level, words = _WORDS[view.state]
    if not component.required and level == ERROR:
        level = WARN
    status = Status(f"WirelessROS {kind}: {component.name}")
    need = "Required" if component.required else "Optional"
    text = words.format(kind=kind, kind_lower=component.kind.value, need=need)
    status.summary(level, f"{text}: {view.message}" if view.message else text)
    for key, value in facts.items():
        status.add(key, value)
    status.add("State", view.state.value)
    status.add("Restarts", view.restarts)
    status.add("Process", view.pid or "not of the hub")
    if view.heard_s is not None:
        status.add("Last Heartbeat (s)", round(now_s - view.heard_s, 3))
    if heartbeat is not None:
        status.add("Mode", heartbeat.mode)
        status.add("Processed", heartbeat.processed)
        status.add("Errors", heartbeat.errors)
        status.add("Processing (ms)", f"{heartbeat.processing_ms_mean:.3f}")
    return status


def diagnose_hub(
    views: Sequence[View], phase: Phase, late: Sequence[str], facts: dict[str, str]
) -> Status:
    """The status of the whole."""
    status = Status("WirelessROS Hub")
    down = [view for view in views if view.component.required and not _is_well(view)]
    engines = [view.component.name for view in down if view.component.kind is Kind.ENGINE]
    cells = [view.component.name for view in down if view.component.kind is Kind.CELL]
    degraded = [view.component.name for view in views if view.state is State.DEGRADED]
    if phase is not Phase.OPERATION:
        status.summary(WARN, f"{phase.value.capitalize()} phase")
    elif engines or cells:
        told = [f"Critical engines inactive: {', '.join(engines)}"] if engines else []
        told += [f"Critical cells inactive: {', '.join(cells)}"] if cells else []
        status.summary(ERROR, "; ".join(told))
    elif degraded:
        status.summary(WARN, f"Degraded: {', '.join(degraded)}")
    else:
        status.summary(OK, "All systems operational")
    for kind, title in ((Kind.ENGINE, "Active Engines"), (Kind.CELL, "Active Cells")):
        status.add(title, sum(view.works for view in views if view.component.kind is kind))
    for key, value in facts.items():
        status.add(key, value)
    if late:
        status.add("Degraded Start", "; ".join(late))
    return status


def _is_well(view: View) -> bool:
    return view.works or view.state is State.STOPPED


def component_status(
    view: View, now_s: float, heartbeat: EngineStatus | None, usage: tuple[float, int] | None
) -> ComponentStatus:
    """The message of a component; usage is CPU in percent and memory in bytes."""
    cpu, memory = usage or (0.0, 0)
    message = ComponentStatus(
        name=view.component.name,
        kind=view.component.kind.value,
        node=view.component.node,
        state=view.state.value,
        message=view.message,
        required=view.component.required,
        pid=view.pid,
        restarts=view.restarts,
        heartbeat_age_s=-1 if view.heard_s is None else now_s - view.heard_s,
        cpu_percent=cpu,
        memory_bytes=memory,
        priority=view.component.priority,
    )
    if heartbeat is not None:
        message.mode = heartbeat.mode
        message.processed = heartbeat.processed
        message.errors = heartbeat.errors
        message.processing_ms_mean = heartbeat.processing_ms_mean
        message.processing_ms_max = heartbeat.processing_ms_max
    return message


def grants_message(
    blocks: Allocation,
    rates: Allocation,
    refused: dict[str, str],
    rntis: dict[str, int],
) -> ResourceGrants:
    """The typed grants.

    Args:
        blocks: Resource blocks.
        rates: Rates in kbit/s, of the same links in the same order.
        refused: Links that may send nothing, with reasons.
        rntis: By link.
    """
    message = ResourceGrants(
        total_prb=blocks.total,
        requested_prb=blocks.requested,
        granted_prb=blocks.granted,
        jain_index=blocks.jain,
        floors_scaled=blocks.floors_scaled,
        conflict=blocks.is_conflict,
        text=blocks.text(),
        total_bps=1000.0 * rates.total,
        granted_bps=1000.0 * rates.granted,
    )
    for block, rate in zip(blocks.grants, rates.grants, strict=True):
        message.grants.append(
            ResourceGrant(
                link_id=block.key,
                rnti=rntis.get(block.key, 0),
                requested_prb=block.wanted,
                granted_prb=block.granted,
                floor_prb=block.floor,
                priority=block.priority,
                requested_bps=1000.0 * rate.wanted,
                granted_bps=1000.0 * rate.granted,
            )
        )
    for key, reason in refused.items():
        message.refused.add(link_id=key, rnti=rntis.get(key, 0), reason=reason)
    return message


def policy_message(
    policy: str, reason: str, *, pinned: bool, parameters: Iterable[tuple[str, str]]
) -> GlobalPolicy:
    """A policy; ``parameters`` are JSON objects by engine."""
    return GlobalPolicy(
        policy=policy,
        reason=reason,
        text=f"Global Policy Updated: {policy}",
        pinned=pinned,
        parameters=dict(parameters),
    )


def event_message(entry: Entry) -> SystemEvent:
    """An entry of the journal."""
    message = SystemEvent(
        is_error=entry.is_error, component=entry.component, text=entry.text, number=entry.number
    )
    message.header.stamp.FromNanoseconds(entry.stamp_ns)
    return message


def performance_facts(performance: WirelessPerformance) -> dict[str, str]:
    """Numbers of the whole, for diagnostics; only those that are known."""
    titles = {
        "avg_bler": ("Avg BLER", "{:.4f}"),
        "avg_throughput": ("Avg Throughput (Mbps)", "{:.2f}"),
        "avg_latency": ("Avg Latency (ms)", "{:.1f}"),
        "resource_utilization": ("Resource Utilization", "{:.2f}"),
        "successful_transmissions": ("Successful Transmissions", "{}"),
        "failed_transmissions": ("Failed Transmissions", "{}"),
    }
    return {
        title: form.format(getattr(performance, name))
        for name, (title, form) in titles.items()
        if name in performance.known
    }
