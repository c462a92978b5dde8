"""A radio channel along a way, which drives a shaped link. SIMULATED; pure.

Path loss of TR 38.901 from a station, shadowing, places where nothing arrives, and a scheme adapted
by an outer loop against error curves of another shape than the engines know (`radio.HiddenCurves`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any
from zlib import crc32

import numpy as np

from simple_ros.errors import ConfigError
from simple_ros_engines.physical_adaptive.link_adaptation import LinkAdapter, OuterLoop
from simple_ros_engines.radio.carrier import Carrier
from simple_ros_engines.radio.mcs import McsTable
from simple_ros_engines.simulator.propagation import Shadowing, umi_loss_db
from simple_ros_engines.simulator.radio import HiddenCurves
from simple_ros_engines.simulator.shaper_trace import (
    Channel,
    Sample,
    Side,
    TraceChannel,
    read_trace,
)

__all__ = [
    "DeadZone",
    "RadioChannel",
    "RadioSettings",
    "make_channel",
]


@dataclass(frozen=True, slots=True)
class DeadZone:
    """A round place behind something: further loss, full inside, gone 3 m outside.

    Attributes:
        x_m: Middle.
        y_m: Middle.
        radius_m: Of the place.
        loss_db: What it costs.
    """

    x_m: float
    y_m: float
    radius_m: float
    loss_db: float = 50.0

    def loss_at(self, x_m: float, y_m: float) -> float:
        """The loss at a place, dB."""
        outside = math.hypot(x_m - self.x_m, y_m - self.y_m) - self.radius_m
        return self.loss_db * min(1.0, max(0.0, 1 - outside / 3))


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """A radio channel.

    Attributes:
        station_m: Where the station stands.
        route_m: Waypoints, gone to and fro; a single one stays.
        speed_mps: Along the route; 0: the place is told (`Channel.moved_to`).
        power_dbm: Received at no path loss, by subcarrier.
        noise_dbm: By subcarrier.
        carrier_ghz: Frequency.
        shadow_sigma_db: Of shadowing.
        shadow_correlation_m: Its distance.
        fast_sigma_db: Of what fading is left over a wide carrier, step to step.
        report_noise_db: Of what the radio reports.
        downlink_gain_db: By how much the downlink is better.
        max_offset_db: Largest offset of the hidden error curves.
        period_s: Of a step.
        dead_zones: Places where little arrives.
    """

    station_m: tuple[float, float] = (0.0, 0.0)
    route_m: tuple[tuple[float, float], ...] = ((30.0, 0.0),)
    speed_mps: float = 1.4
    power_dbm: float = -2.0
    noise_dbm: float = -122.0
    carrier_ghz: float = 3.5
    shadow_sigma_db: float = 4.0
    shadow_correlation_m: float = 13.0
    fast_sigma_db: float = 1.0
    report_noise_db: float = 0.5
    downlink_gain_db: float = 3.0
    max_offset_db: float = 2.0
    period_s: float = 0.1
    dead_zones: tuple[DeadZone, ...] = field(default_factory=tuple)


_BLOCKS = 20.0


class _RadioSide:
    def __init__(self, generator: np.random.Generator, offset_db: float, carrier: Carrier) -> None:
        self._generator = generator
        self._carrier = carrier
        self._curves = HiddenCurves.drawn(generator, McsTable.QAM64, offset_db)
        self._adapter = LinkAdapter(McsTable.QAM64, OuterLoop(0.1, 0.002))

    def sample(self, snr_db: float, noise_db: float) -> Side:
        reported = snr_db + float(self._generator.normal(0.0, noise_db))
        mcs = self._adapter.choose(reported)
        bler = self._curves.bler(mcs, snr_db)
        self._adapter.feedback(_BLOCKS * (1 - bler), _BLOCKS * bler)
        rate = self._curves.rate_bps(mcs, snr_db, self._carrier)
        return Side({"rate_mbps": rate / 1e6}, reported, mcs, bler)


class RadioChannel(Channel):
    """A device that moves about in a cell.

    Args:
        settings: Parameters.
        carrier: Both directions.
        generator: Chance.
    """

    def __init__(
        self, settings: RadioSettings, carrier: Carrier, generator: np.random.Generator
    ) -> None:
        self.settings = settings
        self.period_s = settings.period_s
        self.position_m = settings.route_m[0]
        self._generator = generator
        self._shadow = Shadowing(generator, settings.shadow_sigma_db, settings.shadow_correlation_m)
        self._sides = {
            way: _RadioSide(generator, settings.max_offset_db, carrier) for way in ("up", "down")
        }
        self._seen_m = self.position_m
        self._told = False

    def moved_to(self, x_m: float, y_m: float) -> None:
        """The device is here; its route does not count any more."""
        self.position_m, self._told = (x_m, y_m), True

    def at(self, elapsed_s: float) -> Sample:
        """The next step."""
        settings = self.settings
        if not self._told:
            self.position_m = _along(settings.route_m, settings.speed_mps * elapsed_s)
        x, y = self.position_m
        moved_m = math.dist(self._seen_m, self.position_m)
        self._seen_m = self.position_m
        loss = umi_loss_db(
            math.dist(settings.station_m, (x, y)), settings.carrier_ghz, line_of_sight=False
        )
        hidden = sum(zone.loss_at(x, y) for zone in settings.dead_zones)
        rsrp = settings.power_dbm - loss - hidden + self._shadow.moved(moved_m)
        fast = float(self._generator.normal(0.0, settings.fast_sigma_db))
        snr = min(32.0, rsrp - settings.noise_dbm + fast)
        gains = {"up": 0.0, "down": settings.downlink_gain_db}
        sides = {
            way: side.sample(max(-30.0, snr + gains[way]), settings.report_noise_db)
            for way, side in self._sides.items()
        }
        return Sample(sides, max(-165.0, rsrp), (x, y))


def _along(route: Sequence[tuple[float, float]], way_m: float) -> tuple[float, float]:
    """The place after so long a way along a route, gone to and fro."""
    legs = [math.dist(a, b) for a, b in pairwise(route)]
    total = sum(legs)
    if not total:
        return route[0]
    rest = way_m % (2 * total)
    rest = rest if rest <= total else 2 * total - rest
    for (start, end), leg in zip(pairwise(route), legs, strict=True):
        if rest <= leg:
            part = rest / leg if leg else 0.0
            return start[0] + part * (end[0] - start[0]), start[1] + part * (end[1] - start[1])
        rest -= leg
    return route[-1]


def make_channel(data: Mapping[str, Any], carrier: Carrier, seed: int, name: str) -> Channel | None:
    """The channel that a link's settings ask for; None for none.

    Args:
        data: ``{"kind": "radio", ...}`` with the fields of `RadioSettings`, or ``{"kind": "trace", "text":
            ..., "period_s": ..., "loop": ...}``.
        carrier: Both directions.
        seed: Of chance.
        name: Of the link; chance depends on it.

    Raises:
        ConfigError: Something is unknown or wrong.
    """
    if not data:
        return None
    rest = {key: value for key, value in data.items() if key != "kind"}
    where = f"link {name}: channel"
    match data.get("kind"):
        case "radio":
            words = [seed, crc32(name.encode()), 7]
            return RadioChannel(_radio(rest, where), carrier, np.random.default_rng(words))
        case "trace":
            rows = read_trace(str(rest.pop("text", "")), where)
            try:
                return TraceChannel(rows, **rest)
            except TypeError as error:
                raise ConfigError(f"{where}: {error}") from None
    raise ConfigError(f"{where}: kind is {data.get('kind')!r}, must be radio or trace")


def _radio(data: dict[str, Any], where: str) -> RadioSettings:
    names = {item.name for item in fields(RadioSettings)}
    unknown = sorted(set(data) - names)
    if unknown:
        raise ConfigError(f"{where}: unknown key {unknown[0]!r}; there are {sorted(names)}")
    try:
        if "dead_zones" in data:
            data["dead_zones"] = tuple(DeadZone(*map(float, zone)) for zone in data["dead_zones"])
        if "route_m" in data:
            data["route_m"] = tuple((float(x), float(y)) for x, y in data["route_m"])
        if "station_m" in data:
            x, y = data["station_m"]
            data["station_m"] = (float(x), float(y))
        settings = RadioSettings(**data)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{where}: {error}") from None
    if not settings.route_m or settings.period_s < 0.01:
        raise ConfigError(f"{where}: needs a route_m of one point or more, and period_s >= 0.01")
    return settings
