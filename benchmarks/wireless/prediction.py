"""Forecasts one second ahead, against the newest value and against WirelessROS' line of ten points.

SIMULATED. `python benchmarks/wireless/prediction.py [--seeds 20]`
"""

from __future__ import annotations

import math

import numpy as np
from common import Column, arguments, print_parameters, print_table

from simple_ros_engines.radio_information.prediction import Predictor, line_fit
from simple_ros_engines.simulator.link import LinkSettings, SimulatedLink

SERIES = {"delivery_bps": (1e-6, 0.1), "ul_snr_db": (1.0, -math.inf), "rtt_ms": (1.0, 1.0)}
SAMPLES = 6000
HORIZON = 10
WARM_UP = 100


def errors(values: list[float], least: float) -> tuple[float, float, float]:
    """Mean absolute errors: ours, newest value, line of ten."""
    predictor = Predictor(1.0, least=least, logarithmic=least > 0)
    sums = [0.0, 0.0, 0.0]
    for index, value in enumerate(values):
        forecast = predictor.sample(index * 0.1, value).value
        due = index + HORIZON
        if index < WARM_UP or due >= len(values):
            continue
        ten = values[index - 9 : index + 1]
        line = max(least, line_fit(list(range(10)), ten, 9 + HORIZON))
        for slot, guess in enumerate((forecast, value, line)):
            sums[slot] += abs(guess - values[due])
    return tuple(sums)


def one_seed(seed: int, settings: LinkSettings) -> list[float]:
    link = SimulatedLink(np.random.default_rng(seed), settings)
    records = [link.step() for _ in range(SAMPLES)]
    row = []
    for name, (scale, least) in SERIES.items():
        ours, newest, line = errors([scale * r.values[name] for r in records], least)
        row += [100 * (1 - ours / newest), 100 * (1 - line / newest)]
    return row


COLUMNS = [
    Column(f"{name}: {who} below the newest value", "%", min, bar)
    for name, wanted in (
        ("delivery_bps", "bar: >= 20"),
        ("ul_snr_db", ""),
        ("rtt_ms", "bar: >= 20"),
    )
    for who, bar in (("ours", wanted), ("line of ten", ""))
]
SCENARIOS = {
    "walking": LinkSettings(),
    "walking, smooth grants (no bar)": LinkSettings(scheduler_sigma=0.2),
    "driving, grants as before (no bar)": LinkSettings(speed_mps=13.9, distance_m=(40.0, 250.0)),
}


def main() -> None:
    options = arguments(__doc__ or "")
    for name, settings in SCENARIOS.items():
        print_parameters(f"prediction, 1 s ahead at 10 Hz, {name} (SIMULATED)", settings)
        rows = [one_seed(seed, settings) for seed in range(1, options.seeds + 1)]
        print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
