"""What the mock's interfaces share: its state, problems as each of them tells them, tokens."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any
from urllib.parse import parse_qs

from simple_ros_engines.network_exposure.exposure import schemas
from simple_ros_engines.network_exposure.exposure.schema import Schema, problems
from simple_ros_engines.network_exposure.exposure.web import Reply, json_of
from simple_ros_engines.network_exposure.mock.core import Admission, MockNetwork
from simple_ros_engines.store.http import Request

__all__ = ["BadBody", "Desk", "Outgoing", "TokenDesk", "body_of", "camara_problem", "problem"]


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A notification to send.

    Attributes:
        url: Where to.
        data: Its JSON.
        token: To send with it; empty for none.
    """

    url: str
    data: Any
    token: str = ""


@dataclass(slots=True)
class Desk:
    """One interface's view of the network.

    Attributes:
        network: Shared by all interfaces.
        root: URL of the server, for the locations it hands out.
        now_s: The clock of the network.
        records: What was asked, by its id.
    """

    network: MockNetwork
    root: Callable[[], str]
    now_s: Callable[[], float]
    records: dict[str, dict[str, Any]] = field(default_factory=dict)


class BadBody(ValueError):
    """What was sent is not what the interface takes."""


def body_of(request: Request, schema: Schema) -> Any:
    """The JSON of a request.

    Raises:
        BadBody: It has none, or it is not valid.
    """
    try:
        data = json_of(request)
    except ValueError as error:
        raise BadBody(f"no JSON: {error}") from error
    wrong = problems(data, schema)
    if wrong:
        raise BadBody("; ".join(wrong[:5]))
    return data


def problem(status: int, detail: str, cause: str = "") -> Reply:
    """As 3GPP tells it (RFC 7807)."""
    data = {"status": status, "title": "the mock network refuses", "detail": detail}
    if cause:
        data["cause"] = cause
    return Reply(status, data, content_type="application/problem+json")


_CODES = {
    400: "INVALID_ARGUMENT",
    401: "UNAUTHENTICATED",
    403: "PERMISSION_DENIED",
    404: "NOT_FOUND",
    405: "METHOD_NOT_ALLOWED",
    409: "CONFLICT",
    422: "SERVICE_NOT_APPLICABLE",
    429: "TOO_MANY_REQUESTS",
    500: "INTERNAL",
    503: "UNAVAILABLE",
}


def camara_problem(status: int, message: str, code: str = "") -> Reply:
    """As CAMARA tells it."""
    return Reply(
        status,
        {"status": status, "code": code or _CODES.get(status, "UNKNOWN"), "message": message},
    )


def refusal(admission: Admission) -> Reply:
    """Why a bearer is not admitted, for 3GPP."""
    cause = "REQUESTED_SERVICE_TEMPORARILY_NOT_AUTHORIZED"
    return problem(403, admission.value, cause)


class TokenDesk:
    """OAuth2 client credentials.

    Args:
        client_id: Who may come; empty: everybody, without a token.
        client_secret: With what.
        lifetime_s: Of a token.
    """

    def __init__(self, client_id: str, client_secret: str, lifetime_s: int = 300) -> None:
        self.issued = 0
        self._client = (client_id, client_secret)
        self._lifetime_s = lifetime_s
        self._tokens: dict[str, float] = {}

    def answer(self, request: Request, now_s: float) -> Reply:
        """A request for a token."""
        form = {
            name: values[-1] for name, values in parse_qs(request.body.decode("latin-1")).items()
        }
        if form.get("grant_type") != "client_credentials":
            return Reply(400, {"error": "unsupported_grant_type"})
        own = (form.get("client_id", ""), form.get("client_secret", ""))
        if not all(map(secrets.compare_digest, own, self._client)):
            return Reply(401, {"error": "invalid_client"})
        token = secrets.token_urlsafe(16)
        self._tokens[token] = now_s + self._lifetime_s
        self.issued += 1
        data = {"access_token": token, "token_type": "Bearer", "expires_in": self._lifetime_s}
        wrong = problems(data, schemas.TOKEN)
        assert not wrong, wrong
        return Reply(200, data)

    def admits(self, request: Request, now_s: float) -> bool:
        """Whether a request has a good token, or needs none."""
        if not self._client[0]:
            return True
        token = request.headers.get("authorization", "").removeprefix("Bearer ")
        return self._tokens.get(token, 0.0) > now_s

    def revoke_all(self) -> None:
        """No token is good any more."""
        self._tokens.clear()


def stamp() -> str:
    """Now, as RFC 3339 writes it."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
