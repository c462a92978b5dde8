"""Which score counts: what people say goes before what programs say, and what is old counts no more. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from simple_ros_engines.network_exposure.mos.estimator import is_score

__all__ = ["Judge", "Judgement", "Judgements"]

_MOST = 1000


class Judge(Enum):
    """Who gave a score."""

    HUMAN = "human"
    AUTOMATIC = "automatic"


@dataclass(frozen=True, slots=True)
class Judgement:
    """A score of a group of topics.

    Attributes:
        group: Its name.
        topics: Its topics, as relayed.
        score: 1 to 5.
        judge: Who gave it.
        heard_s: When.
    """

    group: str
    topics: tuple[str, ...]
    score: float
    judge: Judge
    heard_s: float


class Judgements:
    """The scores in force.

    Args:
        timeout_s: A score that is not said again for so long is forgotten.
    """

    def __init__(self, timeout_s: float = 5.0) -> None:
        self._timeout_s = timeout_s
        self._newest: dict[tuple[str, Judge], Judgement] = {}

    def came(
        self, group: str, topics: Iterable[str], score: float, judge: Judge, now_s: float
    ) -> bool:
        """A score was given; 0 takes it back. Returns whether it made sense."""
        key = (group, judge)
        if score == 0:
            self._newest.pop(key, None)
            return True
        if not is_score(score) or (key not in self._newest and len(self._newest) >= _MOST):
            return False
        self._newest[key] = Judgement(group, tuple(topics), score, judge, now_s)
        return True

    def live(self, now_s: float) -> list[Judgement]:
        """All that count now, of both kinds."""
        limit = now_s - self._timeout_s
        self._newest = {key: one for key, one in self._newest.items() if one.heard_s >= limit}
        return list(self._newest.values())

    def of(self, topic: str, now_s: float) -> Judgement | None:
        """What counts for a topic; None if nobody judges it."""
        bare = topic.lstrip("/")
        about = [one for one in self.live(now_s) if bare in (t.lstrip("/") for t in one.topics)]
        # Of several people the newest counts; of programs, too.
        order = sorted(about, key=lambda one: (one.judge is Judge.HUMAN, one.heard_s))
        return order[-1] if order else None
