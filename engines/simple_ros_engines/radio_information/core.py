"""What follows from a record: everything the Radio Information Engine tells, as values. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from simple_ros_engines.radio.carrier import Carrier
from simple_ros_engines.radio.mcs import McsTable
from simple_ros_engines.radio_information.anomalies import Anomaly, AnomalyKind, AnomalyWatch
from simple_ros_engines.radio_information.history import Beginning, Filling, Session, SessionBook
from simple_ros_engines.radio_information.interference import InterferenceWatch
from simple_ros_engines.radio_information.prediction import Forecast, Predictor
from simple_ros_engines.radio_information.quality import LinkQuality, assess
from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.radio_information.spectrum import (
    interference_over_noise_db,
    own_share,
    utilization,
    zones,
)

__all__ = ["Findings", "RadioInformation", "RadioSettings"]


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """Settings.

    Attributes:
        carrier: Direction of the carrier that counters and blocks are of.
        table: MCS table of the links.
        window: Samples kept of each series.
        horizon_s: How far forecasts look.
        period_s: Between the records of a link.
        gap_s: Silence that ends a session.
        silent_s: Silence after which a link is inactive.
        forget_s: Silence after which it is forgotten, with all that was known of it.
        thresholds: Of anomalies, by kind.
        fill: Samples missing in a row that histories fill; 0: none.
        live: Whether records tell of the present.
    """

    carrier: Carrier = field(default_factory=Carrier)
    table: McsTable = McsTable.QAM64
    window: int = 50
    horizon_s: float = 1.0
    period_s: float = 0.1
    gap_s: float = 60.0
    silent_s: float = 5.0
    forget_s: float = 3600.0
    thresholds: dict[AnomalyKind, float] = field(default_factory=dict)
    fill: int = 0
    live: bool = True


@dataclass(frozen=True, slots=True)
class Findings:
    """What follows from one record.

    Attributes:
        record: The record.
        session: Number of its session; began tells whether that is new.
        began: Whether a session began with it.
        beginning: Why its session began.
        missing: Fields that the link's record before had and this one has not.
        quality: How good the link is.
        available_bps: What the link could carry now; None if unknown.
        utilization: Of the carrier, 0..1; None if unknown.
        own_share: Share of the carrier's blocks that this link uses, 0..1; None if unknown.
        interference_db: (I+N)/N; None if unknown.
        zones: Rules that hold.
        anomalies: What began or ended with this record.
        present: Kinds of anomalies that last.
        interferes: Whether more blocks are lost than signal and scheme explain.
        bandwidth: Forecast, bit/s.
        latency: Forecast, ms.
        snr: Forecast, dB.
        interference: Forecast of (I+N)/N, dB.
    """

    record: LinkRecord
    session: int
    began: bool
    beginning: Beginning
    missing: tuple[str, ...]
    quality: LinkQuality
    available_bps: float | None
    utilization: float | None
    own_share: float | None
    interference_db: float | None
    zones: tuple[str, ...]
    anomalies: tuple[Anomaly, ...]
    present: tuple[str, ...]
    interferes: bool
    bandwidth: Forecast | None
    latency: Forecast | None
    snr: Forecast | None
    interference: Forecast | None


class _Link:
    def __init__(self, settings: RadioSettings, number: int) -> None:
        horizon, period = settings.horizon_s, settings.period_s
        self.number = number
        self.share: float | None = None
        self.anomalies = AnomalyWatch(settings.thresholds)
        self.interference = InterferenceWatch(settings.table)
        self.level = Predictor(horizon, least=0.0, period_s=period)
        self.bandwidth = Predictor(horizon, least=1e5, period_s=period, logarithmic=True, others=2)
        self.latency = Predictor(horizon, least=1.0, period_s=period, logarithmic=True)
        self.snr = Predictor(horizon, period_s=period)


class RadioInformation:
    """Takes records of all links.

    Args:
        settings: Settings.

    Attributes:
        book: Sessions of the links.
        stale: Records that came too late and were left out.
        foretells_interference: Whether to forecast that, too; it costs, and few ask for it.
    """

    def __init__(self, settings: RadioSettings | None = None) -> None:
        self.settings = settings or RadioSettings()
        own = self.settings
        filling = Filling(own.period_s, own.fill) if own.fill else None
        self.book = SessionBook(own.window, own.gap_s, filling=filling, live=own.live)
        self.stale = 0
        self.foretells_interference = True
        self._links: dict[str, _Link] = {}

    def take(self, record: LinkRecord, heard_s: float) -> Findings | None:
        """What follows from a record; None for one that is not later than what is known.

        Args:
            record: The record.
            heard_s: When it came, by a clock that never jumps.
        """
        session, began = self.book.take(record, heard_s)
        if session.newest is not record:
            self.stale += 1
            return None
        link = self._links.get(record.link_id)
        if link is None or link.number != session.number:
            link = self._links[record.link_id] = _Link(self.settings, session.number)
        anomalies = tuple(link.anomalies.sample(record))
        link.interference.sample(record)
        available = self._available(record)
        beside = (record.side().snr_db, record.get("prb_cell_used"))
        carrier = self.settings.carrier
        level = interference_over_noise_db(record, carrier.scs_khz)
        link.share = own_share(session, carrier.slots_per_s, carrier.n_prb)
        return Findings(
            record,
            session.number,
            began,
            session.beginning,
            session.missing,
            assess(session, self.settings.table),
            available,
            utilization(session, carrier.slots_per_s, carrier.n_prb),
            link.share,
            level,
            zones(record),
            anomalies,
            link.anomalies.present(),
            link.interference.is_present,
            _forecast(link.bandwidth, session, available, beside),
            _forecast(link.latency, session, record.get("rtt_ms")),
            _forecast(link.snr, session, record.side().snr_db),
            _forecast(link.level, session, level if self.foretells_interference else None),
        )

    def carrier_share(self, record: LinkRecord) -> float | None:
        """Share of the carrier in use by all, 0..1: told by the record, else the sum over active links."""
        used = record.get("prb_cell_used")
        if used is not None:
            return min(1.0, used / (record.get("prb_total") or self.settings.carrier.n_prb))
        shares = [
            self._links[session.link_id].share
            for session in self.book.active()
            if session.link_id in self._links
        ]
        known = [share for share in shares if share is not None]
        return min(1.0, sum(known)) if known else None

    def _available(self, record: LinkRecord) -> float | None:
        """What the link could carry: measured, else what it carries now."""
        delivered = record.get("delivery_bps")
        return record.throughput_bps() if delivered is None else delivered

    def forget(self, now_s: float) -> list[str]:
        """Forget links of which nothing was heard for long; gives their keys."""
        gone = self.book.forget(now_s, self.settings.forget_s)
        for link in gone:
            self._links.pop(link, None)
        return gone

    def silent(self, now_s: float) -> list[Session]:
        """Links that have just become inactive."""
        return self.book.mark_inactive(now_s, self.settings.silent_s)


def _forecast(
    predictor: Predictor,
    session: Session,
    value: float | None,
    beside: tuple[float | None, ...] = (),
) -> Forecast | None:
    return None if value is None else predictor.sample(session.last_seen_s, value, beside)
