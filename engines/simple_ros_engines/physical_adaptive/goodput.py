"""Which scheme brings most where the signal at the time of sending is only foretold: pure.

A report is old when the block is sent, so the ratio then is a forecast with a deviation, and the chance that a block
arrives is the model's error curve smoothed by it. The scheme is the one with the greatest expected goodput, less a
price for each lost block. What arrives teaches three things: the offset of the radio against the model, and that of
each scheme against the others, moved by the difference of what arrived to what was expected to (stochastic
gradient of the likelihood, Robbins and Monro, 1951), and the price, which rises while more blocks are lost than
the target (a Lagrange multiplier). Against one threshold for all schemes, as in `link_adaptation`, blocks are lost
where they cost the fewest bits.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from simple_ros.errors import ConfigError
from simple_ros_engines.radio.bler import DEFAULT_RE, required_snr_db
from simple_ros_engines.radio.mcs import McsTable, mcs_table

__all__ = ["Choice", "GoodputAdapter", "SampledGoodput"]

Floats = NDArray[np.float64]

_LOW_DB, _HIGH_DB, _STEP_DB = -25.0, 50.0, 0.1
_MARGIN = 10
_ONE_SIGMA = 0.1587
_FIRST_GEAR = 25.0
"""How many times further the first block moves offset and price; less with the root of their count."""
_LIMIT_DB = 8.0
_SCHEME_LIMIT_DB = _MARGIN * _STEP_DB
_PRICE_LIMIT = 3.0
_BLOCKS = 10
_SAMPLES = 20
_LEAST_ARRIVAL = 0.7
"""Schemes that less often arrive are not chosen, however cheap losses are; where none does so often, the lowest is."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What to send with.

    Attributes:
        mcs: Index of the scheme.
        expected: Share of blocks that should arrive.
    """

    mcs: int
    expected: float


@lru_cache(maxsize=64)
def _arrivals(table: McsTable, n_re: int, deviation_steps: int) -> Floats:
    """Chance of arrival by ratio and scheme."""
    entries = mcs_table(table)
    low = np.array([required_snr_db(mcs, 1 - _ONE_SIGMA, n_re) for mcs in entries])
    high = np.array([required_snr_db(mcs, _ONE_SIGMA, n_re) for mcs in entries])
    width = np.hypot((high - low) / 2, deviation_steps * _STEP_DB)
    ratios = np.arange(_LOW_DB, _HIGH_DB, _STEP_DB)
    away = (ratios[:, None] - (low + high) / 2) / width
    erf: Floats = np.vectorize(math.erf)(away / math.sqrt(2))
    arrivals: Floats = 0.5 * (1 + erf)
    return arrivals


class GoodputAdapter:
    """Chooses the scheme of one link.

    Args:
        target_bler: Share of first transmissions to lose; None: whatever brings most.
        table: Which schemes the link has.
        n_re: Resource elements of a typical allocation.
        rate_db: How far a block moves the offsets in the long run.
        price_rate: How far a block moves the price in the long run, bits per resource element.

    Attributes:
        offset_db: Added to the forecast.
        price: Of a lost block, bits per resource element; below 0 where the target allows more than pays.
    """

    def __init__(
        self,
        target_bler: float | None = 0.1,
        table: McsTable = McsTable.QAM64,
        n_re: int = DEFAULT_RE,
        *,
        rate_db: float = 0.02,
        price_rate: float = 0.005,
    ) -> None:
        if rate_db <= 0 or price_rate <= 0:
            raise ConfigError("rate_db and price_rate must be more than 0")
        self.offset_db = 0.0
        self.price = 0.0
        self._target = None if target_bler is None else _checked(target_bler)
        self._table = table
        self._n_re = n_re
        self._rate_db = rate_db
        self._price_rate = price_rate
        self._heard = 0.0
        count = len(mcs_table(table))
        self._schemes = np.arange(count)
        self._own_db = np.zeros(count)
        self._shifts = np.zeros(count, np.int64)
        self._efficiency = np.array([mcs.efficiency for mcs in mcs_table(table)])

    def choose(self, snr_db: float, deviation_db: float = 0.0) -> Choice:
        """The scheme for a forecast.

        Args:
            snr_db: Expected ratio at the time of sending.
            deviation_db: How far off the forecast usually is.
        """
        arrives = self._chances(snr_db, deviation_db)
        worth = arrives * (self._efficiency + self.price)
        worth[arrives < _LEAST_ARRIVAL] = -math.inf
        mcs = int(worth.argmax())
        return Choice(mcs, float(arrives[mcs]))

    def expectation(self, mcs: int, snr_db: float, deviation_db: float = 0.0) -> Choice:
        """A scheme that somebody else chose, and what should arrive of it; for `feedback`."""
        return Choice(mcs, float(self._chances(snr_db, deviation_db)[mcs]))

    def aim(self, target_bler: float) -> None:
        """Allow another share of lost blocks; what the link has taught stays.

        Raises:
            ConfigError: It does not lie between 0 and 1.
        """
        self._target = _checked(target_bler)

    def _chances(self, snr_db: float, deviation_db: float) -> Floats:
        """Of arrival, by scheme."""
        deviation = round(min(10.0, max(0.0, deviation_db)) / _STEP_DB)
        table = _arrivals(self._table, self._n_re, deviation)
        place = round((snr_db + self.offset_db - _LOW_DB) / _STEP_DB)
        rows = min(len(table) - 1 - _MARGIN, max(_MARGIN, place)) + self._shifts
        chances: Floats = table[rows, self._schemes]
        return chances

    def feedback(self, choice: Choice, arrived: float, lost: float) -> None:
        """Tell what became of blocks.

        Args:
            choice: What they were sent with.
            arrived: Blocks that arrived at the first transmission.
            lost: Blocks that did not.
        """
        self._heard += arrived + lost
        gear = max(1.0, _FIRST_GEAR / math.sqrt(max(1.0, self._heard)))
        surprise = arrived * (1 - choice.expected) - lost * choice.expected
        self.offset_db = min(
            _LIMIT_DB, max(-_LIMIT_DB, self.offset_db + gear * self._rate_db * surprise)
        )
        own_db = self._own_db[choice.mcs] + self._rate_db * surprise
        self._own_db[choice.mcs] = min(_SCHEME_LIMIT_DB, max(-_SCHEME_LIMIT_DB, own_db))
        self._shifts[choice.mcs] = round(self._own_db[choice.mcs] / _STEP_DB)
        if self._target is not None and self._is_free(choice, self._target):
            more = lost * (1 - self._target) - arrived * self._target
            moved = self.price + gear * self._price_rate * more
            self.price = min(_PRICE_LIMIT, max(-_PRICE_LIMIT, moved))

    def _is_free(self, choice: Choice, target: float) -> bool:
        """Whether more or less blocks could have been lost: at the ends of the table nobody has a choice."""
        is_last = choice.mcs == self._schemes.size - 1
        return choice.mcs > 0 and not (is_last and choice.expected > 1 - target)


class SampledGoodput:
    """`GoodputAdapter` for who sees a link some times a second, as an engine does.

    The newest ratio is the forecast, its usual change from one sample to the next the deviation. The share of
    lost blocks since the last sample stands for as many blocks as make it worth listening to.

    Args:
        target_bler: Share of first transmissions to lose.
        table: Which schemes the link has.
    """

    def __init__(self, target_bler: float = 0.1, table: McsTable = McsTable.QAM64) -> None:
        self._adapter = GoodputAdapter(target_bler, table)
        self._before: float | None = None
        self._changes: deque[float] = deque(maxlen=_SAMPLES)

    @property
    def offset_db(self) -> float:
        """What the radio is better than the model."""
        return self._adapter.offset_db

    @property
    def deviation_db(self) -> float:
        """How far the ratio usually moves from one sample to the next."""
        changes = self._changes
        return math.sqrt(sum(map(_squared, changes)) / len(changes)) if changes else 0.0

    def aim(self, target_bler: float) -> None:
        """Allow another share of lost blocks.

        Raises:
            ConfigError: It does not lie between 0 and 1.
        """
        self._adapter.aim(target_bler)

    def calibrate(self, snr_db: float, mcs: int, bler: float) -> None:
        """Learn from blocks of a scheme that the network chose.

        Args:
            snr_db: Reported ratio.
            mcs: Scheme they were sent with.
            bler: Share lost.
        """
        expected = self._adapter.expectation(mcs, snr_db, self.deviation_db)
        self._adapter.feedback(expected, _BLOCKS * (1 - bler), _BLOCKS * bler)

    def choose(self, snr_db: float) -> int:
        """The scheme for a measured ratio."""
        if self._before is not None:
            self._changes.append(snr_db - self._before)
        self._before = snr_db
        return self._adapter.choose(snr_db, self.deviation_db).mcs


def _squared(value: float) -> float:
    return value * value


def _checked(target_bler: float) -> float:
    if not 0 < target_bler < 1:
        raise ConfigError(f"target_bler is {target_bler}, must lie between 0 and 1")
    return target_bler
