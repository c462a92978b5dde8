from __future__ import annotations

import asyncio
import random

import pytest
from support.foxglove import connected
from support.waiting import until

from simple_ros.foxglove import FoxgloveServer, ServerOptions

HANDSHAKE = (
    b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
)


@pytest.mark.parametrize("seed", range(3))
async def test_bytes_that_are_no_frames(seed: int) -> None:
    print("seed", seed)
    chance = random.Random(seed)
    complaints: list[object] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: complaints.append(context))
    server = FoxgloveServer(ServerOptions(), ("time",))
    async with server.listening(port=0):
        for number in range(100):
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            if number % 2:
                writer.write(HANDSHAKE)
                await reader.readuntil(b"\r\n\r\n")
            writer.write(chance.randbytes(chance.randrange(1, 200)))
            writer.transport.abort()
        await until(lambda: not server.clients)
        async with connected(server.port):
            pass
    assert complaints == []
