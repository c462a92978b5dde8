"""How well the whole does, from what links and topics report. Pure.

A number that nobody measured is not invented: it is left out of `known`. A transmission is a block of the radio
where the source counts blocks, otherwise a numbered message of a watched topic: one that came succeeded, one
that is missing failed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import fmean

from simple_ros.msg.wireless_ros_msgs import ChannelState, FieldQuality, WirelessPerformance

__all__ = ["LinkNumbers", "Performance", "numbers_of"]


@dataclass(frozen=True, slots=True)
class LinkNumbers:
    """What a link's newest state says; None where it says nothing.

    Attributes:
        bler: Mean of both directions as far as known, 0..1.
        throughput_mbps: Sum of both directions.
        rtt_ms: Round trip.
        blocks: Blocks sent since attach.
        block_errors: Of these, lost for good.
        session: Counters begin anew with it.
        utilization: Of the cell, 0..1.
    """

    bler: float | None = None
    throughput_mbps: float | None = None
    rtt_ms: float | None = None
    blocks: int | None = None
    block_errors: int | None = None
    session: int = 0
    utilization: float | None = None


_GOOD = (FieldQuality.MEASURED, FieldQuality.DERIVED, FieldQuality.SIMULATED)


def numbers_of(state: ChannelState) -> LinkNumbers:
    """The numbers of a message; only what its flags say was measured."""
    flags = state.field_quality

    def known(*names: str) -> list[float]:
        return [float(getattr(state, name)) for name in names if flags.get(name) in _GOOD]

    blers = known("dl_bler", "ul_bler")
    rates = known("dl_thr", "ul_thr")
    rtts = known("rtt_ms")
    errors = known("dlsch_errors", "ulsch_errors")
    units = known("dl_num_mac_sdu", "ul_num_mac_sdu")
    cell = known("prb_cell_used", "prb_total")
    has_counters = bool(errors) and bool(units)
    return LinkNumbers(
        fmean(blers) if blers else None,
        sum(rates) if rates else None,
        rtts[0] if rtts else None,
        int(sum(units)) if has_counters else None,
        int(sum(errors)) if has_counters else None,
        state.session,
        cell[0] / cell[1] if len(cell) == 2 and cell[1] else None,
    )


@dataclass(slots=True)
class _Link:
    numbers: LinkNumbers
    seen_s: float


@dataclass(slots=True)
class Performance:
    """Gathers.

    Attributes:
        forget_after_s: Links that were not heard of for so long do not count.
    """

    forget_after_s: float = 5.0
    _links: dict[str, _Link] = field(default_factory=dict)
    _good: int = 0
    _bad: int = 0
    _counts_blocks: bool = False

    def link(self, key: str, numbers: LinkNumbers, now_s: float) -> None:
        """The newest state of a link."""
        before = self._links.get(key)
        self._links[key] = _Link(numbers, now_s)
        if numbers.blocks is None or numbers.block_errors is None:
            return
        self._counts_blocks = True
        old = before.numbers if before else None
        if old is None or old.session != numbers.session:
            return
        if old.blocks is not None and old.block_errors is not None:
            failed = max(0, numbers.block_errors - old.block_errors)
            sent = max(0, numbers.blocks - old.blocks)
            self._good += max(0, sent - failed)
            self._bad += failed

    def present(self, now_s: float) -> Mapping[str, LinkNumbers]:
        """The links that count."""
        gone = [k for k, link in self._links.items() if now_s - link.seen_s > self.forget_after_s]
        for key in gone:
            del self._links[key]
        return {key: link.numbers for key, link in self._links.items()}

    def metrics(
        self, now_s: float, *, granted_share: float | None, came: int, missing: int
    ) -> WirelessPerformance:
        """All numbers.

        Args:
            now_s: When.
            granted_share: Blocks granted over blocks there are, where no cell tells its use.
            came: Numbered messages that came, on all watched topics.
            missing: Those that are missing.
        """
        links = self.present(now_s).values()
        blers = [link.bler for link in links if link.bler is not None]
        rates = [link.throughput_mbps for link in links if link.throughput_mbps is not None]
        rtts = [link.rtt_ms for link in links if link.rtt_ms is not None]
        used = [link.utilization for link in links if link.utilization is not None]
        shares = used or ([granted_share] if granted_share is not None else [])
        means = {
            "avg_bler": blers,
            "avg_throughput": rates,
            "avg_latency": rtts,
            "resource_utilization": shares,
        }
        known = {name: fmean(values) for name, values in means.items() if values}
        good, bad = (self._good, self._bad) if self._counts_blocks else (came, missing)
        counted = "radio blocks" if self._counts_blocks else "messages of topics"
        counters = ["successful_transmissions", "failed_transmissions"]
        return WirelessPerformance(
            **known,
            successful_transmissions=good,
            failed_transmissions=bad,
            counted=counted,
            known=[*known, *(counters if good + bad else [])],
        )
