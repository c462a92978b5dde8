"""Memory that a publishing process shares with the processes it publishes to.

The writer's side is an `Arena`, one for all links of an event loop: a file without a name, so that
nothing is left when the last process that has it ends, however it ends. A large message is copied into a slot once,
whatever the number of readers. A slot is taken again when no reader holds a view of it, or the
process that held it is dead. The reader's side is a `Window`.
"""

from __future__ import annotations

import logging
import mmap
import os
import select
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from simple_ros.errors import FrameError
from simple_ros.wire.slots import (
    MOST_READERS,
    MOST_SLOTS,
    TABLE_BYTES,
    SlotRef,
    held_at,
    in_flight_at,
    slot_capacity,
    wanted_at,
)

__all__ = ["Arena", "ArenaReader", "Window", "is_available"]

logger = logging.getLogger(__name__)

DEFAULT_LIMIT_BYTES = 256 * 1024 * 1024
_IN_FLIGHT_BYTES = 4 * 1024 * 1024
_LEAST_IN_FLIGHT = 2
_WASTE = 4
_NO_READERS = bytes(MOST_READERS)


def is_available() -> bool:
    """Whether this system can share memory without a name and tell when a process has ended."""
    return hasattr(os, "memfd_create") and hasattr(os, "pidfd_open")


def limit_bytes() -> int:
    """The most memory a process shares: ``SIMPLE_ROS_SHM_MB`` (MiB), 256 unless said otherwise."""
    text = os.environ.get("SIMPLE_ROS_SHM_MB", "")
    if not text:
        return DEFAULT_LIMIT_BYTES
    if not text.isdecimal():
        logger.warning("SIMPLE_ROS_SHM_MB=%s is no whole number of MiB; taking 256", text)
        return DEFAULT_LIMIT_BYTES
    return int(text) * 1024 * 1024


class _Slot:
    """One slot as its writer sees it."""

    def __init__(self, fd: int, number: int, offset: int, capacity: int) -> None:
        self.number = number
        self.offset = offset
        self.capacity = capacity
        self._map = mmap.mmap(fd, capacity, offset=offset)
        self._view = memoryview(self._map)

    def fill(self, parts: Sequence[Any]) -> SlotRef:
        """Copy the parts in."""
        end = 0
        for part in parts:
            begin, end = end, end + len(part)
            self._view[begin:end] = part
        return SlotRef(self.number, self.offset, self.capacity, end)

    def close(self, *, give_back: bool) -> None:
        """Unmap; ``give_back`` its pages, which nobody looks at, to the system."""
        self._view.release()
        if give_back:
            self._map.madvise(mmap.MADV_REMOVE)
        self._map.close()


@dataclass(slots=True)
class _Process:
    """A process that reads; ``fd`` tells whether it still runs."""

    fd: int

    def has_ended(self) -> bool:
        poll = select.poll()
        poll.register(self.fd, select.POLLIN)
        return bool(poll.poll(0))


