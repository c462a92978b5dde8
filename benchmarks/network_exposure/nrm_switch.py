"""Changing the quality of a topic: by another tunnel, and by a bearer that is set up anew on the mock network.

The network is simulated: how long a bearer takes is a parameter (--setup), printed with the results. What is measured
is from the command to the first message that arrives with the new quality.

python benchmarks/network_exposure/nrm_switch.py        bar: by tunnel < 100 ms
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import math
import statistics
import time
from dataclasses import replace
from itertools import accumulate
from pathlib import Path

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.msg.network_exposure_msgs import TunnelSelect
from simple_ros.msg.std_msgs import String
from simple_ros_engines.network_exposure.exposure.api import ApiClient
from simple_ros_engines.network_exposure.exposure.http import StandardTransport
from simple_ros_engines.network_exposure.exposure.model import (
    Event,
    FiveTuple,
    Notification,
    QosRequest,
    UeIdentity,
)
from simple_ros_engines.network_exposure.exposure.nef import NefBackend
from simple_ros_engines.network_exposure.exposure.receiver import NotificationReceiver
from simple_ros_engines.network_exposure.mock.core import MockSettings
from simple_ros_engines.network_exposure.mock.server import MockServer
from simple_ros_engines.network_exposure.qci import QCI
from simple_ros_engines.network_exposure.relay import FlowRelay
from simple_ros_master import Master

RATE_HZ = 200.0


@contextlib.asynccontextmanager
async def relay(master: Master, name: str, **parameters: object):
    async with NodeHandle(name, master=master.address, arguments=Arguments()) as node:
        await node.set_parameters({f"~{key}": value for key, value in parameters.items()})
        task = asyncio.create_task(FlowRelay().run(node))
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


async def by_tunnel(rounds: int) -> list[float]:
    """Seconds of each switch between two tunnels."""
    times: list[float] = []
    ways: dict[str, float] = {}
    async with (
        Master(host="127.0.0.1", port=0) as master,
        NodeHandle("app", master=master.address, arguments=Arguments()) as node,
        relay(master, "start", roles=["out"], qcis=[8, 84]),
        relay(master, "end", roles=["in"]),
    ):
        publisher = await node.advertise("text_qos_out", String)
        select = await node.advertise("/tunnel_select", TunnelSelect)
        await node.subscribe("text_qos_in", String, lambda message: None)
        for qci in (8, 84):
            await node.subscribe(
                f"text_QCI_{qci}",
                "network_exposure_msgs.Serialized",
                lambda data, qci=qci: ways.__setitem__(str(qci), time.perf_counter()),
                raw=True,
            )
        await select.wait_for_subscribers(2, 10)
        await publisher.wait_for_subscribers(1, 10)
        node.create_timer(1 / RATE_HZ, lambda _: publisher.publish(String(data="x")))
        for number in range(rounds):
            qci = (8, 84)[number % 2]
            begun = time.perf_counter()
            select.publish(TunnelSelect(topic="text", qci=qci))
            while ways.get(str(qci), 0.0) < begun:
                await asyncio.sleep(0.0005)
            times.append(ways[str(qci)] - begun)
    return times


async def by_bearer(rounds: int, setup_s: float) -> list[float]:
    """Seconds of each change of a bearer's class, until the network says that it stands."""
    granted = asyncio.Event()

    def heard(told: Notification) -> None:
        if told.event is Event.GRANTED:
            granted.set()

    receiver = NotificationReceiver()
    await receiver.start()
    times = []
    try:
        async with MockServer(MockSettings(setup_s=setup_s)) as mock:
            backend = NefBackend(ApiClient(mock.url, StandardTransport()), receiver, heard)
            flow = FiveTuple("TCP", "10.0.0.1", 1, "10.0.0.2", 2)
            asked = QosRequest("text", flow, UeIdentity(ip="10.0.0.1"), QCI[84])
            session = await backend.request(asked)
            await granted.wait()
            for number in range(rounds):
                granted.clear()
                begun = time.perf_counter()
                asked = replace(asked, wanted=QCI[(83, 84)[number % 2]])
                await backend.release(session.id)
                session = await backend.request(asked)
                await granted.wait()
                times.append(time.perf_counter() - begun)
    finally:
        await receiver.close()
    return times


def svg(tunnel: list[float], bearer: list[float], setup_s: float) -> str:
    """Cumulative time of the changes, as the paper's figure 19."""
    width, height, left, right, base, top = 680, 330, 50, 540, 270, 40
    most = sum(bearer)
    step = 10.0 ** math.floor(math.log10(most))
    step = next(step * part for part in (0.2, 0.5, 1, 2) if most / (step * part) <= 5)
    parts = [f'<rect width="{width}" height="{height}" fill="#fff"/>']
    title = f"{len(bearer)} changes, one after the other (simulated network, set-up {setup_s:g} s)"
    parts.append(f'<text x="{left}" y="22" font-size="13">{title}</text>')
    for number in range(int(most / step) + 1):
        y = base - (base - top) * number * step / most
        parts.append(f'<path d="M{left} {y:.1f}H{right}" stroke="#d1d9e0"/>')
        label = f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{number * step:g} s</text>'
        parts.append(label)
    for number in range(0, len(bearer) + 1, max(1, len(bearer) // 5)):
        x = left + number * (right - left) / len(bearer)
        parts.append(f'<text x="{x:.1f}" y="{base + 18}" text-anchor="middle">{number}</text>')
    parts.append(
        f'<text x="{(left + right) / 2}" y="{base + 38}" text-anchor="middle">changes</text>'
    )
    for name, times, colour in (("bearer", bearer, "#bc4c00"), ("tunnel", tunnel, "#0969da")):
        sums = list(accumulate(times, initial=0.0))
        points = " ".join(
            f"{left + n * (right - left) / len(times):.1f},{base - (base - top) * total / most:.1f}"
            for n, total in enumerate(sums)
        )
        line = f'<polyline fill="none" stroke="{colour}" stroke-width="2" points="{points}"/>'
        y = base - (base - top) * sums[-1] / most + 4
        told = (
            f'<text x="{right + 8}" y="{y:.0f}" fill="{colour}">by {name}, {sums[-1]:.3g} s</text>'
        )
        parts += [line, told]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="system-ui" font-size="12">'
    return f"{head}{''.join(parts)}</svg>\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument(
        "--setup", type=float, default=2.0, help="seconds a bearer takes on the mock"
    )
    parser.add_argument("--plot", type=Path, help="write an SVG")
    parser.add_argument("--json", type=Path, help="write the numbers")
    options = parser.parse_args()
    tunnel = asyncio.run(by_tunnel(options.rounds))
    bearer = asyncio.run(by_bearer(options.rounds, options.setup))
    print(
        f"simulated network, set-up {options.setup:g} s; messages at {RATE_HZ:g} Hz; bar: tunnel < 100 ms"
    )
    for name, times in (("by tunnel", tunnel), ("by bearer", bearer)):
        print(
            f"{name}: median {1000 * statistics.median(times):.1f} ms, most {1000 * max(times):.1f} ms"
        )
    if options.plot:
        options.plot.write_text(svg(tunnel, bearer, options.setup), "utf-8")
    if options.json:
        numbers = {"setup_s": options.setup, "tunnel_s": tunnel, "bearer_s": bearer}
        options.json.write_text(json.dumps(numbers), "utf-8")


if __name__ == "__main__":
    main()
