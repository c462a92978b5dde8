"""Requests and reports of SEAL, from and to our own values. Pure."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from simple_ros_engines.network_exposure.exposure.model import (
    Event,
    Notification,
    QosRequest,
    UeIdentity,
)
from simple_ros_engines.network_exposure.exposure.notation import (
    bits_per_second,
    error_rate,
    flow_descriptions,
    reserved_rates,
    uri_stamp,
)

__all__ = [
    "monitoring_event",
    "monitoring_subscription",
    "unicast_subscription",
    "val_group",
    "val_target",
]


def val_target(ue: UeIdentity, fallback: str) -> dict[str, str]:
    """Exactly one identity, as the standard has it."""
    return {"valUeId": ue.external_id or ue.gpsi or fallback}


def val_group(group: str, members: list[dict[str, str]], service: str) -> dict[str, Any]:
    """A group document."""
    body: dict[str, Any] = {
        "valGroupId": group,
        "grpDesc": f"simple_ros {group}",
        "valServiceIds": [service],
        "com5GLanType": "IPV4",
    }
    if members:
        body["members"] = members
    return body


def unicast_subscription(
    request: QosRequest, notify_url: str, until: datetime, *, compat: str = ""
) -> dict[str, Any]:
    """A request for one flow. What ``uniQosReq`` holds is not standardised: see the documentation."""
    return {
        "valTgtUe": val_target(request.ue, request.ue.ip_in(request.flow)),
        "uniQosReq": json.dumps(
            _ericsson_qos(request) if compat == "ericsson" else _unique_qos(request),
            separators=(",", ":"),
        ),
        "duration": uri_stamp(until),
        "notifUri": notify_url,
        "reqTestNotif": False,
    }


def _unique_qos(request: QosRequest) -> dict[str, Any]:
    wanted = request.wanted
    qos: dict[str, Any] = {
        "5qi": wanted.qci,
        "pdb": wanted.delay_ms,
        "per": error_rate(wanted.error_rate),
        "flowDescriptions": flow_descriptions(request.flow, request.ue),
    }
    if request.burst_bytes:
        qos["maxBurst"] = request.burst_bytes
    if request.alternatives:
        qos["alternatives"] = [row.qci for row in request.alternatives]
    return qos | reserved_rates(request, "gbr")


def _ericsson_qos(request: QosRequest) -> dict[str, Any]:
    flow = request.flow
    rate = math.ceil(request.bit_rate)
    return {
        "type": "IPV6" if flow.is_ipv6 else "IPV4",
        "qci": request.wanted.qci,
        "ulBW": rate if request.ue.is_uplink else 0,
        "dlBW": 0 if request.ue.is_uplink else rate,
        "flowID": {
            "srcIp": flow.source_ip,
            "srcPort": flow.source_port,
            "dstIp": flow.destination_ip,
            "dstPort": flow.destination_port,
            "protocol": flow.protocol,
        },
    }


def monitoring_subscription(request: QosRequest, notify_url: str, period_s: int) -> dict[str, Any]:
    """Measurements, periodically and when the delay crosses what was asked for."""
    way = "ul" if request.ue.is_uplink else "dl"
    threshold = {
        "measThrValues": {f"{way}Delay": max(1, request.wanted.delay_ms)},
        "thrDirection": "CROSSED",
    }
    return {
        "valUeIds": [val_target(request.ue, request.ue.ip_in(request.flow))],
        "measReqs": {"measDataTypes": ["UL_DELAY", "DL_DELAY", "AVG_PLR", "AVG_DATA_RATE"]},
        "reportReqs": {
            "reportingMode": "PERIODIC",
            "reportingPeriod": max(1, period_s),
            "reportingThrs": [threshold],
        },
        "notifUri": notify_url,
    }


def monitoring_event(
    report: Mapping[str, Any], session_id: str, delay_limit_ms: float, is_uplink: bool
) -> Notification:
    """What a report says: whether the delay is above what was asked for."""
    data = report["measData"]
    found = {
        name: float(data[key])
        for key, name in (
            ("dlDelay", "dl_delay_ms"),
            ("ulDelay", "ul_delay_ms"),
            ("rtDelay", "rt_delay_ms"),
        )
        if key in data
    }
    if "avgPlr" in data:
        found["loss"] = data["avgPlr"] / 1000
    if "avgDataRate" in data:
        found["rate_bps"] = bits_per_second(data["avgDataRate"])
    delay_ms = found.get("ul_delay_ms" if is_uplink else "dl_delay_ms")
    if delay_ms is None or delay_limit_ms <= 0:
        return Notification(Event.MEASURED, session_id, measurements=found)
    event = Event.DOWNGRADED if delay_ms > delay_limit_ms else Event.RECOVERED
    return Notification(
        event, session_id, None, f"delay {delay_ms:g} ms, asked for {delay_limit_ms:g} ms", found
    )
