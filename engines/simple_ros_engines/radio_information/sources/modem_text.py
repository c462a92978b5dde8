"""What modems and gNBs print: ModemManager, Quectel's AT commands, OpenAirInterface's statistics. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterator

from simple_ros_engines.radio_information.record import (
    LinkRecord,
    link_id_of,
    parse_rnti,
    record,
)

__all__ = ["parse_mmcli_signal", "parse_oai_stats", "parse_qeng"]

_MMCLI = re.compile(r"^modem\.signal\.(\w+)\.([\w-]+)\s*:\s*(-?\d+(?:\.\d+)?)", re.MULTILINE)
_MMCLI_FIELDS = {
    "rsrp": "rsrp_dbm",
    "rsrq": "rsrq_db",
    "snr": "dl_sinr_db",
    "rssi": "rssi_dbm",
}


def parse_mmcli_signal(text: str, stamp_ns: int, link: str) -> LinkRecord | None:
    """The record of ``mmcli -m N --signal-get --output-keyvalue``; 5G where there is any, else LTE.

    Returns:
        None if the modem tells of neither.
    """
    found: dict[str, dict[str, float]] = {}
    for technology, name, value in _MMCLI.findall(text):
        if name in _MMCLI_FIELDS:
            found.setdefault(technology, {})[_MMCLI_FIELDS[name]] = float(value)
    values = found.get("5g") or found.get("lte")
    return None if not values else record(link, stamp_ns, "modemmanager", values)


_FORMS = {
    "NR5G-SA": (15, {"rsrp_dbm": 10, "rsrq_db": 11, "dl_sinr_db": 12}),
    "NR5G-NSA": (7, {"rsrp_dbm": 4, "dl_sinr_db": 5, "rsrq_db": 6}),
    "LTE": (16, {"rsrp_dbm": 11, "rsrq_db": 12, "rssi_dbm": 13, "dl_sinr_db": 14}),
}
"""Fields of a line by kind: how many there are at least, and the places of ours, counted from its kind."""


def parse_qeng(text: str, stamp_ns: int, link: str) -> list[LinkRecord]:
    """Records of the answer to ``AT+QENG="servingcell"``, 5G first.

    The order of fields varies with modules; what cannot be is withheld by the record's limits.
    """
    records = []
    for line in text.splitlines():
        _, found, rest = line.partition("+QENG:")
        words = [word.strip().strip('"') for word in rest.split(",")]
        kinds = [word for word in words if word in _FORMS]
        if not found or not kinds:
            continue
        kind = kinds[0]
        start = words.index(kind)
        least, places = _FORMS[kind]
        if len(words) - start >= least:
            at = words[start:]
            values = {name: _number(at[place]) for name, place in places.items()}
            records.append((kind == "LTE", record(link, stamp_ns, "quectel", values)))
    return [item for _, item in sorted(records, key=lambda pair: pair[0])]


def _number(text: str) -> float | None:
    return float(text) if re.fullmatch(r"-?\d+(?:\.\d+)?", text) else None


_UE = re.compile(r"^UE RNTI ([0-9a-fA-F]{4})\b(.*)$", re.MULTILINE)
_OAI = {
    "power_headroom_db": re.compile(r"\bPH (-?\d+) dB"),
    "pcmax_dbm": re.compile(r"\bPCMAX (-?\d+) dBm"),
    "rsrp_dbm": re.compile(r"average RSRP (-?\d+)"),
    "cqi": re.compile(r"\bCQI (\d+)"),
    "ri": re.compile(r"\bRI (\d+)"),
    "dl_bler": re.compile(r"dlsch_rounds.*?BLER (\d\.\d+)"),
    "dl_mcs": re.compile(r"dlsch_rounds.*?MCS \(\d+\) (\d+)"),
    "ul_bler": re.compile(r"ulsch_rounds.*?BLER (\d\.\d+)"),
    "ul_mcs": re.compile(r"ulsch_rounds.*?MCS \(\d+\) (\d+)"),
    "ul_snr_db": re.compile(r"ulsch_rounds.*?SNR (-?\d+(?:\.\d+)?) dB"),
    "dl_bytes_total": re.compile(r"MAC:\s+TX\s+(\d+)"),
    "ul_bytes_total": re.compile(r"MAC:\s+TX\s+\d+\s+RX\s+(\d+)"),
}


def parse_oai_stats(text: str, stamp_ns: int) -> Iterator[LinkRecord]:
    """Records of OpenAirInterface's ``nrMAC_stats.log``, one for each device."""
    starts = list(_UE.finditer(text))
    ends = [*(found.start() for found in starts[1:]), len(text)]
    for found, end in zip(starts, ends, strict=False):
        part = text[found.start() : end]
        rnti = parse_rnti(f"0x{found[1]}")
        if rnti is None:
            continue
        values: dict[str, float | None] = {}
        for name, pattern in _OAI.items():
            match = pattern.search(part)
            values[name] = None if match is None else float(match[1])
        if "out-of-sync" in found[2]:
            values["in_sync"] = 0
        elif "in-sync" in found[2]:
            values["in_sync"] = 1
        yield record(link_id_of(rnti), stamp_ns, "oai", values, rnti=rnti)
