"""What the server sends, as text and binary frames. Pure.

The Foxglove WebSocket protocol: JSON texts with an ``op``, and binary frames that begin with an opcode
byte; all numbers are little-endian.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

__all__ = [
    "CAPABILITIES",
    "SUBPROTOCOLS",
    "Channel",
    "Level",
    "PlaybackState",
    "Playing",
    "Schema",
    "Service",
    "advertise",
    "advertise_services",
    "asset",
    "asset_error",
    "graph_update",
    "message_parts",
    "parameter_values",
    "playback_state",
    "remove_status",
    "server_info",
    "service_failure",
    "service_response",
    "status",
    "time_frame",
    "unadvertise",
    "unadvertise_services",
]

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""What is spoken, most wanted first; the bytes are the same."""

CAPABILITIES = frozenset(
    {
        "clientPublish",
        "parameters",
        "parametersSubscribe",
        "time",
        "services",
        "connectionGraph",
        "assets",
        "playbackControl",
    }
)

_BATCH = 100
_MESSAGE_DATA, _TIME, _SERVICE_RESPONSE, _ASSET, _PLAYBACK = 1, 2, 3, 4, 5
_TIME_FRAME = struct.Struct("<BQ")
_RESPONSE = struct.Struct("<BIII")
_ASSET_HEAD = struct.Struct("<BIBI")
_PLAYBACK_HEAD = struct.Struct("<BBQfBI")
_STAMP = struct.Struct("<Q")
_MESSAGE_HEAD_BYTES = 13
_FINAL_BINARY = 0x82


class Level(IntEnum):
    """How bad a status is."""

    INFO = 0
    WARNING = 1
    ERROR = 2


@dataclass(frozen=True, slots=True)
class Channel:
    """A stream of messages that is offered.

    Attributes:
        id: Its number, never used again for another one.
        topic: Name with a leading slash.
        schema_name: Type of its messages.
        schema: Definition of the type, encoded as ``schema_encoding`` wants it.
        encoding: Of its messages.
        schema_encoding: ``"protobuf"``: base64 of a ``FileDescriptorSet``; ``"jsonschema"``: JSON.
        metadata: Further facts, for clients of ``foxglove.sdk.v1``.
        recorded_as: Type and ``FileDescriptorSet`` under which recordings keep its messages; None for
            those that clients see.
    """

    id: int
    topic: str
    schema_name: str
    schema: str
    encoding: str = "protobuf"
    schema_encoding: str = "protobuf"
    metadata: Mapping[str, str] = field(default_factory=dict)
    recorded_as: tuple[str, bytes] | None = None


