"""Asking an interface: tokens, retries, redirects, JSON that is checked both ways."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any
from urllib.parse import urlencode, urljoin, urlsplit

from simple_ros_engines.network_exposure.exposure.http import (
    HttpRequest,
    HttpResponse,
    HttpTransport,
)
from simple_ros_engines.network_exposure.exposure.model import (
    ApiMalformed,
    ApiRefused,
    ApiUnavailable,
)
from simple_ros_engines.network_exposure.exposure.retrying import RetryPolicy, retry_after_s
from simple_ros_engines.network_exposure.exposure.schema import Schema, problems
from simple_ros_engines.network_exposure.exposure.schemas import TOKEN

__all__ = ["Answer", "ApiClient", "Credentials", "TokenSource", "checked"]

logger = logging.getLogger(__name__)

SIMULATED_HEADER = "x-simulated-network"
_MARGIN_S = 5.0
_MOST_REDIRECTS = 3
_TOLD = 400


@dataclass(frozen=True, slots=True)
class Credentials:
    """OAuth2 client credentials (RFC 6749, 4.4).

    Attributes:
        token_url: Where tokens are; empty for an interface that needs none.
        client_id: Who we are.
        client_secret: Never printed.
        scope: What for.
    """

    token_url: str = ""
    client_id: str = ""
    client_secret: str = field(default="", repr=False)
    scope: str = ""


@dataclass(frozen=True, slots=True)
class Answer:
    """A good answer.

    Attributes:
        status: 2xx.
        location: Absolute; empty without one.
        data: The JSON; None without any.
        attempts: Requests that were sent for it: those before the last may have been carried out, too.
    """

    status: int
    location: str = ""
    data: Any = None
    attempts: int = 1

    def made_at(self, what: str) -> str:
        """Where the thing is that was made.

        Raises:
            ApiMalformed: The answer does not say.
        """
        if not self.location:
            raise ApiMalformed(f"{what}: made, but the answer has no Location")
        return self.location


def checked(data: Any, schema: Schema, what: str) -> Any:
    """The same data, if it is valid.

    Raises:
        ApiMalformed: It is not.
    """
    wrong = problems(data, schema)
    if wrong:
        raise ApiMalformed(f"{what}: {'; '.join(wrong[:5])}")
    return data


class TokenSource:
    """Gets tokens, and keeps one until shortly before its end."""

    def __init__(
        self, transport: HttpTransport, credentials: Credentials, timeout_s: float
    ) -> None:
        self._transport = transport
        self._credentials = credentials
        self._timeout_s = timeout_s
        self._lock = asyncio.Lock()
        self._token = ""
        self._until_s = 0.0

    async def header(self) -> dict[str, str]:
        """What shows who we are.

        Raises:
            ExposureError: There is no token to be had.
        """
        if not self._credentials.token_url:
            return {}
        async with self._lock:
            if not self._token or time.monotonic() >= self._until_s:
                await self._fetch()
            return {"Authorization": f"Bearer {self._token}"}

    def forget(self, header: Mapping[str, str]) -> None:
        """The network does not take the token any more."""
        if header.get("Authorization") == f"Bearer {self._token}":
            self._token = ""

    async def _fetch(self) -> None:
        own = self._credentials
        form = {"grant_type": "client_credentials", "client_id": own.client_id}
        form |= {"client_secret": own.client_secret}
        if own.scope:
            form["scope"] = own.scope
        headers = {
            "Content-Type": "application/x-www-form-urlencoded",
            "Accept": "application/json",
        }
        request = HttpRequest("POST", own.token_url, headers, urlencode(form).encode())
        answer = await self._transport.send(request, self._timeout_s)
        what = f"token of {urlsplit(own.token_url).netloc}"
        if answer.status != 200:
            _refuse(answer, what)
        token = checked(_json(answer, what), TOKEN, what)
        self._token = token["access_token"]
        lifetime_s = float(token.get("expires_in", 300))
        self._until_s = time.monotonic() + max(lifetime_s / 2, lifetime_s - _MARGIN_S)


class ApiClient:
    """Asks one interface.

    Args:
        root: Its URL, to which paths are added.
        transport: Carries requests.
        credentials: Who we are.
        timeout_s: For one attempt.
        retries: When to ask again.

    Attributes:
        is_simulated: Whether an answer said that it comes from a mock.
        attempts: Requests sent, tokens not among them.
    """

    def __init__(
        self,
        root: str,
        transport: HttpTransport,
        credentials: Credentials | None = None,
        *,
        timeout_s: float = 5.0,
        retries: RetryPolicy | None = None,
    ) -> None:
        self.is_simulated = False
        self.attempts = 0
        self._root = root.rstrip("/")
        self._transport = transport
        self._tokens = TokenSource(transport, credentials or Credentials(), timeout_s)
        self._timeout_s = timeout_s
        self._retries = retries or RetryPolicy()

    def url(self, path: str) -> str:
        """A path of the interface as a URL; what is a URL already stays."""
        return path if "://" in path else f"{self._root}{path}"

    async def call(
        self,
        method: str,
        path: str,
        body: Any = None,
        *,
        sends: Schema | None = None,
        gives: Schema | None = None,
        content_type: str = "application/json",
    ) -> Answer:
        """The answer to a request.

        Args:
            method: Of HTTP.
            path: Below the interface's root, or a URL below it that the network gave.
            body: Becomes JSON; None for none.
            sends: Schema of the body.
            gives: Schema of an answer with a body.
            content_type: Of the body.

        Raises:
            ApiUnavailable: It does not answer, or says that it cannot now, however often it is asked.
            ApiRefused: It says no.
            ApiMalformed: The answer, or the body, is not what the standard says.
        """
        url = self.url(path)
        what = f"{method} {urlsplit(url).path}"
        data = b""
        headers = {"Accept": "application/json, application/problem+json"}
        if body is not None:
            data = json.dumps(checked(body, sends or {}, f"body of {what}")).encode()
            headers["Content-Type"] = content_type
        before = self.attempts
        response = await self._insist(HttpRequest(method, url, headers, data), what)
        if not 200 <= response.status < 300:
            _refuse(response, what)
        location = response.headers.get("location", "")
        location = urljoin(url, location) if location else ""
        answered = _body(response, gives, what, location)
        return Answer(response.status, location, answered, self.attempts - before)

    async def _insist(self, request: HttpRequest, what: str) -> HttpResponse:
        attempt = 0
        while True:
            attempt += 1
            status, wished_s, problem = None, None, ""
            try:
                response = await self._authorised(request)
            except ApiUnavailable as error:
                problem, wished_s = str(error), error.retry_after_s
            else:
                status = response.status
                if status < 400:
                    return response
                wished_s = retry_after_s(response.headers.get("retry-after"), datetime.now(UTC))
                problem = f"answered {status} {_reason(response)}"
            delay_s = self._retries.delay_s(attempt, status, wished_s)
            if delay_s is None:
                if status is None or status in (429, 502, 503, 504):
                    raise ApiUnavailable(f"{what}: {problem}", wished_s)
                return response
            logger.debug("%s: %s; again in %.1f s", what, problem, delay_s)
            await asyncio.sleep(delay_s)

    async def _authorised(self, request: HttpRequest) -> HttpResponse:
        """One attempt; a token that is not taken any more is replaced once."""
        token = await self._tokens.header()
        response = await self._followed(request, token)
        if response.status == 401 and token:
            self._tokens.forget(token)
            response = await self._followed(request, await self._tokens.header())
        return response

    async def _followed(self, request: HttpRequest, token: Mapping[str, str]) -> HttpResponse:
        """One exchange; 307 and 308 are followed on the same host, where the token belongs."""
        url = request.url
        for _ in range(_MOST_REDIRECTS):
            self.attempts += 1
            asked = HttpRequest(request.method, url, {**request.headers, **token}, request.body)
            response = await self._transport.send(asked, self._timeout_s)
            self.is_simulated |= SIMULATED_HEADER in response.headers
            location = response.headers.get("location", "")
            if response.status not in (307, 308) or not location:
                return response
            target = urljoin(url, location)
            if urlsplit(target)[:2] != urlsplit(url)[:2]:
                return response
            url = target
        return response


def _body(response: HttpResponse, schema: Schema | None, what: str, location: str) -> Any:
    """The JSON of a good answer; None if it has none, and needs none."""
    if response.status == 204 or not response.body:
        if schema is not None and response.status != 204:
            raise ApiMalformed(f"{what}: {response.status} without a body", location)
        return None
    try:
        answered = _json(response, what)
        return answered if schema is None else checked(answered, schema, f"answer to {what}")
    except ApiMalformed as error:
        error.location = location
        raise


def _json(response: HttpResponse, what: str) -> Any:
    try:
        return json.loads(response.body)
    except (ValueError, RecursionError) as error:
        raise ApiMalformed(f"{what}: the answer is no JSON: {error}") from error


def _reason(response: HttpResponse) -> str:
    """What a problem document (RFC 7807), CAMARA's or OAuth's error says."""
    try:
        told = json.loads(response.body)
    except (ValueError, RecursionError):
        return response.body[:_TOLD].decode("utf-8", "replace")
    if not isinstance(told, dict):
        return ""
    names = ("title", "detail", "cause", "code", "message", "error", "error_description")
    return "; ".join(str(told[name])[:_TOLD] for name in names if told.get(name))


def _refuse(response: HttpResponse, what: str) -> None:
    if response.status >= 500 or response.status == 429:
        wished_s = retry_after_s(response.headers.get("retry-after"), datetime.now(UTC))
        raise ApiUnavailable(f"{what}: answered {response.status} {_reason(response)}", wished_s)
    raise ApiRefused(what, response.status, _reason(response))
