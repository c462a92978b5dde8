"""The mock's SEAL: groups, unicast subscriptions, monitoring."""

from __future__ import annotations

import json
import secrets
from datetime import UTC, datetime
from typing import Any

from simple_ros_engines.network_exposure.exposure import schemas
from simple_ros_engines.network_exposure.exposure.notation import bit_rate, bits_per_second
from simple_ros_engines.network_exposure.exposure.schema import problems
from simple_ros_engines.network_exposure.exposure.web import Reply
from simple_ros_engines.network_exposure.mock.core import Admission, Bearer
from simple_ros_engines.network_exposure.mock.services import (
    BadBody,
    Desk,
    Outgoing,
    body_of,
    problem,
    refusal,
    stamp,
)
from simple_ros_engines.store.http import Request

__all__ = ["SealApi"]

_GROUPS = "/ss-gm/v1/group-documents"
_UNICAST = "/ss-nra/v1/unicast-subscriptions"
_MONITORING = "/ss-nrm/v1/subscriptions"


class SealApi:
    """Answers what is below ``/ss-``.

    Args:
        desk: The network.
    """

    def __init__(self, desk: Desk) -> None:
        self.groups: dict[str, dict[str, Any]] = {}
        self.monitors: dict[str, dict[str, Any]] = {}
        self._desk = desk
        self._told: dict[str, tuple[int, float]] = {}

    def answer(self, request: Request) -> Reply:
        """The answer to a request."""
        for root, handle in (
            (_GROUPS, self._group),
            (_UNICAST, self._unicast),
            (_MONITORING, self._monitoring),
        ):
            if request.path == root or request.path.startswith(f"{root}/"):
                return handle(request, request.path[len(root) + 1 :])
        return problem(404, f"there is no {request.path}")

    # -- groups ----------------------------------------------------------------------------------

    def _group(self, request: Request, name: str) -> Reply:
        if not name:
            return self._groups_as_whole(request)
        group = self.groups.get(name)
        if group is None:
            return problem(404, f"there is no group document {name}")
        match request.method:
            case "GET":
                return Reply(200, group)
            case "DELETE":
                del self.groups[name]
                return Reply(204)
            case "PATCH":
                return self._patched(request, name, group)
        return problem(405, request.method)

    def _patched(self, request: Request, name: str, group: dict[str, Any]) -> Reply:
        if not request.headers.get("content-type", "").startswith("application/merge-patch+json"):
            return problem(415, "a patch is application/merge-patch+json")
        patch = body_of(request, {"type": "object"})
        if any(key in patch for key in ("valGroupId", "suppFeat", "resUri")):
            return problem(400, "valGroupId, suppFeat and resUri cannot be changed")
        changed = {key: value for key, value in (group | patch).items() if value is not None}
        wrong = problems(changed, schemas.GROUP)
        if wrong:
            raise BadBody("; ".join(wrong))
        self.groups[name] = changed
        return Reply(200, changed)

    def _groups_as_whole(self, request: Request) -> Reply:
        if request.method == "GET":
            wanted = request.query.get("val-group-id")
            found = [
                group for group in self.groups.values() if wanted in (None, group["valGroupId"])
            ]
            return Reply(200, found) if found else problem(404, "there is no such group")
        if request.method != "POST":
            return problem(405, request.method)
        body = body_of(request, schemas.GROUP)
        if any(group["valGroupId"] == body["valGroupId"] for group in self.groups.values()):
            return problem(403, f"there is a group {body['valGroupId']} already")
        name = secrets.token_hex(6)
        uri = f"{self._desk.root()}{_GROUPS}/{name}"
        self.groups[name] = body | {"resUri": uri}
        return Reply(201, self.groups[name], {"Location": uri})

    # -- unicast subscriptions -------------------------------------------------------------------

    def _unicast(self, request: Request, name: str) -> Reply:
        if not name:
            if request.method != "POST":
                return problem(405, request.method)
            return self._subscribed(body_of(request, schemas.UNICAST_SUBSCRIPTION))
        body = self._desk.records.get(name)
        if body is None:
            return problem(404, f"there is no subscription {name}")
        match request.method:
            case "GET":
                return Reply(200, body)
            case "DELETE":
                self.forget(name)
                return Reply(204)
        # Release 18 has no way to change one.
        return problem(405, request.method)

    def _subscribed(self, body: dict[str, Any]) -> Reply:
        qci, others, rate, flow = _read_qos(body)
        name = secrets.token_hex(6)
        desk = self._desk
        bearer = desk.network.ask(name, flow, qci, others, rate, _seconds_left(body), desk.now_s())
        if isinstance(bearer, Admission):
            return refusal(bearer)
        desk.records[name] = body
        return Reply(201, body, {"Location": f"{desk.root()}{_UNICAST}/{name}"})

    def forget(self, name: str) -> None:
        """A subscription is gone."""
        self._desk.records.pop(name, None)
        if name in self._desk.network.bearers:
            self._desk.network.end(name)

    # -- monitoring ------------------------------------------------------------------------------

    def _monitoring(self, request: Request, name: str) -> Reply:
        if not name:
            if request.method != "POST":
                return problem(405, request.method)
            body = body_of(request, schemas.MONITORING_SUBSCRIPTION)
            key = secrets.token_hex(6)
            self.monitors[key] = body
            uri = f"{self._desk.root()}{_MONITORING}/{key}"
            return Reply(201, body, {"Location": uri})
        if name not in self.monitors:
            return problem(404, f"there is no subscription {name}")
        match request.method:
            case "GET":
                return Reply(200, self.monitors[name])
            case "DELETE":
                del self.monitors[name]
                self._told.pop(name, None)
                return Reply(204)
        return problem(405, request.method)

    def reports(self) -> list[Outgoing]:
        """Measurements that are due."""
        found = []
        now_s = self._desk.now_s()
        for name, body in self.monitors.items():
            bearer = self._bearer_of(body)
            if bearer is None or "notifUri" not in body:
                continue
            delay_ms = round(self._desk.network.delay_ms(bearer))
            last_ms, last_s = self._told.get(name, (-1, -1e9))
            period_s = body.get("reportReqs", {}).get("reportingPeriod", 1)
            if delay_ms == last_ms and now_s - last_s < period_s:
                continue
            self._told[name] = (delay_ms, now_s)
            found.append(Outgoing(body["notifUri"], _report(body, bearer, delay_ms)))
        return found

    def _bearer_of(self, body: dict[str, Any]) -> Bearer | None:
        """The newest bearer of the device with the delay that is watched."""
        limits = [
            next(iter(item["measThrValues"].values()))
            for item in body.get("reportReqs", {}).get("reportingThrs", ())
        ]
        for name, record in reversed(self._desk.records.items()):
            bearer = self._desk.network.bearers.get(name)
            if bearer is None or [record["valTgtUe"]] != body.get("valUeIds"):
                continue
            if not limits or bearer.wanted.delay_ms in limits:
                return bearer
        return None


