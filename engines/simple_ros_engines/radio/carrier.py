"""How much fits through a carrier: pure.

3GPP TS 38.101-1 table 5.3.2-1 (resource blocks of a channel), TS 38.211 clause 4 (slots), TS 38.214
clause 5.1.3.2 (resource elements and transport block size).
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass

from simple_ros.errors import ConfigError
from simple_ros_engines.radio.mcs import Mcs

__all__ = ["RE_PER_PRB", "Carrier", "code_blocks", "resource_blocks", "transport_block_bits"]

RE_PER_PRB = 156
"""Most resource elements of a block and slot that count for the transport block (38.214, 5.1.3.2)."""

_N_RB: dict[int, dict[int, int]] = {
    15: {5: 25, 10: 52, 15: 79, 20: 106, 25: 133, 30: 160, 40: 216, 50: 270},
    30: {
        5: 11, 10: 24, 15: 38, 20: 51, 25: 65, 30: 78, 40: 106,
        50: 133, 60: 162, 70: 189, 80: 217, 90: 245, 100: 273,
    },
    60: {
        10: 11, 15: 18, 20: 24, 25: 31, 30: 38, 40: 51,
        50: 65, 60: 79, 70: 93, 80: 107, 90: 121, 100: 135,
    },
}  # fmt: skip

_SMALL_TBS = (
    24, 32, 40, 48, 56, 64, 72, 80, 88, 96, 104, 112, 120, 128, 136, 144, 152, 160, 168, 176, 184,
    192, 208, 224, 240, 256, 272, 288, 304, 320, 336, 352, 368, 384, 408, 432, 456, 480, 504, 528,
    552, 576, 608, 640, 672, 704, 736, 768, 808, 848, 888, 928, 984, 1032, 1064, 1128, 1160, 1192,
    1224, 1256, 1288, 1320, 1352, 1416, 1480, 1544, 1608, 1672, 1736, 1800, 1864, 1928, 2024, 2088,
    2152, 2216, 2280, 2408, 2472, 2536, 2600, 2664, 2728, 2792, 2856, 2976, 3104, 3240, 3368, 3496,
    3624, 3752, 3824,
)  # fmt: skip
_SMALL_LIMIT = 3824
_CODE_BLOCK_BITS = 8448 - 24


def resource_blocks(scs_khz: int, bandwidth_mhz: int) -> int:
    """Blocks of a channel of frequency range 1.

    Raises:
        ConfigError: The standard has no such channel.
    """
    row = _N_RB.get(scs_khz)
    if row is None:
        raise ConfigError(f"subcarrier spacing {scs_khz} kHz is none of {sorted(_N_RB)}")
    if bandwidth_mhz not in row:
        raise ConfigError(
            f"no channel of {bandwidth_mhz} MHz at {scs_khz} kHz; there are {sorted(row)}"
        )
    return row[bandwidth_mhz]


@dataclass(frozen=True, slots=True)
class Carrier:
    """One direction of one carrier.

    Attributes:
        scs_khz: Subcarrier spacing: 15, 30 or 60.
        n_prb: Resource blocks.
        share: Share of slots in this direction: 1 for FDD, about 0.7 for a TDD downlink.
        layers: Spatial layers.
    """

    scs_khz: int = 30
    n_prb: int = 51
    share: float = 1.0
    layers: int = 1

    def __post_init__(self) -> None:
        if self.scs_khz not in _N_RB:
            raise ConfigError(f"scs_khz is {self.scs_khz}, none of {sorted(_N_RB)}")
        if self.n_prb < 1 or self.layers < 1 or not 0 < self.share <= 1:
            raise ConfigError(f"{self} needs n_prb >= 1, layers >= 1, 0 < share <= 1")

    @property
    def slots_per_s(self) -> float:
        """Slots of this direction in a second."""
        return 1000.0 * (self.scs_khz / 15) * self.share

    def rate_bps(self, efficiency: float, n_prb: float | None = None) -> float:
        """What ``n_prb`` blocks (all by default) carry at bits per resource element."""
        blocks = self.n_prb if n_prb is None else n_prb
        return efficiency * self.layers * blocks * RE_PER_PRB * self.slots_per_s


def transport_block_bits(mcs: Mcs, n_re: int, layers: int = 1) -> int:
    """Transport block size for ``n_re`` resource elements (38.214, 5.1.3.2, steps 2 to 4).

    Args:
        mcs: Scheme.
        n_re: Resource elements of the allocation.
        layers: Spatial layers.
    """
    n_info = mcs.efficiency * n_re * layers
    if n_info <= _SMALL_LIMIT:
        shift = max(3, int(math.log2(max(n_info, 1))) - 6)
        step = 1 << shift
        wanted = max(24, step * int(n_info // step))
        return _SMALL_TBS[min(bisect_left(_SMALL_TBS, wanted), len(_SMALL_TBS) - 1)]
    shift = int(math.log2(n_info - 24)) - 5
    step = 1 << shift
    quantised = max(3840, step * math.floor((n_info - 24) / step + 0.5))
    if mcs.code_rate <= 0.25:
        blocks = math.ceil((quantised + 24) / 3816)
    else:
        blocks = math.ceil((quantised + 24) / 8424) if quantised > 8424 else 1
    return 8 * blocks * math.ceil((quantised + 24) / (8 * blocks)) - 24


def code_blocks(bits: int) -> int:
    """Code blocks that a transport block is cut into (38.212, 5.2.2, base graph 1)."""
    return 1 if bits + 24 <= 8448 else math.ceil((bits + 24) / _CODE_BLOCK_BITS)
