"""The program of the board: MicroPython starts it when the board is switched on.

On a Pico it works with the pins of config.py; on a computer (`micropython main.py`) with a robot that is
simulated, which it says.
"""

import gc
import sys
import time

import config
from app import App
from clock import Clock
from framing import FrameReader, FrameWriter

import micropython

if sys.platform == "rp2":
    from hardware import Hardware, open_line
else:
    from hardware_sim import Hardware, open_line

_QUIET_MS = 50
_NOBODY_MS = 500
_GARBAGE_BYTES = 32768


class Board:
    """The line, the clock and the program, put together."""

    def __init__(self):
        self._port = open_line(config)
        self._clock = Clock()
        self._ticks = time.ticks_us()
        self._reader = FrameReader()
        self._writer = FrameWriter()
        self._byte_at = self._message_at = -_NOBODY_MS
        self.hardware = Hardware(config, self.say)
        self.app = App(config, self.hardware, self._clock, self.send, self.say)

    def say(self, text):
        """Text for whoever looks: the bridge shows it as the board's log."""
        print("pico:", text)

    @micropython.native
    def send(self, buffer, size):
        """A message for the bridge."""
        frame_size = self._writer.encode(buffer, size)
        self._port.write(self._writer.frame, frame_size)

    def run(self):
        """Work until somebody presses Ctrl-C."""
        self.say(self.hardware.NAME + ", waiting for simple-ros-pico-bridge")
        while self.step():
            self.hardware.pause()

    @micropython.native
    def step(self):
        """Everything once; False when it is time to end."""
        ticks = time.ticks_us()
        self._clock.add(time.ticks_diff(ticks, self._ticks))
        self._ticks = ticks
        size = self._port.read()
        if size:
            if self._receive(size, self._clock.ms()):
                return False
        elif self._reader.is_inside and self._clock.ms() - self._byte_at > _QUIET_MS:
            self._reader.give_up()
        self.app.run()
        return True

    @micropython.native
    def _receive(self, size, now):
        """A chunk of bytes; True if it is a Ctrl-C of a person or of mpremote."""
        reader = self._reader
        was_quiet = now - self._byte_at >= _QUIET_MS and not reader.is_inside
        self._byte_at = now
        chunk = self._port.chunk
        # In the middle of traffic it is a byte of a message, or noise.
        nobody_talks = was_quiet and now - self._message_at >= _NOBODY_MS
        if nobody_talks and size <= 2 and chunk[size - 1] == 3:
            return True
        reader.feed(chunk, size)
        size = reader.take()
        while size:
            self._message_at = now
            self.app.receive(reader.message, size)
            size = reader.take()
        return False

    def close(self):
        """Motors off, and the REPL back."""
        self.app.stop()
        self._port.close()


def main():
    """Run until it is ended."""
    board = Board()
    gc.collect()
    gc.threshold(_GARBAGE_BYTES)
    try:
        board.run()
        board.say("ended by Ctrl-C, motors are off; 'import main; main.main()' starts it again")
    finally:
        board.close()


if __name__ == "__main__":
    main()
