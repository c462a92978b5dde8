"""How often a block is lost: a model without anybody's measured curves. Pure.

Normal approximation of the best code of a finite length (Polyanskiy, Poor, Verdu: "Channel coding rate
in the finite blocklength regime", 2010, eq. 296), for the complex Gaussian channel and per resource
element: ``BLER = Q(sqrt(n/V) (C - k/n + log2(n)/(2n)))`` with ``C = log2(1+s)`` and
``V = s(s+2)/(s+1)^2 log2(e)^2``. Real receivers lose 1 to 2 dB against it, more with dense
constellations; `IMPLEMENTATION_GAP_DB` stands for that. What a certain radio does differs by some dB
still: `physical_adaptive.link_adaptation` learns the rest.
"""

from __future__ import annotations

import math
from functools import lru_cache

from simple_ros_engines.radio.carrier import RE_PER_PRB, code_blocks
from simple_ros_engines.radio.mcs import Mcs, McsTable, mcs_table

__all__ = [
    "IMPLEMENTATION_GAP_DB",
    "best_mcs",
    "block_error_rate",
    "from_db",
    "implied_snr_db",
    "required_snr_db",
    "to_db",
]

IMPLEMENTATION_GAP_DB = {2: 1.0, 4: 1.3, 6: 1.6, 8: 1.9}
"""Loss of a real receiver by modulation order, dB."""

DEFAULT_RE = 20 * RE_PER_PRB
_LOG2_E = math.log2(math.e)


def to_db(ratio: float) -> float:
    """Ten times the decimal logarithm; ``-inf`` for 0."""
    return 10 * math.log10(ratio) if ratio > 0 else -math.inf


def from_db(db: float) -> float:
    """The ratio."""
    return float(10 ** (db / 10))


def _q(x: float) -> float:
    return 0.5 * math.erfc(x / math.sqrt(2))


def block_error_rate(mcs: Mcs, snr_db: float, n_re: int = DEFAULT_RE) -> float:
    """Expected share of transport blocks lost at the first transmission.

    Args:
        mcs: Scheme.
        snr_db: Signal to noise and interference ratio, effective over the allocation.
        n_re: Resource elements of the allocation.
    """
    snr = from_db(snr_db - IMPLEMENTATION_GAP_DB[mcs.order])
    count = code_blocks(int(mcs.efficiency * n_re))
    n = n_re / count
    capacity = math.log2(1 + snr)
    dispersion = snr * (snr + 2) / (snr + 1) ** 2 * _LOG2_E**2
    margin = capacity - mcs.efficiency + math.log2(n) / (2 * n)
    if dispersion <= 0:
        return 1.0
    one = _q(math.sqrt(n / dispersion) * margin)
    return float(-math.expm1(count * math.log1p(-one))) if one < 1 else 1.0


@lru_cache(maxsize=4096)
def required_snr_db(mcs: Mcs, target_bler: float, n_re: int = DEFAULT_RE) -> float:
    """The ratio at which a scheme meets a block error rate, dB, to 0.001."""
    low, high = -30.0, 60.0
    while high - low > 1e-3:
        middle = (low + high) / 2
        if block_error_rate(mcs, middle, n_re) > target_bler:
            low = middle
        else:
            high = middle
    return high


@lru_cache(maxsize=256)
def _by_efficiency(
    table: McsTable, target_bler: float, n_re: int
) -> tuple[tuple[float, float, Mcs], ...]:
    rows = [
        (mcs.efficiency, required_snr_db(mcs, target_bler, n_re), mcs) for mcs in mcs_table(table)
    ]
    return tuple(sorted(rows, key=lambda row: row[0], reverse=True))


def best_mcs(
    table: McsTable, snr_db: float, target_bler: float = 0.1, n_re: int = DEFAULT_RE
) -> Mcs:
    """The most efficient scheme that meets a block error rate; the first if none does.

    Args:
        table: Which schemes there are.
        snr_db: Effective ratio.
        target_bler: 0.1 for throughput, 1e-5 (with ``McsTable.LOW_SE``) for reliability.
        n_re: Resource elements of the allocation.
    """
    for _, needed_db, mcs in _by_efficiency(table, target_bler, n_re):
        if needed_db <= snr_db:
            return mcs
    return mcs_table(table)[0]


def implied_snr_db(mcs: Mcs, bler: float, n_re: int = DEFAULT_RE) -> float:
    """At which ratio the model would lose that share of blocks, dB; shares are kept in 0.002..0.998."""
    return required_snr_db(mcs, round(min(0.998, max(0.002, bler)), 3), n_re)
