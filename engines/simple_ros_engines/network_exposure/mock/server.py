"""The mock network as a server: SEAL, NEF, CAMARA and VASEAL on one port, tokens, notifications, faults on request.

Every answer has the header ``X-Simulated-Network``. ``GET /mock/state`` shows all, ``POST /mock/control`` changes settings
and faults by their names, so that tests and demos can use up its capacity, or make it fail. ``POST /mock/adapt/GROUP`` asks
an application to adapt, as somebody at the network would.
"""

from __future__ import annotations

import asyncio
import dataclasses
import json
import logging
import ssl
import time
from typing import Any, Self

from simple_ros_engines.network_exposure.exposure.http import (
    HttpRequest,
    HttpTransport,
    StandardTransport,
)
from simple_ros_engines.network_exposure.exposure.model import ExposureError
from simple_ros_engines.network_exposure.exposure.web import Reply, WebServer, json_of
from simple_ros_engines.network_exposure.mock.camara_api import CamaraApi
from simple_ros_engines.network_exposure.mock.core import BearerEvent, MockNetwork, MockSettings
from simple_ros_engines.network_exposure.mock.faults import Faults, sorted_out
from simple_ros_engines.network_exposure.mock.nef_api import NefApi
from simple_ros_engines.network_exposure.mock.seal_api import SealApi
from simple_ros_engines.network_exposure.mock.services import (
    BadBody,
    Desk,
    Outgoing,
    TokenDesk,
    camara_problem,
    problem,
)
from simple_ros_engines.network_exposure.mock.vaseal_api import VasealApi
from simple_ros_engines.store.http import Request

__all__ = ["MockServer"]

logger = logging.getLogger(__name__)

_TICK_S = 0.05
_NOTIFY_S = 5.0
_ATTEMPTS = 3
_LABEL = {"X-Simulated-Network": "simple_ros mock; no radio is behind it"}


