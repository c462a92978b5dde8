"""How long one decision of the QoS mapper takes while many flows are active.

python benchmarks/network_exposure/mapper.py            bar: < 1 ms with 1,000 flows
"""

from __future__ import annotations

import argparse
import random
import statistics
import time

from simple_ros.msg.network_exposure_msgs import (
    Locator,
    UniqueTopicFlow,
    UniqueTopicFlows,
    UniqueTopicFlowStat,
    UniqueTopicFlowStats,
)
from simple_ros_engines.network_exposure.exposure.model import Session
from simple_ros_engines.network_exposure.flow_session import Action
from simple_ros_engines.network_exposure.requirement import FlowMapper, FlowProfile
from simple_ros_engines.network_exposure.statistics import Traffic
from simple_ros_engines.network_exposure.watcher_core import WatcherCore

RATES_HZ = (1, 5, 10, 20, 30, 50, 100, 200, 500)


def flows(count: int) -> UniqueTopicFlows:
    return UniqueTopicFlows(
        relay="relay",
        flows=[
            UniqueTopicFlow(
                topic=f"topic{n}",
                source_topic=f"topic{n}_qos",
                is_reliable=n % 2 == 0,
                source=Locator(kind=Locator.TCPV4, address="10.0.0.1", port=1000 + n),
                destination=Locator(kind=Locator.TCPV4, address="10.0.0.2", port=7),
            )
            for n in range(count)
        ],
    )


def stats(count: int, round_number: int, chance: random.Random) -> UniqueTopicFlowStats:
    found = []
    for n in range(count):
        rate_hz = RATES_HZ[n % len(RATES_HZ)] * chance.uniform(0.95, 1.05)
        size = chance.choice((100, 1200, 100_000))
        found.append(
            UniqueTopicFlowStat(
                topic=f"topic{n}",
                num_messages=round_number,
                window_duration_s=5,
                window_rate=rate_hz,
                window_bandwidth=rate_hz * size,
                window_burst=size,
            )
        )
    return UniqueTopicFlowStats(relay="relay", stats=found)


def one_decision(rounds: int, chance: random.Random) -> list[float]:
    """Milliseconds of each decision."""
    times = []
    mapper = FlowMapper()
    for number in range(rounds):
        rate_hz = chance.choice(RATES_HZ)
        size = chance.choice((100, 1200, 100_000))
        seen = Traffic(5.0, 50, 50 * size, rate_hz, rate_hz * size, 1 / rate_hz, 0.0)
        begun = time.perf_counter()
        mapper.look(seen, size, FlowProfile(), 2.0 * number)
        times.append(1000 * (time.perf_counter() - begun))
    return times[2:]


def whole_watcher(count: int, rounds: int, chance: random.Random) -> list[float]:
    """Milliseconds for statistics of all flows and what follows from them, by flow."""
    core = WatcherCore()
    core.flows_came(flows(count), 0.0)
    times = []
    for number in range(rounds):
        message, now_s = stats(count, number, chance), 2.0 * number
        begun = time.perf_counter()
        core.stats_came(message, now_s)
        due = core.look(now_s)
        times.append(1000 * (time.perf_counter() - begun) / count)
        for item in due:
            is_asked = item.command.action in (Action.REQUEST, Action.UPDATE)
            core.done(item.key, now_s, Session(str(item.key)) if is_asked else None)
    return times[2:]


def told(what: str, times: list[float]) -> None:
    times = sorted(times)
    p99 = times[int(0.99 * (len(times) - 1))]
    print(
        f"{what}: median {statistics.median(times):.4f} ms, p99 {p99:.4f} ms, most {times[-1]:.4f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flows", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    print(
        f"flows {options.flows}, rounds {options.rounds}, seed {options.seed}; bar: < 1 ms a decision"
    )
    told("one decision", one_decision(options.rounds * options.flows, chance))
    told("watcher, a flow", whole_watcher(options.flows, options.rounds, chance))


if __name__ == "__main__":
    main()