class Arena:
    """The writer's side.

    Args:
        most_bytes: The most it shares. What does not fit is to be sent in another way.

    Attributes:
        fd: The file, for readers to map.
        identity: 16 bytes that tell it from others.

    Raises:
        OSError: There is no memory, or no file descriptor.
    """

    def __init__(self, most_bytes: int) -> None:
        self.identity = os.urandom(16)
        self._most_bytes = most_bytes
        self.fd = os.memfd_create("simple_ros", os.MFD_CLOEXEC)
        self._close_file = weakref.finalize(self, os.close, self.fd)
        os.ftruncate(self.fd, TABLE_BYTES)
        self._table = mmap.mmap(self.fd, TABLE_BYTES)
        self._slots: dict[int, _Slot] = {}
        self._end = TABLE_BYTES
        self._readers: dict[int, ArenaReader] = {}
        self._leaving: dict[int, ArenaReader] = {}
        self._last: tuple[object, SlotRef] | None = None

    @property
    def shared_bytes(self) -> int:
        """Size of its slots."""
        return sum(slot.capacity for slot in self._slots.values())

    @property
    def busy_slots(self) -> int:
        """Slots that somebody holds."""
        self._reap()
        return sum(not self._is_free(number) for number in self._slots)

    def join(self, pid: int) -> ArenaReader:
        """A new reader in process ``pid``.

        Raises:
            OSError: There is no such process here, or there are too many readers.
        """
        self._reap()
        taken = self._readers.keys() | self._leaving.keys()
        free = next((number for number in range(MOST_READERS) if number not in taken), None)
        if free is None:
            raise OSError(f"{MOST_READERS} links share memory already")
        reader = ArenaReader(self, free, _Process(os.pidfd_open(pid)))
        self._readers[free] = reader
        return reader

    def leave(self, reader: ArenaReader) -> None:
        """A reader's link has ended. What it still holds stays untouched until it lets go, or dies."""
        if self._readers.pop(reader.number, None) is None:
            return
        self._leaving[reader.number] = reader
        self._reap()

    def put(self, parts: Sequence[Any]) -> SlotRef | None:
        """Copy frames into a slot, once if the same object is put several times in a row.

        Returns:
            Where they lie; None if there is no room.
        """
        if self._last is not None and self._last[0] is parts:
            return self._last[1]
        slot = self._slot_for(sum(map(len, parts)))
        if slot is None:
            return None
        ref = slot.fill(parts)
        self._last = parts, ref
        return ref

    def forget_last(self) -> None:
        """What was put last may be changed from now on."""
        self._last = None

    def mark(self, slot: int, reader: int) -> None:
        """A slot is about to be announced to a reader."""
        self._table[held_at(slot, reader)] = 1
        self._table[in_flight_at(slot, reader)] = 1

    def is_in_flight(self, slot: int, reader: int) -> bool:
        """Whether the reader has not handed the message on yet."""
        return bool(self._table[in_flight_at(slot, reader)])

    def want(self, reader: int) -> None:
        """Ask to be told when the reader has handed a message on."""
        self._table[wanted_at(reader)] = 1

    # -- slots ---------------------------------------------------------------------------------

    def _slot_for(self, size: int) -> _Slot | None:
        found = self._free_slot(size) or self._new_slot(size)
        if found is None and self._reap():
            found = self._free_slot(size) or self._new_slot(size)
        return found

    def _is_free(self, number: int) -> bool:
        begin = held_at(number)
        return self._table[begin : begin + MOST_READERS] == _NO_READERS

    def _free_slot(self, size: int) -> _Slot | None:
        fitting = [
            slot
            for slot in self._slots.values()
            if size <= slot.capacity <= max(size * _WASTE, slot_capacity(1))
        ]
        fitting.sort(key=lambda slot: slot.capacity)
        return next((slot for slot in fitting if self._is_free(slot.number)), None)

    def _new_slot(self, size: int) -> _Slot | None:
        capacity = slot_capacity(size)
        for slot in list(self._slots.values()):
            if self._fits(capacity):
                break
            if self._is_free(slot.number):
                del self._slots[slot.number]
                slot.close(give_back=True)
        if not self._fits(capacity):
            return None
        number = next(number for number in range(MOST_SLOTS) if number not in self._slots)
        try:
            os.ftruncate(self.fd, self._end + capacity)
            slot = _Slot(self.fd, number, self._end, capacity)
        except (OSError, ValueError) as error:
            logger.warning("no memory to share: %s", error)
            return None
        self._end += capacity
        self._slots[number] = slot
        return slot

    def _fits(self, capacity: int) -> bool:
        return len(self._slots) < MOST_SLOTS and self.shared_bytes + capacity <= self._most_bytes

    # -- readers -------------------------------------------------------------------------------

    def _reap(self) -> bool:
        """Take back what dead processes held; True if anything changed."""
        changed = False
        for number, reader in list(self._leaving.items()):
            holds = any(self._table[held_at(slot, number)] for slot in range(MOST_SLOTS))
            if holds and not reader.process.has_ended():
                continue
            self._clear(number)
            del self._leaving[number]
            os.close(reader.process.fd)
            changed = True
        return changed

    def _clear(self, reader: int) -> None:
        for slot in range(MOST_SLOTS):
            self._table[held_at(slot, reader)] = 0
            self._table[in_flight_at(slot, reader)] = 0
        self._table[wanted_at(reader)] = 0

    @property
    def is_unused(self) -> bool:
        """Whether nobody reads or holds anything."""
        self._reap()
        return not (self._readers or self._leaving)

    def close(self) -> None:
        """Unmap; readers keep what they hold."""
        self._last = None
        for slot in self._slots.values():
            slot.close(give_back=False)
        self._slots.clear()
        for reader in [*self._readers.values(), *self._leaving.values()]:
            os.close(reader.process.fd)
        self._readers.clear()
        self._leaving.clear()
        self._table.close()
        self._close_file()


