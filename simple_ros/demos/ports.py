"""A port for a program that a demo starts."""

from __future__ import annotations

import contextlib
import socket

__all__ = ["free_port"]

_TRIED = 20


def free_port(first: int) -> int:
    """That port or one of the next that nobody listens on; 0, any, if all are taken."""
    for port in range(first, min(first + _TRIED, 65536)) if first else ():
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port
    return 0
