"""One adapted link, sample by sample. SIMULATED: every record says so.

A device walks through a street canyon cell; the radio adapts its scheme with its own outer loop; other
devices take a share of the blocks; a queue fills when more is offered than the link carries.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from simple_ros_engines.physical_adaptive.link_adaptation import LinkAdapter, OuterLoop
from simple_ros_engines.radio.carrier import Carrier
from simple_ros_engines.radio.mcs import McsTable, mcs_table
from simple_ros_engines.radio_information.record import LinkRecord, Quality, link_id_of, record
from simple_ros_engines.simulator.propagation import Shadowing, umi_loss_db
from simple_ros_engines.simulator.radio import HiddenCurves

__all__ = ["Disturbance", "LinkSettings", "SimulatedLink"]

SOURCE = "synthetic"


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """Parameters of a simulated link.

    Attributes:
        period_s: Between samples.
        blocks: Transport blocks a sample.
        reports: Reports of the ratio a sample, each with its own fading and scheme.
        speed_mps: Of the device.
        distance_m: Least and largest distance to the station, between which it goes to and fro.
        power_dbm: Received at no path loss, by subcarrier.
        noise_dbm: By subcarrier.
        shadow_sigma_db: Standard deviation of shadowing.
        shadow_correlation_m: Its correlation distance.
        fast_sigma_db: Of what fading is left over a wide carrier, report to report.
        report_noise_db: Of what the radio reports.
        scheduler_sigma: Of the logarithm of the share of blocks, sample to sample.
        offered_bps: What the device wants to send.
        base_rtt_ms: Round trip with empty queues.
        rtt_jitter_ms: Standard deviation of it.
        carrier: The direction of the carrier.
        table: Which schemes it has.
    """

    period_s: float = 0.1
    blocks: int = 100
    reports: int = 5
    speed_mps: float = 1.4
    distance_m: tuple[float, float] = (40.0, 150.0)
    power_dbm: float = -2.0
    noise_dbm: float = -122.0
    shadow_sigma_db: float = 4.0
    shadow_correlation_m: float = 13.0
    fast_sigma_db: float = 1.0
    report_noise_db: float = 0.5
    scheduler_sigma: float = 0.5
    offered_bps: float = 5e6
    base_rtt_ms: float = 18.0
    rtt_jitter_ms: float = 2.0
    carrier: Carrier = field(default_factory=Carrier)
    table: McsTable = McsTable.QAM64


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What is done to a sample.

    Attributes:
        loss_db: Further path loss, seen in the report.
        hidden_db: Interference that the report does not contain.
        rtt_ms: Added to the round trip.
    """

    loss_db: float = 0.0
    hidden_db: float = 0.0
    rtt_ms: float = 0.0


_NOTHING = Disturbance()


