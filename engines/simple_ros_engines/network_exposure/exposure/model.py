"""What the interfaces of networks have in common, as values. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from simple_ros.errors import SimpleRosError
from simple_ros_engines.network_exposure.qci import QosClass

__all__ = [
    "ApiMalformed",
    "ApiRefused",
    "ApiUnavailable",
    "Event",
    "ExposureError",
    "FiveTuple",
    "Notification",
    "QosRequest",
    "Session",
    "UeIdentity",
]


class ExposureError(SimpleRosError):
    """The network's interface did not do what it was asked."""


class ApiUnavailable(ExposureError, ConnectionError):
    """Nobody answers, or not in time, or only that it cannot now.

    Attributes:
        retry_after_s: When to ask again, if it said so.
    """

    def __init__(self, message: str, retry_after_s: float | None = None) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class ApiRefused(ExposureError, RuntimeError):
    """The network said no.

    Attributes:
        status: Of HTTP.
        reason: What it said.
    """

    def __init__(self, what: str, status: int, reason: str) -> None:
        super().__init__(f"{what}: refused with {status}: {reason or 'no reason given'}")
        self.status = status
        self.reason = reason


class ApiMalformed(ExposureError, ValueError):
    """What came is not what the standard says; the message names the fields.

    Attributes:
        location: Where something was made all the same, if the answer said so.
    """

    def __init__(self, message: str, location: str = "") -> None:
        super().__init__(message)
        self.location = location


class Event(Enum):
    """What a network tells about a session."""

    GRANTED = "granted"
    DOWNGRADED = "downgraded"
    RECOVERED = "recovered"
    TERMINATED = "terminated"
    MEASURED = "measured"


@dataclass(frozen=True, slots=True)
class FiveTuple:
    """A flow of packets.

    Attributes:
        protocol: ``TCP`` or ``UDP``.
        source_ip: Of the sender.
        source_port: Of the sender.
        destination_ip: Of the receiver.
        destination_port: Of the receiver.
    """

    protocol: str
    source_ip: str
    source_port: int
    destination_ip: str
    destination_port: int

    @property
    def protocol_number(self) -> int:
        """As in IP headers."""
        return 17 if self.protocol == "UDP" else 6

    @property
    def is_ipv6(self) -> bool:
        """Whether the addresses are IPv6."""
        return ":" in self.source_ip


@dataclass(frozen=True, slots=True)
class UeIdentity:
    """Which device of the network a flow belongs to; what is empty is not known.

    Attributes:
        gpsi: Generic public subscription identifier, ``msisdn-...`` or ``extid-...@domain``.
        ip: Its address in the network; empty takes that end of the flow which `is_uplink` names.
        is_uplink: Whether the flow leaves the device (else it comes to it).
    """

    gpsi: str = ""
    ip: str = ""
    is_uplink: bool = True

    @property
    def phone_number(self) -> str:
        """``+...`` of an MSISDN; empty for other identifiers."""
        return "+" + self.gpsi.removeprefix("msisdn-") if self.gpsi.startswith("msisdn-") else ""

    @property
    def external_id(self) -> str:
        """Of an external identifier; empty for others."""
        return self.gpsi.removeprefix("extid-") if self.gpsi.startswith("extid-") else ""

    def ip_in(self, flow: FiveTuple) -> str:
        """Its address."""
        return self.ip or (flow.source_ip if self.is_uplink else flow.destination_ip)


@dataclass(frozen=True, slots=True)
class QosRequest:
    """What is asked for one flow.

    Attributes:
        topic: Whose flow it is.
        flow: Its packets.
        ue: Its device.
        wanted: The class.
        alternatives: Others that would do, in order.
        bit_rate: bit/s.
        burst_bytes: Most bytes within a delay budget.
        duration_s: How long it is wanted, unless it is asked again.
    """

    topic: str
    flow: FiveTuple
    ue: UeIdentity
    wanted: QosClass
    alternatives: tuple[QosClass, ...] = ()
    bit_rate: float = 0.0
    burst_bytes: int = 0
    duration_s: int = 600


@dataclass(frozen=True, slots=True)
class Session:
    """What was granted.

    Attributes:
        id: Under which the network knows it: its URI, or what stands for that.
        applied_qci: The class given now; None while it is being set up, or if the network does not say.
        is_pending: Whether it is still being set up: `Event.GRANTED` will follow.
    """

    id: str
    applied_qci: int | None = None
    is_pending: bool = False


@dataclass(frozen=True, slots=True)
class Notification:
    """What the network told.

    Attributes:
        event: What happened.
        session_id: Of which session.
        applied_qci: The class given now; None if it was not said.
        detail: In words.
        measurements: By name: ``dl_delay_ms``, ``ul_delay_ms``, ``rt_delay_ms``, ``loss``, ``rate_bps``.
    """

    event: Event
    session_id: str
    applied_qci: int | None = None
    detail: str = ""
    measurements: Mapping[str, float] = field(default_factory=dict)
