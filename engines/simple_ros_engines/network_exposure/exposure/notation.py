"""How the interfaces write rates, times and flows. Pure."""

from __future__ import annotations

import math
from datetime import datetime, timedelta

from simple_ros_engines.network_exposure.exposure.model import FiveTuple, QosRequest, UeIdentity

__all__ = [
    "bit_rate",
    "bits_per_second",
    "error_rate",
    "flow_descriptions",
    "reserved_rates",
    "session_end",
    "uri_stamp",
]

_UNITS = {"bps": 1, "Kbps": 1e3, "Mbps": 1e6, "Gbps": 1e9, "Tbps": 1e12}


def bit_rate(rate: float) -> str:
    """bit/s as TS 29.571 writes them, rounded up."""
    bits = max(1, math.ceil(rate))
    for unit, size in (("Gbps", 1e9), ("Mbps", 1e6), ("Kbps", 1e3)):
        if bits >= size:
            return f"{math.ceil(bits / size * 1000) / 1000:g} {unit}"
    return f"{bits} bps"


def bits_per_second(text: str) -> float:
    """Of such a text.

    Raises:
        ValueError: It is none.
    """
    number, _, unit = text.partition(" ")
    if unit not in _UNITS:
        raise ValueError(f"{text!r} is no bit rate")
    return float(number) * _UNITS[unit]


def error_rate(rate: float) -> str:
    """An error rate as TS 29.571 writes it: one digit, one digit of exponent; never looser."""
    exponent = min(9, max(0, math.ceil(-math.log10(rate) - 1e-9)))
    return f"{max(1, math.floor(rate * 10**exponent + 1e-9))}E-{exponent}"


def uri_stamp(moment: datetime) -> str:
    """RFC 3339, in UTC."""
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def flow_descriptions(flow: FiveTuple, ue: UeIdentity) -> list[str]:
    """The packet filter of a flow (IPFilterRule of RFC 6733): ``out`` is towards the device."""
    way = "in" if ue.is_uplink else "out"
    number = flow.protocol_number
    source = f"{flow.source_ip} {flow.source_port}"
    destination = f"{flow.destination_ip} {flow.destination_port}"
    return [f"permit {way} {number} from {source} to {destination}"]


def reserved_rates(request: QosRequest, prefix: str) -> dict[str, str]:
    """The bit rate to reserve in the direction of the flow, if the class has one; ``prefix`` begins its name."""
    if not request.wanted.is_gbr:
        return {}
    way = "Ul" if request.ue.is_uplink else "Dl"
    return {f"{prefix}{way}": bit_rate(request.bit_rate)}


def session_end(now: datetime, duration_s: int) -> datetime:
    """When a session ends that begins now."""
    return now + timedelta(seconds=duration_s)
