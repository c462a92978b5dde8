"""Frames of DDS-XRCE on a serial line, and what else comes along such a line.

A frame is ``7E source destination length(2) payload crc(2)``, little endian, everything after 7E escaped
(7E and 7D become 7D and the byte xor 20). The checksum covers the payload only. Nothing closes a frame:
it ends by its length, and a bare 7E always begins a new one. What lies between frames is not lost: it may
be text that the board prints.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

from simple_ros_firmware_bridge.crc import crc16

__all__ = ["DEFAULT_MAX_PAYLOAD", "Frame", "FrameReader", "LineCounters", "encode_frame"]

DEFAULT_MAX_PAYLOAD = 4096
_FLAG = b"\x7e"
_ESCAPE = b"\x7d"
_HEAD = 4
_CRC = 2
_MAX_TEXT = 512
_LEAST_TEXT = 3
_SURELY_TEXT = 12
_MAX_DAMAGED = 4
_LEAST_MESSAGE = 12
_SURELY_UNICODE = 6
_TEXT = re.compile(rb"[\x20-\x7d\t]{3,}")
_COLOUR = re.compile(rb"\x1b\[[0-9;]*m")


class Frame(NamedTuple):
    """One frame.

    Attributes:
        source: Address of who sent it; the agent is 0, a board 0 or 1.
        destination: Address of who it is for.
        payload: One XRCE message.
    """

    source: int
    destination: int
    payload: bytes


@dataclass
class LineCounters:
    """What came along the line.

    Attributes:
        frames: Whole and right.
        crc_errors: Whole, with a wrong checksum.
        crlf_frames: Of these, those that are right once every CR LF is LF again.
        cut_frames: Ended by the begin of another.
        oversize_frames: Announced more than the limit.
        noise_bytes: Outside of any frame.
        text_lines: Lines of text among them.
        bytes: All.
    """

    frames: int = 0
    crc_errors: int = 0
    crlf_frames: int = 0
    cut_frames: int = 0
    oversize_frames: int = 0
    noise_bytes: int = 0
    text_lines: int = 0
    bytes: int = 0

    @property
    def damaged(self) -> int:
        """Frames that were begun and did not come through."""
        return self.crc_errors + self.cut_frames + self.oversize_frames


def encode_frame(payload: bytes, source: int, destination: int) -> bytes:
    """The bytes that carry a payload."""
    body = b"".join(
        (
            bytes((source, destination)),
            len(payload).to_bytes(2, "little"),
            payload,
            crc16(payload).to_bytes(2, "little"),
        )
    )
    return _FLAG + body.replace(_ESCAPE, b"\x7d\x5d").replace(_FLAG, b"\x7d\x5e")


def _readable(line: bytearray) -> str:
    """The text of a line; empty if it is none: noise has letters too, and rarely many in a row."""
    line = bytearray(_COLOUR.sub(b"", line))
    if (text := _unicode(line)) and not text.isascii():
        return text
    runs: list[bytes] = _TEXT.findall(line)
    if 5 * sum(map(len, runs)) < 4 * len(line):
        runs = [run for run in runs if len(run) >= _SURELY_TEXT]
    text = b" ".join(runs).decode("ascii").strip()
    return text if len(text) >= _LEAST_TEXT else ""


def _unicode(line: bytearray) -> str:
    """The text of a line in UTF-8; empty if it is none, or so short that noise may look like it."""
    try:
        text = line.decode().replace("\t", " ").strip()
    except UnicodeDecodeError:
        return ""
    return text if len(text) >= _SURELY_UNICODE and text.isprintable() else ""


def _unescaped(raw: bytes) -> bytes:
    """Without escapes; one that is not whole yet is left out, several in a row are one."""
    first, *rest = raw.split(_ESCAPE)
    if not rest:
        return first
    parts = [first]
    for part in rest:
        if part:
            parts.append(bytes((part[0] ^ 0x20,)))
            parts.append(part[1:])
    return b"".join(parts)


class FrameReader:
    """Takes bytes in any portions, gives frames. Its memory is bounded, whatever comes.

    Args:
        max_payload: Longer ones are not believed.
    """

    def __init__(self, max_payload: int = DEFAULT_MAX_PAYLOAD) -> None:
        self.counters = LineCounters()
        self._max_payload = max_payload
        self._raw = bytearray()
        self._in_frame = False
        self._needs = 0
        self._broken = b""
        self._text = bytearray()
        self._damaged: list[bytes] = []

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that are complete with these bytes."""
        self.counters.bytes += len(data)
        frames: list[Frame] = []
        del self._damaged[:-_MAX_DAMAGED]
        first, *rest = data.split(_FLAG)
        self._take(first, frames)
        for segment in rest:
            self._begin()
            self._take(segment, frames)
        return frames

    def take_text(self) -> list[str]:
        """Lines of text that came between frames, each told once."""
        *lines, self._text = self._text.replace(b"\r", b"\n").split(b"\n")
        found = [text for line in lines if (text := _readable(line))]
        self.counters.text_lines += len(found)
        return found

    def take_damaged(self) -> list[bytes]:
        """What is left of payloads that did not come through, each told once; the latest of many."""
        damaged, self._damaged = self._damaged, []
        return damaged[-_MAX_DAMAGED:]

    def _begin(self) -> None:
        if self._in_frame and self._raw:
            self.counters.cut_frames += 1
            self._damaged.append(_unescaped(bytes(self._raw))[_HEAD:])
        self._judge_broken()
        self._raw.clear()
        self._in_frame = True
        self._needs = _HEAD

    def _take(self, segment: bytes, frames: list[Frame]) -> None:
        if not self._in_frame:
            self._between(segment)
            return
        self._raw += segment
        # An escape only makes it longer, so fewer raw bytes than needed are never enough.
        if len(self._raw) < self._needs:
            return
        body = _unescaped(bytes(self._raw))
        if len(body) < _HEAD:
            return
        size = int.from_bytes(body[2:4], "little")
        if size > self._max_payload:
            self.counters.oversize_frames += 1
            self._damaged.append(body[_HEAD:])
            self._end_frame(self._split_raw(_HEAD)[1])
            return
        end = _HEAD + size + _CRC
        self._needs = end
        if len(body) >= end:
            self._complete(body, end, frames)

    def _complete(self, body: bytes, end: int, frames: list[Frame]) -> None:
        payload = body[_HEAD : end - _CRC]
        raw, after = self._split_raw(end) if len(body) > end else (bytes(self._raw), b"")
        if crc16(payload) == int.from_bytes(body[end - _CRC : end], "little"):
            self.counters.frames += 1
            frames.append(Frame(body[0], body[1], payload))
            self._end_frame(after)
        else:
            self.counters.crc_errors += 1
            self._damaged.append(payload)
            self._broken = raw
            self._end_frame(after)

    def _split_raw(self, count: int) -> tuple[bytes, bytes]:
        """The raw bytes that make the first ``count``, and those behind them."""
        raw = bytes(self._raw)
        position = 0
        for _ in range(count):
            while raw[position] == _ESCAPE[0]:
                position += 1
            position += 1
        return raw[:position], raw[position:]

    def _end_frame(self, after: bytes) -> None:
        self._in_frame = False
        self._raw.clear()
        self._between(after)

    def _between(self, noise: bytes) -> None:
        if not noise:
            return
        self.counters.noise_bytes += len(noise)
        if self._broken:
            room = 2 * self._max_payload - len(self._broken)
            self._broken += noise[: max(0, room)]
        else:
            if len(noise) >= _LEAST_MESSAGE and 0 in noise:
                self._damaged.append(noise[1 + _HEAD :])  # no text: a frame whose flag was hit
            self._text += noise
            if len(self._text) > _MAX_TEXT:
                del self._text[:-_MAX_TEXT]

    def _judge_broken(self) -> None:
        """Whether the frame with the wrong checksum is right without the CR that a driver put in."""
        broken, self._broken = self._broken, b""
        if b"\r\n" not in broken:
            return
        body = _unescaped(broken.replace(b"\r\n", b"\n"))
        end = _HEAD + int.from_bytes(body[2:4], "little") + _CRC
        if len(body) >= end and crc16(body[_HEAD : end - _CRC]) == int.from_bytes(
            body[end - _CRC : end], "little"
        ):
            self.counters.crlf_frames += 1
