"""Putting a submessage together that came in pieces."""

from __future__ import annotations

__all__ = ["MAX_BYTES", "Reassembly"]

MAX_BYTES = 1 << 20


class Reassembly:
    """The pieces of one stream, which come in order.

    Args:
        in_middle: The stream is joined late: what comes up to the next last piece is thrown away.
    """

    def __init__(self, *, in_middle: bool = False) -> None:
        self.dropped = 0
        self._skips = in_middle
        self._seen_skipped = 0
        self._pieces = bytearray()

    def whole_came(self) -> None:
        """Something came in one piece: what follows begins at a begin."""
        self._skips = False
        self._pieces.clear()

    def add(self, piece: bytes, skipped: int, *, is_last: bool) -> bytes | None:
        """The next piece; gives the whole with the last one.

        Args:
            piece: Its bytes.
            skipped: How many messages of the stream were given up so far: a submessage that lacks a
                piece is thrown away.
            is_last: Whether it completes.
        """
        if skipped != self._seen_skipped:
            self._seen_skipped = skipped
            self._skips = self._skips or bool(self._pieces)
        if self._skips or len(self._pieces) + len(piece) > MAX_BYTES:
            self._skips = not is_last
            self.dropped += 1
            self._pieces.clear()
            return None
        self._pieces += piece
        if not is_last:
            return None
        whole = bytes(self._pieces)
        self._pieces.clear()
        return whole
