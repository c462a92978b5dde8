"""What is done for one flow, step by step: group, join, request, monitor, ask anew, release. Pure.

A machine: it is told what is wanted, what came of its commands, what the network said, and the time; it says what to
do next. One command is under way at a time. Whatever fails is tried again later, ever more rarely; the topic flows all the
while.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from simple_ros_engines.network_exposure.exposure.model import Event, Session
from simple_ros_engines.network_exposure.qos_mapper import Mode, Selection

__all__ = ["Action", "Command", "FlowSession", "SessionSettings", "State"]


class State(Enum):
    """Where a flow stands."""

    WAITING = "waiting"
    """Too little is known of it."""
    GROUPING = "grouping"
    JOINING = "joining"
    REQUESTING = "requesting"
    PENDING = "pending"
    """The network sets it up."""
    MONITORING = "monitoring"
    ACTIVE = "active"
    DEGRADED = "degraded"
    """The network gives less than was asked for."""
    FAILED = "failed"
    """The last command failed; it will be tried again."""
    RELEASING = "releasing"
    RELEASED = "released"


class Action(Enum):
    """What is to be done."""

    GROUP = "group"
    JOIN = "join"
    REQUEST = "request"
    MONITOR = "monitor"
    UPDATE = "update"
    RENEW = "renew"
    RELEASE = "release"


_DOING = {
    Action.GROUP: State.GROUPING,
    Action.JOIN: State.JOINING,
    Action.REQUEST: State.REQUESTING,
    Action.UPDATE: State.REQUESTING,
    Action.MONITOR: State.MONITORING,
    Action.RELEASE: State.RELEASING,
}


@dataclass(frozen=True, slots=True)
class Command:
    """What to do now.

    Attributes:
        action: What.
        selection: To ask for.
        session_id: Of the session it is about.
    """

    action: Action
    selection: Selection | None = None
    session_id: str = ""


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """How it behaves.

    Attributes:
        mode: When to ask anew.
        dwell_s: Something else must be wanted for so long before it is asked for.
        rate_change: A reserved rate that is wrong by more than this share is asked for anew.
        retry_s: After a first failure; doubled each time.
        retry_most_s: At most.
        duration_s: For how long a session is asked for; renewed when half of it has passed.
        pending_s: A session that nobody confirms for so long counts as set up: notifications get lost.
        monitors: Whether measurements are subscribed to.
    """

    mode: Mode = Mode.DYNAMIC
    dwell_s: float = 5.0
    rate_change: float = 0.25
    retry_s: float = 1.0
    retry_most_s: float = 60.0
    duration_s: int = 600
    pending_s: float = 15.0
    monitors: bool = True


class FlowSession:
    """One flow.

    Args:
        settings: How it behaves.

    Attributes:
        wanted: What the mapper says now.
        asked: What the network was asked for.
        applied_qci: What it gives; None if it does not say.
        session_id: Under which it knows the flow; empty if it does not.
        requests: Sent so far, updates among them.
        detail: What went wrong last; empty after a success.
        is_refused: Whether the network said no last, rather than nothing.
    """

    def __init__(self, settings: SessionSettings | None = None) -> None:
        self.wanted: Selection | None = None
        self.asked: Selection | None = None
        self.applied_qci: int | None = None
        self.session_id = ""
        self.requests = 0
        self.detail = ""
        self.is_refused = False
        self._settings = settings or SessionSettings()
        self._running: Command | None = None
        self._prepared: set[Action] = set()
        self._monitored = False
        self._pending = False
        self._degraded = False
        self._releasing = False
        self._differs_since: float | None = None
        self._renew_at: float | None = None
        self._pending_until = 0.0
        self._failures = 0
        self._retry_at = 0.0

    @property
    def state(self) -> State:
        """Where it stands."""
        if self._running is not None and self._running.action in _DOING:
            return _DOING[self._running.action]
        if self._releasing:
            return State.RELEASING if self.session_id or self._running else State.RELEASED
        if self._failures:
            return State.FAILED
        if not self.session_id:
            return State.WAITING
        if self._pending:
            return State.PENDING
        return State.DEGRADED if self._degraded else State.ACTIVE

    @property
    def is_over(self) -> bool:
        """Whether it was released, and nothing is left to do."""
        return self.state is State.RELEASED

    # -- what it is told -------------------------------------------------------------------------

    def want(self, selection: Selection, now_s: float) -> None:
        """The mapper's view of the flow now; a released flow begins anew."""
        if self._releasing and self.is_over:
            self._releasing = False
        self.wanted = selection
        if self.asked is None or not self._is_other(selection, self.asked):
            self._differs_since = None
        elif self._differs_since is None:
            self._differs_since = now_s

    def release(self) -> None:
        """Nothing is wanted any more."""
        self._releasing = True
        self.wanted = None
        self._differs_since = None
        self._failures, self._retry_at = 0, 0.0

    def done(self, now_s: float, session: Session | None = None) -> None:
        """The command under way succeeded."""
        command, self._running = self._running, None
        assert command is not None
        self._failures, self._retry_at, self.detail, self.is_refused = 0, 0.0, "", False
        match command.action:
            case Action.GROUP | Action.JOIN:
                self._prepared.add(command.action)
            case Action.REQUEST | Action.UPDATE:
                assert session is not None
                self._has_session(command, session, now_s)
            case Action.MONITOR:
                self._monitored = True
            case Action.RENEW:
                if session is not None:
                    self._same_session(session)
                self._renew_at = now_s + self._settings.duration_s / 2
            case Action.RELEASE:
                self._forget_session()

    def failed(self, now_s: float, detail: str, retry_after_s: float | None = None) -> None:
        """The command under way failed."""
        command, self._running = self._running, None
        assert command is not None
        self.detail = detail
        self._failures += 1
        delay_s = min(
            self._settings.retry_most_s, self._settings.retry_s * 2 ** (self._failures - 1)
        )
        self._retry_at = now_s + max(delay_s, retry_after_s or 0.0)
        if command.action is Action.MONITOR:
            # The quality is there all the same.
            self._monitored = True
            self._failures, self._retry_at = 0, 0.0

    def lost(self, now_s: float, detail: str) -> None:
        """The network does not know the session of the command under way."""
        command, self._running = self._running, None
        assert command is not None
        self._forget_session()
        self.detail = detail
        self._failures = 0
        self._retry_at = 0.0 if self._releasing else now_s + self._settings.retry_s

    def told(self, event: Event, applied_qci: int | None, now_s: float, detail: str = "") -> None:
        """The network said something about the session."""
        if applied_qci is not None:
            self.applied_qci = applied_qci
        match event:
            case Event.GRANTED | Event.RECOVERED:
                self._pending = self._degraded = False
                if applied_qci is None and self.asked is not None:
                    self.applied_qci = self.asked.qci
            case Event.DOWNGRADED:
                self._pending, self._degraded = False, True
                self.detail = detail
            case Event.TERMINATED:
                self._forget_session()
                self.detail = detail
                self._failures += 1
                self._retry_at = now_s + self._settings.retry_s
            case Event.MEASURED:
                pass

    # -- what it says ----------------------------------------------------------------------------

    def next_command(self, now_s: float) -> Command | None:
        """What to do now; None if nothing. It counts as begun."""
        if self._pending and now_s >= self._pending_until:
            self._pending = False
            self.detail = "the network has not confirmed it"
        if self._running is not None or now_s < self._retry_at:
            return None
        command = self._release_command() if self._releasing else self._wanted_command(now_s)
        if command is not None:
            self._running = command
            if command.action in (Action.REQUEST, Action.UPDATE):
                self.requests += 1
        return command

    def _release_command(self) -> Command | None:
        return Command(Action.RELEASE, None, self.session_id) if self.session_id else None

    def _wanted_command(self, now_s: float) -> Command | None:
        if self.wanted is None:
            return None
        for step in (Action.GROUP, Action.JOIN):
            if step not in self._prepared:
                return Command(step)
        if not self.session_id:
            return Command(Action.REQUEST, self.wanted)
        if self._is_due_for_change(now_s):
            return Command(Action.UPDATE, self.wanted, self.session_id)
        if self._settings.monitors and not self._monitored and not self._pending:
            return Command(Action.MONITOR, self.asked, self.session_id)
        if self._renew_at is not None and now_s >= self._renew_at:
            return Command(Action.RENEW, self.asked, self.session_id)
        return None

    def _is_due_for_change(self, now_s: float) -> bool:
        return (
            self._settings.mode is not Mode.STATIC
            and self._differs_since is not None
            and now_s - self._differs_since >= self._settings.dwell_s
        )

    def _is_other(self, new: Selection, old: Selection) -> bool:
        if new.qci != old.qci:
            return True
        if not new.chosen.is_gbr:
            return False
        before, now = old.requirement.bit_rate, new.requirement.bit_rate
        return abs(now - before) > self._settings.rate_change * max(before, 1.0)

    def _has_session(self, command: Command, session: Session, now_s: float) -> None:
        self.asked = command.selection
        self._degraded = False
        self._differs_since = None
        self._monitored = self._monitored and session.id == self.session_id
        self._same_session(session)
        self._pending = session.is_pending
        self._pending_until = now_s + self._settings.pending_s
        self._renew_at = now_s + self._settings.duration_s / 2
        if self.wanted is not None:
            self.want(self.wanted, now_s)

    def _same_session(self, session: Session) -> None:
        self.session_id = session.id
        if session.applied_qci is not None:
            self.applied_qci = session.applied_qci

    def _forget_session(self) -> None:
        self.session_id = ""
        self.asked = self.applied_qci = None
        self._monitored = self._pending = self._degraded = self.is_refused = False
        self._renew_at = self._differs_since = None
