"""Sessions and events of CAMARA Quality-on-Demand, from and to our own values. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from simple_ros_engines.network_exposure.exposure.model import (
    Event,
    Notification,
    QosRequest,
    UeIdentity,
)
from simple_ros_engines.network_exposure.exposure.notation import uri_stamp
from simple_ros_engines.network_exposure.qci import QosClass

__all__ = ["camara_event", "camara_profile", "camara_session"]


def camara_profile(wanted: QosClass, profiles: Mapping[str, str]) -> str:
    """The profile that stands for a class.

    Args:
        wanted: The class.
        profiles: Names by the number of a class, or by ``<=`` and a delay budget in ms; ``*`` for the rest.
    """
    exact = profiles.get(str(wanted.qci))
    if exact is not None:
        return exact
    limits = sorted(int(key[2:]) for key in profiles if key.startswith("<="))
    for limit in limits:
        if wanted.delay_ms <= limit:
            return profiles[f"<={limit}"]
    return profiles["*"]


def camara_session(
    request: QosRequest, profile: str, sink: str, token: str, token_until: datetime
) -> dict[str, Any]:
    """A session for one flow."""
    flow, ue = request.flow, request.ue
    ours = (flow.source_ip, flow.source_port)
    theirs = (flow.destination_ip, flow.destination_port)
    if not ue.is_uplink:
        ours, theirs = theirs, ours
    body: dict[str, Any] = {
        "device": _device(ue.ip or ours[0], ours[1], ue),
        "applicationServer": {
            "ipv6Address" if flow.is_ipv6 else "ipv4Address": theirs[0],
        },
        "devicePorts": {"ports": [ours[1]]},
        "applicationServerPorts": {"ports": [theirs[1]]},
        "qosProfile": profile,
        "duration": request.duration_s,
    }
    if sink:
        body["sink"] = sink
        body["sinkCredential"] = {
            "credentialType": "ACCESSTOKEN",
            "accessToken": token,
            "accessTokenExpiresUtc": uri_stamp(token_until),
            "accessTokenType": "bearer",
        }
    return body


def _device(ip: str, port: int, ue: UeIdentity) -> dict[str, Any]:
    if ue.phone_number:
        return {"phoneNumber": ue.phone_number}
    if ":" in ip:
        return {"ipv6Address": ip}
    return {"ipv4Address": {"publicAddress": ip, "publicPort": port}}


def camara_event(event: Mapping[str, Any]) -> Notification:
    """What an event says."""
    data = event["data"]
    if data["qosStatus"] == "AVAILABLE":
        return Notification(Event.GRANTED, data["sessionId"])
    return Notification(
        Event.TERMINATED, data["sessionId"], None, data.get("statusInfo", "UNAVAILABLE")
    )
