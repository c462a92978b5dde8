"""One interface to all networks."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, ClassVar

from simple_ros_engines.network_exposure.exposure.api import ApiClient, checked
from simple_ros_engines.network_exposure.exposure.model import (
    ApiRefused,
    Notification,
    QosRequest,
    Session,
    UeIdentity,
)
from simple_ros_engines.network_exposure.exposure.receiver import NotificationReceiver
from simple_ros_engines.network_exposure.exposure.schema import Schema

__all__ = ["ExposureBackend", "SessionGone"]

logger = logging.getLogger(__name__)

OnNotification = Callable[[Notification], None]


class SessionGone(ApiRefused):
    """The network does not know the session (any more)."""


@dataclass(slots=True)
class _Opened:
    """What belongs to a session here."""

    request: QosRequest
    notify_url: str = ""
    monitor_id: str = ""
    monitor_url: str = ""


class ExposureBackend(ABC):
    """A network that gives flows quality of service.

    Args:
        client: Asks it.
        receiver: Where it sends notifications.
        on_notification: Called with each.

    Attributes:
        name: For reports.
    """

    name: ClassVar[str]

    def __init__(
        self,
        client: ApiClient,
        receiver: NotificationReceiver,
        on_notification: OnNotification,
    ) -> None:
        self.client = client
        self._receiver = receiver
        self._notify = on_notification
        self._sessions: dict[str, _Opened] = {}

    async def ensure_group(self, group: str) -> None:
        """Make the group, unless it is there already. Most networks have none."""
        logger.debug("%s has no groups: %s is not made", self.name, group)

    async def join(self, group: str, ue: UeIdentity) -> None:
        """Make a device a member of the group, unless it is."""
        logger.debug("%s has no groups: %s does not join %s", self.name, ue.gpsi or ue.ip, group)

    async def leave_groups(self) -> None:
        """Delete the groups that were made here."""
        logger.debug("%s has no groups", self.name)

    async def tidy(self) -> None:
        """Delete what requests made that nobody answered, where the network can be asked what there is.

        Raises:
            ExposureError: The network does not answer, or refuses.
        """
        logger.debug("%s does not say what is open: the rest expires", self.name)

    @abstractmethod
    async def request(self, request: QosRequest) -> Session:
        """Ask for a session.

        Raises:
            ExposureError: It is not to be had.
        """

    async def update(self, session_id: str, request: QosRequest) -> Session:
        """Ask for something else: a new session first, then the old one ends.

        Raises:
            ExposureError: It is not to be had; the old one stays.
        """
        session = await self.request(request)
        await self.release(session_id)
        return session

    async def renew(self, session_id: str, request: QosRequest) -> Session:
        """Keep a session for longer."""
        return await self.update(session_id, request)

    async def monitor(self, session_id: str) -> None:
        """Have the session measured, if that is not part of it already."""
        logger.debug("%s measures %s anyway, or not at all", self.name, session_id)

    @abstractmethod
    async def release(self, session_id: str) -> None:
        """End a session; one that the network does not know is ended.

        Raises:
            ExposureError: The network does not answer, or refuses.
        """

    def resources(self) -> list[str]:
        """URLs of all that is open, for who has to clean up after this program was killed."""
        found = []
        for session_id, opened in self._sessions.items():
            found += [self.url_of(session_id), *filter(None, (opened.monitor_id,))]
        return found

    def url_of(self, session_id: str) -> str:
        """Where a session is."""
        return session_id

    async def discard(self, url: str) -> None:
        """Delete what an earlier program left.

        Raises:
            ExposureError: The network does not answer, or refuses.
        """
        await self._delete(url)

    # -- shared by the interfaces ----------------------------------------------------------------

    def _take(
        self, opened: _Opened, schema: Schema, read: Callable[[Any], list[Notification]]
    ) -> Callable[[Any], None]:
        """What takes the notifications of a session that is being made."""

        def came(data: Any) -> None:
            checked(data, schema, f"{self.name} notification")
            for told in read(data):
                # By its URL we know whose it is, whatever name the network gives.
                found = next((name for name, item in self._sessions.items() if item is opened), "")
                self._notify(
                    Notification(
                        told.event,
                        found or told.session_id,
                        told.applied_qci,
                        told.detail,
                        told.measurements,
                    )
                )

        return came

    async def _delete(self, url: str) -> None:
        try:
            await self.client.call("DELETE", url)
        except ApiRefused as error:
            if error.status not in (404, 410):
                raise

    def _forget(self, session_id: str) -> _Opened | None:
        opened = self._sessions.pop(session_id, None)
        if opened is not None:
            for url in filter(None, (opened.notify_url, opened.monitor_url)):
                self._receiver.forget(url)
        return opened


def now() -> datetime:
    """The time, with its zone."""
    return datetime.now(UTC)
