"""Bags of ROS 1 and ROS 2 as bags of ours, for the message types that both have.

Reading them is the work of the package ``rosbags`` (extra ``rosbags``). A message is carried over field
by field, by name; the few fields that mean the same and are written otherwise are listed here. What
ROS has and we have not is left out, and told.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

from simple_ros.bag.channel_qos import metadata_of
from simple_ros.bag.chunks import Compression
from simple_ros.bag.errors import BagError, NotABag
from simple_ros.bag.writer import DEFAULT_CHUNK_BYTES, BagWriter
from simple_ros.errors import ConfigError, UnknownMessageType
from simple_ros.msg.definitions import definition_of
from simple_ros.msg.registry import MsgFactory
from simple_ros.names import canonical
from simple_ros.qos import DEFAULT, LATCHED, MAX_DEPTH, Durability, QosProfile, Reliability

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

__all__ = ["RosImport", "carry_over", "import_ros_bag"]

_TIMES = ("google.protobuf.Timestamp", "google.protobuf.Duration")
_SILENT = {"structure_needs_at_least_one_member"}
# ROS numbers the shapes and actions of markers otherwise.
_MARKER_TYPES = (3, 0, 1, 2, 4, 20, 21, 22, 5, 6, 7, 23, 24)
"""By the number of ROS (ARROW, CUBE, SPHERE, CYLINDER, ...): ours."""
_MARKER_ACTIONS = {0: 0, 2: 1, 3: 2}


@dataclass
class RosImport:
    """What was imported.

    Attributes:
        messages: Messages written.
        skipped: Topics that were left out, and why.
        missing: By type, fields of ROS that had no place.
    """

    messages: int = 0
    skipped: dict[str, str] = field(default_factory=dict)
    missing: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))


def import_ros_bag(
    source: Path,
    target: Path,
    compression: Compression = "zstd",
    chunk_bytes: int = DEFAULT_CHUNK_BYTES,
) -> RosImport:
    """Write the messages of a ROS bag to a new bag.

    Args:
        source: A ``.bag`` of ROS 1, or the directory of a bag of ROS 2.
        target: The new bag.
        compression: Of chunks.
        chunk_bytes: Size of chunks before compression.

    Raises:
        ConfigError: The package ``rosbags`` is not installed.
        NotABag: ``source`` is no ROS bag.
        BagExists: There is a file ``target``.
        BagError: A message cannot be read.
        DiskFull: There is no room; nothing is left of ``target``.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ConfigError(
            "ROS bags need one more package: pip install 'simple-ros[rosbags]'"
        ) from None
    # A single file of a ROS 2 bag is part of what stands in its directory.
    where = source.parent if source.suffix == ".db3" else source
    found = RosImport()
    try:
        store = get_typestore(Stores.LATEST)
        with (
            AnyReader([where], default_typestore=store) as reader,
            BagWriter(target, compression, chunk_bytes, suffix=".part") as writer,
        ):
            _Importer(reader, writer, found).run()
    except (AnyReaderError, FileNotFoundError) as error:
        raise NotABag(source, f"as a ROS bag it cannot be read ({error})") from None
    return found


class _Importer:
    def __init__(self, reader: AnyReader, writer: BagWriter, found: RosImport) -> None:
        self._reader = reader
        self._writer = writer
        self._found = found
        self._classes: dict[str, type[Message]] = {}
        self._channels: dict[tuple[str, str], int] = {}

    def run(self) -> None:
        wanted = [item for item in self._reader.connections if self._is_known(item)]
        if not wanted:
            return
        for connection, stamp_ns, data in self._reader.messages(wanted):
            message_class = self._classes[connection.msgtype]
            theirs = self._deserialised(connection, stamp_ns, data)
            ours = message_class()
            carry_over(theirs, ours, self._found.missing)
            self._writer.add(self._channel(connection), stamp_ns, [ours.SerializeToString()])
            self._found.messages += 1

    def _deserialised(self, connection: Connection, stamp_ns: int, data: bytes) -> object:
        try:
            return self._reader.deserialize(data, connection.msgtype)
        except Exception as error:  # the package lets whatever a damaged message caused through
            raise BagError(
                f"a message on {connection.topic!r} at {stamp_ns} ns is no {connection.msgtype} "
                f"({type(error).__name__}: {error})"
            ) from error

    def _is_known(self, connection: Connection) -> bool:
        name = connection.msgtype.replace("/msg/", ".").replace("/", ".")
        try:
            self._classes[connection.msgtype] = MsgFactory.instance().get_class(name)
        except UnknownMessageType:
            self._found.skipped[canonical(connection.topic)] = f"no type {name} in simple_ros"
            return False
        return True

    def _channel(self, connection: Connection) -> int:
        key = canonical(connection.topic), connection.msgtype
        if key not in self._channels:
            message_class = self._classes[connection.msgtype]
            definition = definition_of(message_class).SerializeToString(deterministic=True)
            schema = self._writer.add_schema(
                message_class.DESCRIPTOR.full_name, "protobuf", definition
            )
            metadata = metadata_of(_offered(connection))
            self._channels[key] = self._writer.add_channel(key[0], schema, metadata=metadata)
        return self._channels[key]


