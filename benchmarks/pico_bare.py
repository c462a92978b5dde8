"""What a pseudo terminal and a socket cost with nothing between them: ``python pico_bare.py PORT_PATH TCP_PORT``.

Reads the port as the bridge does and writes what came to a TCP connection at once: no frames, no agent, no topics.
"""

from __future__ import annotations

import asyncio
import os
import socket
import sys

import serial


async def main(path: str, port: int) -> None:
    line = serial.Serial(path, timeout=0, exclusive=True)
    out = socket.create_connection(("127.0.0.1", port))
    out.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    over = asyncio.Event()

    def readable() -> None:
        data = os.read(line.fileno(), 65536)
        if not data:
            over.set()
            return
        out.send(data)

    asyncio.get_running_loop().add_reader(line.fileno(), readable)
    await over.wait()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
