"""Writing beside the event loop, so that a slow disk never holds up what arrives.

What has arrived waits in memory, bounded in bytes; what does not fit is counted and given up. The
thread takes everything that waits some times a second: handing each message over by itself would cost
more than writing it.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from simple_ros.bag.errors import BagError
from simple_ros.bag.plan import Cadence
from simple_ros.bag.series import BagSeries, RecordedTopic

__all__ = ["FLUSH_S", "WritingThread"]

FLUSH_S = 1.0
"""What a recorder that is killed loses at most, in seconds of messages."""
_TAKE_S = 0.05
_WAKE_BYTES = 1024 * 1024
# So that a message waits no longer than FLUSH_S, even if it came right after a flush that took a while.
_FLUSH_PERIOD_S = FLUSH_S - 2 * _TAKE_S - 0.1


class _Batch(NamedTuple):
    topic: RecordedTopic
    log_time: int
    payloads: Sequence[bytes]
    size: int


class WritingThread:
    """Writes to a series of files from a thread of its own.

    Args:
        series: Where to write; belongs to the thread until `close` has returned.
        max_bytes: How much may wait.
        on_failed: Called from the thread when nothing more can be written.

    Attributes:
        failure: Why nothing more can be written, if so.
    """

    def __init__(
        self, series: BagSeries, max_bytes: int, on_failed: Callable[[], None] = lambda: None
    ) -> None:
        self.failure: BagError | None = None
        self._series = series
        self._max_bytes = max_bytes
        self._on_failed = on_failed
        self._batches: deque[_Batch] = deque()
        self._taken: deque[_Batch] = deque()
        self._waiting_bytes = 0
        self._condition = threading.Condition()
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def put(self, topic: RecordedTopic, log_time: int, payloads: Sequence[bytes]) -> bool:
        """Hand messages over that came at one time; False if there is no room for them."""
        size = sum(map(len, payloads))
        with self._condition:
            if (
                self.failure
                or self._ending
                or (self._waiting_bytes and self._waiting_bytes + size > self._max_bytes)
            ):
                return False
            self._batches.append(_Batch(topic, log_time, payloads, size))
            self._waiting_bytes += size
            if self._waiting_bytes >= _WAKE_BYTES:
                self._condition.notify()
        return True

    def close(self) -> None:
        """Write what waits and end the thread; blocks meanwhile."""
        with self._condition:
            self._ending = True
            self._condition.notify()
        self._thread.join()

    def _run(self) -> None:
        try:
            self._write_until_closed()
        except BagError as error:
            with self._condition:
                self.failure = error
                self._count_lost()
            self._on_failed()

    def _write_until_closed(self) -> None:
        cadence = Cadence(_FLUSH_PERIOD_S, time.monotonic())
        ending = False
        while not ending:
            with self._condition:
                if not self._ending and self._waiting_bytes < _WAKE_BYTES:
                    self._condition.wait(_TAKE_S)
                ending = self._ending
                self._taken, self._batches = self._batches, deque()
            self._write_taken(cadence)
            if cadence.is_due(time.monotonic()):
                self._series.flush()

    def _write_taken(self, cadence: Cadence) -> None:
        while self._taken:
            topic, log_time, payloads, size = self._taken.popleft()
            self._series.add(topic, log_time, payloads)
            with self._condition:
                self._waiting_bytes -= size
            if cadence.is_due(time.monotonic()):
                self._series.flush()

    def _count_lost(self) -> None:
        """Nothing more is written: what waits is lost."""
        for topic, _, payloads, _ in (*self._taken, *self._batches):
            topic.dropped += len(payloads)
        self._taken.clear()
        self._batches.clear()
        self._waiting_bytes = 0
