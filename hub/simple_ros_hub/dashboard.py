"""The dashboard: a page that shows what the hub knows, and switches for policy, modes and components.

It listens where it is told to, and asks nobody for a name: whoever reaches it may switch. A page of another
origin may not.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.nav_msgs import OccupancyGrid
from simple_ros.msg.wireless_ros_msgs import ControlComponentRequest, SetGlobalPolicyRequest
from simple_ros.qos import LATCHED
from simple_ros_hub.components import ENGINES, NAMESPACE
from simple_ros_hub.picture import event_json, links_json, map_json, shares_json, status_json
from simple_ros_hub.policy import POLICIES

if TYPE_CHECKING:
    from simple_ros_hub.hub import Hub

__all__ = ["Dashboard"]

logger = logging.getLogger(__name__)

_WEB = Path(__file__).parent / "web"
_FILES = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/app.js": ("app.js", "text/javascript; charset=utf-8"),
    "/style.css": ("style.css", "text/css; charset=utf-8"),
    "/icon.svg": ("icon.svg", "image/svg+xml"),
}
_PERIOD_S = 0.5
_EVENTS = 100
_MOST_BYTES = 4096
_MODES = ("realtime", "burst", "optimized")


class Dashboard:
    """Serves page and feed. Use `run`.

    Args:
        hub: What is shown.
        host: Where to listen.
        port: The same; 0 for any free one.

    Attributes:
        url: Where it is, once it listens.
    """

    def __init__(self, hub: Hub, host: str, port: int) -> None:
        self.url = ""
        self._hub = hub
        self._host, self._port = host, port
        self._map: dict[str, Any] | None = None
        self._map_number = 0
        self._pose: list[float] | None = None

    async def run(self) -> None:
        """Listen until cancelled; if that is not possible it is told, and the hub goes on without."""
        node = self._hub.node
        map_topic = f"/{NAMESPACE}/enhanced_map"
        await node.subscribe(map_topic, OccupancyGrid, self._map_came, qos=LATCHED)
        await node.subscribe("/robot/pose", PoseStamped, self._pose_came)
        try:
            server = await serve(
                self._connected,
                self._host,
                self._port,
                process_request=_answer,
                max_size=_MOST_BYTES,
            )
        except OSError as error:
            self._hub.log_error(f"no dashboard on {self._host}:{self._port}: {error.strerror}")
            return
        port = next(iter(server.sockets)).getsockname()[1]
        host = f"[{self._host}]" if ":" in self._host else self._host
        self.url = f"http://{host}:{port}/"
        self._hub.log_event(f"Dashboard at {self.url}")
        async with server:
            await asyncio.Future()

    # -- the feed ------------------------------------------------------------------------------

    async def _connected(self, connection: ServerConnection) -> None:
        sending = asyncio.create_task(self._feed(connection))
        try:
            async for text in connection:
                await connection.send(json.dumps(await self._command(text)))
        except ConnectionClosed:
            logger.debug("a dashboard's connection broke")
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _feed(self, connection: ServerConnection) -> None:
        told_event = told_map = 0
        while True:
            events = [e for e in self._hub.journal.system_events if e.number > told_event]
            state = self._state()
            state["events"] = event_json(events[-_EVENTS:])
            if self._map_number != told_map:
                told_map, state["map"] = self._map_number, self._map
            told_event = events[-1].number if events else told_event
            await connection.send(json.dumps(state))
            await asyncio.sleep(_PERIOD_S)

    def _state(self) -> dict[str, Any]:
        hub = self._hub
        return {
            "op": "state",
            **status_json(hub.reporter.status()),
            "policy": {
                "name": hub.policy.policy,
                "pinned": hub.policy.pinned,
                "known": list(POLICIES),
            },
            "links": links_json(hub.coordinator.newest_metrics, hub.senses.channels),
            "shares": shares_json(hub.shared),
            "pose": self._pose,
        }

    def _map_came(self, grid: OccupancyGrid) -> None:
        self._map = map_json(grid)
        self._map_number += 1

    def _pose_came(self, message: PoseStamped) -> None:
        place = message.pose.position
        self._pose = [round(place.x, 3), round(place.y, 3)]

    # -- switches ------------------------------------------------------------------------------

    async def _command(self, text: str | bytes) -> dict[str, Any]:
        switches: dict[str, Callable[[dict[str, Any]], Awaitable[str]]] = {
            "policy": self._policy,
            "component": self._component,
            "mode": self._mode,
        }
        try:
            said = json.loads(text)
            switch = switches[said["op"]]
            return {"op": "answer", "ok": True, "message": await switch(said)}
        except SimpleRosError as error:
            message = " ".join(str(error).split())
        except (LookupError, TypeError, ValueError):
            message = f"not understood; known are {', '.join(switches)}"
        return {"op": "answer", "ok": False, "message": message}

    async def _policy(self, said: dict[str, Any]) -> str:
        answer = self._hub.services.set_policy(SetGlobalPolicyRequest(policy=str(said["policy"])))
        if not answer.ok:
            raise ConfigError(answer.message)
        return f"policy is {answer.policy}"

    async def _component(self, said: dict[str, Any]) -> str:
        request = ControlComponentRequest(name=str(said["name"]), action=str(said["action"]))
        answer = self._hub.services.control(request)
        if not answer.ok:
            raise ConfigError(answer.message)
        return answer.message

    async def _mode(self, said: dict[str, Any]) -> str:
        engine, mode = str(said["engine"]), str(said["mode"])
        if engine not in ENGINES or mode not in _MODES:
            raise ConfigError(f"there is no mode {mode!r} of {engine!r}")
        await self._hub.node.set_parameters({f"/{NAMESPACE}/{engine}/mode": mode})
        self._hub.log_event(f"mode {mode} was chosen", engine)
        return f"{engine} works in mode {mode}"


def _answer(_: ServerConnection, request: Request) -> Response | None:
    """Files by HTTP; None to go on with a WebSocket."""
    path = urlsplit(request.path).path
    if path == "/feed":
        return None if _same_origin(request.headers) else _text(HTTPStatus.FORBIDDEN)
    if path not in _FILES:
        return _text(HTTPStatus.NOT_FOUND)
    name, kind = _FILES[path]
    body = (_WEB / name).read_bytes()
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Content-Security-Policy": "default-src 'self'; connect-src 'self' ws: wss:",
        }
    )
    return Response(HTTPStatus.OK, "OK", headers, body)


def _same_origin(headers: Headers) -> bool:
    """Whether a page asks that came from here; programs send no origin."""
    origin = headers.get("Origin")
    return origin is None or urlsplit(origin).netloc == headers.get("Host")


def _text(status: HTTPStatus) -> Response:
    body = f"{status.value} {status.phrase}\n".encode()
    headers = Headers({"Content-Type": "text/plain", "Content-Length": str(len(body))})
    return Response(status, status.phrase, headers, body)
