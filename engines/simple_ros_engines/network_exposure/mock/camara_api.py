"""The mock's CAMARA Quality-on-Demand."""

from __future__ import annotations

import json
import uuid
from datetime import UTC, datetime, timedelta
from typing import Any

from simple_ros_engines.network_exposure.exposure import schemas
from simple_ros_engines.network_exposure.exposure.web import Reply
from simple_ros_engines.network_exposure.mock.core import (
    Admission,
    Bearer,
    BearerEvent,
    BearerState,
)
from simple_ros_engines.network_exposure.mock.services import (
    Desk,
    Outgoing,
    body_of,
    camara_problem,
    stamp,
)
from simple_ros_engines.store.http import Request

__all__ = ["PROFILES", "CamaraApi"]

_ROOT = "/quality-on-demand/v1"
PROFILES = {"QOS_E": (80, 0.0), "QOS_S": (3, 2e6), "QOS_M": (1, 2e6), "QOS_L": (4, 5e6)}
"""Profiles of the mock: the class behind each, and the bit rate it reserves."""
_ASKED = (
    "device", "applicationServer", "devicePorts", "applicationServerPorts", "qosProfile",
    "duration", "sink",
)  # fmt: skip


class CamaraApi:
    """Answers what is below ``/quality-on-demand``.

    Args:
        desk: The network.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._ended: dict[str, str] = {}

    def answer(self, request: Request) -> Reply:
        """The answer to a request."""
        correlator = request.headers.get("x-correlator")
        reply = self._answer(request, request.path.removeprefix(_ROOT).strip("/").split("/"))
        if correlator is None:
            return reply
        return Reply(reply.status, reply.data, {**reply.headers, "x-correlator": correlator})

    def _answer(self, request: Request, words: list[str]) -> Reply:
        match request.method, words:
            case "POST", ["sessions"]:
                return self._created(body_of(request, schemas.CREATE_SESSION))
            case "POST", ["retrieve-sessions"]:
                return self._of_device(body_of(request, {"type": "object"}))
            case _, ["sessions", name, *rest] if name in self._desk.records:
                return self._of_session(request, name, rest)
            case _, ["sessions", name, *_]:
                return camara_problem(404, f"there is no session {name}")
        return camara_problem(404, f"there is no {request.method} {request.path}")

    def _of_session(self, request: Request, name: str, rest: list[str]) -> Reply:
        match request.method, rest:
            case "GET", []:
                return Reply(200, self._info(name))
            case "DELETE", []:
                self.forget(name)
                return Reply(204)
            case "POST", ["extend"]:
                body = body_of(request, schemas.EXTEND_SESSION)
                return self._extended(name, body["requestedAdditionalDuration"])
        return camara_problem(405, f"{request.method} is not for {request.path}")

    def _created(self, body: dict[str, Any]) -> Reply:
        if body["qosProfile"] not in PROFILES:
            return camara_problem(404, f"there is no profile {body['qosProfile']}")
        if "device" not in body:
            return camara_problem(422, "the device is needed", "MISSING_IDENTIFIER")
        qci, rate = PROFILES[body["qosProfile"]]
        desk = self._desk
        name = str(uuid.uuid4())
        keys = ("device", "applicationServer", "devicePorts", "applicationServerPorts")
        flow = json.dumps([body.get(key) for key in keys], sort_keys=True)
        bearer = desk.network.ask(
            name, flow, qci, (), rate, body["duration"], desk.now_s(), may_share_flow=False
        )
        if bearer is Admission.CONFLICT:
            return camara_problem(409, bearer.value)
        if isinstance(bearer, Admission):
            return camara_problem(429, bearer.value, "QUOTA_EXCEEDED")
        desk.records[name] = body
        location = f"{desk.root()}{_ROOT}/sessions/{name}"
        return Reply(201, self._info(name), {"Location": location})

    def _extended(self, name: str, seconds: int) -> Reply:
        bearer = self._desk.network.bearers.get(name)
        if bearer is None or bearer.state is BearerState.SETTING_UP:
            return camara_problem(
                409,
                "the session is not AVAILABLE",
                "QUALITY_ON_DEMAND.SESSION_EXTENSION_NOT_ALLOWED",
            )
        self._desk.network.extend(name, seconds)
        self._desk.records[name]["duration"] += seconds
        return Reply(200, self._info(name))

    def _of_device(self, body: dict[str, Any]) -> Reply:
        device = body.get("device")
        if device is None:
            return camara_problem(422, "the device is needed", "MISSING_IDENTIFIER")
        records = self._desk.records
        found = [self._info(name) for name, item in records.items() if item["device"] == device]
        return Reply(200, found)

    def _info(self, name: str) -> dict[str, Any]:
        body = self._desk.records[name]
        info: dict[str, Any] = {key: body[key] for key in _ASKED if key in body}
        info["sessionId"] = name
        bearer = self._desk.network.bearers.get(name)
        if bearer is None:
            return info | {
                "qosStatus": "UNAVAILABLE",
                "statusInfo": self._ended.get(name, "NETWORK_TERMINATED"),
            }
        if bearer.state is BearerState.SETTING_UP:
            return info | {"qosStatus": "REQUESTED"}
        return info | {"qosStatus": "AVAILABLE"} | self._times(bearer)

    def _times(self, bearer: Bearer) -> dict[str, str]:
        now, now_s = datetime.now(UTC), self._desk.now_s()
        begun_s = now_s if bearer.begun_s is None else bearer.begun_s
        moments = {"startedAt": begun_s, "expiresAt": bearer.expires_s}
        return {
            name: (now + timedelta(seconds=moment - now_s)).strftime("%Y-%m-%dT%H:%M:%SZ")
            for name, moment in moments.items()
        }

    def forget(self, name: str) -> None:
        """A session is gone."""
        self._desk.records.pop(name, None)
        self._ended.pop(name, None)
        if name in self._desk.network.bearers:
            self._desk.network.end(name)

    def told(self, event: BearerEvent) -> Outgoing | None:
        """The notification of an event; None if it is of no session here, or nobody wants it."""
        name = event.bearer.id
        body = self._desk.records.get(name)
        if body is None:
            return None
        data: dict[str, Any] = {"sessionId": name, "qosStatus": "AVAILABLE"}
        if event.bearer.state is not BearerState.ACTIVE:
            is_expired = event.reason == "expired"
            reason = "DURATION_EXPIRED" if is_expired else "NETWORK_TERMINATED"
            data |= {"qosStatus": "UNAVAILABLE", "statusInfo": reason}
            self._ended[name] = reason
            if name in self._desk.network.bearers:
                # A profile is given or it is not: there is no less of it.
                self._desk.network.end(name)
        if "sink" not in body:
            return None
        cloud_event = {
            "id": str(uuid.uuid4()),
            "source": f"{self._desk.root()}{_ROOT}/sessions/{name}",
            "specversion": "1.0",
            "type": "org.camaraproject.quality-on-demand.v1.qos-status-changed",
            "time": stamp(),
            "datacontenttype": "application/json",
            "data": data,
        }
        token = body.get("sinkCredential", {}).get("accessToken", "")
        return Outgoing(body["sink"], cloud_event, token)
