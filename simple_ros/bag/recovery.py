"""Saving what is whole of a bag that was never ended, or is damaged.

The file is read from front to back. Whole chunks are taken over as they are; one that fails its
checksum is left out, and reading goes on behind it. Where no record can be read any more, the rest is
given up. The file itself is never changed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema

from simple_ros.bag.errors import BagDamaged
from simple_ros.bag.examination import examine
from simple_ros.bag.scan import Found, check_magic, is_ended, opened, parsed, walk
from simple_ros.bag.unpacking import Stored, unpacked
from simple_ros.bag.writer import BagWriter

__all__ = ["Recovery", "recover"]

_MESSAGE_HEAD_BYTES = 22


@dataclass
class Recovery:
    """What was saved.

    Attributes:
        path: The new file.
        was_ended: Whether the damaged file had an end.
        messages: Messages saved.
        chunks: Chunks saved.
        damage: Each part that was left out, and why; and what came over and is of no use.
        lost_bytes: Size of the parts that were left out.
    """

    path: Path
    was_ended: bool = False
    messages: int = 0
    chunks: int = 0
    damage: tuple[BagDamaged, ...] = ()
    lost_bytes: int = 0


def recover(source: Path, target: Path) -> Recovery:
    """Write what is whole of ``source`` to a new file.

    Raises:
        BagUnavailable: A file cannot be opened.
        NotABag: ``source`` does not begin as an MCAP file.
        BagExists: There is a file ``target``.
        BagDamaged: What was written cannot be read back; ``target`` was not made.
        DiskFull: No room for it; ``target`` was not made.
    """
    with opened(source) as file, BagWriter(target, suffix=".part") as writer:
        check_magic(source, file)
        found = Recovery(target, was_ended=is_ended(file))
        saver = _Saver(source, writer, found)
        try:
            for record in walk(source, file):
                if record.opcode == Opcode.DATA_END:
                    break
                saver.take(record)
        except BagDamaged as damage:
            lost = source.stat().st_size - damage.offset
            if lost:
                found.damage = (*found.damage, damage)
                found.lost_bytes += lost
        writer.flush()
        found.messages = writer.message_count
    _check(target, found)
    return found


class _Saver:
    def __init__(self, source: Path, writer: BagWriter, found: Recovery) -> None:
        self._source = source
        self._writer = writer
        self._found = found

    def take(self, record: Found) -> None:
        """Take one record over, or note that it cannot be."""
        try:
            self._take(record)
        except BagDamaged as damage:
            self._found.damage = (*self._found.damage, damage)
            self._found.lost_bytes += record.length

    def _take(self, record: Found) -> None:
        if record.opcode == Opcode.MESSAGE:
            self._take_message(record)
            return
        content = parsed(self._source, record)
        match content:
            case Schema() | Channel():
                self._writer.copy_definition(content)
            case Chunk():
                self._take_chunk(record, content)
            case Attachment():
                self._writer.attach(
                    content.name, content.media_type, content.data, content.log_time
                )
            case Metadata():
                self._writer.note(content.name, content.metadata)
            case _:
                pass  # indexes are made anew, the header is written already

    def _take_chunk(self, record: Found, chunk: Chunk) -> None:
        try:
            content = unpacked(chunk)
        except ValueError as error:
            raise BagDamaged(self._source, record.offset, str(error)) from None
        for definition in content.definitions:
            self._writer.copy_definition(definition)
        for channel_id in {message.channel_id for message in content.messages}:
            self._check_channel(record, channel_id)
        if content.span == (chunk.message_start_time, chunk.message_end_time):
            self._writer.copy_chunk(record.raw, chunk, content)
        else:
            self._add(content.messages)  # the times in its head are wrong: it is made anew
        self._found.chunks += 1

    def _take_message(self, record: Found) -> None:
        if len(record.body) < _MESSAGE_HEAD_BYTES:
            raise BagDamaged(self._source, record.offset, "a message is too short")
        read = Message.read(ReadDataStream(BytesIO(record.body)), len(record.body))
        self._check_channel(record, read.channel_id)
        self._add(
            [Stored(read.log_time, read.channel_id, read.data, read.sequence, read.publish_time)]
        )

    def _add(self, messages: Iterable[Stored]) -> None:
        for message in messages:
            self._writer.add(
                message.channel_id,
                message.log_time,
                [message.data],
                publish_time=message.publish_time,
                sequence=message.sequence,
            )

    def _check_channel(self, record: Found, channel_id: int) -> None:
        if not self._writer.has_channel(channel_id):
            reason = f"messages of channel {channel_id}, which was not defined before"
            raise BagDamaged(self._source, record.offset, reason)


def _check(target: Path, found: Recovery) -> None:
    """Read back what was written.

    Raises:
        BagDamaged: It is not as it should be; the file is removed.
    """
    findings = examine(target)
    broken = [finding for finding in findings.errors if finding.is_structural]
    if broken or findings.messages != found.messages:
        target.unlink()
        first = broken[0].reason if broken else "messages are missing"
        raise BagDamaged(target, 0, f"what was written cannot be read back ({first})")
    kept = (BagDamaged(target, item.offset, item.reason) for item in findings.errors)
    found.damage = (*found.damage, *kept)
