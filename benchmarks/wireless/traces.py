"""Traces after the standards' models, fixed before anything was measured on them. SIMULATED.

Street canyon of 3GPP TR 38.901 without line of sight: path loss, 7.82 dB of shadowing that is correlated over 13 m
(tables 7.4.1-1 and 7.5-6), delay spread of its median. Fading by Clarke's spectrum at 3 km/h and 60 km/h over the
whole carrier. The other devices of the cell fetch files of 0.5 MB, as in the traffic models of TR 36.814, A.2.1.3,
which come by chance and share the blocks evenly with the link.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simple_ros_engines.simulator.link import LinkSettings, SimulatedLink
from simple_ros_engines.simulator.propagation import Fading, effective_snr_db, umi_loss_db

WALKING_MPS, DRIVING_MPS = 3 / 3.6, 60 / 3.6


def street(speed_mps: float, **others) -> LinkSettings:
    """A link in a street canyon; who drives goes further."""
    far = 150.0 if speed_mps < 5 else 250.0
    return LinkSettings(
        speed_mps=speed_mps,
        distance_m=(40.0, far),
        shadow_sigma_db=7.82,
        shadow_correlation_m=13.0,
        **others,
    )


@dataclass(frozen=True)
class CellTraffic:
    """What the others do.

    Attributes:
        load: Share of the cell's time that they would take alone.
        file_bits: Size of what they fetch.
        cell_bps: What the cell carries for them.
        step_s: In which time is reckoned.
    """

    load: float = 0.5
    file_bits: float = 4e6
    cell_bps: float = 45e6
    step_s: float = 0.01


class Cell:
    """Files that come by chance and share the cell evenly with one link that always sends."""

    def __init__(self, generator: np.random.Generator, traffic: CellTraffic) -> None:
        self.files: list[float] = []
        self._traffic = traffic
        rate = traffic.load * traffic.cell_bps / traffic.file_bits
        self._arrivals = lambda: generator.poisson(rate * traffic.step_s, 1000).tolist()
        self._next: list[int] = []

    def share(self, period_s: float) -> float:
        """Mean share of the link in the coming time."""
        traffic, total = self._traffic, 0.0
        steps = round(period_s / traffic.step_s)
        for _ in range(steps):
            if not self._next:
                self._next = self._arrivals()
            self.files += [traffic.file_bits] * self._next.pop()
            part = 1 / (1 + len(self.files))
            total += part
            sent = part * traffic.cell_bps * traffic.step_s
            self.files = [left - sent for left in self.files if left > sent]
        return total / steps


class KnownLink(SimulatedLink):
    """A simulated link of which one may know what nobody can measure."""

    def neighbours(self) -> float:
        """What says how much the others take."""
        return self._share

    def state(self) -> tuple[float, float, float, float]:
        """Neighbours, shadowing, path loss now and in a second."""
        here, moved_m = self._travelled_m, self.settings.speed_mps
        losses = []
        for self._travelled_m in (here, here + moved_m):
            losses.append(umi_loss_db(self._distance_m(), 3.5, line_of_sight=False))
        self._travelled_m = here
        return self.neighbours(), self._shadow.value_db, losses[0], losses[1]


class StreetLink(KnownLink):
    """A simulated link with such fading and such neighbours."""

    def __init__(
        self,
        generator: np.random.Generator,
        settings: LinkSettings,
        fading: Fading,
        traffic: CellTraffic,
        samples: int,
    ) -> None:
        super().__init__(generator, settings)
        self.cell = Cell(generator, traffic)
        times = np.arange(samples * settings.reports) * settings.period_s / settings.reports
        gains = fading.trace(generator, times)
        level = np.full(times.size, 15.0)
        self._fades = (effective_snr_db(level, gains) - level).reshape(samples, -1)
        self._at = 0

    def neighbours(self) -> float:
        return float(len(self.cell.files))

    def _fades_db(self) -> list[float]:
        fades = self._fades[self._at].tolist()
        self._at += 1
        return fades

    def _granted(self) -> float:
        self._share = self.cell.share(self.settings.period_s)
        return self._share


def street_fading(speed_mps: float) -> Fading:
    """Over 20 MHz with 4 antennas; 103 ns is the median delay spread of TR 38.901, table 7.5-6, at 3.5 GHz."""
    return Fading(speed_mps, delay_spread_s=103e-9, bandwidth_hz=18.36e6)
