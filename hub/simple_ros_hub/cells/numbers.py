"""What a cell counts, and rates from it over a window. Pure."""

from __future__ import annotations

from collections import deque

__all__ = ["CellNumbers"]

_WINDOW_S = 10.0
_MOST = 10_000


class CellNumbers:
    """Counts.

    Args:
        now_s: When it was made.

    Attributes:
        executions: In all, failed ones too.
        errors: Executions that failed.
        skipped: Executions that were not tried.
        hook_errors: Hooks that raised.
        observer_errors: Times an observer raised.
    """

    def __init__(self, now_s: float) -> None:
        self.executions = 0
        self.errors = 0
        self.skipped = 0
        self.hook_errors = 0
        self.observer_errors = 0
        self._begun_s = now_s
        self._last_s = now_s
        self._runs: deque[tuple[float, bool]] = deque(maxlen=_MOST)
        self._updates: deque[float] = deque(maxlen=_MOST)

    def began(self, now_s: float) -> None:
        """The cell was started."""
        self._begun_s = self._last_s = now_s

    def executed(self, now_s: float, *, failed: bool) -> None:
        """It was executed."""
        self.executions += 1
        self.errors += failed
        self._last_s = now_s
        self._runs.append((now_s, failed))

    def parameter_set(self, now_s: float) -> None:
        """A parameter has a new value."""
        self._updates.append(now_s)

    def idle_s(self, now_s: float) -> float:
        """Since the last execution, or the start."""
        return max(0.0, now_s - self._last_s)

    def metrics(self, now_s: float) -> dict[str, float]:
        """Rates over the last 10 s, or since the start if that is later."""
        since_s = max(self._begun_s, now_s - _WINDOW_S)
        span_s = max(0.1, now_s - since_s)
        runs = [failed for at_s, failed in self._runs if at_s >= since_s]
        updates = sum(at_s >= since_s for at_s in self._updates)
        return {
            "execution_rate": len(runs) / span_s,
            "error_rate": sum(runs) / len(runs) if runs else 0.0,
            "parameter_update_rate": updates / span_s,
            "last_updated": now_s,
        }
