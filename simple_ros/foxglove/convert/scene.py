"""Markers as updates of a scene."""

from __future__ import annotations

from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.timestamp_pb2 import Timestamp

from simple_ros.foxglove.convert.base import Context, Converter, described
from simple_ros.foxglove.convert.common import frame_of, stamp_of, timestamp
from simple_ros.foxglove.convert.growing_lines import GrowingLines, is_step
from simple_ros.foxglove.convert.shapes import add_shapes, is_finite
from simple_ros.msg import visualization_msgs as vis
from simple_ros.msg.visualization_msgs import Marker, MarkerArray

__all__ = ["MarkerArrayConverter", "MarkerConverter", "SceneConverter"]

_NS = 1_000_000_000
_MAX_DURATION_S = 315_576_000_000.0
"""Of a protobuf Duration."""


class _Update:
    """One update in the making: what a viewer has to remove first, then what it has to show."""

    def __init__(self) -> None:
        self._deletions: dict[str, SceneEntityDeletion] = {}
        self._entities: dict[str, SceneEntity] = {}

    def show(self, entity: SceneEntity) -> None:
        self._entities[entity.id] = entity

    def remove(self, entity_id: str, when: Timestamp) -> None:
        self._entities.pop(entity_id, None)
        kind = SceneEntityDeletion.MATCHING_ID
        self._deletions[entity_id] = SceneEntityDeletion(timestamp=when, type=kind, id=entity_id)

    def remove_all(self, when: Timestamp) -> None:
        self._entities.clear()
        everything = SceneEntityDeletion(timestamp=when, type=SceneEntityDeletion.ALL)
        self._deletions = {"": everything}

    def message(self) -> SceneUpdate:
        deletions, entities = self._deletions.values(), self._entities.values()
        return SceneUpdate(deletions=deletions, entities=entities)


class SceneConverter(Converter):
    """Markers as entities with the id ``<ns>_<id>``, ADD and DELETE in the order they come.

    Remembers lines that grow, see `growing_lines`.
    """

    schema_name = SceneUpdate.DESCRIPTOR.full_name
    suffix = "/scene"

    def __init__(self) -> None:
        self._lines = GrowingLines()

    @property
    def schema(self) -> bytes:
        """See `Converter`."""
        return described(SceneUpdate)

    def _apply(self, marker: Marker, context: Context, update: _Update) -> None:
        entity_id = f"{marker.ns}_{marker.id}"
        match marker.action:
            case vis.ADD:
                self._show(entity_id, marker, context, update)
            case vis.DELETE:
                when = _deletion_time(marker, context)
                for each in (entity_id, *self._lines.forget(entity_id)):
                    update.remove(each, when)
            case vis.DELETEALL:
                self._lines.clear()
                update.remove_all(_deletion_time(marker, context))

    def _show(self, entity_id: str, marker: Marker, context: Context, update: _Update) -> None:
        if is_step(marker) and is_finite(marker):
            for each, line in self._lines.grow(entity_id, marker).items():
                update.show(_entity(each, marker, context, line))
            return
        for piece in self._lines.forget(entity_id):
            update.remove(piece, _deletion_time(marker, context))
        update.show(_entity(entity_id, marker, context))


class MarkerConverter(SceneConverter):
    """``visualization_msgs.Marker`` as ``foxglove.SceneUpdate``."""

    def _converted(self, message: bytes, context: Context) -> bytes:
        update = _Update()
        self._apply(Marker.FromString(message), context, update)
        return update.message().SerializeToString()


class MarkerArrayConverter(SceneConverter):
    """``visualization_msgs.MarkerArray`` as ``foxglove.SceneUpdate``."""

    def _converted(self, message: bytes, context: Context) -> bytes:
        update = _Update()
        for marker in MarkerArray.FromString(message).markers:
            self._apply(marker, context, update)
        return update.message().SerializeToString()


def _entity(
    entity_id: str, marker: Marker, context: Context, line: LinePrimitive | None = None
) -> SceneEntity:
    entity = SceneEntity(
        timestamp=stamp_of(marker.header, context),
        frame_id=frame_of(marker.header, context),
        id=entity_id,
        frame_locked=marker.frame_locked,
    )
    # Unset, zero and negative are for ever; so is what a Duration cannot hold.
    if 0 < marker.lifetime <= _MAX_DURATION_S:
        seconds, nanos = divmod(max(1, round(marker.lifetime * _NS)), _NS)
        entity.lifetime.seconds, entity.lifetime.nanos = seconds, nanos
    else:
        entity.lifetime.SetInParent()
    if line is None:
        add_shapes(marker, entity)
    else:
        entity.lines.append(line)
    return entity


def _deletion_time(marker: Marker, context: Context) -> Timestamp:
    """Late enough to concern what was shown before, whichever clock the sender's stamps are from."""
    stamp, received = stamp_of(marker.header, context), timestamp(context.receive_time_ns)
    return max(stamp, received, key=lambda time: (time.seconds, time.nanos))
