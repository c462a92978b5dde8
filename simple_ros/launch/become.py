"""Become a command that ends with its parent, within limits.

Usage: ``python become.py PARENT_PID [cwd=PATH] [memory=BYTES] [cpu_seconds=N] [files=N] [nice=N] --
COMMAND...``.

A parent that is killed with SIGKILL can end nobody. Linux can: a process may ask to be sent a signal
when its parent ends (``PR_SET_PDEATHSIG``), and the wish survives ``execve``. It must be made by the
child, between fork and exec, where Python code of a parent with threads (gRPC has some) may
deadlock. So the parent starts this file, which makes the wish, sets the limits and then becomes the
command: same process id, and the command needs to know nothing. The signal is SIGTERM, so that a
robot's node can still stop its motors.

The wish is about the *thread* that started the process: it must live as long as the parent.
Elsewhere than on Linux there is no such wish.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys

_PR_SET_PDEATHSIG = 1
_NOT_FOUND, _NOT_RUN = 127, 126
_RESOURCES = {
    "memory": resource.RLIMIT_DATA,
    "cpu_seconds": resource.RLIMIT_CPU,
    "files": resource.RLIMIT_NOFILE,
}


def main() -> None:
    """Run as described above; this file is started by path, with none of the library imported."""
    end = sys.argv.index("--")
    parent, wishes, command = int(sys.argv[1]), sys.argv[2:end], sys.argv[end + 1 :]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:
            sys.exit("the parent ended before its child began")
    # A shell starts background jobs with SIGINT ignored, which would be inherited.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    for wish in wishes:
        name, _, value = wish.partition("=")
        try:
            _carry_out(name, value)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            _fail(f"cannot set {name} to {value}: {reason}", _NOT_RUN)
    try:
        os.execvp(command[0], command)  # noqa: S606
    except OSError as error:
        code = _NOT_FOUND if isinstance(error, FileNotFoundError) else _NOT_RUN
        _fail(f"cannot run {command[0]}: {error.strerror}", code)


def _carry_out(name: str, value: str) -> None:
    if name == "cwd":
        os.chdir(value)
    elif name == "nice":
        os.setpriority(os.PRIO_PROCESS, 0, int(value))
    else:
        kind, soft = _RESOURCES[name], int(value)
        # The signal of the soft limit of computing time may be caught; a second later it is not.
        hard = soft + 1 if name == "cpu_seconds" else soft
        resource.setrlimit(kind, (soft, hard))


def _fail(line: str, code: int) -> None:
    print(line, file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
