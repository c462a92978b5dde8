"""First lines, and what the kernel says about code points: whatever comes, nothing but an answer."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros_engines.link_shaper.dscp import parse_code_points
from simple_ros_engines.link_shaper.hello import (
    BadHello,
    Hello,
    answer_line,
    hello_line,
    parse_hello,
    refusal,
)


@given(st.text(), st.text(), st.text())
def test_a_hello_is_understood(source: str, target: str, address: str) -> None:
    hello = Hello(source, target, address)
    line = hello_line(hello)
    assert line.count(b"\n") == 1
    assert parse_hello(line) == hello
    assert hello.watches == (not address)


@given(st.text())
def test_an_answer_is_understood(reason: str) -> None:
    assert refusal(answer_line(reason)) == reason


@given(st.binary())
def test_anything_else_is_refused(line: bytes) -> None:
    with pytest.raises(BadHello):
        parse_hello(line)


def test_brackets_without_end_are_refused() -> None:
    with pytest.raises(BadHello):
        parse_hello(b"[" * 4096)


def _answer(kind: int, body: bytes) -> bytes:
    length = 16 + len(body)
    return struct.pack("=IHHII", length, kind, 0, 1, 0) + body + bytes(-length % 4)


def _connection(local: int, peer: int, tos: int) -> bytes:
    body = bytearray(72)
    struct.pack_into(">HH", body, 4, local, peer)
    return bytes(body) + struct.pack("=HHB3x", 5, 5, tos)


def test_code_points_are_found_by_ports() -> None:
    data = _answer(20, _connection(4711, 7310, 46 << 2)) + _answer(20, _connection(7310, 4711, 0))
    assert parse_code_points(data) == ({(4711, 7310): 46, (7310, 4711): 0}, False)
    assert parse_code_points(data + _answer(3, bytes(4)))[1]


@given(st.binary(max_size=200))
def test_garbage_of_the_kernel_does_no_harm(data: bytes) -> None:
    parse_code_points(data)
    parse_code_points(_answer(20, data))
