"""What a server offers: channels and services by the numbers under which clients know them. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import count

from simple_ros.foxglove.frames import Channel, Schema, Service

__all__ = ["Catalog"]

_MOST_REMEMBERED = 1000


class Catalog:
    """Channels and services.

    Ids of channels are given once and never again. A service that comes back as it was has its old
    id, since some apps never forget one.
    """

    def __init__(self) -> None:
        self.channels: dict[int, Channel] = {}
        self.services: dict[int, Service] = {}
        self._channel_ids: Iterator[int] = count(1)
        self._service_ids: Iterator[int] = count(1)
        self._gone_services: dict[tuple[str, str, Schema, Schema], int] = {}

    def add_channel(
        self,
        topic: str,
        schema_name: str,
        schema: str,
        *,
        encoding: str = "protobuf",
        schema_encoding: str = "protobuf",
        metadata: Mapping[str, str] | None = None,
        recorded_as: tuple[str, bytes] | None = None,
    ) -> Channel:
        """Offer a channel under a new number; for the arguments see `Channel`."""
        channel = Channel(
            next(self._channel_ids),
            topic,
            schema_name,
            schema,
            encoding,
            schema_encoding,
            metadata or {},
            recorded_as,
        )
        self.channels[channel.id] = channel
        return channel

    def add_service(self, name: str, type_name: str, request: Schema, response: Schema) -> Service:
        """Offer a service."""
        known = self._gone_services.pop((name, type_name, request, response), None)
        number = next(self._service_ids) if known is None else known
        service = Service(number, name, type_name, request, response)
        self.services[service.id] = service
        return service

    def remove_channels(self, ids: Iterable[int]) -> list[int]:
        """Offer channels no more; gives those that were there."""
        return [one for one in ids if self.channels.pop(one, None) is not None]

    def remove_services(self, ids: Iterable[int]) -> list[int]:
        """Offer services no more; gives those that were there."""
        gone = [item for one in ids if (item := self.services.pop(one, None)) is not None]
        for item in gone:
            self._gone_services[item.name, item.type_name, item.request, item.response] = item.id
        # Names that nodes make up anew each time they start must not gather for ever.
        while len(self._gone_services) > _MOST_REMEMBERED:
            del self._gone_services[next(iter(self._gone_services))]
        return [item.id for item in gone]
