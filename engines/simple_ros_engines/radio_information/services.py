"""Services and the action of the Radio Information Engine."""

from __future__ import annotations

import asyncio
import json
import time
from statistics import fmean, pstdev

from simple_ros.aio import ServerGoal
from simple_ros.errors import SimpleRosError
from simple_ros.msg.wireless_ros_msgs import (
    GetLinkHistory,
    GetLinkHistoryRequest,
    GetLinkHistoryResponse,
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
)
from simple_ros.node import NodeHandle
from simple_ros_engines.base import NAMESPACE
from simple_ros_engines.mapping_parameter import object_of
from simple_ros_engines.radio_information.history import SessionBook
from simple_ros_engines.radio_information.record import link_id_of, parse_rnti

__all__ = ["LinkServices"]

_LONGEST_S = 86_400.0
_ENGINES = ("radio_info_engine", "cross_domain_engine", "physical_adaptive_engine")


class LinkServices:
    """Answers questions about links.

    Args:
        node: Provides them.
        book: Sessions of the links.
        newest: By link, the newest assessment and when it was made, by the steady clock.
    """

    def __init__(
        self,
        node: NodeHandle,
        book: SessionBook,
        newest: dict[str, tuple[PhyLayerMetrics, float]],
    ) -> None:
        self._node = node
        self._book = book
        self._newest = newest

    async def provide(self) -> None:
        """Advertise all."""
        provide = self._node.advertise_service
        await provide(f"/{NAMESPACE}/get_link_quality", GetLinkQuality, self._quality)
        await provide(f"/{NAMESPACE}/get_link_history", GetLinkHistory, self._history)
        await provide(f"/{NAMESPACE}/reconfigure_engine", ReconfigureEngine, self._reconfigure)
        await self._node.advertise_action(
            f"/{NAMESPACE}/monitor_quality", MonitorQuality, self._monitor
        )

    def _find(self, rnti: int, link_id: str) -> tuple[PhyLayerMetrics, float] | None:
        return self._newest.get(_key(rnti, link_id))

    def _unknown(self) -> str:
        return f"no such link; there are: {', '.join(sorted(self._newest)) or 'none'}"

    def _quality(self, request: GetLinkQualityRequest) -> GetLinkQualityResponse:
        found = self._find(request.rnti, request.link_id)
        if found is None:
            return GetLinkQualityResponse(message=self._unknown())
        age_s = time.monotonic() - found[1]
        return GetLinkQualityResponse(found=True, metrics=found[0], age_s=age_s)

    def _history(self, request: GetLinkHistoryRequest) -> GetLinkHistoryResponse:
        session = self._book.current.get(_key(request.rnti, request.link_id))
        if session is None:
            return GetLinkHistoryResponse(message=self._unknown())
        if request.field not in SessionBook.FIELDS:
            known = ", ".join(SessionBook.FIELDS)
            text = f"{request.field!r} has no history; these have: {known}"
            return GetLinkHistoryResponse(message=text)
        series = session.of(request.field)
        return GetLinkHistoryResponse(
            found=True,
            times_s=series.times_s,
            values=series.values,
            interpolated=series.interpolated,
        )

    async def _reconfigure(self, request: ReconfigureEngineRequest) -> ReconfigureEngineResponse:
        """Set parameters of an engine; its node has the last word."""
        name = request.engine.removeprefix(f"/{NAMESPACE}/").removeprefix(f"{NAMESPACE}/")
        if name not in _ENGINES:
            return ReconfigureEngineResponse(message=f"{name!r} is none of {', '.join(_ENGINES)}")
        try:
            values = object_of(request.json)
            wanted = {f"/{NAMESPACE}/{name}/{key}": value for key, value in values.items()}
            for key in wanted:
                # Set without its node, a wrong value would keep the engine from starting.
                if not (await self._node.describe_parameter(key)).nodes:
                    return ReconfigureEngineResponse(message=f"no live node declares {key!r}")
            await self._node.set_parameters(wanted)
        except SimpleRosError as error:
            return ReconfigureEngineResponse(message=str(error))
        return ReconfigureEngineResponse(ok=True, applied=json.dumps(values))

    async def _monitor(
        self, goal: ServerGoal[MonitorQualityGoal, MonitorQualityResult, MonitorQualityFeedback]
    ) -> MonitorQualityResult:
        wanted = goal.goal
        duration_s, period_s = wanted.duration_s or 5.0, max(0.02, wanted.period_s or 0.5)
        if not (0 < duration_s <= _LONGEST_S and period_s <= _LONGEST_S):
            goal.abort(MonitorQualityResult(), f"seconds must be from 0 to {_LONGEST_S:g}")
            return MonitorQualityResult()
        qualities: list[float] = []
        begun_s = time.monotonic()
        for _ in range(max(1, round(duration_s / period_s))):
            await asyncio.sleep(period_s)
            found = self._find(wanted.rnti, wanted.link_id)
            # What a link was like before it fell silent is no sample of it.
            if found is not None and found[1] > begun_s:
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


def _key(rnti: int, link_id: str) -> str:
    """Key of the link that a request means: as it is, an RNTI as 0x4601, or as a number."""
    text = link_id.strip()
    number = parse_rnti(text) if text.lower().startswith("0x") else None
    if number is not None:
        return link_id_of(number)
    return text or link_id_of(rnti)
