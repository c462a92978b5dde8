"""What FlexRIC's xApps send over UDP, as it comes. Never run on hardware."""

from __future__ import annotations

import asyncio
from typing import ClassVar

from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.field_maps import FieldMap, preset, read_fields
from simple_ros_engines.store.line_protocol import (
    BadLine,
    flexric_line,
    parse_fields,
    parse_line,
    parse_tags,
)

__all__ = ["FlexricSource", "record_of_line"]


class FlexricSource(MetricsSource):
    """Lines in datagrams: ``mac_stats: tstamp=..,rnti=4601,..``, or line protocol.

    Args:
        host: Where to listen.
        port: The same; 0 takes any free one.
        fields: Field map; lines of other measurements are left out.
        measurement: Instead of the field map's.
        period_s: Of a device, records more often than this are left out; E2 reports each 1 to 10 ms.
    """

    summary: ClassVar[str] = "FlexRIC's lines over UDP (never run on hardware)"

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 8094,
        fields: str = "flexric_mac",
        measurement: str = "",
        period_s: float = 0.05,
    ) -> None:
        self.period_s = period_s
        self.port = 0
        self._place = (host, port)
        self._mapping = preset(fields)
        self._measurement = measurement or self._mapping.measurement
        self._given_ns: dict[str, int] = {}

    async def run(self, emit: Emit) -> None:
        """Give a record of each line that is due.

        Raises:
            SourceDown: The port is taken.
        """
        loop = asyncio.get_running_loop()
        try:
            transport, _ = await loop.create_datagram_endpoint(
                lambda: _Datagrams(self, emit), local_addr=self._place
            )
        except OSError as error:
            host, port = self._place
            raise SourceDown(f"cannot listen on {host}:{port}: {error}") from error
        self.port = transport.get_extra_info("sockname")[1]
        try:
            await asyncio.Event().wait()
        finally:
            self.port = 0
            transport.close()

    def take(self, text: str, emit: Emit) -> None:
        """A datagram's text."""
        for line in text.splitlines():
            try:
                item = record_of_line(line, self._mapping, self._measurement)
            except BadLine:
                self.malformed += 1
                continue
            if item is not None and self._is_due(item):
                emit(item)

    def _is_due(self, item: LinkRecord) -> bool:
        since_ns = item.stamp_ns - self._given_ns.get(item.link_id, 0)
        if 0 <= since_ns < 1e9 * self.period_s:
            return False
        self._given_ns[item.link_id] = item.stamp_ns
        return True


def record_of_line(line: str, mapping: FieldMap, measurement: str) -> LinkRecord | None:
    """The record of a line; None for a line of another measurement.

    Raises:
        BadLine: It is none, or has no stamp or no RNTI.
    """
    point = parse_line(flexric_line(line))
    if point.measurement != measurement:
        return None
    rnti = parse_tags(point.tags).get(mapping.rnti_tag, "")
    if point.stamp_ns is None:
        raise BadLine(1, line)
    found = read_fields(mapping, rnti, point.stamp_ns, "flexric", parse_fields(point.fields))
    if found is None:
        raise BadLine(1, line)
    return found


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, source: FlexricSource, emit: Emit) -> None:
        self._source = source
        self._emit = emit

    def datagram_received(self, data: bytes, _: tuple[str, int]) -> None:
        """Take lines."""
        self._source.take(data.decode("utf-8", "replace"), self._emit)
