"""One HTTP exchange, off the event loop: the seam between the clients and the network.

By the standard library. A request goes out on a connection of its own: an interface is asked a few times a minute.
"""

from __future__ import annotations

import asyncio
import http.client
import ssl
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.exposure.model import ApiMalformed, ApiUnavailable

__all__ = ["HttpRequest", "HttpResponse", "HttpTransport", "StandardTransport", "client_tls"]

_MAX_ANSWER = 4 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class HttpRequest:
    """What is asked.

    Attributes:
        method: Such as ``POST``.
        url: With scheme and host.
        headers: By name.
        body: Empty for none.
    """

    method: str
    url: str
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes = b""


@dataclass(frozen=True, slots=True)
class HttpResponse:
    """What was answered.

    Attributes:
        status: Such as 201.
        headers: By name in small letters.
        body: As it came.
    """

    status: int
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes = b""


class HttpTransport(ABC):
    """Sends requests."""

    @abstractmethod
    async def send(self, request: HttpRequest, timeout_s: float) -> HttpResponse:
        """The answer to one request.

        Raises:
            ApiUnavailable: None came, or not in time.
            ApiMalformed: What came is no HTTP.
        """


def client_tls(ca_file: str = "", cert_file: str = "", key_file: str = "") -> ssl.SSLContext:
    """How servers are judged, and who we are.

    Args:
        ca_file: Certificates to trust; empty: those of the system.
        cert_file: Our own certificate, for networks that ask for one.
        key_file: Its key; empty if it is in the same file.

    Raises:
        ConfigError: A file cannot be read, or is none of its kind.
    """
    for name in filter(None, (ca_file, cert_file, key_file)):
        if not Path(name).is_file():
            raise ConfigError(f"TLS: there is no file {name}")
    try:
        context = ssl.create_default_context(cafile=ca_file or None)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        if cert_file:
            context.load_cert_chain(cert_file, key_file or None)
    except (ssl.SSLError, OSError) as error:
        raise ConfigError(f"TLS: {ca_file} {cert_file} {key_file}: {error}") from error
    return context


class StandardTransport(HttpTransport):
    """By ``http.client``, in a thread.

    Args:
        tls: For ``https://``; None trusts what the system trusts.
    """

    def __init__(self, tls: ssl.SSLContext | None = None) -> None:
        self._tls = tls

    async def send(self, request: HttpRequest, timeout_s: float) -> HttpResponse:
        """The answer to one request."""
        try:
            async with asyncio.timeout(timeout_s):
                return await asyncio.to_thread(self._send, request, timeout_s)
        except TimeoutError as error:
            host = urlsplit(request.url).netloc
            raise ApiUnavailable(f"{host} does not answer within {timeout_s:g} s") from error

    def _send(self, request: HttpRequest, timeout_s: float) -> HttpResponse:
        parts = urlsplit(request.url)
        connection = self._connection(parts.scheme, parts.hostname or "", parts.port, timeout_s)
        target = parts.path or "/"
        if parts.query:
            target += f"?{parts.query}"
        try:
            connection.request(
                request.method,
                target,
                request.body or None,
                {**request.headers, "Connection": "close"},
            )
            with connection.getresponse() as answer:
                body = answer.read(_MAX_ANSWER + 1)
                headers = {name.lower(): value for name, value in answer.getheaders()}
                status = answer.status
        except OSError as error:
            raise ApiUnavailable(f"{parts.netloc} cannot be reached: {error}") from error
        except http.client.HTTPException as error:
            what = f"{parts.netloc} answers {request.method} {parts.path} with no HTTP"
            raise ApiMalformed(f"{what}: {error!r}") from error
        finally:
            connection.close()
        if len(body) > _MAX_ANSWER:
            raise ApiMalformed(f"{parts.netloc}: the answer is over {_MAX_ANSWER} bytes")
        return HttpResponse(status, headers, body)

    def _connection(
        self, scheme: str, host: str, port: int | None, timeout_s: float
    ) -> http.client.HTTPConnection:
        if scheme == "https":
            tls = self._tls or ssl.create_default_context()
            return http.client.HTTPSConnection(host, port, timeout=timeout_s, context=tls)
        return http.client.HTTPConnection(host, port, timeout=timeout_s)
