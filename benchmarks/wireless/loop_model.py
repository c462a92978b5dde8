"""A robot on a radio link that becomes narrow, in simulated time: sensors up, commands round, engines or none.

The link is the shaper's machine (`simulator.shaper`), the engines are their pure cores, the bridge's rules are put
together here from its parts as `cross_domain.bridge_node` does. Pictures are compressed for real, to know their size.
"""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from itertools import count
from typing import Any

import numpy as np

from simple_ros.msg.sensor_msgs import Image
from simple_ros_engines.cross_domain.adaptation import RateGate
from simple_ros_engines.cross_domain.core import CrossDomain, LinkMetrics
from simple_ros_engines.cross_domain.flow_rules import FlowRules
from simple_ros_engines.cross_domain.jpeg import to_jpeg
from simple_ros_engines.cross_domain.treatment import TreatmentJudge, fair_rates
from simple_ros_engines.physical_adaptive.core import (
    Demand,
    LinkView,
    PhysicalAdaptive,
    PhysicalSettings,
)
from simple_ros_engines.physical_adaptive.strategy import RECOMMENDATIONS, Strategy
from simple_ros_engines.radio_information.core import RadioInformation
from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.simulator.shaper import LinkShaper
from simple_ros_engines.simulator.shaper_reading import read_settings


@dataclass(frozen=True)
class Scenario:
    """What happens, the same for all configurations."""

    length_s: float = 80.0
    narrow_s: tuple[float, float] = (20.0, 60.0)
    share: float = 0.3
    camera_hz: float = 30.0
    camera_pixels: tuple[int, int] = (640, 480)
    lidar_hz: float = 10.0
    lidar_bytes: int = 160_000
    pose_hz: float = 20.0
    pose_bytes: int = 120
    command_bytes: int = 80
    deadline_s: dict[str, float] = field(
        default_factory=lambda: {"pose": 0.1, "command": 0.1, "camera": 0.5, "lidar": 0.5}
    )
    link: dict[str, Any] = field(
        default_factory=lambda: {
            "up": {"delay_ms": 8, "jitter_ms": 1},
            "down": {"delay_ms": 8, "jitter_ms": 1},
            "channel": {
                "kind": "radio",
                "station_m": [0, 0],
                "route_m": [[20, 0], [80, 0]],
                "speed_mps": 1.4,
            },
        }
    )


CLASSES = [
    {"name": "command", "topics": ["pose", "command"], "priority": 5, "deadline_ms": 100},
    {
        "name": "sensors",
        "topics": ["camera", "lidar"],
        "priority": 2,
        "deadline_ms": 500,
        "discard_late": True,
    },
]


@dataclass(frozen=True)
class Static:
    """A configuration that stays as it is."""

    classes: bool
    camera_hz: float
    quality: int
    scale: float
    lidar_ratio: float


@dataclass
class Told:
    """What came of a message."""

    kind: str
    sent_s: float
    size: int
    look: tuple[float, int] = (100.0, 95)
    arrived_s: float = math.inf
    origin_s: float = 0.0


@cache
def picture_bytes(scene: int, pixels: tuple[int, int], scale: float, quality: int) -> int:
    """Size of a picture of a scene: surfaces, edges and the noise of a sensor."""
    width, height = pixels
    chance = np.random.default_rng(scene)
    y, x = np.mgrid[0:height, 0:width]
    canvas = np.stack([x * 0.2, y * 0.3, (x + y) * 0.1], axis=2)
    for _ in range(60):
        left, top = chance.integers(0, width - 40), chance.integers(0, height - 40)
        right, bottom = left + chance.integers(20, 160), top + chance.integers(20, 120)
        canvas[top:bottom, left:right] = chance.integers(0, 255, 3)
    noisy = np.clip(canvas + chance.normal(0, 6, canvas.shape), 0, 255).astype(np.uint8)
    image = Image(width=width, height=height, step=3 * width, encoding="rgb8", data=noisy.tobytes())
    made = to_jpeg(image, scale, quality)
    assert made is not None
    return made.ByteSize()


class Fixed:
    """Sends as a static configuration says."""

    def __init__(self, scenario: Scenario, how: Static) -> None:
        self._scenario, self._how = scenario, how
        self._gate = RateGate(how.camera_hz)

    def record(self, record: LinkRecord, now_s: float) -> None:
        """A static configuration does not care."""

    def picture(self, scene: int, now_s: float) -> tuple[int, float, int] | None:
        """Bytes, scale and quality of a picture to send now; None for none."""
        if not self._gate.passes(now_s):
            return None
        scale, quality = self._how.scale, self._how.quality
        size = picture_bytes(scene, self._scenario.camera_pixels, scale, quality)
        return size, scale, quality

    def cloud(self, now_s: float) -> int:
        """Bytes of a cloud to send now; 0 for none."""
        return int(self._scenario.lidar_bytes * self._how.lidar_ratio)


