"""A circuit breaker: after repeated failures nothing is tried for a while. Pure."""

from __future__ import annotations

from enum import Enum

from simple_ros.errors import ConfigError

__all__ = ["BreakerState", "CircuitBreaker"]


class BreakerState(Enum):
    """closed: everything is tried; open: nothing is; half open: one trial is under way."""

    CLOSED = "closed"
    OPEN = "open"
    HALF_OPEN = "half open"


class CircuitBreaker:
    """Ask `allows` before each try, and tell how it went.

    Args:
        failures: In a row, that open it.
        retry_s: How long it stays open at first; doubles with every trial that fails.
        max_retry_s: At most.

    Raises:
        ConfigError: A number makes no sense.
    """

    def __init__(self, failures: int = 3, retry_s: float = 1.0, max_retry_s: float = 30.0) -> None:
        if failures < 1 or retry_s <= 0 or max_retry_s < retry_s:
            raise ConfigError("a circuit breaker needs failures of at least 1 and times above 0")
        self.state = BreakerState.CLOSED
        self.last_error = ""
        self._most = failures
        self._first_s = retry_s
        self._longest_s = max_retry_s
        self._failures = 0
        self._wait_s = retry_s
        self._again_s = 0.0

    def allows(self, now_s: float) -> bool:
        """Whether to try now. After it was open one call is let through as a trial."""
        if self.state is BreakerState.CLOSED:
            return True
        if self.state is BreakerState.OPEN and now_s >= self._again_s:
            self.state = BreakerState.HALF_OPEN
            return True
        return False

    def succeeded(self) -> bool:
        """A try went well; whether that closed it."""
        was_closed = self.state is BreakerState.CLOSED
        self.state, self._failures, self._wait_s = BreakerState.CLOSED, 0, self._first_s
        return not was_closed

    def failed(self, now_s: float, error: str = "") -> bool:
        """A try went wrong; whether that opened it (again: after a trial)."""
        self.last_error = error
        self._failures += 1
        if self.state is BreakerState.HALF_OPEN:
            self._wait_s = min(self._longest_s, 2 * self._wait_s)
        elif self.state is BreakerState.OPEN or self._failures < self._most:
            return False
        self.state, self._again_s = BreakerState.OPEN, now_s + self._wait_s
        return True
