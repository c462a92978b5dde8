"""The newest sign of life of each component, the hub's own and strangers'. Pure."""

from __future__ import annotations

from collections.abc import Collection

from simple_ros.msg.wireless_ros_msgs import EngineStatus

__all__ = ["Signs"]


class Signs:
    """Keeps them; of strangers only while they are heard of, since each may come under a new name.

    Args:
        ours: Names of the components that are looked after; may change.
        forget_after_s: Silence of a stranger after which it is forgotten.

    Attributes:
        newest: By name.
    """

    def __init__(self, ours: Collection[str], forget_after_s: float = 60.0) -> None:
        self.newest: dict[str, EngineStatus] = {}
        self._ours = ours
        self._forget_after_s = forget_after_s
        self._heard_s: dict[str, float] = {}

    def came(self, name: str, message: EngineStatus, now_s: float) -> None:
        """A sign of life came."""
        self.newest[name] = message
        if name not in self._ours:
            self._heard_s[name] = now_s

    def forget(self, now_s: float) -> None:
        """Forget the strangers that are gone."""
        for name in [k for k, s in self._heard_s.items() if now_s - s > self._forget_after_s]:
            del self._heard_s[name], self.newest[name]
