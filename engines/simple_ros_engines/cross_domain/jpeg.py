"""Pictures as JPEG, and the quality to use. Needs Pillow (``pip install 'simple-ros[camera]'``). Pure."""

from __future__ import annotations

import io
from types import ModuleType

from simple_ros.errors import ConfigError
from simple_ros.msg.sensor_msgs import CompressedImage, Image
from simple_ros_engines.cross_domain.sensing import jpeg_quality
from simple_ros_engines.cross_domain.treatment import Reluctant

__all__ = ["JPEG_STEPS", "JpegLadder", "pillow", "to_jpeg"]

JPEG_STEPS = (95, 85, 75, 65, 55, 45, 35, 25)
"""Qualities in use; between them a change is not worth it."""

# How Pillow calls the layout of the bytes, and what the picture is made of.
_LAYOUTS = {
    "rgb8": ("RGB", "RGB"),
    "bgr8": ("RGB", "BGR"),
    "rgba8": ("RGB", "RGBX"),
    "bgra8": ("RGB", "BGRX"),
    "mono8": ("L", "L"),
}


def pillow() -> ModuleType:
    """Pillow's ``Image`` module.

    Raises:
        ConfigError: It is not installed.
    """
    try:
        import PIL.Image
    except ImportError:
        raise ConfigError(
            "JPEG needs Pillow, which is not installed: pip install 'simple-ros[camera]'"
        ) from None
    return PIL.Image


def to_jpeg(image: Image, percent: float, quality: int) -> CompressedImage | None:
    """A picture as JPEG.

    Args:
        image: Encoding rgb8, bgr8, rgba8, bgra8 or mono8; transparency is left out.
        percent: Of each side, at most 100.
        quality: 1 to 95.

    Returns:
        A new message with the same header; None if the picture has another encoding, or its data does not
        fit it.

    Raises:
        ConfigError: Pillow is not installed.
    """
    module = pillow()
    layout = _LAYOUTS.get(image.encoding)
    width, height, step, data = image.width, image.height, image.step, image.data
    if layout is None or not width or not height or len(data) < step * height:
        return None
    if step < width * len(layout[1]):
        return None
    mode, raw = layout
    picture = module.frombuffer(mode, (width, height), data, "raw", raw, step, 1)
    if percent < 100:
        size = (max(1, round(width * percent / 100)), max(1, round(height * percent / 100)))
        picture = picture.resize(size, module.Resampling.BILINEAR, reducing_gap=2.0)
    target = io.BytesIO()
    picture.save(target, "JPEG", quality=quality)
    return CompressedImage(header=image.header, format="jpeg", data=target.getvalue())


class JpegLadder:
    """Which quality to use: from a target ratio, corrected by what pictures really take.

    Args:
        dwell_s: How long a better quality must have been wanted before it is taken.
    """

    def __init__(self, dwell_s: float = 2.0) -> None:
        self._base = Reluctant(float(JPEG_STEPS[0]), dwell_s)
        self._more = 0

    @property
    def quality(self) -> int:
        """Now."""
        index = next((i for i, step in enumerate(JPEG_STEPS) if step <= self._base.value), 0)
        return JPEG_STEPS[min(len(JPEG_STEPS) - 1, index + self._more)]

    def want(self, ratio: float, now_s: float) -> int:
        """Bytes out per byte in are wanted; the quality now."""
        exact = max(float(JPEG_STEPS[-1]), float(jpeg_quality(ratio)))
        step = next(step for step in JPEG_STEPS if step <= exact)
        self._base.want(float(step), now_s)
        return self.quality

    def produced(self, size_bytes: int, budget_bytes: float) -> None:
        """A picture took so much, and might have taken so much: a step down, or back up with a wide margin."""
        if size_bytes > budget_bytes:
            self._more = min(len(JPEG_STEPS) - 1, self._more + 1)
        elif size_bytes < 0.5 * budget_bytes:
            self._more = max(0, self._more - 1)
