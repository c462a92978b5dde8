"""The base of all cells: life, parameters, observers, children, performance.

A cell does one thing each time it is executed. What goes wrong in a hook, a provider, an observer or a child is
told and counted, and stays there: neither the caller nor another cell suffers from it. All methods may
be called from any thread.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol, runtime_checkable

from simple_ros.errors import ConfigError
from simple_ros.msg.wireless_ros_msgs import ChannelState, Constraint
from simple_ros_hub.breaker import CircuitBreaker
from simple_ros_hub.cells.meter import ResourceMeter
from simple_ros_hub.cells.numbers import CellNumbers

__all__ = ["Cell", "CellEvent", "CellObserver", "CellState"]

logger = logging.getLogger(__name__)

IDLE_S = 60.0


class CellState(Enum):
    """How a cell is."""

    INITIALIZED = "INITIALIZED"
    CONFIGURED = "CONFIGURED"
    ACTIVE = "ACTIVE"
    STOPPED = "STOPPED"
    ERROR = "ERROR"


class CellEvent(Enum):
    """What observers are told of."""

    START = "start"
    STOP = "stop"
    CONFIGURE = "configure"
    EXECUTED = "executed"
    ERROR = "error"


@runtime_checkable
class CellObserver(Protocol):
    """Who wants to know what happens to cells."""

    def on_cell_event(self, name: str, event: str, data: Mapping[str, Any]) -> None:
        """Something happened.

        Args:
            name: Of the cell.
            event: Value of a `CellEvent`.
            data: More of that.
        """


@dataclass(slots=True)
class _Bound:
    provider: Callable[[], Any]
    value: Any = None
    at_s: float | None = None
    is_failing: bool = False


class Cell:
    """Derive from it and override hooks: `_on_start`, `_on_stop`, `_on_configure`, `_execute` and more.

    Args:
        name: Of the cell.
        clock: Seconds that only go forward.

    Attributes:
        name: Of the cell.
        config: What it was configured with.
        constraint: The newest one it keeps to.
        channel: The newest state of its link.
        detail: Why it is in state ERROR, or what went wrong last.
    """

    def __init__(self, name: str, *, clock: Callable[[], float] = time.monotonic) -> None:
        self.name = name
        self.config: dict[str, Any] = {}
        self.constraint: Constraint | None = None
        self.channel: ChannelState | None = None
        self.detail = ""
        self.numbers = CellNumbers(clock())
        self._clock = clock
        self._state = CellState.INITIALIZED
        self._parameters: dict[str, Any] = {}
        self._bound: dict[str, _Bound] = {}
        self._observers: list[object] = []
        self._deaf: set[int] = set()
        self._children: dict[str, Cell] = {}
        self._breaker = CircuitBreaker(5, 0.5, 10.0)
        self._meter = ResourceMeter()
        self._lock = threading.RLock()
        self._warned_idle = False
        self.resources = self._meter.read(clock())

    # -- life ----------------------------------------------------------------------------------

    @property
    def state(self) -> CellState:
        """How it is."""
        return self._state

    @property
    def active(self) -> bool:
        """Whether it may be executed."""
        return self._state is CellState.ACTIVE

    def start(self) -> bool:
        """Start the children in order, then itself; nothing if it is active. Whether it is active now."""
        with self._lock:
            if self.active:
                return True
            for child in self._children.values():
                child.start()
            if not self._guarded("start", self._on_start):
                self._state = CellState.ERROR
                return False
            self._state, self.detail = CellState.ACTIVE, ""
            self.numbers.began(self._clock())
        logger.info("cell %s started", self.name)
        self.notify_observers(CellEvent.START, {})
        return True

    def stop(self) -> None:
        """Stop itself, then the children in reverse order; nothing if it is not active."""
        with self._lock:
            if self._state not in (CellState.ACTIVE, CellState.ERROR):
                return
            self._state = CellState.STOPPED
            self._guarded("stop", self._on_stop)
            for child in reversed(self._children.values()):
                child.stop()
        logger.info("cell %s stopped", self.name)
        self.notify_observers(CellEvent.STOP, {})

    def configure(self, config: Mapping[str, Any]) -> bool:
        """Take a configuration, if `_on_configure` accepts it; otherwise nothing changes.

        Returns:
            Whether it was taken.
        """
        with self._lock:
            before = self.config
            self.config = {**before, **config}
            if not self._guarded("configure", lambda: self._on_configure(dict(config))):
                self.config = before
                return False
            if self._state is CellState.INITIALIZED:
                self._state = CellState.CONFIGURED
        self.numbers.parameter_set(self._clock())
        self.notify_observers(CellEvent.CONFIGURE, {"config": dict(config)})
        return True

    def execute(self, *args: Any, **kwargs: Any) -> Any:
        """Do what the cell does, with fresh values of bound parameters.

        After several failures in a row it rests for a while, longer each time.

        Returns:
            What `_execute` returns; None if it failed, rests, or the cell is not active.
        """
        now_s = self._clock()
        if not self.active:
            self.numbers.skipped += 1
            logger.debug("cell %s is not active, execution skipped", self.name)
            return None
        if not self._breaker.allows(now_s):
            self.numbers.skipped += 1
            return None
        self._warned_idle = False
        self._collect()
        try:
            result = self._execute(*args, **kwargs)
        except Exception as error:
            self.numbers.executed(now_s, failed=True)
            self.detail = f"{type(error).__name__}: {error}"
            if self._breaker.failed(now_s, self.detail):
                logger.exception("cell %s failed again and again and rests", self.name)
            self.notify_observers(CellEvent.ERROR, {"error": self.detail})
            return None
        self.numbers.executed(now_s, failed=False)
        if self._breaker.succeeded():
            logger.info("cell %s works again", self.name)
        self.notify_observers(CellEvent.EXECUTED, {"success": True, "result": result})
        return result

    # -- parameters ----------------------------------------------------------------------------

    def set_parameter(self, key: str, value: Any) -> bool:
        """Set a parameter; a provider that was bound to it is unbound."""
        with self._lock:
            self._bound.pop(key, None)
            self._parameters[key] = value
        self.numbers.parameter_set(self._clock())
        return True

    def get_parameter(self, key: str, default: Any = None) -> Any:
        """Its value; of a bound one the last its provider gave, as also under ``<key>_value``."""
        with self._lock:
            bound = self._bound.get(key) or self._bound.get(key.removesuffix("_value"))
            if bound is not None:
                return default if bound.at_s is None else bound.value
            return self._parameters.get(key, default)

    def bind_parameter(self, key: str, provider: object) -> bool:
        """Have a provider asked for a parameter at each execution; whether it can be called."""
        if not callable(provider):
            logger.warning("cell %s: the provider of %s cannot be called", self.name, key)
            return False
        with self._lock:
            self._bound[key] = _Bound(provider)
        return True

    def unbind_parameter(self, key: str) -> bool:
        """Ask no more; the last value stays as its value. Whether it was bound."""
        with self._lock:
            bound = self._bound.pop(key, None)
            if bound is None:
                return False
            if bound.at_s is not None:
                self._parameters[key] = bound.value
        return True

    def bound_age_s(self, key: str) -> float | None:
        """Age of the last good value of a bound parameter; None if there is none."""
        bound = self._bound.get(key)
        return None if bound is None or bound.at_s is None else self._clock() - bound.at_s

    def _collect(self) -> None:
        with self._lock:
            asked = list(self._bound.items())
        for key, bound in asked:
            try:
                value = bound.provider()
            except Exception as error:
                if not bound.is_failing:
                    logger.warning(
                        "cell %s: parameter %s keeps its value: %s", self.name, key, error
                    )
                bound.is_failing = True
            else:
                with self._lock:
                    bound.value, bound.at_s, bound.is_failing = value, self._clock(), False
                self.numbers.parameter_set(self._clock())

    # -- observers and children ----------------------------------------------------------------

    def register_observer(self, observer: object) -> bool:
        """Tell an observer from now on (a `CellObserver`; others hear nothing); whether it is new."""
        with self._lock:
            if observer in self._observers:
                return False
            self._observers.append(observer)
        return True

    def unregister_observer(self, observer: object) -> bool:
        """Tell it no more; whether it was told."""
        with self._lock:
            if observer not in self._observers:
                return False
            self._observers.remove(observer)
        return True

    def notify_observers(self, event: CellEvent, data: Mapping[str, Any]) -> None:
        """Tell all observers; one that raises is logged once, and the others are told."""
        with self._lock:
            observers = list(self._observers)
        for observer in observers:
            if not isinstance(observer, CellObserver):
                continue
            try:
                observer.on_cell_event(self.name, event.value, data)
            except Exception:
                self.numbers.observer_errors += 1
                if id(observer) not in self._deaf:
                    self._deaf.add(id(observer))
                    logger.exception("cell %s: an observer raised", self.name)

    def add_child(self, child: Cell) -> None:
        """Contain another cell; it is started at once if this one is active.

        Raises:
            ConfigError: There is one of that name, or it contains this one.
        """
        if child is self or child.contains(self):
            raise ConfigError(f"cell {child.name!r} cannot be in {self.name!r}: it contains it")
        with self._lock:
            if child.name in self._children:
                raise ConfigError(f"cell {self.name!r} has a child {child.name!r} already")
            self._children[child.name] = child
            if self.active:
                child.start()

    def remove_child(self, name: str) -> Cell:
        """Contain it no more; it is stopped.

        Raises:
            LookupError: There is none of that name.
        """
        with self._lock:
            child = self._children.pop(name, None)
        if child is None:
            raise LookupError(f"cell {self.name!r} has no child {name!r}")
        child.stop()
        return child

    def contains(self, other: Cell) -> bool:
        """Whether another cell is in this one, at any depth."""
        return any(child is other or child.contains(other) for child in self.children)

    @property
    def children(self) -> tuple[Cell, ...]:
        """In the order of their start."""
        with self._lock:
            return tuple(self._children.values())

    # -- the link ------------------------------------------------------------------------------

    def apply_constraints(self, constraint: Constraint) -> bool:
        """Keep to a constraint from now on, with the children; whether `_on_constraint` took it."""
        self.constraint = constraint
        taken = self._guarded("constraint", lambda: self._on_constraint(constraint))
        return all([taken, *(child.apply_constraints(constraint) for child in self.children)])

    def on_channel_update(self, state: ChannelState) -> None:
        """The newest state of the link, for the children, too."""
        self.channel = state
        self._guarded("channel", lambda: self._on_channel(state))
        for child in self.children:
            child.on_channel_update(state)

    # -- how it does ---------------------------------------------------------------------------

    def monitor(self) -> None:
        """Measure CPU and memory, and warn once of a cell that has long been idle; every 5 s or so."""
        now_s = self._clock()
        self.resources = self._meter.read(now_s)
        self._update_performance_metrics()
        idle_s = self.numbers.idle_s(now_s)
        if self.active and idle_s > IDLE_S and not self._warned_idle:
            self._warned_idle = True
            logger.warning("cell %s has been idle for more than %g s", self.name, IDLE_S)
        for child in self.children:
            child.monitor()

    @property
    def performance_metrics(self) -> dict[str, float]:
        """Rates over the last seconds; execution_rate and parameter_update_rate in 1/s."""
        return self.numbers.metrics(self._clock())

    def get_status(self) -> dict[str, Any]:
        """Everything about it, for people and programs."""
        now_s = self._clock()
        return {
            "name": self.name,
            "state": self._state.value,
            "detail": self.detail,
            "executions": self.numbers.executions,
            "errors": self.numbers.errors,
            "skipped": self.numbers.skipped,
            "idle_s": self.numbers.idle_s(now_s),
            "cpu_percent": self.resources.cpu_percent,
            "memory_bytes": self.resources.memory_bytes,
            "constraint_type": self.constraint.constraint_type if self.constraint else "",
            **self.numbers.metrics(now_s),
            "children": [child.get_status() for child in self.children],
        }

    # -- hooks ---------------------------------------------------------------------------------

    def _on_start(self) -> None:
        """Called before it becomes active; what it raises keeps it from that."""

    def _on_stop(self) -> None:
        """Called once it is not active any more."""

    def _on_configure(self, config: dict[str, Any]) -> None:
        """Called with what is new, when ``self.config`` has it; what it raises refuses it."""

    def _execute(self, *args: Any, **kwargs: Any) -> Any:
        """What the cell does."""
        raise NotImplementedError(f"cell {self.name!r} does nothing: override _execute")

    def _on_constraint(self, constraint: Constraint) -> None:
        """Called with each new constraint."""

    def _on_channel(self, state: ChannelState) -> None:
        """Called with each new state of the link."""

    def _update_performance_metrics(self) -> None:
        """Called by `monitor`, for numbers of one's own."""

    def _guarded(self, what: str, hook: Callable[[], object]) -> bool:
        try:
            hook()
        except Exception as error:
            self.detail = f"{what}: {type(error).__name__}: {error}"
            self.numbers.hook_errors += 1
            logger.exception("cell %s: its %s hook raised", self.name, what)
            self.notify_observers(CellEvent.ERROR, {"error": self.detail})
            return False
        return True
