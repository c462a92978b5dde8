"""100 devices at 10 Hz through all three engines on one core: from metric to strategy.

Engines, a Master and a listener share one event loop and one process, pinned to one core. SIMULATED
records; the time is that of this computer. `python benchmarks/wireless/chain.py [--seeds 5]`
"""

from __future__ import annotations

import asyncio
import gc
import os
import time
from statistics import quantiles

from common import Column, arguments, print_parameters, print_table

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.engine import Engine
from simple_ros.msg.wireless_ros_msgs import TransmissionStrategy
from simple_ros_engines.cross_domain.node import CrossDomainEngine
from simple_ros_engines.physical_adaptive.node import PhysicalAdaptiveEngine
from simple_ros_engines.radio_information.node import RadioInformationEngine
from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.simulator.link import SimulatedLink
from simple_ros_master import Master

LINKS, PERIOD_S, SECONDS = 100, 0.1, 10


def prepared(seed: int) -> list[list[LinkRecord]]:
    """Records made beforehand: the simulator is not what is measured."""
    import numpy as np

    links = [SimulatedLink(np.random.default_rng([seed, i]), rnti=0x4601 + i) for i in range(LINKS)]
    return [[link.step() for link in links] for _ in range(int(SECONDS / PERIOD_S))]


async def one_seed(seed: int) -> list[float]:
    samples = prepared(seed)
    sent: dict[tuple[str, int], float] = {}
    delays: list[float] = []

    def came(message: TransmissionStrategy) -> None:
        key = (message.link_id, message.header.stamp.ToNanoseconds())
        delays.append(1000 * (time.perf_counter() - sent[key]))

    async with Master(host="127.0.0.1", port=0) as master:
        engines: list[Engine] = [
            RadioInformationEngine(),
            CrossDomainEngine(),
            PhysicalAdaptiveEngine(),
        ]
        nodes = [
            NodeHandle(engine.node_name, master=master.address, arguments=Arguments())
            for engine in engines
        ]
        listener = NodeHandle("listener", master=master.address, arguments=Arguments())
        for node in (*nodes, listener):
            await node.start()
        # The transport source finds nothing on loopback; records come by hand.
        tasks = [
            asyncio.create_task(engine.run(node))
            for engine, node in zip(engines, nodes, strict=True)
        ]
        await listener.subscribe("/wireless_ros/transmission_strategy", TransmissionStrategy, came)
        await asyncio.sleep(2)
        radio = engines[0]
        assert isinstance(radio, RadioInformationEngine)
        # What was made beforehand is no part of the engines' heap.
        gc.collect()
        gc.freeze()
        begun, cpu = asyncio.get_running_loop().time(), time.process_time()
        for index, records in enumerate(samples):
            for at, record in enumerate(records):
                # Devices do not report at the same moment.
                due = begun + PERIOD_S * (index + at / LINKS)
                wait = due - asyncio.get_running_loop().time()
                await asyncio.sleep(max(0.0, wait))
                sent[record.link_id, record.stamp_ns] = time.perf_counter()
                radio.offer(record.link_id, record)
        await asyncio.sleep(0.5)
        used = (time.process_time() - cpu) / SECONDS
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for node in (*nodes, listener):
            await node.close()
    expected = LINKS * len(samples)
    return [
        quantiles(delays, n=100)[98],
        quantiles(delays, n=2)[0],
        max(delays),
        100 * len(delays) / expected,
        100 * used,
    ]


COLUMNS = [
    Column("metric to strategy, p99", "ms", max, "bar: < 50"),
    Column("metric to strategy, median", "ms", max),
    Column("metric to strategy, longest", "ms", max),
    Column("records that led to a strategy", "%", min),
    Column("use of the core", "%", max),
]


def main() -> None:
    options = arguments(__doc__ or "")
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print_parameters("whole chain", links=LINKS, rate_hz=1 / PERIOD_S, seconds=SECONDS)
    rows = [asyncio.run(one_seed(seed)) for seed in range(1, options.seeds + 1)]
    print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
