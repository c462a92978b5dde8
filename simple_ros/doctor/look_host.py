"""The clock, limits and devices of this host."""

from __future__ import annotations

import asyncio
import ctypes
import grp
import os
import resource
import shutil
import time
from pathlib import Path

from simple_ros.doctor.judge_host import Clock, Host, SerialPort, parse_chrony_tracking
from simple_ros.doctor.looking import output_of, within

__all__ = ["clock_difference", "look_at_clock", "look_at_host"]

_PROGRAM_LIMIT_S = 1.0
_YES_NO = {"yes": True, "no": False}
_TIME_ERROR = 5
_STA_UNSYNC = 0x40
_SERIAL_PORTS = ("ttyACM*", "ttyUSB*")


def clock_difference() -> float:
    """Wall clock minus monotonic clock, in seconds: it changes when the wall clock is set."""
    return time.time() - time.clock_gettime(time.CLOCK_MONOTONIC)


async def look_at_clock() -> Clock:
    """What the kernel and the time services say."""
    chrony, service = await asyncio.gather(
        within(_PROGRAM_LIMIT_S, output_of("chronyc", "-c", "tracking")),
        within(
            _PROGRAM_LIMIT_S,
            output_of("timedatectl", "show", "--property=NTPSynchronized", "--value"),
        ),
    )
    kernel, error_s = _kernel_clock()
    return Clock(
        year=time.gmtime().tm_year,
        kernel=kernel,
        kernel_error_s=error_s,
        timedatectl=_YES_NO.get(service.strip()) if isinstance(service, str) else None,
        chrony=parse_chrony_tracking(chrony) if isinstance(chrony, str) else None,
    )


class _Timex(ctypes.Structure):
    """``struct timex`` of Linux as far as it is read here; see adjtimex(2)."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 256),
    )


def _kernel_clock() -> tuple[bool | None, float]:
    """Whether the kernel counts its clock as synchronised, and its largest error in seconds."""
    try:
        adjtimex = ctypes.CDLL(None).adjtimex
    except (OSError, AttributeError):
        return None, 0.0
    state = _Timex()  # modes 0: only read
    result = adjtimex(ctypes.byref(state))
    if result < 0:
        return None, 0.0
    return result != _TIME_ERROR and not state.status & _STA_UNSYNC, state.maxerror / 1e6


def look_at_host() -> Host:
    """Limits and devices."""
    return Host(
        open_files=resource.getrlimit(resource.RLIMIT_NOFILE),
        tcp_buffers=_pair("net/ipv4/tcp_rmem", "net/ipv4/tcp_wmem"),
        core_buffers=_pair("net/core/rmem_max", "net/core/wmem_max"),
        shared_memory=_shared_memory(),
        governors=_governors(),
        serial_ports=_serial_ports(),
    )


def _pair(first: str, second: str) -> tuple[int, int] | None:
    """The last numbers of two files below /proc/sys; None where there are none."""
    try:
        left, right = (
            int(Path("/proc/sys", name).read_text().split()[-1]) for name in (first, second)
        )
    except (OSError, ValueError, IndexError):
        return None
    return left, right


def _shared_memory() -> tuple[int, int] | None:
    try:
        usage = shutil.disk_usage("/dev/shm")  # noqa: S108  (looked at, not written)
    except OSError:
        return None
    return usage.total, usage.free


def _governors() -> tuple[tuple[str, str], ...]:
    """Each governor in use, once, with its driver."""
    found = set()
    for folder in Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq"):
        try:
            governor = (folder / "scaling_governor").read_text().strip()
            driver = (folder / "scaling_driver").read_text().strip()
        except OSError:
            continue
        found.add((governor, driver))
    return tuple(sorted(found))


def _serial_ports() -> tuple[SerialPort, ...]:
    paths = sorted(path for pattern in _SERIAL_PORTS for path in Path("/dev").glob(pattern))
    return tuple(
        SerialPort(str(path), _group(path), os.access(path, os.R_OK | os.W_OK)) for path in paths
    )


def _group(path: Path) -> str:
    try:
        return grp.getgrgid(path.stat().st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"
