"""NEF AsSessionWithQoS, TS 29.122: one subscription for each flow, changed in place, with events."""

from __future__ import annotations

import logging
from typing import Any, ClassVar
from urllib.parse import urlsplit

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.exposure import schemas
from simple_ros_engines.network_exposure.exposure.api import Answer, ApiClient
from simple_ros_engines.network_exposure.exposure.base import (
    ExposureBackend,
    OnNotification,
    SessionGone,
    _Opened,
)
from simple_ros_engines.network_exposure.exposure.model import (
    ApiRefused,
    ExposureError,
    Notification,
    QosRequest,
    Session,
)
from simple_ros_engines.network_exposure.exposure.nef_bodies import as_session, nef_events
from simple_ros_engines.network_exposure.exposure.receiver import NotificationReceiver
from simple_ros_engines.network_exposure.qci import QCI

__all__ = ["NefBackend"]

logger = logging.getLogger(__name__)


class NefBackend(ExposureBackend):
    """A network exposure function.

    Args:
        client: Asks it.
        receiver: Takes notifications.
        on_notification: Called with each.
        af_id: Who we are there (``scsAsId``).
        reference: Names of the classes in the agreement with the operator; ``{qci}`` stands for the number.

    Raises:
        ConfigError: The reference has no ``{qci}``.
    """

    name: ClassVar[str] = "nef"

    def __init__(
        self,
        client: ApiClient,
        receiver: NotificationReceiver,
        on_notification: OnNotification,
        *,
        af_id: str = "simple_ros",
        reference: str = "5qi_{qci}",
    ) -> None:
        super().__init__(client, receiver, on_notification)
        try:
            self._references = {reference.format(qci=qci): qci for qci in QCI}
        except (KeyError, IndexError, ValueError) as error:
            raise ConfigError(f"qos_reference {reference!r}: {error}") from error
        if len(self._references) != len(QCI):
            raise ConfigError(f"qos_reference {reference!r} must have {{qci}} in it")
        self._reference = reference
        self._path = f"/3gpp-as-session-with-qos/v1/{af_id}/subscriptions"
        self._unsure: set[str] = set()

    async def request(self, request: QosRequest) -> Session:
        """Subscribe."""
        opened = _Opened(request)
        opened.notify_url, _ = self._receiver.open(
            self._take(opened, schemas.USER_PLANE_NOTIFICATION, self._read)
        )
        try:
            made = await self._send("POST", self._path, opened)
            session_id = made.made_at(request.topic)
        except BaseException as error:
            self._receiver.forget(opened.notify_url)
            if not isinstance(error, ApiRefused):
                self._unsure.add(opened.notify_url)
            raise
        self._sessions[session_id] = opened
        if made.attempts > 1:
            self._unsure.add(opened.notify_url)
        try:
            await self.tidy()
        except ExposureError as error:
            logger.info("what may have been left open is looked for later: %s", error)
        return Session(session_id, None, True)

    async def tidy(self) -> None:
        """Delete subscriptions of requests that nobody answered: each is known by where its events go."""
        if not self._unsure:
            return
        unsure = frozenset(self._unsure)
        found = await self.client.call("GET", self._path, gives=schemas.AS_SESSIONS)
        known = {urlsplit(session_id).path for session_id in self._sessions}
        for item in found.data:
            path = urlsplit(item.get("self", "")).path
            if item["notificationDestination"] in unsure and path and path not in known:
                await self._delete(item["self"])
                logger.info("made by a request that nobody answered, released: %s", item["self"])
        self._unsure -= unsure

    async def update(self, session_id: str, request: QosRequest) -> Session:
        """Change the subscription."""
        opened = self._sessions.get(session_id)
        if opened is None:
            raise SessionGone(f"PUT {session_id}", 404, "not a session of this program")
        opened.request = request
        try:
            await self._send("PUT", session_id, opened)
        except ApiRefused as error:
            if error.status in (404, 410):
                self._forget(session_id)
                raise SessionGone(f"PUT {session_id}", error.status, error.reason) from error
            raise
        return Session(session_id, None, True)

    async def renew(self, session_id: str, request: QosRequest) -> Session:
        """The same again: its duration begins anew."""
        session = await self.update(session_id, request)
        return Session(session.id)

    async def release(self, session_id: str) -> None:
        """Unsubscribe."""
        await self._delete(session_id)
        self._forget(session_id)

    async def _send(self, method: str, path: str, opened: _Opened) -> Answer:
        body = as_session(opened.request, opened.notify_url, self._reference)
        return await self.client.call(
            method, path, body, sends=schemas.AS_SESSION, gives=schemas.AS_SESSION
        )

    def _read(self, data: Any) -> list[Notification]:
        return nef_events(data, self._references)
