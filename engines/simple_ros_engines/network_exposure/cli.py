"""``simple-ros network``: the mock network, what is asked of the network now, and the classes it has."""

from __future__ import annotations

import asyncio
import json
import os
import ssl
from typing import Annotated

import typer

from simple_ros.cli.options import JsonOption
from simple_ros_engines.network_exposure.qci import (
    FIVE_G_ONLY,
    QCI,
    RESERVED,
    QosClass,
    dscp_of,
    qos_class,
)
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


@app.command()
def ask(
    application: Annotated[str, typer.Argument(help="Its group, as on /MOS.")],
    speed: Annotated[float, typer.Option(help="Share of its own speed.", min=0)] = 1.0,
    rate: Annotated[float, typer.Option(help="Share of its own rate.", min=0)] = 1.0,
    seconds: Annotated[float, typer.Option("--for", help="Seconds.", min=0)] = 30.0,
    reason: Annotated[str, typer.Option(help="In words.")] = "",
    url: Annotated[str, typer.Option(help="Of the mock network.")] = "http://127.0.0.1:8099",
) -> None:
    """Ask an application to adapt, as somebody at the mock network; needs engine vaseal beside it."""
    from urllib.parse import quote

    from simple_ros.aio import run

    wish = {"speedFactor": speed, "rateFactor": rate, "validFor": seconds, "reason": reason}
    run(_control(wish, url, f"/mock/adapt/{quote(application, safe='')}"))


def _values(changes: list[str]) -> dict[str, object]:
    values: dict[str, object] = {}
    for change in changes:
        name, _, value = change.partition("=")
        try:
            values[name] = json.loads(value)
        except ValueError as error:
            raise typer.BadParameter(f"{change!r} is not NAME=NUMBER or NAME=true") from error
    return values


async def _control(changes: dict[str, object], url: str, path: str = "/mock/control") -> None:
    from simple_ros_engines.network_exposure.exposure.api import ApiClient
    from simple_ros_engines.network_exposure.exposure.http import StandardTransport
    from simple_ros_engines.network_exposure.exposure.model import ApiUnavailable, ExposureError

    client = ApiClient(url, StandardTransport())
    try:
        if changes:
            answer = await client.call("POST", path, changes)
        else:
            answer = await client.call("GET", "/mock/state")
    except ExposureError as error:
        hint = "; is 'simple-ros network mock' running there?"
        typer.echo(f"error: {error}{hint if isinstance(error, ApiUnavailable) else ''}", err=True)
        raise typer.Exit(1) from error
    typer.echo(json.dumps(answer.data, indent=2))


@app.command()
def classes(
    numbers: Annotated[
        list[int] | None, typer.Argument(metavar="QCI...", help="Only these.")
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Show the QoS classes of mobile networks (QCI, 5QI): what a number stands for."""
    rows = [_row_of(number) for number in numbers or sorted(QCI)]
    if json_:
        typer.echo(json.dumps([_as_json(row) for row in rows], indent=2))
        return
    typer.echo("QCI  type          priority  delay  errors  burst    DSCP  example")
    for row in rows:
        burst = "-" if row.burst_bytes is None else f"{row.burst_bytes} B"
        typer.echo(
            f"{row.qci:<4} {_kind(row):<13} {row.five_qi_priority:<9} {f'{row.delay_ms} ms':<8}"
            f"{row.error_rate:<7.0e} {burst:<8} {dscp_of(row.qci):<5} {row.example}{_note(row)}"
        )


def _row_of(number: int) -> QosClass:
    row = qos_class(number)
    if row is None:
        known = ", ".join(map(str, sorted(QCI)))
        raise typer.BadParameter(f"the tables have no QCI {number}; they have {known}")
    return row


def _kind(row: QosClass) -> str:
    return "critical GBR" if row.is_delay_critical else row.resource.value


def _note(row: QosClass) -> str:
    if row.qci in RESERVED:
        return " (for who is authorised)"
    return " (5G only)" if row.qci in FIVE_G_ONLY else ""


def _as_json(row: QosClass) -> dict[str, object]:
    return {
        "qci": row.qci,
        "resource": row.resource.value,
        "delay_critical": row.is_delay_critical,
        "priority": row.priority,
        "priority_5qi": row.five_qi_priority,
        "delay_ms": row.delay_ms,
        "error_rate": row.error_rate,
        "burst_bytes": row.burst_bytes,
        "averaging_window_ms": row.window_ms,
        "dscp": dscp_of(row.qci),
        "authorised_only": row.qci in RESERVED,
        "five_g_only": row.qci in FIVE_G_ONLY,
        "example": row.example,
    }
