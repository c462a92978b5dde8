"""Messages on a TCP connection."""

from __future__ import annotations

import random

from hypothesis import given
from hypothesis import strategies as st

from simple_ros_firmware_bridge.tcp_framing import MessageReader, encode_message

MESSAGES = st.lists(st.binary(min_size=1, max_size=700), max_size=8)


def test_the_length_is_little_endian() -> None:
    assert encode_message(b"ab" * 150) == b"\x2c\x01" + b"ab" * 150


@given(MESSAGES, st.randoms(use_true_random=False))
def test_any_portions_give_the_same_messages(messages: list[bytes], rng: random.Random) -> None:
    data = b"".join(map(encode_message, messages))
    reader, found = MessageReader(), []
    while data:
        size = rng.randrange(1, 400)
        found += reader.feed(data[:size])
        data = data[size:]
    assert found == messages


def test_empty_messages_are_left_out() -> None:
    assert MessageReader().feed(bytes(9) + b"\0" + encode_message(b"x")) == [b"x"]
