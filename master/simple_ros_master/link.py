"""What the Master still has to send to one address, when to dial it, and when it counts as dead.

Pure; time is an argument, in seconds. Frames leave in the order they were pushed. One that was
handed to a connection which then broke may or may not have arrived, so the next connection starts
with a *resync*: everything the node should know, anew. The same happens when a node takes nothing
for so long that its queue must be given up.

Verdict on watched addresses (nodes that hold no lease). Before the first connection, a node has
`PATIENCE_S` to start listening. After one, it is dead when the address refuses twice in a row,
`SECOND_LOOK_S` apart. Each registration starts over. As long as the port accepts, the node lives,
even if it closes every connection at once; dialling then slows down.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from simple_ros.names import MAX_NAME_BYTES
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.wire.framing import (
    EMPTY_UPDATE_TOPIC,
    TARGETS_UPDATE_TYPE,
    encode_frame,
    encode_header,
)
from simple_ros.wire.session import Backoff

__all__ = ["PushLink", "frame_of"]

PATIENCE_S = 3.0
"""How long a registered node may take until it listens."""
SECOND_LOOK_S = 0.3
"""How long after a first refusal an address that did listen gets its last chance."""
STEADY_S = 1.0
"""A connection that lived this long is dialled again at once when it is lost."""
MAX_FRAMES = 10_000
"""Frames that may wait for one address."""
MAX_BYTES = 16 * 1024 * 1024
"""Bytes that may wait for one address."""


def frame_of(update: ros.TopicTargetsUpdate) -> bytes:
    """An update as it goes over the wire.

    Receivers read the topic from the update; a frame that cannot carry it in its header says so.
    """
    fits = 0 < len(update.topic.encode()) <= MAX_NAME_BYTES
    header = encode_header(update.topic if fits else EMPTY_UPDATE_TOPIC, TARGETS_UPDATE_TYPE)
    return encode_frame(header, update.SerializeToString())


class PushLink:
    """The state of one address; see the module for its contract.

    Attributes:
        needs_resync: The shell must call `resync` before `take`.
        dial_at: When to connect, while there is no connection.
    """

    def __init__(self, now: float) -> None:
        self.needs_resync = False
        self.dial_at = now
        self._queue: deque[bytes] = deque()
        self._queued_bytes = 0
        self._handed_over = False
        self._backoff = Backoff(0.1, 1.0)
        self._connected_at = now
        self._accepts = False
        self._was_connected = False
        self._refusals = 0
        self._deadline: float | None = None

    # -- frames --------------------------------------------------------------------------------

    def push(self, frame: bytes, now: float) -> None:
        """Queue a frame; a queue beyond its limits is given up for a later resync.

        A node that closes connections but accepts them need not wait for its next frame.
        """
        if self._accepts:
            self.dial_at = min(self.dial_at, now)
        if self.needs_resync:
            return
        self._append(frame)
        if len(self._queue) > MAX_FRAMES or self._queued_bytes > MAX_BYTES:
            self._clear()
            self.needs_resync = True

    def resync(self, frames: Iterable[bytes]) -> None:
        """Everything the node should know by now, instead of what was to be sent."""
        self._clear()
        self.needs_resync = False
        for frame in frames:
            self._append(frame)

    def take(self, limit: int) -> bytes:
        """Frames to write to the live connection now: about ``limit`` bytes, empty for none."""
        taken = []
        while self._queue and limit > 0:
            frame = self._queue.popleft()
            limit -= len(frame)
            self._queued_bytes -= len(frame)
            taken.append(frame)
        self._handed_over = self._handed_over or bool(taken)
        return b"".join(taken)

    def _append(self, frame: bytes) -> None:
        self._queue.append(frame)
        self._queued_bytes += len(frame)

    def _clear(self) -> None:
        self._queue.clear()
        self._queued_bytes = 0

    # -- connections ---------------------------------------------------------------------------

    def watch(self, now: float) -> None:
        """Ask for a verdict; a node that registers proves that it lives, so its time starts anew."""
        self._deadline = now + PATIENCE_S
        self._was_connected = False
        self._refusals = 0
        self._backoff.reset()
        self.dial_at = min(self.dial_at, now)

    def unwatch(self) -> None:
        """Ask for no verdict: something else tells whether the node lives."""
        self._deadline = None

    def connected(self, now: float) -> None:
        """Somebody accepted."""
        self._accepts = True
        self._connected_at = now
        self._refusals = 0
        self._handed_over = False

    def lost(self, now: float) -> None:
        """The connection ended: `dial_at` says when to try again."""
        self._was_connected = True
        self.needs_resync = self.needs_resync or self._handed_over
        if now - self._connected_at >= STEADY_S:
            self._backoff.reset()
            self.dial_at = now
        else:
            self.dial_at = now + self._backoff.next_delay()

    def failed(self, now: float, *, refused: bool) -> bool:
        """Nobody accepted: `dial_at` says when to try again.

        Args:
            now: The time.
            refused: Whether that says something about the node, and not about this host.

        Returns:
            Whether the address is watched and by now counts as dead. It is said once; then the
            address is watched no longer.
        """
        self._accepts = False
        self.dial_at = now + self._backoff.next_delay()
        if self._deadline is None or not refused:
            return False
        self._refusals += 1
        if self._was_connected:
            is_dead = self._refusals > 1
            self.dial_at = now + SECOND_LOOK_S
        else:
            is_dead = now >= self._deadline
            self.dial_at = min(self.dial_at, max(self._deadline, now))
        if is_dead:
            self.unwatch()
        return is_dead
