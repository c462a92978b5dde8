"""Two turtles and their network, simulated as fast as the processor can: where policies are trained. Pure.

The turtles, their controllers, the throttle and the scores are those of the live system; simulated is the network: each
message takes a random time (never overtaking another) or is lost.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, runtime_checkable

import numpy as np

from simple_ros_engines.network_exposure.maximizer.knobs import START, Setting
from simple_ros_engines.network_exposure.maximizer.resource import TopicTraffic
from simple_ros_engines.network_exposure.mos.estimator import Estimator
from simple_ros_engines.network_exposure.throttle import Throttle, ThrottleSettings
from simple_ros_engines.network_exposure.turtlesim.circle import Circle, CircleController
from simple_ros_engines.network_exposure.turtlesim.world import Pen, Slip, World

__all__ = ["LoopSetup", "Plant", "Repeatable", "Seen", "SimulatedTurtles"]

TICK_S = 0.016
SLIP_TAU_S = 0.3
_POSE_BYTES, _COMMAND_BYTES = 33.0, 40.0
_COLUMN = 4096
_CENTRE_M = 5.544


@dataclass(frozen=True, slots=True)
class Seen:
    """What is known of a topic after a decision period.

    Attributes:
        rate_hz: Messages a second that went out.
        bytes_per_s: The same in bytes.
        jitter_s: Standard deviation of the times between them.
        mos: Score of its process, 1 to 5.
        setting: Of the knobs.
        progress_mps: Of its process.
        is_downgraded: Whether the network gives less than was asked for.
    """

    rate_hz: float
    bytes_per_s: float
    jitter_s: float
    mos: float
    setting: Setting
    progress_mps: float = 0.0
    is_downgraded: bool = False


class Plant(Protocol):
    """What agents act on: simulated turtles, or live topics."""

    @property
    def groups(self) -> Mapping[str, tuple[str, ...]]:
        """Topics by process."""

    def traffic(self, topic: str) -> TopicTraffic:
        """What a topic sends when nothing is left out."""

    def advance(self, settings: Mapping[str, Setting]) -> dict[str, Seen]:
        """Set the knobs, let a decision period pass, and look."""


@runtime_checkable
class Repeatable(Protocol):
    """A plant that can be begun anew, and does the same then."""

    def restart(self, seed: int) -> None:
        """Begin anew with the chance of this seed."""


@dataclass(frozen=True, slots=True)
class LoopSetup:
    """One turtle, and the network it is driven over.

    Attributes:
        radius_m: Of its circle.
        speed_mps: Along it.
        control_hz: Commands a second.
        delay_ms: Mean time a message takes.
        loss: Share of messages the network loses.
        slip: Of the turtle, rad/s.
    """

    radius_m: float = 2.0
    speed_mps: float = 1.0
    control_hz: float = 20.0
    delay_ms: float = 8.0
    loss: float = 0.002
    slip: float = 0.2

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> LoopSetup:
        """A random one."""
        return cls(
            float(draw.uniform(1.2, 2.4)),
            float(draw.uniform(0.6, 1.2)),
            float(draw.choice([10.0, 20.0, 31.25])),
            float(draw.uniform(3, 15)),
            float(draw.uniform(0, 0.01)),
            float(draw.uniform(0.1, 0.25)),
        )


class _Way:
    """A topic from its publisher to its subscriber: throttle, then network."""

    def __init__(self, draw: np.random.Generator, setup: LoopSetup) -> None:
        self.throttle: Throttle[tuple[float, ...]] = Throttle()
        self.sent: list[float] = []
        self._draw = draw
        self._loss = setup.loss
        self._mean_s = setup.delay_ms / 1000
        self._underway: deque[tuple[float, tuple[float, ...]]] = deque()
        self._numbers: list[tuple[float, float]] = []

    def put(self, message: tuple[float, ...], now_s: float) -> None:
        self._send(self.throttle.put(message, now_s), now_s)

    def arrived(self, now_s: float) -> tuple[float, ...] | None:
        """The newest message that has come by now, if any has."""
        if self.throttle.held:
            self._send(self.throttle.due(now_s), now_s)
        newest = None
        while self._underway and self._underway[0][0] <= now_s:
            newest = self._underway.popleft()[1]
        return newest

    def _send(self, messages: list[tuple[float, ...]], now_s: float) -> None:
        for message in messages:
            self.sent.append(now_s)
            if not self._numbers:
                self._draw_numbers()
            luck, due = self._numbers.pop()
            if luck < self._loss:
                continue
            due += now_s
            if self._underway and due < self._underway[-1][0]:
                due = self._underway[-1][0]
            self._underway.append((due, message))

    def _draw_numbers(self) -> None:
        """Whether messages are lost and how long they take, many at once since that is much faster."""
        luck, late = self._draw.random(_COLUMN), self._draw.exponential(self._mean_s, _COLUMN)
        self._numbers = list(zip(luck.tolist(), late.tolist(), strict=True))


class _Loop:
    """One turtle and its controller."""

    def __init__(
        self, name: str, setup: LoopSetup, draw: np.random.Generator, period_s: float
    ) -> None:
        self.name, self.setup = name, setup
        self.pose, self.command = f"{name}/pose", f"{name}/cmd_vel"
        self.ways = {topic: _Way(draw, setup) for topic in (self.pose, self.command)}
        self._world = World(Slip(setup.slip, SLIP_TAU_S, draw.standard_normal))
        self._turtle = self._world.spawn(_CENTRE_M + setup.radius_m, _CENTRE_M, math.pi / 2, name)
        self._world.set_pen(name, Pen(is_off=True))
        self._controller = CircleController(
            Circle(_CENTRE_M, _CENTRE_M, setup.radius_m), setup.speed_mps, window_s=period_s
        )
        self._next_s = 0.0
        self._angle = 0.0
        self._turned = 0.0

    @property
    def travelled_m(self) -> float:
        """Way along the circle that it has really come, whatever its controller knows of it."""
        return self._turned * self.setup.radius_m

    def set(self, settings: Mapping[str, Setting]) -> None:
        for topic, way in self.ways.items():
            setting = settings[topic]
            way.throttle.settings = ThrottleSettings(
                setting.drop_every_nth, delay_ms=setting.delay_ms(self.traffic(topic).rate_hz)
            )
            way.sent.clear()
        self._controller.factor = settings[self.command].speed_factor

    def tick(self, now_s: float) -> None:
        turtle, controller = self._turtle, self._controller
        poses, commands = self.ways[self.pose], self.ways[self.command]
        poses.put((turtle.x, turtle.y, turtle.theta), now_s)
        pose = poses.arrived(now_s)
        if pose is not None:
            controller.pose_came(pose[0], pose[1], pose[2], now_s)
        if now_s >= self._next_s:
            self._next_s += 1 / self.setup.control_hz
            wanted = controller.command(now_s)
            commands.put((wanted.linear, wanted.angular), now_s)
        command = commands.arrived(now_s)
        if command is not None:
            self._world.command(self.name, command[0], 0.0, command[1], now_s)
        self._world.step(TICK_S, now_s + TICK_S)
        angle = math.atan2(turtle.y - _CENTRE_M, turtle.x - _CENTRE_M)
        self._turned += math.remainder(angle - self._angle, math.tau)
        self._angle = angle

    def seen(
        self, now_s: float, settings: Mapping[str, Setting], judge: Estimator
    ) -> dict[str, Seen]:
        tracking = self._controller.tracking(now_s)
        mos = judge.score(
            tracking.error_m, tracking.progress_mps, self.setup.speed_mps, tracking.pose_age_s
        )
        return {
            topic: _seen(way.sent, self._bytes(topic), mos, settings[topic], tracking.progress_mps)
            for topic, way in self.ways.items()
        }

    def traffic(self, topic: str) -> TopicTraffic:
        if topic == self.pose:
            return TopicTraffic(1 / TICK_S, _POSE_BYTES, 1e-2)
        return TopicTraffic(self.setup.control_hz, _COMMAND_BYTES, 1e-5)

    def _bytes(self, topic: str) -> float:
        return _POSE_BYTES if topic == self.pose else _COMMAND_BYTES


class SimulatedTurtles:
    """Turtles that drive in simulated time; implements `Plant` and `Repeatable`.

    What a controller knows of its progress ends with the last pose that came, so it is a little less when poses are left
    out; `speeds_mps` is what an onlooker would measure.

    Args:
        setups: One for each turtle.
        seed: Of the network's chance.
        period_s: A decision stands so long.
        estimator: Gives the scores.
    """

    def __init__(
        self,
        setups: tuple[LoopSetup, ...] = (LoopSetup(), LoopSetup(radius_m=1.5)),
        seed: int = 0,
        period_s: float = 4.0,
        estimator: Estimator | None = None,
    ) -> None:
        self._setups = setups
        self._period_s = period_s
        self._ticks = max(1, round(period_s / TICK_S))
        self._judge = estimator or Estimator()
        self.restart(seed)

    @classmethod
    def drawn(cls, seed: int, turtles: int = 2) -> SimulatedTurtles:
        """Turtles with radius, speed, rate, network and slip of their own, drawn by a seed."""
        draw = np.random.default_rng(seed)
        return cls(tuple(LoopSetup.drawn(draw) for _ in range(turtles)), seed)

    def restart(self, seed: int) -> None:
        """The same turtles from the beginning, with other chance."""
        draw = np.random.default_rng(seed)
        self._loops = [
            _Loop(f"turtle{number}", setup, draw, self._period_s)
            for number, setup in enumerate(self._setups, 1)
        ]
        self._now = 0
        self.advance({topic: START for loop in self._loops for topic in loop.ways})

    @property
    def speeds_mps(self) -> dict[str, float]:
        """Real mean speed of each turtle along its circle since the beginning."""
        span_s = self._now * TICK_S
        return {loop.name: loop.travelled_m / span_s for loop in self._loops}

    @property
    def groups(self) -> Mapping[str, tuple[str, ...]]:
        """Topics by turtle."""
        return {loop.name: tuple(loop.ways) for loop in self._loops}

    def traffic(self, topic: str) -> TopicTraffic:
        """What a topic sends when nothing is left out."""
        return self._loop(topic).traffic(topic)

    def wanted_mps(self, topic: str) -> float:
        """Speed that the topic's process was made for."""
        return self._loop(topic).setup.speed_mps

    def advance(self, settings: Mapping[str, Setting]) -> dict[str, Seen]:
        """Drive on with these settings, for a decision period."""
        seen: dict[str, Seen] = {}
        for loop in self._loops:
            loop.set(settings)
            for tick in range(self._now, self._now + self._ticks):
                loop.tick(tick * TICK_S)
        self._now += self._ticks
        for loop in self._loops:
            seen.update(loop.seen(self._now * TICK_S, settings, self._judge))
        return seen

    def _loop(self, topic: str) -> _Loop:
        return next(loop for loop in self._loops if topic in loop.ways)


def _seen(
    sent: list[float], size_bytes: float, mos: float, setting: Setting, progress: float
) -> Seen:
    if len(sent) < 2:
        return Seen(0.0, 0.0, 0.0, mos, setting, progress)
    gaps = [later - earlier for earlier, later in pairwise(sent)]
    mean = sum(gaps) / len(gaps)
    jitter = (sum((gap - mean) ** 2 for gap in gaps) / len(gaps)) ** 0.5
    rate = 1 / mean if mean > 0 else 0.0
    return Seen(rate, rate * size_bytes, jitter, mos, setting, progress)
