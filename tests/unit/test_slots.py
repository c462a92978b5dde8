"""What is written about shared memory."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import FrameError
from simple_ros.wire.framing import FrameDecoder, Run, encode_frame, encode_header
from simple_ros.wire.slots import (
    MOST_READERS,
    MOST_SLOTS,
    SLOT_HEADER,
    TABLE_BYTES,
    SlotRef,
    frames_in,
    held_at,
    in_flight_at,
    slot_capacity,
    wanted_at,
)

HEADER = encode_header("image", "ros.sensor_msgs.Image")
LIMIT = 1024


def test_every_flag_has_a_byte_of_its_own_inside_the_table() -> None:
    numbers = [(slot, reader) for slot in range(MOST_SLOTS) for reader in range(MOST_READERS)]
    places = (
        [held_at(*pair) for pair in numbers]
        + [in_flight_at(*pair) for pair in numbers]
        + [wanted_at(reader) for reader in range(MOST_READERS)]
    )
    assert len(set(places)) == len(places)
    assert min(places) == 0
    assert max(places) < TABLE_BYTES


@given(st.integers(1, 2**34))
def test_a_slot_has_room_for_a_bit_more_in_whole_pages(size: int) -> None:
    capacity = slot_capacity(size)
    assert size <= capacity <= size * 1.26 + 64 * 1024
    assert capacity % (64 * 1024) == 0
    assert slot_capacity(capacity) == capacity


def test_a_reference_travels_as_an_ordinary_frame() -> None:
    ref = SlotRef(3, TABLE_BYTES + 65536, 131072, 70000)
    (run,) = FrameDecoder().feed(ref.frame())
    assert run.header == SLOT_HEADER
    assert SlotRef.parse(run.payloads[0]) == ref


@pytest.mark.parametrize(
    ("payload", "complaint"),
    [
        (b"", "0 bytes do not name a slot"),
        (b"x" * 27, "27 bytes"),
        (SlotRef(MOST_SLOTS, TABLE_BYTES, 100, 50).frame()[-28:], "no such slot"),
        (SlotRef(0, TABLE_BYTES, 100, 101).frame()[-28:], "no such slot"),
        (SlotRef(0, 5, 100, 50).frame()[-28:], "no such slot"),
    ],
)
def test_what_is_no_reference_is_refused(payload: bytes, complaint: str) -> None:
    with pytest.raises(FrameError, match=complaint):
        SlotRef.parse(payload)


@given(st.lists(st.binary(max_size=50), max_size=5))
def test_the_frames_in_a_slot_are_those_of_the_stream(payloads: list[bytes]) -> None:
    data = b"".join(encode_frame(HEADER, payload) for payload in payloads)
    runs = frames_in(memoryview(data), LIMIT)
    assert [bytes(view) for run in runs for view in run.payloads] == payloads
    assert all(run.header == HEADER for run in runs)


def test_a_message_over_the_limit_is_reported_and_the_next_one_delivered() -> None:
    data = encode_frame(HEADER, bytes(LIMIT + 1)) + encode_frame(HEADER, b"next")
    assert frames_in(memoryview(data), LIMIT) == [
        Run(HEADER, [], LIMIT + 1),
        Run(HEADER, [memoryview(b"next")]),
    ]


@pytest.mark.parametrize("cut", [1, 3, len(HEADER), len(HEADER) + 3, len(HEADER) + 5])
def test_a_slot_that_ends_inside_a_frame_is_refused(cut: int) -> None:
    with pytest.raises(FrameError, match="inside a frame"):
        frames_in(memoryview(encode_frame(HEADER, b"payload")[:cut]), LIMIT)


def test_noise_in_a_slot_is_refused() -> None:
    with pytest.raises(FrameError, match="name of 65535 bytes"):
        frames_in(memoryview(b"\xff" * 100), LIMIT)
