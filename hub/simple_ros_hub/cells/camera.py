"""The camera cell."""

from __future__ import annotations

import time
from typing import Any, ClassVar

from google.protobuf.message import Message

from simple_ros.msg.sensor_msgs import CompressedImage, Image
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros_engines.cross_domain.adaptation import scaled
from simple_ros_engines.cross_domain.jpeg import JpegLadder, pillow, to_jpeg
from simple_ros_hub.cells.sensor import SensorCell

__all__ = ["CameraCell"]


class CameraCell(SensorCell):
    """Pictures: fewer a second, of fewer pixels, and as JPEG of lower quality while the link is narrow.

    Further parameter: ``image_format``: ``raw``, or ``jpeg`` (CompressedImage; needs Pillow).
    """

    cell_name: ClassVar[str] = "camera_cell"
    summary: ClassVar[str] = "Pictures, fewer and smaller while the link is narrow."
    message_class: ClassVar[type[Message]] = Image
    source: ClassVar[str] = "/camera/image_raw"
    sink: ClassVar[str] = "/camera/cell/image_raw"
    priority: int = 2
    share: ClassVar[float] = 0.5
    deadline_s: float = 0.3

    def __init__(self) -> None:
        super().__init__()
        self.ladder = JpegLadder()
        self.is_jpeg = False

    async def advertise(self, node: NodeHandle, sink: str) -> Publisher[Any]:
        """The publisher of pictures.

        Raises:
            ConfigError: JPEG is wanted and Pillow is not installed.
        """
        form = await node.declare_parameter(
            "~image_format", "raw", choices=("raw", "jpeg"), read_only=True
        )
        self.is_jpeg = form == "jpeg"
        if not self.is_jpeg:
            return await super().advertise(node, sink)
        pillow()
        return await node.advertise(f"{sink}/compressed", CompressedImage)

    @property
    def is_untouched(self) -> bool:
        """Whether bytes go on as they came: never as JPEG."""
        return super().is_untouched and not self.is_jpeg

    def _execute(self, data: bytes) -> bytes | None:
        if self.is_jpeg and self.treatment.is_untouched:
            return self._jpeg(data, 100.0)
        return super()._execute(data)

    def shrink(self, data: bytes, percent: float) -> bytes | None:
        """A picture with that share of its width and height; None if it cannot be made a JPEG."""
        if self.is_jpeg:
            return self._jpeg(data, percent)
        smaller = scaled(Image.FromString(data), percent)
        return data if smaller is None else smaller.SerializeToString()

    def _jpeg(self, data: bytes, percent: float) -> bytes | None:
        quality = self.ladder.want(self.treatment.ratio, time.monotonic())
        made = to_jpeg(Image.FromString(data), percent, quality)
        if made is None:
            self.malformed += 1
            return None
        out = made.SerializeToString()
        self.ladder.produced(len(out), self.flow.message_bytes(self.treatment.rate_hz))
        return out