def _offered(connection: Connection) -> QosProfile:
    """What the publisher offered, as far as the bag tells."""
    ext: Any = connection.ext
    if getattr(ext, "latching", None):
        return LATCHED
    profiles = getattr(ext, "offered_qos_profiles", None)
    if not profiles:
        return DEFAULT
    theirs = profiles[0]
    latched = theirs.durability.name == "TRANSIENT_LOCAL"
    best_effort = theirs.reliability.name == "BEST_EFFORT"
    return DEFAULT.replace(
        depth=min(max(theirs.depth, 1), MAX_DEPTH),
        durability=Durability.TRANSIENT_LOCAL if latched else Durability.VOLATILE,
        reliability=Reliability.BEST_EFFORT if best_effort else Reliability.RELIABLE,
    )


# -- one message ---------------------------------------------------------------------------------


def carry_over(theirs: Any, ours: Message, missing: dict[str, set[str]]) -> None:
    """Fill a message of ours from an object with the fields of the ROS message of that name.

    Args:
        theirs: The object.
        ours: An empty message.
        missing: Gets, by type, the fields of ROS that have no place.
    """
    descriptor = ours.DESCRIPTOR
    if descriptor.full_name in _TIMES:
        _set_time(theirs, ours)
        return
    fields = {name.lower(): name for name in vars(theirs) if not name.startswith("__")}
    for item in descriptor.fields:
        name = fields.pop(item.name.lower(), None)
        if name is not None:
            value = getattr(theirs, name)
            special = _SPECIAL.get((descriptor.full_name, item.name))
            if special is not None:
                setattr(ours, item.name, special(value))
            else:
                _set(ours, item, value, missing)
    absent = set(fields.values()) - _SILENT
    if absent:
        missing[descriptor.full_name] |= absent


def _set(ours: Message, item: Any, value: Any, missing: dict[str, set[str]]) -> None:
    if item.is_repeated:
        container = getattr(ours, item.name)
        if item.message_type is None:
            container.extend(value.tolist() if hasattr(value, "tolist") else value)
        else:
            _extend(container, value, missing)
    elif item.message_type is not None:
        inner = getattr(ours, item.name)
        inner.SetInParent()
        carry_over(value, inner, missing)
    elif item.type == FieldDescriptor.TYPE_BYTES:
        setattr(ours, item.name, _octets(value))
    elif item.type == FieldDescriptor.TYPE_BOOL:
        setattr(ours, item.name, bool(value))
    else:
        setattr(ours, item.name, value)


def _extend(container: Any, values: Iterable[Any], missing: dict[str, set[str]]) -> None:
    for value in values:
        carry_over(value, container.add(), missing)


def _octets(value: Any) -> bytes:
    if isinstance(value, bytes):
        return value
    if hasattr(value, "tobytes"):
        return bytes(value.tobytes())
    return bytes(octet & 0xFF for octet in value)


def _set_time(theirs: Any, ours: Any) -> None:
    ours.seconds = theirs.sec
    ours.nanos = theirs.nanosec
    if ours.seconds < 0 < ours.nanos and ours.DESCRIPTOR.name == "Duration":
        # ROS counts nanoseconds upwards from the second; protobuf wants one sign for both.
        ours.seconds += 1
        ours.nanos -= 10**9


def _seconds(duration: Any) -> float:
    return float(duration.sec) + float(duration.nanosec) * 1e-9


_SPECIAL: dict[tuple[str, str], Callable[[Any], Any]] = {
    ("visualization_msgs.Marker", "type"): lambda number: _MARKER_TYPES[int(number)],
    ("visualization_msgs.Marker", "action"): lambda number: _MARKER_ACTIONS[int(number)],
    ("visualization_msgs.Marker", "lifetime"): _seconds,
}