class Adaptive:
    """The three engines and the bridge."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self._scenario = scenario
        self._radio, self._cross = RadioInformation(), CrossDomain()
        self._physical = PhysicalAdaptive(PhysicalSettings(), random.Random(seed))
        self._judge = TreatmentJudge()
        self._rules = {kind: FlowRules() for kind in ("camera", "lidar")}

    def record(self, record: LinkRecord, now_s: float) -> None:
        """From a metric to what the bridge does."""
        found = self._radio.take(record, now_s)
        if found is None:
            return
        quality, side, key = found.quality, record.side(), record.link_id
        available = found.available_bps
        view = LinkView(
            side.snr_db,
            side.bler,
            side.mcs,
            quality.response_ms,
            record.get("buffer_bytes"),
            record.throughput_bps(),
            available,
            int(record.get("prb_total") or 0),
        )
        self._physical.observe(key, view)
        metrics = LinkMetrics(
            key, quality.quality, quality.reliability, quality.response_ms, available
        )
        decision = self._cross.decide(metrics)
        limits = decision.limits
        self._judge.constraint(limits.resolution_scale, limits.frame_rate, now_s)
        demand = Demand(
            limits.kind,
            limits.max_rate_bps,
            decision.criticality,
            RECOMMENDATIONS[decision.level],
        )
        self._take(self._physical.decide(key, view, demand), now_s)
        self._physical.applied(key)

    def _take(self, strategy: Strategy, now_s: float) -> None:
        self._judge.strategy(strategy.compression_ratio, now_s)
        wanted = [rules.wanted_bps(as_jpeg=kind == "camera") for kind, rules in self._rules.items()]
        given = fair_rates(0.8 * strategy.rate_bps, wanted)
        for rules, rate_bps in zip(self._rules.values(), given, strict=True):
            rules.strategy(rate_bps, strategy.compression_ratio, now_s)

    def picture(self, scene: int, now_s: float) -> tuple[int, float, int] | None:
        """Bytes, scale and quality of a picture to send now; None for none."""
        treatment, rules = self._judge.treatment, self._rules["camera"]
        rules.came(3 * math.prod(self._scenario.camera_pixels), now_s)
        look = rules.look(treatment, now_s)
        if not rules.passes(treatment, now_s, rules.ladder.expected_bytes()):
            return None
        size = picture_bytes(scene, self._scenario.camera_pixels, look.scale, look.quality)
        rules.sent(size, look)
        return size, look.scale, look.quality

    def cloud(self, now_s: float) -> int:
        """Bytes of a cloud to send now; 0 for none."""
        treatment, rules, size = (
            self._judge.treatment,
            self._rules["lidar"],
            self._scenario.lidar_bytes,
        )
        rules.came(size, now_s)
        share = rules.cloud_share(treatment, size, now_s)
        if not rules.passes(treatment, now_s, rules.cloud_bytes(share, size)):
            return 0
        thinned = int(share * size)
        rules.thinned(share, size, thinned)
        rules.sent(thinned)
        return thinned


class Drive:
    """One drive.

    Args:
        scenario: What happens.
        seed: Of radio and scenes.
        sender: What decides what is sent.
        classes: Whether the link tells commands from pictures.
    """

    def __init__(
        self, scenario: Scenario, seed: int, sender: Fixed | Adaptive, *, classes: bool
    ) -> None:
        data: dict[str, Any] = {
            "seed": seed,
            "carrier": {"scs_khz": 30, "bandwidth_mhz": 20},
            "links": {"robot": scenario.link},
        }
        if classes:
            data["classes"] = CLASSES
        self.told: list[Told] = []
        self._scenario, self._sender = scenario, sender
        self._shaper = LinkShaper(read_settings(data), 0.0)
        self._ways = {
            kind: self._shaper.open("robot", "edge", kind) for kind in ("pose", "camera", "lidar")
        }
        self._ways["command"] = self._shaper.open("edge", "robot", "command")
        self._order = count()
        self._due: list[tuple[float, int, float, Callable[[float], None]]] = []
        self._pictures = 0

    def run(self) -> list[Told]:
        """Drive; what came of each message."""
        scenario = self._scenario
        for period_s, work in (
            (1 / scenario.pose_hz, self._pose),
            (1 / scenario.camera_hz, self._camera),
            (1 / scenario.lidar_hz, self._lidar),
            (0.1, self._metrics),
        ):
            self._at(period_s, period_s, work)
        for when_s, share in zip(scenario.narrow_s, (scenario.share, 1.0), strict=True):
            self._at(when_s, math.inf, lambda now_s, share=share: self._share(share, now_s))
        now_s = 0.0
        while now_s < scenario.length_s:
            now_s = min(self._due[0][0], self._shaper.next_event_s())
            for _, told in self._shaper.advance(now_s):
                self._arrived(told, now_s)
            while self._due[0][0] <= now_s:
                when_s, _, period_s, work = heapq.heappop(self._due)
                self._at(when_s + period_s, period_s, work)
                work(when_s)
        return self.told

    def _at(self, when_s: float, period_s: float, work: Callable[[float], None]) -> None:
        heapq.heappush(self._due, (when_s, next(self._order), period_s, work))

    def _share(self, share: float, now_s: float) -> None:
        self._shaper.change("robot", "", {"max_share": share}, now_s)

    def _metrics(self, now_s: float) -> None:
        for record in self._shaper.records(int(now_s * 1e9), now_s):
            self._sender.record(record, now_s)

    def _send(self, told: Told, now_s: float) -> None:
        self.told.append(told)
        self._shaper.offer(self._ways[told.kind], told, told.size, now_s)

    def _pose(self, now_s: float) -> None:
        self._send(Told("pose", now_s, self._scenario.pose_bytes), now_s)

    def _camera(self, now_s: float) -> None:
        self._pictures += 1
        picture = self._sender.picture(self._pictures % 7, now_s)
        if picture is not None:
            size, scale, quality = picture
            self._send(Told("camera", now_s, size, (scale, quality)), now_s)

    def _lidar(self, now_s: float) -> None:
        size = self._sender.cloud(now_s)
        if size:
            self._send(Told("lidar", now_s, size), now_s)

    def _arrived(self, told: Told, now_s: float) -> None:
        told.arrived_s = now_s
        if told.kind == "pose":
            size = self._scenario.command_bytes
            self._send(Told("command", now_s, size, origin_s=told.sent_s), now_s)
