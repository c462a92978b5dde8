"""The Radio Information Engine as a node."""

from __future__ import annotations

import asyncio
import logging
import time
from statistics import fmean
from typing import ClassVar

from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.std_msgs import Float32, String
from simple_ros.msg.wireless_ros_msgs import (
    ChannelState,
    Forecast,
    PhyLayerMetrics,
    SpectrumAnalysis,
)
from simple_ros.node import NodeHandle
from simple_ros_engines.base import NAMESPACE, Outlet, WirelessEngine, outlet
from simple_ros_engines.own_link import OwnLink
from simple_ros_engines.radio_information.core import Findings, RadioInformation
from simple_ros_engines.radio_information.health import SourceHealth
from simple_ros_engines.radio_information.messages import (
    channel_state,
    forecast_message,
    phy_metrics,
    spectrum_analysis,
    zone_text,
)
from simple_ros_engines.radio_information.observers import Observers
from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.radio_information.services import LinkServices
from simple_ros_engines.radio_information.settings import radio_settings, source_options
from simple_ros_engines.radio_information.sources.base import (
    MetricsSource,
    SourceDown,
    make_source,
)

__all__ = ["RadioInformationEngine"]

logger = logging.getLogger(__name__)

_RETRY_S = (0.5, 1.0, 2.0, 5.0)
_STEADY_S = 10.0
_NAMED = 5
_FORECASTS = {"bandwidth": 1e-6, "latency": 1.0, "interference": 1.0}
"""Forecasts that have a topic, and what their value is multiplied with there."""


