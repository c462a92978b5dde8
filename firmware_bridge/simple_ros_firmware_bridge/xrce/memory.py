"""What must outlive the bridge so that a board never notices that it was restarted.

A few hundred bytes, which change only when the board creates something. Where its streams are is not among
them: the board says so itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from simple_ros_firmware_bridge.xrce.creation import Creation, ObjectId
from simple_ros_firmware_bridge.xrce.objects import Identity, Objects, ReadRequest

if TYPE_CHECKING:
    from simple_ros_firmware_bridge.xrce.session import Session

__all__ = ["restored", "saved"]

_VERSION = 1


def saved(session: Session) -> dict[str, Any]:
    """A session as JSON."""
    who = session.identity
    return {
        "version": _VERSION,
        "session_id": who.session_id,
        "key": who.key.hex(),
        "mtu": who.mtu,
        "objects": [_saved_object(item) for item in session.objects.created.values()],
        "reads": {
            reader.hex(): [request.request_id.hex(), request.stream, request.remaining]
            for reader, request in session.objects.reads.items()
        },
    }


def _saved_object(item: Creation) -> dict[str, Any]:
    return {
        "id": item.object_id.hex(),
        "kind": item.kind,
        "name": item.name,
        "type": item.type_name,
        "topic": None if item.topic is None else item.topic.hex(),
        "reference": item.reference,
        "reliable": item.reliable,
        "transient": item.transient,
        "reply": item.reply_type,
    }


def restored(data: Mapping[str, Any], objects: Objects) -> tuple[Identity, Objects] | None:
    """What was saved, put into ``objects``; None if it makes no sense (any more)."""
    try:
        if data["version"] != _VERSION:
            return None
        for item in data["objects"]:
            creation = _restored_object(item)
            objects.created[creation.object_id] = creation
        for reader, (request, stream, remaining) in data["reads"].items():
            asked = ReadRequest(bytes.fromhex(request), stream, remaining)
            objects.reads[ObjectId.fromhex(reader)] = asked
        return Identity(data["session_id"], bytes.fromhex(data["key"]), data["mtu"]), objects
    except (KeyError, TypeError, ValueError, AttributeError):
        return None


def _restored_object(item: Mapping[str, Any]) -> Creation:
    return Creation(
        ObjectId.fromhex(item["id"]),
        item["kind"],
        item["name"],
        item["type"],
        None if item["topic"] is None else ObjectId.fromhex(item["topic"]),
        item["reference"],
        item["reliable"],
        item["transient"],
        item["reply"],
    )
