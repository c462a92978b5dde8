"""What waits for a board: answers in order, of each topic only the newest sample."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable

from simple_ros.errors import MessageTooLarge
from simple_ros_firmware_bridge.xrce import wire
from simple_ros_firmware_bridge.xrce.output_stream import WINDOW, ReliableOutput
from simple_ros_firmware_bridge.xrce.wire import SubmessageId

__all__ = ["Downlink", "best_effort_limit", "reliable_limit"]

_HEADER = 4
_KEYED_HEADER = 8
_SUBHEADER = 4
_IDS = 4
_MAX_PAYLOAD = 0xFFFF
"""A submessage says its length in 16 bits."""
_MAX_WAITING = 256


def reliable_limit(mtu: int) -> int:
    """Largest sample, in bytes of CDR, that a board can put together from its four buffers."""
    return min(WINDOW * _slice_bytes(mtu) - _SUBHEADER, _MAX_PAYLOAD) - _IDS


def best_effort_limit(mtu: int) -> int:
    """Largest sample, in bytes of CDR, that fits one message."""
    return mtu - _HEADER - _SUBHEADER - _IDS


def _slice_bytes(mtu: int) -> int:
    return (mtu - _HEADER - _SUBHEADER) & ~3


class Downlink:
    """One reliable stream to a board and what waits for room on it.

    Args:
        output: The stream.
        mtu: Longest message, header included.
        is_keyed: Whether headers carry the client key.
    """

    def __init__(self, output: ReliableOutput, mtu: int, *, is_keyed: bool = False) -> None:
        self.output = output
        self.replaced = 0
        self._mtu = mtu - (_KEYED_HEADER - _HEADER if is_keyed else 0)
        self._answers: deque[bytes] = deque(maxlen=_MAX_WAITING)
        self._samples: dict[tuple[Hashable, Hashable], list[bytes]] = {}

    def answer(self, body: bytes) -> None:
        """An answer, which is never dropped for a newer one."""
        self._answers.append(body)

    def offer(
        self, source: tuple[Hashable, Hashable], topic: str, payload: bytes, size: int
    ) -> None:
        """A sample; one of the same source that still waits is replaced by it.

        Args:
            source: For which reader, and for which call of a service if it is one.
            topic: For the error.
            payload: Payload of a DATA.
            size: Of its sample in bytes, for the error.

        Raises:
            MessageTooLarge: The board could never put it together, and its stream would stand still.
        """
        limit = reliable_limit(self._mtu)
        if size > limit:
            raise MessageTooLarge(topic, size, limit)
        if source in self._samples:
            self.replaced += 1
        self._samples[source] = self._sliced(payload)

    def forget(self, reader: Hashable) -> None:
        """Nothing of this reader is to be sent any more."""
        for key in [key for key in self._samples if key[0] == reader]:
            del self._samples[key]

    def _sliced(self, payload: bytes) -> list[bytes]:
        whole = wire.submessage(SubmessageId.DATA, payload)
        if len(whole) + _HEADER <= self._mtu:
            return [whole]
        step = _slice_bytes(self._mtu)
        pieces = [whole[start : start + step] for start in range(0, len(whole), step)]
        last = len(pieces) - 1
        return [
            wire.submessage(
                SubmessageId.FRAGMENT,
                piece,
                wire.LITTLE | (wire.LAST_FRAGMENT if index == last else 0),
            )
            for index, piece in enumerate(pieces)
        ]

    def due(self, now: float) -> list[tuple[int, bytes]]:
        """The messages that go now, numbered."""
        sent: list[tuple[int, bytes]] = []
        while self._answers and self.output.room:
            sent.append(self.output.send(self._answers.popleft(), now))
        while not self._answers and self._samples:
            source = next(iter(self._samples))
            bodies = self._samples[source]
            if len(bodies) > self.output.room:
                break
            del self._samples[source]
            sent += [self.output.send(body, now) for body in bodies]
        return sent
