"""Who is measured: ours, and the bare limits."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass, field
from typing import Literal

__all__ = ["LIMITS", "OURS", "Group", "Peer", "known_transports"]

Group = Literal["ours", "limit", "rival"]

_OURS = (sys.executable, "-m", "simple_ros.benchmark.ours")
_BARE = (sys.executable, "-m", "simple_ros.benchmark.bare")


@dataclass(frozen=True, slots=True)
class Peer:
    """A program that is measured, and how.

    Attributes:
        name: What it is called in tables.
        group: Ours, a bare limit, or other middleware.
        what: What it is, in words.
        command: The program; the job is its last argument.
        options: What the program is told.
        workloads: What it is measured with; None for everything.
        services: What must run beside it: ``master``, say.
        fractions: Of the messages of a workload, for peers that would take minutes.
        is_raw: Whether it carries raw bytes where the others serialise and parse protobuf.
        missing: Why it cannot run here; empty if it can.
    """

    name: str
    group: Group
    what: str
    command: tuple[str, ...]
    options: dict[str, str] = field(default_factory=dict)
    workloads: frozenset[str] | None = None
    services: tuple[str, ...] = ()
    fractions: dict[str, float] = field(default_factory=dict)
    is_raw: bool = False
    missing: str = ""

    def takes(self, workload: str) -> bool:
        """Whether it is measured with a workload."""
        return self.workloads is None or workload in self.workloads


_LARGE = frozenset({"mib", "mib30", "image30"})
_SMALL = frozenset({"small", "latency"})


def known_transports() -> tuple[str, ...]:
    """The transports of nodes that can be measured: those of the library, and installed ones."""
    from simple_ros import plugins
    from simple_ros.net.transport import DEFAULT_TRANSPORTS, InProcess

    ways = {way.value for way in InProcess}
    names = [*DEFAULT_TRANSPORTS, *plugins.names(plugins.TRANSPORTS), "tcp"]
    return tuple(dict.fromkeys(name for name in names if name not in ways))


def _no_uvloop() -> str:
    return "" if importlib.util.find_spec("uvloop") else "pip install uvloop"


def _ours(name: str, what: str, *, missing: str = "", **options: str) -> Peer:
    return Peer(name, "ours", what, _OURS, options, services=("master",), missing=missing)


def _bare(
    name: str,
    what: str,
    style: str,
    workloads: frozenset[str] | None = None,
    missing: str = "",
    **options: str,
) -> Peer:
    options = {"style": style, "transport": "tcp"} | options
    return Peer(name, "limit", what, _BARE, options, workloads, missing=missing)


def _own() -> dict[str, Peer]:
    shm = "" if "shm" in known_transports() else "this version has no transport 'shm'"
    peers = (
        _ours("ours", "simple_ros, TCP", transport="tcp"),
        _ours("ours_unix", "simple_ros, Unix sockets", transport="unix"),
        _ours("ours_shm", "simple_ros, shared memory", transport="shm", missing=shm),
        _ours(
            "ours_uvloop",
            "simple_ros, TCP, uvloop",
            transport="tcp",
            loop="uvloop",
            missing=_no_uvloop(),
        ),
        _ours("ours_blocking", "simple_ros, TCP, blocking face", transport="tcp", face="blocking"),
    )
    inside = Peer(
        "ours_inside",
        "ours",
        "simple_ros, TCP, pixels inside protobuf",
        _OURS,
        {"transport": "tcp", "pixels": "inside"},
        _LARGE,
        ("master",),
    )
    busy = Peer(
        "ours_busy",
        "ours",
        "simple_ros, Unix sockets, busy polling" + (", uvloop" if not _no_uvloop() else ""),
        _OURS,
        {"transport": "unix", "busy": "yes", "loop": "" if _no_uvloop() else "uvloop"},
        frozenset({"latency"}),
        ("master",),
    )
    return {peer.name: peer for peer in (*peers, inside, busy)}


def _limits() -> dict[str, Peer]:
    peers = (
        _bare("streams", "bare asyncio streams, TCP", "streams", _SMALL | {"mib"}),
        _bare("buffered", "bare asyncio BufferedProtocol, TCP", "buffered"),
        _bare(
            "buffered_unix",
            "bare asyncio BufferedProtocol, Unix sockets",
            "buffered",
            _SMALL | {"image30"},
            transport="unix",
        ),
        _bare("sockets", "bare blocking sockets, TCP", "blocking", _SMALL),
        _bare("tuned", "bare, with the same techniques, TCP", "tuned"),
        _bare(
            "tuned_unix",
            "bare, with the same techniques, Unix sockets",
            "tuned",
            _LARGE | {"small"},
            transport="unix",
        ),
        _bare(
            "tuned_uvloop",
            "bare, with the same techniques, TCP, uvloop",
            "tuned",
            _SMALL,
            _no_uvloop(),
            loop="uvloop",
        ),
    )
    return {peer.name: peer for peer in peers}


OURS = _own()
LIMITS = _limits()
