"""The record every source fills: one link at one moment, SI units, a quality for each field. Pure.

A value that is not a number, or that no radio can have (`FIELDS` has the limits), is withheld and its
field marked `Quality.OUT_OF_RANGE`: a source with wrong units is seen at once and nothing downstream
computes with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from simple_ros.errors import ConfigError

__all__ = ["FIELDS", "LinkRecord", "Quality", "Side", "link_id_of", "parse_rnti", "record"]


class Quality(IntEnum):
    """Where a value comes from; the numbers of ``wireless_ros_msgs.FieldQuality``."""

    MISSING = 0
    MEASURED = 1
    DERIVED = 2
    SIMULATED = 3
    OUT_OF_RANGE = 4
    INTERPOLATED = 5


FIELDS: dict[str, tuple[float, float]] = {
    "in_sync": (0, 1),
    "frame": (0, 1023),
    "slot": (0, 319),
    "ul_snr_db": (-40, 60),
    "dl_sinr_db": (-40, 60),
    "rsrp_dbm": (-170, 0),
    "rsrq_db": (-45, 25),
    "rssi_dbm": (-140, 20),
    "ul_rssi_dbm": (-140, 20),
    "noise_dbm": (-180, -20),
    "rsrp_samples": (0, 1e9),
    "cqi": (0, 15),
    "ri": (1, 8),
    "dl_max_mcs": (0, 31),
    "dl_mcs": (0, 31),
    "ul_mcs": (0, 31),
    "dl_bler": (0, 1),
    "ul_bler": (0, 1),
    "dl_thr_bps": (0, 1e11),
    "ul_thr_bps": (0, 1e11),
    "dl_blocks_ok": (0, 1e15),
    "dl_blocks_lost": (0, 1e15),
    "ul_blocks_ok": (0, 1e15),
    "ul_blocks_lost": (0, 1e15),
    "dl_bytes_total": (0, 1e18),
    "ul_bytes_total": (0, 1e18),
    "dl_bytes_slot": (0, 1e9),
    "ul_bytes_slot": (0, 1e9),
    "dl_rbs_total": (0, 1e18),
    "ul_rbs_total": (0, 1e18),
    "dl_rbs_slot": (0, 300),
    "ul_rbs_slot": (0, 300),
    "dl_pdus_total": (0, 1e18),
    "dl_sdus_total": (0, 1e18),
    "ul_sdus_total": (0, 1e18),
    "sdu_bytes_total": (0, 1e18),
    "ul_bytes_scheduled": (0, 1e18),
    "prb_used": (0, 300),
    "prb_cell_used": (0, 300),
    "prb_total": (1, 300),
    "buffer_bytes": (0, 1e10),
    "power_headroom_db": (-60, 80),
    "pcmax_dbm": (-60, 60),
    "rtt_ms": (0, 600_000),
    "min_rtt_ms": (0, 600_000),
    "rtt_var_ms": (0, 600_000),
    "echo_rtt_ms": (0, 600_000),
    "loss": (0, 1),
    "delivery_bps": (0, 1e12),
    "phy_rate_bps": (0, 1e12),
}
"""Every field of a record, with the least and the largest value it can have."""


@dataclass(frozen=True, slots=True)
class Side:
    """One direction of a link: values that belong together.

    Attributes:
        name: ``"ul"`` or ``"dl"``.
        snr_db: Signal to noise and interference ratio.
        bler: Share of blocks lost.
        mcs: Scheme.
    """

    name: str
    snr_db: float | None
    bler: float | None
    mcs: int | None


@dataclass(frozen=True, slots=True)
class LinkRecord:
    """One link at one moment.

    Attributes:
        link_id: Key of the link.
        stamp_ns: When it was measured, ns since 1970.
        source: Which plug-in it came from.
        rnti: Radio network temporary identifier, if the source has them.
        values: By field name; what was not measured is absent.
        quality: By field name, for every field of `values` and those withheld.
    """

    link_id: str
    stamp_ns: int
    source: str
    rnti: int | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    quality: Mapping[str, Quality] = field(default_factory=dict)

    def get(self, name: str) -> float | None:
        """A value; None if it was not measured."""
        return self.values.get(name)

    def quality_of(self, name: str) -> Quality:
        """Where a value comes from."""
        return self.quality.get(name, Quality.MISSING)

    def suspects(self) -> Iterator[str]:
        """Fields that were withheld."""
        return (name for name, quality in self.quality.items() if quality is Quality.OUT_OF_RANGE)

    def side(self) -> Side:
        """The direction that is known best; the uplink if both are."""
        sides = (
            self._side("ul", self.get("ul_snr_db")),
            self._side("dl", self.get("dl_sinr_db")),
        )
        return max(sides, key=lambda s: (s.snr_db is not None) * 2 + (s.bler is not None))

    def _side(self, name: str, snr_db: float | None) -> Side:
        mcs = self.get(f"{name}_mcs")
        return Side(name, snr_db, self.get(f"{name}_bler"), None if mcs is None else int(mcs))

    def throughput_bps(self) -> float | None:
        """What both directions carry together; None if neither is known."""
        known = [v for v in (self.get("dl_thr_bps"), self.get("ul_thr_bps")) if v is not None]
        return sum(known) if known else None


def record(
    link_id: str,
    stamp_ns: int,
    source: str,
    values: Mapping[str, float | None],
    *,
    rnti: int | None = None,
    quality: Quality = Quality.MEASURED,
    derived: frozenset[str] | tuple[str, ...] = (),
) -> LinkRecord:
    """A record of raw values, checked.

    Args:
        link_id: Key of the link.
        stamp_ns: When it was measured.
        source: Which plug-in.
        values: By field name; None is missing.
        rnti: If the source has one.
        quality: Of the fields, unless they are ``derived`` (computed from measured ones).
        derived: Names of computed fields.

    Raises:
        ConfigError: A field is none of `FIELDS`.
    """
    kept: dict[str, float] = {}
    marks: dict[str, Quality] = {}
    for name, value in values.items():
        if value is None:
            continue
        limits = FIELDS.get(name)
        if limits is None:
            raise ConfigError(f"{name!r} is no field of a link record (source {source!r})")
        if limits[0] <= value <= limits[1]:
            kept[name] = float(value)
            is_derived = name in derived and quality is Quality.MEASURED
            marks[name] = Quality.DERIVED if is_derived else quality
        else:
            marks[name] = Quality.OUT_OF_RANGE
    return LinkRecord(link_id, stamp_ns, source, rnti, kept, marks)


def parse_rnti(text: str | float) -> int | None:
    """An RNTI written as a number, hexadecimal (4 digits, with or without 0x) or decimal.

    Text of exactly four characters is hexadecimal, as gNBs print it.

    Returns:
        1..65535; None for what is no RNTI.
    """
    try:
        if isinstance(text, str):
            word = text.strip().lower()
            as_hex = word.startswith("0x") or len(word) == 4
            value = int(word, 16) if as_hex else int(word)
        else:
            value = int(text) if math.isfinite(text) else 0
    except ValueError:
        return None
    return value if 1 <= value <= 0xFFFF else None


def link_id_of(rnti: int) -> str:
    """Key of a link that has an RNTI: four hexadecimal digits."""
    return f"{rnti:04x}"
