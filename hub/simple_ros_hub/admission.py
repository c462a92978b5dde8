"""Who may use the radio at all: at most so many users. Pure.

Who is in stays in; a new one waits until somebody has left. Of those who wait the highest priority goes
first, then who came first.
"""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros.errors import ConfigError

__all__ = ["Admission"]


@dataclass(slots=True)
class _User:
    priority: int
    since_s: float
    seen_s: float
    is_in: bool = False


class Admission:
    """Keeps the list.

    Args:
        max_users: Most at a time.
        leaves_after_s: Silence after which a user has left.

    Raises:
        ConfigError: Less than one user, or no time.
    """

    def __init__(self, max_users: int, leaves_after_s: float = 10.0) -> None:
        if max_users < 1 or leaves_after_s <= 0:
            raise ConfigError(
                f"{max_users} users, gone after {leaves_after_s:g} s, is no admission"
            )
        self.max_users = max_users
        self._leaves_after_s = leaves_after_s
        self._users: dict[str, _User] = {}

    def seen(self, key: str, priority: int, now_s: float) -> None:
        """A user wants something."""
        user = self._users.get(key)
        if user is None:
            self._users[key] = _User(priority, now_s, now_s)
        else:
            user.priority, user.seen_s = priority, now_s

    def decide(self, now_s: float) -> tuple[tuple[str, ...], dict[str, str]]:
        """Who is in, in the order they came, and who is not, with the reason."""
        for key in [k for k, u in self._users.items() if now_s - u.seen_s > self._leaves_after_s]:
            del self._users[key]
        waiting = [key for key, user in self._users.items() if not user.is_in]
        waiting.sort(key=lambda key: (-self._users[key].priority, self._users[key].since_s))
        free = self.max_users - (len(self._users) - len(waiting))
        for key in waiting[: max(0, free)]:
            self._users[key].is_in = True
        inside = tuple(key for key, user in self._users.items() if user.is_in)
        refused = {
            key: f"{len(inside)} of at most {self.max_users} users are admitted; {place} in the queue"
            for place, key in enumerate(waiting[max(0, free) :], 1)
        }
        return inside, refused
