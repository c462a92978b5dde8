"""Numbers at fixed distances from each other, read and written by one `struct` call."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simple_ros_firmware_bridge.cdr_values import Convert

__all__ = ["Cursor", "Impossible", "Item", "Run", "align", "pad"]


class Impossible(ValueError):
    """A sample that cannot be, or a message that cannot be written."""


def align(position: int, size: int) -> int:
    """The next multiple of ``size``."""
    return position + -position % size


def pad(out: bytearray, size: int) -> None:
    """Append zeros up to a multiple of ``size``."""
    out += bytes(-len(out) % size)


@cache
def _size(code: str) -> int:
    return struct.calcsize("=" + code[0])


class Cursor:
    """A place in a sample."""

    __slots__ = ("data", "is_outermost", "order", "position")

    def __init__(self, data: bytes, order: str) -> None:
        self.data = data
        self.order = order
        self.position = 0
        self.is_outermost = True

    def is_at_end(self, size: int) -> bool:
        """Whether nothing of a value of ``size`` bytes is left; padding does not count."""
        return align(self.position, size) >= len(self.data)

    def raw(self, count: int) -> bytes:
        """So many bytes."""
        end = self.position + count
        if end > len(self.data):
            raise Impossible(f"ends at byte {len(self.data)}, within a member")
        piece = self.data[self.position : end]
        self.position = end
        return piece

    def numbers(self, code: str, count: int) -> tuple[Any, ...]:
        """So many numbers."""
        size = _size(code)
        self.position = align(self.position, size)
        return struct.unpack(f"{self.order}{count}{code}", self.raw(size * count))

    def count(self, least_bytes: int) -> int:
        """The length of a sequence whose elements have at least so many bytes."""
        (count,) = self.numbers("I", 1)
        if count * least_bytes > len(self.data) - self.position:
            raise Impossible(f"a sequence of {count} elements does not fit")
        return int(count)

    def text(self) -> str:
        """A string."""
        return self.raw(self.count(1)).rstrip(b"\0").decode("utf-8", "replace")


@dataclass(frozen=True)
class Item:
    """One field of a run.

    Attributes:
        holder: Index of the message it is in.
        name: Its name.
        code: One code of `struct`, or several of the same size for a converted value.
        count: How many numbers of that code.
        member: Which member of the outermost message it belongs to.
        is_array: Whether it is a repeated field.
        convert: How it becomes a field, if it is not simply the number.
    """

    holder: int
    name: str
    code: str
    count: int
    member: int
    is_array: bool = False
    convert: Convert | None = None

    @property
    def numbers(self) -> int:
        """How many values `struct` gives."""
        return self.count * len(self.code)

    def put(self, holders: list[Any], values: tuple[Any, ...]) -> None:
        """Numbers of the sample into the message."""
        if self.is_array:
            getattr(holders[self.holder], self.name).extend(values)
        elif self.convert is not None:
            self.convert.read(holders[self.holder], self.name, values)
        else:
            setattr(holders[self.holder], self.name, values[0])

    def take(self, holders: list[Any]) -> tuple[Any, ...]:
        """The numbers for the sample."""
        if self.convert is not None:
            return self.convert.write(holders[self.holder], self.name)
        value = getattr(holders[self.holder], self.name)
        if not self.is_array:
            return (value,)
        if len(value) > self.count:
            raise Impossible(f"{self.name} has {len(value)} numbers instead of {self.count}")
        return (*value, *(0,) * (self.count - len(value)))


class Run:
    """Items that follow each other without a string or sequence between them."""

    def __init__(self, items: tuple[Item, ...]) -> None:
        self.items = items
        self.member = items[0].member
        self.last_member = items[-1].member
        self._structs: dict[tuple[str, int], struct.Struct] = {}
        bounds = [0]
        for item in items:
            bounds.append(bounds[-1] + item.numbers)
        self._slices = tuple(
            (item, start, end) for item, start, end in zip(items, bounds, bounds[1:], strict=False)
        )

    @staticmethod
    def size_of(code: str) -> int:
        """Bytes of a number."""
        return _size(code)

    @staticmethod
    def packed(order: str, code: str, values: Iterable[Any], padding: int = 0) -> bytes:
        """Numbers of one code, behind so many zeros."""
        values = tuple(values)
        return struct.pack(f"{order}{padding}x{len(values)}{code}", *values)

    def _struct(self, order: str, phase: int) -> struct.Struct:
        found = self._structs.get((order, phase))
        if found is None:
            found = self._structs[order, phase] = struct.Struct(order + self._format(phase))
        return found

    def _format(self, phase: int) -> str:
        parts = []
        position = phase
        for item in self.items:
            size = _size(item.code)
            start = align(position, size)
            parts.append(f"{start - position}x")
            parts += [f"{item.count}{code}" for code in item.code]
            position = start + size * item.numbers
        return "".join(parts)

    def decode(self, cursor: Cursor, holders: list[Any], *, is_lenient: bool) -> bool:
        """Read it; what the sample lacks at its end is left out, if that is allowed."""
        layout = self._struct(cursor.order, cursor.position & 7)
        if cursor.position + layout.size > len(cursor.data):
            return self._decode_some(cursor, holders, is_lenient=is_lenient)
        values = layout.unpack_from(cursor.data, cursor.position)
        cursor.position += layout.size
        for item, start, end in self._slices:
            if item.convert is None and not item.is_array:
                setattr(holders[item.holder], item.name, values[start])
            else:
                item.put(holders, values[start:end])
        return True

    def _decode_some(self, cursor: Cursor, holders: list[Any], *, is_lenient: bool) -> bool:
        previous = None if is_lenient else self.member
        for item in self.items:
            may_end = cursor.is_outermost and item.member != previous
            if may_end and cursor.is_at_end(_size(item.code)):
                return False
            values: tuple[Any, ...] = ()
            for code in item.code:
                values += cursor.numbers(code, item.count)
            item.put(holders, values)
            previous = item.member
        return True

    def encode(self, out: bytearray, holders: list[Any], order: str) -> None:
        """Append it."""
        values: list[Any] = []
        for item in self.items:
            if item.convert is None and not item.is_array:
                values.append(getattr(holders[item.holder], item.name))
            else:
                values += item.take(holders)
        try:
            out += self._struct(order, len(out) & 7).pack(*values)
        except struct.error as error:
            raise Impossible(f"{self._culprit(values, order)} ({error})") from None

    def _culprit(self, values: list[Any], order: str) -> str:
        for item, start, end in self._slices:
            try:
                struct.pack(
                    order + "".join(f"{item.count}{c}" for c in item.code), *values[start:end]
                )
            except struct.error:
                return f"{item.name} does not fit"
        return "a number does not fit"
