"""Serial frames: any portions, any noise."""

from __future__ import annotations

import random
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros_firmware_bridge.crc import crc16
from simple_ros_firmware_bridge.serial_framing import Frame, FrameReader, encode_frame
from simple_ros_firmware_bridge.simulator import line

payloads = st.binary(max_size=300) | st.lists(
    st.sampled_from([0x7E, 0x7D, 0x5E, 0x5D, 0x0A, 0x0D]), max_size=40
).map(bytes)


def test_the_checksum_is_that_of_the_standard() -> None:
    assert crc16(b"123456789") == 0xBB3D
    assert crc16(b"") == 0


@given(payloads)
def test_both_ends_agree_on_checksum_and_frame(payload: bytes) -> None:
    assert crc16(payload) == line.crc(payload)
    assert encode_frame(payload, 1, 0) == line.frame(payload, 1, 0)
    assert 0x7E not in encode_frame(payload, 1, 0)[1:]
    assert line.LineReader(1).feed(encode_frame(payload, 0, 1)) == [payload]


@given(st.lists(payloads, max_size=6), st.randoms(use_true_random=False))
def test_any_portions_give_the_same_frames(messages: list[bytes], rng: random.Random) -> None:
    stream = b"".join(encode_frame(message, 1, 0) for message in messages)
    reader = FrameReader()
    found: list[Frame] = []
    while stream:
        cut = rng.randrange(1, 9)
        found += reader.feed(stream[:cut])
        stream = stream[cut:]
    assert found == [Frame(1, 0, message) for message in messages]
    assert reader.counters.frames == len(messages)
    assert reader.counters.noise_bytes == reader.counters.damaged == 0


def flags_in(data: bytes) -> int:
    """Frames that are begun and not empty: what follows a flag and is not another flag."""
    return sum(1 for part in data.split(b"\x7e")[1:-1] if part)


@pytest.mark.parametrize("seed", range(3))
def test_a_million_bytes_of_garbage(seed: int) -> None:
    """Nothing raised, every begun frame counted once, no memory kept, and the next frame comes."""
    garbage = random.Random(seed).randbytes(1_000_000)
    reader = FrameReader()
    reader.feed(garbage[:50_000])  # tables and caches are made
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for start in range(50_000, len(garbage), 4096):
        reader.feed(garbage[start : start + 4096])
        reader.take_text()
        reader.take_damaged()
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert after - before < 32_768
    (frame,) = reader.feed(encode_frame(b"still here", 1, 0))
    assert frame == Frame(1, 0, b"still here")
    counters = reader.counters
    assert counters.bytes == len(garbage) + len(encode_frame(b"still here", 1, 0))
    begun = flags_in(garbage + b"\x7e")
    assert counters.frames + counters.damaged == begun + 1


def test_garbage_in_one_piece_is_garbage_in_many() -> None:
    garbage = random.Random(7).randbytes(50_000)
    whole, bytewise = FrameReader(), FrameReader()
    whole.feed(garbage)
    for byte in garbage:
        bytewise.feed(bytes((byte,)))
    assert whole.counters == bytewise.counters


def test_text_between_frames_is_the_log_of_the_board() -> None:
    reader = FrameReader()
    message = encode_frame(b"sample", 0, 0)
    assert len(reader.feed(message + b"imu found\r\nmotor " + message + b"ready\n" + message)) == 3
    assert reader.take_text() == ["imu found", "motor ready"]
    assert reader.take_text() == []


@pytest.mark.parametrize(
    ("printed", "told"),
    [
        ("Temperatur 21.5 °C", "Temperatur 21.5 °C"),
        ("电机过热 请检查", "电机过热 请检查"),
        ('{"speed": {"left": 1}}', '{"speed": {"left": 1}}'),
        ("\x1b[0;32mI (312) wifi: up\x1b[0m", "I (312) wifi: up"),
        ("é", None),
    ],
)
def test_text_in_any_language(printed: str, told: str | None) -> None:
    reader = FrameReader()
    reader.feed(printed.encode() + b"\r\n")
    assert reader.take_text() == ([] if told is None else [told])


def test_noise_is_no_text() -> None:
    reader = FrameReader()
    rng = random.Random(20261122)
    for _ in range(1000):
        reader.feed(rng.randbytes(100).replace(b"\x7e", b""))
        reader.take_text()
    assert reader.counters.text_lines <= 2
    reader.feed(b"\n\x80\x01\xff\x02" * 20 + b"motor driver is hot\r")
    assert reader.take_text()[-1:] == ["motor driver is hot"]


def test_a_flipped_bit_is_told_with_what_is_left() -> None:
    frame = bytearray(encode_frame(b"\x81\x80\x05\x00 a sample", 0, 0))
    frame[-4] ^= 0x10
    reader = FrameReader()
    assert reader.feed(bytes(frame)) == []
    (remains,) = reader.take_damaged()
    assert remains[:4] == b"\x81\x80\x05\x00"
    assert reader.counters.crc_errors == 1


def test_a_cut_frame_is_told_when_the_next_begins() -> None:
    frame = encode_frame(b"\x81\x80\x05\x00 a sample", 0, 0)
    reader = FrameReader()
    assert len(reader.feed(frame[:9] + frame)) == 1
    assert reader.counters.cut_frames == 1
    assert reader.take_damaged() == [b"\x81\x80\x05\x00"]


def test_line_ends_that_a_driver_turned_into_two_bytes_are_recognised() -> None:
    frame = encode_frame(b"\x81\x80\x0a\x00 line\nends\n here", 0, 0)
    reader = FrameReader()
    reader.feed(frame.replace(b"\n", b"\r\n") + frame)
    assert reader.counters.crc_errors == 1
    assert reader.counters.crlf_frames == 1
    assert reader.counters.frames == 1


def test_a_length_that_cannot_be_is_not_waited_for() -> None:
    reader = FrameReader(max_payload=512)
    assert reader.feed(b"\x7e\x00\x00\xff\xff" + b"x" * 100) == []
    assert reader.counters.oversize_frames == 1
    assert len(reader.feed(encode_frame(b"ok", 0, 0))) == 1
