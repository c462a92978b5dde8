"""The steps by which a message is read and written: runs of numbers, strings, sequences."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

from simple_ros_firmware_bridge.cdr_run import Cursor, Impossible, Run, align, pad

__all__ = ["Messages", "Numbers", "Octets", "Plan", "Step", "Text", "Texts"]


class Step(Protocol):
    """Something to read or write: a run of numbers, a string, a sequence."""

    @property
    def member(self) -> int:
        """Which member of the outermost message its first item belongs to."""
        ...

    def decode(self, cursor: Cursor, holders: list[Any], *, is_lenient: bool) -> bool:
        """Read it; False if the sample ended before."""
        ...

    def encode(self, out: bytearray, holders: list[Any], order: str) -> None:
        """Write it."""
        ...


@dataclass
class Plan:
    """The steps of a type.

    Attributes:
        steps: In order.
        holders: Messages inside the message: index of the parent, name of the field.
    """

    steps: list[Step] = field(default_factory=list)
    holders: list[tuple[int, str]] = field(default_factory=list)

    def _opened(self, message: Any) -> list[Any]:
        opened = [message]
        for parent, name in self.holders:
            opened.append(getattr(opened[parent], name))
        return opened

    def decode(self, cursor: Cursor, message: Any) -> None:
        """Read one message.

        Args:
            cursor: Where; in an outermost message members at the end may be missing.
            message: An empty one, which is filled.
        """
        holders = self._opened(message)
        previous = -1
        for step in self.steps:
            is_lenient = cursor.is_outermost and step.member != previous and previous >= 0
            if not step.decode(cursor, holders, is_lenient=is_lenient):
                return
            previous = step.last_member if isinstance(step, Run) else step.member
        if not self.steps:
            cursor.position += 1

    def encode(self, out: bytearray, message: Any, order: str) -> None:
        """Append one message."""
        holders = self._opened(message)
        for step in self.steps:
            step.encode(out, holders, order)
        if not self.steps:
            out.append(0)  # a structure has at least one member there


@dataclass(frozen=True)
class Text:
    """A string: length with its NUL, bytes, NUL. An empty one may have length 0."""

    holder: int
    name: str
    member: int

    def decode(self, cursor: Cursor, holders: list[Any], *, is_lenient: bool) -> bool:
        """As `Step` says."""
        if is_lenient and cursor.is_at_end(4):
            return False
        setattr(holders[self.holder], self.name, cursor.text())
        return True

    def encode(self, out: bytearray, holders: list[Any], order: str) -> None:
        """As `Step` says."""
        _put_text(out, getattr(holders[self.holder], self.name), order)


@dataclass(frozen=True)
class Octets:
    """Bytes: a sequence, or an array of fixed length."""

    holder: int
    name: str
    member: int
    fixed: int

    def decode(self, cursor: Cursor, holders: list[Any], *, is_lenient: bool) -> bool:
        """As `Step` says."""
        if is_lenient and cursor.is_at_end(1 if self.fixed else 4):
            return False
        size = self.fixed or cursor.count(1)
        setattr(holders[self.holder], self.name, cursor.raw(size))
        return True

    def encode(self, out: bytearray, holders: list[Any], order: str) -> None:
        """As `Step` says."""
        value = getattr(holders[self.holder], self.name)
        if self.fixed:
            if len(value) > self.fixed:
                raise Impossible(f"{self.name} has {len(value)} bytes instead of {self.fixed}")
            out += value.ljust(self.fixed, b"\0")
        else:
            _put_count(out, len(value), order)
            out += value


@dataclass(frozen=True)
class Numbers:
    """A sequence of numbers."""

    holder: int
    name: str
    member: int
    code: str

    def decode(self, cursor: Cursor, holders: list[Any], *, is_lenient: bool) -> bool:
        """As `Step` says."""
        if is_lenient and cursor.is_at_end(4):
            return False
        count = cursor.count(Run.size_of(self.code))
        if count:
            getattr(holders[self.holder], self.name).extend(cursor.numbers(self.code, count))
        return True

    def encode(self, out: bytearray, holders: list[Any], order: str) -> None:
        """As `Step` says."""
        values = getattr(holders[self.holder], self.name)
        _put_count(out, len(values), order)
        if values:
            pad(out, Run.size_of(self.code))
            out += Run.packed(order, self.code, values)


@dataclass(frozen=True)
class Texts:
    """A sequence of strings."""

    holder: int
    name: str
    member: int

    def decode(self, cursor: Cursor, holders: list[Any], *, is_lenient: bool) -> bool:
        """As `Step` says."""
        if is_lenient and cursor.is_at_end(4):
            return False
        texts = [cursor.text() for _ in range(cursor.count(4))]
        getattr(holders[self.holder], self.name).extend(texts)
        return True

    def encode(self, out: bytearray, holders: list[Any], order: str) -> None:
        """As `Step` says."""
        values = getattr(holders[self.holder], self.name)
        _put_count(out, len(values), order)
        for value in values:
            _put_text(out, value, order)


@dataclass(frozen=True)
class Messages:
    """A sequence of messages."""

    holder: int
    name: str
    member: int
    plan: Plan

    def decode(self, cursor: Cursor, holders: list[Any], *, is_lenient: bool) -> bool:
        """As `Step` says."""
        if is_lenient and cursor.is_at_end(4):
            return False
        target = getattr(holders[self.holder], self.name)
        was_outermost, cursor.is_outermost = cursor.is_outermost, False
        for _ in range(cursor.count(1)):
            self.plan.decode(cursor, target.add())
        cursor.is_outermost = was_outermost
        return True

    def encode(self, out: bytearray, holders: list[Any], order: str) -> None:
        """As `Step` says."""
        values = getattr(holders[self.holder], self.name)
        _put_count(out, len(values), order)
        for value in values:
            self.plan.encode(out, value, order)


def _put_count(out: bytearray, count: int, order: str) -> None:
    out += Run.packed(order, "I", (count,), align(len(out), 4) - len(out))


def _put_text(out: bytearray, text: str, order: str) -> None:
    data = text.encode()
    _put_count(out, len(data) + 1, order)
    out += data
    out.append(0)
