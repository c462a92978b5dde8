"""Boards over UDP and TCP: the client of the simulator on a socket, in real time."""

from __future__ import annotations

import asyncio
import contextlib
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from simple_ros_firmware_bridge.simulator.client import BoardClient
from simple_ros_firmware_bridge.simulator.creation import Topic

PERIOD_S = 0.005
TOPICS = (
    Topic(1, "/light", "std_msgs/Float64"),
    Topic(2, "/cmd_vel", "geometry_msgs/Twist", is_published=False),
)


class NetBoard:
    """Publishes a counter on ``light`` and keeps the samples of ``cmd_vel``."""

    def __init__(self, key: bytes, *, gives_up: bool) -> None:
        self.client = BoardClient(list(TOPICS), key, gives_up=gives_up)
        self.commands: list[bytes] = []
        self.sent = 0

    def run(self, now: float) -> list[bytes]:
        self.client.handle_timeout(now)
        if self.client.publish(0, struct.pack("<d", self.sent), now):
            self.sent += 1
        self.commands += [data for _, data in self.client.take_samples()]
        return self.client.data_to_send()


class UdpLine(asyncio.DatagramProtocol):
    def __init__(self, board: NetBoard) -> None:
        self.board = board

    def datagram_received(self, data: bytes, addr: object) -> None:
        self.board.client.receive(data, asyncio.get_running_loop().time())

    def error_received(self, exc: Exception) -> None:
        """Nobody is there now."""


@asynccontextmanager
async def udp_board(
    port: int, key: bytes = b"udp!", *, gives_up: bool = False
) -> AsyncIterator[NetBoard]:
    loop = asyncio.get_running_loop()
    board = NetBoard(key, gives_up=gives_up)
    transport, _ = await loop.create_datagram_endpoint(
        lambda: UdpLine(board), remote_addr=("127.0.0.1", port)
    )

    async def run() -> None:
        while True:
            for message in board.run(loop.time()):
                transport.sendto(message)
            await asyncio.sleep(PERIOD_S)

    task = asyncio.create_task(run())
    try:
        yield board
    finally:
        task.cancel()
        transport.close()


@asynccontextmanager
async def tcp_board(
    port: int, key: bytes = b"tcp!", *, gives_up: bool = False
) -> AsyncIterator[NetBoard]:
    """A board that dials again when its connection ends, and knows its session all the while."""
    loop = asyncio.get_running_loop()
    board = NetBoard(key, gives_up=gives_up)

    async def hear(reader: asyncio.StreamReader) -> None:
        while True:
            size = int.from_bytes(await reader.readexactly(2), "little")
            board.client.receive(await reader.readexactly(size), loop.time())

    async def connected() -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        hearing = asyncio.create_task(hear(reader))
        try:
            while not hearing.done():
                for message in board.run(loop.time()):
                    writer.write(len(message).to_bytes(2, "little") + message)
                await asyncio.sleep(PERIOD_S)
        finally:
            hearing.cancel()
            await asyncio.gather(hearing, return_exceptions=True)
            writer.close()

    async def run() -> None:
        while True:
            with contextlib.suppress(OSError):
                await connected()
            await asyncio.sleep(PERIOD_S)

    task = asyncio.create_task(run())
    try:
        yield board
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
