"""What a server offers: channels and services by the numbers under which clients know them. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import count

from simple_ros.foxglove.frames import Channel, Schema, Service

__all__ = ["Catalog"]


class Catalog:
    """Channels and services; ids are given once and never again."""

    def __init__(self) -> None:
        self.channels: dict[int, Channel] = {}
        self.services: dict[int, Service] = {}
        self._channel_ids: Iterator[int] = count(1)
        self._service_ids: Iterator[int] = count(1)

    def add_channel(
        self,
        topic: str,
        schema_name: str,
        schema: str,
        *,
        encoding: str = "protobuf",
        schema_encoding: str = "protobuf",
        metadata: Mapping[str, str] | None = None,
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
        )
        self.channels[channel.id] = channel
        return channel

    def add_service(self, name: str, type_name: str, request: Schema, response: Schema) -> Service:
        """Offer a service under a new number."""
        service = Service(next(self._service_ids), name, type_name, request, response)
        self.services[service.id] = service
        return service

    def remove_channels(self, ids: Iterable[int]) -> list[int]:
        """Offer channels no more; gives those that were there."""
        return [one for one in ids if self.channels.pop(one, None) is not None]

    def remove_services(self, ids: Iterable[int]) -> list[int]:
        """Offer services no more; gives those that were there."""
        return [one for one in ids if self.services.pop(one, None) is not None]
