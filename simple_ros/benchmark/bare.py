"""The bare limits: the plainest programs that do the same, ``python -m simple_ros.benchmark.bare JOB``.

A 4-byte length before each message, the same protobuf parse, the same callback; no topics, no queues, nobody
to find, no fault survived. Options:

* ``style``: ``streams`` (`asyncio.StreamReader` and writer), ``buffered`` (`asyncio.BufferedProtocol`, one write a
  message), ``tuned`` (the same, 64 small messages a write; pixels sent and received in place beside a
  protobuf object), ``blocking`` (sockets and no loop);
* ``transport``: ``tcp`` or ``unix``; ``loop``: ``uvloop``.
"""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable
from typing import Any

from simple_ros.benchmark.frames import LENGTH, FrameReader, large_taker
from simple_ros.benchmark.payloads import encoder, image_fields
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.sink import Sink
from simple_ros.benchmark.source import drive, drive_async, until_end
from simple_ros.benchmark.workloads import Job, Workload

__all__: list[str] = []

_TOGETHER = 64
_HOST = "127.0.0.1"


def receive(job: Job, sink: Sink) -> Any:
    """Listen on one socket and take the messages of one sender."""
    listening = _listening(job)
    at = listening.getsockname()
    ready(at.decode("latin-1") if isinstance(at, bytes) else at[1])
    take = sink.parser()
    if _is_apart(job):
        take = large_taker(sink)
    if job.options["style"] == "blocking" or _is_apart(job):
        connection, _ = listening.accept()
        _receive_blocking(connection, FrameReader(take))
        return None
    if job.options["style"] == "streams":
        return _receive_streams(listening, take)
    return _receive_buffered(listening, take)


def send(job: Job) -> Any:
    """Send every message to all receivers, serialised once."""
    if job.options["style"] == "blocking" or _is_apart(job):
        return _send_blocking(job)
    if job.options["style"] == "streams":
        return _send_streams(job)
    return _send_transports(job)


def _is_apart(job: Job) -> bool:
    """Whether pixels stay beside the protobuf object; sockets then serve as well as any loop."""
    return job.options["style"] == "tuned" and job.workload.shape == "image"


def _listening(job: Job) -> socket.socket:
    if job.options["transport"] == "unix":
        listening = socket.socket(socket.AF_UNIX)
        listening.bind(f"\0simple_ros_bare_{os.getpid()}")
        listening.listen()
        return listening
    return socket.create_server((_HOST, 0))


def _dialled(job: Job) -> list[socket.socket]:
    found = []
    for at in job.at:
        if job.options["transport"] == "unix":
            sock = socket.socket(socket.AF_UNIX)
            sock.connect(at.encode("latin-1"))
        else:
            sock = socket.create_connection((_HOST, at))
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        found.append(sock)
    return found


# -- receivers -------------------------------------------------------------------------------------


class _Buffered(asyncio.BufferedProtocol):
    def __init__(self, take: Callable[[Any], None]) -> None:
        self._reader = FrameReader(take)

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002
        return self._reader.room()

    def buffer_updated(self, nbytes: int) -> None:
        self._reader.received(nbytes)


async def _receive_buffered(listening: socket.socket, take: Callable[[Any], None]) -> None:
    loop = asyncio.get_running_loop()
    if listening.family is socket.AF_UNIX:
        await loop.create_unix_server(lambda: _Buffered(take), sock=listening)
    else:
        await loop.create_server(lambda: _Buffered(take), sock=listening)
    await asyncio.Event().wait()


async def _receive_streams(listening: socket.socket, take: Callable[[Any], None]) -> None:
    async def serve(reader: asyncio.StreamReader, _: asyncio.StreamWriter) -> None:
        while True:
            (size,) = LENGTH.unpack(await reader.readexactly(LENGTH.size))
            take(await reader.readexactly(size))

    await asyncio.start_server(serve, sock=listening)
    await asyncio.Event().wait()


def _receive_blocking(connection: socket.socket, reader: FrameReader) -> None:
    while count := connection.recv_into(reader.room()):
        reader.received(count)


# -- senders ---------------------------------------------------------------------------------------


def _framed(workload: Workload) -> Callable[[int], bytes]:
    encode, pack = encoder(workload), LENGTH.pack

    def make(number: int) -> bytes:
        data = encode(number)
        return pack(len(data)) + data

    return make


def _send_blocking(job: Job) -> None:
    sockets = _dialled(job)
    if _is_apart(job):

        def put_parts(parts: list[Any]) -> None:
            for sock in sockets:
                _put(sock, parts)

        drive(job.workload, _parts(job.workload), put_parts)
        return

    def put(frame: bytes) -> None:
        for sock in sockets:
            sock.sendall(frame)

    drive(job.workload, _framed(job.workload), put)


def _parts(workload: Workload) -> Callable[[int], list[Any]]:
    from simple_ros.protobuf_wire import field_head

    fields, pixels = image_fields(workload), memoryview(bytearray(workload.size_bytes))
    number_of_data = fields(0).DESCRIPTOR.fields_by_name["data"].number
    tag = field_head(number_of_data, len(pixels))

    def make(number: int) -> list[Any]:
        head = fields(number).SerializeToString() + tag
        return [LENGTH.pack(len(head) + len(pixels)) + head, pixels]

    return make


def _put(sock: socket.socket, parts: list[Any]) -> None:
    head, pixels = parts
    sent = sock.sendmsg(parts) - len(head)
    if sent < 0:
        sock.sendall(head[sent:])
        sent = 0
    if sent < len(pixels):
        sock.sendall(pixels[sent:])


async def _send_streams(job: Job) -> None:
    writers = [(await asyncio.open_connection(sock=sock))[1] for sock in _dialled(job)]

    async def put(frame: bytes) -> None:
        for writer in writers:
            writer.write(frame)
            await writer.drain()

    await drive_async(job.workload, _framed(job.workload), put)
    await until_end()


class _Sender(asyncio.Protocol):
    """Knows whether its transport has room."""

    transport: Any

    def __init__(self) -> None:
        self.room = asyncio.Event()
        self.room.set()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport

    def pause_writing(self) -> None:
        self.room.clear()

    def resume_writing(self) -> None:
        self.room.set()


async def _send_transports(job: Job) -> None:
    loop = asyncio.get_running_loop()
    senders: list[_Sender] = []
    for sock in _dialled(job):
        dial: Any = (
            loop.create_connection if sock.family is socket.AF_INET else loop.create_unix_connection
        )
        senders.append((await dial(_Sender, sock=sock))[1])
    together = _TOGETHER if job.options["style"] == "tuned" and not job.workload.rate_hz else 1
    waiting: list[bytes] = []

    def flush() -> None:
        data = waiting[0] if len(waiting) == 1 else b"".join(waiting)
        waiting.clear()
        for sender in senders:
            sender.transport.write(data)

    async def put(frame: bytes) -> None:
        waiting.append(frame)
        if len(waiting) < together:
            return
        flush()
        if together > 1:
            await asyncio.sleep(0)
        for sender in senders:
            if not sender.room.is_set():
                await sender.room.wait()

    await drive_async(
        job.workload, _framed(job.workload), put, lambda: flush() if waiting else None
    )
    await until_end()


if __name__ == "__main__":
    run_program(receive, send)
