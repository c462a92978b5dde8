"""The lidar cell."""

from __future__ import annotations

from typing import Any, ClassVar

from google.protobuf.message import Message

from simple_ros.msg.sensor_msgs import PointCloud2
from simple_ros.node import NodeHandle
from simple_ros_engines.cross_domain.adaptation import voxels
from simple_ros_engines.cross_domain.sensing import voxel_leaf_m
from simple_ros_hub.cells.sensor import SensorCell

__all__ = ["LidarCell"]


class LidarCell(SensorCell):
    """Point clouds: fewer a second and one point a voxel while the link is narrow.

    Further parameter: ``point_spacing`` (m, between neighbouring points).
    """

    cell_name: ClassVar[str] = "lidar_cell"
    summary: ClassVar[str] = "Point clouds, thinned out while the link is narrow."
    message_class: ClassVar[type[Message]] = PointCloud2
    source: ClassVar[str] = "/lidar/points"
    sink: ClassVar[str] = "/lidar/cell/points"
    priority: int = 3
    share: ClassVar[float] = 0.3
    deadline_s: float = 0.3

    def __init__(self) -> None:
        super().__init__()
        self.spacing_m = 0.05

    async def set_up(self, node: NodeHandle) -> None:
        """Join source and sink."""
        await super().set_up(node)
        self.spacing_m = float(
            await node.declare_parameter("~point_spacing", 0.05, minimum=0.001, maximum=10)
        )
        node.on_parameter_changed("~point_spacing", self._spacing_changed)

    def _spacing_changed(self, value: Any) -> None:
        self.spacing_m = float(value)

    def shrink(self, data: bytes, percent: float) -> bytes:
        """A cloud with the square of that share of its points, about."""
        leaf_m = voxel_leaf_m((percent / 100) ** 2, self.spacing_m)
        smaller = voxels(PointCloud2.FromString(data), leaf_m)
        return data if smaller is None else smaller.SerializeToString()
