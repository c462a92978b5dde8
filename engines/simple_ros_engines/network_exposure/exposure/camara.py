"""CAMARA Quality-on-Demand: sessions with named profiles.

It knows no error rates and no alternatives: a profile stands for each class, and what is not given any more ends the
session. Its sink must be https.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.exposure import schemas
from simple_ros_engines.network_exposure.exposure.api import Answer, ApiClient
from simple_ros_engines.network_exposure.exposure.base import (
    ExposureBackend,
    OnNotification,
    SessionGone,
    _Opened,
    now,
)
from simple_ros_engines.network_exposure.exposure.camara_bodies import (
    camara_event,
    camara_profile,
    camara_session,
)
from simple_ros_engines.network_exposure.exposure.model import ApiRefused, QosRequest, Session
from simple_ros_engines.network_exposure.exposure.notation import session_end
from simple_ros_engines.network_exposure.exposure.receiver import NotificationReceiver

__all__ = ["DEFAULT_PROFILES", "CamaraBackend"]

DEFAULT_PROFILES = {"<=15": "QOS_E", "<=60": "QOS_S", "<=150": "QOS_M", "*": "QOS_L"}
_ROOT = "/quality-on-demand/v1"
_TOKEN_S = 30 * 24 * 3600


class CamaraBackend(ExposureBackend):
    """Quality-on-Demand.

    Args:
        client: Asks it.
        receiver: Takes notifications; those of a receiver without https are not asked for.
        on_notification: Called with each.
        profiles: Which profile stands for which class (`camara_bodies.camara_profile`).

    Raises:
        ConfigError: The profiles have no ``*``.
    """

    name: ClassVar[str] = "camara"

    def __init__(
        self,
        client: ApiClient,
        receiver: NotificationReceiver,
        on_notification: OnNotification,
        *,
        profiles: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(client, receiver, on_notification)
        self._profiles = dict(profiles or DEFAULT_PROFILES)
        if "*" not in self._profiles:
            raise ConfigError("profiles must have one for '*', all other classes")

    async def request(self, request: QosRequest) -> Session:
        """Make a session."""
        opened = _Opened(request)
        token = ""
        if self._receiver.url.startswith("https://"):
            opened.notify_url, token = self._receiver.open(
                self._take(opened, schemas.QOS_STATUS_CHANGED, lambda event: [camara_event(event)]),
                with_token=True,
            )
        body = camara_session(
            request,
            camara_profile(request.wanted, self._profiles),
            opened.notify_url,
            token,
            session_end(now(), _TOKEN_S),
        )
        try:
            made = await self._made(body)
        except BaseException:
            self._receiver.forget(opened.notify_url)
            raise
        session_id = str(made.data["sessionId"])
        self._sessions[session_id] = opened
        is_ready = made.data["qosStatus"] == "AVAILABLE"
        # Without a sink nobody will tell when it is ready.
        is_pending = not is_ready and bool(opened.notify_url)
        return Session(session_id, request.wanted.qci if is_ready else None, is_pending)

    async def _made(self, body: dict[str, Any]) -> Answer:
        """A session; one that an earlier attempt or program left for the same flow is deleted first."""
        try:
            return await self._post(body)
        except ApiRefused as error:
            if error.status != 409 or not await self._delete_left(body):
                raise
        return await self._post(body)

    async def _post(self, body: dict[str, Any]) -> Answer:
        return await self.client.call(
            "POST",
            f"{_ROOT}/sessions",
            body,
            sends=schemas.CREATE_SESSION,
            gives=schemas.SESSION_INFO,
        )

    async def _delete_left(self, body: dict[str, Any]) -> int:
        """How many sessions of the flow there were that nobody here knows."""
        found = await self.client.call(
            "POST",
            f"{_ROOT}/retrieve-sessions",
            {"device": body["device"]},
            gives={"type": "array", "items": schemas.SESSION_INFO},
        )
        keys = ("applicationServer", "devicePorts", "applicationServerPorts")
        left = [
            str(info["sessionId"])
            for info in found.data
            if info["sessionId"] not in self._sessions
            and all(info.get(key) == body.get(key) for key in keys)
        ]
        for session_id in left:
            await self._delete(self.url_of(session_id))
        return len(left)

    async def update(self, session_id: str, request: QosRequest) -> Session:
        """End the session, make another: two for one flow would be a conflict."""
        await self.release(session_id)
        return await self.request(request)

    async def renew(self, session_id: str, request: QosRequest) -> Session:
        """Extend it."""
        body: dict[str, Any] = {"requestedAdditionalDuration": request.duration_s}
        path = f"{_ROOT}/sessions/{session_id}/extend"
        try:
            await self.client.call(
                "POST", path, body, sends=schemas.EXTEND_SESSION, gives=schemas.SESSION_INFO
            )
        except ApiRefused as error:
            if error.status in (404, 409, 410):
                self._forget(session_id)
                raise SessionGone(f"POST {path}", error.status, error.reason) from error
            raise
        return Session(session_id)

    async def release(self, session_id: str) -> None:
        """Delete it."""
        await self._delete(self.url_of(session_id))
        self._forget(session_id)

    def url_of(self, session_id: str) -> str:
        """Where it is."""
        return self.client.url(f"{_ROOT}/sessions/{session_id}")
