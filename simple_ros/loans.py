"""Large buffers that links send from where they are.

A camera image that does not fit a socket at once has to wait, and while it waits nobody may change it. ``publish``
returns at once, so the rest is copied, which costs a large part of sending it. ``publish_async`` may wait
instead: the links borrow the buffers until the operating system has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Protocol, Self

__all__ = ["Borrower", "Loan"]


class Borrower(Protocol):
    """A link as a loan sees it.

    Attributes:
        turns: How often it has sent, or given up, all that waited.
    """

    turns: int

    def keep_own(self) -> None:
        """Copy what is borrowed and still needed."""


class Loan:
    """Who still needs the buffers of one message. Left early, it makes the links copy what they need."""

    def __init__(self) -> None:
        self._borrowers: Sequence[tuple[Borrower, int]] = ()

    def add(self, borrower: Borrower) -> None:
        """A link needs the buffers until its next turn."""
        self._borrowers = (*self._borrowers, (borrower, borrower.turns))

    @property
    def is_open(self) -> bool:
        """Whether anybody still needs the buffers."""
        return any(borrower.turns == turns for borrower, turns in self._borrowers)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for borrower, turns in self._borrowers:
            if borrower.turns == turns:
                borrower.keep_own()