class RadioInformationEngine(WirelessEngine[LinkRecord]):
    """Reads metrics of radio links from a source, judges them, and tells.

    Parameters besides the common ones: ``source``, its options below its own name (``wifi/interface``; or
    together as ``source_options``, a JSON object),
    ``history_window_size``, ``interpolate`` (samples missing in a row that histories fill; 0: none),
    ``prediction_horizon`` (s), ``bandwidth_mhz``, ``scs_khz``, ``snr_drop`` (dB), ``bler_spike``,
    ``latency_spike`` (ms), ``stale_after`` (s, age from which records are late; 0: two periods, at least
    2 s), ``forget_after`` (s of silence), ``discovery_interval`` (s), ``link`` (the robot's own; empty: the only one heard of lately).
    """

    node_name: ClassVar[str] = f"{NAMESPACE}/radio_info_engine"
    summary: ClassVar[str] = "What is known about each radio link, and what will be in a second."

    def __init__(self) -> None:
        super().__init__()
        self.source: MetricsSource | None = None
        self.core = RadioInformation()
        self.health = SourceHealth(time.monotonic())
        self.observers = Observers()
        self.newest: dict[str, tuple[PhyLayerMetrics, float]] = {}
        self.discovered: frozenset[str] = frozenset()
        self._ages_s: dict[str, float] = {}
        self._confidence: dict[tuple[str, str], float] = {}
        self._own = OwnLink()
        self._place: PoseStamped | None = None

    async def set_up(self, node: NodeHandle) -> None:
        """Declare, advertise, provide."""
        await self._declare(node)
        self._channel = await outlet(node, "channel_state", ChannelState, 100)
        self._metrics = await outlet(node, "phy_layer_metrics", PhyLayerMetrics, 100)
        self._spectrum = await outlet(node, "spectrum_analysis", SpectrumAnalysis, 100)
        self._forecasts: dict[str, Outlet[Forecast]] = {
            name: await outlet(node, f"{name}_forecast", Forecast, 100) for name in _FORECASTS
        }
        self._zone = await node.advertise(f"/{NAMESPACE}/interference_zone", String)
        self._used = await node.advertise(f"/{NAMESPACE}/prb_utilization", Float32)
        self._carrier = await node.advertise(f"/{NAMESPACE}/resource_utilization", Float32)
        self._alert = await node.advertise(f"/{NAMESPACE}/anomaly", String)
        await LinkServices(node, self.core.book, self.newest).provide()
        await node.subscribe("/robot/pose", PoseStamped, self._moved)
        assert self.source is not None
        await self.source.attach(node)

    async def _declare(self, node: NodeHandle) -> None:
        get = node.declare_parameter
        name = str(await get("~source", "transport", read_only=True))
        self.source = source = make_source(name, await source_options(node, name))
        lately_s = max(15.0, 5 * source.period_s)
        self._own = OwnLink(str(await get("~link", "", read_only=True)), lately_s)
        self._discovery_s = float(await get("~discovery_interval", 5.0, minimum=0.1, maximum=600))
        stale_s = float(await get("~stale_after", 0.0, minimum=0, maximum=600, read_only=True))
        settings = await radio_settings(node, source)
        self.core = RadioInformation(settings)
        self.health = SourceHealth(
            time.monotonic(),
            stale_s or max(2.0, 2 * source.period_s),
            float("inf") if source.may_be_silent else settings.silent_s,
            live=source.live,
        )

    async def work(self, node: NodeHandle) -> None:
        """Read the source, and try again while it is down."""
        node.create_timer(1.0, lambda _: self._tell_silent())
        assert self.source is not None
        discovering = asyncio.create_task(self._discover(self.source))
        try:
            await self._read(self.source)
            await node.spin()
        finally:
            discovering.cancel()
            await asyncio.gather(discovering, return_exceptions=True)

    async def _read(self, source: MetricsSource) -> None:
        tries, told = 0, ""
        while True:
            begun = time.monotonic()
            try:
                await source.run(self._came)
                self.health.ended()
                self._judge()
                return
            except SourceDown as error:
                reason = str(error)
            except Exception as error:
                # A source is a plug-in: its mistake must not end the engine.
                self.errors += 1
                reason = f"{type(error).__name__}: {error}"
                if reason != told:
                    logger.exception("the source failed")
                told = reason
            if time.monotonic() - begun > _STEADY_S:
                tries = 0
            self.health.failed(reason)
            self._judge()
            if not tries:
                logger.warning("no metrics: %s; trying again", reason)
            await asyncio.sleep(_RETRY_S[min(tries, len(_RETRY_S) - 1)])
            tries += 1

    async def _discover(self, source: MetricsSource) -> None:
        """Ask the source now and then which links it has heard of lately."""
        while True:
            try:
                found = await source.discover()
            except SourceDown as error:
                logger.debug("no discovery: %s", error)
            except Exception:
                self.errors += 1
                logger.exception("discovery failed")
            else:
                if found is None:
                    return
                for link in sorted(found - self.discovered - set(self.core.book.current)):
                    logger.info("link %s is known to the source", link)
                self.discovered = found
            await asyncio.sleep(self._discovery_s)

    def _came(self, record: LinkRecord) -> None:
        age_s = self.health.came(record, time.time_ns(), time.monotonic())
        self._ages_s[record.link_id] = age_s
        if self.state != "active":
            self._judge()
        self.offer(record.link_id, record)

    def _judge(self) -> None:
        self.detail = self.health.verdict(time.monotonic())
        self.state = "degraded" if self.detail else "active"

    def verdict(self) -> tuple[str, str]:
        """State and what is wrong."""
        self._judge()
        return super().verdict()

    def link_count(self) -> int:
        """Links of which records come."""
        return len(self.core.book.active())

    def inactive_count(self) -> int:
        """Links that were heard of and say nothing now."""
        return len(self.discovered | set(self.core.book.current)) - self.link_count()

    def measures(self) -> dict[str, float]:
        """What was wrong with records, and how forecasts came out (1: always right)."""
        assert self.source is not None
        found: dict[str, float] = {
            **self.health.counts,
            "malformed": self.source.malformed,
            "repeated_records": self.core.stale,
            "sessions_ended": len(self.core.book.ended),
            "observer_errors": self.observers.errors,
            "newest_age_s": self.health.age_s,
        }
        for name in _FORECASTS:
            shares = [share for (kind, _), share in self._confidence.items() if kind == name]
            if shares:
                found[f"{name}_accuracy"] = fmean(shares)
        return found

    def priority(self, item: LinkRecord) -> float:
        """Bad links go first."""
        known = self.newest.get(item.link_id)
        return 1.0 if known is None else 1.0 - known[0].link_quality

    def differs(self, before: LinkRecord, now: LinkRecord) -> bool:
        """Whether any value is another one."""
        return before.values != now.values

    def look_at(self, item: LinkRecord) -> None:
        """Judge a record and tell."""
        self.core.foretells_interference = self._forecasts["interference"].is_heard
        findings = self.core.take(item, time.monotonic())
        if findings is None:
            return
        metrics = phy_metrics(findings)
        self.newest[item.link_id] = (metrics, time.monotonic())
        if findings.began:
            why = findings.beginning.value
            logger.info("link %s, session %d: %s", item.link_id, findings.session, why)
        self._own.heard(item.link_id, time.monotonic())
        is_own = item.link_id == self._own.link(time.monotonic())
        place = self._place if is_own else None
        state = channel_state(
            item,
            findings.session,
            missing=findings.missing,
            age_s=self._ages_s.get(item.link_id, 0.0),
        )
        self._channel.publish(state)
        self._metrics.publish(metrics)
        self._spectrum.publish(spectrum_analysis(findings, place))
        self.observers.notify_observers(state)
        self._tell_rest(findings, place)

    def _tell_rest(self, findings: Findings, place: PoseStamped | None) -> None:
        record = findings.record
        for name, factor in _FORECASTS.items():
            forecast = getattr(findings, name)
            if forecast is not None:
                self._confidence[name, record.link_id] = forecast.confidence
                if self._forecasts[name].is_heard:
                    self._forecasts[name].publish(forecast_message(record, forecast, factor))
        if findings.own_share is not None and self._used.subscriber_count:
            self._used.publish(Float32(data=findings.own_share))
        share = self.core.carrier_share(record) if self._carrier.subscriber_count else None
        if share is not None:
            self._carrier.publish(Float32(data=share))
        for zone in findings.zones if self._zone.subscriber_count else ():
            self._zone.publish(String(data=zone_text(record.link_id, zone, place)))
        for change in findings.anomalies:
            what = "began" if change.began else "ended"
            text = f"{record.link_id}: {change.kind.value} {what}, {change.value:g}"
            self._alert.publish(String(data=f"{text} (usual {change.usual:g})"))

    def _moved(self, message: PoseStamped) -> None:
        self._place = message

    def _tell_silent(self) -> None:
        silent = [session.link_id for session in self.core.silent(time.monotonic())]
        if silent:
            more = "" if len(silent) <= _NAMED else f" and {len(silent) - _NAMED} more"
            names = ", ".join(silent[:_NAMED])
            logger.warning("no longer heard of: %s%s", names, more)
        for link in self.core.forget(time.monotonic()):
            self.forget(link)
            self.newest.pop(link, None)
            self._ages_s.pop(link, None)
            for name in _FORECASTS:
                self._confidence.pop((name, link), None)
