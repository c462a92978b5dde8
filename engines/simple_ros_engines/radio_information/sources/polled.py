"""Sources that ask a database again and again for the newest point of each device."""

from __future__ import annotations

import asyncio
from abc import abstractmethod

from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource
from simple_ros_engines.radio_information.sources.field_maps import NewestPoints, RawPoint

__all__ = ["PolledDatabase"]


class PolledDatabase(MetricsSource):
    """What is the same whatever the database; the others say how to ask it.

    Args:
        newest: Makes records of points.
        period_s: Between queries.
    """

    def __init__(self, newest: NewestPoints, period_s: float) -> None:
        self.period_s = period_s
        self._newest = newest

    @abstractmethod
    async def last_points(self) -> list[RawPoint]:
        """The newest point of each device, as far back as the source looks."""

    @abstractmethod
    async def points_of_a_minute(self) -> list[RawPoint]:
        """The newest point of each device that has one in the last minute."""

    async def run(self, emit: Emit) -> None:
        """Give each device's newest point once.

        Raises:
            SourceDown: The server does not answer, or refuses.
        """
        while True:
            for item in self._newest.fresh(await self.last_points()):
                if item is None:
                    self.malformed += 1
                else:
                    emit(item)
            await asyncio.sleep(self.period_s)

    async def discover(self) -> frozenset[str]:
        """Devices with a point in the last minute.

        Raises:
            SourceDown: The server does not answer, or refuses.
        """
        return self._newest.links(point.rnti for point in await self.points_of_a_minute())
