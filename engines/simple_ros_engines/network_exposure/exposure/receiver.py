"""Where networks send notifications: each session has a URL of its own that nobody can guess."""

from __future__ import annotations

import hmac
import logging
import secrets
import ssl
from collections.abc import Callable
from typing import Any

from simple_ros_engines.network_exposure.exposure.model import ExposureError
from simple_ros_engines.network_exposure.exposure.web import Reply, WebServer, json_of
from simple_ros_engines.store.http import Request

__all__ = ["NotificationReceiver", "Taker"]

logger = logging.getLogger(__name__)

_PREFIX = "/notifications/"
Taker = Callable[[Any], None]
"""Takes the JSON of a notification; raises `ExposureError` if it is none."""


class NotificationReceiver:
    """Receives.

    Args:
        public_url: How the network reaches it, if that is not where it listens (a proxy, a NAT).
        tls: To listen with https.

    Attributes:
        received: Notifications taken.
        malformed: Notifications that were none.
        refused: Requests with an address or token that is not known.
    """

    def __init__(self, public_url: str = "", tls: ssl.SSLContext | None = None) -> None:
        self.received = self.malformed = self.refused = 0
        self._public_url = public_url.rstrip("/")
        self._server = WebServer(self._came, tls)
        self._host = ""
        self._takers: dict[str, tuple[Taker, str]] = {}

    async def start(self, host: str = "127.0.0.1", port: int = 0) -> None:
        """Listen.

        Raises:
            OSError: The port is taken.
        """
        await self._server.start(host, port)
        self._host = host

    async def close(self) -> None:
        """Listen no more."""
        await self._server.close()

    @property
    def url(self) -> str:
        """How the network reaches it."""
        return self._public_url or f"{self._server.scheme}://{self._host}:{self._server.port}"

    def open(self, taker: Taker, *, with_token: bool = False) -> tuple[str, str]:
        """A new URL, and the token to send with it (empty if none is asked for)."""
        key = secrets.token_urlsafe(18)
        token = secrets.token_urlsafe(24) if with_token else ""
        self._takers[key] = (taker, token)
        return f"{self.url}{_PREFIX}{key}", token

    def forget(self, url: str) -> None:
        """Nothing more is taken at a URL."""
        self._takers.pop(url.rpartition("/")[2], None)

    async def _came(self, request: Request) -> Reply:
        taker, token = self._takers.get(request.path.removeprefix(_PREFIX), (None, ""))
        if taker is None:
            self.refused += 1
            return Reply(404, {"title": "Not Found", "status": 404})
        if request.method != "POST":
            return Reply(405, {"title": "Method Not Allowed", "status": 405}, {"Allow": "POST"})
        sent = request.headers.get("authorization", "").removeprefix("Bearer ")
        if token and not hmac.compare_digest(sent.encode(), token.encode()):
            self.refused += 1
            return Reply(401, {"title": "Unauthorized", "status": 401})
        try:
            taker(json_of(request))
        except (ExposureError, ValueError) as error:
            self.malformed += 1
            if self.malformed == 1:
                logger.warning("a notification is left out: %s", error)
            return Reply(400, {"title": "Bad Request", "status": 400, "detail": str(error)[:200]})
        self.received += 1
        return Reply(204)
