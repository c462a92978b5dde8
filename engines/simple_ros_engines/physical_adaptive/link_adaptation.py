"""Which scheme to use, corrected by what happens: pure.

The inner loop is `radio.bler.best_mcs`: the most efficient scheme that the model believes to meet the
target. Radios differ from the model by some dB, so an outer loop adds an offset to the measured ratio:
up a little with each block that arrives, down by ``step (1-t)/t`` with each that does not. It stands
still on average where the share of lost blocks is the target ``t`` (Pedersen et al., "Frequency domain
scheduling for OFDMA with limited and noisy channel feedback", VTC 2007).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from simple_ros.errors import ConfigError
from simple_ros_engines.radio.bler import DEFAULT_RE, best_mcs, implied_snr_db, required_snr_db
from simple_ros_engines.radio.mcs import McsTable, mcs_table

__all__ = ["LinkAdapter", "OuterLoop", "feedback_step"]


@dataclass(frozen=True, slots=True)
class OuterLoop:
    """The offset that a link has earned.

    Attributes:
        target_bler: Share of first transmissions that may be lost.
        step_up_db: Added for a block that arrived.
        limit_db: The offset stays within plus and minus this.
        offset_db: Added to the measured ratio.
    """

    target_bler: float = 0.1
    step_up_db: float = 0.02
    limit_db: float = 8.0
    offset_db: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.target_bler < 1:
            raise ConfigError(f"target_bler is {self.target_bler}, must lie between 0 and 1")
        if self.step_up_db <= 0 or self.limit_db <= 0:
            raise ConfigError("step_up_db and limit_db must be more than 0")

    def after(self, arrived: float, lost: float = 0.0) -> OuterLoop:
        """The loop after blocks arrived and were lost; shares of blocks are fine."""
        down = self.step_up_db * (1 - self.target_bler) / self.target_bler
        moved = self.offset_db + arrived * self.step_up_db - lost * down
        return replace(self, offset_db=min(self.limit_db, max(-self.limit_db, moved)))


class LinkAdapter:
    """Chooses the scheme of one link.

    Args:
        table: Which schemes the link has.
        loop: Target and steps.
        n_re: Resource elements of a typical allocation.
        max_index: The highest scheme it may use; None for all.
    """

    def __init__(
        self,
        table: McsTable = McsTable.QAM64,
        loop: OuterLoop | None = None,
        n_re: int = DEFAULT_RE,
        max_index: int | None = None,
    ) -> None:
        last = len(mcs_table(table)) - 1
        self.table = table
        self.loop = loop or OuterLoop()
        self.mcs = 0
        self._n_re = n_re
        self._max = last if max_index is None else min(last, max_index)

    @property
    def offset_db(self) -> float:
        """What the radio is better than the model."""
        return self.loop.offset_db

    def aim(self, target_bler: float) -> None:
        """Allow another share of lost blocks; what the link has earned stays.

        Raises:
            ConfigError: It does not lie between 0 and 1.
        """
        self.loop = replace(self.loop, target_bler=target_bler)

    def choose(self, snr_db: float) -> int:
        """The scheme for a measured ratio."""
        entry = best_mcs(
            self.table, snr_db + self.loop.offset_db, self.loop.target_bler, self._n_re
        )
        self.mcs = min(entry.index, self._max)
        return self.mcs

    def feedback(self, arrived: float, lost: float, mcs: int | None = None) -> None:
        """Tell what became of blocks.

        At an end of the table the offset is not driven further: there the share of lost blocks says
        nothing about it.

        Args:
            arrived: Blocks that arrived at the first transmission.
            lost: Blocks that did not.
            mcs: The scheme they were sent with; None for the one chosen last.
        """
        sent_with = self.mcs if mcs is None else mcs
        after = self.loop.after(arrived, lost)
        rose = after.offset_db > self.loop.offset_db
        at_end = sent_with >= self._max if rose else sent_with <= 0
        if not at_end:
            self.loop = after

    def calibrate(self, snr_db: float, mcs: int, bler: float, weight: float = 0.05) -> None:
        """Learn from blocks that somebody else chose the scheme of, as a network does.

        The offset drifts to where the model would lose as many blocks. No lost block at all only says that
        the offset is at least so much, none that arrived that it is at most so much.

        Args:
            snr_db: Reported ratio.
            mcs: Scheme they were sent with.
            bler: Share lost.
            weight: Of this against all before.
        """
        entry = mcs_table(self.table)[mcs]
        change = implied_snr_db(entry, round(bler, 2), self._n_re) - snr_db - self.loop.offset_db
        says_nothing = (bler < 0.005 and change < 0) or (bler > 0.995 and change > 0)
        if not says_nothing:
            limit = self.loop.limit_db
            moved = min(limit, max(-limit, self.loop.offset_db + weight * change))
            self.loop = replace(self.loop, offset_db=moved)


def feedback_step(
    table: McsTable,
    mcs: int,
    bler: float,
    snr_db: float,
    snr_stability: float,
    *,
    target: tuple[float, float] = (0.01, 0.1),
    n_re: int = DEFAULT_RE,
) -> int:
    """The rule of WirelessROS, for sources that tell a mean error rate and no single blocks.

    Two schemes down above 1.5 times the upper target, one down above it; one up below the lower target if
    the link is stable and 3 dB of reserve remain.

    Args:
        table: Which schemes there are.
        mcs: The present one.
        bler: Mean share of blocks lost.
        snr_db: Mean ratio.
        snr_stability: 0..1.
        target: Where the share of lost blocks should be.
        n_re: Resource elements of a typical allocation.
    """
    entries = mcs_table(table)
    low, high = target
    if bler > 1.5 * high:
        return max(0, mcs - 2)
    if bler > high:
        return max(0, mcs - 1)
    following = mcs + 1
    if bler < low and snr_stability > 0.7 and following < len(entries):
        reserve_db = snr_db - required_snr_db(entries[following], high, n_re)
        return following if reserve_db > 3.0 else mcs
    return mcs
