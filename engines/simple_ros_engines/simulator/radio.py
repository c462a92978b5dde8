"""What a simulated radio loses, and how an adapted link behaves. SIMULATED.

The curves are logistic in dB, with a width, a place by scheme and an offset of up to 2 dB that the engines
are not told: another shape than `radio.bler` has, so that adaptation has something to learn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simple_ros_engines.radio.carrier import Carrier
from simple_ros_engines.radio.mcs import McsTable, mcs_table

__all__ = ["HiddenCurves"]

Floats = NDArray[np.float64]

_GAP_DB = {2: 1.5, 4: 1.7, 6: 2.0, 8: 2.6}


@dataclass(frozen=True)
class HiddenCurves:
    """The true block error rates of one simulated radio.

    Attributes:
        offset_db: Of all curves; unknown to the engines.
        width_db: Of the logistic.
        jitter_db: Of each scheme, about its place.
        table: Which schemes it has.
    """

    offset_db: float
    width_db: float
    jitter_db: tuple[float, ...]
    table: McsTable = McsTable.QAM64
    _middles: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        shannon = [
            10 * math.log10(2**mcs.efficiency - 1) + _GAP_DB[mcs.order] + jitter
            for mcs, jitter in zip(mcs_table(self.table), self.jitter_db, strict=True)
        ]
        object.__setattr__(self, "_middles", np.array(shannon) + self.offset_db)

    @classmethod
    def drawn(
        cls,
        generator: np.random.Generator,
        table: McsTable = McsTable.QAM64,
        most_offset_db: float = 2.0,
    ) -> HiddenCurves:
        """A radio by chance: offset within plus and minus 2 dB, width 0.15 to 0.45 dB, jitter 0.2 dB."""
        return cls(
            float(generator.uniform(-most_offset_db, most_offset_db)),
            float(generator.uniform(0.15, 0.45)),
            tuple(float(x) for x in generator.normal(0.0, 0.2, len(mcs_table(table)))),
            table,
        )

    def bler(self, mcs: int, snr_db: float) -> float:
        """Share of first transmissions lost."""
        x = (snr_db - float(self._middles[mcs])) / self.width_db
        return 1 / (1 + math.exp(min(60.0, max(-60.0, x))))

    def goodputs(self, snr_db: float) -> Floats:
        """Bits per resource element that arrive, by scheme."""
        x = np.clip((snr_db - self._middles) / self.width_db, -60, 60)
        efficiency = np.array([mcs.efficiency for mcs in mcs_table(self.table)])
        result: Floats = efficiency / (1 + np.exp(-x))
        return result

    def genie(self, snr_db: float) -> int:
        """The scheme with the highest goodput, for who knows everything."""
        return int(np.argmax(self.goodputs(snr_db)))

    def rate_bps(
        self, mcs: int, snr_db: float, carrier: Carrier, prb: float | None = None
    ) -> float:
        """What arrives with a scheme."""
        efficiency = mcs_table(self.table)[mcs].efficiency
        return carrier.rate_bps(efficiency * (1 - self.bler(mcs, snr_db)), prb)
