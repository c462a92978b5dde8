"""The Radio Information Engine as a node."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from statistics import fmean, pstdev
from typing import Any, ClassVar

from simple_ros.aio import ServerGoal
from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.msg.std_msgs import Float32, String
from simple_ros.msg.wireless_ros_msgs import (
    ChannelState,
    Forecast,
    GetLinkQuality,
    GetLinkQualityRequest,
    GetLinkQualityResponse,
    MonitorQuality,
    MonitorQualityFeedback,
    MonitorQualityGoal,
    MonitorQualityResult,
    PhyLayerMetrics,
    ReconfigureEngine,
    ReconfigureEngineRequest,
    ReconfigureEngineResponse,
    SpectrumAnalysis,
)
from simple_ros.node import NodeHandle
from simple_ros_engines.base import NAMESPACE, WirelessEngine, outlet
from simple_ros_engines.radio.carrier import Carrier, resource_blocks
from simple_ros_engines.radio_information.anomalies import AnomalyKind
from simple_ros_engines.radio_information.core import Findings, RadioInformation, RadioSettings
from simple_ros_engines.radio_information.messages import (
    channel_state,
    forecast_message,
    phy_metrics,
    spectrum_analysis,
)
from simple_ros_engines.radio_information.record import LinkRecord, link_id_of
from simple_ros_engines.radio_information.sources.base import (
    MetricsSource,
    SourceDown,
    make_source,
)

__all__ = ["RadioInformationEngine"]

logger = logging.getLogger(__name__)

_RETRY_S = (0.5, 1.0, 2.0, 5.0)
ENGINES = ("radio_info_engine", "cross_domain_engine", "physical_adaptive_engine")


class RadioInformationEngine(WirelessEngine[LinkRecord]):
    """Reads metrics of radio links from a source, judges them, and tells.

    Parameters besides the common ones: ``source`` and ``source_options`` (a JSON object),
    ``history_window_size``, ``prediction_horizon`` (s), ``bandwidth_mhz``, ``scs_khz``, ``snr_drop`` (dB),
    ``bler_spike``, ``latency_spike`` (ms).
    """

    node_name: ClassVar[str] = f"{NAMESPACE}/radio_info_engine"
    summary: ClassVar[str] = "What is known about each radio link, and what will be in a second."

    def __init__(self) -> None:
        super().__init__()
        self.source: MetricsSource | None = None
        self.core = RadioInformation()
        self.newest: dict[str, tuple[PhyLayerMetrics, float]] = {}

    async def set_up(self, node: NodeHandle) -> None:
        """Declare, advertise, provide."""
        await self._declare(node)
        self._channel = await outlet(node, "channel_state", ChannelState, 100)
        self._metrics = await outlet(node, "phy_layer_metrics", PhyLayerMetrics, 100)
        self._spectrum = await outlet(node, "spectrum_analysis", SpectrumAnalysis, 100)
        self._bandwidth = await outlet(node, "bandwidth_forecast", Forecast, 100)
        self._latency = await outlet(node, "latency_forecast", Forecast, 100)
        self._zone = await node.advertise(f"/{NAMESPACE}/interference_zone", String)
        self._used = await node.advertise(f"/{NAMESPACE}/prb_utilization", Float32)
        self._alert = await node.advertise(f"/{NAMESPACE}/anomaly", String)
        await node.advertise_service(
            f"/{NAMESPACE}/get_link_quality", GetLinkQuality, self._get_link_quality
        )
        self._node = node
        await node.advertise_service(
            f"/{NAMESPACE}/reconfigure_engine", ReconfigureEngine, self._reconfigure
        )
        await node.advertise_action(f"/{NAMESPACE}/monitor_quality", MonitorQuality, self._monitor)

    async def _declare(self, node: NodeHandle) -> None:
        get = node.declare_parameter
        name = str(await get("~source", "transport", read_only=True))
        text = str(await get("~source_options", "{}", read_only=True))
        window = int(
            await get("~history_window_size", 50, minimum=10, maximum=10_000, read_only=True)
        )
        horizon = float(
            await get("~prediction_horizon", 1.0, minimum=0.1, maximum=60, read_only=True)
        )
        mhz = int(await get("~bandwidth_mhz", 20, read_only=True))
        scs = int(await get("~scs_khz", 30, choices=(15, 30, 60), read_only=True))
        thresholds = {
            kind: float(await get(f"~{kind.value.lower()}", default, minimum=0, read_only=True))
            for kind, default in (
                (AnomalyKind.SNR_DROP, 5.0),
                (AnomalyKind.BLER_SPIKE, 0.15),
                (AnomalyKind.LATENCY_SPIKE, 30.0),
            )
        }
        self.source = make_source(name, _options(text))
        period = self.source.period_s
        self.core = RadioInformation(
            RadioSettings(
                Carrier(scs, resource_blocks(scs, mhz)),
                window=window,
                horizon_s=horizon,
                period_s=period,
                silent_s=max(2.0, 5 * period),
                thresholds=thresholds,
            )
        )

    async def work(self, node: NodeHandle) -> None:
        """Read the source, and try again while it is down."""
        node.create_timer(1.0, lambda _: self._tell_silent())
        assert self.source is not None
        tries = 0
        while True:
            begun = time.monotonic()
            try:
                await self.source.run(self._came)
                self.state, self.detail = "degraded", "the source has ended"
                await node.spin()
                return
            except SourceDown as error:
                if time.monotonic() - begun > 10:
                    tries = 0
                wait_s = _RETRY_S[min(tries, len(_RETRY_S) - 1)]
                self.state, self.detail = "degraded", str(error)
                if not tries:
                    logger.warning("no metrics: %s; trying again", error)
                tries += 1
                await asyncio.sleep(wait_s)

    def _came(self, record: LinkRecord) -> None:
        self.state, self.detail = "active", ""
        self.offer(record.link_id, record)

    def link_count(self) -> int:
        """Links of which records come."""
        return len(self.core.book.active())

    def priority(self, item: LinkRecord) -> float:
        """Bad links go first."""
        known = self.newest.get(item.link_id)
        return 1.0 if known is None else 1.0 - known[0].link_quality

    def differs(self, before: LinkRecord, now: LinkRecord) -> bool:
        """Whether any value is another one."""
        return before.values != now.values

    def look_at(self, item: LinkRecord) -> None:
        """Judge a record and tell."""
        findings = self.core.take(item, time.monotonic())
        if findings is None:
            return
        metrics = phy_metrics(findings)
        self.newest[item.link_id] = (metrics, time.monotonic())
        if findings.began:
            logger.info("link %s, session %d", item.link_id, findings.session)
        self._channel.publish(channel_state(item, findings.session))
        self._metrics.publish(metrics)
        self._spectrum.publish(spectrum_analysis(findings))
        self._tell_rest(findings)

    def _tell_rest(self, findings: Findings) -> None:
        record = findings.record
        if findings.bandwidth is not None and self._bandwidth.is_heard:
            self._bandwidth.publish(forecast_message(record, findings.bandwidth, 1e-6))
        if findings.latency is not None and self._latency.is_heard:
            self._latency.publish(forecast_message(record, findings.latency, 1.0))
        if findings.utilization is not None and self._used.subscriber_count:
            self._used.publish(Float32(data=findings.utilization))
        for zone in findings.zones if self._zone.subscriber_count else ():
            self._zone.publish(String(data=f"{record.link_id}: {zone}"))
        for change in findings.anomalies:
            what = "began" if change.began else "ended"
            text = f"{record.link_id}: {change.kind.value} {what}, {change.value:g}"
            self._alert.publish(String(data=f"{text} (usual {change.usual:g})"))

    def _tell_silent(self) -> None:
        for session in self.core.silent(time.monotonic()):
            logger.warning("link %s is silent", session.link_id)

    def _find(self, rnti: int, link_id: str) -> tuple[PhyLayerMetrics, float] | None:
        return self.newest.get(link_id or link_id_of(rnti))

    def _get_link_quality(self, request: GetLinkQualityRequest) -> GetLinkQualityResponse:
        found = self._find(request.rnti, request.link_id)
        if found is None:
            known = ", ".join(sorted(self.newest)) or "none"
            return GetLinkQualityResponse(message=f"no such link; there are: {known}")
        age_s = time.monotonic() - found[1]
        return GetLinkQualityResponse(found=True, metrics=found[0], age_s=age_s)

    async def _reconfigure(self, request: ReconfigureEngineRequest) -> ReconfigureEngineResponse:
        """Set parameters of an engine; its node has the last word."""
        name = request.engine.removeprefix(f"/{NAMESPACE}/").removeprefix(f"{NAMESPACE}/")
        if name not in ENGINES:
            return ReconfigureEngineResponse(message=f"{name!r} is none of {', '.join(ENGINES)}")
        try:
            values = _options(request.json)
            await self._node.set_parameters(
                {f"/{NAMESPACE}/{name}/{key}": value for key, value in values.items()}
            )
        except SimpleRosError as error:
            return ReconfigureEngineResponse(message=str(error))
        return ReconfigureEngineResponse(ok=True, applied=json.dumps(values))

    async def _monitor(
        self, goal: ServerGoal[MonitorQualityGoal, MonitorQualityResult, MonitorQualityFeedback]
    ) -> MonitorQualityResult:
        wanted = goal.goal
        period_s = max(0.02, wanted.period_s or 0.5)
        qualities: list[float] = []
        for _ in range(max(1, round((wanted.duration_s or 5.0) / period_s))):
            await asyncio.sleep(period_s)
            found = self._find(wanted.rnti, wanted.link_id)
            if found is not None:
                qualities.append(found[0].link_quality)
                age_s = time.monotonic() - found[1]
                goal.publish_feedback(MonitorQualityFeedback(metrics=found[0], age_s=age_s))
        if not qualities:
            goal.abort(MonitorQualityResult(), "no sample of that link came")
            return MonitorQualityResult()
        return MonitorQualityResult(
            samples=len(qualities),
            mean=fmean(qualities),
            minimum=min(qualities),
            maximum=max(qualities),
            deviation=pstdev(qualities),
        )


def _options(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text or "{}")
    except ValueError as error:
        raise ConfigError(f"{text!r} is no JSON: {error}") from error
    if not isinstance(found, dict):
        raise ConfigError(f"{text!r} is no JSON object")
    return found
