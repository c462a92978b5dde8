"""What the fields of other people's databases mean: data, and the function that reads by it. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.record import (
    LinkRecord,
    link_id_of,
    parse_rnti,
    record,
)
from simple_ros_engines.store.annotated_csv import LastValue

__all__ = ["PRESETS", "FieldMap", "NewestPoints", "RawPoint", "preset", "read_fields", "rnti_of"]


@dataclass(frozen=True)
class FieldMap:
    """How to read a measurement.

    Attributes:
        measurement: Its name.
        fields: Raw name to our name, factor and what is added after it.
        ratios: Our name to the raw names of a part and of the rest: ``part / (part + rest)``.
        rnti_tag: Tag that holds the RNTI.
        rnti_base: 16 or 10.
    """

    measurement: str
    fields: Mapping[str, tuple[str, float, float]]
    ratios: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    rnti_tag: str = "rnti"
    rnti_base: int = 16


def _same(*names: str) -> dict[str, tuple[str, float, float]]:
    return {name: (name, 1.0, 0.0) for name in names}


PRESETS = {
    # The gNB of WirelessROS: throughput in Mbit/s, ratio in tenths of dB, RSSI as the FAPI code
    # (tenths of dB above -128 dBm).
    "wirelessros_oai": FieldMap(
        "glasses_18",
        {
            **_same("in_sync", "frame", "slot", "cqi", "ri", "dl_mcs", "ul_mcs"),
            **_same("dl_bler", "ul_bler"),
            "DL_Thr": ("dl_thr_bps", 1e6, 0.0),
            "UL_Thr": ("ul_thr_bps", 1e6, 0.0),
            "ph": ("power_headroom_db", 1.0, 0.0),
            "pcmax": ("pcmax_dbm", 1.0, 0.0),
            "avg_rsrp": ("rsrp_dbm", 1.0, 0.0),
            "raw_rssi": ("rssi_dbm", 0.1, -128.0),
            "ul_rssi": ("ul_rssi_dbm", 0.1, -128.0),
            "snr_pusch": ("ul_snr_db", 0.1, 0.0),
            "dlsch_total_byte": ("dl_bytes_total", 1.0, 0.0),
            "ulsch_total_byte": ("ul_bytes_total", 1.0, 0.0),
            "dl_total_rbs": ("dl_rbs_total", 1.0, 0.0),
            "ul_total_rbs": ("ul_rbs_total", 1.0, 0.0),
            "estimated_ul_buffer": ("buffer_bytes", 1.0, 0.0),
            "num_rsrp_meas": ("rsrp_samples", 1.0, 0.0),
            **_same("dl_max_mcs", "dl_pdus_total"),
            "sched_ul_bytes": ("ul_bytes_scheduled", 1.0, 0.0),
            "num_total_bytes": ("sdu_bytes_total", 1.0, 0.0),
            "dlsch_errors": ("dl_blocks_lost", 1.0, 0.0),
            "ulsch_errors": ("ul_blocks_lost", 1.0, 0.0),
            "dlsch_current_bytes": ("dl_bytes_slot", 1.0, 0.0),
            "ulsch_current_bytes": ("ul_bytes_slot", 1.0, 0.0),
            "dl_current_rbs": ("dl_rbs_slot", 1.0, 0.0),
            "ul_current_rbs": ("ul_rbs_slot", 1.0, 0.0),
            "dl_num_mac_sdu": ("dl_sdus_total", 1.0, 0.0),
            "ul_num_mac_sdu": ("ul_sdus_total", 1.0, 0.0),
        },
    ),
    "srsran": FieldMap(
        "ue",
        {
            **_same("cqi", "dl_mcs", "ul_mcs"),
            "dl_ri": ("ri", 1.0, 0.0),
            "dl_brate": ("dl_thr_bps", 1.0, 0.0),
            "ul_brate": ("ul_thr_bps", 1.0, 0.0),
            "pusch_snr_db": ("ul_snr_db", 1.0, 0.0),
            "bsr": ("buffer_bytes", 1.0, 0.0),
            "last_phr": ("power_headroom_db", 1.0, 0.0),
        },
        {"dl_bler": ("dl_nof_nok", "dl_nof_ok"), "ul_bler": ("ul_nof_nok", "ul_nof_ok")},
        rnti_base=10,
    ),
    "flexric_mac": FieldMap(
        "mac_stats",
        {
            **_same("frame", "slot", "dl_bler", "ul_bler"),
            "pusch_snr": ("ul_snr_db", 1.0, 0.0),
            "wb_cqi": ("cqi", 1.0, 0.0),
            "dl_mcs1": ("dl_mcs", 1.0, 0.0),
            "ul_mcs1": ("ul_mcs", 1.0, 0.0),
            "phr": ("power_headroom_db", 1.0, 0.0),
            "bsr": ("buffer_bytes", 1.0, 0.0),
            "dl_aggr_bytes_sdus": ("dl_bytes_total", 1.0, 0.0),
            "ul_aggr_bytes_sdus": ("ul_bytes_total", 1.0, 0.0),
            "dl_aggr_prb": ("dl_rbs_total", 1.0, 0.0),
            "ul_aggr_prb": ("ul_rbs_total", 1.0, 0.0),
        },
    ),
}
"""Field maps by name."""


def preset(name: str) -> FieldMap:
    """A field map by its name.

    Raises:
        ConfigError: There is none.
    """
    if name not in PRESETS:
        raise ConfigError(f"field map {name!r} is none of {', '.join(PRESETS)}")
    return PRESETS[name]


def rnti_of(mapping: FieldMap, text: str) -> int | None:
    """The RNTI that a tag says; None if it says none."""
    text = text.strip()
    if mapping.rnti_base != 16:
        return parse_rnti(int(text)) if text.isdecimal() and len(text) <= 5 else None
    return parse_rnti(text if text.lower().startswith("0x") else f"0x{text}")


def read_fields(
    mapping: FieldMap,
    rnti_text: str,
    stamp_ns: int,
    source: str,
    raw: Mapping[str, object],
) -> LinkRecord | None:
    """The record of a point; None if its RNTI is none."""
    rnti = rnti_of(mapping, rnti_text)
    if rnti is None:
        return None
    values: dict[str, float | None] = {}
    for name, (ours, factor, added) in mapping.fields.items():
        number = _number(raw.get(name))
        if number is not None:
            values[ours] = number * factor + added
    for ours, (part, rest) in mapping.ratios.items():
        one, other = _number(raw.get(part)), _number(raw.get(rest))
        if one is not None and other is not None and one + other > 0:
            values[ours] = one / (one + other)
    derived = frozenset(mapping.ratios)
    return record(link_id_of(rnti), stamp_ns, source, values, rnti=rnti, derived=derived)


def _number(value: object) -> float | None:
    if not isinstance(value, bool | int | float):
        return None
    try:
        return float(value)
    except OverflowError:  # an integer of hundreds of digits
        return math.inf


@dataclass(frozen=True, slots=True)
class RawPoint:
    """One device at one moment, in the words of its database.

    Attributes:
        rnti: Value of the tag that holds the RNTI.
        stamp_ns: When.
        fields: By raw name.
    """

    rnti: str
    stamp_ns: int
    fields: Mapping[str, object]


class NewestPoints:
    """Turns newest points of devices into records, each point once.

    Args:
        mapping: How to read them.
        source: Name of the source.
    """

    def __init__(self, mapping: FieldMap, source: str) -> None:
        self._mapping = mapping
        self._source = source
        self._seen: dict[str, int] = {}

    def fresh(self, points: Iterable[RawPoint]) -> Iterator[LinkRecord | None]:
        """Records of the points not seen before; None for a device whose RNTI is none."""
        for point in points:
            if self._seen.get(point.rnti, -1) != point.stamp_ns:
                self._seen[point.rnti] = point.stamp_ns
                yield read_fields(
                    self._mapping, point.rnti, point.stamp_ns, self._source, point.fields
                )

    def of_values(self, values: Iterable[LastValue]) -> Iterator[LinkRecord | None]:
        """The same from newest values of fields, of which those of the newest moment count."""
        series: dict[str, list[LastValue]] = {}
        for value in values:
            rnti = value.tags.get(self._mapping.rnti_tag)
            if rnti is not None:
                series.setdefault(rnti, []).append(value)
        for rnti, items in series.items():
            stamp_ns = max(item.stamp_ns for item in items)
            raw = {item.name: item.value for item in items if item.stamp_ns == stamp_ns}
            yield from self.fresh([RawPoint(rnti, stamp_ns, raw)])

    def links(self, rntis: Iterable[str]) -> frozenset[str]:
        """Keys of the links of devices; what is no RNTI is left out."""
        found = (rnti_of(self._mapping, text) for text in rntis)
        return frozenset(link_id_of(rnti) for rnti in found if rnti is not None)
