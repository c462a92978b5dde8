"""Sharing out resource blocks: fairness, floors, and the time for a thousand users.

    python benchmarks/wireless/prb.py [--seeds 20] [--users 1000]

Beside it: what WirelessROS does (by priority, until nothing is left), and shares in proportion to the wishes.
"""

from __future__ import annotations

import argparse
import random
import statistics
import time
from collections.abc import Callable, Sequence

from simple_ros_hub.resources import Request, allocate, jain_index

Shares = Callable[[Sequence[Request], int], list[int]]


def ours(requests: Sequence[Request], total: int) -> list[int]:
    return [grant.granted for grant in allocate(requests, total).grants]


def by_priority(requests: Sequence[Request], total: int) -> list[int]:
    """The rule of WirelessROS."""
    left, shares = total, [0] * len(requests)
    for index in sorted(range(len(requests)), key=lambda i: -requests[i].priority):
        wish = requests[index]
        factor = 1.0 if wish.priority >= 4 else 0.8 if wish.priority >= 2 else 0.5
        least = 5 if wish.priority < 2 else 0
        shares[index] = min(left, max(least, int(wish.wanted * factor)))
        left -= shares[index]
        if left <= 0:
            break
    return shares


def proportional(requests: Sequence[Request], total: int) -> list[int]:
    whole = sum(request.wanted for request in requests)
    factor = min(1.0, total / whole) if whole else 1.0
    return [int(request.wanted * factor) for request in requests]


def judged(name: str, share: Shares, cases: list[tuple[list[Request], int]]) -> None:
    jains, starved, over, unused = [], [], [], []
    for requests, total in cases:
        shares = share(requests, total)
        pairs = list(zip(requests, shares, strict=True))
        jains.append(jain_index(got / wish.wanted for wish, got in pairs if wish.wanted))
        fits = sum(min(wish.floor, wish.wanted) for wish in requests) <= total
        below = sum(got < min(wish.floor, wish.wanted) for wish, got in pairs) if fits else 0
        starved.append(below / len(requests))
        over.append(max(0, sum(shares) - total))
        wanted = min(total, sum(wish.wanted for wish in requests))
        unused.append(1 - sum(shares) / wanted)
    print(
        f"{name:<14} Jain {statistics.median(jains):.3f} (worst {min(jains):.3f})  "
        f"below their floor {statistics.median(starved):.1%} (worst {max(starved):.1%})  "
        f"over the limit by {max(over)}  unused {statistics.median(unused):.1%}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--users", type=int, default=1000)
    options = parser.parse_args()
    print(
        "generator: wishes 1..100 uniform, priority 1..5 uniform, floor 0..5 uniform, load 1.2 to 4"
    )
    for users in (10, options.users):
        cases, times = [], []
        for seed in range(options.seeds):
            rng = random.Random(seed)
            requests = [
                Request(str(i), rng.randint(1, 100), rng.randint(1, 5), rng.randint(0, 5))
                for i in range(users)
            ]
            total = int(sum(wish.wanted for wish in requests) / rng.uniform(1.2, 4))
            cases.append((requests, total))
            begun = time.perf_counter()
            allocate(requests, total)
            times.append(1000 * (time.perf_counter() - begun))
        print(f"\n{users} users, {options.seeds} seeds")
        judged("max-min", ours, cases)
        judged("by priority", by_priority, cases)
        judged("proportional", proportional, cases)
        print(
            f"time: median {statistics.median(times):.2f} ms, worst {max(times):.2f} ms (bar 10 ms)"
        )


if __name__ == "__main__":
    main()
