"""``simple-ros service list``, ``info``, ``type`` and ``find``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.cli.lookup import address_text, ask, node_json
from simple_ros.cli.options import FilterArgument, JsonOption, MasterOption
from simple_ros.cli.service.lookup import (
    ServiceArgument,
    find_service,
    get_services,
    is_hidden,
    resolve_service_type,
    service_types_here,
    type_text,
)
from simple_ros.cli.text import columns, json_line, say

if TYPE_CHECKING:
    from simple_ros.rpc import services_pb2 as srv

__all__ = ["find", "info", "list_services", "print_type", "shown_services", "written_info"]

AllOption = Annotated[
    bool, typer.Option("--all", "-a", help="Also those that serve actions, such as a/_action/b.")
]
ServiceTypeArgument = Annotated[
    str, typer.Argument(metavar="TYPE", help="std_srvs.SetBool, std_srvs/SetBool or SetBool.")
]


def list_services(
    filter: FilterArgument = "",  # noqa: A002
    show_all: AllOption = False,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print the services, their types and their nodes."""
    found = ask(master, lambda client: get_services(client, filter.lstrip("/")))
    services = shown_services(found, show_all=show_all)
    if json:
        say(json_line([_json(service) for service in services]))
    elif services:
        say(columns([_row(service) for service in services]))


def shown_services(
    services: list[srv.ServiceInfo], *, show_all: bool = False
) -> list[srv.ServiceInfo]:
    """Those that are services for people, unless all are wanted."""
    return [service for service in services if show_all or not is_hidden(service.name)]


def _row(service: srv.ServiceInfo) -> tuple[str, str, str]:
    return service.name, type_text(service), service.node_info.node_name


def _json(service: srv.ServiceInfo) -> dict[str, Any]:
    return {
        "service": service.name,
        "type": type_text(service),
        "request": service.request_type,
        "response": service.response_type,
        "node": node_json(service.node_info),
    }


def info(
    service: ServiceArgument,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print a service's type, its messages, and the node that provides it."""
    found = ask(master, lambda client: find_service(client, service))
    say(json_line(_json(found)) if json else written_info(found))


def written_info(service: srv.ServiceInfo) -> str:
    """A service and its node as text."""
    return "\n".join(
        [
            f"Service: {service.name}",
            f"Type: {type_text(service)}",
            f"Request: {service.request_type}",
            f"Response: {service.response_type}",
            f"Node: {service.node_info.node_name}  {address_text(service.node_info)}",
        ]
    )


def print_type(
    service: ServiceArgument,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print the type of a service."""
    found = type_text(ask(master, lambda client: find_service(client, service)))
    say(json_line(found) if json else found)


def find(
    service_type: ServiceTypeArgument,
    show_all: AllOption = False,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print the services of a type; nothing if there are none."""
    services = ask(master, get_services)
    in_use = {type_text(service) for service in services}
    wanted = resolve_service_type(service_type, in_use.union(service_types_here()))
    names = [
        service.name
        for service in shown_services(services, show_all=show_all)
        if type_text(service) == wanted
    ]
    if json:
        say(json_line(names))
    elif names:
        say("\n".join(names))
