"""How sensors should work, and how strongly to compress: pure, with hysteresis."""

from __future__ import annotations

__all__ = [
    "SENSOR_MODES",
    "CompressionJudge",
    "SensorModeJudge",
    "compression_target",
    "jpeg_quality",
    "voxel_leaf_m",
]

SENSOR_MODES = ("MINIMAL", "REDUCED", "STANDARD", "HIGH_RESOLUTION")
"""From least to most."""

MODE_RATES_BPS = {"MINIMAL": 0.0, "REDUCED": 1e6, "STANDARD": 4e6, "HIGH_RESOLUTION": 10e6}
"""What a mode needs; criticality never raises a mode above what there is."""

_SPLIT_BPS = {"EXCELLENT": 10e6, "GOOD": 10e6, "FAIR": 5e6, "POOR": 2e6, "BAD": 2e6}
_UPPER = {"EXCELLENT": 3, "GOOD": 3, "FAIR": 2, "POOR": 1, "BAD": 1}


class SensorModeJudge:
    """The mode of a robot's sensors.

    A lower mode is taken at once, a higher one only when the rate exceeds its bound by a margin.

    Args:
        margin: Share of the bound.
    """

    def __init__(self, margin: float = 0.15) -> None:
        self.mode: str | None = None
        self._margin = margin

    def judge(self, level: str, bandwidth_bps: float, criticality: float) -> str:
        """The mode at a level of network quality.

        Args:
            level: One of `constraints.LEVELS`.
            bandwidth_bps: What the link can carry.
            criticality: Of the task; above 0.8 REDUCED becomes STANDARD and MINIMAL becomes REDUCED, if
                the rate allows it.
        """
        plain = _mode(level, bandwidth_bps, criticality)
        if self.mode is not None and plain > SENSOR_MODES.index(self.mode):
            careful = _mode(level, bandwidth_bps / (1 + self._margin), criticality)
            plain = max(SENSOR_MODES.index(self.mode), careful)
        self.mode = SENSOR_MODES[plain]
        return self.mode


def _mode(level: str, bandwidth_bps: float, criticality: float) -> int:
    index = _UPPER[level] - (bandwidth_bps <= _SPLIT_BPS[level])
    if criticality > 0.8 and index < 2:
        wanted = index + 1
        if bandwidth_bps >= MODE_RATES_BPS[SENSOR_MODES[wanted]]:
            return wanted
    return index


_STEPS = ((10e6, 0.8, 0.0), (5e6, 0.6, 0.3), (2e6, 0.4, 0.6), (0.0, -1.0, 0.9))
_STRONGEST = 0.9


class CompressionJudge:
    """The compression level of a link: 0 nothing to 0.9.

    Args:
        margin: Share by which rate and quality must exceed a bound before the level falls.
    """

    def __init__(self, margin: float = 0.1) -> None:
        self.level: float | None = None
        self._margin = margin

    def judge(self, bandwidth_bps: float, quality: float, criticality: float) -> float:
        """The level; 0.2 less, but not below 0, for a task more critical than 0.8."""
        plain = _level(bandwidth_bps, quality)
        if self.level is not None and plain < self.level:
            relaxed = 1 + self._margin
            plain = min(self.level, _level(bandwidth_bps / relaxed, quality / relaxed))
        self.level = plain
        return max(0.0, plain - 0.2) if criticality > 0.8 else plain


def _level(bandwidth_bps: float, quality: float) -> float:
    fitting = (level for rate, least, level in _STEPS if bandwidth_bps > rate and quality > least)
    return next(fitting, _STRONGEST)


def compression_target(level: float) -> float:
    """Bytes out per byte in that a level means: ``1 - level``, at least 0.05."""
    return max(0.05, 1 - level)


def jpeg_quality(ratio: float) -> int:
    """JPEG quality for a target of bytes out per byte in: 95 at 1, 30 at 0.05."""
    return round(30 + 65 * (max(0.05, min(1.0, ratio)) - 0.05) / 0.95)


def voxel_leaf_m(ratio: float, spacing_m: float = 0.05) -> float:
    """Edge of voxels that keep about a share of the points of a surface sampled every ``spacing_m``."""
    return 0.0 if ratio >= 1 else float(spacing_m / max(0.05, ratio) ** 0.5)
