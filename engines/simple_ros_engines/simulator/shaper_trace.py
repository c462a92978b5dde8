"""What drives a shaped link: samples and their sources, and a source that reads a recording. SIMULATED; pure."""

from __future__ import annotations

import csv
import io
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass

from simple_ros.errors import ConfigError

__all__ = ["Channel", "Sample", "Side", "TraceChannel", "read_trace"]


@dataclass(frozen=True, slots=True)
class Side:
    """One direction at one time.

    Attributes:
        changes: Of conditions, named as in settings (``rate_mbps``, ...).
        snr_db: Signal to noise ratio as reported; None if the channel has no radio.
        mcs: Scheme.
        bler: Share of first transmissions lost.
    """

    changes: Mapping[str, float]
    snr_db: float | None = None
    mcs: int | None = None
    bler: float | None = None


@dataclass(frozen=True, slots=True)
class Sample:
    """Both directions at one time.

    Attributes:
        sides: By direction.
        rsrp_dbm: Received power; None if the channel has no radio.
        position_m: Of the device; None if the channel has no place.
    """

    sides: Mapping[str, Side]
    rsrp_dbm: float | None = None
    position_m: tuple[float, float] | None = None


class Channel(ABC):
    """Moves on step by step.

    Attributes:
        period_s: Of a step.
    """

    period_s: float = 0.1

    @abstractmethod
    def at(self, elapsed_s: float) -> Sample:
        """How it is so long after the start; called once for each period, in order."""

    def moved_to(self, x_m: float, y_m: float) -> None:  # noqa: B027
        """The device is here; channels without a place do not mind."""


_TRACE_COLUMNS = {
    "t_s",
    "way",
    "rate_mbps",
    "delay_ms",
    "jitter_ms",
    "loss",
    "min_share",
    "max_share",
}


def read_trace(text: str, where: str = "trace") -> list[tuple[float, str, dict[str, float]]]:
    """Rows of a trace: time, direction (empty: both), changes.

    Args:
        text: CSV with a header; ``t_s``, optionally ``way`` (up, down), and any of ``rate_mbps``,
            ``delay_ms``, ``jitter_ms``, ``loss``, ``min_share``, ``max_share``. Empty cells change nothing.
        where: For errors.

    Raises:
        ConfigError: A column or a value is wrong, or times fall.
    """
    reader = csv.DictReader(io.StringIO(text))
    columns = set(reader.fieldnames or ())
    if "t_s" not in columns or not columns <= _TRACE_COLUMNS:
        raise ConfigError(
            f"{where}: columns are {sorted(columns)}, not of {sorted(_TRACE_COLUMNS)}"
        )
    rows: list[tuple[float, str, dict[str, float]]] = []
    for line, row in enumerate(reader, 2):
        try:
            at_s = float(row["t_s"])
            changes = {
                name: float(value)
                for name, value in row.items()
                if name not in ("t_s", "way") and value
            }
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{where}: line {line}: {error}") from None
        way = row.get("way") or ""
        if way not in ("", "up", "down") or (rows and at_s < rows[-1][0]):
            raise ConfigError(f"{where}: line {line}: way {way!r}, time {at_s} s")
        rows.append((at_s, way, changes))
    if not rows:
        raise ConfigError(f"{where}: no rows")
    return rows


class TraceChannel(Channel):
    """Conditions from a recording, held until the next row.

    Args:
        rows: From `read_trace`.
        period_s: How often to look.
        loop: Whether it begins again after its last row.
    """

    def __init__(
        self,
        rows: list[tuple[float, str, dict[str, float]]],
        period_s: float = 0.05,
        loop: bool = False,
    ) -> None:
        self.period_s = period_s
        self._ways = {way: _held(rows, way) for way in ("up", "down")}
        self._length_s = rows[-1][0]
        self._loop = loop

    def at(self, elapsed_s: float) -> Sample:
        """What was recorded for this time."""
        if self._loop and self._length_s > 0:
            elapsed_s %= self._length_s
        sides = {}
        for way, (times, states) in self._ways.items():
            index = bisect_right(times, elapsed_s + 1e-9)
            sides[way] = Side(states[index - 1] if index else {})
        return Sample(sides)


def _held(
    rows: list[tuple[float, str, dict[str, float]]], way: str
) -> tuple[list[float], list[dict[str, float]]]:
    """Times, and what holds from each on."""
    times, states = [], []
    state: dict[str, float] = {}
    for at_s, which, changes in rows:
        if which in ("", way):
            state = state | changes
            times.append(at_s)
            states.append(state)
    return times, states
