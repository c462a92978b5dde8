"""What applies strategies: the interface, and the gNB's slice policy file as its first implementation.

An actuator says what it set, or why it did not: nothing counts as applied without that.
"""

from __future__ import annotations

import json
import os
import tempfile
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from simple_ros_engines.physical_adaptive.strategy import Strategy

__all__ = ["Actuator", "Applied", "RrmPolicyFile", "rrm_policy"]


@dataclass(frozen=True, slots=True)
class Applied:
    """What became of a strategy.

    Attributes:
        ok: Whether it holds now.
        detail: What was set, or why not.
    """

    ok: bool
    detail: str


class Actuator(ABC):
    """Applies strategies of links.

    Attributes:
        name: For reports.
    """

    name: ClassVar[str]

    @abstractmethod
    def apply(self, link_id: str, rnti: int | None, strategy: Strategy) -> Applied:
        """Make a strategy hold; quickly, on the event loop."""

    def forget(self, rnti: int) -> None:  # noqa: B027
        """A device is gone: what was kept for it is free, as soon as the next strategy is applied."""


def rrm_policy(
    shares: dict[int, tuple[int, int, int]], sub_slices: int = 5, parent: int = 0
) -> dict[str, Any]:
    """The policy file of WirelessROS' gNB: a sub-slice for each priority, each device in its own.

    Args:
        shares: By RNTI: priority 1..5, least and most share of the blocks, per cent.
        sub_slices: How many there are.
        parent: Index of the slice they are in.
    """
    by_priority: dict[int, tuple[int, int]] = {}
    for priority, least, most in shares.values():
        low, high = by_priority.get(priority, (0, 0))
        by_priority[priority] = (min(100, low + least), max(high, most))
    total = sum(low for low, _ in by_priority.values())
    scale = min(1.0, 100 / total) if total else 1.0
    subs = []
    for priority in range(1, sub_slices + 1):
        low, high = by_priority.get(priority, (0, 100))
        subs.append(
            {
                "sub_slice_id": priority,
                "parent_slice": parent,
                "min_ratio": int(low * scale),
                "max_ratio": max(int(low * scale), high),
                "priority": priority,
            }
        )
    ratio = {"sST": 1, "sD_flag": 0, "sD": 0xFFFFFF, "min_ratio": 0, "max_ratio": 100}
    mapping = {
        f"0x{rnti:04x}": {
            "target_slice": parent,
            "target_sub_slice": priority,
            "up_target_sub_slice": priority,
            "force_slice": 0,
        }
        for rnti, (priority, _, _) in sorted(shares.items())
    }
    return {
        "rrmPolicyRatio": [ratio],
        "up_rrmPolicyRatio": [dict(ratio)],
        "subSlicePolicy": {"enabled": 1, "subSlices": subs},
        "ueSliceMapping": mapping,
        "Slice_Config": 1,
    }


class RrmPolicyFile(Actuator):
    """Writes ``rrmPolicy_sub.json``, which the gNB reads anew. Never run on hardware.

    Args:
        path: The file; replaced in one step, so that nobody reads half of it.
        n_prb: Blocks of the carrier.
    """

    name: ClassVar[str] = "rrm_policy_file"

    def __init__(self, path: Path | str, n_prb: int) -> None:
        self._path = Path(path)
        self._n_prb = n_prb
        self._shares: dict[int, tuple[int, int, int]] = {}
        self._written = ""

    def apply(self, link_id: str, rnti: int | None, strategy: Strategy) -> Applied:
        """Give a device its priority and its share of the blocks."""
        if rnti is None:
            return Applied(False, f"link {link_id} has no RNTI")
        share = min(100, -(-100 * strategy.prb // max(1, self._n_prb)))
        self._shares[rnti] = (strategy.priority, share, 100)
        text = json.dumps(rrm_policy(self._shares), indent=2) + "\n"
        if text != self._written or not self._path.exists():
            try:
                self._replace(text)
            except OSError as error:
                return Applied(False, f"{self._path} cannot be written: {error.strerror}")
            self._written = text
        return Applied(True, f"0x{rnti:04x}: priority {strategy.priority}, at least {share} %")

    def forget(self, rnti: int) -> None:
        """Keep no share for a device that is gone."""
        self._shares.pop(rnti, None)

    def _replace(self, text: str) -> None:
        handle, name = tempfile.mkstemp(dir=self._path.parent, prefix=self._path.name)
        try:
            with os.fdopen(handle, "w", encoding="ascii") as file:
                file.write(text)
            Path(name).chmod(0o644)
            Path(name).replace(self._path)
        except OSError:
            Path(name).unlink(missing_ok=True)
            raise
