"""Simulated links, for trying things out: every field is marked simulated."""

from __future__ import annotations

import asyncio
import time
from typing import ClassVar

import numpy as np

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource
from simple_ros_engines.simulator.link import LinkSettings, SimulatedLink

__all__ = ["SyntheticSource"]


class SyntheticSource(MetricsSource):
    """Links of a simulated cell.

    Args:
        links: How many.
        seed: Of the randomness.
        period_s: Between samples.
        speed_mps: Of the devices.
        offered_bps: What each wants to send.
        count: Samples of each link, then it ends; 0: for ever.
    """

    summary: ClassVar[str] = "simulated links (no radio is behind them)"

    def __init__(
        self,
        links: int = 1,
        seed: int = 1,
        period_s: float = 0.1,
        speed_mps: float = 1.4,
        offered_bps: float = 5e6,
        count: int = 0,
    ) -> None:
        if links < 1 or not period_s > 0 or count < 0:
            raise ConfigError("links must be at least 1, period_s more than 0, count not negative")
        self.period_s = period_s
        self._count = count
        settings = LinkSettings(period_s=period_s, speed_mps=speed_mps, offered_bps=offered_bps)
        now_ns = time.time_ns()
        self._links = [
            SimulatedLink(np.random.default_rng([seed, index]), settings, 0x4601 + index, now_ns)
            for index in range(links)
        ]

    async def run(self, emit: Emit) -> None:
        """Give records at their times."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        done = 0
        while not self._count or done < self._count:
            for link in self._links:
                emit(link.step())
            done += 1
            due += self.period_s
            await asyncio.sleep(max(0.0, due - loop.time()))
