"""The two reliable streams of XRCE, in buffers that are made once. Times are milliseconds."""

from struct import pack_into

import micropython

SLOTS = 4
MESSAGE_BYTES = 508
_HEARTBEAT_MS = 100


@micropython.native
def ahead(start, end):
    """How far ``end`` is after ``start``, of numbers that begin anew after 65535; below 0 if before."""
    difference = (end - start) & 0xFFFF
    return difference - 0x10000 if difference & 0x8000 else difference


class ReliableOutput:
    """To the agent: messages stay in their slots until they are acknowledged.

    Args:
        send: Called with a buffer and a size: a message for the line.
        session: Number of the session.
        stream: Number of the stream.
    """

    def __init__(self, send, session, stream):
        self._send = send
        self._session = session
        self._stream = stream
        self._slots = [bytearray(MESSAGE_BYTES) for _ in range(SLOTS)]
        self._sizes = [0] * SLOTS
        self._heartbeat = bytearray(13)
        self._first = 0
        self._next = 0
        self._heartbeat_at = 0
        self.resent = 0

    def reset(self):
        """Begin anew: nothing is under way."""
        self._first = self._next = 0

    @property
    def free(self):
        """How many messages there is room for."""
        return SLOTS - ahead(self._first, self._next)

    @micropython.native
    def slot(self):
        """Buffer for the next message; its first four bytes are filled in already."""
        buffer = self._slots[self._next % SLOTS]
        pack_into("<BBH", buffer, 0, self._session, self._stream, self._next)
        return buffer

    @micropython.native
    def commit(self, size, now):
        """The message in `slot` is ready, with that size: send it."""
        index = self._next % SLOTS
        self._sizes[index] = size
        if self._first == self._next:
            self._heartbeat_at = now + _HEARTBEAT_MS
        self._next = (self._next + 1) & 0xFFFF
        self._send(self._slots[index], size)

    @micropython.native
    def acknowledged(self, first, missing, now):
        """An ACKNACK: all before ``first`` arrived; bit i of ``missing`` asks for ``first + i`` again."""
        under_way = ahead(self._first, self._next)
        if not 0 <= ahead(self._first, first) <= under_way:
            return
        self._first = first
        self._heartbeat_at = now + _HEARTBEAT_MS
        for bit in range(ahead(first, self._next)):
            if missing >> bit & 1:
                index = (first + bit) % SLOTS
                self.resent += 1
                self._send(self._slots[index], self._sizes[index])

    def run(self, now):
        """Tell what is under way, if nothing was heard of it for a while."""
        if self._first == self._next or now < self._heartbeat_at:
            return
        self._heartbeat_at = now + _HEARTBEAT_MS
        last = (self._next - 1) & 0xFFFF
        pack_into("<BBHBBH", self._heartbeat, 0, self._session, 0, 0, 11, 1, 5)
        pack_into("<HHB", self._heartbeat, 8, self._first, last, self._stream)
        self._send(self._heartbeat, 13)


class ReliableInput:
    """From the agent: hands messages on in order, and keeps up to four that came too early."""

    def __init__(self):
        self._slots = [bytearray(MESSAGE_BYTES) for _ in range(SLOTS)]
        self._sizes = [0] * SLOTS
        self.next = 0

    def reset(self):
        """Begin anew."""
        self.next = 0
        for index in range(SLOTS):
            self._sizes[index] = 0

    @micropython.native
    def is_next(self, number):
        """Whether it is the message that is waited for; then it counts as taken."""
        if number != self.next:
            return False
        self._sizes[number % SLOTS] = 0
        self.next = (number + 1) & 0xFFFF
        return True

    def keep(self, number, message, size):
        """A message that is not next: kept if it is early and there is room for it."""
        if 0 < ahead(self.next, number) < SLOTS and size <= MESSAGE_BYTES:
            index = number % SLOTS
            self._slots[index][:size] = message[:size]
            self._sizes[index] = size

    @micropython.native
    def early(self):
        """Size of the next message if it came early: it is in `early_message`, until the next call."""
        index = self.next % SLOTS
        size = self._sizes[index]
        if size:
            self._sizes[index] = 0
            self.next = (self.next + 1) & 0xFFFF
        return size

    def early_message(self):
        """Buffer of the message that `early` gave."""
        return self._slots[(self.next - 1) % SLOTS]

    @micropython.native
    def missing(self, last):
        """Bits of the numbers from `next` up to ``last`` that are not here."""
        bits = 0
        for bit in range(min(ahead(self.next, last) + 1, 16)):
            if bit >= SLOTS or not self._sizes[(self.next + bit) % SLOTS]:
                bits |= 1 << bit
        return bits

    @micropython.native
    def highest(self):
        """The highest number that is here; one before `next` if nothing came early."""
        for bit in range(SLOTS - 1, 0, -1):
            if self._sizes[(self.next + bit) % SLOTS]:
                return (self.next + bit) & 0xFFFF
        return (self.next - 1) & 0xFFFF
