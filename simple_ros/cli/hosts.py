"""Which node is on this host, and how far away the others are."""

from __future__ import annotations

import asyncio
import socket

__all__ = ["connect", "is_this_host"]

_CONNECT_TIMEOUT_S = 2.0


async def connect(host: str, port: int) -> tuple[float | None, str]:
    """Milliseconds until the connection stood, or None and why it does not."""
    loop = asyncio.get_running_loop()
    start = loop.time()
    try:
        async with asyncio.timeout(_CONNECT_TIMEOUT_S):
            _, writer = await asyncio.open_connection(host, port)
    except ConnectionRefusedError:
        return None, "nobody listens"
    except TimeoutError:
        return None, f"no answer within {_CONNECT_TIMEOUT_S:g} s"
    except OSError as error:
        return None, error.strerror or str(error)
    taken_ms = (loop.time() - start) * 1e3
    writer.close()
    return taken_ms, ""


def is_this_host(ip: str, master: str | None = None) -> bool:
    """Whether a node that gave this address to its Master runs on the host of this program.

    A loopback address does not say whose: such a node is where its Master is.

    Args:
        ip: As in `NodeInfo`.
        master: Where the Master is, as for `master_address`.
    """
    from simple_ros.net.addresses import is_loopback, master_address, split_address

    own = _own_addresses()
    if not is_loopback(ip):
        return ip in own
    host, port = split_address(master_address(master))
    if is_loopback(host):
        return True
    try:
        infos = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except OSError:
        return False
    return any(is_loopback(str(info[4][0])) or info[4][0] in own for info in infos)


def _own_addresses() -> set[str]:
    import psutil

    return {entry.address for entries in psutil.net_if_addrs().values() for entry in entries}
