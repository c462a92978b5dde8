"""What ``iw`` and ``/proc/net/wireless`` say: pure."""

from __future__ import annotations

import re
from collections.abc import Mapping

from simple_ros_engines.radio_information.record import LinkRecord, record

__all__ = ["parse_proc_wireless", "parse_station_dump", "parse_survey_noise"]

_STATION = re.compile(r"^Station ([0-9a-f:]{17}) \(on (\S+)\)", re.MULTILINE)
_LINE = re.compile(r"^\s+([^:\n]+):\s*(.+?)\s*$", re.MULTILINE)
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def parse_station_dump(
    text: str,
    stamp_ns: int,
    noise_dbm: float | None = None,
    before: Mapping[str, tuple[int, int]] | None = None,
) -> tuple[list[LinkRecord], dict[str, tuple[int, int]]]:
    """Records of ``iw dev IF station dump``, one for each station.

    Args:
        text: What it printed.
        stamp_ns: When.
        noise_dbm: From `parse_survey_noise`; gives the ratio.
        before: Sent and failed packets of each link, as returned the last time; gives loss.

    Returns:
        The records, and the counters for the next time.
    """
    starts = list(_STATION.finditer(text))
    records, counts = [], {}
    ends = [*(found.start() for found in starts[1:]), len(text)]
    for found, end in zip(starts, ends, strict=False):
        part = text[found.end() : end]
        fields = {name.strip().lower(): value for name, value in _LINE.findall(part)}
        link = f"{found[2]}/{found[1]}"
        sent, failed = _first(fields, "tx packets"), _first(fields, "tx failed")
        values: dict[str, float | None] = {
            "rssi_dbm": _first(fields, "signal avg", "signal"),
            "noise_dbm": noise_dbm,
            "phy_rate_bps": _times(_first(fields, "tx bitrate"), 1e6),
            "delivery_bps": _times(_first(fields, "expected throughput"), 1e6),
            "ul_bytes_total": _first(fields, "tx bytes"),
            "dl_bytes_total": _first(fields, "rx bytes"),
        }
        signal = values["rssi_dbm"]
        if signal is not None and noise_dbm is not None:
            values["dl_sinr_db"] = signal - noise_dbm
        if sent is not None and failed is not None:
            counts[link] = (int(sent), int(failed))
            values["loss"] = _loss(counts[link], (before or {}).get(link))
        records.append(record(link, stamp_ns, "wifi", values, derived=("dl_sinr_db", "loss")))
    return records, counts


def _loss(now: tuple[int, int], before: tuple[int, int] | None) -> float | None:
    if before is None or now[0] <= before[0] or now[1] < before[1]:
        return None
    return min(1.0, (now[1] - before[1]) / (now[0] - before[0]))


def _first(fields: Mapping[str, str], *names: str) -> float | None:
    for name in names:
        number = _NUMBER.search(fields.get(name, ""))
        if number is not None:
            return float(number[0])
    return None


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def parse_survey_noise(text: str) -> float | None:
    """Noise of the channel in use from ``iw dev IF survey dump``, dBm."""
    for part in text.split("Survey data from")[1:]:
        if "[in use]" in part:
            found = re.search(r"noise:\s*(-?\d+)", part)
            return float(found[1]) if found else None
    return None


def parse_proc_wireless(text: str, stamp_ns: int) -> list[LinkRecord]:
    """Records of ``/proc/net/wireless``: level and noise in dBm; -256 is unknown."""
    records = []
    for line in text.splitlines()[2:]:
        name, colon, rest = line.partition(":")
        numbers = [float(word.rstrip(".")) for word in _NUMBER.findall(rest)]
        if not colon or len(numbers) < 4:
            continue
        level, noise = numbers[2], numbers[3]
        known = -200 < noise < -20
        values = {
            "rssi_dbm": level if level < 0 else None,
            "noise_dbm": noise if known else None,
            "dl_sinr_db": level - noise if known and level < 0 else None,
        }
        records.append(record(name.strip(), stamp_ns, "wifi", values, derived=("dl_sinr_db",)))
    return records
