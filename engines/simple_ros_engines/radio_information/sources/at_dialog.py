"""Questions to a modem and its answers, AT commands as of ITU-T V.250: pure."""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["AtAnswer", "AtDialog"]

_LONGEST = 4096
_MOST_LINES = 200
_REFUSED = re.compile(r"(ERROR|\+CM[ES] ERROR:.*|ABORTED|NO CARRIER)")


@dataclass(frozen=True, slots=True)
class AtAnswer:
    """What a modem said to a command.

    Attributes:
        command: The command.
        lines: What came before the final word, without the echo. Words that the modem says unasked can
            be among them.
        refused: The final word, if it was none of assent.
    """

    command: str
    lines: tuple[str, ...]
    refused: str = ""

    @property
    def text(self) -> str:
        """All lines."""
        return "\n".join(self.lines)


class AtDialog:
    """One question at a time."""

    def __init__(self) -> None:
        self._buffer = b""
        self._command: str | None = None
        self._lines: list[str] = []

    def ask(self, command: str) -> bytes:
        """The bytes of a command. An unanswered one before it is given up."""
        self._command, self._lines = command, []
        return f"{command}\r".encode("ascii")

    def receive(self, data: bytes) -> AtAnswer | None:
        """Bytes came; gives the answer if they ended it."""
        *lines, rest = re.split(rb"[\r\n]+", self._buffer + data)
        # A line that never ends is noise, such as of another speed.
        self._buffer = rest if len(rest) <= _LONGEST else b""
        found = None
        for raw in lines:
            found = self._line(raw.decode("ascii", "replace").strip()) or found
        return found

    def _line(self, line: str) -> AtAnswer | None:
        command = self._command
        if command is None or not line or line == command:
            return None
        if line == "OK" or _REFUSED.fullmatch(line):
            self._command = None
            return AtAnswer(command, tuple(self._lines), "" if line == "OK" else line)
        if len(self._lines) < _MOST_LINES:
            self._lines.append(line)
        return None
