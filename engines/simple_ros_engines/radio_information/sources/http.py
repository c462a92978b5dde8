"""Asking a server over HTTP, without blocking the engine."""

from __future__ import annotations

import asyncio
import base64
import http.client
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Mapping

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.sources.base import SourceDown

__all__ = ["HttpServer", "basic_authorization"]

_TIMEOUT_S = 5.0
_MAX_ANSWER = 16 * 1024 * 1024


class HttpServer:
    """A server that is asked.

    Args:
        url: Of the server, ``http://`` or ``https://``.
        headers: Sent with every question.

    Raises:
        ConfigError: The URL is of another kind.
    """

    def __init__(self, url: str, headers: Mapping[str, str]) -> None:
        if not url.startswith(("http://", "https://")):
            raise ConfigError(f"url {url!r} is neither http:// nor https://")
        self._url = url.rstrip("/")
        self._headers = dict(headers)

    async def ask(
        self, path: str, query: Mapping[str, str] | None = None, body: bytes | None = None
    ) -> str:
        """The answer to a question: POST with a body, GET without.

        Raises:
            SourceDown: It does not answer within 5 s, or refuses.
        """
        target = f"{self._url}{path}"
        if query:
            target = f"{target}?{urllib.parse.urlencode(query)}"
        method = "GET" if body is None else "POST"
        request = urllib.request.Request(target, body, self._headers, method=method)  # noqa: S310
        return await asyncio.to_thread(self._ask, request)

    def _ask(self, request: urllib.request.Request) -> str:
        try:
            with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:  # noqa: S310
                data: bytes = answer.read(_MAX_ANSWER)
        except urllib.error.HTTPError as error:
            with error:
                told = error.read(500).decode("utf-8", "replace")
            raise SourceDown(f"{self._url} refuses the query ({error.code}): {told}") from error
        except (OSError, http.client.HTTPException) as error:
            told = str(error) or type(error).__name__
            raise SourceDown(f"{self._url} does not answer: {told}") from error
        return data.decode("utf-8", "replace")


def basic_authorization(user: str, password: str) -> str:
    """The header of RFC 7617."""
    return f"Basic {base64.b64encode(f'{user}:{password}'.encode()).decode()}"
