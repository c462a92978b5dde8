"""The standardised QoS classes of mobile networks: QCI (4G) and 5QI (5G), and code points for them. Pure.

TS 23.203 tables 6.1.7-A and -B; TS 23.501 table 5.7.4-1. Numbers up to 85 mean the same in both; 86 to 90 are 5G
only. A 5QI's priority level is ten times the QCI's. Delay budgets are one way, between device and core.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = [
    "FIVE_G_ONLY",
    "QCI",
    "RESERVED",
    "QosClass",
    "ResourceType",
    "dscp_of",
    "qos_class",
]

AVERAGING_WINDOW_MS = 2000


class ResourceType(Enum):
    """Whether the network reserves a bit rate."""

    GBR = "GBR"
    NON_GBR = "Non-GBR"


@dataclass(frozen=True, slots=True)
class QosClass:
    """One row.

    Attributes:
        qci: Its number, as QCI and as 5QI.
        resource: Whether it reserves a bit rate.
        priority: Priority level; the smaller, the more important.
        delay_ms: Packet delay budget.
        error_rate: Packet error loss rate.
        burst_bytes: Maximum data burst volume; None where the table has none.
        example: Service of the table.
    """

    qci: int
    resource: ResourceType
    priority: float
    delay_ms: int
    error_rate: float
    burst_bytes: int | None
    example: str

    @property
    def is_gbr(self) -> bool:
        """Whether it reserves a bit rate."""
        return self.resource is ResourceType.GBR

    @property
    def is_delay_critical(self) -> bool:
        """Whether 5G calls it delay-critical GBR: late counts as lost."""
        return self.burst_bytes is not None

    @property
    def five_qi_priority(self) -> int:
        """Priority level as 5QI, 1..127."""
        return round(10 * self.priority)

    @property
    def window_ms(self) -> int | None:
        """Averaging window of the bit rate; None without a reserved one."""
        return AVERAGING_WINDOW_MS if self.is_gbr else None


_ROWS = (
    (1, "GBR", 2, 100, 1e-2, None, "conversational voice"),
    (2, "GBR", 4, 150, 1e-3, None, "conversational video"),
    (3, "GBR", 3, 50, 1e-3, None, "real-time gaming, V2X, process automation monitoring"),
    (4, "GBR", 5, 300, 1e-6, None, "buffered video"),
    (65, "GBR", 0.7, 75, 1e-2, None, "mission-critical push to talk"),
    (66, "GBR", 2, 100, 1e-2, None, "push to talk"),
    (67, "GBR", 1.5, 100, 1e-3, None, "mission-critical video"),
    (71, "GBR", 5.6, 150, 1e-6, None, "live uplink streaming"),
    (72, "GBR", 5.6, 300, 1e-4, None, "live uplink streaming"),
    (73, "GBR", 5.6, 300, 1e-8, None, "live uplink streaming"),
    (74, "GBR", 5.6, 500, 1e-8, None, "live uplink streaming"),
    (75, "GBR", 2.5, 50, 1e-2, None, "V2X messages"),
    (76, "GBR", 5.6, 500, 1e-4, None, "live uplink streaming"),
    (82, "GBR", 1.9, 10, 1e-4, 255, "discrete automation, small packets"),
    (83, "GBR", 2.2, 10, 1e-4, 1354, "discrete automation, big packets"),
    (84, "GBR", 2.4, 30, 1e-5, 1354, "intelligent transport systems"),
    (85, "GBR", 2.1, 5, 1e-5, 255, "electricity distribution, high voltage"),
    (86, "GBR", 1.8, 5, 1e-4, 1354, "V2X, advanced driving"),
    (87, "GBR", 2.5, 5, 1e-3, 500, "interactive service, motion tracking"),
    (88, "GBR", 2.5, 10, 1e-3, 1125, "interactive service, motion tracking"),
    (89, "GBR", 2.5, 15, 1e-4, 17000, "visual content, split rendering"),
    (90, "GBR", 2.5, 20, 1e-4, 63000, "visual content, split rendering"),
    (5, "Non-GBR", 1, 100, 1e-6, None, "IMS signalling"),
    (6, "Non-GBR", 6, 300, 1e-6, None, "buffered video, TCP"),
    (7, "Non-GBR", 7, 100, 1e-3, None, "voice, live video, interactive gaming"),
    (8, "Non-GBR", 8, 300, 1e-6, None, "buffered video, TCP"),
    (9, "Non-GBR", 9, 300, 1e-6, None, "buffered video, TCP: the default bearer"),
    (10, "Non-GBR", 9, 1100, 1e-6, None, "buffered video, TCP, over satellite"),
    (69, "Non-GBR", 0.5, 60, 1e-6, None, "mission-critical signalling"),
    (70, "Non-GBR", 5.5, 200, 1e-6, None, "mission-critical data"),
    (79, "Non-GBR", 6.5, 50, 1e-2, None, "V2X messages"),
    (80, "Non-GBR", 6.8, 10, 1e-6, None, "low latency eMBB, augmented reality"),
)

QCI: dict[int, QosClass] = {
    row[0]: QosClass(row[0], ResourceType(row[1]), *row[2:]) for row in _ROWS
}
"""Every class by its number."""

RESERVED = frozenset({5, 65, 66, 67, 69, 70})
"""Mission-critical and IMS classes: only for who is authorised."""
FIVE_G_ONLY = frozenset({86, 87, 88, 89, 90})
"""Classes that have no QCI."""

_DSCP = {
    46: (1, 5, 65, 66),
    36: (2,),
    10: (3, 6),
    28: (4, 71, 72, 73, 74, 76),
    34: (67, 69, 80),
    18: (7, 8, 70, 75, 79, 82, 83, 84, 85, 86, 87, 88, 89, 90),
    0: (9, 10),
}
_DSCP_OF = {qci: dscp for dscp, numbers in _DSCP.items() for qci in numbers}


def qos_class(qci: int) -> QosClass | None:
    """The class of a number; None if the tables have none."""
    return QCI.get(qci)


def dscp_of(qci: int) -> int:
    """The code point (DSCP) that marks packets of a class; 0 for numbers the table does not have.

    The defaults of an operator's published table; where that has no row (75, 87 to 90, 10) that of its neighbours.
    """
    return _DSCP_OF.get(qci, 0)
