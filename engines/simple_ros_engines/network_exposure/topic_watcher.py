"""The topic watcher: asks the network for what tagged topics need, and tells what it says."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Coroutine
from http import HTTPStatus
from typing import Any, ClassVar

from simple_ros.engine import Engine
from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.msg.network_exposure_msgs import (
    FlowQosArray,
    QosAdvice,
    QosNotification,
    TunnelSelect,
    UniqueTopicFlows,
    UniqueTopicFlowStats,
)
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_engines.network_exposure.exposure.base import ExposureBackend, SessionGone
from simple_ros_engines.network_exposure.exposure.model import (
    ApiRefused,
    ApiUnavailable,
    Event,
    ExposureError,
    Notification,
    Session,
)
from simple_ros_engines.network_exposure.exposure.receiver import NotificationReceiver
from simple_ros_engines.network_exposure.flow_session import Action
from simple_ros_engines.network_exposure.journal import Journal
from simple_ros_engines.network_exposure.relay import (
    FLOWS_TOPIC,
    LATCHED_FLOWS,
    QOS_TOPIC,
    SELECT_TOPIC,
    STATS_TOPIC,
)
from simple_ros_engines.network_exposure.watcher_core import Due, WatcherCore
from simple_ros_engines.network_exposure.watcher_settings import (
    Connection,
    backend_of,
    connection,
    receiver_of,
    watcher_settings,
)

__all__ = ["TopicWatcher"]

logger = logging.getLogger(__name__)

ADVICE_TOPIC = "/qos_advice"
NOTIFICATIONS_TOPIC = "/qos_notifications"
_TICK_S = 0.1
_RELEASE_S = 5.0
_SETTLE_S = 2.0
_EVENTS = {
    Event.GRANTED: QosNotification.GRANTED,
    Event.DOWNGRADED: QosNotification.DOWNGRADED,
    Event.RECOVERED: QosNotification.RECOVERED,
    Event.TERMINATED: QosNotification.TERMINATED,
    Event.MEASURED: QosNotification.MEASURED,
}


class TopicWatcher(Engine):
    """Has a session at the network for each flow that relays tell of.

    Whatever the network does, topics flow; what could not be had is said on ``/network_flow_state``.
    Parameters of its node: see docs/network-exposure.md.
    """

    node_name: ClassVar[str] = "topic_watcher"
    summary: ClassVar[str] = "Asks the mobile network for what tagged topics need."

    def __init__(self) -> None:
        self.core = WatcherCore()
        self.backend: ExposureBackend | None = None
        self.receiver: NotificationReceiver | None = None
        self._node: NodeHandle | None = None
        self._connection: Connection | None = None
        self._journal = Journal("")
        self._status: Publisher[FlowQosArray] | None = None
        self._notifications: Publisher[QosNotification] | None = None
        self._selects: Publisher[TunnelSelect] | None = None
        self._told = b""
        self._is_news = False
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends; then release everything, for at most 5 s.

        Raises:
            ConfigError: A parameter makes no sense, or a file is missing.
            OSError: Notifications cannot be received where the parameters say.
        """
        self._node = node
        wiring = self._connection = await connection(node)
        self.core = WatcherCore(await watcher_settings(node))
        self._journal = Journal(wiring.journal)
        self.receiver = receiver_of(wiring)
        await self.receiver.start(wiring.notify_host, wiring.notify_port)
        try:
            self.backend = backend_of(wiring, self.receiver, self._heard)
            await self._advertise(node)
            await self._subscribe(node)
            self._begin(self._clean_up(self._journal.read()))
            ticking = asyncio.create_task(self._tick())
            try:
                await node.spin()
            finally:
                ticking.cancel()
                await asyncio.gather(ticking, return_exceptions=True)
                await self._release_all()
        finally:
            await self.receiver.close()

    async def _advertise(self, node: NodeHandle) -> None:
        self._status = await node.advertise(QOS_TOPIC, FlowQosArray, qos=LATCHED)
        self._selects = await node.advertise(SELECT_TOPIC, TunnelSelect)
        self._notifications = await node.advertise(
            NOTIFICATIONS_TOPIC, QosNotification, qos=QosProfile(depth=100)
        )

    async def _subscribe(self, node: NodeHandle) -> None:
        await node.subscribe(ADVICE_TOPIC, QosAdvice, self._advised)
        await node.subscribe(FLOWS_TOPIC, UniqueTopicFlows, self._flows, qos=LATCHED_FLOWS)
        await node.subscribe(STATS_TOPIC, UniqueTopicFlowStats, self._stats)

    def _advised(self, message: QosAdvice) -> None:
        try:
            self.core.advised(message, _now_s())
        except ConfigError as error:
            logger.warning("advice for %s is not followed: %s", message.topic, error)

    def _flows(self, message: UniqueTopicFlows) -> None:
        self.core.flows_came(message, _now_s())
        self._is_news = True

    def _stats(self, message: UniqueTopicFlowStats) -> None:
        self.core.stats_came(message, _now_s())
        self._is_news = True

    # -- going on --------------------------------------------------------------------------------

    async def _tick(self) -> None:
        while True:
            self._look()
            await asyncio.sleep(_TICK_S)

    def _look(self) -> None:
        for due in self.core.look(_now_s()):
            self._is_news = True
            self._begin(self._carry_out(due))
        for told in self.core.steering:
            if self._selects is not None:
                self._selects.publish(told)
        self.core.steering.clear()
        if self._is_news:
            self._tell()

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _carry_out(self, due: Due) -> None:
        try:
            session = await self._command(due)
        except SessionGone as error:
            self.core.lost(due.key, _now_s(), str(error))
        except ExposureError as error:
            wished_s = error.retry_after_s if isinstance(error, ApiUnavailable) else None
            self._failed(due, str(error), wished_s)
            refusal = isinstance(error, ApiRefused) and error.status == HTTPStatus.FORBIDDEN
            self.core.flows[due.key].session.is_refused = refusal
        except Exception as error:
            # One flow's trouble must not be every flow's; it is tried again.
            logger.exception("%s of %s", due.command.action.value, due.key[0])
            self._failed(due, f"{type(error).__name__}: {error}", None)
        else:
            self.core.done(due.key, _now_s(), session)
        assert self.backend is not None
        self._journal.write(self.backend.resources())
        self._tell()

    def _failed(self, due: Due, detail: str, wished_s: float | None) -> None:
        if self.core.flows[due.key].session.detail != detail:
            logger.warning("%s of %s: %s", due.command.action.value, due.key[0], detail)
        self.core.failed(due.key, _now_s(), detail, wished_s)

    async def _command(self, due: Due) -> Session | None:
        backend, wiring = self.backend, self._connection
        assert backend is not None
        assert wiring is not None
        session_id, request = due.command.session_id, due.request
        match due.command.action:
            case Action.GROUP:
                await backend.ensure_group(wiring.group)
            case Action.JOIN:
                await backend.join(wiring.group, due.ue)
            case Action.MONITOR:
                await backend.monitor(session_id)
            case Action.RELEASE:
                await backend.release(session_id)
            case Action.REQUEST:
                assert request is not None
                return await backend.request(request)
            case Action.UPDATE:
                assert request is not None
                return await backend.update(session_id, request)
            case Action.RENEW:
                assert request is not None
                return await backend.renew(session_id, request)
        return None

    async def _clean_up(self, urls: list[str]) -> None:
        """Delete what an earlier program left; what does not go now expires."""
        assert self.backend is not None
        for url in urls:
            try:
                await self.backend.discard(url)
                logger.info("left open by an earlier program, released: %s", url)
            except ExposureError as error:
                logger.warning("left open by an earlier program: %s", error)

    async def _release_all(self) -> None:
        assert self.backend is not None
        if self._tasks:
            # What is being asked for should be known before it is released.
            await asyncio.wait(tuple(self._tasks), timeout=_SETTLE_S)
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self.core.end()
        try:
            async with asyncio.timeout(_RELEASE_S):
                await asyncio.gather(
                    *(
                        self._released(known.session.session_id)
                        for known in self.core.flows.values()
                    )
                )
                await self.backend.tidy()
                await self.backend.leave_groups()
        except (TimeoutError, ExposureError) as error:
            logger.warning("not everything could be released, it will expire: %s", error)
        self._journal.write(self.backend.resources())

    async def _released(self, session_id: str) -> None:
        if session_id and self.backend is not None:
            await self.backend.release(session_id)

    # -- what is said ----------------------------------------------------------------------------

    def _heard(self, told: Notification) -> None:
        """The network said something."""
        known = self.core.told(told, _now_s())
        if self._notifications is None or self._node is None:
            return
        asked = known.session.asked if known is not None else None
        message = QosNotification(
            event=_EVENTS[told.event],
            topic=known.message.topic if known is not None else "",
            session_id=told.session_id,
            requested_qci=asked.qci if asked is not None else 0,
            applied_qci=told.applied_qci or 0,
            detail=told.detail,
            measurements=told.measurements,
        )
        message.header.stamp.FromNanoseconds(self._node.clock.now().nanoseconds)
        self._notifications.publish(message)
        self._tell()

    def _tell(self) -> None:
        """Say how all flows are, if that has changed."""
        assert self.backend is not None
        if self._status is None or self._node is None or self._connection is None:
            return
        self._is_news = False
        message = FlowQosArray(
            backend=self.backend.name,
            is_simulated=self.backend.client.is_simulated,
            group=self._connection.group,
            mode=self._connection.mode,
            flows=self.core.status(),
        )
        told = message.SerializeToString(deterministic=True)
        if told == self._told:
            return
        self._told = told
        message.header.stamp.FromNanoseconds(self._node.clock.now().nanoseconds)
        try:
            self._status.publish(message)
        except SimpleRosError as error:
            logger.debug("the state of flows is not told: %s", error)


def _now_s() -> float:
    return asyncio.get_running_loop().time()
