"""Stand-ins for peers of another implementation, speaking bytes over plain sockets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from simple_ros.net.feeder import NO_LANE, Lane, Source
from simple_ros.net.server import NodeServer
from simple_ros.wire.framing import Run, header_names


@dataclass
class ForeignListener:
    """Accepts links as a C++ node does and keeps what comes, with the spelling it came in."""

    frames: list[tuple[str, str, bytes]] = field(default_factory=list)
    port: int = 0
    carriers: set[Source] = field(default_factory=set)
    """Links that brought messages (a Master also keeps one, to see whether the node lives)."""

    async def __aenter__(self) -> ForeignListener:
        self._server = NodeServer(self)
        await self._server.start(("127.0.0.1",))
        self.port = self._server.port
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._server.close()

    def receive(self, link: Source, run: Run, resume: Callable[[], None], *, force: bool) -> int:
        self.carriers.add(link)
        names = header_names(run.header)
        assert names is not None
        self.frames += [(*names, bytes(view)) for view in run.payloads]
        return len(run.payloads)

    def lane_of(self, link: Source, header: bytes) -> Lane:
        return NO_LANE

    def link_refused(self, peer: str, reason: str) -> None:
        raise AssertionError(f"{peer} sent what is no frame: {reason}")

    def link_ended(self, link: Source) -> None:
        pass

    def on(self, topic: str) -> list[bytes]:
        return [payload for name, _, payload in self.frames if name == topic]
