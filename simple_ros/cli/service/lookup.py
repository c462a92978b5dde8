"""What the Master knows of services, and what people mean by the name of a service type."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.completion import complete_services
from simple_ros.cli.lookup import UnknownName
from simple_ros.errors import SimpleRosError

if TYPE_CHECKING:
    from simple_ros.net.master_client import MasterClient
    from simple_ros.rpc import services_pb2 as srv

__all__ = [
    "ServiceArgument",
    "UnknownServiceType",
    "find_service",
    "get_services",
    "is_hidden",
    "resolve_service_type",
    "service_types_here",
    "type_text",
]

ServiceArgument = Annotated[
    str,
    typer.Argument(metavar="SERVICE", help="Its name.", autocompletion=complete_services),
]


class UnknownServiceType(SimpleRosError, LookupError):
    """No service has such a type, and none of that name is installed.

    Attributes:
        spelling: As it was typed.
        near: Known types that look like it.
    """

    def __init__(self, spelling: str, near: Iterable[str]) -> None:
        self.spelling = spelling
        self.near = tuple(near)
        hint = f"; did you mean {' or '.join(map(repr, self.near))}?" if self.near else ""
        super().__init__(f"no service type {spelling!r}{hint}")


async def get_services(client: MasterClient, filter: str = "") -> list[srv.ServiceInfo]:  # noqa: A002
    """Services whose name contains ``filter``, in the order of their names."""
    from simple_ros.rpc import methods
    from simple_ros.rpc import services_pb2 as srv

    answer = await client.call(methods.GET_SERVICES, srv.GetServicesRequest(filter=filter))
    return sorted(answer.services, key=lambda service: service.name)


async def find_service(client: MasterClient, name: str) -> srv.ServiceInfo:
    """One service, whatever the leading slash of its name.

    Raises:
        UnknownName: The Master knows no such service.
        InvalidName: The name breaks the rules.
    """
    from simple_ros.names import resolve

    wanted = resolve(name, kind="service")
    services = await get_services(client)
    for service in services:
        if service.name == wanted:
            return service
    names = [service.name for service in services]
    raise UnknownName("service", name, [near for near in names if not is_hidden(near)])


def is_hidden(name: str) -> bool:
    """Whether a service serves something else (an action): a part of its name begins with ``_``."""
    return any(part.startswith("_") for part in name.split("/"))


def type_text(service: srv.ServiceInfo) -> str:
    """The type of a service in one word, or its two messages if they are called differently."""
    stem = service.request_type.removesuffix("Request")
    if service.request_type != stem and service.response_type == f"{stem}Response":
        return stem
    return f"{service.request_type} -> {service.response_type}"


def service_types_here() -> list[str]:
    """Service types of this installation: pairs of messages called alike."""
    from simple_ros.msg.registry import message_types

    names = set(message_types())
    stems = (name.removesuffix("Request") for name in names if name.endswith("Request"))
    return sorted(stem for stem in stems if f"{stem}Response" in names)


def resolve_service_type(spelling: str, known: Iterable[str]) -> str:
    """The service type that is meant: ``std_srvs/SetBool``, ``std_srvs/srv/SetBool``, ``SetBool``.

    Args:
        spelling: As typed.
        known: Every service type that may be meant.

    Raises:
        UnknownServiceType: None, or more than one, is meant.
    """
    types = sorted(set(known))
    wanted = ".".join(
        part
        for part in spelling.replace("::", "/").replace(".", "/").split("/")
        if part not in ("", "srv")
    )
    if wanted in types or spelling in types:
        return wanted if wanted in types else spelling
    alone = [name for name in types if name.rpartition(".")[2] == wanted]
    if len(alone) == 1:
        return alone[0]
    raise UnknownServiceType(spelling, alone or _alike(wanted, types))


def _alike(wanted: str, types: list[str]) -> list[str]:
    """Types that look like what is wanted, which may be their last part only."""
    last = {name.rpartition(".")[2]: name for name in types}
    parts = [last[name] for name in get_close_matches(wanted.rpartition(".")[2], last, n=3)]
    return list(dict.fromkeys(get_close_matches(wanted, types, n=3) + parts))[:3]
