"""When a process that failed is started again: backoff, limit, giving up. Pure.

Failures are counted along the time the process has *run*; waiting for a restart does not count. So
a process that always crashes at its start is given up after ``limit`` restarts however long the
delays are, and one that crashes once a day runs for ever. The delay doubles with every restart that
still counts.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from simple_ros.errors import ConfigError

__all__ = ["GiveUp", "Respawn", "RestartHistory", "RestartIn"]


@dataclass(frozen=True, slots=True)
class Respawn:
    """How a process is started again.

    Attributes:
        limit: Most restarts within ``within_s`` seconds of running; one more failure ends it.
        within_s: How long a restart counts.
        delay_s: Before the first restart; doubles with every one that counts.
        max_delay_s: Longest delay.
        always: Restart it also after it ended with code 0.

    Raises:
        ConfigError: A number is negative, or ``within_s`` is 0.
    """

    limit: int = 5
    within_s: float = 60.0
    delay_s: float = 0.5
    max_delay_s: float = 10.0
    always: bool = False

    def __post_init__(self) -> None:
        if self.limit < 0 or self.delay_s < 0 or self.max_delay_s < 0 or self.within_s <= 0:
            raise ConfigError("numbers of respawn must not be negative, and within must not be 0")


@dataclass(frozen=True, slots=True)
class RestartIn:
    """Start it again after ``delay_s``; it is restart ``number`` of ``limit`` that count."""

    delay_s: float
    number: int
    limit: int


@dataclass(frozen=True, slots=True)
class GiveUp:
    """Do not start it again, for that reason."""

    reason: str


class RestartHistory:
    """The restarts of one process.

    Args:
        policy: None never restarts.
    """

    def __init__(self, policy: Respawn | None) -> None:
        self._policy = policy
        self._ran_s = 0.0
        self._restarts: deque[float] = deque()

    def failed(self, ran_s: float) -> RestartIn | GiveUp:
        """What to do now that it ended after ``ran_s`` seconds of running.

        Args:
            ran_s: Length of this run.
        """
        policy = self._policy
        if policy is None:
            return GiveUp("it has no respawn")
        self._ran_s += ran_s
        while self._restarts and self._restarts[0] <= self._ran_s - policy.within_s:
            self._restarts.popleft()
        counted = len(self._restarts)
        if counted >= policy.limit:
            times = "once" if counted == 1 else f"{counted} times"
            return GiveUp(f"restarted {times} within {policy.within_s:g} s of running")
        self._restarts.append(self._ran_s)
        # 2**64 delays are longer than any maximum.
        delay_s = min(policy.max_delay_s, policy.delay_s * 2 ** min(counted, 64))
        return RestartIn(delay_s, counted + 1, policy.limit)

    def forget(self) -> None:
        """Begin anew: somebody started it by hand."""
        self._ran_s = 0.0
        self._restarts.clear()
