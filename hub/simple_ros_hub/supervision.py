"""Start, health and restarts of the components: a machine that is told what happens, and the time. Pure.

Three phases: in DISCOVERY the hub learns what is there already, in INITIALIZATION the components are started in
their order, in OPERATION they are kept alive. A phase that takes too long ends all the same, with the reason
noted: a robot with two engines is better than a robot that waits. What a component goes through::

    WAITING -> STARTING -> ACTIVE <-> DEGRADED
                  |           |
                  |          HUNG (silent; killed)
                  v           v
               RESTARTING <---+    -> STARTING, or GIVEN_UP when it crashes again and again
"""

from __future__ import annotations

from collections.abc import Sequence

from simple_ros.launch.restart import GiveUp, RestartHistory
from simple_ros_hub.components import Component
from simple_ros_hub.conditions import (
    Action,
    Do,
    Happening,
    Phase,
    State,
    SupervisionSettings,
    View,
)

__all__ = ["Supervision"]

_SUSPENDED_S = 1.0


class Supervision:
    """Decides.

    Args:
        components: What to look after, in the order of their start.
        settings: Settings.

    Attributes:
        phase: How far the start is.
        late: Why a phase ended without being complete.
    """

    def __init__(
        self, components: Sequence[Component], settings: SupervisionSettings | None = None
    ) -> None:
        self.settings = settings or SupervisionSettings()
        self.phase = Phase.DISCOVERY
        self.late: list[str] = []
        self._views: dict[str, View] = {}
        self._phase_begun_s = 0.0
        self._ticked_s: float | None = None
        self._is_discovered = False
        self._listens_s = self.settings.discovery_s
        self._actions: list[Action] = []
        self._happenings: list[Happening] = []
        for component in components:
            self.add(component)

    # -- what is asked -------------------------------------------------------------------------

    def add(self, component: Component) -> None:
        """Look after one more."""
        self._views[component.name] = View(component, history=RestartHistory(component.respawn))

    def view(self, name: str) -> View:
        """What is known of a component.

        Raises:
            LookupError: There is none of that name.
        """
        found = self._views.get(name)
        if found is None:
            known = ", ".join(self._views)
            raise LookupError(f"there is no component {name!r}, only {known}")
        return found

    def views(self) -> list[View]:
        """All of them."""
        return list(self._views.values())

    def reasons(self) -> list[str]:
        """Why the whole is degraded; nothing if it is not."""
        found = []
        for view in self._views.values():
            is_wanted = view.component.required and view.state is not State.STOPPED
            if is_wanted and view.state is not State.ACTIVE:
                detail = f": {view.message}" if view.message else ""
                found.append(f"{view.component.name} is {view.state.value}{detail}")
        return found

    def take_actions(self) -> list[Action]:
        """What to do, once."""
        actions, self._actions = self._actions, []
        return actions

    def take_happenings(self) -> list[Happening]:
        """What happened, once."""
        happenings, self._happenings = self._happenings, []
        return happenings

    # -- what is told --------------------------------------------------------------------------

    def begin(self, now_s: float) -> None:
        """The hub begins to look around."""
        self._phase_begun_s = now_s
        self._say("", "Discovery phase")

    def found(self, name: str, pid: int, now_s: float) -> None:
        """A process of an earlier hub still runs: it is taken over."""
        view = self.view(name)
        view.pid, view.begun_s = pid, now_s
        view.heard_s = None
        self._turn(view, State.STARTING, "taken over, no sign of life yet")
        view.due_s = now_s + self.settings.inactive_after_s
        self._say(name, f"Taken over: process {pid} runs on")

    def lost(self, name: str, pid: int) -> None:
        """A process of an earlier hub has ended while there was no hub; it is started in its turn."""
        view = self.view(name)
        view.restarts += 1
        self._say(
            name,
            f"{_title(view)} {name} failed: process {pid} ended while there was no hub",
            is_error=True,
        )

    def was_stopped(self, name: str) -> None:
        """Somebody had it stopped by hand, as an earlier hub knows: it stays so."""
        view = self.view(name)
        view.settled = True
        self._turn(view, State.STOPPED, "stopped by hand")

    def discovered(self, *, all_known: bool = False) -> None:
        """Configuration, Master and processes were looked through.

        Args:
            all_known: Whether each component is one of an earlier hub, so that there is nobody to listen for.
        """
        self._is_discovered = True
        self._listens_s = 0.0 if all_known else self.settings.discovery_s

    def heard(self, name: str, state: str, detail: str, now_s: float) -> None:
        """A sign of life came; of one that is not looked after: nothing.

        Args:
            name: Of the component.
            state: What it says of itself: starting, active, degraded.
            detail: More of that.
            now_s: When.
        """
        view = self._views.get(name)
        if view is None:
            return
        view.heard_s = now_s
        is_foreign = view.state in (State.WAITING, State.GIVEN_UP, State.STOPPED) and not view.pid
        is_ours = view.works or view.state is State.STARTING
        if not (is_foreign or is_ours) or state == "starting":
            return
        if is_foreign:
            self._say(name, f"{_title(view)} {name} runs already, not started by this hub")
        before = view.state
        view.settled, view.due_s = True, None
        if state == "degraded":
            self._turn(view, State.DEGRADED, detail)
            if before is not State.DEGRADED:
                self._say(name, f"{_title(view)} {name} is degraded: {detail}", is_error=True)
        else:
            self._turn(view, State.ACTIVE, "")
            if before is not State.ACTIVE:
                self._say(name, f"{_title(view)} {name} is active")

    def started(self, name: str, pid: int, now_s: float) -> None:
        """Its process runs."""
        view = self.view(name)
        view.pid, view.begun_s = pid, now_s
        if view.state is State.STARTING:
            view.due_s = now_s + view.component.start_timeout_s
        self._say(name, f"Started {view.component.kind.value} {name} (pid {pid})")

    def ended(self, name: str, how: str, now_s: float) -> None:
        """Its process has ended, or could not be started.

        Args:
            name: Of the component.
            how: In words.
            now_s: When.
        """
        view = self.view(name)
        ran_s = max(0.0, now_s - view.begun_s) if view.pid else 0.0
        view.pid, view.due_s, view.heard_s = 0, None, None
        if view.state is State.STOPPING:
            self._turn(view, State.STOPPED, "stopped by hand")
            self._say(name, f"Stopped {name}")
            if view.again:
                self._begin_start(view)
            return
        reason = f"{view.why}, {how}" if view.why else how
        view.why = ""
        if not self.settings.recovery_enabled:
            self._give_up(view, f"{reason}; recovery is disabled")
            return
        answer = view.history.failed(ran_s)
        if isinstance(answer, GiveUp):
            self._give_up(view, f"{reason}, {answer.reason}")
            return
        view.due_s = now_s + answer.delay_s
        self._turn(view, State.RESTARTING, reason)
        self._say(
            name,
            f"{_title(view)} {name} failed: {reason}; starting again in {answer.delay_s:g} s "
            f"({answer.number} of {answer.limit})",
            is_error=True,
        )

    def start(self, name: str) -> None:
        """Somebody wants it started; its restarts are counted anew."""
        view = self.view(name)
        view.history.forget()
        if view.state in (State.STOPPED, State.GIVEN_UP, State.WAITING, State.RESTARTING):
            self._begin_start(view)
        elif view.state is State.STOPPING:
            view.again = True

    def stop(self, name: str) -> None:
        """Somebody wants it stopped; it is not started again."""
        view = self.view(name)
        view.again = False
        if view.pid or view.state is State.STARTING:
            self._turn(view, State.STOPPING, "")
            self._actions.append(Action(Do.STOP, name))
        elif view.works:
            view.message = "not a process of this hub: stop it where it was started"
        else:
            self._turn(view, State.STOPPED, "stopped by hand")
        view.due_s = None

    def restart(self, name: str) -> None:
        """Stop and start."""
        view = self.view(name)
        if view.pid:
            self.stop(name)
            view.history.forget()
            view.again = True
        else:
            self.start(name)

    def tick(self, now_s: float) -> None:
        """Time has passed; call it several times a second."""
        before, self._ticked_s = self._ticked_s, now_s
        if before is not None and now_s - before > _SUSPENDED_S:
            # It was the hub that slept, not the others.
            self._forgive(now_s - before)
        if self.phase is Phase.DISCOVERY:
            self._discovery(now_s)
        for view in self._views.values():
            self._look(view, now_s)
        if self.phase is Phase.INITIALIZATION:
            self._initialization(now_s)

    # -- inside --------------------------------------------------------------------------------

    def _forgive(self, gap_s: float) -> None:
        for view in self._views.values():
            if view.heard_s is not None:
                view.heard_s += gap_s
            if view.due_s is not None:
                view.due_s += gap_s
        self._phase_begun_s += gap_s

    def _discovery(self, now_s: float) -> None:
        took_s = now_s - self._phase_begun_s
        is_late = took_s >= self.settings.discovery_timeout_s
        if not is_late and not (self._is_discovered and took_s >= self._listens_s):
            return
        if is_late and not self._is_discovered:
            self._note_late(
                f"discovery was not complete after {self.settings.discovery_timeout_s:g} s"
            )
        self.phase, self._phase_begun_s = Phase.INITIALIZATION, now_s
        self._say("", "Initialization phase")

    def _initialization(self, now_s: float) -> None:
        for view in self._views.values():
            if view.state is State.WAITING and self._may_start(view):
                self._begin_start(view)
        waiting = [view.component.name for view in self._views.values() if not view.settled]
        took_s = now_s - self._phase_begun_s
        if waiting and took_s < self.settings.initialization_timeout_s:
            return
        if waiting:
            limit_s = self.settings.initialization_timeout_s
            self._note_late(f"{', '.join(waiting)} not ready after {limit_s:g} s")
        self.phase = Phase.OPERATION
        for view in self._views.values():
            if view.state is State.WAITING:
                self._begin_start(view)
        why = f", degraded: {'; '.join(self.reasons())}" if self.reasons() else ""
        self._say("", f"Operation phase{why}", is_error=bool(why))

    def _may_start(self, view: View) -> bool:
        return all(self._views[name].settled for name in view.component.after)

    def _begin_start(self, view: View) -> None:
        view.again, view.why, view.due_s, view.heard_s = False, "", None, None
        self._turn(view, State.STARTING, "")
        self._actions.append(Action(Do.START, view.component.name))

    def _look(self, view: View, now_s: float) -> None:
        settings = self.settings
        if view.works:
            silent_s = now_s - (now_s if view.heard_s is None else view.heard_s)
            limit_s = settings.hung_after_s if view.pid else settings.inactive_after_s
            if silent_s >= limit_s:
                self._silent(view, silent_s)
        elif view.state is State.STARTING and view.due_s is not None and now_s >= view.due_s:
            view.settled = True
            self._hung(view, f"no sign of life {now_s - view.begun_s:.1f} s after its start")
        elif view.state is State.RESTARTING and view.due_s is not None and now_s >= view.due_s:
            view.restarts += 1
            self._begin_start(view)

    def _silent(self, view: View, silent_s: float) -> None:
        if view.pid:
            self._hung(view, f"silent for {silent_s:.1f} s")
            return
        name = view.component.name
        self._say(name, f"{_title(view)} {name} is inactive, not sending messages", is_error=True)
        if self.settings.recovery_enabled:
            view.restarts += 1
            self._begin_start(view)
        else:
            self._give_up(view, "inactive; recovery is disabled")

    def _hung(self, view: View, why: str) -> None:
        name = view.component.name
        view.why, view.due_s = f"hung ({why})", None
        self._turn(view, State.HUNG, why)
        self._say(name, f"{_title(view)} {name} hangs: {why}; killing it", is_error=True)
        self._actions.append(Action(Do.KILL, name))

    def _give_up(self, view: View, reason: str) -> None:
        view.settled = True
        self._turn(view, State.GIVEN_UP, reason)
        self._say(
            view.component.name,
            f"{_title(view)} {view.component.name} is given up: {reason}",
            is_error=True,
        )

    def _turn(self, view: View, state: State, message: str) -> None:
        view.state, view.message = state, message

    def _note_late(self, reason: str) -> None:
        self.late.append(reason)
        self._say("", f"Degraded start: {reason}", is_error=True)

    def _say(self, component: str, text: str, *, is_error: bool = False) -> None:
        self._happenings.append(Happening(component, text, is_error))


def _title(view: View) -> str:
    need = "Required" if view.component.required else "Optional"
    return f"{need} {view.component.kind.value}"
