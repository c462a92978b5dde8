"""Simulated hours of faults: supervision, journal, memory and degradation, with hubs that die, too. No clock, no process."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable

import pytest

from simple_ros_hub.components import Component, Kind
from simple_ros_hub.conditions import Action, Do, Phase, State, SupervisionSettings
from simple_ros_hub.journal import Entry, Journal
from simple_ros_hub.memory import Memory
from simple_ros_hub.supervision import Supervision

ENGINES = ("radio", "cross", "physical")
CELLS = ("camera", "lidar", "command")
COMPONENTS = tuple(
    Component(name, Kind.ENGINE, (name,), after=ENGINES[:index])
    for index, name in enumerate(ENGINES)
) + tuple(Component(name, Kind.CELL, (name,), after=ENGINES) for name in CELLS)
TICK_S = 0.1
START_S = 1.0
BAR_S = 5.0
HUB_AWAY_S = 1.0
EVERY_S = 30.0
"""A fault; so a component fails seldom enough for the delay to stay at its first step or two."""


class System:
    """Processes as the kernel would have them, and one hub after the other."""

    def __init__(self, seed: int) -> None:
        self.ticks = 0
        self.rng = random.Random(seed)
        self.pids: dict[str, int] = {}
        self.begun: dict[str, float] = {}
        self.hanging: set[str] = set()
        self.next_pid = 100
        self.kept: list[Entry] = []
        self.memory = Memory()
        self.hub_pid = 0
        self.silent = False
        self.start_hub()

    @property
    def now_s(self) -> float:
        return self.ticks * TICK_S

    # -- hubs ----------------------------------------------------------------------------------

    def start_hub(self) -> None:
        self.next_pid += 1
        self.hub_pid = self.next_pid
        self.journal = Journal(1000, self.kept)
        self.journal.go_on(self.memory.present)
        self.hub = Supervision(COMPONENTS, SupervisionSettings(discovery_s=0.5))
        self.hub.begin(self.now_s)
        if self.memory.hub:
            self.log("The hub before this one died", is_error=True)
        for name, pid in self.pids.items():
            self.hub.found(name, pid, self.now_s)
        for name, pid in self.memory.pids.items():
            if name not in self.pids:
                self.hub.lost(name, pid)
        self.hub.discovered(all_known=bool(self.memory.pids))
        self.settle()

    def kill_hub(self) -> None:
        self.hub_pid = 0

    def log(self, text: str, *, is_error: bool) -> None:
        log = self.journal.log_error if is_error else self.journal.log_system_event
        self.kept.append(log(text, round(self.now_s * 1e9)))

    def settle(self) -> None:
        while actions := self.hub.take_actions():
            for action in actions:
                self.carry_out(action)
        for happening in self.hub.take_happenings():
            self.log(happening.text, is_error=happening.is_error)
        pids = {view.component.name: view.pid for view in self.hub.views() if view.pid}
        self.memory = Memory(self.hub_pid, pids, present=self.journal.present)

    def carry_out(self, action: Action) -> None:
        if action.do is Do.START:
            assert action.name not in self.pids, "started twice"
            self.next_pid += 1
            self.pids[action.name], self.begun[action.name] = self.next_pid, self.now_s
            self.hub.started(action.name, self.next_pid, self.now_s)
        else:
            self.end(action.name)

    # -- processes -----------------------------------------------------------------------------

    def end(self, name: str) -> None:
        self.pids.pop(name, None)
        self.hanging.discard(name)
        if self.hub_pid:
            self.hub.ended(name, "killed by SIGKILL", self.now_s)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.ticks += 1
            if self.hub_pid:
                self.tick()

    def tick(self) -> None:
        for name in self.pids:
            is_up = self.now_s - self.begun[name] >= START_S and name not in self.hanging
            if is_up and self.ticks % 5 == 0:
                state = "degraded" if self.silent and name == "radio" else "active"
                self.hub.heard(name, state, "nothing came" if state != "active" else "", self.now_s)
        self.hub.tick(self.now_s)
        self.settle()

    @property
    def operates(self) -> bool:
        works = all(view.state is State.ACTIVE for view in self.hub.views())
        return bool(self.hub_pid) and self.hub.phase is Phase.OPERATION and works

    def until_it_operates(self) -> float:
        begun_s = self.now_s
        while not self.operates:
            self.run(TICK_S)
            assert self.now_s - begun_s < 60, [str(view.state) for view in self.hub.views()]
        return self.now_s - begun_s


def kill(system: System, victim: str) -> Counter[str]:
    system.end(victim)
    system.settle()
    return Counter({f"{victim} failed": 1})


def stop(system: System, victim: str) -> Counter[str]:
    system.hanging.add(victim)
    system.run(1.0)
    return Counter({f"{victim} hangs": 1, f"{victim} failed": 1})


def hub(system: System, _: str) -> Counter[str]:
    system.kill_hub()
    system.run(HUB_AWAY_S)
    system.start_hub()
    return Counter({"The hub before": 1})


def hub_and_one_more(system: System, victim: str) -> Counter[str]:
    system.kill_hub()
    system.end(victim)
    system.run(HUB_AWAY_S)
    system.start_hub()
    return Counter({"The hub before": 1, f"{victim} failed": 1})


def silent_source(system: System, _: str) -> Counter[str]:
    system.silent = True
    system.run(6)
    system.silent = False
    return Counter({"radio is degraded": 1})


FAULTS: tuple[Callable[[System, str], Counter[str]], ...] = (
    kill,
    stop,
    hub,
    hub_and_one_more,
    silent_source,
)


@pytest.mark.parametrize(("seed", "hours"), [(1, 1), (2, 1), (3, 6)])
def test_no_process_is_lost_and_each_fault_is_logged_once(seed: int, hours: float) -> None:
    system = System(seed)
    system.until_it_operates()
    begun_s = system.now_s
    while system.now_s - begun_s < hours * 3600:
        fault, victim = system.rng.choice(FAULTS), system.rng.choice(ENGINES + CELLS)
        before, logged = dict(system.pids), len(system.kept)
        told = fault(system, victim)
        took_s = system.until_it_operates()
        assert took_s <= BAR_S, (fault.__name__, victim)
        system.run(EVERY_S)
        assert system.operates
        changed = {name for name, pid in system.pids.items() if before[name] != pid}
        assert changed == ({victim} if fault in (kill, stop, hub_and_one_more) else set())
        assert system.pids.keys() == before.keys()
        errors = [item.text for item in system.kept[logged:] if item.is_error]
        for words, times in told.items():
            assert sum(words in text for text in errors) == times, (fault.__name__, victim, errors)
        assert len(errors) == told.total(), errors
    assert [item.number for item in system.kept] == list(range(1, len(system.kept) + 1))
    # What a hub keeps does not grow with time.
    assert len(system.journal.system_events) <= 1000
    assert len(system.journal.error_logs) <= 1000
