"""What can be wrong with a request of a client, or with how the bridge is set up."""

from __future__ import annotations

from simple_ros.errors import SimpleRosError

__all__ = [
    "AssetRefused",
    "CannotListen",
    "InvalidRequest",
    "PublishRefused",
    "one_line",
    "shortened",
]

_MOST_SAID = 1000


def shortened(text: str) -> str:
    """A text for people that may hold what a client sent: of a very long one, beginning and end."""
    if len(text) <= _MOST_SAID:
        return text
    half = _MOST_SAID // 2
    return f"{text[:half]} ... {text[-half:]}"


def one_line(error: Exception) -> str:
    """What an error says, without the lines that only help in a terminal (a caret, say)."""
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(":") if lines else type(error).__name__


class InvalidRequest(SimpleRosError, ValueError):
    """A frame of a client makes no sense; the message says why."""


class PublishRefused(SimpleRosError, ValueError):
    """What a client wants to publish cannot be published; the message says why."""


class AssetRefused(SimpleRosError, LookupError):
    """An asset is not served.

    Attributes:
        uri: What was asked for.
        reason: Why not.
    """

    def __init__(self, uri: str, reason: str) -> None:
        self.uri = uri
        self.reason = reason
        super().__init__(f"asset {uri!r}: {reason}")


class CannotListen(SimpleRosError, OSError):
    """The address to listen on, or the TLS certificate, cannot be used; the message says why."""
