"""Markdown pages as values: their links, headings and code blocks, and the shell sessions they show."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

_FENCE = re.compile(r"^(?P<fence>`{3,}|:{3,})(?P<info>.*)$")
_HEADING = re.compile(r"^#{1,6} +(?P<title>.+?) *#*$")
_LINK = re.compile(r"!?\[[^\]]*\]\((?P<target>[^)\s]+)\)")
_CODE = re.compile(r"`[^`]*`")
_NAMED = re.compile(r"^(?:#|//) (?P<name>[\w-]+\.\w+)$")
_TERMINAL = re.compile(r"^# terminal (?P<number>\d+)$")
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e-?\d+)?")
_UNIT = re.compile(r"# (?:us|ms|s)\b")
_SPACES = re.compile(r" +")

MORE = "..."
CTRL_C = "^C"


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text and the line it begins at, from 1."""

    language: str
    text: str
    line: int

    @property
    def file_name(self) -> str:
        """The file it shows, by a first line ``# name.py`` or ``// name.proto``; else empty."""
        match = _NAMED.match(self.text.partition("\n")[0])
        return match["name"] if match else ""


@dataclass
class Command:
    """A command of a session, and the lines it prints.

    ``more`` tells that further lines follow, ``interrupted`` that the reader ends it with Ctrl-C.
    """

    text: str
    line: int
    output: list[str] = field(default_factory=list)
    more: bool = False
    interrupted: bool = False

    @property
    def stays(self) -> bool:
        """Whether it goes on: it says so, or prints nothing to wait for."""
        return not self.interrupted and (self.more or not self.output)


@dataclass
class Session:
    """One ``console`` block: commands one after another in one terminal, 0 for no particular one."""

    terminal: int
    commands: list[Command]


@dataclass(frozen=True)
class Page:
    """A Markdown file."""

    path: Path
    text: str

    @classmethod
    def read(cls, path: Path) -> Page:
        return cls(path, path.read_text(encoding="utf-8"))

    def blocks(self) -> list[Block]:
        """Every fenced block."""
        return [block for block, _ in self._parts() if block is not None]

    def prose(self) -> list[tuple[int, str]]:
        """Every line outside the fenced blocks, with its number."""
        return [line for block, line in self._parts() if block is None]

    def _parts(self) -> Iterator[tuple[Block | None, tuple[int, str]]]:
        lines = iter(enumerate(self.text.splitlines(), 1))
        for number, line in lines:
            opening = _FENCE.match(line)
            if opening is None:
                yield None, (number, line)
                continue
            body = []
            for _, inner in lines:
                if inner.rstrip() == opening["fence"]:
                    break
                body.append(inner)
            yield Block(opening["info"].strip(), "\n".join(body), number), (number, line)

    def links(self) -> list[tuple[int, str]]:
        """Targets of links, with their lines; not those in code."""
        return [
            (number, match["target"])
            for number, line in self.prose()
            for match in _LINK.finditer(_CODE.sub("``", line))
        ]

    def anchors(self) -> set[str]:
        """The anchors of the headings, as GitHub makes them."""
        found: dict[str, int] = {}
        for _, line in self.prose():
            match = _HEADING.match(line)
            if match:
                slug = slug_of(match["title"])
                found[slug] = found.get(slug, 0) + 1
        repeated = {f"{slug}-{n}" for slug, count in found.items() for n in range(1, count)}
        return found.keys() | repeated


def slug_of(title: str) -> str:
    """GitHub's anchor of a heading."""
    kept = re.sub(r"[^\w\- ]", "", title.lower())
    return kept.strip().replace(" ", "-")


def session_of(block: Block) -> Session:
    """Read a ``console`` block.

    ``$`` begins a command and ``>`` carries it on; other lines are what it prints. A last line ``...``
    stands for more of the same, ``^C`` for Ctrl-C. A first line ``# terminal 2`` says where it is typed.
    """
    session = Session(0, [])
    for number, line in enumerate(block.text.splitlines(), block.line + 1):
        terminal = _TERMINAL.match(line)
        if terminal and not session.commands:
            session.terminal = int(terminal["number"])
        elif line.startswith("$ "):
            session.commands.append(Command(line[2:], number))
        elif not session.commands:
            raise ValueError(f"line {number}: output before any command: {line!r}")
        else:
            _add_output(session.commands[-1], line)
    return session


def _add_output(command: Command, line: str) -> None:
    if line.startswith("> ") and not command.output:
        command.text += "\n" + line[2:]
    elif line == MORE:
        command.more = True
    elif line == CTRL_C:
        command.interrupted = True
    else:
        command.output.append(line)


def shape_of(line: str) -> str:
    """A line with its numbers, units of time and column widths blanked: what two runs share."""
    return _SPACES.sub(" ", _UNIT.sub("# s", _NUMBER.sub("#", line))).rstrip()
