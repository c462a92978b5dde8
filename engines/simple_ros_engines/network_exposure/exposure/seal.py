"""SEAL, TS 29.549: group management, network resource adaptation, network resource monitoring.

Its unicast subscriptions can be made and deleted, not changed (up to release 18), and tell of no downgrade. So a change
is a new subscription before the old one goes, and downgrades are seen by monitoring the delay.
"""

from __future__ import annotations

import asyncio
from typing import Any, ClassVar

from simple_ros_engines.network_exposure.exposure import schemas
from simple_ros_engines.network_exposure.exposure.api import ApiClient
from simple_ros_engines.network_exposure.exposure.base import (
    ExposureBackend,
    OnNotification,
    _Opened,
    now,
)
from simple_ros_engines.network_exposure.exposure.model import (
    ApiMalformed,
    ApiRefused,
    Event,
    Notification,
    QosRequest,
    Session,
    UeIdentity,
)
from simple_ros_engines.network_exposure.exposure.notation import session_end
from simple_ros_engines.network_exposure.exposure.receiver import NotificationReceiver
from simple_ros_engines.network_exposure.exposure.seal_bodies import (
    monitoring_event,
    monitoring_subscription,
    unicast_subscription,
    val_group,
    val_target,
)

__all__ = ["SealBackend"]

_MERGE = "application/merge-patch+json"


class SealBackend(ExposureBackend):
    """SEAL servers below one root.

    Args:
        client: Asks them.
        receiver: Takes notifications.
        on_notification: Called with each.
        service: Name of the vertical service.
        compat: ``ericsson`` writes ``uniQosReq`` as the published code of the paper does.
        period_s: Between measurements.
    """

    name: ClassVar[str] = "seal"

    def __init__(
        self,
        client: ApiClient,
        receiver: NotificationReceiver,
        on_notification: OnNotification,
        *,
        service: str = "simple_ros",
        compat: str = "",
        period_s: int = 1,
    ) -> None:
        super().__init__(client, receiver, on_notification)
        self._service = service
        self._compat = compat
        self._period_s = period_s
        self._groups: dict[str, str] = {}
        self._members: dict[str, list[dict[str, str]]] = {}
        self._grouping = asyncio.Lock()

    # -- groups ----------------------------------------------------------------------------------

    async def ensure_group(self, group: str) -> None:
        """Make the group, or find the one of that name."""
        async with self._grouping:
            if group not in self._groups:
                self._groups[group] = await self._made_or_found(group)
                self._members.setdefault(group, [])

    async def _made_or_found(self, group: str) -> str:
        query = f"/ss-gm/v1/group-documents?val-group-id={group}"
        found = await self._found(query)
        for document in found:
            if document.get("valGroupId") == group and document.get("resUri"):
                return str(document["resUri"])
        body = val_group(group, [], self._service)
        made = await self.client.call(
            "POST", "/ss-gm/v1/group-documents", body, sends=schemas.GROUP, gives=schemas.GROUP
        )
        return str(made.data.get("resUri") or made.made_at(f"group {group}"))

    async def _found(self, query: str) -> list[dict[str, Any]]:
        try:
            answer = await self.client.call("GET", query)
        except ApiRefused as error:
            if error.status == 404:
                return []
            raise
        documents = answer.data if isinstance(answer.data, list) else []
        return [document for document in documents if isinstance(document, dict)]

    async def join(self, group: str, ue: UeIdentity) -> None:
        """Add the device to the members; those that others added stay."""
        member = val_target(ue, ue.ip)
        async with self._grouping:
            own = self._members[group]
            if not member["valUeId"] or member in own:
                return
            there = await self._there(group)
            if there is None:
                # Another member ended it, or the network has forgotten it.
                self._groups[group] = await self._made_or_found(group)
                there = []
            wanted = [*there, *(item for item in (*own, member) if item not in there)]
            if wanted != there:
                await self._set_members(group, wanted)
            own.append(member)

    async def _there(self, group: str) -> list[dict[str, str]] | None:
        """The members of a group now; None if there is no such group any more."""
        try:
            answer = await self.client.call("GET", self._groups[group], gives=schemas.GROUP)
        except ApiRefused as error:
            if error.status in (404, 410):
                return None
            raise
        return list(answer.data.get("members", ()))

    async def _set_members(self, group: str, members: list[dict[str, str]]) -> None:
        await self.client.call(
            "PATCH",
            self._groups[group],
            {"members": members},
            sends=schemas.GROUP_PATCH,
            content_type=_MERGE,
        )

    async def leave_groups(self) -> None:
        """Take our devices out of the groups; one that has no others is deleted."""
        for group, url in tuple(self._groups.items()):
            there = await self._there(group)
            others = [item for item in there or () if item not in self._members[group]]
            if others:
                await self._set_members(group, others)
            elif there is not None:
                await self._delete(url)
            del self._groups[group], self._members[group]

    # -- sessions --------------------------------------------------------------------------------

    async def request(self, request: QosRequest) -> Session:
        """Subscribe."""
        opened = _Opened(request)
        opened.notify_url, _ = self._receiver.open(
            self._take(opened, schemas.UP_NOTIFICATION, _no_events)
        )
        body = unicast_subscription(
            request,
            opened.notify_url,
            session_end(now(), request.duration_s),
            compat=self._compat,
        )
        try:
            made = await self.client.call(
                "POST",
                "/ss-nra/v1/unicast-subscriptions",
                body,
                sends=schemas.UNICAST_SUBSCRIPTION,
                gives=schemas.UNICAST_SUBSCRIPTION,
            )
            session_id = made.made_at(request.topic)
        except BaseException as error:
            self._receiver.forget(opened.notify_url)
            if isinstance(error, ApiMalformed) and error.location:
                # Whatever is there, we cannot use it.
                await self._delete(error.location)
            raise
        self._sessions[session_id] = opened
        return Session(session_id, request.wanted.qci)

    async def monitor(self, session_id: str) -> None:
        """Have the device measured."""
        opened = self._sessions.get(session_id)
        if opened is None:
            return
        request = opened.request

        def read(report: Any) -> list[Notification]:
            limit_ms = request.wanted.delay_ms
            return [monitoring_event(report, session_id, limit_ms, request.ue.is_uplink)]

        opened.monitor_url, _ = self._receiver.open(
            self._take(opened, schemas.MONITORING_REPORT, read)
        )
        body = monitoring_subscription(request, opened.monitor_url, self._period_s)
        made = await self.client.call(
            "POST", "/ss-nrm/v1/subscriptions", body, sends=schemas.MONITORING_SUBSCRIPTION
        )
        opened.monitor_id = made.made_at(f"monitoring of {request.topic}")

    async def release(self, session_id: str) -> None:
        """Unsubscribe, measurements first."""
        opened = self._sessions.get(session_id)
        if opened is not None and opened.monitor_id:
            await self._delete(opened.monitor_id)
            opened.monitor_id = ""
        await self._delete(session_id)
        self._forget(session_id)


def _no_events(data: Any) -> list[Notification]:
    modes = [str(item.get("deliveryMode", "")) for item in data["eventNotifs"]]
    return [Notification(Event.MEASURED, "", None, f"delivery mode {' '.join(modes)}")]
