"""How much arrives: path loss, shadowing, fading. SIMULATED; no radio is behind it.

Path loss: 3GPP TR 38.901, table 7.4.1-1, urban micro (UMi street canyon) and indoor office. Shadowing:
log-normal, correlated over distance by ``exp(-d/d_corr)`` (Gudmundson, Electronics Letters 27(23), 1991).
Fading: taps with an exponential power delay profile, each a sum of sinusoids (Clarke's spectrum), so that
a wide carrier sees several fades at once, and what counts is the effective ratio over its subbands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Fading", "Shadowing", "effective_snr_db", "indoor_loss_db", "umi_loss_db"]

Floats = NDArray[np.float64]
_LIGHT_MPS = 299_792_458.0


def umi_loss_db(
    distance_m: float,
    carrier_ghz: float,
    *,
    line_of_sight: bool,
    station_m: float = 10.0,
    device_m: float = 1.5,
) -> float:
    """Path loss of a street canyon, dB (TR 38.901, table 7.4.1-1; distances 10 m to 5 km).

    Args:
        distance_m: Along the ground.
        carrier_ghz: 0.5 to 100.
        line_of_sight: Whether the station can be seen.
        station_m: Height of the station.
        device_m: Height of the device.
    """
    ground = max(10.0, distance_m)
    slant = math.hypot(ground, station_m - device_m)
    effective = 4 * (station_m - 1) * (device_m - 1) * carrier_ghz * 1e9 / _LIGHT_MPS
    if ground <= effective:
        clear = 32.4 + 21 * math.log10(slant) + 20 * math.log10(carrier_ghz)
    else:
        bend = effective**2 + (station_m - device_m) ** 2
        clear = (
            32.4 + 40 * math.log10(slant) + 20 * math.log10(carrier_ghz) - 9.5 * math.log10(bend)
        )
    if line_of_sight:
        return clear
    hidden = (
        22.4 + 35.3 * math.log10(slant) + 21.3 * math.log10(carrier_ghz) - 0.3 * (device_m - 1.5)
    )
    return max(clear, hidden)


def indoor_loss_db(distance_m: float, carrier_ghz: float, *, line_of_sight: bool) -> float:
    """Path loss of an office, dB (TR 38.901, table 7.4.1-1, InH; distances 1 m to 150 m)."""
    distance = max(1.0, distance_m)
    clear = 32.4 + 17.3 * math.log10(distance) + 20 * math.log10(carrier_ghz)
    if line_of_sight:
        return clear
    hidden = 17.3 + 38.3 * math.log10(distance) + 24.9 * math.log10(carrier_ghz)
    return max(clear, hidden)


class Shadowing:
    """What stands in the way, along a device's way.

    Args:
        generator: Randomness.
        sigma_db: Standard deviation.
        correlation_m: Distance at which correlation has fallen to 1/e.
    """

    def __init__(
        self, generator: np.random.Generator, sigma_db: float = 4.0, correlation_m: float = 13.0
    ) -> None:
        self._generator = generator
        self._sigma_db = sigma_db
        self._correlation_m = correlation_m
        self.value_db = float(generator.normal(0.0, sigma_db))

    def moved(self, distance_m: float) -> float:
        """The loss after moving on, dB."""
        keep = math.exp(-distance_m / self._correlation_m)
        fresh = float(self._generator.normal(0.0, self._sigma_db))
        self.value_db = keep * self.value_db + math.sqrt(1 - keep**2) * fresh
        return self.value_db


@dataclass(frozen=True)
class Fading:
    """Fast fading of one link.

    Attributes:
        speed_mps: Of the device.
        carrier_ghz: Carrier frequency.
        delay_spread_s: Of the exponential profile.
        bandwidth_hz: Over which the link is spread.
        taps: Echoes.
        waves: Sinusoids of each echo.
        subbands: Over which the effective ratio is taken.
        antennas: Of the receiver, which adds up what they get (maximum ratio combining); 4 is what TS
            38.101-1, 7.2 asks of devices in the band at 3.5 GHz.
    """

    speed_mps: float
    carrier_ghz: float = 3.5
    delay_spread_s: float = 300e-9
    bandwidth_hz: float = 40e6
    taps: int = 12
    waves: int = 16
    subbands: int = 24
    antennas: int = 4

    def trace(self, generator: np.random.Generator, times_s: Floats) -> Floats:
        """Power gain by time and subband, mean 1."""
        branches = [self._branch(generator, times_s) for _ in range(self.antennas)]
        power: Floats = np.mean(branches, axis=0)
        return power

    def _branch(self, generator: np.random.Generator, times_s: Floats) -> Floats:
        doppler_hz = self.speed_mps * self.carrier_ghz * 1e9 / _LIGHT_MPS
        delays = np.linspace(0.0, 4 * self.delay_spread_s, self.taps)
        powers = np.exp(-delays / self.delay_spread_s)
        powers /= powers.sum()
        gains = np.zeros((times_s.size, self.taps), np.complex128)
        for tap in range(self.taps):
            angles = generator.uniform(0, 2 * np.pi, self.waves)
            phases = generator.uniform(0, 2 * np.pi, self.waves)
            turns = 2 * np.pi * doppler_hz * np.cos(angles)
            sum_of_waves = _sum_of_waves(times_s, turns, phases)
            gains[:, tap] = sum_of_waves * math.sqrt(powers[tap] / self.waves)
        offsets = (np.arange(self.subbands) / self.subbands - 0.5) * self.bandwidth_hz
        turn = np.exp(-2j * np.pi * delays[:, None] * offsets[None, :])
        power: Floats = np.abs(gains @ turn) ** 2
        return power


def _sum_of_waves(times_s: Floats, turns: Floats, phases: Floats) -> NDArray[np.complex128]:
    """Sum of ``exp(i (time turn + phase))`` over waves, by time."""
    count = times_s.size
    steps = np.diff(times_s)
    if count < 64 or not np.allclose(steps, steps[0], rtol=1e-6, atol=0.0):
        direct: NDArray[np.complex128] = np.exp(
            1j * (times_s[:, None] * turns[None, :] + phases)
        ).sum(1)
        return direct
    # On an even grid a time is a coarse and a fine part, and the sum over waves a matrix product.
    fine = math.isqrt(count) + 1
    step = (times_s[-1] - times_s[0]) / (count - 1)
    starts = times_s[0] + np.arange(-(-count // fine)) * fine * step
    coarse = np.exp(1j * (starts[:, None] * turns + phases))
    product: NDArray[np.complex128] = (
        coarse @ np.exp(1j * np.arange(fine)[:, None] * step * turns).T
    )
    return product.reshape(-1)[:count]


def effective_snr_db(mean_snr_db: Floats, gains: Floats) -> Floats:
    """The ratio of a flat channel with the same capacity, by time, dB."""
    ratios = 10 ** (mean_snr_db[:, None] / 10) * gains
    capacity = np.log2(1 + ratios).mean(axis=1)
    result: Floats = 10 * np.log10(np.maximum(1e-9, 2**capacity - 1))
    return result
