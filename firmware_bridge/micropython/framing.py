"""Frames on a serial line, for MicroPython: no hardware, nothing allocated per frame.

A frame is ``7E``, the sender's and the receiver's address (both 0), the size of the message (two bytes, low
one first), the message, and its CRC-16/ARC. After ``7E`` the bytes ``7E`` and ``7D`` are written as ``7D``
and the byte with bit 5 flipped. Whatever is not a frame, such as text, is skipped up to the next ``7E``.
"""

import array

import micropython

MAX_MESSAGE = 512
MAX_FRAME = 2 * (MAX_MESSAGE + 6) + 1


def _crc_of_byte(value):
    for _ in range(8):
        value = (value >> 1) ^ 0xA001 if value & 1 else value >> 1
    return value


_CRC = array.array("H", [_crc_of_byte(value) for value in range(256)])


@micropython.viper
def _crc(data: ptr8, size: int, table: ptr16) -> int:
    crc = 0
    for i in range(size):
        crc = (crc >> 8) ^ table[(crc ^ data[i]) & 0xFF]
    return crc


@micropython.viper
def _escaped(frame: ptr8, plain: ptr8, at: int, size: int) -> int:
    for i in range(size):
        byte = plain[i]
        if byte == 0x7E or byte == 0x7D:
            frame[at] = 0x7D
            at += 1
            byte ^= 0x20
        frame[at] = byte
        at += 1
    return at


@micropython.viper
def _scan(chunk: ptr8, size: int, state: ptr32, frame: ptr8) -> int:
    """Read on; gives the size of a message once it is whole, 0 when the chunk is used up.

    ``state``: how many bytes of a frame are here plus one (0 outside of a frame), whether the last was
    ``7D``, where to go on in the chunk.
    """
    got = state[0]
    escape = state[1]
    i = state[2]
    whole = 0
    while i < size and whole == 0:
        byte = chunk[i]
        i += 1
        if byte == 0x7E:
            got = 1
            escape = 0
        elif got > 0:
            if byte == 0x7D:
                escape = 1
            else:
                if escape:
                    byte ^= 0x20
                    escape = 0
                frame[got - 1] = byte
                got += 1
                if got > 4:
                    length = frame[2] | (frame[3] << 8)
                    if length == 0 or length > 512:
                        got = 0
                    elif got == length + 7:
                        got = 0
                        whole = length
    state[0] = got
    state[1] = escape
    state[2] = i
    return whole


class FrameWriter:
    """Makes frames.

    Attributes:
        frame: Holds the last one; used again for the next.
    """

    def __init__(self):
        self.frame = bytearray(MAX_FRAME)
        self._head = bytearray(4)
        self._tail = bytearray(2)

    @micropython.native
    def encode(self, message, size):
        """Put the first ``size`` bytes of ``message`` into `frame`; gives the size of the frame.

        Raises:
            ValueError: There are more than `MAX_MESSAGE`.
        """
        if size > MAX_MESSAGE:
            raise ValueError(f"a message of {size} bytes")
        crc = _crc(message, size, _CRC)
        self._head[2] = size & 0xFF
        self._head[3] = size >> 8
        self._tail[0] = crc & 0xFF
        self._tail[1] = crc >> 8
        self.frame[0] = 0x7E
        at = _escaped(self.frame, self._head, 1, 4)
        at = _escaped(self.frame, message, at, size)
        return _escaped(self.frame, self._tail, at, 2)


class FrameReader:
    """Finds messages in chunks of bytes.

    Attributes:
        message: Holds the last one found, from its first byte.
        damaged: How many frames had a wrong checksum.
    """

    def __init__(self):
        self._frame = bytearray(MAX_MESSAGE + 6)
        self.message = memoryview(self._frame)[4:]
        self.damaged = 0
        self._state = array.array("i", [0, 0, 0])
        self._chunk = b""
        self._size = 0

    @property
    def is_inside(self):
        """Whether a frame has begun and is not whole."""
        return self._state[0] > 0

    def feed(self, chunk, size):
        """The next ``size`` bytes of the line; take every message with `take` before the next chunk."""
        self._chunk = chunk
        self._size = size
        self._state[2] = 0

    @micropython.native
    def take(self):
        """Size of the next message, now in `message`; 0 if there is none (yet)."""
        while True:
            size = _scan(self._chunk, self._size, self._state, self._frame)
            if not size:
                return 0
            frame = self._frame
            if _crc(self.message, size, _CRC) != frame[size + 4] | frame[size + 5] << 8:
                self.damaged += 1
            elif frame[0] == 0 and frame[1] == 0:
                return size

    def give_up(self):
        """The rest of a frame is not coming."""
        self._state[0] = 0
