"""What clients may send, as values.

The Foxglove WebSocket protocol: requests are JSON texts with an ``op``, or binary frames that begin
with an opcode byte; all numbers are little-endian. Pure.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from simple_ros.foxglove.errors import InvalidRequest

__all__ = [
    "AdvertiseChannels",
    "CallService",
    "ClientChannel",
    "ClientMessage",
    "FetchAsset",
    "GetParameters",
    "PlaybackControl",
    "Request",
    "SetParameters",
    "Subscribe",
    "SubscribeGraph",
    "SubscribeParameters",
    "UnadvertiseChannels",
    "Unsubscribe",
    "UnsubscribeGraph",
    "UnsubscribeParameters",
    "parsed",
]

_MESSAGE = struct.Struct("<I")
_CALL = struct.Struct("<III")
_PLAYBACK = struct.Struct("<BfBQI")
_U32_MAX = 2**32 - 1


@dataclass(frozen=True, slots=True)
class Subscribe:
    """Channels by the ids of their subscriptions, in order; ids are the client's own."""

    subscriptions: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Unsubscribe:
    """Subscriptions to end."""

    subscription_ids: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ClientChannel:
    """A channel on which a client publishes.

    Attributes:
        id: Chosen by the client.
        topic: As the client spells it.
        encoding: Of its messages.
        schema_name: Type of its messages, in whatever spelling; may be empty.
    """

    id: int
    topic: str
    encoding: str
    schema_name: str


@dataclass(frozen=True, slots=True)
class AdvertiseChannels:
    """A client is going to publish."""

    channels: tuple[ClientChannel, ...]


@dataclass(frozen=True, slots=True)
class UnadvertiseChannels:
    """A client publishes no more."""

    channel_ids: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ClientMessage:
    """A message of a client."""

    channel_id: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class CallService:
    """A call of a service; the client numbers its calls."""

    service_id: int
    call_id: int
    encoding: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class GetParameters:
    """Parameters to tell; no names for all."""

    names: tuple[str, ...]
    id: str | None


@dataclass(frozen=True, slots=True)
class SetParameters:
    """Parameters to set, as they came: dicts with ``name``, ``value`` and ``type``."""

    parameters: tuple[Mapping[str, Any], ...]
    id: str | None


@dataclass(frozen=True, slots=True)
class SubscribeParameters:
    """Parameters whose changes to tell; no names for all."""

    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class UnsubscribeParameters:
    """Parameters whose changes not to tell any more; no names for all."""

    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SubscribeGraph:
    """Tell who publishes and subscribes what."""


@dataclass(frozen=True, slots=True)
class UnsubscribeGraph:
    """Do not tell it any more."""


@dataclass(frozen=True, slots=True)
class FetchAsset:
    """A file to send."""

    uri: str
    request_id: int


@dataclass(frozen=True, slots=True)
class PlaybackControl:
    """Play or pause, how fast, and where to go on (ns since 1970), if anywhere else."""

    is_play: bool
    speed: float
    seek_ns: int | None
    request_id: str


Request: TypeAlias = (
    Subscribe
    | Unsubscribe
    | AdvertiseChannels
    | UnadvertiseChannels
    | ClientMessage
    | CallService
    | GetParameters
    | SetParameters
    | SubscribeParameters
    | UnsubscribeParameters
    | SubscribeGraph
    | UnsubscribeGraph
    | FetchAsset
    | PlaybackControl
)


def parsed(frame: str | bytes) -> Request | None:
    """The request in a frame; None for an empty binary frame, which means nothing.

    Raises:
        InvalidRequest: There is none in it.
    """
    return _text(frame) if isinstance(frame, str) else _binary(frame)


# -- text ------------------------------------------------------------------------------------------


def _text(frame: str) -> Request:
    try:
        document = json.loads(frame)
    except (ValueError, RecursionError) as error:
        raise InvalidRequest(f"no JSON ({error})") from None
    if not isinstance(document, dict):
        raise InvalidRequest("no JSON object")
    op = document.get("op")
    make = _OPS.get(op) if isinstance(op, str) else None
    if make is None:
        raise InvalidRequest(f"unknown op {op!r}")
    return make(document)


def _items(document: Mapping[str, Any], name: str) -> list[Any]:
    items = document.get(name)
    if not isinstance(items, list):
        raise InvalidRequest(f"{document['op']} needs a list {name!r}")
    return items


def _objects(document: Mapping[str, Any], name: str) -> list[dict[str, Any]]:
    items = _items(document, name)
    if not all(isinstance(item, dict) for item in items):
        raise InvalidRequest(f"{document['op']} needs objects in {name!r}")
    return items