def _report(body: dict[str, Any], bearer: Bearer, delay_ms: int) -> dict[str, Any]:
    wanted = bearer.wanted
    # Tenths of a per cent; in delay-critical classes what is late counts as lost.
    lost = 1000 if wanted.is_delay_critical and delay_ms > wanted.delay_ms else 0
    return {
        "valUeIds": body["valUeIds"],
        "measData": {
            "ulDelay": delay_ms,
            "dlDelay": delay_ms,
            "avgPlr": lost,
            "avgDataRate": bit_rate(bearer.bit_rate),
        },
        "timestamp": stamp(),
    }


def _read_qos(body: dict[str, Any]) -> tuple[int, tuple[int, ...], float, str]:
    """Class, alternatives, rate and flow of a subscription.

    Raises:
        BadBody: ``uniQosReq`` is not of the form agreed.
    """
    try:
        qos = json.loads(body.get("uniQosReq", ""))
    except (ValueError, RecursionError) as error:
        raise BadBody(f"uniQosReq: {error}") from error
    if isinstance(qos, dict) and "flowID" in qos and "qci" in qos:
        rate = max(float(qos.get("ulBW", 0)), float(qos.get("dlBW", 0)))
        return int(qos["qci"]), (), rate, json.dumps(qos["flowID"], sort_keys=True)
    wrong = problems(qos, schemas.UNIQUE_QOS)
    if wrong:
        raise BadBody(f"uniQosReq: {'; '.join(wrong)}")
    rate = sum(bits_per_second(qos[key]) for key in ("gbrUl", "gbrDl") if key in qos)
    return qos["5qi"], tuple(qos.get("alternatives", ())), rate, qos["flowDescriptions"][0]


def _seconds_left(body: dict[str, Any]) -> float:
    if "duration" not in body:
        return 3600.0
    until = datetime.fromisoformat(body["duration"])
    return max(0.0, (until - datetime.now(UTC)).total_seconds())
