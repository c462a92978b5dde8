"""A simulated network inside one process, that delays, loses and reorders as told."""

from __future__ import annotations

import asyncio
import itertools
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from simple_ros.net.transport import Acceptor, Listener, Place, Transport, feed

__all__ = ["MemoryNetwork", "NetworkCounts"]

_WINDOW_BYTES = 256 * 1024
_numbers = itertools.count(1)


@dataclass(slots=True)
class NetworkCounts:
    """What became of writes.

    Attributes:
        sent: Writes taken.
        delivered: Writes that arrived.
        lost: Writes lost by chance, by a network that is down, or with their connection.
        reordered: Writes that were held back so that later ones overtake them.
    """

    sent: int = 0
    delivered: int = 0
    lost: int = 0
    reordered: int = 0


class MemoryNetwork(Transport):
    """A transport between nodes of one event loop: ``NodeHandle("a", transports=[network])``.

    Its chances are drawn from a seeded generator of its own: the same program on a `ManualClock` loses
    the same messages. Without loss and reordering it is reliable and holds senders back as TCP does; with
    either it only carries topics that are published best effort.

    Args:
        delay_s: How long a write is under way.
        jitter_s: Up to so much longer, evenly distributed. Order is kept.
        loss: Share of writes that never arrive, 0 to 1.
        reorder: Share of writes that are held back by ``reorder_s``, so that later ones overtake.
        reorder_s: How long.
        seed: Of the generator.

    Attributes:
        counts: What became of writes.

    Raises:
        ValueError: A share is not between 0 and 1, or a time is negative.
    """

    scheme = "memory"

    def __init__(
        self,
        *,
        delay_s: float = 0.0,
        jitter_s: float = 0.0,
        loss: float = 0.0,
        reorder: float = 0.0,
        reorder_s: float = 0.01,
        seed: int = 0,
    ) -> None:
        for name, share in (("loss", loss), ("reorder", reorder)):
            if not 0 <= share <= 1:
                raise ValueError(f"{name} is a share between 0 and 1, not {share}")
        for name, time in (("delay_s", delay_s), ("jitter_s", jitter_s), ("reorder_s", reorder_s)):
            if time < 0:
                raise ValueError(f"{name} is a time in seconds, not {time}")
        self.delay_s = delay_s
        self.jitter_s = jitter_s
        self.loss = loss
        self.reorder = reorder
        self.reorder_s = reorder_s
        self.is_reliable = loss == 0 and reorder == 0
        self.counts = NetworkCounts()
        self.random = random.Random(seed)  # noqa: S311 - chances, not secrets
        self._name = f"net{next(_numbers)}"
        self._is_down = False
        self._listeners: dict[str, Acceptor] = {}
        self._pipes: set[_Pipe] = set()

    @property
    def is_down(self) -> bool:
        """Whether nothing gets through: connections stand, what is written waits or is lost.

        A reliable network delivers once it is up again; another one loses.
        """
        return self._is_down

    @is_down.setter
    def is_down(self, down: bool) -> None:
        self._is_down = down
        if not down:
            for pipe in list(self._pipes):
                pipe.go_on()

    def break_connections(self) -> None:
        """End every connection that stands, as when an access point restarts; nodes dial anew."""
        for pipe in list(self._pipes):
            pipe.end(ConnectionResetError("connection broken by the test"))

    async def listen(self, accept: Acceptor, place: Place) -> Listener:
        """Take connections for one node."""
        address = f"{self.scheme}://{self._name}/{place.instance_id}"
        self._listeners[address] = accept
        return _MemoryListener(self._listeners, address)

    async def dial(self, address: str, protocol: asyncio.Protocol) -> None:
        """Connect to a node of this network."""
        accept = self._listeners.get(address)
        if accept is None or self._is_down:
            raise ConnectionRefusedError(f"nobody listens at {address}")
        pipe = _Pipe(self, protocol, accept(), address)
        self._pipes.add(pipe)
        pipe.begin()

    def forget(self, pipe: _Pipe) -> None:
        """A connection has ended (called by it)."""
        self._pipes.discard(pipe)


class _MemoryListener(Listener):
    def __init__(self, listeners: dict[str, Acceptor], address: str) -> None:
        self._listeners = listeners
        self._address = address

    @property
    def addresses(self) -> tuple[str, ...]:
        return (self._address,)

    async def close(self) -> None:
        self._listeners.pop(self._address, None)


