"""The parameters of the topic watcher, and what is made of them."""

from __future__ import annotations

import os
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from simple_ros.errors import ConfigError
from simple_ros.node import NodeHandle
from simple_ros_engines.network_exposure.exposure.api import ApiClient, Credentials
from simple_ros_engines.network_exposure.exposure.base import ExposureBackend, OnNotification
from simple_ros_engines.network_exposure.exposure.camara import DEFAULT_PROFILES, CamaraBackend
from simple_ros_engines.network_exposure.exposure.http import StandardTransport, client_tls
from simple_ros_engines.network_exposure.exposure.nef import NefBackend
from simple_ros_engines.network_exposure.exposure.receiver import NotificationReceiver
from simple_ros_engines.network_exposure.exposure.seal import SealBackend
from simple_ros_engines.network_exposure.flow_session import SessionSettings
from simple_ros_engines.network_exposure.qci import RESERVED
from simple_ros_engines.network_exposure.qos_mapper import MapperSettings, Mode
from simple_ros_engines.network_exposure.watcher_core import Identities, WatcherSettings

__all__ = ["Connection", "backend_of", "connection", "receiver_of", "watcher_settings"]

SECRET_VARIABLE = "SIMPLE_ROS_NETWORK_SECRET"  # noqa: S105


@dataclass(frozen=True, slots=True)
class Connection:
    """How the network is reached, by the parameters of their names."""

    backend: str
    url: str
    group: str
    mode: str
    credentials: Credentials
    ca_file: str
    cert_file: str
    key_file: str
    timeout_s: float
    notify_host: str
    notify_port: int
    notify_url: str
    notify_cert: str
    notify_key: str
    journal: str
    af_id: str
    qos_reference: str
    profiles: dict[str, str]
    compat: str


async def connection(node: NodeHandle) -> Connection:
    """Declare them.

    Raises:
        ConfigError: One makes no sense.
    """

    async def text(name: str, default: str = "", choices: Sequence[str] = ()) -> str:
        value = await node.declare_parameter(
            f"~{name}", default, choices=tuple(choices), read_only=True
        )
        return str(value)

    secret_file = await text("secret_file")
    url = await text("url", "http://127.0.0.1:8099")
    if not url.startswith(("http://", "https://")):
        raise ConfigError(f"url {url!r} is neither http:// nor https://")
    port = await node.declare_parameter("~notify_port", 0, minimum=0, maximum=65535, read_only=True)
    timeout_s = await node.declare_parameter(
        "~timeout_s", 5.0, minimum=0.1, maximum=120.0, read_only=True
    )
    profiles = await node.declare_parameter("~profiles", [], type="string[]", read_only=True)
    return Connection(
        backend=await text("backend", "nef", ("seal", "nef", "camara")),
        url=url,
        group=await text("group", "simple_ros"),
        mode=await text("mode", Mode.DYNAMIC.value, [mode.value for mode in Mode]),
        credentials=Credentials(
            await text("token_url"),
            await text("client_id"),
            _secret(secret_file),
            await text("scope"),
        ),
        ca_file=await text("ca_file"),
        cert_file=await text("cert_file"),
        key_file=await text("key_file"),
        timeout_s=float(timeout_s),
        notify_host=await text("notify_host", "127.0.0.1"),
        notify_port=int(port),
        notify_url=await text("notify_url"),
        notify_cert=await text("notify_cert"),
        notify_key=await text("notify_key"),
        journal=await text("journal"),
        af_id=await text("af_id", "simple_ros"),
        qos_reference=await text("qos_reference", "5qi_{qci}"),
        profiles=_table("profiles", profiles) or dict(DEFAULT_PROFILES),
        compat=await text("compat", "", ("", "ericsson")),
    )


def _secret(path: str) -> str:
    """From a file, or else the environment: parameters are seen by everybody."""
    if not path:
        return os.environ.get(SECRET_VARIABLE, "")
    try:
        return Path(path).read_text("utf-8").strip()
    except OSError as error:
        raise ConfigError(f"secret_file {path}: {error.strerror}") from error


def _table(what: str, items: Sequence[str]) -> dict[str, str]:
    """``KEY=VALUE`` as a table; the last ``=`` counts."""
    table = {}
    for item in items:
        key, _, value = item.rpartition("=")
        if not key or not value:
            raise ConfigError(f"{what}: {item!r} is not KEY=VALUE")
        table[key] = value
    return table


async def watcher_settings(node: NodeHandle) -> WatcherSettings:
    """Declare how the watcher works.

    Raises:
        ConfigError: A parameter makes no sense.
    """

    async def number(name: str, default: float, least: float, most: float) -> float:
        value = await node.declare_parameter(
            f"~{name}", default, minimum=least, maximum=most, read_only=True
        )
        return float(value)

    declare = node.declare_parameter
    authorised = await declare("~authorised", [], type="int[]", read_only=True)
    unknown = set(authorised) - RESERVED
    if unknown:
        raise ConfigError(f"authorised: {sorted(unknown)} is none of {sorted(RESERVED)}")
    mapper = MapperSettings(
        five_g=bool(await declare("~five_g", False, read_only=True)),
        authorised=frozenset(authorised),
        reliable_error_rate=await number("reliable_error_rate", 1e-5, 1e-9, 0.5),
        best_effort_error_rate=await number("best_effort_error_rate", 1e-2, 1e-9, 0.5),
        min_window_s=await number("min_window_s", 2.0, 0.05, 60.0),
    )
    session = SessionSettings(
        mode=Mode(node.parameters["~mode"]),
        dwell_s=await number("dwell_s", 5.0, 0.0, 600.0),
        retry_s=await number("retry_s", 1.0, 0.05, 60.0),
        duration_s=int(await number("session_s", 600.0, 2.0, 86_400.0)),
        monitors=bool(await declare("~monitors", True, read_only=True)),
    )
    identities = Identities(
        _table("ues", await declare("~ues", [], type="string[]", read_only=True)),
        str(await declare("~gpsi", "", read_only=True)),
    )
    return WatcherSettings(session, mapper, identities, await number("idle_s", 60.0, 0.5, 86_400.0))


def receiver_of(wiring: Connection) -> NotificationReceiver:
    """Where notifications come.

    Raises:
        ConfigError: The certificate cannot be read.
    """
    if not wiring.notify_cert:
        return NotificationReceiver(wiring.notify_url)
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        tls.load_cert_chain(wiring.notify_cert, wiring.notify_key or None)
    except (ssl.SSLError, OSError) as error:
        raise ConfigError(f"notify_cert {wiring.notify_cert}: {error}") from error
    return NotificationReceiver(wiring.notify_url, tls)


def backend_of(
    wiring: Connection, receiver: NotificationReceiver, heard: OnNotification
) -> ExposureBackend:
    """What asks the network.

    Raises:
        ConfigError: A parameter makes no sense, or a file is missing.
    """
    tls = client_tls(wiring.ca_file, wiring.cert_file, wiring.key_file)
    client = ApiClient(
        wiring.url, StandardTransport(tls), wiring.credentials, timeout_s=wiring.timeout_s
    )
    match wiring.backend:
        case "seal":
            return SealBackend(client, receiver, heard, compat=wiring.compat)
        case "camara":
            return CamaraBackend(client, receiver, heard, profiles=wiring.profiles)
    return NefBackend(client, receiver, heard, af_id=wiring.af_id, reference=wiring.qos_reference)
