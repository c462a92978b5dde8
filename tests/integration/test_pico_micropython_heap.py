"""The MicroPython firmware for minutes in simulated time, with the memory of a Pico: the heap stays flat."""

from __future__ import annotations

import asyncio
import shutil
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "firmware_bridge" / "micropython"
MICROPYTHON = shutil.which("micropython") or shutil.which(
    "micropython", path=str(Path(sys.executable).parent)
)
SECONDS = 120
HEAP = ("-X", "heapsize=192k")  # as on a Pico, but of 64-bit objects, which are twice as large

pytestmark = pytest.mark.skipif(
    MICROPYTHON is None,
    reason="needs micropython (its unix port) on the PATH",
)

SOAK = """
import gc, struct, sys
sys.path.insert(0, sys.argv[1])
import config
from app import App
from clock import Clock
from framing import FrameReader, FrameWriter
from hardware_sim import Hardware

class Agent:
    # The least that keeps a board going: acknowledges, says yes to all, commands.
    def __init__(self):
        self.answers = []
        self.number = 0
        self.read = None
        self.messages = 0
    def put(self, session, stream, number, body):
        self.answers.append(struct.pack('<BBH', session, stream, number) + body)
    def put_reliably(self, body):
        self.put(0x81, 0x80, self.number, body)
        self.number = self.number + 1 & 0xFFFF
    def send(self, buffer, size):
        # Through frames and back, as on a line.
        count = writer.encode(buffer, size)
        reader.feed(writer.frame, count)
        assert reader.take() == size
        self.messages += 1
        session, stream, number = struct.unpack_from('<BBH', buffer)
        kind = buffer[4]
        if kind == 2:
            self.put(session, 0, 0, b'\\x06\\x01\\x08\\0' + bytes(buffer[8:12]) + b'\\0\\x01\\0\\0')
        elif kind == 0:
            self.put(0x81, 0, 0, b'\\x04\\x01\\x0b\\0\\0\\0XRCE\\x01\\0\\x01\\x0f\\0')
        if stream == 0x80:
            acknack = struct.pack('<H', number + 1 & 0xFFFF) + b'\\0\\0\\x80'
            self.put(0x81, 0, 0, b'\\x0a\\x01\\x05\\0' + acknack)
            if kind == 1:
                self.put_reliably(b'\\x05\\x01\\x06\\0' + bytes(buffer[8:12]) + b'\\0\\0')
            elif kind == 8:
                self.read = bytes(buffer[8:12])
    def command(self, vx, wz):
        if self.read:
            twist = struct.pack('<6d', vx, 0, 0, 0, 0, wz)
            self.put_reliably(b'\\x09\\x01\\x34\\0' + self.read + twist)

writer, reader = FrameWriter(), FrameReader()
agent, clock = Agent(), Clock()
hardware = Hardware(config, print)
app = App(config, hardware, clock, agent.send, lambda text: None)
gc.threshold(32768)
seconds = int(sys.argv[2])
for s in range(seconds):
    for step in range(500):
        clock.add(2000)
        app.run()
        if step % 25 == 0:
            agent.command(0.2 if s % 20 < 10 else -0.2, 0.3)
        for answer in agent.answers:
            app.receive(bytearray(answer), len(answer))
        agent.answers.clear()
    if s % 10 == 9:
        gc.collect()
        print(gc.mem_alloc(), gc.mem_free(), agent.messages, app.client.sessions)
"""


async def test_the_heap_stays_flat_for_minutes(tmp_path: Path) -> None:
    assert MICROPYTHON is not None
    program = tmp_path / "soak.py"
    program.write_text(SOAK)
    process = await asyncio.create_subprocess_exec(
        MICROPYTHON, *HEAP, str(program), str(FOLDER), str(SECONDS), stdout=asyncio.subprocess.PIPE
    )
    output, _ = await process.communicate()
    assert process.returncode == 0
    rows = [[int(word) for word in line.split()] for line in output.decode().splitlines()]
    used = [row[0] for row in rows]
    assert len(rows) == SECONDS // 10
    assert rows[-1][2] > SECONDS * 140  # messages
    assert rows[-1][3] == 1  # session
    assert max(used[3:]) - min(used[3:]) < 1024
    assert max(used) < 100_000
