"""What the soak does and how it judges: faults by a seed, events they must leave, memory that must stay flat. Pure."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean, median

from simple_ros_hub.journal import Entry

ENGINES = ("radio_info_engine", "cross_domain_engine", "physical_adaptive_engine")
CELLS = ("camera_cell", "lidar_cell", "telemetry_cell", "command_cell")
COMPONENTS = (*ENGINES, *CELLS)

# Each long-lived process is struck in one half of the run only: the other half is one life, long enough to see a
# leak in, while those around it die and come back.
FIRST_HALF = ("radio_info_engine", "physical_adaptive_engine", "camera_cell", "telemetry_cell")

KINDS = {
    # kind: weight in the first half, in the second
    "kill": (8, 8),
    "stop": (6, 6),
    "hub": (3, 0),
    "hub and one more": (2, 0),
    "master": (0, 3),
    "silent": (2, 2),
    "dead zone": (2, 2),
}


@dataclass(frozen=True)
class Fault:
    """One.

    Attributes:
        kind: One of `KINDS`.
        victim: The component, where there is one.
        pause_s: Quiet time after it.
    """

    kind: str
    victim: str
    pause_s: float


def faults(seed: int) -> Iterator[tuple[Fault, Fault]]:
    """For ever: the next fault if it comes in the first half, and if in the second."""
    rng = random.Random(seed)
    second = tuple(name for name in COMPONENTS if name not in FIRST_HALF)
    while True:
        pause_s = rng.uniform(8, 18)
        yield tuple(  # type: ignore[misc]
            Fault(
                rng.choices(list(KINDS), [weights[half] for weights in KINDS.values()])[0],
                rng.choice(victims),
                pause_s,
            )
            for half, victims in enumerate((FIRST_HALF, second))
        )


@dataclass
class Struck:
    """A fault that happened.

    Attributes:
        fault: Which.
        begun_ns: When, since 1970.
        took_s: Until everything was well again; of a source that was silent and of a Master: since it was back.
        shown_s: Until the hub had noticed, where that is looked at.
        lag_s: How late a timer of the measuring program itself was at worst meanwhile: what a busy computer adds.
        wrong: What was not as it must be.
    """

    fault: Fault
    begun_ns: int
    took_s: float = 0.0
    shown_s: float = 0.0
    lag_s: float = 0.0
    wrong: list[str] = field(default_factory=list)


def expected(fault: Fault) -> dict[str, int]:
    """Patterns of the errors a fault must leave in the log, and how often."""
    failed = rf"(Required|Optional) \w+ {fault.victim} failed: "
    match fault.kind:
        case "kill":
            return {failed + r"(killed by SIGKILL|ended);": 1}
        case "stop":
            return {rf"{fault.victim} hangs: silent for": 1, failed + "hung": 1}
        case "hub":
            return {"The hub before this one died": 1}
        case "hub and one more":
            return {"The hub before this one died": 1, failed + ".*ended while there was no hub": 1}
        case "master":
            return {"the Master at .* does not answer": 1}
        case "silent":
            return {"radio_info_engine is degraded: ": 1}
        case _:
            return {}


def levels_expected(fault: Fault) -> int:
    """How often a fault makes the degradation reach ESSENTIAL or worse from below."""
    return 1 if fault.kind == "dead zone" else 0


_CLIMB = re.compile(r"Degradation level (\w+)")
_RANK = {"NORMAL": 0, "REDUCED": 1, "ESSENTIAL": 2, "SAFE": 3}


@dataclass
class EventVerdict:
    """What the event log says.

    Attributes:
        wrong: Faults that are not there exactly once, numbers that are not there exactly once.
        unexplained: Errors that no fault explains.
    """

    wrong: list[str] = field(default_factory=list)
    unexplained: list[str] = field(default_factory=list)


def judge_events(entries: Sequence[Entry], struck: Sequence[Struck]) -> EventVerdict:
    """Whether each fault is in the log exactly once.

    Args:
        entries: The whole log, over all hubs.
        struck: What was done, in order.
    """
    verdict = EventVerdict()
    numbers = Counter(entry.number for entry in entries)
    verdict.wrong += [
        f"event {n} is there {count} times" for n, count in numbers.items() if count > 1
    ]
    if numbers:
        missing = set(range(min(numbers), max(numbers) + 1)) - numbers.keys()
        verdict.wrong += [f"event {number} is missing" for number in sorted(missing)]
    ends = [
        *(item.begun_ns for item in struck[1:]),
        max((e.stamp_ns for e in entries), default=0) + 1,
    ]
    level = 0
    for number, (item, end_ns) in enumerate(zip(struck, ends, strict=False)):
        mine = [entry for entry in entries if item.begun_ns <= entry.stamp_ns < end_ns]
        climbs = 0
        for entry in mine:
            if found := _CLIMB.match(entry.text):
                before, level = level, _RANK[found[1]]
                climbs += before < 2 <= level
        if climbs != levels_expected(item.fault):
            verdict.wrong.append(f"{number} {item.fault}: degraded {climbs} times")
        patterns = expected(item.fault)
        errors = [entry.text for entry in mine if entry.is_error]
        for pattern, times in patterns.items():
            count = sum(re.search(pattern, text) is not None for text in errors)
            if count != times:
                verdict.wrong.append(f"{number} {item.fault}: {count} of {pattern!r}")
        verdict.unexplained += [
            f"{number} {item.fault.kind} {item.fault.victim}: {text}"
            for text in errors
            if not any(re.search(pattern, text) for pattern in patterns)
        ]
    return verdict


@dataclass(frozen=True)
class Sample:
    """What a process takes at a time."""

    at_s: float
    rss_bytes: int
    files: int


@dataclass(frozen=True)
class Life:
    """One run of one process, without its warm-up.

    Attributes:
        name: Of the program.
        minutes: How long.
        slope_mb_h: Of resident memory, by least squares.
        grown: Mean of its last quarter over that of its first, less 1.
        grown_mb: The same difference in MB.
        files: Median number of open files in the first quarter, and in the last.
        mb: Mean memory.
    """

    name: str
    minutes: float
    slope_mb_h: float
    grown: float
    grown_mb: float
    files: tuple[float, float]
    mb: float

    @property
    def is_flat(self) -> bool:
        """Neither 2 % nor 1.5 MB more, and no more than two open files more."""
        return (self.grown < 0.02 or self.grown_mb < 1.5) and self.files[1] <= self.files[0] + 2


def lives(
    samples: Mapping[tuple[str, int], Sequence[Sample]], least_s: float, warm_up_s: float
) -> list[Life]:
    """The lives long enough to judge: at least ``least_s`` after ``warm_up_s``."""
    found = []
    for (name, _), all_of in samples.items():
        taken = [item for item in all_of if item.at_s - all_of[0].at_s >= warm_up_s]
        if len(taken) < 8 or taken[-1].at_s - taken[0].at_s < least_s:
            continue
        quarter = len(taken) // 4
        first, last = taken[:quarter], taken[-quarter:]
        before, after = (fmean(item.rss_bytes for item in part) for part in (first, last))
        found.append(
            Life(
                name,
                (taken[-1].at_s - taken[0].at_s) / 60,
                _slope([(item.at_s / 3600, item.rss_bytes / 1e6) for item in taken]),
                after / before - 1,
                (after - before) / 1e6,
                (median(i.files for i in first), median(i.files for i in last)),
                fmean(item.rss_bytes for item in taken) / 1e6,
            )
        )
    return found


def _slope(points: Sequence[tuple[float, float]]) -> float:
    x_mean, y_mean = fmean(x for x, _ in points), fmean(y for _, y in points)
    spread = sum((x - x_mean) ** 2 for x, _ in points)
    return sum((x - x_mean) * (y - y_mean) for x, y in points) / spread if spread else 0.0
