"""What the counters of a line mean, in words."""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros.diagnostics.status import ERROR, OK, WARN, Level
from simple_ros_firmware_bridge.serial_framing import LineCounters

__all__ = ["LineFacts", "judge_line"]

_ENOUGH_BYTES = 256
_BAD_SHARE = 0.02


@dataclass(frozen=True)
class LineFacts:
    """What happened since the last look, and how things stand.

    Attributes:
        is_open: Whether the port is there.
        why_closed: If not, why.
        has_session: Whether the board has connected.
        counters: Since the last look.
        silence_s: Since the last byte.
        strangers: Messages of a session that nobody here began.
        baud: What was asked for.
    """

    is_open: bool
    why_closed: str
    has_session: bool
    counters: LineCounters
    silence_s: float
    strangers: int
    baud: int


def judge_line(facts: LineFacts) -> tuple[Level, str]:
    """A level of diagnostics and a sentence."""
    new = facts.counters
    if not facts.is_open:
        return ERROR, f"the port is not there: {facts.why_closed}"
    if new.crlf_frames:
        return ERROR, (
            "the board turns LF into CR LF inside of messages: switch off "
            "PICO_STDIO_ENABLE_CRLF_SUPPORT in its CMakeLists"
        )
    if not new.frames and new.bytes >= _ENOUGH_BYTES:
        return ERROR, (
            f"{new.bytes} bytes and no message among them: is {facts.baud} baud right, and is it "
            "micro-ROS that runs on the board?"
        )
    if facts.strangers and not facts.has_session:
        return WARN, "the board talks in a session that was not begun here: it has to be reset"
    if facts.silence_s > 2.0:
        return (
            ERROR if facts.has_session else WARN
        ), f"the board is silent for {facts.silence_s:.0f} s"
    if not facts.has_session:
        return WARN, "the board has not connected yet"
    if new.damaged > _BAD_SHARE * (new.frames + new.damaged):
        return (
            WARN,
            f"{new.damaged} of {new.frames + new.damaged} messages came damaged: a bad cable?",
        )
    return OK, "connected"
