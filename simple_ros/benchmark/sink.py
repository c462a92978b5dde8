"""What receivers do with a message: look at it, count it, and report when the last one came."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from simple_ros.benchmark.payloads import HEAD
from simple_ros.benchmark.workloads import Workload

__all__ = ["Sink", "say"]

_LAST = b"\0"
_QUIET_S = 4.0
"""Longer than the heartbeats with which some middleware notices that something is missing."""


def say(**facts: Any) -> None:
    """Tell the harness: a line of JSON."""
    sys.stdout.write(json.dumps(facts) + "\n")
    sys.stdout.flush()


class Sink:
    """Counts the messages of a workload; one of its methods is the callback of a receiver.

    The first warm-up is told at once, the report after the last message, or when the harness has waited
    long enough.

    Attributes:
        message: Takes a parsed message: a Twist, or an Image of protobuf or with its pixels apart.
    """

    def __init__(self, workload: Workload) -> None:
        self._count = workload.count
        self._size = workload.size_bytes
        self._is_timed = bool(workload.rate_hz)
        self._heard = False
        self._next = -1
        self._received = self._lost = self._late = 0
        self._begun = self._ended = self._cpu = 0.0
        self._took: list[float] = []
        small = self.timed_twist if self._is_timed else self.twist
        self.message: Callable[[Any], None] = small if workload.shape == "twist" else self.image

    def watch(self) -> None:
        """When the harness says that everything is sent, report as soon as nothing comes any more."""

        def wait() -> None:
            if sys.stdin.readline():
                before = -1
                while self._received != before:
                    before = self._received
                    time.sleep(_QUIET_S)
                if not self._ended:
                    self._report()
                sys.stdin.readline()
            os._exit(0)

        threading.Thread(target=wait, daemon=True).start()

    def parser(self) -> Any:
        """A callback for serialised messages."""
        message = self.message
        if self._size:
            from simple_ros.msg.sensor_msgs_pb2 import Image

            parse: Any = Image.FromString
        else:
            from simple_ros.msg.geometry_msgs_pb2 import Twist

            parse = Twist.FromString

        def take(data: Any) -> None:
            message(parse(data))

        return take

    # -- callbacks -----------------------------------------------------------------------------

    def twist(self, twist: Any) -> None:
        """Take a Twist of any middleware."""
        number = twist.linear.x
        if number == self._next:
            self._received += 1
            self._next += 1
            if number == self._count:
                self._finish()
        else:
            self._odd(int(number))

    def timed_twist(self, twist: Any) -> None:
        """Take a Twist, and how long it took."""
        took = time.monotonic() - twist.angular.z
        if twist.linear.x:
            self._took.append(took)
        self.twist(twist)

    def image(self, image: Any) -> None:
        """Take an Image, and how long it took until its pixels could be read."""
        header = image.header
        stamp = header.stamp
        self.pixels(header.seq, stamp.seconds + stamp.nanos / 1e9, image.data)

    def raw(self, data: Any) -> None:
        """Take a buffer that begins with number and stamp."""
        number, stamp = HEAD.unpack_from(data)
        self.pixels(number, stamp, data)

    def pixels(self, number: int, stamp_s: float, data: Any) -> None:
        """Take the pixels of the Image of a number and a stamp."""
        if len(data) != self._size or bytes(data[-1:]) != _LAST:
            raise SystemExit(f"{len(data)} bytes arrived instead of {self._size}")
        if number and self._is_timed:
            self._took.append(time.monotonic() - stamp_s)
        if number == self._next:
            self._received += 1
            self._next += 1
            if number == self._count:
                self._finish()
        else:
            self._odd(number)

    # -- rare ----------------------------------------------------------------------------------

    def _odd(self, number: int) -> None:
        """A warm-up, the first message, or one that is not the next."""
        if number == 0:
            if not self._heard:
                self._heard = True
                say(heard=time.monotonic())
            return
        if self._next < 0:
            self._begun, self._cpu = time.perf_counter(), time.process_time()
            self._next = 1
        if number < self._next:
            self._late += 1
            return
        self._lost += number - self._next
        self._received += 1
        self._next = number + 1
        if number == self._count:
            self._finish()

    def _finish(self) -> None:
        self._ended, self._cpu = time.perf_counter(), time.process_time() - self._cpu
        self._report()

    def _report(self) -> None:
        from simple_ros.benchmark.figures import latencies  # later: it takes long to import

        took_s = self._ended - self._begun
        complete = bool(self._ended)
        per_second = (self._received - 1) / took_s if complete and took_s else 0.0
        report: dict[str, Any] = {
            "received": self._received,
            "lost": self._count - self._received,
            "repeated": self._late,
            "per_second": per_second,
            "mb_s": per_second * self._size / 1e6,
            "receive_cpu_us": 1e6 * self._cpu / max(1, self._received) if complete else 0.0,
        }
        say(report=report | latencies(self._took))
