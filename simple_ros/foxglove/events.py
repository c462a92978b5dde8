"""What a client did, as values; see `session`. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from simple_ros.foxglove.frames import Service
from simple_ros.foxglove.requests import ClientChannel, PlaybackControl

__all__ = [
    "AssetWanted",
    "Called",
    "ChannelClosed",
    "ChannelOpened",
    "ChannelUnwanted",
    "ChannelWanted",
    "Event",
    "GraphWanted",
    "ParametersSet",
    "ParametersWanted",
    "PlaybackWanted",
    "Published",
]


@dataclass(frozen=True, slots=True)
class ChannelWanted:
    """The client subscribed to a channel, to which it was not subscribed."""

    channel_id: int
    subscription_id: int


@dataclass(frozen=True, slots=True)
class ChannelUnwanted:
    """The client is no longer subscribed to a channel."""

    channel_id: int


@dataclass(frozen=True, slots=True)
class ChannelOpened:
    """The client is going to publish."""

    channel: ClientChannel


@dataclass(frozen=True, slots=True)
class ChannelClosed:
    """The client publishes no more on this channel."""

    channel: ClientChannel


@dataclass(frozen=True, slots=True)
class Published:
    """The client published a message."""

    channel: ClientChannel
    payload: bytes


@dataclass(frozen=True, slots=True)
class Called:
    """The client calls a service; `Session.answer` or `Session.fail` are due, once."""

    service: Service
    call_id: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class AssetWanted:
    """The client asks for a file; `Session.send_asset` or `Session.refuse_asset` are due, once."""

    uri: str
    request_id: int


@dataclass(frozen=True, slots=True)
class ParametersWanted:
    """The client asks for parameters; none named means all."""

    names: tuple[str, ...]
    id: str | None


@dataclass(frozen=True, slots=True)
class ParametersSet:
    """The client sets parameters, given as they came."""

    parameters: tuple[Mapping[str, Any], ...]
    id: str | None


@dataclass(frozen=True, slots=True)
class GraphWanted:
    """The client wants to be told the whole graph, and then its changes."""


@dataclass(frozen=True, slots=True)
class PlaybackWanted:
    """The client controls playback."""

    control: PlaybackControl


Event: TypeAlias = (
    ChannelWanted
    | ChannelUnwanted
    | ChannelOpened
    | ChannelClosed
    | Published
    | Called
    | AssetWanted
    | ParametersWanted
    | ParametersSet
    | GraphWanted
    | PlaybackWanted
)