def _names(document: Mapping[str, Any]) -> tuple[str, ...]:
    names = _items(document, "parameterNames")
    if not all(isinstance(name, str) for name in names):
        raise InvalidRequest(f"{document['op']} needs texts in 'parameterNames'")
    return tuple(map(_unicode, names))


def _number(value: Any, what: str) -> int:
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= _U32_MAX:
        raise InvalidRequest(f"{what} must be an integer of 32 bits without sign, not {value!r}")
    return value


def _numbers(document: Mapping[str, Any], name: str) -> tuple[int, ...]:
    return tuple(_number(item, name) for item in _items(document, name))


def _string(document: Mapping[str, Any], name: str, default: str | None = None) -> str:
    value = document.get(name, default)
    if value is None and default is not None:
        value = default
    if not isinstance(value, str):
        raise InvalidRequest(f"{name!r} must be a text, not {value!r}")
    return _unicode(value)


def _unicode(text: str) -> str:
    """A text that can be written as UTF-8: JSON can escape halves of characters, too."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise InvalidRequest(f"{text!r} is no valid Unicode text") from None
    return text


def _id(document: Mapping[str, Any]) -> str | None:
    return None if document.get("id") is None else _string(document, "id")


def _subscribe(document: Mapping[str, Any]) -> Subscribe:
    return Subscribe(
        tuple(
            (_number(item.get("id"), "id"), _number(item.get("channelId"), "channelId"))
            for item in _objects(document, "subscriptions")
        )
    )


def _channel(item: Mapping[str, Any]) -> ClientChannel:
    return ClientChannel(
        _number(item.get("id"), "id"),
        _string(item, "topic"),
        _string(item, "encoding"),
        _string(item, "schemaName", ""),
    )


def _parameter(item: Mapping[str, Any]) -> Mapping[str, Any]:
    _string(item, "name")
    _string(item, "type", "")
    return item


_OPS: dict[str, Callable[[Mapping[str, Any]], Request]] = {
    "subscribe": _subscribe,
    "unsubscribe": lambda document: Unsubscribe(_numbers(document, "subscriptionIds")),
    "advertise": lambda document: AdvertiseChannels(
        tuple(map(_channel, _objects(document, "channels")))
    ),
    "unadvertise": lambda document: UnadvertiseChannels(_numbers(document, "channelIds")),
    "getParameters": lambda document: GetParameters(_names(document), _id(document)),
    "setParameters": lambda document: SetParameters(
        tuple(map(_parameter, _objects(document, "parameters"))), _id(document)
    ),
    "subscribeParameterUpdates": lambda document: SubscribeParameters(_names(document)),
    "unsubscribeParameterUpdates": lambda document: UnsubscribeParameters(_names(document)),
    "subscribeConnectionGraph": lambda _: SubscribeGraph(),
    "unsubscribeConnectionGraph": lambda _: UnsubscribeGraph(),
    "fetchAsset": lambda document: FetchAsset(
        _string(document, "uri"), _number(document.get("requestId"), "requestId")
    ),
}


# -- binary ----------------------------------------------------------------------------------------


def _binary(frame: bytes) -> Request | None:
    if not frame:
        return None
    make = _OPCODES.get(frame[0])
    if make is None:
        raise InvalidRequest(f"unknown opcode {frame[0]}")
    try:
        return make(frame)
    except struct.error:
        raise InvalidRequest(f"{len(frame)} bytes are too few for opcode {frame[0]}") from None


def _message(frame: bytes) -> ClientMessage:
    (channel,) = _MESSAGE.unpack_from(frame, 1)
    return ClientMessage(channel, frame[1 + _MESSAGE.size :])


def _counted_text(frame: bytes, begin: int, length: int, what: str) -> str:
    data = frame[begin : begin + length]
    if len(data) < length:
        raise InvalidRequest(f"{what} breaks off")
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise InvalidRequest(f"{what} is no UTF-8") from None


def _call(frame: bytes) -> CallService:
    service, call, length = _CALL.unpack_from(frame, 1)
    begin = 1 + _CALL.size
    encoding = _counted_text(frame, begin, length, "the encoding")
    return CallService(service, call, encoding, frame[begin + length :])


def _playback(frame: bytes) -> PlaybackControl:
    command, speed, had_seek, seek_ns, length = _PLAYBACK.unpack_from(frame, 1)
    if command > 1:
        raise InvalidRequest(f"unknown playback command {command}")
    request = _counted_text(frame, 1 + _PLAYBACK.size, length, "the request id")
    return PlaybackControl(command == 0, speed, seek_ns if had_seek else None, request)


_OPCODES: dict[int, Callable[[bytes], Request]] = {1: _message, 2: _call, 3: _playback}
