"""How to read and write one message type: a list of steps, made from its descriptor once."""

from __future__ import annotations

from google.protobuf.descriptor import Descriptor, FieldDescriptor

from simple_ros_firmware_bridge.cdr_layout import (
    CODES,
    ENUM_VALUES,
    FIXED,
    LEFT_OUT,
    ORDER,
    SECONDS,
)
from simple_ros_firmware_bridge.cdr_run import Cursor, Impossible, Item, Run
from simple_ros_firmware_bridge.cdr_steps import (
    Messages,
    Numbers,
    Octets,
    Plan,
    Step,
    Text,
    Texts,
)
from simple_ros_firmware_bridge.cdr_values import FromTable, Nanoseconds, Nothing

__all__ = ["Cursor", "Impossible", "Plan", "plan_of"]

_CODES = {
    FieldDescriptor.TYPE_DOUBLE: "d",
    FieldDescriptor.TYPE_FLOAT: "f",
    FieldDescriptor.TYPE_INT32: "i",
    FieldDescriptor.TYPE_SINT32: "i",
    FieldDescriptor.TYPE_SFIXED32: "i",
    FieldDescriptor.TYPE_UINT32: "I",
    FieldDescriptor.TYPE_FIXED32: "I",
    FieldDescriptor.TYPE_INT64: "q",
    FieldDescriptor.TYPE_SINT64: "q",
    FieldDescriptor.TYPE_SFIXED64: "q",
    FieldDescriptor.TYPE_UINT64: "Q",
    FieldDescriptor.TYPE_FIXED64: "Q",
    FieldDescriptor.TYPE_BOOL: "?",
    FieldDescriptor.TYPE_ENUM: "B",
}
_TIMESTAMP = "google.protobuf.Timestamp"
_DURATION = "google.protobuf.Duration"


def plan_of(descriptor: Descriptor) -> Plan:
    """The plan of a type."""
    return _Planner().plan(descriptor)


class _Planner:
    def __init__(self) -> None:
        self._plan = Plan()
        self._items: list[Item] = []

    def plan(self, descriptor: Descriptor) -> Plan:
        for member, item in enumerate(_fields(descriptor)):
            self._add(item, 0, member)
        self._end_run()
        return self._plan

    def _end_run(self) -> None:
        if self._items:
            self._plan.steps.append(Run(tuple(self._items)))
            self._items = []

    def _step(self, step: Step) -> None:
        self._end_run()
        self._plan.steps.append(step)

    def _add(self, item: FieldDescriptor, holder: int, member: int) -> None:
        inner = item.message_type
        if inner is not None and not item.is_repeated:
            self._add_message(item, inner, holder, member)
        elif inner is not None:
            self._step(Messages(holder, item.name, member, plan_of(inner)))
        elif item.type == FieldDescriptor.TYPE_STRING:
            step = Texts if item.is_repeated else Text
            self._step(step(holder, item.name, member))
        elif item.type == FieldDescriptor.TYPE_BYTES:
            self._step(Octets(holder, item.name, member, FIXED.get(_key(item), 0)))
        else:
            self._add_number(item, holder, member)

    def _add_message(
        self, item: FieldDescriptor, what: Descriptor, holder: int, member: int
    ) -> None:
        self._plan.holders.append((holder, item.name))
        inner = len(self._plan.holders)
        if what.full_name in (_TIMESTAMP, _DURATION):
            self._items.append(Item(inner, "", "iI", 1, member, convert=Nanoseconds()))
            return
        for below in _fields(what):
            self._add(below, inner, member)
        if not what.fields:
            self._items.append(Item(inner, "", "B", 1, member, convert=Nothing()))

    def _add_number(self, item: FieldDescriptor, holder: int, member: int) -> None:
        key = _key(item)
        code = CODES.get(key) or _CODES[item.type]
        if key in SECONDS:
            self._items.append(Item(holder, item.name, "iI", 1, member, convert=Nanoseconds()))
        elif not item.is_repeated:
            table = ENUM_VALUES.get(key)
            convert = None if table is None else FromTable(table)
            self._items.append(Item(holder, item.name, code, 1, member, convert=convert))
        elif key in FIXED:
            self._items.append(Item(holder, item.name, code, FIXED[key], member, is_array=True))
        else:
            self._step(Numbers(holder, item.name, member, code))


def _key(item: FieldDescriptor) -> tuple[str, str]:
    owner = item.containing_type
    return owner.full_name if owner is not None else "", item.name


def _fields(descriptor: Descriptor) -> list[FieldDescriptor]:
    order = ORDER.get(descriptor.full_name)
    if order is not None:
        return [descriptor.fields_by_name[name] for name in order]
    return [item for item in descriptor.fields if _key(item) not in LEFT_OUT]
