"""Ends process groups whose owner was killed and cannot.

Usage: ``python guard.py``, with ``+GROUP`` and ``-GROUP`` lines on its standard input: groups to end,
and groups that are gone. When the input ends, so has the owner: each group left gets SIGTERM, and
SIGKILL if it is still there after `_GRACE_S`. This reaches what `become` cannot: children of children,
and children that do not heed SIGTERM.
"""

from __future__ import annotations

import os
import signal
import sys
import time

_GRACE_S = 2.0
_LOOK_EVERY_S = 0.02


def main() -> None:
    """Run as described above; this file is started by path, with none of the library imported."""
    # SIGHUP comes to one that stands still (SIGSTOP) while its owner is killed.
    for ignored in (signal.SIGINT, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    groups: dict[int, None] = {}
    for line in sys.stdin:
        group = int(line[1:])
        if line[0] == "+":
            groups[group] = None
        else:
            groups.pop(group, None)
    left = [group for group in groups if _signalled(group, signal.SIGTERM)]
    end = time.monotonic() + _GRACE_S
    while left and time.monotonic() < end:
        time.sleep(_LOOK_EVERY_S)
        left = [group for group in left if _signalled(group, 0)]
    for group in left:
        _signalled(group, signal.SIGKILL)


def _signalled(group: int, number: int) -> bool:
    """Send a signal to a group; whether it is there."""
    try:
        os.killpg(group, number)
    except (ProcessLookupError, PermissionError):
        return False
    return True


if __name__ == "__main__":
    main()
