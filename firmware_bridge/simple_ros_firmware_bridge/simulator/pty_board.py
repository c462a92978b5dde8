"""A simulated board at one end of a pseudo terminal; a bridge opens the other end like any port."""

from __future__ import annotations

import asyncio
import os
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Self

from simple_ros_firmware_bridge.simulator.firmware import Firmware
from simple_ros_firmware_bridge.simulator.line import LineReader, frame

__all__ = ["PtyBoard"]

Spoil = Callable[[bytes], bytes]


class PtyBoard:
    """Runs a `Firmware` in real time.

    Args:
        firmware: What runs on it.
        link: A path that shall point to the port, such as ``/tmp/pico``.
        spoil_up: What the line does to bytes to the bridge; for tests.
        spoil_down: What it does to bytes to the board.

    Attributes:
        link: As given.
        path: Of the port.
        sent_bytes: What the port took.
        lost_bytes: What it did not take, since nobody read.
    """

    def __init__(
        self,
        firmware: Firmware,
        link: Path | None = None,
        spoil_up: Spoil = bytes,
        spoil_down: Spoil = bytes,
    ) -> None:
        self.firmware = firmware
        self.link = link
        self._spoil_up = spoil_up
        self._spoil_down = spoil_down
        self._reader = LineReader()
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.path = os.ttyname(self._theirs)
        self._loop = asyncio.get_running_loop()
        self._started_at = self._loop.time()
        self._timer: asyncio.TimerHandle | None = None
        self.sent_bytes = 0
        self.lost_bytes = 0

    def now(self) -> float:
        """Seconds since it was switched on."""
        return self._loop.time() - self._started_at

    async def __aenter__(self) -> Self:
        if self.link is not None:
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(self.path)
        self._loop.add_reader(self._ours, self._readable)
        self._run()
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switch it off: the port is gone."""
        if self._ours < 0:
            return
        self._loop.remove_reader(self._ours)
        if self._timer is not None:
            self._timer.cancel()
        if self.link is not None:
            self.link.unlink(missing_ok=True)
        os.close(self._ours)
        os.close(self._theirs)
        self._ours = -1

    def say(self, text: str) -> None:
        """What printf on the same line does."""
        self.noise(text.encode())

    def noise(self, data: bytes) -> int:
        """Bytes that are no message; gives how many of them the port took."""
        before = self.sent_bytes
        self._write(data)
        return self.sent_bytes - before

    def _readable(self) -> None:
        try:
            data = os.read(self._ours, 4096)
        except BlockingIOError:
            return
        now = self.now()
        for message in self._reader.feed(self._spoil_down(data)):
            self.firmware.receive(message, now)
        self._run()

    def _run(self) -> None:
        now = self.now()
        self.firmware.run(now)
        for message in self.firmware.client.data_to_send():
            self._write(self._spoil_up(frame(message)))
        if self._timer is not None:
            self._timer.cancel()
        wait = max(0.0, self.firmware.next_timeout() - now)
        self._timer = self._loop.call_later(wait, self._run)

    def _write(self, data: bytes) -> None:
        try:
            sent = os.write(self._ours, data)
        except BlockingIOError:
            sent = 0
        self.sent_bytes += sent
        self.lost_bytes += len(data) - sent
