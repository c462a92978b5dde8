"""Telling whoever started this program that it is ready.

`simple-ros launch` and systemd understand the same word: ``READY=1`` in a datagram to the socket named
by the environment variable ``NOTIFY_SOCKET`` (the sd_notify protocol).
"""

from __future__ import annotations

import os

__all__ = ["ready"]


def ready() -> bool:
    """Say that this program is ready; those that come after it are started now.

    Call it once what others rely on works: the camera is open, the map is loaded. May be called
    again, from any thread.

    Returns:
        Whether anybody is told; False if ``NOTIFY_SOCKET`` is not set.

    Raises:
        OSError: The socket named there does not take it.
    """
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    import socket

    # A leading @ stands for the zero byte of Linux's abstract sockets.
    target = f"\0{address[1:]}" if address.startswith("@") else address
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(b"READY=1", target)
    return True
