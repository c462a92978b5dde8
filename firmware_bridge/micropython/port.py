"""The line to the computer: USB, as MicroPython gives it to a program as stdin and stdout."""

import select
import sys

import micropython

_CHUNK = 64
_CTRL_C = 3


class StdioPort:
    """Bytes over USB. While it is open Ctrl-C is a byte like any other.

    Attributes:
        chunk: What `read` found.
    """

    def __init__(self):
        micropython.kbd_intr(-1)
        self.chunk = bytearray(_CHUNK)
        self._take = sys.stdin.buffer.readinto
        self._put = sys.stdout.buffer.write
        whole = memoryview(self.chunk)
        self._places = [whole[i : i + 1] for i in range(_CHUNK)]
        readable, writable = select.poll(), select.poll()
        readable.register(sys.stdin, select.POLLIN)
        writable.register(sys.stdout, select.POLLOUT)
        self._look, self._has_room = readable.ipoll, writable.ipoll
        self.dropped = 0

    @micropython.native
    def read(self):
        """What came, into `chunk`, without waiting; gives how many bytes.

        A Ctrl-C is the last byte of its chunk: what follows it may be meant for the REPL.
        """
        look, take, chunk, places = self._look, self._take, self.chunk, self._places
        size = 0
        while size < _CHUNK:
            # MicroPython's stdin waits for as many bytes as it is asked for: one at a time.
            for _ in look(0):
                break
            else:
                break
            if not take(places[size]):
                break
            size += 1
            if chunk[size - 1] == _CTRL_C:
                break
        return size

    def write(self, buffer, size):
        """Send; what nobody takes is dropped, as on any line without somebody at its other end."""
        for _, event in self._has_room(0):
            if event & select.POLLOUT:
                try:
                    self._put(buffer, size)
                    return
                except OSError:
                    break
        self.dropped += 1

    def close(self):
        """Give Ctrl-C its meaning back."""
        micropython.kbd_intr(_CTRL_C)
