"""Start, health and restarts as a machine: no process, no clock."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from simple_ros.launch import Respawn
from simple_ros_hub.components import Component, Kind
from simple_ros_hub.conditions import Action, Do, Phase, State, SupervisionSettings
from simple_ros_hub.supervision import Supervision

RADIO = Component("radio", Kind.ENGINE, ("radio",), start_timeout_s=10)
CROSS = Component("cross", Kind.ENGINE, ("cross",), after=("radio",))
EYE = Component("eye", Kind.CELL, ("eye",), required=False, after=("radio", "cross"))
SETTINGS = SupervisionSettings(discovery_s=1.0)


class World:
    """Processes that behave, until they are told not to."""

    def __init__(self, *components: Component, settings: SupervisionSettings = SETTINGS) -> None:
        self.machine = Supervision(components, settings)
        self.now = 100.0
        self.pids: dict[str, int] = {}
        self.next_pid = 1
        self.hanging: set[str] = set()
        self.crashing: set[str] = set()
        self.reports: dict[str, tuple[str, str]] = {}
        self.starts: list[str] = []
        self.texts: list[str] = []
        self.errors: list[str] = []
        self.machine.begin(self.now)

    def discovered(self) -> None:
        self.machine.discovered()

    def settle(self) -> None:
        while actions := self.machine.take_actions():
            for action in actions:
                self.carry_out(action)
        for happening in self.machine.take_happenings():
            self.texts.append(happening.text)
            if happening.is_error:
                self.errors.append(happening.text)

    def carry_out(self, action: Action) -> None:
        name = action.name
        if action.do is Do.START:
            assert name not in self.pids, "started twice"
            self.starts.append(name)
            self.pids[name] = self.next_pid
            self.next_pid += 1
            self.machine.started(name, self.pids[name], self.now)
            if name in self.crashing:
                self.die(name, "ended with code 1 (no camera)")
        elif name in self.pids:
            self.hanging.discard(name)
            how = "killed by SIGKILL" if action.do is Do.KILL else "killed by SIGINT"
            self.die(name, how)

    def die(self, name: str, how: str = "killed by SIGKILL") -> None:
        del self.pids[name]
        self.machine.ended(name, how, self.now)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.now += 0.1
            for name in self.pids:
                if name not in self.hanging and round(self.now * 10) % 5 == 0:
                    self.machine.heard(name, *self.reports.get(name, ("active", "")), self.now)
            self.machine.tick(self.now)
            self.settle()

    def state(self, name: str) -> State:
        return self.machine.view(name).state


def operating(*components: Component, settings: SupervisionSettings = SETTINGS) -> World:
    world = World(*components, settings=settings)
    world.discovered()
    world.run(6)
    assert world.machine.phase is Phase.OPERATION
    world.errors.clear()
    world.texts.clear()
    return world


def test_three_phases_in_order() -> None:
    world = World(EYE, RADIO, CROSS)
    world.discovered()
    world.run(0.9)
    assert (world.machine.phase, world.starts) == (Phase.DISCOVERY, [])
    world.run(0.2)
    assert world.machine.phase is Phase.INITIALIZATION
    assert world.starts == ["radio"]
    world.run(5)
    assert world.starts == ["radio", "cross", "eye"]
    assert world.machine.phase is Phase.OPERATION
    assert not world.machine.reasons()
    assert not world.errors


def test_a_discovery_that_takes_too_long_ends() -> None:
    world = World(RADIO)
    world.run(6)
    assert world.machine.phase is not Phase.DISCOVERY
    assert world.machine.late == ["discovery was not complete after 5 s"]


def test_one_that_is_never_ready_holds_the_others_up_for_its_time_only() -> None:
    world = World(RADIO, CROSS)
    world.hanging.add("radio")
    world.discovered()
    world.run(10)
    assert world.starts == ["radio"]
    world.run(2)
    # It was killed, and starts again; who comes after it does not wait any more.
    assert world.starts.count("cross") == 1
    assert "no sign of life 10" in world.errors[0]


def test_a_component_that_crashes_at_once_is_given_up_and_the_start_goes_on() -> None:
    world = World(replace(RADIO, respawn=Respawn(limit=2, delay_s=0.1)), CROSS)
    world.crashing.add("radio")
    world.discovered()
    world.run(4)
    assert world.state("radio") is State.GIVEN_UP
    assert "no camera" in world.machine.view("radio").message
    assert world.machine.phase is Phase.OPERATION
    assert world.state("cross") is State.ACTIVE
    assert world.machine.reasons() == [
        "radio is given up: ended with code 1 (no camera), restarted 2 times within 60 s of running"
    ]


def test_initialization_ends_by_its_own_time() -> None:
    slow = replace(RADIO, start_timeout_s=1000)
    world = World(slow, CROSS, settings=replace(SETTINGS, initialization_timeout_s=5))
    world.hanging.add("radio")
    world.discovered()
    world.run(8)
    assert world.machine.phase is Phase.OPERATION
    assert world.machine.late == ["radio, cross not ready after 5 s"]
    assert world.state("cross") is State.ACTIVE


def test_a_killed_one_is_started_again_others_are_not_touched() -> None:
    world = operating(RADIO, CROSS)
    before = dict(world.pids)
    world.die("cross")
    world.run(3)
    assert world.state("cross") is State.ACTIVE
    assert world.pids["radio"] == before["radio"]
    assert world.machine.view("cross").restarts == 1
    assert len(world.errors) == 1


def test_a_hung_one_is_killed_after_two_seconds() -> None:
    world = operating(RADIO)
    world.hanging.add("radio")
    world.run(1.4)
    assert world.state("radio") is State.ACTIVE
    world.run(1.2)
    assert "hangs: silent for 2" in world.errors[0]
    assert "hung (silent for" in world.errors[1]
    world.run(2)
    assert world.state("radio") is State.ACTIVE


def test_a_hub_that_was_suspended_blames_nobody() -> None:
    world = operating(RADIO)
    world.now += 60
    world.run(3)
    assert not world.errors
    assert world.starts == ["radio"]


def test_delays_double_and_a_crash_loop_ends() -> None:
    world = operating(replace(RADIO, respawn=Respawn(limit=4, delay_s=0.2, max_delay_s=10)))
    world.crashing.add("radio")
    world.die("radio")
    world.run(10)
    delays = [text.rpartition("again in ")[2].split()[0] for text in world.errors[:-1]]
    assert delays == ["0.2", "0.4", "0.8", "1.6"]
    assert world.state("radio") is State.GIVEN_UP
    count = len(world.starts)
    world.run(100)
    assert len(world.starts) == count
    world.crashing.clear()
    world.machine.start("radio")
    world.settle()
    world.run(1)
    assert world.state("radio") is State.ACTIVE


def test_recovery_can_be_switched_off() -> None:
    world = operating(RADIO, settings=replace(SETTINGS, recovery_enabled=False))
    world.die("radio")
    world.run(5)
    assert world.starts == ["radio"]
    assert "recovery is disabled" in world.machine.view("radio").message


def test_degraded_is_told_when_it_begins_and_ends() -> None:
    world = operating(RADIO)
    world.reports["radio"] = ("degraded", "no metrics")
    world.run(3)
    assert world.errors == ["Required engine radio is degraded: no metrics"]
    assert world.machine.reasons() == ["radio is degraded: no metrics"]
    world.reports.clear()
    world.run(3)
    assert world.texts[-1] == "Required engine radio is active"
    assert not world.machine.reasons()


def test_stop_start_and_restart_by_hand() -> None:
    world = operating(RADIO)
    world.machine.stop("radio")
    world.settle()
    world.run(3)
    assert (world.state("radio"), world.pids) == (State.STOPPED, {})
    assert not world.machine.reasons()
    assert not world.errors
    world.machine.start("radio")
    world.settle()
    world.run(1)
    first = world.pids["radio"]
    world.machine.restart("radio")
    world.settle()
    world.run(1)
    assert world.state("radio") is State.ACTIVE
    assert world.pids["radio"] != first
    assert not world.errors
    with pytest.raises(LookupError, match="only radio"):
        world.machine.stop("eye")


def test_processes_of_an_earlier_hub_are_taken_over() -> None:
    world = World(RADIO, CROSS)
    world.pids["radio"] = 77
    world.machine.found("radio", 77, world.now)
    world.discovered()
    world.run(4)
    assert world.starts == ["cross"]
    assert world.state("radio") is State.ACTIVE
    assert world.machine.view("radio").restarts == 0


def test_what_ended_while_there_was_no_hub_is_told_and_started_at_once() -> None:
    world = World(RADIO, CROSS, EYE)
    world.pids["cross"] = 78
    world.machine.found("cross", 78, world.now)
    world.machine.lost("radio", 77)
    world.machine.was_stopped("eye")
    world.machine.discovered(all_known=True)
    world.run(0.2)
    # There is nobody to listen for: each is known from before.
    assert world.starts == ["radio"]
    world.run(4)
    assert world.errors == ["Required engine radio failed: process 77 ended while there was no hub"]
    assert world.machine.view("radio").restarts == 1
    assert world.state("eye") is State.STOPPED
    assert (world.machine.phase, world.machine.reasons()) == (Phase.OPERATION, [])
    world.machine.start("eye")
    world.settle()
    world.run(1)
    assert world.state("eye") is State.ACTIVE


def test_one_that_was_taken_over_and_hangs_is_killed() -> None:
    world = World(RADIO)
    world.pids["radio"] = 77
    world.hanging.add("radio")
    world.machine.found("radio", 77, world.now)
    world.discovered()
    world.run(8)
    assert world.starts == ["radio"]
    assert "no sign of life" in world.errors[0]


def test_one_that_somebody_else_runs_is_left_alone_until_it_is_silent() -> None:
    world = World(RADIO)
    world.discovered()
    for _ in range(30):
        world.machine.heard("radio", "active", "", world.now)
        world.run(0.1)
    assert world.starts == []
    assert world.state("radio") is State.ACTIVE
    assert "not started by this hub" in world.texts[1]
    world.run(4.5)
    assert world.starts == []
    world.run(1)
    assert world.starts == ["radio"]
    assert "is inactive, not sending messages" in world.errors[0]


def test_strangers_are_not_looked_after() -> None:
    world = operating(RADIO)
    world.machine.heard("stranger", "active", "", world.now)
    assert [view.component.name for view in world.machine.views()] == ["radio"]


@pytest.mark.parametrize("seed", range(5))
def test_a_simulated_hour_of_faults_loses_no_process(seed: int) -> None:
    rng = random.Random(seed)
    names = ("radio", "cross", "eye")
    world = operating(RADIO, CROSS, EYE)
    faults = 0
    for _ in range(120):
        victim = rng.choice(names)
        if victim in world.pids and world.state(victim) is State.ACTIVE:
            faults += 1
            if rng.random() < 0.5:
                world.die(victim)
            else:
                world.hanging.add(victim)
        world.run(30)
    world.run(30)
    assert all(world.state(name) is State.ACTIVE for name in names)
    assert set(world.pids) == set(names)
    assert sum(world.machine.view(name).restarts for name in names) == faults
    # A kill is one error, a hang two, and each is told once.
    failures = [text for text in world.errors if "failed" in text]
    hangs = [text for text in world.errors if "hangs" in text]
    assert len(failures) == faults
    assert len(world.errors) == len(failures) + len(hangs)
