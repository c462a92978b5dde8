"""Become a command that ends with its parent.

Usage: ``python exit_with_parent.py PARENT_PID COMMAND...``.

A parent that is killed with SIGKILL can end nobody. Linux can: a process may ask to be sent a signal
when its parent ends (``PR_SET_PDEATHSIG``), and the wish survives ``execve``. It must be made by the
child, between fork and exec, where Python code of a parent with threads (gRPC has some) may
deadlock. So the parent starts this file, which makes the wish and then becomes the command: same
process id, and the command needs to know nothing. The signal is SIGTERM, so that a robot's node can
still stop its motors.

The wish is about the *thread* that started the process: it must live as long as the parent.
Elsewhere than on Linux this only becomes the command.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main() -> None:
    """Run as described above; this file is started by path, with none of the library imported."""
    parent, command = int(sys.argv[1]), sys.argv[2:]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:
            sys.exit("the parent ended before its child began")
    try:
        os.execvp(command[0], command)  # noqa: S606
    except OSError as error:
        sys.exit(f"cannot run {command[0]}: {error.strerror}")


if __name__ == "__main__":
    main()
