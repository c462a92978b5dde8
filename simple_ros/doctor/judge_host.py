"""Is the host in a state to run a robot: its clock, its limits, its devices?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from simple_ros.doctor.findings import Finding, ok, warning

__all__ = [
    "ChronyTracking",
    "Clock",
    "Host",
    "SerialPort",
    "judge_clock",
    "judge_host",
    "parse_chrony_tracking",
]

_MAX_OFFSET_S = 0.01
_MAX_JUMP_S = 0.02
_RELEASE_YEAR = 2026
_USUAL_FILES = 1024
_FILES_OF_A_NODE = 64
_TCP_BUFFER = 1 << 20
_SHM = "/dev/shm"  # noqa: S108  (looked at, not written)
_SHARED_MEMORY = 64 << 20
_SCALING_DRIVERS = ("intel_pstate", "amd-pstate", "amd-pstate-epp")


@dataclass(frozen=True, slots=True)
class ChronyTracking:
    """What ``chronyc -c tracking`` tells.

    Attributes:
        source: Name or address of the time source.
        stratum: Steps from a reference clock; 0 if there is no source.
        offset_s: By how much the clock is off, in seconds (positive: it is slow).
        error_s: Half the root delay plus the root dispersion: the most the clock may be off.
        is_synchronised: Whether chrony itself says so.
    """

    source: str
    stratum: int
    offset_s: float
    error_s: float
    is_synchronised: bool


def parse_chrony_tracking(text: str) -> ChronyTracking | None:
    """The line of ``chronyc -c tracking``; None if it is none."""
    cells = text.strip().split(",")
    try:
        return ChronyTracking(
            source=cells[1] or cells[0],
            stratum=int(cells[2]),
            offset_s=float(cells[4]),
            error_s=float(cells[10]) / 2 + float(cells[11]),
            is_synchronised=cells[13] != "Not synchronised",
        )
    except (IndexError, ValueError):
        return None


@dataclass(frozen=True, slots=True)
class Clock:
    """What was found out about the clock.

    Attributes:
        year: Of the clock.
        kernel: Whether the kernel counts its clock as synchronised; None if it does not tell.
        kernel_error_s: The most by which the kernel says it may be off, in seconds.
        timedatectl: What ``timedatectl`` says about that; None if it says nothing.
        chrony: What chrony says; None if it does not run here.
        jump_s: By how much the clock was set forward or back while the doctor ran, in seconds.
        is_master_local: Whether the Master is on this host; None if unknown.
    """

    year: int
    kernel: bool | None = None
    kernel_error_s: float = 0.0
    timedatectl: bool | None = None
    chrony: ChronyTracking | None = None
    jump_s: float = 0.0
    is_master_local: bool | None = None


def judge_clock(found: Clock) -> list[Finding]:
    """All findings about the clock."""
    findings = [_synchronised(found), _against_master(found)]
    if found.year < _RELEASE_YEAR:
        findings.append(
            warning(
                "clock",
                f"it is the year {found.year} here: the clock was never set",
                "let it be set by the network ('timedatectl set-ntp true'), or fit a real-time clock",
            )
        )
    if abs(found.jump_s) > _MAX_JUMP_S:
        findings.append(
            warning(
                "clock",
                f"it was set by {found.jump_s:+.3f} s while the doctor ran",
                "find out who sets it: two time services, or a virtual machine's host",
            )
        )
    return findings


def _synchronised(found: Clock) -> Finding:
    fix = "'apt install chrony' or 'timedatectl set-ntp true'; for nodes on one host it does not matter"
    chrony = found.chrony
    if chrony is not None:
        text = f"chrony: {chrony.offset_s * 1e3:+.3f} ms from {chrony.source}, at most {chrony.error_s * 1e3:.1f} ms off"
        if not chrony.is_synchronised:
            return warning("clock", "chrony runs and has no time source", "see 'chronyc sources'")
        if abs(chrony.offset_s) > _MAX_OFFSET_S:
            return warning(
                "clock", text, "see 'chronyc sources'; 'chronyc makestep' sets it at once"
            )
        return ok("clock", text)
    if found.kernel or found.timedatectl:
        by = f"the kernel says at most {found.kernel_error_s * 1e3:.0f} ms off"
        return ok("clock", f"synchronised ({by if found.kernel else 'says timedatectl'})")
    if found.kernel is None and found.timedatectl is None:
        return warning("clock", "whether it is synchronised cannot be told here", fix)
    return warning("clock", "not synchronised: stamps of several hosts do not compare", fix)


def _against_master(found: Clock) -> Finding:
    check = "clock and master"
    if found.is_master_local is None:
        return ok(check, "where the Master is, is not known")
    if found.is_master_local:
        return ok(check, "the Master is on this host: one clock")
    return ok(
        check, "the offset cannot be measured (a Master tells no time); run the doctor there, too"
    )


@dataclass(frozen=True, slots=True)
class SerialPort:
    """A serial device, such as a Pico.

    Attributes:
        path: Of the device.
        group: That may use it.
        is_allowed: Whether we may.
    """

    path: str
    group: str
    is_allowed: bool


@dataclass(frozen=True, slots=True)
class Host:
    """What was found out about limits and devices; None where the host does not tell.

    Attributes:
        open_files: Soft and hard limit of open files per process; -1 is none.
        tcp_buffers: Largest receive and send buffer the kernel gives a TCP connection, in bytes.
        core_buffers: ``net.core.rmem_max`` and ``wmem_max``, in bytes.
        shared_memory: Size and free part of ``/dev/shm``, in bytes.
        governors: CPU governors in use, each with its scaling driver.
        serial_ports: Serial devices.
    """

    open_files: tuple[int, int] | None = None
    tcp_buffers: tuple[int, int] | None = None
    core_buffers: tuple[int, int] | None = None
    shared_memory: tuple[int, int] | None = None
    governors: tuple[tuple[str, str], ...] = ()
    serial_ports: tuple[SerialPort, ...] = ()


def judge_host(found: Host, busiest: tuple[str, int] = ("", 0)) -> list[Finding]:
    """All findings about limits and devices.

    Args:
        found: The facts.
        busiest: The node with the most links, and how many.
    """
    return [
        *_open_files(found, busiest),
        *_buffers(found),
        *_shared_memory(found),
        *_governors(found.governors),
        *_serial_ports(found.serial_ports),
    ]


def _open_files(found: Host, busiest: tuple[str, int]) -> Iterator[Finding]:
    if found.open_files is None:
        return
    soft, hard = found.open_files
    node, links = busiest
    text = f"a process may have {soft}"
    fix = f"'ulimit -n {hard if 0 < hard < 65536 else 65536}' before starting nodes, or LimitNOFILE= in a systemd unit"
    if soft < 0:  # how Linux writes that there is none
        yield ok("open files", "no limit")
    elif links + _FILES_OF_A_NODE > soft:
        yield warning("open files", f"{text}; node {node} has {links} links, each is one", fix)
    elif soft < _USUAL_FILES:
        yield warning("open files", f"{text}; each link between two nodes is one", fix)
    else:
        yield ok("open files", f"{text} (up to {hard})")


def _buffers(found: Host) -> Iterator[Finding]:
    if found.tcp_buffers is not None:
        receive, send = found.tcp_buffers
        text = f"a TCP link grows to {_size(receive)} for receiving, {_size(send)} for sending"
        if min(receive, send) < _TCP_BUFFER:
            yield warning(
                "buffers",
                f"{text}: large messages come in small pieces",
                "sysctl -w net.ipv4.tcp_rmem='4096 131072 6291456' net.ipv4.tcp_wmem='4096 16384 4194304'",
            )
        else:
            yield ok("buffers", text)
    if found.core_buffers is not None:
        receive, send = found.core_buffers
        yield ok(
            "buffers",
            f"net.core.rmem_max {_size(receive)}, wmem_max {_size(send)}: for sockets that ask for a size, "
            "which TCP links do not",
        )


def _size(count: int) -> str:
    if count < 1 << 30:
        return f"{count / (1 << 20):.3g} MiB"
    return f"{count / (1 << 30):.3g} GiB"


def _shared_memory(found: Host) -> Iterator[Finding]:
    if found.shared_memory is None:
        return
    size, free = found.shared_memory
    text = f"{_SHM} has {_size(free)} of {_size(size)} free"
    if free < _SHARED_MEMORY // 4 or size < _SHARED_MEMORY:
        yield warning(
            "shared memory",
            f"{text}; TCP links need none, programs that share images through it do",
            f"'mount -o remount,size=1G {_SHM}'; in Docker '--shm-size=1g'",
        )
    else:
        yield ok("shared memory", text)


def _governors(governors: Sequence[tuple[str, str]]) -> Iterator[Finding]:
    for governor, driver in governors:
        slow = governor in ("powersave", "conservative") and driver not in _SCALING_DRIVERS
        if slow:
            yield warning(
                "CPU governor",
                f"{governor!r} ({driver}): the CPU wakes slowly, which adds to latency",
                "'cpupower frequency-set -g performance' (or schedutil)",
            )
        else:
            yield ok("CPU governor", f"{governor!r} ({driver})")


def _serial_ports(ports: Sequence[SerialPort]) -> Iterator[Finding]:
    for port in ports:
        if port.is_allowed:
            yield ok("serial port", f"{port.path} may be used")
        else:
            yield warning(
                "serial port",
                f"{port.path} may not be used by this user",
                f"'sudo usermod -aG {port.group} $USER', then log in again",
            )
