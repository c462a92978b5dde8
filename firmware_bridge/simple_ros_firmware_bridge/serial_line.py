"""A serial port on the event loop, and finding the one a Pico is on."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import os
import re
import struct
import termios
from collections.abc import Callable
from pathlib import Path

import serial
from serial.tools import list_ports

__all__ = ["BY_ID", "SerialLine", "find_boards", "open_problem"]

_READ_BYTES = 65536
_MAX_WAITING = 65536
_BACKED_UP = 1024
"""Two messages of the usual size; 90 ms at 115200 baud."""
_RASPBERRY_PI = 0x2E8A
BY_ID = Path("/dev/serial/by-id")
_PICO_NAME = "usb-Raspberry_Pi_Pico"


def find_boards(by_id: Path = BY_ID) -> list[str]:
    """Paths of the ports of Picos, by the name that stays theirs whichever socket they are put into.

    Args:
        by_id: The directory of these names.
    """
    named = sorted(by_id.iterdir()) if by_id.is_dir() else []
    by_device = {str(path.resolve()): str(path) for path in named}
    found = {str(path) for path in named if path.name.startswith(_PICO_NAME) and path.exists()}
    for port in list_ports.comports():
        if port.vid == _RASPBERRY_PI:
            found.add(by_device.get(port.device, port.device))
    return sorted(found)


_WORDS = {
    errno.ENOENT: "there is no such port; it is opened when it comes",
    errno.EACCES: "you may not open it; add yourself to the group that owns it (on Debian: dialout)",
    errno.EAGAIN: "another program has it",
    errno.EBUSY: "another program has it",
    errno.ENOTTY: "this is no serial port",
    errno.EISDIR: "this is a directory and no serial port",
}


def open_problem(error: Exception) -> str:
    """Why a port cannot be opened, in words."""
    number = getattr(error, "errno", None)
    if number is None and (found := re.search(r"\((\d+), ", str(error))):
        number = int(found[1])  # of termios, which pyserial puts into its text
    reason = _WORDS.get(number) if number is not None else None
    return reason or getattr(error, "strerror", None) or str(error)


def _opened(path: str, baud: int) -> serial.Serial:
    try:
        return serial.Serial(path, baud, timeout=0, exclusive=True)
    except termios.error as error:  # no OSError: a port that went away just now ends so
        raise OSError(*error.args) from None
    except OverflowError:
        raise OSError(errno.EINVAL, f"there is no such speed as {baud} baud") from None


class SerialLine:
    """An open port. ``received`` and ``lost`` are called on the event loop.

    Args:
        path: Of the port.
        baud: Bits per second; USB does not care.
        received: Called with what came.
        lost: Called once with the reason when the port is gone.

    Raises:
        OSError: It cannot be opened; another program may have it.
    """

    def __init__(
        self,
        path: str,
        baud: int,
        received: Callable[[bytes], None],
        lost: Callable[[str], None],
    ) -> None:
        # Exclusive: two agents on one port would each get half of the bytes.
        self._port = _opened(path, baud)
        self._fd = self._port.fileno()
        self._received = received
        self._lost = lost
        self._waiting = bytearray()
        self.dropped_bytes = 0
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self._readable)

    @property
    def is_open(self) -> bool:
        """Whether it is still there."""
        return bool(self._port.is_open)

    def _readable(self) -> None:
        try:
            data = os.read(self._fd, _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(error.strerror or str(error))
            return
        if data:
            self._received(data)
        else:
            self._end("it was unplugged")

    @property
    def is_backed_up(self) -> bool:
        """Whether what was written lies here or in the driver for longer than a message may."""
        if not self.is_open:
            return False
        try:
            (queued,) = struct.unpack("i", fcntl.ioctl(self._fd, termios.TIOCOUTQ, bytes(4)))
        except OSError:
            queued = 0  # it is going away, which reading tells
        return bool(len(self._waiting) + queued > _BACKED_UP)

    def write(self, data: bytes) -> None:
        """Send; what the port does not take now waits, up to 64 KiB."""
        if not self.is_open:
            return
        if self._waiting:
            self._wait_with(data)
            return
        sent = self._sent(data)
        if sent < len(data):
            self._wait_with(data[sent:])
            if self.is_open:
                self._loop.add_writer(self._fd, self._writable)

    def _wait_with(self, data: bytes) -> None:
        if len(self._waiting) + len(data) > _MAX_WAITING:
            self.dropped_bytes += len(data)
        else:
            self._waiting += data

    def _sent(self, data: bytes | bytearray) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            self._end("it was unplugged" if error.errno == errno.EIO else str(error))
            return 0

    def _writable(self) -> None:
        del self._waiting[: self._sent(self._waiting)]
        if not self._waiting and self.is_open:
            self._loop.remove_writer(self._fd)

    def _end(self, reason: str) -> None:
        if self.is_open:
            self.close()
            self._lost(reason)

    def close(self) -> None:
        """Close it; nothing is called after that."""
        if self.is_open:
            self._loop.remove_reader(self._fd)
            self._loop.remove_writer(self._fd)
            self._port.close()
