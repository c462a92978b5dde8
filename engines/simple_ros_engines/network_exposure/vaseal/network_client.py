"""The Network Layer Service Client: tells the network how applications are, and takes what it asks of them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import quote

from simple_ros_engines.network_exposure.exposure.api import ApiClient
from simple_ros_engines.network_exposure.exposure.model import ApiRefused, ExposureError
from simple_ros_engines.network_exposure.exposure.receiver import NotificationReceiver
from simple_ros_engines.network_exposure.vaseal.bodies import (
    APPLICATION,
    ROOT,
    Wish,
    wish_of,
)

__all__ = ["NetworkClient"]

logger = logging.getLogger(__name__)

OnWish = Callable[[str, Wish], None]


class NetworkClient:
    """Talks to a Network Layer Service Server.

    Args:
        client: Asks it.
        receiver: Takes what the network asks for.
        on_wish: Called with that, and the process it is for.
        least: Smallest share of speed and rate that is agreed to.
        longest_s: Longest time that is agreed to.
    """

    def __init__(
        self,
        client: ApiClient,
        receiver: NotificationReceiver,
        on_wish: OnWish,
        *,
        least: float = 0.25,
        longest_s: float = 60.0,
    ) -> None:
        self._client = client
        self._receiver = receiver
        self._on_wish = on_wish
        self._least = least
        self._longest_s = longest_s
        self._urls: dict[str, str] = {}
        self._trouble = ""

    async def tell(self, reports: Mapping[str, dict[str, Any]]) -> None:
        """Tell how applications are; those that are not there any more are taken back."""
        try:
            for group, report in reports.items():
                body = report | {"notificationDestination": self._url(group)}
                await self._client.call(
                    "PUT", _path(group), body, sends=APPLICATION, gives=APPLICATION
                )
            for group in self._urls.keys() - reports.keys():
                await self._withdraw(group)
        except ExposureError as error:
            if str(error) != self._trouble:
                logger.warning("the network is not told how applications are: %s", error)
            self._trouble = str(error)
        else:
            self._trouble = ""

    async def close(self) -> None:
        """Take everything back; what the network does not hear of expires."""
        try:
            for group in tuple(self._urls):
                await self._withdraw(group)
        except ExposureError as error:
            logger.info("not taken back, it will expire: %s", error)

    async def _withdraw(self, group: str) -> None:
        self._receiver.forget(self._urls.pop(group))
        try:
            await self._client.call("DELETE", _path(group))
        except ApiRefused as error:
            if error.status != 404:
                raise

    def _url(self, group: str) -> str:
        if group not in self._urls:
            self._urls[group], _ = self._receiver.open(lambda data: self._came(group, data))
        return self._urls[group]

    def _came(self, group: str, data: Any) -> None:
        self._on_wish(group, wish_of(data, self._least, self._longest_s))


def _path(group: str) -> str:
    return f"{ROOT}/{quote(group, safe='')}"
