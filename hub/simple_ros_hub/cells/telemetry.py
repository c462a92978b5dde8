"""The telemetry cell."""

from __future__ import annotations

import time
from typing import Any, ClassVar

from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.nav_msgs import Path
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros_hub.cells.topic_cell import TopicCell
from simple_ros_hub.cells.track import Track

__all__ = ["TelemetryCell"]

_LINK_LOST_S = 2.0


class TelemetryCell(TopicCell):
    """Where the robot was: batches of poses, kept while there is no link and sent when there is one again.

    Further parameters: ``source`` (PoseStamped), ``sink`` (Path), ``period`` (s, between batches),
    ``keep`` (poses at most).
    """

    cell_name: ClassVar[str] = "telemetry_cell"
    summary: ClassVar[str] = "The robot's track, kept while there is no link."
    priority: int = 4
    share: ClassVar[float] = 0.1
    deadline_s: float = 2.0

    def __init__(self) -> None:
        super().__init__()
        self.track: Track[PoseStamped] = Track()
        self._publisher: Publisher[Path] | None = None
        self._period_s = 0.5
        self._sent_s = 0.0
        self._constrained_s: float | None = None

    async def set_up(self, node: NodeHandle) -> None:
        """Join source and sink."""
        get = node.declare_parameter
        source = str(await get("~source", "/robot/pose", read_only=True))
        sink = str(await get("~sink", "/telemetry/track", read_only=True))
        keep = int(await get("~keep", 1000, minimum=4, maximum=1_000_000, read_only=True))
        self._period_s = float(await get("~period", 0.5, minimum=0.02, maximum=60))
        node.on_parameter_changed("~period", self._period_changed)
        self.track = Track(keep)
        self._publisher = await node.advertise(sink, Path)
        await node.subscribe(source, PoseStamped, self._pose)
        node.create_timer(0.1, lambda _: self._look())

    def _period_changed(self, value: Any) -> None:
        self._period_s = float(value)

    def apply_constraints(self, constraint: Any) -> bool:
        """Keep to it, and note that the link is heard of."""
        self._constrained_s = time.monotonic()
        return super().apply_constraints(constraint)

    @property
    def has_link(self) -> bool:
        """Whether there is somebody to send to, over a link that carries anything.

        Where no engine ever told of the link, it is believed to be there.
        """
        if self._publisher is None or not self._publisher.subscriber_count:
            return False
        if self._constrained_s is None:
            return True
        is_fresh = time.monotonic() - self._constrained_s < _LINK_LOST_S
        return is_fresh and (self.constraint is None or self.constraint.max_data_rate > 0)

    def _pose(self, pose: PoseStamped) -> None:
        self.came(pose.ByteSize())
        self.track.add(pose)

    def _look(self) -> None:
        period_s = self._period_s / max(0.1, self.budget.rate_factor)
        due = time.monotonic() - self._sent_s >= period_s
        if due and len(self.track) and self.has_link and self.budget.allows(self.priority):
            self._sent_s = time.monotonic()
            self.execute()

    def _execute(self) -> int:
        """Send what there is; how many poses that were."""
        assert self._publisher is not None
        poses = self.track.take()
        path = Path(poses=poses)
        path.header.CopyFrom(poses[-1].header)
        if not self.send(self._publisher, path.SerializeToString()):
            for pose in poses:
                self.track.add(pose)
            return 0
        return len(poses)
