"""The operator of the demo: commands the robot, looks at what comes, with engines or without.

With engines on, pictures and points come from the cells and commands go to the command cell; with engines off
all of it goes as it is, through one queue. The parameter ``engines`` of its node switches.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from simple_ros import aio
from simple_ros.msg.geometry_msgs import PoseStamped, Twist
from simple_ros.msg.link_shaper_msgs import ShaperStatistics
from simple_ros.msg.sensor_msgs import CompressedImage, Image, PointCloud2
from simple_ros.msg.std_msgs import Bool, Float32
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED
from simple_ros_hub.demo.plot import Second

__all__ = ["NODE_NAME", "Operator"]

NODE_NAME = "wireless_demo"
_LATE_S = 0.5
_SEEN = "/operator/image_raw"
_TOPICS: dict[bool, tuple[str, str, str, str]] = {
    False: ("/plain/pose", "/camera/image_raw", "/lidar/points", "/plain/cmd_vel"),
    True: ("/robot/pose", "/camera/cell/image_raw", "/lidar/cell/points", "/cmd_vel/remote"),
}
"""Pose, pictures, points, commands; by whether engines are on."""


@dataclass
class _Heard:
    """What came since the last second began."""

    ages_s: list[float] = field(default_factory=list)
    pictures: int = 0
    sensed_bytes: int = 0
    offered: int = 0
    missed: int = 0


class Operator:
    """The operator.

    Args:
        node: Started, at a site without radio.
        speed_mps: How fast the robot shall drive.
        told: Called with each second's numbers.
        jpeg: Whether the camera cell sends JPEG.

    Attributes:
        engines: Whether they are on.
        laps: Rounds the robot has driven.
    """

    def __init__(
        self,
        node: aio.NodeHandle,
        speed_mps: float,
        told: Callable[[Second], None],
        *,
        jpeg: bool = True,
    ) -> None:
        self.engines = False
        self.laps = 0.0
        self._node = node
        self._speed_mps = speed_mps
        self._told = told
        self._jpeg_comes = jpeg
        self._heard = _Heard()
        self._counted: tuple[int, int] | None = None
        self._listening: list[Any] = []
        self._commands: dict[bool, Publisher[Twist]] = {}
        self._moved = asyncio.Event()
        self._switching = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self) -> None:
        """Advertise, subscribe, begin with engines off."""
        node = self._node
        for is_on, (*_, commands) in _TOPICS.items():
            self._commands[is_on] = await node.advertise(commands, Twist)
        self._raw = await node.advertise(_SEEN, Image)
        self._jpeg = await node.advertise(f"{_SEEN}/compressed", CompressedImage)
        self._numbers = {
            name: await node.advertise(f"/wireless_demo/{name}", Float32)
            for name in ("pose_age_ms", "pictures_hz", "lost_percent", "sensor_mbps")
        }
        self._is_on = await node.advertise("/wireless_demo/engines", Bool, qos=LATCHED)
        await node.subscribe("/wireless_demo/progress", Float32, self._progress)
        await node.subscribe("/link_shaper/statistics", ShaperStatistics, self._statistics)
        await node.declare_parameter("~engines", False)
        node.on_parameter_changed("~engines", self._wanted)
        await self._switch(on=False)
        node.create_timer(1.0, lambda _: self._tell())

    def _wanted(self, value: object) -> None:
        task = asyncio.create_task(self._switch(on=bool(value)))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _switch(self, *, on: bool) -> None:
        """Listen to the other topics."""
        async with self._switching:
            before, self._listening = self._listening, []
            for subscriber in before:
                await subscriber.close()
            pose, pictures, points, _ = _TOPICS[on]
            subscribe = self._node.subscribe
            kind = CompressedImage if on and self._jpeg_comes else Image
            pictures += "/compressed" if kind is CompressedImage else ""
            cloud = PointCloud2.DESCRIPTOR.full_name
            self._listening = [
                await subscribe(pose, PoseStamped, self._pose),
                await subscribe(
                    pictures, kind.DESCRIPTOR.full_name, partial(self._picture, kind), raw=True
                ),
                await subscribe(points, cloud, self._points, raw=True),
            ]
            self.engines = on
            self._is_on.publish(Bool(data=on))

    # -- what comes ----------------------------------------------------------------------------

    def _age_s(self, message: Any) -> float:
        now_ns = self._node.clock.now().nanoseconds
        return float(now_ns - message.header.stamp.ToNanoseconds()) / 1e9

    def _progress(self, message: Float32) -> None:
        self.laps = max(self.laps, message.data)
        self._moved.set()

    async def driven(self, laps: float) -> None:
        """Wait until the robot has driven so many rounds."""
        while self.laps < laps:
            self._moved.clear()
            await self._moved.wait()

    def _pose(self, message: PoseStamped) -> None:
        self._heard.ages_s.append(self._age_s(message))
        command = Twist()
        command.linear.x = self._speed_mps
        self._commands[self.engines].publish(command)

    def _picture(self, kind: type[Image | CompressedImage], data: bytes) -> None:
        self._heard.sensed_bytes += len(data)
        self._heard.pictures += self._age_s(kind.FromString(data)) <= _LATE_S
        publisher: Publisher[Any] = self._raw if kind is Image else self._jpeg
        publisher.publish_bytes(data)

    def _points(self, data: bytes) -> None:
        self._heard.sensed_bytes += len(data)

    def _statistics(self, message: ShaperStatistics) -> None:
        classes = [one for link in message.links for one in link.classes]
        offered = sum(one.offered for one in classes)
        missed = sum(one.late + one.dropped + one.lost + one.expired for one in classes)
        if self._counted is not None:
            self._heard.offered += offered - self._counted[0]
            self._heard.missed += missed - self._counted[1]
        self._counted = (offered, missed)

    # -- what is told --------------------------------------------------------------------------

    def _tell(self) -> None:
        heard, self._heard = self._heard, _Heard()
        ages = sorted(heard.ages_s)
        second = Second(
            time.time(),
            self.laps,
            self.engines,
            1000 * ages[int(0.95 * len(ages))] if ages else None,
            float(heard.pictures),
            # What is given up now may have come a second ago.
            min(100.0, 100 * heard.missed / heard.offered) if heard.offered else 0.0,
            8e-6 * heard.sensed_bytes,
        )
        values = {
            "pose_age_ms": second.pose_age_ms,
            "pictures_hz": second.pictures_hz,
            "lost_percent": second.lost_percent,
            "sensor_mbps": second.sensor_mbps,
        }
        for name, value in values.items():
            if value is not None:
                self._numbers[name].publish(Float32(data=value))
        self._told(second)
