"""Stand-ins for peers of another implementation, speaking bytes over plain sockets."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from simple_ros.wire.framing import FrameDecoder, header_names


@dataclass
class ForeignListener:
    """Accepts links as a C++ node does and keeps what comes, with the spelling it came in."""

    frames: list[tuple[str, str, bytes]] = field(default_factory=list)
    port: int = 0
    writers: list[asyncio.StreamWriter] = field(default_factory=list)
    carriers: set[int] = field(default_factory=set)
    """Links that brought messages (a Master also keeps one, to see whether the node lives)."""

    async def __aenter__(self) -> ForeignListener:
        self._server = await asyncio.start_server(self._accepted, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()
        for writer in self.writers:
            writer.close()

    async def _accepted(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.writers.append(writer)
        decoder = FrameDecoder()
        while data := await reader.read(65536):
            self.carriers.add(id(writer))
            for run in decoder.feed(data):
                names = header_names(run.header)
                assert names is not None
                self.frames += [(*names, bytes(view)) for view in run.payloads]
        writer.close()

    def on(self, topic: str) -> list[bytes]:
        return [payload for name, _, payload in self.frames if name == topic]
