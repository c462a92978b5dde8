"""Ten thousand seeded garbage streams: nothing raised, counters exact, memory flat, others untouched."""

from __future__ import annotations

import gc
import random
import socket
from collections import Counter

import psutil
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.msg.example import SensorData
from simple_ros.wire.framing import FrameDecoder, encode_frame, encode_header
from simple_ros_master import Master

SEED = 20_261_122
STREAMS = 10_000
LIMIT = 4096
SENSOR = encode_header("sensor", "example.SensorData")
VALID = encode_frame(SENSOR, SensorData(sensor_id=7).SerializeToString())


def garbage(random_: random.Random) -> tuple[bytes, Counter[str]]:
    """A stream of well-framed bad messages, and how many there are of each kind."""
    kinds = random_.choices(["unknown_topic", "unparsable", "oversized", "bad_name"], k=3)
    parts = []
    for kind in kinds:
        match kind:
            case "unknown_topic":
                header = encode_header("t" * random_.randrange(20), "x.Y" * random_.randrange(9))
                parts.append(encode_frame(header, random_.randbytes(random_.randrange(200))))
            case "unparsable":
                parts.append(encode_frame(SENSOR, b"\xff" * random_.randrange(1, 30)))
            case "oversized":
                parts.append(encode_frame(SENSOR, bytes(LIMIT + random_.randrange(1, 500))))
            case "bad_name":
                parts.append(encode_frame(b"\0\2\xff\xfe\0\1\xff", random_.randbytes(9)))
    return b"".join(parts), Counter(kinds)


def test_decoder_alone_on_pure_noise() -> None:
    random_ = random.Random(SEED)
    violations = 0
    for _ in range(STREAMS):
        decoder = FrameDecoder(LIMIT)
        data = random_.randbytes(random_.randrange(1, 300))
        while data:
            size = random_.randrange(1, len(data) + 1)
            decoder.feed(data[:size])
            data = data[size:]
        violations += decoder.error is not None
        assert len(decoder._buffer) <= 64 * 1024
    assert violations > STREAMS * 0.9


async def test_node_under_garbage(master: Master) -> None:
    print(f"seed {SEED}")
    random_ = random.Random(SEED)
    got = 0
    other: list[int] = []

    def count(_: SensorData) -> None:
        nonlocal got
        got += 1

    async with (
        NodeHandle("sink", master=master.address, max_message_bytes=LIMIT) as node,
        NodeHandle("source", master=master.address) as source,
    ):
        await node.subscribe("sensor", SensorData, count)
        await node.subscribe("other", SensorData, lambda m: other.append(m.sensor_id))
        publisher = await source.advertise("other", SensorData)
        await publisher.wait_for_subscribers(1, timeout=30)

        async def storm(streams: int) -> Counter[str]:
            """Each stream on a link of its own: bad messages, a valid one, then noise or an end."""
            expected: Counter[str] = Counter()
            for index in range(streams):
                stream, bad = garbage(random_)
                expected.update(bad)
                end = random_.choice([b"", b"\xff" * 9, VALID[:9], b"HTTP/1.1 400"])
                expected["violation"] += end[:1] in (b"\xff", b"H")
                expected["valid"] += 1
                with socket.create_connection(("127.0.0.1", node.port)) as sock:
                    sock.sendall(stream + VALID + end)
                if index % 50 == 49:
                    await until(lambda: got == expected["valid"])
                    publisher.publish(SensorData(sensor_id=index))
            return expected

        warm = await storm(2000)
        got = 0
        gc.collect()
        before = psutil.Process().memory_info().rss
        expected = await storm(STREAMS)
        await until(lambda: not node._server.links)
        gc.collect()
        grown = psutil.Process().memory_info().rss - before
        total = warm + expected
        del total["valid"]
        assert node.dropped_messages.counts == total
        await until(lambda: len(other) == (STREAMS + 2000) // 50)
        assert grown < 9_000_000, "less than 1 kB a stream: memory is flat"
