"""What the counters of a line mean, in words."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from simple_ros.diagnostics.status import ERROR, OK, WARN, Level
from simple_ros_firmware_bridge.serial_framing import LineCounters

__all__ = ["Judgement", "LineFacts", "Standing", "judge_line"]

_ENOUGH_BYTES = 48
_ENOUGH_S = 3.0
"""Two pings of a board that looks for its agent, and what it may print before the first of them."""
_SILENT_S = 2.0
_BAD_SHARE = 0.02


class Standing(Enum):
    """What kind of sentence it is, so that one is not told again while only its numbers change."""

    CLOSED = "closed"
    CRLF = "crlf"
    TEXT_ONLY = "text only"
    NOISE = "noise"
    STRANGER = "stranger"
    SILENT = "silent"
    NOT_CONNECTED = "not connected"
    DAMAGED = "damaged"
    GOOD = "good"


class Judgement(NamedTuple):
    """How a line is.

    Attributes:
        level: Of diagnostics.
        standing: Its kind.
        text: A sentence.
    """

    level: Level
    standing: Standing
    text: str


@dataclass(frozen=True)
class LineFacts:
    """What happened since the last look, and how things stand.

    Attributes:
        is_open: Whether the port is there.
        why_closed: If not, why.
        has_session: Whether the board has connected.
        counters: Since the last look.
        vain_bytes: Since the last message, or since the port was opened.
        vain_lines: Of text among them.
        vain_s: Seconds since then.
        silence_s: Since the last byte.
        strangers: Messages of a session that nobody here began.
        baud: What was asked for.
    """

    is_open: bool
    why_closed: str
    has_session: bool
    counters: LineCounters
    vain_bytes: int
    vain_lines: int
    vain_s: float
    silence_s: float
    strangers: int
    baud: int


def judge_line(facts: LineFacts) -> Judgement:
    """How the line is, in words."""
    new = facts.counters
    if not facts.is_open:
        why = f"the port is not open: {facts.why_closed}"
        return Judgement(ERROR, Standing.CLOSED, why)
    if new.crlf_frames:
        return Judgement(
            ERROR,
            Standing.CRLF,
            "the board turns LF into CR LF inside of messages: switch off "
            "PICO_STDIO_ENABLE_CRLF_SUPPORT in its CMakeLists",
        )
    if facts.silence_s > _SILENT_S:
        text = f"the board is silent for {facts.silence_s:.0f} s"
        if facts.has_session:
            return Judgement(ERROR, Standing.SILENT, text)
        return Judgement(WARN, Standing.SILENT, f"{text}: is it running, and is this its port?")
    if facts.vain_bytes >= _ENOUGH_BYTES and facts.vain_s >= _ENOUGH_S:
        return _judged_vain(facts)
    if not facts.has_session:
        return _judged_waiting(facts)
    if new.damaged > _BAD_SHARE * (new.frames + new.damaged):
        return Judgement(
            WARN,
            Standing.DAMAGED,
            f"{new.damaged} of {new.frames + new.damaged} messages came damaged: a bad cable?",
        )
    return Judgement(OK, Standing.GOOD, "connected")


def _judged_vain(facts: LineFacts) -> Judgement:
    if facts.vain_lines:
        text = "the board prints text and sends no messages: is it micro-ROS that runs on it?"
        return Judgement(ERROR, Standing.TEXT_ONLY, text)
    text = (
        f"{facts.vain_bytes} bytes and no message among them: is {facts.baud} baud right, and is it "
        "micro-ROS that runs on the board?"
    )
    return Judgement(ERROR, Standing.NOISE, text)


def _judged_waiting(facts: LineFacts) -> Judgement:
    if facts.strangers:
        text = "the board talks in a session that was not begun here: it has to be reset"
        return Judgement(WARN, Standing.STRANGER, text)
    return Judgement(WARN, Standing.NOT_CONNECTED, "the board has not connected yet")
