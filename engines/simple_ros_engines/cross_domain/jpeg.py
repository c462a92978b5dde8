"""Pictures as JPEG, and the quality to use. Needs Pillow (``pip install 'simple-ros[camera]'``). Pure."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from types import ModuleType

from simple_ros.errors import ConfigError
from simple_ros.msg.sensor_msgs import CompressedImage, Image
from simple_ros_engines.cross_domain.sensing import jpeg_quality
from simple_ros_engines.cross_domain.treatment import Reluctant

__all__ = ["JPEG_STEPS", "LEAST_SCALE", "JpegLadder", "Look", "pillow", "to_jpeg"]

JPEG_STEPS = (95, 85, 75, 65, 55, 45, 35, 25)
"""Qualities in use; between them a change is not worth it."""

LEAST_SCALE = 30.0
"""Per cent of each side: no picture is made smaller to fit than the worst link's constraint makes it."""

# Bytes at each quality against the best, as photographs have it; the ladder learns how its own pictures differ.
_WEIGHTS = (1.0, 0.5, 0.36, 0.28, 0.23, 0.2, 0.17, 0.14)
_LADDER = (*((step, 1.0) for step in JPEG_STEPS), *((JPEG_STEPS[-1], s) for s in (0.7, 0.5, 0.3)))
# Less than 2: fewer pixels have more in each.
_BYTES_BY_SIDE = 1.5

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


@dataclass(frozen=True, slots=True)
class Look:
    """How a picture is made.

    Attributes:
        scale: Per cent of each side.
        quality: Of the JPEG.
    """

    scale: float
    quality: int


class JpegLadder:
    """Which quality and how many pixels: from a target ratio, and from what pictures may take.

    How large a picture of another quality would be is foretold from the last one, and learnt; so the step that
    fits is taken at once. Quality is given up first, then pixels.

    Args:
        dwell_s: How long a better step must have been wanted before it is taken.
    """

    def __init__(self, dwell_s: float = 2.0) -> None:
        self._base = Reluctant(float(JPEG_STEPS[0]), dwell_s)
        self._fit = Reluctant(0.0, dwell_s)
        self._weights = dict(zip(JPEG_STEPS, _WEIGHTS, strict=True))
        self._scale = 100.0
        self._made: tuple[Look, float] | None = None
        self._now_s = 0.0

    @property
    def quality(self) -> int:
        """Now."""
        return self._look().quality

    def want(self, ratio: float, now_s: float) -> int:
        """Bytes out per byte in are wanted; the quality now."""
        exact = max(float(JPEG_STEPS[-1]), float(jpeg_quality(ratio)))
        step = next(step for step in JPEG_STEPS if step <= exact)
        self._base.want(float(step), now_s)
        self._now_s = now_s
        return self.quality

    def look(self, scale: float, budget_bytes: float, now_s: float) -> Look:
        """How to make the next picture.

        Args:
            scale: Per cent of each side that it may have.
            budget_bytes: What it may take.
            now_s: A clock that never jumps.
        """
        self._scale, self._now_s = scale, now_s
        self._choose(budget_bytes)
        return self._look()

    def expected_bytes(self) -> float | None:
        """What the next picture will take; None before the first."""
        return None if self._made is None else self._expected(self._look())

    def produced(self, size_bytes: int, budget_bytes: float, made: Look | None = None) -> None:
        """A picture took so much, and might have taken so much.

        Args:
            size_bytes: It took.
            budget_bytes: The next may take.
            made: How it was made; None: as the ladder says now.
        """
        look = made or self._look()
        before = self._made[0] if self._made is not None else look
        if before.quality != look.quality and before.scale == look.scale:
            self._learn(look, max(1, size_bytes) / self._expected(look))
        self._made = (look, float(max(1, size_bytes)))
        self._choose(budget_bytes)

    def _learn(self, look: Look, surprise: float) -> None:
        prior = _WEIGHTS[JPEG_STEPS.index(look.quality)]
        moved = self._weights[look.quality] * math.sqrt(surprise)
        self._weights[look.quality] = min(2 * prior, max(0.5 * prior, moved))

    def _choose(self, budget_bytes: float) -> None:
        steps = range(len(_LADDER))
        last = len(_LADDER) - 1
        fits = (
            i for i in steps if self._made is None or self._expected(self._at(i)) <= budget_bytes
        )
        self._fit.want(-float(next(fits, last)), self._now_s)

    def _expected(self, look: Look) -> float:
        assert self._made is not None
        made, size_bytes = self._made
        sides: float = (look.scale / made.scale) ** _BYTES_BY_SIDE
        return size_bytes * sides * self._weights[look.quality] / self._weights[made.quality]

    def _look(self) -> Look:
        base = next((i for i, step in enumerate(JPEG_STEPS) if step <= self._base.value), 0)
        return self._at(max(base, int(-self._fit.value)))

    def _at(self, index: int) -> Look:
        quality, share = _LADDER[index]
        return Look(min(self._scale, max(LEAST_SCALE, self._scale * share)), quality)