class _Pipe:
    """One connection: writes go in at one end and come out, perhaps, at the other."""

    def __init__(
        self,
        network: MemoryNetwork,
        sender: asyncio.Protocol,
        receiver: asyncio.BufferedProtocol,
        address: str,
    ) -> None:
        self._network = network
        self._sender = sender
        self._receiver = receiver
        self._loop = asyncio.get_running_loop()
        self._out = _End(self, address)
        self._in = _End(self, address)
        self._in_order: deque[bytes] = deque()
        self._under_way = 0
        self._arrived: deque[bytes] = deque()
        self._reading = True
        self._writing_paused = False
        self._ended = False
        self._finishing = False

    def begin(self) -> None:
        self._receiver.connection_made(self._in)
        self._sender.connection_made(self._out)

    # -- the sending end -----------------------------------------------------------------------

    def write(self, data: bytes) -> None:
        network = self._network
        network.counts.sent += 1
        unlucky = network.random.random() < network.loss
        if self._ended or unlucky or (network.is_down and not network.is_reliable):
            network.counts.lost += 1
            return
        self._under_way += len(data)
        delay = network.delay_s + network.random.uniform(0, network.jitter_s)
        if network.random.random() < network.reorder:
            network.counts.reordered += 1
            self._call_later(delay + network.reorder_s, self._arrive, bytes(data))
        else:
            self._in_order.append(bytes(data))
            self._call_later(delay, self._next_arrives)
        if self._under_way > _WINDOW_BYTES and not self._writing_paused:
            self._writing_paused = True
            self._sender.pause_writing()

    def _call_later(self, delay_s: float, function: Callable[..., object], *args: bytes) -> None:
        if delay_s > 0:
            self._loop.call_later(delay_s, function, *args)
        else:
            self._loop.call_soon(function, *args)

    def _next_arrives(self) -> None:
        """Whichever write this was for: those in order arrive in order."""
        self._arrive(self._in_order.popleft())

    def _arrive(self, data: bytes) -> None:
        if self._ended:
            self._network.counts.lost += 1
            return
        self._arrived.append(data)
        self.go_on()

    # -- the receiving end ---------------------------------------------------------------------

    def read(self, on: bool) -> None:
        self._reading = on
        if on:
            self._loop.call_soon(self.go_on)

    def go_on(self) -> None:
        """Hand over what has arrived, as far as the receiver reads."""
        while self._arrived and self._reading and not self._ended and not self._network.is_down:
            data = self._arrived.popleft()
            self._under_way -= len(data)
            self._network.counts.delivered += 1
            feed(self._receiver, data)
        if self._writing_paused and self._under_way <= _WINDOW_BYTES // 2 and not self._ended:
            self._writing_paused = False
            self._sender.resume_writing()
        if self._finishing and not self._under_way:
            self.end(None)

    # -- the end -------------------------------------------------------------------------------

    @property
    def is_ending(self) -> bool:
        return self._ended or self._finishing

    def finish(self, end: _End) -> None:
        """One end closes: what the sender wrote before still arrives, as with TCP."""
        if end is self._out and self._under_way and self._network.is_reliable:
            self._finishing = True
        else:
            self._loop.call_soon(self.end, None)

    def end(self, error: Exception | None) -> None:
        if self._ended:
            return
        self._ended = True
        self._network.counts.lost += len(self._arrived)
        self._network.forget(self)
        self._loop.call_soon(self._receiver.connection_lost, error)
        self._loop.call_soon(self._sender.connection_lost, error)


class _End(asyncio.Transport):
    """What a protocol sees of its end."""

    def __init__(self, pipe: _Pipe, address: str) -> None:
        super().__init__({"peername": address})
        self._pipe = pipe

    def write(self, data: Any) -> None:
        self._pipe.write(data)

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """The window of the network counts instead."""

    def pause_reading(self) -> None:
        self._pipe.read(False)

    def resume_reading(self) -> None:
        self._pipe.read(True)

    def is_closing(self) -> bool:
        return self._pipe.is_ending

    def close(self) -> None:
        self._pipe.finish(self)

    def abort(self) -> None:
        self._pipe.end(ConnectionAbortedError("aborted"))
