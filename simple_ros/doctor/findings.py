"""What a check found, and how it is told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from simple_ros.graph_view import printable

__all__ = ["Finding", "Level", "error", "ok", "report_json", "report_lines", "summary", "warning"]


class Level(Enum):
    """How bad it is."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Finding:
    """The outcome of one check.

    Attributes:
        check: What was examined, in a word or two.
        level: See `Level`.
        text: One line.
        fix: What to do about it, one line; empty when there is nothing to do.
    """

    check: str
    level: Level
    text: str
    fix: str = ""


def ok(check: str, text: str) -> Finding:
    """All is well, and this is how it is."""
    return Finding(check, Level.OK, text)


def warning(check: str, text: str, fix: str = "") -> Finding:
    """Something works less well than it could, or will fail under some condition."""
    return Finding(check, Level.WARNING, text, fix)


def error(check: str, text: str, fix: str) -> Finding:
    """Something does not work."""
    return Finding(check, Level.ERROR, text, fix)


def report_lines(findings: Sequence[Finding], *, verbose: bool) -> list[tuple[Level, str]]:
    """The lines for people, each with its level; the good ones only if ``verbose``."""
    lines = []
    for finding in findings:
        if finding.level is Level.OK and not verbose:
            continue
        head = finding.level.value.ljust(len(Level.WARNING.value))
        lines.append((finding.level, f"{head}  {finding.check}: {printable(finding.text)}"))
        if finding.fix:
            lines.append((Level.OK, f"         fix: {printable(finding.fix)}"))
    return lines


def summary(findings: Sequence[Finding]) -> str:
    """How many there are of each level."""
    errors, warnings = (_count(findings, level) for level in (Level.ERROR, Level.WARNING))
    good = len(findings) - errors - warnings
    return (
        f"{len(findings)} findings: {good} ok, "
        f"{warnings} warning{'' if warnings == 1 else 's'}, {errors} error{'' if errors == 1 else 's'}"
    )


def report_json(findings: Sequence[Finding]) -> dict[str, Any]:
    """The whole report for programs."""
    return {
        "ok": _count(findings, Level.OK),
        "warnings": _count(findings, Level.WARNING),
        "errors": _count(findings, Level.ERROR),
        "findings": [
            {
                "check": finding.check,
                "level": finding.level.value,
                "text": finding.text,
                "fix": finding.fix,
            }
            for finding in findings
        ],
    }


def _count(findings: Sequence[Finding], level: Level) -> int:
    return sum(finding.level is level for finding in findings)
