"""How good a link is, 0..1: pure.

Where a link has no radio numbers (a cable, a source that only knows round trips) quality comes from loss and
round trip alone, and is marked so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from simple_ros_engines.radio.mcs import McsTable, mcs_entry, mcs_table
from simple_ros_engines.radio_information.history import Session

__all__ = [
    "LinkQuality",
    "assess",
    "channel_capacity",
    "channel_stability",
    "deviation",
    "link_quality",
    "reliability",
    "spectral_efficiency",
    "transport_quality",
]

_WINDOW = 10
_DEFAULT = 0.5


@dataclass(frozen=True, slots=True)
class LinkQuality:
    """The assessment of a link.

    Attributes:
        quality: 0..1.
        stability: 0..1.
        reliability: 0..1.
        efficiency: Bits per second and Hz that arrive.
        capacity: Bits per second and Hz that theory allows.
        response_ms: Mean round trip of the last five samples; None if never measured.
        from_radio: False where it comes from loss and round trip alone.
    """

    quality: float
    stability: float
    reliability: float
    efficiency: float
    capacity: float
    response_ms: float | None
    from_radio: bool


def _clip(value: float) -> float:
    return max(0.0, min(1.0, value))


def deviation(values: Sequence[float]) -> float:
    """Standard deviation of all values there are; that of `statistics` is exact and fifty times slower."""
    mean = fmean(values)
    return math.sqrt(sum((value - mean) ** 2 for value in values) / len(values))


def link_quality(snrs_db: Sequence[float], blers: Sequence[float]) -> float:
    """``0.6 clip(SNR/30) + 0.4 (1 - min(1, 5 BLER))`` of the means; 0.5 while nothing is known.

    Both must be of the same direction. Without error rates the ratio counts alone.
    """
    if not snrs_db:
        return _DEFAULT
    signal = _clip(fmean(snrs_db) / 30)
    if not blers:
        return signal
    return 0.6 * signal + 0.4 * (1 - min(1.0, 5 * fmean(blers)))


def channel_stability(snrs_db: Sequence[float], blers: Sequence[float]) -> float:
    """``0.5 max(0, 1 - std(SNR)/10) + 0.5 max(0, 1 - 20 std(BLER))``; 0.5 below ten samples."""
    if len(snrs_db) < _WINDOW:
        return _DEFAULT
    signal = max(0.0, 1 - deviation(snrs_db) / 10)
    if len(blers) < _WINDOW:
        return signal
    return 0.5 * signal + 0.5 * max(0.0, 1 - 20 * deviation(blers))


def reliability(blers: Sequence[float]) -> float:
    """``clip(1 - 5 mean BLER)``; 0.5 while nothing is known."""
    return _clip(1 - 5 * fmean(blers)) if blers else _DEFAULT


def spectral_efficiency(
    mcs: int | None, bler: float | None, layers: int = 1, table: McsTable = McsTable.QAM64
) -> float:
    """Bits per resource element that arrive: order, code rate, layers, less what is lost.

    Indices beyond the table, which stand for retransmissions, count as its last.
    """
    if mcs is None:
        return 0.0
    index = min(mcs, len(mcs_table(table)) - 1)
    return mcs_entry(table, index).efficiency * layers * (1 - (bler or 0.0))


def channel_capacity(snr_db: float) -> float:
    """``log2(1 + SNR)``, bit/s/Hz (Shannon, 1948)."""
    return math.log2(1 + 10 ** (snr_db / 10))


def transport_quality(loss: float | None, rtt_ms: float | None) -> float:
    """Quality of a link of which only loss and round trip are known.

    No loss and 20 ms are 0.9; 20 % loss or a second are near 0. Square root of both parts' product.
    """
    arrived = 1 - min(1.0, 5 * (loss or 0.0))
    prompt = 1.0 if rtt_ms is None else 1 / (1 + rtt_ms / 100)
    return math.sqrt(arrived * prompt) if loss is not None or rtt_ms is not None else _DEFAULT


def assess(session: Session, table: McsTable = McsTable.QAM64) -> LinkQuality:
    """The assessment of a link now."""
    newest = session.newest
    side = newest.side()
    snr_name = "ul_snr_db" if side.name == "ul" else "dl_sinr_db"
    snrs = session.of(snr_name).last(_WINDOW)
    blers = session.of(f"{side.name}_bler").last(_WINDOW)
    rtts = session.of("rtt_ms").last(5)
    response = fmean(rtts) if rtts else None
    if not snrs:
        loss = newest.get("loss")
        arrived = _DEFAULT if loss is None else _clip(1 - 5 * loss)
        quality = transport_quality(loss, response)
        return LinkQuality(quality, _rtt_stability(session), arrived, 0.0, 0.0, response, False)
    return LinkQuality(
        link_quality(snrs, blers),
        channel_stability(snrs, blers),
        reliability(blers),
        spectral_efficiency(side.mcs, side.bler, int(newest.get("ri") or 1), table),
        channel_capacity(snrs[-1]),
        response,
        True,
    )


def _rtt_stability(session: Session) -> float:
    rtts = session.of("rtt_ms").last(_WINDOW)
    if len(rtts) < _WINDOW:
        return _DEFAULT
    return max(0.0, 1 - deviation(rtts) / max(1.0, fmean(rtts)))
