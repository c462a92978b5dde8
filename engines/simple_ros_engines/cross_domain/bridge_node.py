"""The transparent bridge: camera and lidar topics, made smaller when the link asks for it."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from google.protobuf.message import DecodeError, Message

from simple_ros.engine import Engine
from simple_ros.msg.sensor_msgs import Image, PointCloud2
from simple_ros.msg.std_msgs import String
from simple_ros.msg.wireless_ros_msgs import Constraint
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros_engines.base import NAMESPACE
from simple_ros_engines.cross_domain.adaptation import RateGate, scaled, voxels
from simple_ros_engines.cross_domain.sensing import voxel_leaf_m

__all__ = ["TopicBridge"]

logger = logging.getLogger(__name__)


@dataclass(slots=True)
class _Flow:
    publisher: Publisher[Message]
    gate: RateGate
    shrink: Callable[[bytes, float], bytes]
    came: int = 0
    passed: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    malformed: int = 0


class TopicBridge(Engine):
    """Hands camera pictures and lidar clouds on, smaller while the link's constraint says so.

    A link whose constraint has full resolution gets the bytes as they came. Parameters of its node:
    ``image_in``, ``image_out``, ``cloud_in``, ``cloud_out`` (topics; an empty ``..._in`` is left out),
    ``link`` (whose constraint counts; empty takes any), ``point_spacing_m``.
    """

    node_name: ClassVar[str] = f"{NAMESPACE}/topic_bridge"
    summary: ClassVar[str] = "Camera and lidar topics, made smaller when the link asks for it."

    def __init__(self) -> None:
        self.flows: dict[str, _Flow] = {}
        self.scale = 100.0
        self._spacing_m = 0.05
        self._link = ""

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends."""
        get = node.declare_parameter
        image_in = str(await get("~image_in", "/camera/image_raw", read_only=True))
        image_out = str(await get("~image_out", "/camera/mobile/image_raw", read_only=True))
        cloud_in = str(await get("~cloud_in", "/lidar/points", read_only=True))
        cloud_out = str(await get("~cloud_out", "/lidar/mobile/points", read_only=True))
        self._link = str(await get("~link", "", read_only=True))
        self._spacing_m = float(await get("~point_spacing_m", 0.05, minimum=0.001, read_only=True))
        if image_in:
            await self._join(node, image_in, image_out, Image, _smaller_image)
        if cloud_in:
            await self._join(node, cloud_in, cloud_out, PointCloud2, self._smaller_cloud)
        await node.subscribe(f"/{NAMESPACE}/constraints", Constraint, self._constraint)
        told = await node.advertise(f"/{NAMESPACE}/bridge_statistics", String)
        node.create_timer(1.0, lambda _: told.publish(String(data=self.statistics())))
        await node.spin()

    async def _join(
        self,
        node: NodeHandle,
        source: str,
        sink: str,
        kind: type[Image | PointCloud2],
        shrink: Callable[[bytes, float], bytes],
    ) -> None:
        publisher = await node.advertise(sink, kind)
        flow = self.flows[source] = _Flow(publisher, RateGate(), shrink)  # type: ignore[arg-type]
        await node.subscribe(source, kind.DESCRIPTOR.full_name, partial(self._came, flow), raw=True)

    def _constraint(self, message: Constraint) -> None:
        if self._link in ("", message.link_id):
            self.scale = message.resolution_scale or 100.0
            is_healthy = self.scale >= 100
            for flow in self.flows.values():
                flow.gate.rate_hz = 0.0 if is_healthy else message.frame_rate

    async def _came(self, flow: _Flow, data: bytes) -> None:
        flow.came += 1
        flow.bytes_in += len(data)
        if not flow.publisher.subscriber_count or not flow.gate.passes(time.monotonic()):
            return
        out = data
        if self.scale < 100:
            try:
                out = await asyncio.to_thread(flow.shrink, data, self.scale)
            except DecodeError:
                flow.malformed += 1
                return
        flow.passed += 1
        flow.bytes_out += len(out)
        flow.publisher.publish_bytes(out)

    def _smaller_cloud(self, data: bytes, scale: float) -> bytes:
        leaf_m = voxel_leaf_m((scale / 100) ** 2, self._spacing_m)
        smaller = voxels(PointCloud2.FromString(data), leaf_m)
        return data if smaller is None else smaller.SerializeToString()

    def statistics(self) -> str:
        """Messages and bytes of each topic, in and out."""
        return "; ".join(
            f"{topic}: {flow.passed} of {flow.came} messages, "
            f"{flow.bytes_out} of {flow.bytes_in} bytes"
            for topic, flow in self.flows.items()
        )


def _smaller_image(data: bytes, scale: float) -> bytes:
    smaller = scaled(Image.FromString(data), scale)
    return data if smaller is None else smaller.SerializeToString()
