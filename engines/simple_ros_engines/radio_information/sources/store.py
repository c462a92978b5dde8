"""Metrics that others write into the embedded store: gNBs, Telegraf, FlexRIC."""

from __future__ import annotations

import asyncio
import sqlite3
import time
from typing import ClassVar

from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.field_maps import NewestPoints, RawPoint, preset
from simple_ros_engines.store.database import MetricsStore
from simple_ros_engines.store.flux import FluxQuery
from simple_ros_engines.store.server import StoreServer

__all__ = ["StoreSource"]


class StoreSource(MetricsSource):
    """Runs the store and reads what is new.

    Args:
        fields: Field map: ``wirelessros_oai``, ``srsran``, ``flexric_mac``.
        measurement: Instead of the field map's.
        path: File of the store; empty keeps it in memory.
        host: Where to listen.
        port: For HTTP; 0 takes any free one.
        udp_port: For lines; 0 takes any free one.
        period_s: Between looks.
        retention_s: How long points are kept.
    """

    summary: ClassVar[str] = "line protocol written to the embedded store (HTTP 8086, UDP 8094)"

    def __init__(
        self,
        fields: str = "wirelessros_oai",
        measurement: str = "",
        path: str = "",
        host: str = "127.0.0.1",
        port: int = 8086,
        udp_port: int = 8094,
        period_s: float = 0.1,
        retention_s: float = 3600.0,
    ) -> None:
        self.period_s = period_s
        self.server: StoreServer | None = None
        mapping = preset(fields)
        self._measurement = measurement or mapping.measurement
        self._place = (host, port, udp_port)
        self._path = path
        self._retention_s = retention_s
        self._newest = NewestPoints(mapping, "store")
        self._tag = mapping.rnti_tag
        self._store: MetricsStore | None = None

    async def run(self, emit: Emit) -> None:
        """Serve, and give each series' newest point once.

        Raises:
            SourceDown: A port is taken, or the file cannot be used.
        """
        try:
            store = MetricsStore(self._path or None, self._retention_s)
        except sqlite3.Error as error:
            raise SourceDown(f"the store's file {self._path} cannot be used: {error}") from error
        server = StoreServer(store)
        host, port, udp_port = self._place
        try:
            await server.start(host, port, udp_port)
        except (OSError, OverflowError) as error:
            store.close()
            raise SourceDown(f"the store cannot listen on {host}:{port}: {error}") from error
        self.server, self._store = server, store
        try:
            while True:
                self._look(store, emit)
                await asyncio.sleep(self.period_s)
        except sqlite3.Error as error:
            raise SourceDown(f"the store's file {self._path} cannot be used: {error}") from error
        finally:
            self.server = self._store = None
            await server.close()
            store.close()

    def _look(self, store: MetricsStore, emit: Emit) -> None:
        points = [
            RawPoint(tags[self._tag], stamp_ns, fields)
            for tags, stamp_ns, fields in store.fresh(self._measurement)
            if self._tag in tags
        ]
        for item in self._newest.fresh(points):
            if item is None:
                self.malformed += 1
            else:
                emit(item)

    async def discover(self) -> frozenset[str]:
        """Devices with a point in the last minute."""
        if self._store is None:
            return frozenset()
        now_ns = time.time_ns()
        equals = {"_measurement": self._measurement}
        query = FluxQuery("", now_ns - 60 * 10**9, now_ns + 1, equals, self._tag)
        return self._newest.links(self._store.distinct(query))