class SimulatedLink:
    """A link that moves on by `step`.

    Args:
        generator: Randomness.
        settings: Parameters.
        rnti: Of the device.
        start_ns: Stamp of the first sample.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        settings: LinkSettings | None = None,
        rnti: int = 0x4601,
        start_ns: int = 0,
    ) -> None:
        self.settings = settings or LinkSettings()
        self.rnti = rnti
        self.curves = HiddenCurves.drawn(generator, self.settings.table)
        self.true_snr_db = 0.0
        self._generator = generator
        self._shadow = Shadowing(
            generator, self.settings.shadow_sigma_db, self.settings.shadow_correlation_m
        )
        self._adapter = LinkAdapter(self.settings.table, OuterLoop(0.1, 0.002))
        self._stamp_ns = start_ns
        self._travelled_m = float(generator.uniform(0, 2 * self._span_m()))
        self._share = float(generator.uniform(0.4, 1.0))
        self._queue_bytes = 0.0
        self._bytes_total = 0.0
        self._rbs_total = 0.0

    def _span_m(self) -> float:
        near, far = self.settings.distance_m
        return far - near

    def _distance_m(self) -> float:
        span = max(1e-6, self._span_m())
        at = self._travelled_m % (2 * span)
        return self.settings.distance_m[0] + (at if at <= span else 2 * span - at)

    def step(self, disturbance: Disturbance = _NOTHING) -> LinkRecord:
        """The next sample."""
        settings, draw = self.settings, self._generator
        moved_m = settings.speed_mps * settings.period_s
        self._travelled_m += moved_m
        loss = umi_loss_db(self._distance_m(), 3.5, line_of_sight=False)
        rsrp = settings.power_dbm - loss + self._shadow.moved(moved_m) - disturbance.loss_db
        mean_db = min(32.0, rsrp - settings.noise_dbm)
        fast = self._fades_db()
        noise = draw.normal(0, settings.report_noise_db, settings.reports).tolist()
        lost, mcs = 0, 0
        for fade, error in zip(fast, noise, strict=True):
            mcs = self._adapter.choose(mean_db + fade + error)
            lost += self._burst(mcs, mean_db + fade - disturbance.hidden_db)
        reported = mean_db + (sum(fast) + sum(noise)) / settings.reports
        self.true_snr_db = mean_db - disturbance.hidden_db
        return self._record(rsrp, reported, mcs, lost / settings.blocks, disturbance)

    def _fades_db(self) -> list[float]:
        """What fading adds at each report of a sample."""
        sigma, count = self.settings.fast_sigma_db, self.settings.reports
        fades: list[float] = self._generator.normal(0, sigma, count).tolist()
        return fades

    def _granted(self) -> float:
        """Share of the carrier's blocks in a sample, 0..1."""
        settings, draw = self.settings, self._generator
        if draw.random() < settings.period_s / 8:
            # Another device comes or goes.
            self._share = float(draw.uniform(0.3, 1.0))
        return min(1.0, self._share * math.exp(float(draw.normal(0, settings.scheduler_sigma))))

    def _burst(self, mcs: int, snr_db: float) -> int:
        """Send the blocks of one report; how many are lost."""
        count = self.settings.blocks // self.settings.reports
        lost = int(self._generator.binomial(count, self.curves.bler(mcs, snr_db)))
        self._adapter.feedback(count - lost, lost)
        return lost

    def _record(
        self, rsrp: float, snr: float, mcs: int, bler: float, disturbance: Disturbance
    ) -> LinkRecord:
        settings, draw = self.settings, self._generator
        efficiency = mcs_table(settings.table)[mcs].efficiency * (1 - bler)
        prb = self._granted() * settings.carrier.n_prb
        could_bps = settings.carrier.rate_bps(efficiency, prb)
        offered = settings.offered_bps * settings.period_s / 8
        sent = min(self._queue_bytes + offered, could_bps * settings.period_s / 8)
        self._queue_bytes = min(2e6, self._queue_bytes + offered - sent)
        self._bytes_total += sent
        used = prb * (sent / max(1e-9, could_bps * settings.period_s / 8))
        self._rbs_total += used * settings.carrier.slots_per_s * settings.period_s
        waiting_ms = min(5000.0, 8e3 * self._queue_bytes / max(1e3, could_bps))
        jitter = abs(float(draw.normal(0, settings.rtt_jitter_ms)))
        self._stamp_ns += round(settings.period_s * 1e9)
        return record(
            link_id_of(self.rnti),
            self._stamp_ns,
            SOURCE,
            {
                "in_sync": 1,
                "ul_snr_db": snr,
                "ul_mcs": mcs,
                "ul_bler": bler,
                "ul_thr_bps": sent * 8 / settings.period_s,
                "delivery_bps": could_bps,
                "rsrp_dbm": rsrp,
                "rsrq_db": -10.8 - 3 * (1 - self._share),
                "buffer_bytes": self._queue_bytes,
                "ul_bytes_total": math.floor(self._bytes_total),
                "ul_rbs_total": math.floor(self._rbs_total),
                "prb_used": used,
                "prb_cell_used": min(settings.carrier.n_prb, used + (1 - self._share) * 40),
                "prb_total": settings.carrier.n_prb,
                "rtt_ms": settings.base_rtt_ms + waiting_ms + jitter + disturbance.rtt_ms,
                "cqi": max(0, min(15, round((snr + 6) / 2))),
                "ri": 1,
            },
            rnti=self.rnti,
            quality=Quality.SIMULATED,
        )
