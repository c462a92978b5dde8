"""Modulation and coding schemes of 5G NR: pure tables.

3GPP TS 38.214, tables 5.1.3.1-1 to -3 (MCS) and 5.2.2.1-2 to -4 (CQI). A code rate is given as in the
standard, times 1024.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from simple_ros.errors import ConfigError

__all__ = ["Mcs", "McsTable", "cqi_efficiency", "cqi_to_mcs", "mcs_entry", "mcs_table"]


class McsTable(Enum):
    """Which table a link uses."""

    QAM64 = "64QAM"  # 5.1.3.1-1
    QAM256 = "256QAM"  # 5.1.3.1-2
    LOW_SE = "low-SE"  # 5.1.3.1-3, for high reliability


@dataclass(frozen=True, slots=True)
class Mcs:
    """One scheme.

    Attributes:
        index: Its number in the table.
        order: Bits a symbol: 2 QPSK, 4 16QAM, 6 64QAM, 8 256QAM.
        rate_x1024: Code rate times 1024.
    """

    index: int
    order: int
    rate_x1024: float

    @property
    def code_rate(self) -> float:
        """Information bits per coded bit."""
        return self.rate_x1024 / 1024

    @property
    def efficiency(self) -> float:
        """Information bits per resource element."""
        return self.order * self.rate_x1024 / 1024

    @property
    def modulation(self) -> str:
        """The name people use."""
        return "QPSK" if self.order == 2 else f"{1 << self.order}QAM"


_Rows = tuple[tuple[int, tuple[float, ...]], ...]

_MCS_ROWS: dict[McsTable, _Rows] = {
    McsTable.QAM64: (
        (2, (120, 157, 193, 251, 308, 379, 449, 526, 602, 679)),
        (4, (340, 378, 434, 490, 553, 616, 658)),
        (6, (438, 466, 517, 567, 616, 666, 719, 772, 822, 873, 910, 948)),
    ),
    McsTable.QAM256: (
        (2, (120, 193, 308, 449, 602)),
        (4, (378, 434, 490, 553, 616, 658)),
        (6, (466, 517, 567, 616, 666, 719, 772, 822, 873)),
        (8, (682.5, 711, 754, 797, 841, 885, 916.5, 948)),
    ),
    McsTable.LOW_SE: (
        (2, (30, 40, 50, 64, 78, 99, 120, 157, 193, 251, 308, 379, 449, 526, 602)),
        (4, (340, 378, 434, 490, 553, 616)),
        (6, (438, 466, 517, 567, 616, 666, 719, 772)),
    ),
}

_CQI_ROWS: dict[McsTable, _Rows] = {
    McsTable.QAM64: (
        (2, (78, 120, 193, 308, 449, 602)),
        (4, (378, 490, 616)),
        (6, (466, 567, 666, 772, 873, 948)),
    ),
    McsTable.QAM256: (
        (2, (78, 193, 449)),
        (4, (378, 490, 616)),
        (6, (466, 567, 666, 772, 873)),
        (8, (711, 797, 885, 948)),
    ),
    McsTable.LOW_SE: (
        (2, (30, 50, 78, 120, 193, 308, 449, 602)),
        (4, (378, 490, 616)),
        (6, (466, 567, 666, 772)),
    ),
}


def _entries(rows: _Rows, first: int) -> tuple[Mcs, ...]:
    flat = [(order, rate) for order, rates in rows for rate in rates]
    return tuple(Mcs(index, order, rate) for index, (order, rate) in enumerate(flat, first))


_MCS = {table: _entries(rows, 0) for table, rows in _MCS_ROWS.items()}
_CQI = {table: _entries(rows, 1) for table, rows in _CQI_ROWS.items()}


def mcs_table(table: McsTable) -> tuple[Mcs, ...]:
    """All schemes of a table, in order of their index."""
    return _MCS[table]


def mcs_entry(table: McsTable, index: int) -> Mcs:
    """One scheme.

    Raises:
        ConfigError: The table has no such index (reserved ones are for retransmissions).
    """
    entries = _MCS[table]
    if not 0 <= index < len(entries):
        raise ConfigError(f"MCS {index} is not in table {table.value}: 0..{len(entries) - 1}")
    return entries[index]


def cqi_efficiency(table: McsTable, cqi: int) -> float:
    """Bits per resource element that a channel quality indicator stands for; 0 for CQI 0.

    Raises:
        ConfigError: The indicator is not 0..15.
    """
    if not 0 <= cqi <= 15:
        raise ConfigError(f"CQI {cqi} is not in 0..15")
    return _CQI[table][cqi - 1].efficiency if cqi else 0.0


def cqi_to_mcs(table: McsTable, cqi: int) -> int:
    """The scheme whose efficiency is closest to that of a CQI; 0 for CQI 0 too.

    Raises:
        ConfigError: The indicator is not 0..15.
    """
    wanted = cqi_efficiency(table, cqi)
    return min(_MCS[table], key=lambda mcs: abs(mcs.efficiency - wanted)).index
