"""The network is short: what it says of it, and what applications are asked for then; the shell of `Depletion`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from simple_ros.msg.network_exposure_msgs import FlowQos, FlowQosArray, QosNotification
from simple_ros.msg.turtlesim_msgs import AdaptationRequest
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_engines.network_exposure.maximizer.depletion import Depletion, Measure
from simple_ros_engines.network_exposure.turtlesim.adaptation import ADAPTATION_TOPIC

__all__ = ["Patience", "Shortage"]

_SLOWED = 0.5
_REQUESTER = "mos_qos_ratio_maximizer"
_AS_IT_IS = (1.0, 1.0)
_LEAST_VALID_S = 2.0
_OVER = ("active", "releasing", "released")
FlowKey = tuple[str, int, int]
"""Topic and both ports."""


@dataclass(frozen=True, slots=True)
class Patience:
    """How long is waited; see `Depletion`."""

    settle_s: float = 8.0
    patience_s: float = 15.0


class Shortage:
    """Has a `Depletion` for each process.

    What the network said is heard twice: on ``/qos_notifications`` at once, and on ``/network_flow_state``, which is said again
    whenever anything changes, for those who have missed it.

    Args:
        node: Subscribes and advertises.
        groups: Topics by process, now.
        changed: Called when the level of a process has changed.
        patience: How long is waited.
    """

    def __init__(
        self,
        node: NodeHandle,
        groups: Callable[[], Mapping[str, tuple[str, ...]]],
        changed: Callable[[], None],
        patience: Patience | None = None,
    ) -> None:
        self._node = node
        self._groups = groups
        self._changed = changed
        self._patience = patience or Patience()
        self._known: dict[str, Depletion] = {}
        self._told: dict[str, tuple[float, float]] = {}
        self._why: dict[str, str] = {}
        self._latest: dict[FlowKey, FlowQos] = {}
        self._counted: dict[FlowKey, int] = {}

    async def open(self) -> None:
        """Subscribe and advertise."""
        self._requests: Publisher[AdaptationRequest] = await self._node.advertise(
            ADAPTATION_TOPIC, AdaptationRequest, qos=QosProfile(depth=10)
        )
        await self._node.subscribe(
            "/network_flow_state", FlowQosArray, self._states_came, qos=LATCHED
        )
        await self._node.subscribe("/qos_notifications", QosNotification, self._notified)

    def level(self, group: str) -> int:
        """0 nothing, 1 the request is lowered, 2 the application has adapted."""
        known = self._known.get(group)
        return 0 if known is None else known.level

    def tick(self, now_s: float) -> None:
        """Do what is overdue, and what was missed."""
        self._review()
        for group, known in self._known.items():
            why = "nothing more is heard" if known.is_short else "what is asked for is given"
            self._act(group, known.tick(now_s), why)

    def ask(self, group: str, speed: float, period_s: float) -> None:
        """Tell an application how fast it shall be; said again as long as that is not its own speed.

        Args:
            group: Its name.
            speed: That the policy wants, as a share of its own.
            period_s: Until this is called again.
        """
        slowed = self.level(group) == 2
        wanted = (min(speed, _SLOWED), _SLOWED) if slowed else (speed, 1.0)
        if wanted == self._told.get(group, _AS_IT_IS) == _AS_IT_IS:
            return
        why = self._why.get(group, "") if slowed else self._why.pop(group, "")
        valid_s = max(_LEAST_VALID_S, 3 * period_s)
        self._publish(group, wanted, why or "the maximizer's policy", valid_s)

    def release(self) -> None:
        """Everybody at their own speed."""
        for group, told in tuple(self._told.items()):
            if told != _AS_IT_IS:
                self._publish(group, _AS_IT_IS, "the maximizer ends", 0.0)
        self._known.clear()

    # -- what it is told ---------------------------------------------------------------------------

    def _notified(self, message: QosNotification) -> None:
        topic, now_s = message.topic.lstrip("/"), _now_s()
        group = self._group_of(topic)
        if not group:
            return
        known, measure, why = self._of(group), None, ""
        match message.event:
            case QosNotification.DOWNGRADED | QosNotification.TERMINATED:
                self._outdated(topic)
                measure = known.downgraded(topic, now_s)
                why = f"the network gives {topic} less than was asked for"
            case QosNotification.RECOVERED:
                measure, why = known.recovered(topic, now_s), "the network has recovered"
            case QosNotification.GRANTED:
                measure, why = known.granted(topic, now_s), "the network has recovered"
        self._act(group, measure, why)

    def _outdated(self, topic: str) -> None:
        """States said before a downgrade was notified are old; that it is said again by a state is no news."""
        for key in [key for key in self._latest if key[0] == topic]:
            self._counted[key] = self._latest.pop(key).requests

    def _states_came(self, message: FlowQosArray) -> None:
        """Notifications get lost; and that a request is refused is none: only its state says so."""
        for flow in message.flows:
            self._latest[_key(flow)] = flow
            if flow.state == "released":
                del self._latest[_key(flow)]
        self._review()

    def _review(self) -> None:
        """Look at all states: also at those that came before it was known whose they are."""
        now_s = _now_s()
        for key, flow in tuple(self._latest.items()):
            topic = key[0]
            group = self._group_of(topic)
            if not group:
                continue
            known = self._of(group)
            if self._is_news(flow, known):
                self._counted[key] = flow.requests
                does = "refuses" if flow.is_refused else "gives less than"
                why = f"the network {does} what {topic} asks for"
                self._act(group, known.downgraded(topic, now_s), why)
            elif flow.state in _OVER and known.is_short:
                self._act(group, known.granted(topic, now_s), "the network has recovered")

    def _is_news(self, flow: FlowQos, known: Depletion) -> bool:
        """Whether a state tells of a downgrade not counted yet: each request can be downgraded once."""
        # Who is refused before anything was downgraded may lack a permission: asking for less is no help.
        is_refused = flow.state == "failed" and flow.is_refused and known.is_alert
        is_less = flow.state == "degraded" or is_refused
        return is_less and self._counted.get(_key(flow)) != flow.requests

    def _of(self, group: str) -> Depletion:
        if group not in self._known:
            self._known[group] = Depletion(self._patience.settle_s, self._patience.patience_s)
        return self._known[group]

    def _group_of(self, topic: str) -> str:
        """Name of the process of a topic; empty if nobody judges it."""
        return next((name for name, topics in self._groups().items() if topic in topics), "")

    # -- what it does ------------------------------------------------------------------------------

    def _act(self, group: str, measure: Measure | None, why: str) -> None:
        if measure is None:
            return
        if measure in (Measure.ADAPT, Measure.RESTORE):
            self._why[group] = why or measure.value
        self._changed()

    def _publish(self, group: str, wanted: tuple[float, float], why: str, valid_s: float) -> None:
        self._told[group] = wanted
        request = AdaptationRequest(
            group=group,
            topics=self._groups().get(group, ()),
            speed_factor=wanted[0],
            rate_factor=wanted[1],
            reason=why,
            requester=_REQUESTER,
            valid_s=valid_s,
        )
        request.header.stamp.GetCurrentTime()
        self._requests.publish(request)


def _key(flow: FlowQos) -> FlowKey:
    return flow.topic.lstrip("/"), flow.source.port, flow.destination.port


def _now_s() -> float:
    return asyncio.get_running_loop().time()
