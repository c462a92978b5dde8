"""The mock's NEF: AsSessionWithQoS."""

from __future__ import annotations

import re
import secrets
from typing import Any

from simple_ros_engines.network_exposure.exposure import schemas
from simple_ros_engines.network_exposure.exposure.notation import bits_per_second
from simple_ros_engines.network_exposure.exposure.web import Reply
from simple_ros_engines.network_exposure.mock.core import (
    Admission,
    BearerEvent,
    BearerState,
)
from simple_ros_engines.network_exposure.mock.services import (
    BadBody,
    Desk,
    Outgoing,
    body_of,
    problem,
    refusal,
)
from simple_ros_engines.store.http import Request

__all__ = ["NefApi"]

_PATH = re.compile(r"/3gpp-as-session-with-qos/v1/([^/]+)/subscriptions(?:/([^/]+))?")


class NefApi:
    """Answers what is below ``/3gpp-as-session-with-qos``.

    Args:
        desk: The network.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._owners: dict[str, str] = {}

    def answer(self, request: Request) -> Reply:
        """The answer to a request."""
        found = _PATH.fullmatch(request.path)
        if found is None:
            return problem(404, f"there is no {request.path}")
        owner, name = found[1], found[2]
        if name is None:
            return self._whole(request, owner)
        body = self._desk.records.get(name)
        if body is None or self._owners[name] != owner:
            return problem(404, f"there is no subscription {name}")
        match request.method:
            case "GET":
                return Reply(200, body)
            case "DELETE":
                self.forget(name)
                return Reply(204)
            case "PUT":
                return self._changed(name, body_of(request, schemas.AS_SESSION))
        return problem(405, request.method)

    def _whole(self, request: Request, owner: str) -> Reply:
        if request.method == "GET":
            return Reply(
                200,
                [body for name, body in self._desk.records.items() if self._owners[name] == owner],
            )
        if request.method != "POST":
            return problem(405, request.method)
        body = body_of(request, schemas.AS_SESSION)
        desk = self._desk
        qci, others, rate, flow = _read(body)
        name = secrets.token_hex(6)
        duration_s = body.get("qosDuration", 86_400)
        bearer = desk.network.ask(name, flow, qci, others, rate, duration_s, desk.now_s())
        if isinstance(bearer, Admission):
            return refusal(bearer)
        uri = f"{desk.root()}{request.path}/{name}"
        desk.records[name] = body | {"self": uri}
        self._owners[name] = owner
        return Reply(201, desk.records[name], {"Location": uri})

    def _changed(self, name: str, body: dict[str, Any]) -> Reply:
        desk = self._desk
        qci, others, rate, _ = _read(body)
        duration_s = body.get("qosDuration", 86_400)
        done = desk.network.change(name, qci, others, rate, duration_s, desk.now_s())
        if isinstance(done, Admission):
            return refusal(done)
        desk.records[name] = body | {"self": desk.records[name]["self"]}
        return Reply(200, desk.records[name])

    def forget(self, name: str) -> None:
        """A subscription is gone."""
        self._desk.records.pop(name, None)
        self._owners.pop(name, None)
        if name in self._desk.network.bearers:
            self._desk.network.end(name)

    def told(self, event: BearerEvent) -> Outgoing | None:
        """The notification of an event; None if it is of no subscription here."""
        body = self._desk.records.get(event.bearer.id)
        if body is None:
            return None
        kind = _kind(event)
        report: dict[str, Any] = {"event": kind, "flowIds": [1]}
        if kind in ("QOS_NOT_GUARANTEED", "SUCCESSFUL_RESOURCES_ALLOCATION"):
            report["appliedQosRef"] = _like(body["qosReference"], event.bearer.applied.qci)
        if event.bearer.state is BearerState.ENDED:
            self.forget(event.bearer.id)
        data = {"transaction": body["self"], "eventReports": [report]}
        return Outgoing(body["notificationDestination"], data)


def _kind(event: BearerEvent) -> str:
    match event.bearer.state:
        case BearerState.ENDED:
            return "SESSION_TERMINATION"
        case BearerState.DEGRADED:
            return "QOS_NOT_GUARANTEED"
    if event.before is BearerState.SETTING_UP:
        return "SUCCESSFUL_RESOURCES_ALLOCATION"
    return "QOS_GUARANTEED"


def _number(reference: str) -> int:
    found = re.search(r"(\d+)$", reference)
    if found is None:
        raise BadBody(f"qosReference {reference!r} is not agreed: it must end in a class's number")
    return int(found[1])


def _like(reference: str, qci: int) -> str:
    return re.sub(r"\d+$", str(qci), reference)


def _read(body: dict[str, Any]) -> tuple[int, tuple[int, ...], float, str]:
    if not body.get("flowInfo") or "qosReference" not in body:
        raise BadBody("flowInfo and qosReference are needed here")
    rates = body.get("tscQosReq", {})
    rate = sum(bits_per_second(rates[key]) for key in ("reqGbrUl", "reqGbrDl") if key in rates)
    others = tuple(_number(name) for name in body.get("altQoSReferences", ()))
    flow = body["flowInfo"][0].get("flowDescriptions", [""])[0]
    return _number(body["qosReference"]), others, rate, flow
