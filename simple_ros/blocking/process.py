"""What a blocking program leaves to us while its node runs: signals, and the last word on a lost name."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

from simple_ros.errors import NodeNameTaken

__all__ = ["ProcessHooks"]


class ProcessHooks:
    """Handlers of SIGINT, SIGTERM and of uncaught errors.

    Args:
        interrupt: Called on a signal; whether it ends a spin. If not, the program ends.
    """

    def __init__(self, interrupt: Callable[[], bool]) -> None:
        self._interrupt = interrupt
        self._old_handlers: dict[int, Any] = {}
        self._old_hook: Any = None
        self._ending = False
        self._signalled = False

    def take(self) -> None:
        """Begin. Only the main thread can take signals; in another one they stay as they are."""
        self._ending = self._signalled = False
        if self._old_hook is None:
            self._old_hook, sys.excepthook = sys.excepthook, self._uncaught
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                if number not in self._old_handlers:
                    self._old_handlers[number] = signal.signal(number, self._on_signal)

    def hold(self) -> None:
        """From now on a signal interrupts nothing: the node says goodbye."""
        self._ending = True

    def give_back(self) -> None:
        """End.

        Raises:
            SystemExit: A signal came since `hold`.
        """
        if sys.excepthook == self._uncaught:
            sys.excepthook = self._old_hook
        self._old_hook = None
        self._ending = False
        is_main = threading.current_thread() is threading.main_thread()
        if is_main:
            for number, handler in self._old_handlers.items():
                signal.signal(number, handler)
            self._old_handlers.clear()
        if self._signalled:
            self._signalled = False
            if is_main:
                sys.exit(0)
            signal.raise_signal(signal.SIGTERM)  # reaches the main thread, as the first one did

    def give_up(self) -> None:
        """The program is at its end: from now on nothing interrupts it."""
        for number in self._old_handlers:
            signal.signal(number, signal.SIG_IGN)
        self._old_handlers.clear()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002
        if self._ending:
            self._signalled = True
        elif not self._interrupt():
            sys.exit(0)

    def _uncaught(
        self, kind: type[BaseException], error: BaseException, traceback: TracebackType | None
    ) -> None:
        """A name that was lost is no mistake of the program: one line says it."""
        if isinstance(error, NodeNameTaken):
            print(error, file=sys.stderr)
        else:
            self._old_hook(kind, error, traceback)
