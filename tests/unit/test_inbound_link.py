"""A connection that brings messages: what comes alone goes a short way, and overtakes nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Any

from support.waiting import until

from simple_ros.msg.example import SensorData
from simple_ros.net.server import InboundLink
from simple_ros.qos import DEFAULT, QosProfile
from simple_ros.router import Router
from simple_ros.wire.framing import encode_frame, encode_header

HEADER = encode_header("sensor", "example.SensorData")


class Sink:
    wants_bytes = False
    takes_batches = False
    waits = False
    has_received = False
    qos: QosProfile = DEFAULT

    def __init__(self, got: list[int], *, is_direct: bool) -> None:
        self.got = got
        self.is_direct = self.takes_payloads = is_direct
        self.ways: list[str] = []

    def take(self, message: Any, size: int) -> None:
        self.got.append(message.sensor_id)

    def take_payloads(
        self, payloads: list[Any], parse: Callable[[Any], Any], unparsable: Any
    ) -> None:
        self.ways.append("many")
        for payload in payloads:
            self.got.append(parse(payload).sensor_id)

    def lone_taker(self, parse: Callable[[Any], Any], unparsable: Any) -> Callable[[bytes], None]:
        def take(payload: bytes) -> None:
            self.ways.append("lone")
            self.got.append(parse(payload).sensor_id)

        return take

    def take_batch(self, messages: list[Any]) -> None:
        raise AssertionError("it takes no batches")

    def room(self, sizes: Sequence[int]) -> int:
        return 0

    def call_when_room(self, resume: Callable[[], None]) -> None:
        raise AssertionError("it does not wait")

    def sources_changed(self) -> None:
        pass


class Transport(asyncio.Transport):
    """Brings what it is told to, also while the link wants to rest."""

    def __init__(self, link: InboundLink) -> None:
        super().__init__()
        self.link = link
        self.reads = True
        link.connection_made(self)

    def bring(self, *ids: int) -> None:
        data = b"".join(
            encode_frame(HEADER, SensorData(sensor_id=i).SerializeToString()) for i in ids
        )
        self.link.get_buffer(-1)[: len(data)] = data
        self.link.buffer_updated(len(data))

    def is_closing(self) -> bool:
        return False

    def pause_reading(self) -> None:
        self.reads = False

    def resume_reading(self) -> None:
        self.reads = True


def made() -> tuple[Router, Transport]:
    router = Router({}, lambda _: None)
    return router, Transport(InboundLink(router, 1 << 20))


async def test_one_that_comes_alone_like_the_last_goes_straight() -> None:
    got: list[int] = []
    router, transport = made()
    sink = Sink(got, is_direct=True)
    router.add("sensor", "example.SensorData", SensorData.FromString, sink)
    for ids in ((1,), (2,), (3, 4), (5,), (6,), (300,), (301,)):
        transport.bring(*ids)
    assert got == [1, 2, 3, 4, 5, 6, 300, 301]
    # After two at once, and after one of another size, the first goes with all the others.
    assert sink.ways == ["many", "lone", "many", "many", "lone", "many", "lone"]


async def test_nothing_overtakes_what_waits_for_room() -> None:
    got: list[int] = []
    router, transport = made()
    slow, quick = Sink(got, is_direct=False), Sink(got, is_direct=True)
    router.add("sensor", "example.SensorData", SensorData.FromString, slow)
    transport.bring(1)
    assert not transport.reads
    # Somebody else takes the topic before the first message was delivered.
    router.add("sensor", "example.SensorData", SensorData.FromString, quick)
    router.remove("sensor", "example.SensorData", slow)
    transport.bring(2)
    assert got == []
    await until(lambda: transport.reads)
    transport.bring(3)
    assert got == [1, 2, 3]
