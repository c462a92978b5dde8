"""Anomalies: precision and recall on injected events; the plain threshold of WirelessROS beside it.

SIMULATED. `python benchmarks/wireless/anomalies.py [--seeds 20]`
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from statistics import fmean

import numpy as np
from common import Column, arguments, by_seed, print_parameters, print_table
from traces import (
    DRIVING_MPS,
    WALKING_MPS,
    CellTraffic,
    StreetLink,
    street,
    street_fading,
)

from simple_ros_engines.radio_information.anomalies import (
    THRESHOLDS,
    AnomalyKind,
    AnomalyWatch,
)
from simple_ros_engines.simulator.link import Disturbance, LinkSettings, SimulatedLink


@dataclass(frozen=True)
class Setup:
    """Parameters of the generator; an event is a step of some size for some samples."""

    samples: int = 6000
    warm_up: int = 60
    every: tuple[int, int] = (80, 160)
    lasts: tuple[int, int] = (5, 20)
    loss_db: tuple[float, float] = (9.0, 18.0)
    hidden_db: tuple[float, float] = (6.0, 12.0)
    rtt_ms: tuple[float, float] = (60.0, 200.0)
    tolerance: int = 8


def events(setup: Setup, rng) -> list[tuple[int, int, AnomalyKind, Disturbance]]:
    found, at = [], setup.warm_up
    while True:
        at += int(rng.integers(*setup.every))
        end = at + int(rng.integers(*setup.lasts))
        if end + setup.tolerance >= setup.samples:
            return found
        kind = list(AnomalyKind)[int(rng.integers(3))]
        what = {
            AnomalyKind.SNR_DROP: Disturbance(loss_db=rng.uniform(*setup.loss_db)),
            AnomalyKind.BLER_SPIKE: Disturbance(hidden_db=rng.uniform(*setup.hidden_db)),
            AnomalyKind.LATENCY_SPIKE: Disturbance(rtt_ms=rng.uniform(*setup.rtt_ms)),
        }[kind]
        found.append((at, end, kind, what))


class Plain:
    """Newest value against the mean of the four before it; no memory, no spread."""

    def __init__(self) -> None:
        self.before: dict = {kind: [] for kind in AnomalyKind}
        self.on: set = set()

    def sample(self, record) -> list[AnomalyKind]:
        side, began = record.side(), []
        values = (side.snr_db, side.bler, record.get("rtt_ms"))
        for kind, value in zip(AnomalyKind, values, strict=True):
            past = self.before[kind]
            if len(past) > 5:
                change = (value - fmean(past[-4:])) * (-1 if kind is AnomalyKind.SNR_DROP else 1)
                if change > THRESHOLDS[kind]:
                    if kind not in self.on:
                        began.append(kind)
                    self.on.add(kind)
                else:
                    self.on.discard(kind)
            past.append(value)
        return began


@dataclass(frozen=True)
class Truth:
    """What happened: events, those of them that changed the link, and samples that are left out."""

    events: list[tuple[int, int, AnomalyKind, Disturbance]]
    felt: set[int]
    left_out: set[int]


def truth(setup: Setup, injected, records) -> Truth:
    """A drop far above the last scheme and interference that costs no blocks are no events.

    While the link is out of reach, when the lowest scheme loses blocks without any event, and in the two seconds
    after, alarms are neither right nor wrong.
    """
    snrs = [record.values["ul_snr_db"] for record in records]
    blers = [record.values["ul_bler"] for record in records]
    felt = set()
    for index, (start, _, kind, _) in enumerate(injected):
        fell = fmean(snrs[start - 3 : start]) - fmean(snrs[start : start + 3])
        is_felt = {
            AnomalyKind.SNR_DROP: fell > THRESHOLDS[AnomalyKind.SNR_DROP],
            AnomalyKind.BLER_SPIKE: max(blers[start : start + 5]) > 0.3,
            AnomalyKind.LATENCY_SPIKE: True,
        }
        if is_felt[kind]:
            felt.add(index)
    disturbed = {at for start, end, _, _ in injected for at in range(start, end + setup.tolerance)}
    out: set[int] = set()
    for at, record in enumerate(records):
        if at not in disturbed and record.values["ul_mcs"] == 0 and blers[at] > 0.3:
            out.update(range(at, at + 20))
    return Truth(injected, felt, out - disturbed)


def judged(setup: Setup, what: Truth, alarms: list[tuple[int, AnomalyKind]]) -> tuple[float, float]:
    """Precision and recall. A strong drop also costs blocks, so those alarms count for the event."""
    found, wrong = set(), 0
    counted = [one for one in alarms if one[0] >= setup.warm_up and one[0] not in what.left_out]
    for at, kind in counted:
        near = [
            index
            for index, (start, end, _, _) in enumerate(what.events)
            if start <= at <= end + setup.tolerance
        ]
        found.update(index for index in near if what.events[index][2] is kind)
        wrong += not near
    right = len(counted) - wrong
    return right / max(1, right + wrong), len(found & what.felt) / len(what.felt)


def one_seed(seed: int, setup: Setup, speed_mps: float | None) -> list[float]:
    rng = np.random.default_rng(seed)
    if speed_mps is None:
        link = SimulatedLink(rng, PLAIN_LINK)
    else:
        settings, fading = street(speed_mps, offered_bps=1e6), street_fading(speed_mps)
        link = StreetLink(rng, settings, fading, CellTraffic(), setup.samples)
    injected = events(setup, rng)
    by_sample = {at: what for start, end, _, what in injected for at in range(start, end)}
    watch, plain = AnomalyWatch(), Plain()
    ours, theirs, records = [], [], []
    for at in range(setup.samples):
        record = link.step(by_sample.get(at, Disturbance()))
        records.append(record)
        ours += [(at, change.kind) for change in watch.sample(record) if change.began]
        theirs += [(at, kind) for kind in plain.sample(record)]
    what = truth(setup, injected, records)
    return [
        *judged(setup, what, ours),
        *judged(setup, what, theirs),
        len(what.felt),
        100 * len(what.left_out) / setup.samples,
    ]


COLUMNS = [
    Column("ours, precision", "", min, "bar: >= 0.9"),
    Column("ours, recall", "", min, "bar: >= 0.9"),
    Column("best simple (WirelessROS' threshold), precision", "", min),
    Column("best simple (WirelessROS' threshold), recall", "", min),
    Column("events that changed the link", "", min),
    Column("time out of reach", "%", max),
]
PLAIN_LINK = LinkSettings(offered_bps=2e6)
SCENARIOS = {
    "walking, mild shadowing, white fading": None,
    "walking 3 km/h in a street canyon": WALKING_MPS,
    "driving 60 km/h in a street canyon (no bar: the street alone changes the ratio as much)": DRIVING_MPS,
}


def main() -> None:
    options = arguments(__doc__ or "")
    setup = Setup()
    for name, speed in SCENARIOS.items():
        shown = [PLAIN_LINK]
        if speed is not None:
            shown = [street(speed, offered_bps=1e6), street_fading(speed), CellTraffic()]
        print_parameters(f"anomalies, {name} (SIMULATED)", setup, *shown)
        rows = by_seed(partial(one_seed, setup=setup, speed_mps=speed), options)
        print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
