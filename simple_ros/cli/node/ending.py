"""How a node is brought to its end from outside.

A node of ours obeys one peer frame on the port it listens on: topic `CONTROL_TOPIC`, a `Shutdown`. A
C++ node has no such thing; there is only its process, if that is on this host.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simple_ros.cli.hosts import is_this_host
from simple_ros.cli.lookup import address_text

if TYPE_CHECKING:
    import psutil

    from simple_ros.net.master_client import MasterClient
    from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = [
    "CONTROL_TOPIC",
    "Outcome",
    "ask_to_end",
    "end_processes",
    "shutdown_frame",
    "wait_until_unlisted",
]

CONTROL_TOPIC = "__node_control"
_POLL_S = 0.05
_CONNECT_TIMEOUT_S = 1.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a node.

    Attributes:
        name: Its name.
        error: Why it has not ended; empty if it has.
        pid: The process that got SIGTERM, if it was ended so.
    """

    name: str
    error: str = ""
    pid: int | None = None

    def line(self) -> str:
        """The end of a node, for people."""
        how = "" if self.pid is None else f" (SIGTERM to process {self.pid})"
        return f"killed {self.name}{how}"

    def json(self) -> dict[str, Any]:
        """The outcome as a value for JSON."""
        return {
            "name": self.name,
            "killed": not self.error,
            "pid": self.pid,
            "error": self.error or None,
        }


# -- by request ------------------------------------------------------------------------------------


def shutdown_frame(node: ros.NodeInfo, asked_by: str) -> bytes:
    """The frame that ends a node, and no other one that may have its port by now."""
    from simple_ros.rpc.master_pb2 import Shutdown
    from simple_ros.wire.framing import encode_frame, encode_header

    request = Shutdown(
        instance_id=node.instance_id, reason="simple-ros node kill", asked_by=asked_by
    )
    header = encode_header(CONTROL_TOPIC, Shutdown.DESCRIPTOR.full_name)
    return encode_frame(header, request.SerializeToString())


async def ask_to_end(node: ros.NodeInfo, timeout_s: float) -> str:
    """Send a node the request, at the first of its addresses that takes it; empty, or why not."""
    from simple_ros.net.addresses import split_address

    frame = shutdown_frame(node, f"{socket.gethostname()}, process {os.getpid()}")
    by_tcp = [address for address in node.addresses if "://" not in address]
    addresses = [address_text(node), *by_tcp]
    reasons = []
    for address in addresses:
        try:
            await _send(*split_address(address), frame, min(timeout_s, _CONNECT_TIMEOUT_S))
            return ""
        except TimeoutError:
            reasons.append(f"no answer at {address}")
        except ConnectionRefusedError:
            reasons.append(f"nobody listens at {address}")
        except (OSError, ValueError) as error:
            reasons.append(f"{address}: {getattr(error, 'strerror', None) or error}")
    return f"{node.node_name} cannot be reached: {', '.join(reasons)}"


async def _send(host: str, port: int, frame: bytes, timeout_s: float) -> None:
    async with asyncio.timeout(timeout_s):
        reader, writer = await asyncio.open_connection(host, port)
    try:
        writer.write(frame)
        writer.write_eof()
        # Closing before it has read would be a reset if it had sent something; its own end, or
        # silence, is as good.
        with contextlib.suppress(TimeoutError, ConnectionError):
            async with asyncio.timeout(timeout_s):
                await reader.read()
    finally:
        writer.close()


async def wait_until_unlisted(
    client: MasterClient, nodes: Sequence[ros.NodeInfo], end: float
) -> list[ros.NodeInfo]:
    """Wait for the Master to list none of these starts of nodes.

    Args:
        client: Connection to the Master.
        nodes: As it listed them.
        end: Time of the event loop after which it is given up.

    Returns:
        Those it lists still.
    """
    loop = asyncio.get_running_loop()
    left = list(nodes)
    while left:
        listed = {(node.node_name, node.instance_id) for node in await client.get_nodes()}
        left = [node for node in left if (node.node_name, node.instance_id) in listed]
        if loop.time() >= end:
            break
        if left:
            await asyncio.sleep(_POLL_S)
    return left


# -- by signal -------------------------------------------------------------------------------------


async def end_processes(
    nodes: Sequence[ros.NodeInfo], timeout_s: float, master: str | None, *, by_signal: bool
) -> list[Outcome]:
    """End nodes of another implementation with SIGTERM, or say why not."""
    outcomes = []
    ending: list[tuple[str, psutil.Process]] = []
    for node in nodes:
        error, process = await asyncio.to_thread(_process_to_end, node, master, by_signal=by_signal)
        if process is None:
            outcomes.append(Outcome(node.node_name, error))
        else:
            ending.append((node.node_name, process))
    end = asyncio.get_running_loop().time() + timeout_s
    for name, process in ending:
        outcomes.append(await _ended(name, process, end, timeout_s))
    return outcomes


def _process_to_end(
    node: ros.NodeInfo, master: str | None, *, by_signal: bool
) -> tuple[str, psutil.Process | None]:
    """The process of a node, which got SIGTERM; or why there is none, empty if it has ended."""
    import psutil

    start = f"{node.node_name} is a C++ node and cannot be asked to end"
    where = address_text(node)
    if not is_this_host(node.ip, master):
        return f"{start}; it listens at {where}, on another host: end its process there", None
    if not by_signal:
        return f"{start}; with --signal, the process that listens at {where} gets SIGTERM", None
    try:
        process = listening_process(node.ip, node.port)
        if process is None:
            return f"{start}; no process listens at {where} any more", None
        process.terminate()
    except psutil.AccessDenied:
        return f"{start}; the process that listens at {where} is another user's", None
    except psutil.NoSuchProcess:
        return "", None
    return "", process


def listening_process(ip: str, port: int) -> psutil.Process | None:
    """The process of this host, not this one, that listens on a TCP address.

    Raises:
        psutil.AccessDenied: This user may not see which one it is.
    """
    import psutil

    hosts = {ip, "0.0.0.0", "::", f"::ffff:{ip}"}
    for connection in psutil.net_connections(kind="tcp"):
        if connection.status != psutil.CONN_LISTEN or not connection.laddr:
            continue
        if connection.laddr.port == port and connection.laddr.ip in hosts:
            if connection.pid is None:
                raise psutil.AccessDenied
            if connection.pid != os.getpid():
                return psutil.Process(connection.pid)
    return None


async def _ended(name: str, process: psutil.Process, end: float, timeout_s: float) -> Outcome:
    loop = asyncio.get_running_loop()
    while _runs(process):
        if loop.time() >= end:
            error = f"{name} did not end within {timeout_s:g} s of SIGTERM to process {process.pid}"
            return Outcome(name, error, process.pid)
        await asyncio.sleep(_POLL_S)
    return Outcome(name, pid=process.pid)


def _runs(process: psutil.Process) -> bool:
    """Whether a process has not ended; one that its parent has not yet looked after has."""
    import psutil

    try:
        return bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False
