"""``simple-ros network``: the mock network, and what is asked of the network now."""

from __future__ import annotations

import asyncio
import json
import os
import ssl
from typing import Annotated

import typer

from simple_ros_engines.network_exposure.watcher_settings import SECRET_VARIABLE

__all__ = ["app"]

app = typer.Typer(
    help="Quality of service from mobile networks.", no_args_is_help=True, add_completion=False
)


@app.callback()
def _group() -> None:
    """Quality of service from mobile networks."""


@app.command()
def mock(
    host: Annotated[str, typer.Option(help="Where it listens.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="0 takes any free one.", min=0, max=65535)] = 8099,
    setup: Annotated[float, typer.Option(help="Seconds that a bearer takes.", min=0)] = 2.0,
    capacity: Annotated[float, typer.Option(help="For reserved bit rates, Mbit/s.", min=0)] = 100.0,
    client_id: Annotated[
        str,
        typer.Option(help=f"Ask for tokens of this client; its secret is in {SECRET_VARIABLE}."),
    ] = "",
    cert: Annotated[str, typer.Option(help="Certificate, to serve https.")] = "",
    key: Annotated[str, typer.Option(help="Its key, if that is in another file.")] = "",
    ca: Annotated[str, typer.Option(help="Certificates of receivers of notifications.")] = "",
) -> None:
    """Run a simulated network with SEAL, NEF and CAMARA interfaces, until Ctrl-C. No radio is behind it."""
    from simple_ros.aio import run

    run(_mock(host, port, setup, capacity, client_id, cert, key, ca))


async def _mock(
    host: str,
    port: int,
    setup: float,
    capacity: float,
    client_id: str,
    cert: str,
    key: str,
    ca: str,
) -> None:
    from simple_ros_engines.network_exposure.exposure.http import StandardTransport, client_tls
    from simple_ros_engines.network_exposure.mock.core import MockSettings
    from simple_ros_engines.network_exposure.mock.server import MockServer

    server = MockServer(
        MockSettings(setup_s=setup, capacity_bps=capacity * 1e6),
        client_id=client_id,
        client_secret=os.environ.get(SECRET_VARIABLE, ""),
        tls=_server_tls(cert, key) if cert else None,
        notifies=StandardTransport(client_tls(ca)),
    )
    try:
        await server.start(host, port)
    except OSError as error:
        raise typer.BadParameter(f"{host}:{port}: {error.strerror}") from error
    typer.echo(f"a simulated network listens on {server.url} (state: {server.url}/mock/state)")
    try:
        await asyncio.Event().wait()
    finally:
        await server.close()


def _server_tls(cert: str, key: str) -> ssl.SSLContext:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        tls.load_cert_chain(cert, key or None)
    except (ssl.SSLError, OSError) as error:
        raise typer.BadParameter(f"{cert}: {error}") from error
    return tls


@app.command()
def control(
    changes: Annotated[
        list[str] | None, typer.Argument(metavar="NAME=VALUE...", help="What to change.")
    ] = None,
    url: Annotated[str, typer.Option(help="Of the mock network.")] = "http://127.0.0.1:8099",
) -> None:
    """Show a mock network's state, after changing settings and faults (capacity_bps=0, is_down=true)."""
    from simple_ros.aio import run

    run(_control(_values(changes or []), url))


def _values(changes: list[str]) -> dict[str, object]:
    values: dict[str, object] = {}
    for change in changes:
        name, _, value = change.partition("=")
        try:
            values[name] = json.loads(value)
        except ValueError as error:
            raise typer.BadParameter(f"{change!r} is not NAME=NUMBER or NAME=true") from error
    return values


async def _control(changes: dict[str, object], url: str) -> None:
    from simple_ros_engines.network_exposure.exposure.api import ApiClient
    from simple_ros_engines.network_exposure.exposure.http import StandardTransport
    from simple_ros_engines.network_exposure.exposure.model import ExposureError

    client = ApiClient(url, StandardTransport())
    try:
        if changes:
            answer = await client.call("POST", "/mock/control", changes)
        else:
            answer = await client.call("GET", "/mock/state")
    except ExposureError as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(json.dumps(answer.data, indent=2))
