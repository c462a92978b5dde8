"""What may be wrong with the mock network on request: pure."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Faults"]


@dataclass(slots=True)
class Faults:
    """What is wrong now.

    Attributes:
        is_down: Connections are closed without an answer.
        delay_s: Before each answer.
        status: Answered instead of the real answer; 0 for none.
        status_count: How often; -1 for always.
        malformed: Answers with a body have JSON that is none.
        loses_notifications: None is sent.
        retry_after_s: Said with 429 and 503.
    """

    is_down: bool = False
    delay_s: float = 0.0
    status: int = 0
    status_count: int = -1
    malformed: bool = False
    loses_notifications: bool = False
    retry_after_s: int = 0

    def take_status(self) -> int:
        """The status to answer with instead; 0 for none."""
        if not self.status or self.status_count == 0:
            return 0
        if self.status_count > 0:
            self.status_count -= 1
        return self.status
