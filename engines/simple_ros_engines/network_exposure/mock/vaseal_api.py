"""The mock's Network Layer Service Server: what applications expose to the network, and what it asks of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

from simple_ros_engines.network_exposure.exposure.web import Reply
from simple_ros_engines.network_exposure.mock.services import Desk, Outgoing, body_of, problem
from simple_ros_engines.network_exposure.vaseal.bodies import ADAPTATION, APPLICATION, ROOT
from simple_ros_engines.store.http import Request

__all__ = ["VasealApi"]

_MOST = 1000


@dataclass(slots=True)
class _Application:
    body: dict[str, Any]
    until_s: float


class VasealApi:
    """Answers what is below ``/vaseal``.

    Args:
        desk: The network.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._known: dict[str, _Application] = {}

    @property
    def applications(self) -> dict[str, dict[str, Any]]:
        """As they were told, those that are not too old."""
        now_s = self._desk.now_s()
        self._known = {name: one for name, one in self._known.items() if one.until_s > now_s}
        return {name: one.body for name, one in self._known.items()}

    def answer(self, request: Request) -> Reply:
        """The answer to a request."""
        name = unquote(request.path.removeprefix(ROOT).strip("/"))
        known = self.applications
        match request.method:
            case "GET" if not name:
                return Reply(200, list(known.values()))
            case "PUT" if name:
                return self._told(name, body_of(request, APPLICATION))
            case _ if name not in known:
                return problem(404, f"there is no application {name!r}")
            case "GET":
                return Reply(200, known[name])
            case "DELETE":
                del self._known[name]
                return Reply(204)
        return problem(405, request.method)

    def _told(self, name: str, body: dict[str, Any]) -> Reply:
        if body["group"] != name:
            return problem(400, f"group {body['group']!r} is told as {name!r}")
        is_new = name not in self._known
        if is_new and len(self._known) >= _MOST:
            return problem(403, "there are too many applications")
        self._known[name] = _Application(body, self._desk.now_s() + body["validFor"])
        return Reply(201 if is_new else 200, body)

    def wish(self, request: Request) -> tuple[Reply, Outgoing | None]:
        """Somebody at the network asks an application to adapt: the reply to them, what goes to the application."""
        name = unquote(request.path.rpartition("/")[2])
        body = body_of(request, ADAPTATION)
        known = self.applications.get(name)
        if known is None or "notificationDestination" not in known:
            return problem(404, f"there is no application {name!r} that takes requests"), None
        return Reply(202, body), Outgoing(known["notificationDestination"], body)
