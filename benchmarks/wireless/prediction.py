"""Forecasts one second ahead, against the newest value.

Beside ours stand the best simple alternatives and what is attainable: the best linear combination of the series' own
past, fitted in hindsight over the whole trace, and the same of what nobody can see, the state of the generator
(shadowing, place, direction, files in the cell). SIMULATED.
`python benchmarks/wireless/prediction.py [--seeds 20]`
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from common import Column, arguments, by_seed, print_parameters, print_table, recent_means
from traces import (
    DRIVING_MPS,
    WALKING_MPS,
    CellTraffic,
    KnownLink,
    StreetLink,
    street,
    street_fading,
)

from simple_ros_engines.radio_information.prediction import Predictor, line_fit
from simple_ros_engines.simulator.link import LinkSettings

SAMPLES = 6000
HORIZON = 10
WARM_UP = 100
EDGES = (*range(9), 12, 16, 24, 32, 64, 128, 256)
FIELDS = ("delivery_bps", "ul_snr_db", "rtt_ms", "prb_cell_used")


@dataclass(frozen=True)
class Series:
    """One number to foretell, in the unit of its least value; what is beside it in the record."""

    values: np.ndarray
    least: float | None = None
    beside: tuple[np.ndarray, ...] = ()

    def inward(self) -> np.ndarray:
        return self.values if self.least is None else np.log(np.maximum(self.least, self.values))

    def outward(self, guesses: np.ndarray) -> np.ndarray:
        return guesses if self.least is None else np.exp(np.clip(guesses, np.log(self.least), 50))

    def error(self, forecasts: np.ndarray) -> float:
        """Mean absolute error of the forecasts made with each sample."""
        return float(np.abs(forecasts[:-HORIZON] - self.values[HORIZON:])[WARM_UP:].mean())

    def gain(self, forecasts: np.ndarray) -> float:
        """Per cent below the error of the newest value."""
        return 100 * (1 - self.error(forecasts) / self.error(self.values))


def ours(series: Series) -> np.ndarray:
    least = -np.inf if series.least is None else series.least
    logarithmic, count = series.least is not None, len(series.beside)
    predictor = Predictor(1.0, least=least, logarithmic=logarithmic, others=count)
    beside = np.stack(series.beside, 1).tolist() if count else [()] * SAMPLES
    pairs = zip(series.values.tolist(), beside, strict=True)
    return np.array([predictor.sample(0.1 * at, *pair).value for at, pair in enumerate(pairs)])


def mean_of_ten(series: Series) -> np.ndarray:
    sums = np.cumsum(np.r_[np.full(10, series.values[0]), series.values])
    return (sums[10:] - sums[:-10]) / 10


def line_of_ten(series: Series) -> np.ndarray:
    """What WirelessROS does."""
    times, values = range(10), series.values.tolist()
    lines = [line_fit(times, values[at - 9 : at + 1], 9 + HORIZON) for at in range(9, SAMPLES)]
    return np.maximum(series.least or -np.inf, np.r_[series.values[:9], lines])


def in_hindsight(series: Series, inputs: np.ndarray) -> np.ndarray:
    """The least squares combination of inputs over the whole trace."""
    known, came = inputs[WARM_UP:-HORIZON], series.inward()[WARM_UP + HORIZON :]
    return series.outward(inputs @ np.linalg.lstsq(known, came, rcond=None)[0])


def state(link: KnownLink) -> list[float]:
    """What the generator knows of the coming second."""
    files, shadow, loss, later = link.state()
    parts = [shadow, loss, later, files, files**2, 1 / (1 + files)]
    return [*parts, *(shadow * part for part in parts), *(files * part for part in parts), 1.0]


def made(seed: int, speed_mps: float | None) -> KnownLink:
    generator = np.random.default_rng(seed)
    if speed_mps is None:
        return KnownLink(generator, LinkSettings())
    settings, fading = street(speed_mps, offered_bps=1e6), street_fading(speed_mps)
    return StreetLink(generator, settings, fading, CellTraffic(), SAMPLES)


def recorded(link: KnownLink) -> tuple[np.ndarray, np.ndarray]:
    """Fields by sample, and the state behind them."""
    rows, states = [], []
    for _ in range(SAMPLES):
        values = link.step().values
        rows.append([values[name] for name in FIELDS])
        states.append(state(link))
    return np.array(rows), np.array(states)


def one_seed(seed: int, speed_mps: float | None) -> list[float]:
    rows, states = recorded(made(seed, speed_mps))
    bandwidth, signal, trip, used = rows.T
    rate = Series(1e-6 * bandwidth, 0.1, (signal, used))
    result = []
    for series in (rate, Series(signal), Series(trip, 1.0)):
        inward = series.inward()
        own_past = recent_means(inward, EDGES)
        forecasters: list[Callable[[Series], np.ndarray]] = [ours, mean_of_ten, line_of_ten]
        result += [series.gain(one(series)) for one in forecasters]
        if series.least != 1.0:
            seen = np.c_[states, inward, signal]
            result += [series.gain(in_hindsight(series, own_past))]
            result += [series.gain(in_hindsight(series, seen))]
    return result


NUMBERS = (("bandwidth", "bar: >= 20"), ("signal", ""), ("round trip", "bar: >= 20"))
COLUMNS = [
    Column(f"{name}: {who}", "%", min, bar if who == "ours" else "")
    for name, bar in NUMBERS
    for who in (
        "ours",
        "best simple (mean of ten)",
        "line of ten (WirelessROS)",
        "attainable from its past",
        "attainable knowing the state",
    )
    if not (name == "round trip" and who.startswith("attainable"))
]
SCENARIOS = {
    "walking, mild shadowing, white fading": None,
    "walking 3 km/h in a street canyon": WALKING_MPS,
    "driving 60 km/h in a street canyon": DRIVING_MPS,
}


def main() -> None:
    options = arguments(__doc__ or "")
    for name, speed in SCENARIOS.items():
        shown = [LinkSettings()]
        if speed is not None:
            shown = [street(speed, offered_bps=1e6), street_fading(speed), CellTraffic()]
        title = f"error 1 s ahead at 10 Hz below that of the newest value, {name} (SIMULATED)"
        print_parameters(title, *shown)
        rows = by_seed(partial(one_seed, speed_mps=speed), options)
        print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
