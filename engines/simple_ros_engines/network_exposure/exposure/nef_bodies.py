"""Requests and events of NEF AsSessionWithQoS, from and to our own values. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simple_ros_engines.network_exposure.exposure.model import Event, Notification, QosRequest
from simple_ros_engines.network_exposure.exposure.notation import flow_descriptions, reserved_rates

__all__ = ["as_session", "nef_events"]

NEF_EVENTS = (
    "QOS_GUARANTEED", "QOS_NOT_GUARANTEED", "SUCCESSFUL_RESOURCES_ALLOCATION",
    "FAILED_RESOURCES_ALLOCATION", "SESSION_TERMINATION", "LOSS_OF_BEARER",
    "RECOVERY_OF_BEARER", "RELEASE_OF_BEARER", "QOS_MONITORING",
)  # fmt: skip


def as_session(request: QosRequest, notify_url: str, reference: str) -> dict[str, Any]:
    """A subscription for one flow.

    Args:
        request: What is wanted.
        notify_url: Where events go.
        reference: Name of a class in the agreement with the operator; ``{qci}`` stands for its number.
    """
    ip = request.ue.ip_in(request.flow)
    body: dict[str, Any] = {
        "notificationDestination": notify_url,
        "ueIpv6Addr" if ":" in ip else "ueIpv4Addr": ip,
        "flowInfo": [
            {"flowId": 1, "flowDescriptions": flow_descriptions(request.flow, request.ue)}
        ],
        "qosReference": reference.format(qci=request.wanted.qci),
        "events": list(NEF_EVENTS),
        "qosMonInfo": {
            "reqQosMonParams": ["UPLINK" if request.ue.is_uplink else "DOWNLINK"],
            "repFreqs": ["EVENT_TRIGGERED"],
            "repThreshUl" if request.ue.is_uplink else "repThreshDl": request.wanted.delay_ms,
        },
        "qosDuration": request.duration_s,
    }
    if request.alternatives:
        body["altQoSReferences"] = [reference.format(qci=row.qci) for row in request.alternatives]
    rates = reserved_rates(request, "reqGbr")
    if rates:
        body["tscQosReq"] = rates
    return body


_NEF = {
    "QOS_GUARANTEED": Event.RECOVERED,
    "RECOVERY_OF_BEARER": Event.RECOVERED,
    "SUCCESSFUL_RESOURCES_ALLOCATION": Event.GRANTED,
    "QOS_NOT_GUARANTEED": Event.DOWNGRADED,
    "LOSS_OF_BEARER": Event.DOWNGRADED,
    "FAILED_RESOURCES_ALLOCATION": Event.TERMINATED,
    "SESSION_TERMINATION": Event.TERMINATED,
    "RELEASE_OF_BEARER": Event.TERMINATED,
}


def nef_events(data: Mapping[str, Any], references: Mapping[str, int]) -> list[Notification]:
    """What a notification says; ``references`` are the numbers of the classes by their names."""
    found = []
    for report in data["eventReports"]:
        event = _NEF.get(report["event"], Event.MEASURED)
        applied = references.get(report.get("appliedQosRef", ""))
        measured = _nef_measured(report.get("qosMonReports", ()))
        found.append(Notification(event, data["transaction"], applied, report["event"], measured))
    return found


def _nef_measured(reports: Any) -> dict[str, float]:
    found: dict[str, float] = {}
    names = (("ulDelays", "ul_delay_ms"), ("dlDelays", "dl_delay_ms"), ("rtDelays", "rt_delay_ms"))
    for report in reports:
        for key, name in names:
            if report.get(key):
                found[name] = float(max(report[key]))
    return found
