"""As much of HTTP/1.1 as writers and readers of InfluxDB use: requests off a stream, answers as bytes.

Bodies come with a length or in chunks (RFC 9112), packed by gzip or not; a client that asks to go on before it
sends its body is told so at once, since libcurl waits a second otherwise.
"""

from __future__ import annotations

import asyncio
import json
import zlib
from dataclasses import dataclass, field
from urllib.parse import parse_qs, urlsplit

__all__ = ["MAX_HEAD", "Answer", "Request", "framed", "read_request", "refused"]

MAX_HEAD = 32 * 1024
_MAX_BODY = 25 * 1024 * 1024
_REASONS = {
    200: "OK", 204: "No Content", 400: "Bad Request", 404: "Not Found", 413: "Too Large",
    503: "Service Unavailable",
}  # fmt: skip


@dataclass(slots=True)
class Answer:
    """What is said to a request."""

    status: int
    body: bytes = b""
    content_type: str = "application/json; charset=utf-8"


@dataclass(slots=True)
class Request:
    """What was asked.

    Attributes:
        method: Such as ``POST``.
        path: Without the query.
        query: Of names that come twice, the last.
        headers: By their names in small letters.
        body: Unpacked.
    """

    method: str
    path: str
    query: dict[str, str]
    headers: dict[str, str] = field(default_factory=dict)
    body: bytes = b""

    @property
    def is_last(self) -> bool:
        """Whether the client closes the connection after it."""
        return self.headers.get("connection", "").lower() == "close"


def refused(status: int, code: str, message: str) -> Answer:
    """An answer that says what is wrong, in InfluxDB's form."""
    return Answer(status, json.dumps({"code": code, "message": message, "error": message}).encode())


def framed(answer: Answer) -> bytes:
    """An answer as it is sent."""
    head = (
        f"HTTP/1.1 {answer.status} {_REASONS[answer.status]}\r\n"
        f"Content-Type: {answer.content_type}\r\nContent-Length: {len(answer.body)}\r\n"
        "X-Influxdb-Version: 2.0-simple-ros\r\n\r\n"
    )
    return head.encode() + answer.body


async def read_request(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> Request | Answer:
    """The next request; an answer if it is none that can be read, after which the connection is of no use.

    Raises:
        IncompleteReadError: The client left.
    """
    try:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
    except asyncio.LimitOverrunError:
        return refused(413, "invalid", f"the head is over {MAX_HEAD} bytes")
    first, *lines = head[:-4].split("\r\n")
    words = first.split(" ")
    if len(words) != 3:
        return refused(400, "invalid", "that is no HTTP request")
    pairs = (line.partition(":") for line in lines)
    headers = {name.strip().lower(): value.strip() for name, _, value in pairs}
    if headers.get("expect", "").lower() == "100-continue":
        writer.write(b"HTTP/1.1 100 Continue\r\n\r\n")
    body = await _body(reader, headers)
    if body is None:
        return refused(413, "invalid", f"the body must be of at most {_MAX_BODY} bytes")
    if headers.get("content-encoding") == "gzip":
        body = _unpacked(body)
        if body is None:
            return refused(400, "invalid", "the body is no gzip, or too large")
    try:
        target = urlsplit(words[1])
    except ValueError:
        return refused(400, "invalid", f"{words[1]!r} is no target")
    query = {name: values[-1] for name, values in parse_qs(target.query).items()}
    return Request(words[0], target.path, query, headers, body)


async def _body(reader: asyncio.StreamReader, headers: dict[str, str]) -> bytes | None:
    if headers.get("transfer-encoding", "").lower() == "chunked":
        return await _chunks(reader)
    length = headers.get("content-length", "0")
    is_number = length.isascii() and length.isdigit() and len(length) <= 20
    if not is_number or int(length) > _MAX_BODY:
        return None
    return await reader.readexactly(int(length))


async def _chunks(reader: asyncio.StreamReader) -> bytes | None:
    whole = bytearray()
    while True:
        line = await _line(reader)
        try:
            size = int(line.partition(b";")[0], 16)
        except ValueError:
            return None
        if size < 0 or len(whole) + size > _MAX_BODY:
            return None
        if not size:
            while await _line(reader):
                continue
            return bytes(whole)
        whole += await reader.readexactly(size)
        if await _line(reader):
            return None


async def _line(reader: asyncio.StreamReader) -> bytes:
    try:
        return (await reader.readuntil(b"\r\n"))[:-2]
    except asyncio.LimitOverrunError:
        return b"-"


def _unpacked(body: bytes) -> bytes | None:
    unpacker = zlib.decompressobj(16 + zlib.MAX_WBITS)
    try:
        data = unpacker.decompress(body, _MAX_BODY)
    except zlib.error:
        return None
    return data if unpacker.eof else None
