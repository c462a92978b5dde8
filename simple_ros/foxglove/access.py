"""Who may connect, and what is shown to them. Pure."""

from __future__ import annotations

import hmac
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Protocol
from urllib.parse import parse_qs, urlsplit

from simple_ros.bag.plan import TopicSelection
from simple_ros.errors import ConfigError
from simple_ros.foxglove.frames import CAPABILITIES, SUBPROTOCOLS

__all__ = ["APP_ORIGINS", "Access", "Headers", "Refusal"]

APP_ORIGINS = frozenset(
    {
        "https://app.foxglove.dev",
        "https://studio.foxglove.dev",
        "file://",  # the desktop apps; no web page has this origin
    }
)
_CHANGING = frozenset({"clientPublish", "services"})
_EVERYTHING = TopicSelection(every=True)
_LOCAL_HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})


class Headers(Protocol):
    """HTTP headers, as WebSocket libraries give them."""

    def get_all(self, key: str) -> list[str]:
        """All values of a header, whatever the case of its name."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a connection is not accepted."""

    status: HTTPStatus
    reason: str


@dataclass(frozen=True, slots=True)
class Access:
    """What is allowed.

    Attributes:
        selection: The topics that clients see and may publish.
        client_topics: Those of them that they may publish.
        services: The services that they see and may call.
        parameters: The parameters that they see and may set.
        withheld: Capabilities that are not offered at all.
        read_only: Whether clients may neither publish nor call services nor set parameters.
        token: What clients must know; None for nothing.
        origins: Web pages that may connect beside those of this host and `APP_ORIGINS`, as
            ``https://host:port``; ``*`` allows all.
    """

    selection: TopicSelection = field(default=_EVERYTHING)
    client_topics: TopicSelection = field(default=_EVERYTHING)
    services: TopicSelection = field(default=_EVERYTHING)
    parameters: TopicSelection = field(default=_EVERYTHING)
    withheld: frozenset[str] = frozenset()
    read_only: bool = False
    token: str | None = None
    origins: tuple[str, ...] = ()

    @classmethod
    def made(
        cls,
        topics: str | None = None,
        exclude: str | None = None,
        *,
        client_topics: str | None = None,
        services: str | None = None,
        parameters: str | None = None,
        without: Collection[str] = (),
        read_only: bool = False,
        token: str | None = None,
        origins: Sequence[str] = (),
    ) -> Access:
        """Rules as a user writes them.

        Args:
            topics: Regular expression of the topics that are shown; None for all.
            exclude: Regular expression of topics that are not.
            client_topics: Regular expression of the topics that clients may publish; None for all
                that are shown.
            services: Regular expression of the services that are shown; None for all.
            parameters: Regular expression of the parameters that are shown; None for all.
            without: Capabilities that are withheld.
            read_only: As above.
            token: As above; empty is None.
            origins: As above.

        Raises:
            ConfigError: A pattern is no regular expression, there is no such capability, or an origin
                is none.
        """
        unknown = sorted(set(without) - CAPABILITIES)
        if unknown:
            known = ", ".join(sorted(CAPABILITIES))
            raise ConfigError(f"there is no capability {unknown[0]!r}; there are {known}")
        for origin in origins:
            if origin != "*" and "://" not in origin:
                raise ConfigError(f"an origin is written http://host:port, not {origin!r}")
        return cls(
            TopicSelection.made(every=topics is None, pattern=topics, exclude=exclude),
            _fitting(client_topics),
            _fitting(services),
            _fitting(parameters),
            _with_what_needs_it(without),
            read_only,
            token or None,
            tuple(origin.rstrip("/").lower() for origin in origins),
        )

    @property
    def hidden(self) -> frozenset[str]:
        """Capabilities that no client has."""
        return self.withheld | _CHANGING if self.read_only else self.withheld

    def wants(self, topic: str) -> bool:
        """Whether a topic is shown."""
        return self.selection.wants(topic)

    def lets_publish(self, topic: str) -> bool:
        """Whether clients may publish a topic."""
        return self.selection.wants(topic) and self.client_topics.wants(topic)

    def refusal(self, path: str, headers: Headers) -> Refusal | None:
        """Why a request to connect is refused; None if it is not."""
        for origin in headers.get_all("Origin"):
            if not self._is_allowed(origin):
                reason = f"pages of {origin} may not connect; --allow-origin {origin} allows it"
                return Refusal(HTTPStatus.FORBIDDEN, reason)
        if self.token is not None and not self._knows_token(path, headers, self.token):
            reason = "a token is needed: 'Authorization: Bearer TOKEN', or ?token=TOKEN in the URL"
            return Refusal(HTTPStatus.UNAUTHORIZED, reason)
        if chosen_subprotocol(headers) is None:
            spoken = " and ".join(SUBPROTOCOLS)
            return Refusal(
                HTTPStatus.BAD_REQUEST,
                f"the header Sec-WebSocket-Protocol names no subprotocol of this server: {spoken}",
            )
        return None

    def _is_allowed(self, origin: str) -> bool:
        plain = origin.rstrip("/").lower() if origin != "file://" else origin
        if plain in APP_ORIGINS or plain in self.origins or "*" in self.origins:
            return True
        try:
            return urlsplit(plain).hostname in _LOCAL_HOSTS
        except ValueError:
            return False

    @staticmethod
    def _knows_token(path: str, headers: Headers, token: str) -> bool:
        given = [
            value.partition(" ")[2].strip()
            for value in headers.get_all("Authorization")
            if value.lower().startswith("bearer ")
        ]
        query = urlsplit(path).query
        # Tokens in base64 hold "+", which means a space in forms, and people write it as it is.
        for text in (query, query.replace("+", "%2B")):
            given += parse_qs(text).get("token", [])
        wanted = token.encode("utf-8", "replace")
        return any(hmac.compare_digest(text.encode("utf-8", "replace"), wanted) for text in given)


def _with_what_needs_it(capabilities: Collection[str]) -> frozenset[str]:
    needing = ("parametersSubscribe",) if "parameters" in capabilities else ()
    return frozenset((*capabilities, *needing))


def _fitting(pattern: str | None) -> TopicSelection:
    """What fits a regular expression; everything for None."""
    return TopicSelection.made(every=pattern is None, pattern=pattern)


def chosen_subprotocol(headers: Headers) -> str | None:
    """The first of `SUBPROTOCOLS` that a client offers; None if it offers none of them."""
    offered = {
        part.strip()
        for value in headers.get_all("Sec-WebSocket-Protocol")
        for part in value.split(",")
    }
    return next((name for name in SUBPROTOCOLS if name in offered), None)
