"""How many resource blocks a rate takes: pure (TS 38.214, 5.1.3.2 and TS 38.101-1, 5.3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simple_ros_engines.radio.carrier import Carrier
from simple_ros_engines.radio.mcs import Mcs

__all__ = ["ResourceNeed", "resource_need"]

SMALLEST_RATIO = 0.05


@dataclass(frozen=True, slots=True)
class ResourceNeed:
    """What to ask for.

    Attributes:
        prb: Blocks in each slot, 1 to what there is.
        compression_ratio: Bytes out per byte in, so that the rest fits: 0.05..1, small is strong.
        rate_bps: What then goes through.
        wanted_prb: Blocks without compression.
    """

    prb: int
    compression_ratio: float
    rate_bps: float
    wanted_prb: int


def resource_need(
    rate_bps: float,
    mcs: Mcs,
    carrier: Carrier,
    *,
    available_prb: int | None = None,
    bler: float = 0.0,
) -> ResourceNeed:
    """Blocks and compression for a rate.

    Args:
        rate_bps: What the application wants to send.
        mcs: Scheme.
        carrier: The direction of the carrier.
        available_prb: Blocks this link may use; None for the whole carrier.
        bler: Share of blocks lost, which takes further blocks.
    """
    most = carrier.n_prb if available_prb is None else max(1, min(available_prb, carrier.n_prb))
    one_bps = carrier.rate_bps(mcs.efficiency, 1) * max(0.05, 1 - bler)
    wanted = max(1, math.ceil(rate_bps / one_bps - 1e-9))
    prb = min(wanted, most)
    fits_bps = prb * one_bps
    ratio = 1.0 if wanted <= most else max(SMALLEST_RATIO, fits_bps / rate_bps)
    return ResourceNeed(prb, ratio, min(rate_bps, fits_bps), wanted)
