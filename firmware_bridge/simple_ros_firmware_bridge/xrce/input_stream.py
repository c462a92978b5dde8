"""A reliable stream from a board: in order, each once, with holes asked for."""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros_firmware_bridge.xrce import wire
from simple_ros_firmware_bridge.xrce.numbers import after, distance
from simple_ros_firmware_bridge.xrce.patience import Patience

__all__ = ["InputCounters", "ReliableInput"]

_WINDOW = 16
_TROUBLE_KEPT = 0.99
_TROUBLED = 0.5
_FRAGMENT = bytes((wire.SubmessageId.FRAGMENT,))


@dataclass
class InputCounters:
    """What happened on a stream.

    Attributes:
        messages: Taken, each once.
        duplicates: Came again.
        asked: Questions for a message that was waited for.
        holes: Messages that came after one that was missing.
        skipped: Messages given up: the board can no longer send them.
    """

    messages: int = 0
    duplicates: int = 0
    asked: int = 0
    holes: int = 0
    skipped: int = 0


class ReliableInput:
    """Puts messages in order and says what to answer.

    Args:
        stream: Its number.
        expected: The number of the next message; None is learnt from what comes (after a restart).
    """

    def __init__(self, stream: int, expected: int | None = 0) -> None:
        self.stream = stream
        self.expected = expected
        self.counters = InputCounters()
        self.patience = Patience()
        self._held: dict[int, bytes] = {}
        self._asked_at: dict[int, float] = {}
        self._recently_asked: dict[int, bool] = {}
        self._answered_at: float | None = None
        self._heard_at: float | None = None
        self._questions = 0
        self._in_train = False
        self._trouble = 0.0

    def receive(self, sequence: int, body: bytes, now: float) -> list[bytes]:
        """What can be handed on now, in order. Answer with `answer` afterwards, whatever it gives."""
        if self.expected is None:
            self.expected = sequence
        self._heard_at = now
        self._questions = 0
        self._trouble *= _TROUBLE_KEPT
        ahead = distance(self.expected, sequence)
        if ahead < 0 or sequence in self._held:
            self._count_duplicate(sequence)
            return []
        if ahead >= _WINDOW:
            self._skip_to(after(sequence, 1 - _WINDOW))
        if ahead:
            self.counters.holes += 1
        self._measure(now, sequence in self._recently_asked or bool(ahead))
        self._in_train = body[:1] == _FRAGMENT and not body[1] & wire.LAST_FRAGMENT
        self._held[sequence] = body
        return self._in_order()

    def _measure(self, now: float, was_asked_for: bool) -> None:
        # Fragments follow each other without an answer between them; so does what came in one read.
        gap = 0.0 if self._answered_at is None else now - self._answered_at
        follows_answer = gap > 0 and not self._in_train and not was_asked_for
        self.patience.came(gap if follows_answer else None)

    def _count_duplicate(self, sequence: int) -> None:
        self.counters.duplicates += 1
        if self._recently_asked.pop(sequence, False):
            self.patience.came_twice()

    def _in_order(self) -> list[bytes]:
        assert self.expected is not None
        ready = []
        while (body := self._held.pop(self.expected, None)) is not None:
            ready.append(body)
            self._asked_at.pop(self.expected, None)
            self.expected = after(self.expected)
        self.counters.messages += len(ready)
        return ready

    def _skip_to(self, sequence: int) -> None:
        """The board went on without waiting: what is older is not coming any more."""
        assert self.expected is not None
        while distance(self.expected, sequence) > 0:
            if self._held.pop(self.expected, None) is None:
                self.counters.skipped += 1
            self._asked_at.pop(self.expected, None)
            self.expected = after(self.expected)

    def heartbeat(self, first: int, now: float) -> list[bytes]:
        """The board has nothing before ``first`` any more. Answer with `answer`.

        Returns:
            What can be handed on since the board gave up what was missing before it.
        """
        self._heard_at = now
        if self.expected is None:
            self.expected = first
        if 0 < distance(self.expected, first) <= _WINDOW:
            self._skip_to(first)
            return self._in_order()
        return []

    def answer(self, now: float, last: int | None = None) -> bytes:
        """The ACKNACK to send now, as a submessage.

        A hole is asked for once per wait, not with every message that follows it.

        Args:
            now: The time.
            last: The last message the board says it has sent.
        """
        assert self.expected is not None
        highest = max((distance(self.expected, number) for number in self._held), default=0)
        if last is not None:
            highest = max(highest, distance(self.expected, last) + 1)
        missing = 0
        for offset in range(min(highest, _WINDOW)):
            number = after(self.expected, offset)
            if number not in self._held and self._may_ask(number, now):
                missing |= 1 << offset
                self._note_asked(number, now)
        self._answered_at = now
        return wire.acknack(self.expected, missing, self.stream)

    @property
    def is_answered_twice(self) -> bool:
        """Whether the answer goes out twice: on a line that damages messages it costs less than a lost one.

        A board that waits for an answer that was lost stands still until it is asked. An answer that asks for
        something goes once, as the board would send that twice.
        """
        return self._trouble > _TROUBLED and not self._held

    def damaged(self, now: float) -> bytes | None:
        """Something was damaged on its way, and may have been the next message: what `ask` gives."""
        self._trouble += 1
        return self.ask(now)

    def ask(self, now: float, *, by_patience: bool = False) -> bytes | None:
        """ACKNACK that asks for the next message: it is quiet for long, or there is another reason.

        None if it was asked for just now, or if nothing is known of the stream yet.
        """
        if self.expected is None:
            return None
        asked_at = self._asked_at.get(self.expected)
        if asked_at is not None and now - asked_at < self.patience.wait_s / 4:
            return None
        self._note_asked(self.expected, now, by_patience=by_patience)
        self._answered_at = now
        self.counters.asked += 1
        return wire.acknack(self.expected, 1, self.stream)

    def _may_ask(self, number: int, now: float) -> bool:
        asked_at = self._asked_at.get(number)
        return asked_at is None or now - asked_at >= self.patience.wait_s

    def _note_asked(self, number: int, now: float, *, by_patience: bool = False) -> None:
        # Only a question that came of impatience can come too early.
        self._asked_at[number] = now
        self._recently_asked[number] = by_patience
        if len(self._recently_asked) > 2 * _WINDOW:
            del self._recently_asked[next(iter(self._recently_asked))]

    def next_timeout(self) -> float | None:
        """When to call `handle_timeout`, None if nothing is waited for."""
        if self._heard_at is None or self._answered_at is None or self.expected is None:
            return None
        due = self._answered_at + self.patience.wait_after(self._questions)
        return due if self.patience.still_asks(due - self._heard_at) else None

    def handle_timeout(self, now: float) -> bytes | None:
        """The question that is due, if one is."""
        due = self.next_timeout()
        if due is None or now < due:
            return None
        self._questions += 1
        return self.ask(now, by_patience=True)