@dataclass(frozen=True, slots=True)
class Schema:
    """Type of a request or a response, and its JSON schema."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Service:
    """A service that is offered, to be called in JSON."""

    id: int
    name: str
    type_name: str
    request: Schema
    response: Schema


class Playing(IntEnum):
    """What playback does."""

    PLAYING = 0
    PAUSED = 1
    BUFFERING = 2
    ENDED = 3


@dataclass(frozen=True, slots=True)
class PlaybackState:
    """Where playback is, in ns since 1970, and how fast it goes."""

    status: Playing
    now_ns: int
    speed: float


def _json(op: str, **fields: Any) -> str:
    return json.dumps({"op": op, **fields}, separators=(",", ":"))


def server_info(
    name: str,
    session: str,
    capabilities: Iterable[str],
    metadata: Mapping[str, str],
    span_ns: tuple[int, int] | None = None,
) -> str:
    """The first frame; sent again with another session it makes clients forget what they showed.

    Args:
        name: Of the server.
        session: Which session this is.
        capabilities: Some of `CAPABILITIES`.
        metadata: Further facts.
        span_ns: Beginning and end of what is played, in ns since 1970.
    """
    times = (
        {}
        if span_ns is None
        else {
            key: {"sec": stamp // 10**9, "nsec": stamp % 10**9}
            for key, stamp in zip(("dataStartTime", "dataEndTime"), span_ns, strict=True)
        }
    )
    return _json(
        "serverInfo",
        name=name,
        capabilities=sorted(capabilities),
        supportedEncodings=["json", "protobuf"],
        metadata=dict(metadata),
        sessionId=session,
        **times,
    )


def status(level: Level, message: str, id: str | None = None) -> str:  # noqa: A002
    """Something to tell people; a further one with the same id replaces it."""
    return _json("status", level=int(level), message=message, **({} if id is None else {"id": id}))


def remove_status(*ids: str) -> str:
    """Statuses that no longer hold."""
    return _json("removeStatus", statusIds=list(ids))


def advertise(channels: Sequence[Channel], *, with_metadata: bool = False) -> list[str]:
    """Channels that are there now, some in each frame; no frame for none."""
    items = [_channel(channel, with_metadata=with_metadata) for channel in channels]
    return [
        _json("advertise", channels=items[begin : begin + _BATCH])
        for begin in range(0, len(items), _BATCH)
    ]


def _channel(channel: Channel, *, with_metadata: bool) -> dict[str, Any]:
    item: dict[str, Any] = {
        "id": channel.id,
        "topic": channel.topic,
        "encoding": channel.encoding,
        "schemaName": channel.schema_name,
        "schema": channel.schema,
        "schemaEncoding": channel.schema_encoding,
    }
    if with_metadata and channel.metadata:
        item["metadata"] = dict(channel.metadata)
    return item


def unadvertise(ids: Iterable[int]) -> str:
    """Channels that are no longer there."""
    return _json("unadvertise", channelIds=list(ids))


def advertise_services(services: Iterable[Service]) -> str:
    """Services that are there now."""
    return _json(
        "advertiseServices",
        services=[
            {
                "id": service.id,
                "name": service.name,
                "type": service.type_name,
                "request": _schema(service.request),
                "response": _schema(service.response),
            }
            for service in services
        ],
    )


def _schema(schema: Schema) -> dict[str, str]:
    return {
        "encoding": "json",
        "schemaName": schema.name,
        "schemaEncoding": "jsonschema",
        "schema": schema.text,
    }


def unadvertise_services(ids: Iterable[int]) -> str:
    """Services that are no longer there."""
    return _json("unadvertiseServices", serviceIds=list(ids))


def parameter_values(parameters: Iterable[Mapping[str, Any]], id: str | None = None) -> str:  # noqa: A002
    """Parameters as they are; with the id of the request that this answers."""
    return _json(
        "parameterValues", parameters=list(parameters), **({} if id is None else {"id": id})
    )


def graph_update(
    published: Mapping[str, Iterable[str]],
    subscribed: Mapping[str, Iterable[str]],
    services: Mapping[str, Iterable[str]],
    removed_topics: Iterable[str] = (),
    removed_services: Iterable[str] = (),
) -> str:
    """Who publishes, subscribes and provides what: nodes by name, replacing what was said of that name."""
    return _json(
        "connectionGraphUpdate",
        publishedTopics=[
            {"name": name, "publisherIds": list(ids)} for name, ids in published.items()
        ],
        subscribedTopics=[
            {"name": name, "subscriberIds": list(ids)} for name, ids in subscribed.items()
        ],
        advertisedServices=[
            {"name": name, "providerIds": list(ids)} for name, ids in services.items()
        ],
        removedTopics=list(removed_topics),
        removedServices=list(removed_services),
    )


def service_failure(service_id: int, call_id: int, reason: str) -> str:
    """A call that was not answered."""
    return _json("serviceCallFailure", serviceId=service_id, callId=call_id, message=reason)


def service_response(service_id: int, call_id: int, encoding: str, payload: bytes) -> bytes:
    """The answer of a service."""
    name = encoding.encode()
    return _RESPONSE.pack(_SERVICE_RESPONSE, service_id, call_id, len(name)) + name + payload


def asset(request_id: int, data: bytes) -> bytes:
    """A file that was asked for."""
    return _ASSET_HEAD.pack(_ASSET, request_id, 0, 0) + data


def asset_error(request_id: int, reason: str) -> bytes:
    """Why a file is not sent."""
    text = reason.encode("utf-8", "replace")
    return _ASSET_HEAD.pack(_ASSET, request_id, 1, len(text)) + text


def time_frame(now_ns: int) -> bytes:
    """The time of the server, in ns since 1970."""
    return _TIME_FRAME.pack(_TIME, now_ns)


def playback_state(state: PlaybackState, *, did_seek: bool = False, request_id: str = "") -> bytes:
    """Where playback is; only for clients that control it, as others do not know the frame."""
    request = request_id.encode()
    head = _PLAYBACK_HEAD.pack(
        _PLAYBACK, state.status, state.now_ns, state.speed, did_seek, len(request)
    )
    return head + request


def message_parts(stamp_ns: int, data: bytes) -> tuple[bytes, bytes, bytes]:
    """A whole WebSocket frame with a message, in parts between which 4 bytes are left out.

    RFC 6455, section 5.2: final binary frame, not masked. Framing is done here and once, not by the
    WebSocket library and for each client again.

    Returns:
        What comes before the little-endian id of the subscription, and two parts that come after it.
    """
    length = _MESSAGE_HEAD_BYTES + len(data)
    if length < 126:
        head = bytes((_FINAL_BINARY, length, _MESSAGE_DATA))
    elif length < 65536:
        head = struct.pack(">BBHB", _FINAL_BINARY, 126, length, _MESSAGE_DATA)
    else:
        head = struct.pack(">BBQB", _FINAL_BINARY, 127, length, _MESSAGE_DATA)
    return head, _STAMP.pack(stamp_ns), data
