"""The base of all cells: F1 to F11."""

from __future__ import annotations

import logging
import mmap
import threading
from collections.abc import Mapping
from typing import Any

import pytest

from simple_ros.errors import ConfigError
from simple_ros.msg.wireless_ros_msgs import ChannelState, Constraint
from simple_ros_hub.cells import Cell, CellState
from simple_ros_hub.cells.messages import cell_status
from simple_ros_hub.cells.meter import ResourceMeter


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


class Adder(Cell):
    """Adds; fails when told to."""

    fails = False

    def _execute(self, *args: Any, **kwargs: Any) -> Any:
        if self.fails:
            raise ValueError("told to")
        return sum(args) + self.get_parameter("offset", 0)


class Listener:
    def __init__(self) -> None:
        self.heard: list[tuple[str, str, Mapping[str, Any]]] = []

    def on_cell_event(self, name: str, event: str, data: Mapping[str, Any]) -> None:
        self.heard.append((name, event, data))

    @property
    def events(self) -> list[str]:
        return [event for _, event, _ in self.heard]


def cell(name: str = "adder") -> tuple[Adder, Clock, Listener]:
    clock, listener = Clock(), Listener()
    made = Adder(name, clock=clock)
    made.register_observer(listener)
    return made, clock, listener


def test_life_and_all_five_events() -> None:
    adder, _, listener = cell()
    assert adder.state is CellState.INITIALIZED
    assert adder.execute(1) is None
    assert adder.configure({"a": 1})
    assert adder.state is CellState.CONFIGURED
    assert adder.start()
    assert adder.start()
    assert adder.execute(1, 2) == 3
    adder.fails = True
    assert adder.execute(1) is None
    adder.stop()
    adder.stop()
    assert adder.state is CellState.STOPPED
    assert listener.events == ["configure", "start", "executed", "error", "stop"]
    assert listener.heard[2] == ("adder", "executed", {"success": True, "result": 3})
    assert listener.heard[3][2] == {"error": "ValueError: told to"}
    assert adder.start()


def test_a_start_that_fails_leaves_it_in_error() -> None:
    class Broken(Adder):
        def _on_start(self) -> None:
            raise OSError("no camera")

    broken = Broken("broken")
    assert not broken.start()
    assert broken.state is CellState.ERROR
    assert broken.detail == "start: OSError: no camera"


def test_a_configuration_that_is_refused_changes_nothing() -> None:
    class Picky(Adder):
        def _on_configure(self, config: dict[str, Any]) -> None:
            if config.get("rate", 1) <= 0:
                raise ValueError("rate must be above 0")

    picky = Picky("picky")
    assert picky.configure({"rate": 5})
    assert not picky.configure({"rate": 0})
    assert picky.config == {"rate": 5}


def test_bound_parameters_are_asked_at_each_execution() -> None:
    adder, clock, _ = cell()
    values = iter([10, 20])
    assert adder.bind_parameter("offset", lambda: next(values))
    assert not adder.bind_parameter("other", 5)
    assert adder.get_parameter("offset", -1) == -1
    adder.start()
    assert adder.execute(1) == 11
    assert adder.get_parameter("offset_value") == 10
    assert adder.execute(1) == 21
    clock.now += 3
    # The provider has no more to give: the last good value stays, and is known to be old.
    assert adder.execute(1) == 21
    assert adder.bound_age_s("offset") == 3
    assert adder.numbers.errors == 0
    assert adder.unbind_parameter("offset")
    assert not adder.unbind_parameter("offset")
    assert adder.execute(1) == 21
    adder.set_parameter("offset", 0)
    assert adder.execute(1) == 1


def test_observers_are_isolated_from_each_other(caplog: pytest.LogCaptureFixture) -> None:
    class Bad:
        def on_cell_event(self, name: str, event: str, data: Mapping[str, Any]) -> None:
            raise RuntimeError("bad observer")

    adder, _, last = cell()
    adder.unregister_observer(last)
    assert adder.register_observer(Bad())
    assert adder.register_observer(object())
    assert adder.register_observer(last)
    assert not adder.register_observer(last)
    adder.start()
    with caplog.at_level(logging.ERROR):
        assert adder.execute(2) == 2
        assert adder.execute(3) == 3
    assert last.events == ["start", "executed", "executed"]
    assert adder.numbers.observer_errors == 3
    assert len(caplog.records) <= 1
    assert adder.unregister_observer(last)
    assert not adder.unregister_observer(last)


