"""What a node does with input that it cannot deliver: count, log once, go on."""

from __future__ import annotations

import asyncio
import contextlib
import logging

import pytest
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.msg.example import SensorData
from simple_ros.wire.framing import encode_frame, encode_header
from simple_ros_master import Master

SENSOR = encode_header("sensor", "example.SensorData")
VALID = encode_frame(SENSOR, SensorData(sensor_id=7).SerializeToString())


async def test_bad_messages_are_counted_logged_once_and_the_link_stays(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    got: list[int] = []
    async with NodeHandle("sink", master=master.address, max_message_bytes=10_000) as node:
        await node.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        _, writer = await asyncio.open_connection("127.0.0.1", node.port)
        bad = [
            encode_frame(SENSOR, b"\xff\xff"),
            encode_frame(SENSOR, bytes(10_001)),
            encode_frame(encode_header("sensor", "example.Nonsense"), b"x"),
            encode_frame(encode_header("sensor", "sensor_msgs/SensorData"), b"x"),
            encode_frame(encode_header("elsewhere", "example.SensorData"), b""),
            encode_frame(encode_header("", ""), b""),
            encode_frame(b"\x00\x01\xff\x00\x01\xff", b"x"),
            encode_frame(encode_header("sensor", "TopicTargetsUpdate"), b"\xff\xff"),
        ]
        for _ in range(3):
            for frame in bad:
                writer.write(frame)
            writer.write(VALID)
        await until(lambda: got == [7, 7, 7])
        assert node.dropped_messages.counts == {
            "unparsable": 6,
            "oversized": 3,
            "type_mismatch": 6,
            "unknown_topic": 6,
            "bad_name": 3,
        }
        assert len(caplog.records) == 7, [r.getMessage() for r in caplog.records]
        writer.close()


@pytest.mark.parametrize(
    "noise", [b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"\x16\x03\x01\x02\x00" * 9]
)
async def test_a_header_violation_closes_only_its_link(
    master: Master, caplog: pytest.LogCaptureFixture, noise: bytes
) -> None:
    caplog.set_level(logging.WARNING)
    got: list[int] = []
    async with NodeHandle("sink", master=master.address) as node:
        await node.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        _, good = await asyncio.open_connection("127.0.0.1", node.port)
        reader, bad = await asyncio.open_connection("127.0.0.1", node.port)
        bad.write(VALID + noise)
        with contextlib.suppress(ConnectionResetError):
            assert await asyncio.wait_for(reader.read(), 30) == b""
        good.write(VALID)
        await until(lambda: got == [7, 7])
        assert "not a simple_ros stream" in caplog.text
        assert node.dropped_messages.counts == {"violation": 1}
        for writer in (good, bad):
            writer.close()


async def test_a_connection_that_says_nothing_or_half_a_message_hurts_nobody(
    master: Master,
) -> None:
    got: list[int] = []
    async with NodeHandle("sink", master=master.address) as node:
        await node.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        writers = [(await asyncio.open_connection("127.0.0.1", node.port))[1] for _ in range(20)]
        for index, writer in enumerate(writers):
            writer.write(VALID[:index])
        _, good = await asyncio.open_connection("127.0.0.1", node.port)
        good.write(VALID)
        await until(lambda: got == [7])
        writers[10].write(VALID[10:])
        await until(lambda: got == [7, 7])
        for writer in [*writers, good]:
            writer.close()
