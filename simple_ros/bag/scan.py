"""Reading a bag from front to back, record by record, whatever state its end is in."""

from __future__ import annotations

import os
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from struct import Struct
from struct import error as struct_error
from typing import IO, Any, NamedTuple
from zlib import crc32

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from simple_ros.bag.catalog import MAGIC
from simple_ros.bag.errors import BagDamaged, BagUnavailable, NotABag

__all__ = ["Found", "check_magic", "is_ended", "opened", "parsed", "walk"]

MAX_RECORD_BYTES = 1 << 32
_HEAD = Struct("<BQ")
_PARSERS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}


class Found(NamedTuple):
    """A record in a file.

    Attributes:
        offset: Where it begins, in bytes.
        opcode: Its kind.
        body: Its bytes after opcode and length.
    """

    offset: int
    opcode: int
    body: bytes

    @property
    def raw(self) -> bytes:
        """The record as it stands in the file."""
        return _HEAD.pack(self.opcode, len(self.body)) + self.body

    @property
    def length(self) -> int:
        """Bytes it takes in the file."""
        return _HEAD.size + len(self.body)


def opened(path: Path) -> IO[bytes]:
    """A file for reading.

    Raises:
        BagUnavailable: It cannot be opened.
    """
    try:
        return path.open("rb")
    except OSError as error:
        raise BagUnavailable(path, error) from None


def check_magic(path: Path, file: IO[bytes]) -> None:
    """Read the beginning of a file.

    Raises:
        NotABag: It does not begin as an MCAP file of version 0 does.
    """
    file.seek(0)
    magic = file.read(len(MAGIC))
    if magic == MAGIC:
        return
    if magic[:5] == MAGIC[:5] and magic[6:] == MAGIC[6:]:
        raise NotABag(path, f"it is MCAP of version {magic[5:6].decode('latin-1')!r}, not '0'")
    if not magic:
        raise NotABag(path, "it is empty")
    if magic.startswith(b"#ROSBAG"):
        raise NotABag(path, f"it is a ROS 1 bag; 'simple-ros bag convert {path} OUT.mcap' reads it")
    if magic.startswith(b"SQLite"):
        raise NotABag(path, "it is a ROS 2 bag; 'simple-ros bag convert' reads its directory")
    raise NotABag(path, f"it begins with {magic!r}, an MCAP file with {MAGIC!r}")


def is_ended(file: IO[bytes]) -> bool:
    """Whether the end of the file is the end of an MCAP file."""
    size = file.seek(0, os.SEEK_END)
    if size < 2 * len(MAGIC):
        return False
    file.seek(size - len(MAGIC))
    return file.read(len(MAGIC)) == MAGIC


def walk(path: Path, file: IO[bytes], position: int = len(MAGIC)) -> Iterator[Found]:
    """The records from a position on, up to and with the footer.

    Raises:
        BagDamaged: The file breaks off, or no record begins where one has to.
    """
    size = file.seek(0, os.SEEK_END)
    while True:
        file.seek(position)
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise BagDamaged(path, position, "the file ends here, with no end of its own")
        opcode, length = _HEAD.unpack(head)
        if opcode == 0 or length > MAX_RECORD_BYTES:
            raise BagDamaged(path, position, "no record begins here")
        if length > size - position - _HEAD.size:
            missing = length - (size - position - _HEAD.size)
            raise BagDamaged(path, position, f"a record breaks off, {missing} bytes are missing")
        found = Found(position, opcode, file.read(length))
        yield found
        if opcode == Opcode.FOOTER:
            return
        position += found.length


def parsed(path: Path, found: Found) -> McapRecord | None:
    """The record; None if it is of a kind that is not known.

    Raises:
        BagDamaged: Its bytes are no such record.
    """
    kind = _PARSERS.get(found.opcode)
    if kind is None:
        return None
    try:
        record: McapRecord = kind.read(ReadDataStream(BytesIO(found.body)))
    except (McapError, ValueError, OverflowError, MemoryError, struct_error) as error:
        reason = f"a record of kind {found.opcode} cannot be read ({error or type(error).__name__})"
        raise BagDamaged(path, found.offset, reason) from None
    if found.opcode == Opcode.ATTACHMENT and not _is_intact(found.body):
        raise BagDamaged(path, found.offset, "an attachment fails its checksum")
    return record


def _is_intact(attachment: bytes) -> bool:
    """Whether the checksum at the end of an attachment is right, or not given."""
    told = int.from_bytes(attachment[-4:], "little")
    return told in (0, crc32(attachment[:-4]))