def test_children_start_in_order_and_stop_in_reverse() -> None:
    parent, _, listener = cell("parent")
    for name in ("one", "two"):
        child = Adder(name)
        child.register_observer(listener)
        parent.add_child(child)
    parent.start()
    parent.stop()
    starts = [name for name, event, _ in listener.heard if event == "start"]
    stops = [name for name, event, _ in listener.heard if event == "stop"]
    assert starts == ["one", "two", "parent"]
    assert stops == ["two", "one", "parent"]
    grandchild = Adder("three")
    parent.children[0].add_child(grandchild)
    assert parent.contains(grandchild)
    with pytest.raises(ConfigError):
        grandchild.add_child(parent)
    with pytest.raises(ConfigError):
        parent.add_child(Adder("one"))
    removed = parent.remove_child("one")
    assert removed.name == "one"
    with pytest.raises(LookupError):
        parent.remove_child("one")


def test_a_child_that_fails_keeps_the_parent_going() -> None:
    class Broken(Adder):
        def _on_start(self) -> None:
            raise OSError("broken")

    parent, _, _ = cell("parent")
    parent.add_child(Broken("child"))
    assert parent.start()
    assert [child.state for child in parent.children] == [CellState.ERROR]
    status = cell_status(parent.get_status())
    assert (status.state, status.children[0].state) == ("ACTIVE", "ERROR")


def test_repeated_failures_rest() -> None:
    adder, clock, listener = cell()
    adder.start()
    adder.fails = True
    for _ in range(20):
        adder.execute(1)
    assert adder.numbers.errors == 5
    assert adder.numbers.skipped == 15
    adder.fails = False
    clock.now += 0.6
    assert adder.execute(1) == 1
    assert adder.execute(1) == 1
    assert listener.events.count("error") == 5


def test_rates_over_a_window() -> None:
    adder, clock, _ = cell()
    adder.start()
    for number in range(100):
        clock.now += 0.1
        adder.fails = number % 10 == 0
        adder.execute(1)
    metrics = adder.performance_metrics
    assert metrics["execution_rate"] == pytest.approx(10, rel=0.02)
    assert metrics["error_rate"] == pytest.approx(0.1, abs=0.02)
    clock.now += 30
    assert adder.performance_metrics["execution_rate"] == 0


def test_long_idle_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    adder, clock, _ = cell()
    adder.start()
    clock.now += 61
    with caplog.at_level(logging.WARNING):
        adder.monitor()
        adder.monitor()
    assert [record.getMessage() for record in caplog.records] == [
        "cell adder has been idle for more than 60 s"
    ]


def test_cpu_and_memory_are_measured() -> None:
    meter = ResourceMeter()
    first = meter.read(0.0)
    # Fresh pages, whatever the process has left of earlier blocks.
    block = mmap.mmap(-1, 30_000_000)
    block.write(b"x" * len(block))
    total = sum(i * i for i in range(2_000_000))
    second = meter.read(1.0)
    assert total
    assert second.cpu_percent > 1
    assert second.memory_bytes - first.memory_bytes > 20_000_000
    assert second.threads >= 1
    block.close()


def test_constraints_and_channel_reach_children() -> None:
    class Minding(Adder):
        def _on_constraint(self, constraint: Constraint) -> None:
            if constraint.frame_rate < 0:
                raise ValueError("no such rate")

    parent, child = Minding("parent"), Minding("child")
    parent.add_child(child)
    assert parent.apply_constraints(Constraint(constraint_type="REDUCED"))
    assert child.constraint is not None
    assert child.get_status()["constraint_type"] == "REDUCED"
    assert not parent.apply_constraints(Constraint(frame_rate=-1))
    parent.on_channel_update(ChannelState(link_id="4601"))
    assert child.channel is not None


def test_a_cell_that_does_nothing_says_so() -> None:
    empty = Cell("empty")
    empty.start()
    assert empty.execute() is None
    assert "override _execute" in empty.detail


def test_threads_may_start_and_stop_it() -> None:
    adder, _, listener = cell()

    def work() -> None:
        for _ in range(50):
            adder.start()
            adder.execute(1)
            adder.stop()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert listener.events.count("start") == listener.events.count("stop")
    assert adder.numbers.errors == 0