@dataclass(eq=False, slots=True)
class ArenaReader:
    """One reading link, as the writer sees it.

    Attributes:
        number: Which of the arena's readers it is.
        process: Where it runs.
    """

    arena: Arena
    number: int
    process: _Process
    _in_flight: list[tuple[int, int]] = field(default_factory=list)

    def announce(self, parts: Sequence[Any]) -> bytes | None:
        """Put frames where the reader finds them; return the frame that says where, None if no room."""
        ref = self.arena.put(parts)
        if ref is None:
            return None
        self.arena.mark(ref.slot, self.number)
        self._in_flight.append((ref.slot, ref.size))
        return ref.frame()

    def is_behind(self) -> bool:
        """Whether so much is on its way that the next message had better wait."""
        arena, number = self.arena, self.number
        self._in_flight = [item for item in self._in_flight if arena.is_in_flight(item[0], number)]
        return (
            len(self._in_flight) >= _LEAST_IN_FLIGHT
            and sum(size for _, size in self._in_flight) >= _IN_FLIGHT_BYTES
        )

    def is_behind_for_now(self) -> bool:
        """As `is_behind`; if it is, the reader will say when that has changed."""
        if not self.is_behind():
            return False
        self.arena.want(self.number)
        return self.is_behind()


class Window:
    """The reader's side of one arena. Links from the same process share it; see `shared`.

    Args:
        fd: The arena's file; kept, and closed in the end.
    """

    _known: ClassVar[weakref.WeakValueDictionary[bytes, Window]] = weakref.WeakValueDictionary()

    def __init__(self, fd: int) -> None:
        self.table = mmap.mmap(fd, TABLE_BYTES)
        self._fd = fd
        weakref.finalize(self, os.close, fd)
        self._maps: dict[int, tuple[int, int, mmap.mmap, Any]] = {}

    @classmethod
    def shared(cls, identity: bytes, fd: int) -> Window:
        """The window to an arena; ``fd`` is taken over.

        Raises:
            OSError: The file is no arena's.
        """
        known = cls._known.get(identity)
        if known is not None:
            os.close(fd)
            return known
        try:
            made = cls(fd)
        except ValueError as error:
            os.close(fd)
            raise OSError(f"cannot map shared memory: {error}") from error
        cls._known[identity] = made
        return made

    def take(self, ref: SlotRef, reader: int) -> memoryview:
        """A read-only view of what lies in a slot; the slot is held until the last view of it is gone.

        Raises:
            FrameError: There is no such slot.
        """
        known = self._maps.get(ref.slot)
        if known is None or known[:2] != (ref.offset, ref.capacity):
            known = self._maps[ref.slot] = self._mapped(ref)
        content = known[3].from_buffer(known[2])
        position = held_at(ref.slot, reader)
        weakref.finalize(content, _let_go, self.table, position, os.getpid()).atexit = False
        return memoryview(content).cast("B").toreadonly()[: ref.size]

    def _mapped(self, ref: SlotRef) -> tuple[int, int, mmap.mmap, Any]:
        # Beyond the end of the file a mapping can be made, but not be read.
        if ref.offset + ref.capacity > os.fstat(self._fd).st_size:
            raise FrameError(f"a slot outside of the shared memory: {ref}")
        try:
            memory = mmap.mmap(self._fd, ref.capacity, offset=ref.offset)
        except (OSError, ValueError) as error:
            raise FrameError(f"cannot map {ref}: {error}") from error
        # Late: most programs never receive a large message. A class of its own, since ctypes' arrays
        # themselves cannot be watched.
        import ctypes

        content = type("_Content", (ctypes.c_ubyte * ref.capacity,), {})
        return ref.offset, ref.capacity, memory, content

    def handed_on(self, slots: Sequence[int], reader: int) -> bool:
        """Messages were delivered; True if the writer wants to be told."""
        for slot in slots:
            self.table[in_flight_at(slot, reader)] = 0
        wanted = wanted_at(reader)
        if self.table[wanted]:
            self.table[wanted] = 0
            return True
        return False


def _let_go(table: mmap.mmap, position: int, pid: int) -> None:
    """The last view of a slot is gone. A copy of it in a forked process does not count."""
    if os.getpid() == pid:
        table[position] = 0
