"""An agent behind serial frames: bytes in, bytes and events out."""

from __future__ import annotations

from simple_ros_firmware_bridge.serial_framing import FrameReader, encode_frame
from simple_ros_firmware_bridge.xrce.agent import Agent

__all__ = ["SerialAgent"]

_AGENT_ADDRESS = 0


class SerialAgent:
    """Joins a `FrameReader` and an `Agent`.

    Args:
        agent: Speaks to the board.
    """

    def __init__(self, agent: Agent) -> None:
        self.agent = agent
        self.reader = FrameReader()
        self.misaddressed = 0
        self._peer = _AGENT_ADDRESS

    def receive(self, data: bytes, now: float) -> None:
        """Bytes of the line."""
        for frame in self.reader.feed(data):
            if frame.destination != _AGENT_ADDRESS:
                self.misaddressed += 1
                continue
            # Boards are 0 with a custom transport and 1 with the serial one; answers go where it came from.
            self._peer = frame.source
            self.agent.receive(frame.payload, now)
        for remains in self.reader.take_damaged():
            self.agent.line_damaged(remains, now)

    def data_to_send(self) -> bytes:
        """Bytes for the line."""
        return b"".join(
            encode_frame(message, _AGENT_ADDRESS, self._peer)
            for message in self.agent.data_to_send()
        )

    def line_opened(self) -> None:
        """The line was opened anew: what was half read is not going on."""
        counters = self.reader.counters
        self.reader = FrameReader()
        self.reader.counters = counters
