"""The peer frame: golden bytes, any chunking, limits, bad streams."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import FrameError
from simple_ros.wire.framing import (
    TARGETS_UPDATE_TYPE,
    FrameDecoder,
    encode_frame,
    encode_header,
    header_names,
)

GOLDEN_PUSH = (
    b"\x00\x0dquad_odometry\x00\x12TopicTargetsUpdate\x00\x00\x00\x31"
    b"\x0a\x0dquad_odometry\x12\x20\x0a\x09127.0.0.1\x10\xe1\xd4\x03\x1a\x0fquad_visualizer"
)

names = st.text(max_size=20)
messages = st.lists(st.tuples(names, names, st.binary(max_size=300)), max_size=12)


def decode(decoder: FrameDecoder, chunks: list[bytes]) -> list[tuple[str, str, bytes]]:
    found = []
    for chunk in chunks:
        for run in decoder.feed(chunk):
            topic_type = header_names(run.header)
            assert topic_type is not None
            found += [(*topic_type, bytes(view)) for view in run.payloads]
    return found


def cut(data: bytes, sizes: list[int]) -> list[bytes]:
    chunks = []
    for size in sizes:
        chunks.append(data[:size])
        data = data[size:]
    return [*chunks, data]


def test_golden_push_is_made_and_read() -> None:
    header = encode_header("quad_odometry", TARGETS_UPDATE_TYPE)
    payload = GOLDEN_PUSH[len(header) + 4 :]
    assert encode_frame(header, payload) == GOLDEN_PUSH
    assert decode(FrameDecoder(), [GOLDEN_PUSH]) == [
        ("quad_odometry", "TopicTargetsUpdate", payload)
    ]


@given(messages, st.lists(st.integers(0, 200), max_size=20))
def test_any_chunking_gives_the_same_messages(
    sent: list[tuple[str, str, bytes]], sizes: list[int]
) -> None:
    stream = b"".join(encode_frame(encode_header(t, m), data) for t, m, data in sent)
    decoder = FrameDecoder()
    assert decode(decoder, cut(stream, sizes)) == sent
    assert not decoder.mid_message
    assert decoder.error is None


@given(messages)
def test_byte_by_byte(sent: list[tuple[str, str, bytes]]) -> None:
    stream = b"".join(encode_frame(encode_header(t, m), data) for t, m, data in sent)
    assert decode(FrameDecoder(), [stream[i : i + 1] for i in range(len(stream))]) == sent


def test_run_keeps_messages_of_one_header_together() -> None:
    header = encode_header("a", "b.C")
    stream = b"".join(encode_frame(header, bytes([i])) for i in range(5))
    (run,) = FrameDecoder().feed(stream)
    assert run.header == header
    assert [bytes(view) for view in run.payloads] == [b"\0", b"\1", b"\2", b"\3", b"\4"]


few = st.sampled_from([b"", b"x", b"1" * 40, b"2" * 40, encode_header("a", "b") + b"\0\0\0\0"])
like = st.lists(st.tuples(st.sampled_from("ac"), st.sampled_from("bd"), few), max_size=4)


@given(st.lists(st.tuples(like, st.integers(1, 9)), max_size=9), st.lists(st.integers(0, 400)))
def test_streaks_of_equal_frames_in_any_chunking(
    streaks: list[tuple[list[tuple[str, str, bytes]], int]], sizes: list[int]
) -> None:
    sent = [item for items, times in streaks for item in items * times]
    stream = b"".join(encode_frame(encode_header(t, m), data) for t, m, data in sent)
    decoder = FrameDecoder()
    assert decode(decoder, cut(stream, sizes)) == sent
    assert not decoder.mid_message


@given(st.lists(st.sampled_from([(0, 0), (0, 1), (1, 0), (2, 2), (3, 3)]), max_size=20))
def test_messages_one_by_one_of_changing_topic_and_size(kinds: list[tuple[int, int]]) -> None:
    sent = [("ab"[t % 2], "c", bytes([i]) * (1, 2, 5000, 300)[n]) for i, (t, n) in enumerate(kinds)]
    decoder = FrameDecoder(max_message_bytes=4999)
    found = [decode(decoder, [encode_frame(encode_header(t, m), data)]) for t, m, data in sent]
    assert found == [[item] if len(item[2]) < 5000 else [] for item in sent]


@given(
    st.lists(
        st.tuples(st.sampled_from([0, 0, 1]), st.sampled_from([2, 2, 3, 5000]), st.integers(0, 9)),
        max_size=20,
    )
)
def test_a_lone_message_is_taken_in_one_step_or_not_at_all(
    kinds: list[tuple[int, int, int]],
) -> None:
    """What `lone` refuses comes by `received`; the room it leaves may be asked for before or after."""
    decoder, rest, sent, found = FrameDecoder(), b"", [], []
    room = None
    for topic, size, late in kinds:
        data = bytes([len(sent)]) * size
        sent.append(("ab"[topic], "c", data))
        frame = rest + encode_frame(encode_header("ab"[topic], "c"), data)
        # Some come in one read, of others the end comes with the next.
        frame, rest = (frame, b"") if late < 7 else (frame[:-1], frame[-1:])
        while frame:
            space = decoder.get_buffer() if room is None else room
            count = min(len(space), len(frame))
            space[:count], frame = frame[:count], frame[count:]
            lone = decoder.lone(count)
            if lone is not None:
                names = header_names(decoder.header)
                assert names is not None
                found.append((*names, lone))
                continue
            room = None
            for header, payloads, _ in decoder.received(count):
                names = header_names(header)
                assert names is not None
                found += [(*names, bytes(view)) for view in payloads]
            if decoder.expects_lone:
                room = decoder.get_buffer()
    assert found == (sent[:-1] if rest else sent)


def test_nothing_is_delivered_after_noise_although_it_looks_like_the_last_message() -> None:
    frame = encode_frame(encode_header("a", "b"), b"12")
    decoder = FrameDecoder()
    assert len(decode(decoder, [frame, frame])) == 2
    assert len(decode(decoder, [frame + b"\xff" * 9])) == 1
    assert decoder.error is not None
    assert decode(decoder, [frame]) == []


@pytest.mark.parametrize("odd", ["a", "c"])
def test_one_frame_of_another_topic_or_size_among_equal_ones(odd: str) -> None:
    sent = [("a", "b", bytes([i])) for i in range(20)]
    sent[11] = (odd, "b", b"odd" if odd == "a" else b"o")
    stream = b"".join(encode_frame(encode_header(t, m), data) for t, m, data in sent)
    assert decode(FrameDecoder(), [stream]) == sent


def test_payload_that_looks_like_a_frame_is_not_one() -> None:
    frame = encode_frame(encode_header("a", "b"), b"12")
    sent = [("a", "b", frame)] * 7
    stream = b"".join(encode_frame(encode_header(t, m), data) for t, m, data in sent)
    assert decode(FrameDecoder(), [stream]) == sent


def test_header_that_continues_an_old_one_is_told_apart() -> None:
    sent = [("a", "b", b"x" * 9), ("a", "bc", b"y"), ("a", "b", b""), ("", "", b"z")]
    stream = b"".join(encode_frame(encode_header(t, m), data) for t, m, data in sent)
    assert decode(FrameDecoder(), [stream]) == sent


@pytest.mark.parametrize("size", [16 * 1024, 300_000, 5_000_000])
def test_large_messages_between_small_ones(size: int) -> None:
    header = encode_header("image", "sensor_msgs.Image")
    big = bytes(range(256)) * (size // 256)
    stream = encode_frame(header, b"1") + encode_frame(header, big) + encode_frame(header, b"2")
    decoder = FrameDecoder()
    chunks = [stream[i : i + 65536] for i in range(0, len(stream), 65536)]
    assert [data for _, _, data in decode(decoder, chunks)] == [b"1", big, b"2"]


def test_memory_follows_what_came_not_what_was_announced() -> None:
    decoder = FrameDecoder(max_message_bytes=2**31)
    header = encode_header("a", "b")
    assert decoder.feed(header + (2**31 - 1).to_bytes(4, "big") + b"x" * 1000) == []
    assert len(decoder.get_buffer()) < 100_000
    assert decoder.mid_message


def test_memory_is_given_back_after_a_large_message() -> None:
    decoder = FrameDecoder()
    header = encode_header("a", "b")
    decoder.feed(encode_frame(header, bytes(4_000_000)))
    for _ in range(200):
        decoder.feed(encode_frame(header, b"small"))
    assert len(decoder.get_buffer()) <= 256 * 1024


def test_too_large_message_is_drained_and_the_next_delivered() -> None:
    decoder = FrameDecoder(max_message_bytes=100)
    header = encode_header("a", "b")
    stream = encode_frame(header, b"1") + encode_frame(header, bytes(50_000))
    stream += encode_frame(header, b"2")
    runs = [run for i in range(0, len(stream), 777) for run in decoder.feed(stream[i : i + 777])]
    assert [bytes(view) for run in runs for view in run.payloads] == [b"1", b"2"]
    assert [run.oversized for run in runs if run.oversized] == [50_000]
    assert decoder.error is None


@pytest.mark.parametrize(
    "noise", [b"GET / HTTP/1.1\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc", b"\xff" * 40]
)
def test_noise_is_a_violation_and_nothing_after_it_counts(noise: bytes) -> None:
    decoder = FrameDecoder()
    good = encode_frame(encode_header("a", "b"), b"1")
    assert len(decoder.feed(good + noise)) == 1
    assert isinstance(decoder.error, FrameError)
    assert decoder.feed(good) == []


def test_names_of_1024_bytes_are_the_longest() -> None:
    longest = "é" * 512
    header = encode_header(longest, longest)
    assert header_names(header) == (longest, longest)
    with pytest.raises(FrameError, match="1025"):
        encode_header("a" * 1025, "b")


def test_names_that_are_not_utf8_keep_the_stream() -> None:
    decoder = FrameDecoder()
    (run,) = decoder.feed(b"\x00\x01\xff\x00\x01\xfe\x00\x00\x00\x01x")
    assert header_names(run.header) is None
    assert decoder.error is None


@given(st.binary(max_size=400), st.integers(1, 50))
def test_garbage_never_raises(garbage: bytes, step: int) -> None:
    decoder = FrameDecoder(max_message_bytes=1000)
    for i in range(0, len(garbage), step):
        decoder.feed(garbage[i : i + step])