class MockServer:
    """Serves a mock network.

    Args:
        settings: How the network behaves.
        client_id: Who may ask; empty: everybody, without a token.
        client_secret: With what.
        tls: To serve https.
        notifies: Sends notifications; None: by http, or https with certificates of the system.

    Attributes:
        network: The network.
        faults: What is wrong with it.
        requests: What was asked: method, path and status, newest last.
        sent: Notifications that were taken.
        unsent: Notifications that nobody took, or that were lost on purpose.
    """

    def __init__(
        self,
        settings: MockSettings | None = None,
        *,
        client_id: str = "",
        client_secret: str = "",
        tls: ssl.SSLContext | None = None,
        notifies: HttpTransport | None = None,
    ) -> None:
        self.network = MockNetwork(settings or MockSettings())
        self.faults = Faults()
        self.tokens = TokenDesk(client_id, client_secret)
        self.requests: list[tuple[str, str, int]] = []
        self.sent = self.unsent = 0
        self.seal = SealApi(self._desk())
        self.nef = NefApi(self._desk())
        self.camara = CamaraApi(self._desk())
        self.vaseal = VasealApi(self._desk())
        self._server = WebServer(self._answer, tls)
        self._notifies = notifies or StandardTransport()
        self._host = ""
        self._ticking: asyncio.Task[None] | None = None
        self._sending: set[asyncio.Task[None]] = set()

    def _desk(self) -> Desk:
        return Desk(self.network, lambda: self.url, time.monotonic)

    @property
    def url(self) -> str:
        """Where it listens."""
        return f"{self._server.scheme}://{self._host}:{self._server.port}"

    @property
    def token_url(self) -> str:
        """Where tokens are."""
        return f"{self.url}/oauth2/token"

    async def start(self, host: str = "127.0.0.1", port: int = 0) -> None:
        """Listen.

        Raises:
            OSError: The port is taken.
        """
        self._host = host
        await self._server.start(host, port)
        self._ticking = asyncio.create_task(self._tick())

    async def close(self) -> None:
        """Listen no more."""
        if self._ticking is not None:
            self._ticking.cancel()
            await asyncio.gather(self._ticking, return_exceptions=True)
        for task in self._sending:
            task.cancel()
        await asyncio.gather(*self._sending, return_exceptions=True)
        await self._server.close()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    # -- time ------------------------------------------------------------------------------------

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(_TICK_S)
            self.look()

    def look(self) -> None:
        """Let the network go on, and send what it says."""
        for event in self.network.tick(time.monotonic()):
            self.tell(event)
        for report in self.seal.reports():
            self._send(report)

    def tell(self, event: BearerEvent) -> None:
        """Send the notification of an event."""
        for api in (self.nef, self.camara):
            outgoing = api.told(event)
            if outgoing is not None:
                self._send(outgoing)

    def terminate(self, bearer_id: str) -> None:
        """The network ends a bearer by itself.

        Raises:
            KeyError: There is no such bearer.
        """
        self.tell(self.network.terminate(bearer_id))

    def _send(self, outgoing: Outgoing) -> None:
        if self.faults.loses_notifications:
            self.unsent += 1
            return
        task = asyncio.create_task(self._post(outgoing))
        self._sending.add(task)
        task.add_done_callback(self._sending.discard)

    async def _post(self, outgoing: Outgoing) -> None:
        headers = {"Content-Type": "application/json"}
        if outgoing.token:
            headers["Authorization"] = f"Bearer {outgoing.token}"
        body = json.dumps(outgoing.data).encode()
        request = HttpRequest("POST", outgoing.url, headers, body)
        for _ in range(_ATTEMPTS):
            try:
                answer = await self._notifies.send(request, _NOTIFY_S)
            except ExposureError as error:
                logger.debug("notification to %s: %s", outgoing.url, error)
                await asyncio.sleep(_TICK_S)
                continue
            if answer.status < 300:
                self.sent += 1
                return
            break
        self.unsent += 1

    # -- requests --------------------------------------------------------------------------------

    async def _answer(self, request: Request) -> Reply | None:
        if request.path.startswith("/mock/"):
            return _labelled(self._control(request))
        faults = self.faults
        if faults.delay_s:
            await asyncio.sleep(faults.delay_s)
        if faults.is_down:
            return None
        status = faults.take_status()
        reply = self._failing(request, status) if status else self._real(request)
        if faults.malformed and reply.data is not None:
            reply = Reply(reply.status, b'{"half": ', reply.headers)
        self.requests.append((request.method, request.path, reply.status))
        return _labelled(reply)

    def _failing(self, request: Request, status: int) -> Reply:
        if status == 401:
            self.tokens.revoke_all()
        reply = self._problem(request, status, "it was told to fail")
        if not self.faults.retry_after_s:
            return reply
        headers = {"Retry-After": str(self.faults.retry_after_s)}
        return dataclasses.replace(reply, headers=headers)

    def _real(self, request: Request) -> Reply:
        if request.path == "/oauth2/token":
            return self.tokens.answer(request, time.monotonic())
        if not self.tokens.admits(request, time.monotonic()):
            return self._problem(request, 401, "there is no valid token")
        try:
            return self._routed(request)
        except BadBody as error:
            return self._problem(request, 400, str(error))

    def _routed(self, request: Request) -> Reply:
        if request.path.startswith("/quality-on-demand/"):
            return self.camara.answer(request)
        if request.path.startswith("/3gpp-as-session-with-qos/"):
            return self.nef.answer(request)
        if request.path.startswith("/vaseal/"):
            return self.vaseal.answer(request)
        return self.seal.answer(request)

    @staticmethod
    def _problem(request: Request, status: int, detail: str) -> Reply:
        make = camara_problem if request.path.startswith("/quality-on-demand/") else problem
        return make(status, detail)

    # -- control ---------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """What there is."""
        return {
            "simulated": True,
            "settings": dataclasses.asdict(self.network.settings),
            "faults": dataclasses.asdict(self.faults),
            "free_bps": self.network.free_bps,
            "applications": list(self.vaseal.applications.values()),
            "groups": [group["valGroupId"] for group in self.seal.groups.values()],
            "bearers": [
                {
                    "id": bearer.id,
                    "flow": bearer.flow,
                    "wanted": bearer.wanted.qci,
                    "applied": bearer.applied.qci,
                    "state": bearer.state.value,
                    "bit_rate": bearer.bit_rate,
                }
                for bearer in self.network.bearers.values()
            ],
        }

    def control(self, changes: dict[str, Any]) -> None:
        """Change settings and faults.

        Raises:
            ValueError: A name or a value is wrong.
        """
        settings, faults = sorted_out(changes)
        self.network.settings = dataclasses.replace(self.network.settings, **settings)
        for name, value in faults.items():
            setattr(self.faults, name, value)

    def _control(self, request: Request) -> Reply:
        try:
            if request.method == "POST" and request.path.startswith("/mock/adapt/"):
                return self._adapt(request)
            if (request.method, request.path) == ("POST", "/mock/control"):
                changes = json_of(request)
                if not isinstance(changes, dict):
                    return problem(400, "an object is needed")
                self.control(changes)
            elif (request.method, request.path) != ("GET", "/mock/state"):
                return problem(404, f"there is no {request.method} {request.path}")
        except ValueError as error:
            return problem(400, str(error))
        return Reply(200, self.state())

    def _adapt(self, request: Request) -> Reply:
        reply, outgoing = self.vaseal.wish(request)
        if outgoing is not None:
            self._send(outgoing)
        return reply


def _labelled(reply: Reply) -> Reply:
    return dataclasses.replace(reply, headers={**_LABEL, **reply.headers})
