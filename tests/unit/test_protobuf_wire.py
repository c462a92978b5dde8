from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.codecs import codec_of
from simple_ros.large import LargeMessage, large
from simple_ros.msg.example import ControlCommand
from simple_ros.msg.nav_msgs import OccupancyGrid
from simple_ros.msg.sensor_msgs import Image, PointCloud2
from simple_ros.msg.std_msgs import ByteMultiArray
from simple_ros.protobuf_wire import field_head, split_field
from simple_ros.wire.framing import FrameDecoder, encode_frame, encode_header

NUMBER = Image.DESCRIPTOR.fields_by_name["data"].number


@given(st.binary(max_size=300), st.text(max_size=20), st.integers(0, 2**31), st.booleans())
def test_what_is_split_is_what_protobuf_reads(
    data: bytes, frame_id: str, step: int, big: bool
) -> None:
    image = Image(encoding="rgb8", step=step, is_bigendian=big, data=data)
    image.header.frame_id = frame_id
    rest, field = split_field(memoryview(image.SerializeToString()), NUMBER)
    assert bytes(field) == data
    assert Image.FromString(rest + field_head(NUMBER, len(data)) + data) == image
    image.ClearField("data")
    assert Image.FromString(rest) == image


def test_of_a_field_that_comes_twice_the_last_counts() -> None:
    raw = Image(data=b"first").SerializeToString() + Image(data=b"second").SerializeToString()
    rest, field = split_field(memoryview(raw), NUMBER)
    assert (rest, bytes(field)) == (b"", b"second")
    assert Image.FromString(raw).data == b"second"


@given(st.binary(max_size=60))
def test_garbage_is_split_or_refused(data: bytes) -> None:
    try:
        rest, field = split_field(memoryview(data), NUMBER)
    except ValueError:
        return
    assert len(rest) + len(field) <= len(data)


@pytest.mark.parametrize("data", [b"\x0a\x05ab", b"\x0b\x00", b"\x80" * 11, b"\x0d\x00"])
def test_what_is_no_message_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"field|wire type|varint"):
        split_field(memoryview(data), NUMBER)


def test_a_large_message_reads_as_the_plain_one() -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    kind = large(Image)
    assert kind is large(Image)
    assert kind.__name__ == "LargeImage"
    message = kind(Image(height=2, width=4, encoding="rgb8", step=12), pixels)
    assert (message.height, message.encoding, len(message.data)) == (2, "rgb8", 24)
    whole = message.to_message()
    assert whole.data == pixels.tobytes()
    codec = codec_of(kind)
    assert codec.type_name(kind) == "sensor_msgs.Image"
    assert Image.FromString(codec.encode(message)) == whole
    again = codec.decoder(kind)(memoryview(whole.SerializeToString()))
    assert again == message
    assert again != kind(Image(), pixels)
    assert "24 bytes data" in repr(again)


def test_numbers_other_than_bytes_are_seen_as_bytes() -> None:
    message = large(PointCloud2)(PointCloud2(), np.zeros((5, 4), np.float32))
    assert len(message.data) == 80


def test_what_cannot_be_a_large_message() -> None:
    with pytest.raises(ValueError, match="name the field of"):
        large(ControlCommand)
    with pytest.raises(ValueError, match="has no bytes field 'pixels'; it has data"):
        large(Image, "pixels")
    with pytest.raises(TypeError, match=r"must be a sensor_msgs\.Image, not PointCloud2"):
        large(Image)(PointCloud2(), b"")
    with pytest.raises(ValueError, match="C-contiguous"):
        large(Image)(Image(), np.zeros((4, 4), np.uint8)[:, ::2])
    with pytest.raises(AttributeError):
        _ = large(Image)(Image(), b"").nothing
    assert large(ByteMultiArray, "data").number
    assert issubclass(large(OccupancyGrid), LargeMessage)


# -- buffers that are lent -------------------------------------------------------------------------

HEADER = encode_header("image", "sensor_msgs.Image")


def received(decoder: FrameDecoder, data: bytes) -> list[memoryview]:
    """As a shell does it: into the decoder's own buffer."""
    views: list[memoryview] = []
    rest = memoryview(data)
    while rest:
        space = decoder.get_buffer()
        size = min(len(space), len(rest))
        space[:size] = rest[:size]
        del space
        views += [view for run in decoder.received(size) for view in run.payloads]
        rest = rest[size:]
    return views


def test_large_payloads_stay_as_they_were_while_somebody_holds_them() -> None:
    decoder = FrameDecoder()
    held = []
    for number in range(12):
        payload = bytes([number]) * 200_000
        held += received(decoder, encode_frame(HEADER, payload) + encode_frame(HEADER, b"small"))[
            :1
        ]
    assert [set(bytes(view)) for view in held] == [{number} for number in range(12)]


def test_buffers_come_back_when_nobody_holds_them() -> None:
    decoder = FrameDecoder()
    addresses = set()
    for number in range(50):
        (view,) = received(decoder, encode_frame(HEADER, bytes([number]) * 500_000))
        if number >= 10:
            addresses.add(np.frombuffer(view, np.uint8).ctypes.data)
        assert bytes(view[:1]) == bytes([number])
    assert len(addresses) <= 3


@given(
    st.lists(st.integers(0, 200_000), min_size=1, max_size=8),
    st.integers(1000, 300_000),
    st.sets(st.integers(0, 7)),
)
def test_any_chunks_any_holders(sizes: list[int], chunk: int, keep: set[int]) -> None:
    decoder = FrameDecoder()
    stream = b"".join(
        encode_frame(HEADER, bytes([index]) * size) for index, size in enumerate(sizes)
    )
    lengths, kept = [], []
    for start in range(0, len(stream), chunk):
        for view in received(decoder, stream[start : start + chunk]):
            if len(view) >= 65_536 and len(lengths) in keep:
                kept.append((len(lengths), view))
            lengths.append(len(view))
    assert lengths == sizes
    for index, view in kept:
        assert view[0] == view[-1] == index
