"""Which of the links heard of is the robot's own: pure."""

from __future__ import annotations

__all__ = ["OwnLink", "is_meant"]

_KEPT = 1000


def is_meant(name: str, link_id: str) -> bool:
    """Whether a name means a link: its key, the interface of a Wi-Fi station, or empty for any."""
    return name in ("", link_id) or link_id.startswith(f"{name}/")


class OwnLink:
    """The link that was named or its newest station, else the only one heard of lately.

    A device that attaches anew gets another RNTI, so what was heard of once does not count for ever.

    Args:
        name: Key of the robot's own link; empty: the only one there is.
        lately_s: A link of which nothing was heard for so long does not count beside one that was.

    Attributes:
        name: May be changed.
    """

    def __init__(self, name: str = "", lately_s: float = 15.0) -> None:
        self.name = name
        self._lately_s = lately_s
        self._heard_s: dict[str, float] = {}

    def heard(self, link_id: str, now_s: float) -> None:
        """Something came of a link, by a steady clock."""
        self._heard_s.pop(link_id, None)
        self._heard_s[link_id] = now_s
        if len(self._heard_s) > _KEPT:
            del self._heard_s[next(iter(self._heard_s))]

    def link(self, now_s: float) -> str:
        """Key of the robot's own link; empty if it is not known which that is."""
        if self.name in self._heard_s or not self._heard_s:
            return self.name
        newest_first = reversed(self._heard_s)
        if self.name:
            # A station of a Wi-Fi interface is wlan0/02:00:..., and another one after roaming.
            stations = (link for link in newest_first if is_meant(self.name, link))
            return next(stations, self.name)
        newest, other = next(newest_first), next(newest_first, None)
        is_alone = other is None or now_s - self._heard_s[other] > self._lately_s
        return newest if is_alone else ""

    def silent_s(self, now_s: float) -> float | None:
        """For how long nothing came of the robot's own link; None if nothing ever did."""
        heard_s = self._heard_s.get(self.link(now_s))
        return None if heard_s is None else now_s - heard_s
