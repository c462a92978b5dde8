"""The objects of one board: what it created, and which topic each reader and writer means."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from simple_ros_firmware_bridge.xrce.creation import Creation, ObjectId
from simple_ros_firmware_bridge.xrce.events import Endpoint
from simple_ros_firmware_bridge.xrce.wire import KEYLESS_FROM, Kind, Status

__all__ = ["Identity", "Objects", "Profile", "ReadRequest"]

_ENDPOINTS = (Kind.DATAWRITER, Kind.DATAREADER)
_SERVICES = (Kind.REQUESTER, Kind.REPLIER)


@dataclass(frozen=True)
class Identity:
    """Who a session is with.

    Attributes:
        session_id: Its number; below 128 headers carry the key.
        key: Client key, 4 bytes.
        mtu: Longest message the board takes, header included.
    """

    session_id: int
    key: bytes
    mtu: int

    @property
    def is_keyed(self) -> bool:
        """Whether headers carry the key."""
        return self.session_id < KEYLESS_FROM


@dataclass(frozen=True)
class Profile:
    """What a name of REF stands for.

    Attributes:
        topic: ``rt/odom``.
        type_name: ``nav_msgs::msg::dds_::Odometry_``.
    """

    topic: str
    type_name: str


@dataclass
class ReadRequest:
    """What a board wants of a reader.

    Attributes:
        request_id: Goes into every DATA.
        stream: Where it wants them.
        remaining: How many more; None is any number.
    """

    request_id: bytes
    stream: int
    remaining: int | None


@dataclass
class Objects:
    """What there is.

    Attributes:
        knows_type: Whether samples of a type can be carried.
        profiles: By the first part of a name of REF (``odom`` of ``odom__dw``).
        created: By id.
        reads: By reader.
    """

    knows_type: Callable[[str], bool]
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    created: dict[ObjectId, Creation] = field(default_factory=dict)
    reads: dict[ObjectId, ReadRequest] = field(default_factory=dict)

    def create(self, wanted: Creation) -> tuple[Status, str]:
        """Make an object; gives the status, and if it was refused the reason in words.

        One that exists is replaced: boards set both REUSE and REPLACE.
        """
        if wanted.kind in _SERVICES:
            for name in (wanted.type_name, wanted.reply_type):
                if not self.knows_type(name):
                    return Status.DDS_ERROR, f"service {wanted.name!r}: type {name!r} is not known"
        if wanted.kind in _ENDPOINTS:
            if wanted.topic is not None and wanted.topic not in self.created:
                return Status.UNKNOWN_REFERENCE, f"topic {wanted.topic!r} was never created"
            endpoint = self._meant_by(wanted)
            if not endpoint.topic:
                return Status.DDS_ERROR, f"nothing says what profile {wanted.reference!r} is"
            if not self.knows_type(endpoint.type_name):
                return Status.DDS_ERROR, (
                    f"topic {endpoint.topic!r}: type {endpoint.type_name!r} is not known"
                )
        self.created[wanted.object_id] = wanted
        return Status.OK, ""

    def delete(self, object_id: ObjectId) -> Status:
        """Remove an object."""
        self.reads.pop(object_id, None)
        gone = self.created.pop(object_id, None)
        return Status.OK if gone is not None else Status.UNKNOWN_REFERENCE

    def endpoint(self, object_id: ObjectId) -> Endpoint | None:
        """The reader, writer, requester or replier of that id."""
        found = self.created.get(object_id)
        if found is None or found.kind not in (*_ENDPOINTS, *_SERVICES):
            return None
        return self._meant_by(found)

    def endpoints(self, kind: Kind) -> list[Endpoint]:
        """All of a kind."""
        return [self._meant_by(item) for item in self.created.values() if item.kind == kind]

    def _meant_by(self, item: Creation) -> Endpoint:
        topic = self.created.get(item.topic) if item.topic is not None else None
        source = topic or item
        name, type_name = source.name, source.type_name
        reference = source.reference or item.reference
        if reference and (profile := self.profiles.get(reference.partition("__")[0])):
            name, type_name = profile.topic, profile.type_name
        return Endpoint(
            item.object_id, name, type_name, item.reliable, item.transient, item.reply_type
        )
