"""What the link shaper carries, and the latency it adds, between real processes.

    python benchmarks/wireless/shaper.py [seconds]

A sender, the shaper and a receiver are three processes on this host. The same traffic goes by plain TCP and
through the shaper, unconstrained and constrained; latency is from publish to callback on one clock.
"""

from __future__ import annotations

import asyncio
import json
import sys
import tempfile
import time
from pathlib import Path

import yaml

from simple_ros import QosProfile, aio
from simple_ros.msg.example import ControlCommand
from simple_ros_engines.link_shaper.transport import ShapedTransport
from simple_ros_master import Master

QOS = QosProfile(depth=2000, max_bytes=64 * 1024 * 1024)
KINDS = {
    "telemetry, 5,000 messages/s of 200 B": (5000, 200),
    "camera, 200 messages/s of 100 kB (20 MB/s)": (200, 100_000),
    "mixed size, 1,000 messages/s of 40 kB (40 MB/s)": (1000, 40_000),
}
OPEN = {"links": {"robot": {}}}
SHAPED = {"links": {"robot": {"up": {"rate_mbps": 1000, "delay_ms": 10, "jitter_ms": 2}}}}


def ways(where: str, site: str) -> tuple[object, ...]:
    return (ShapedTransport(site, where),) if where else ("tcp",)


async def send(master: str, where: str, rate: int, size: int, seconds: float) -> None:
    async with aio.NodeHandle("sender", master=master, transports=ways(where, "robot")) as node:
        publisher = await node.advertise("x", ControlCommand, qos=QOS)
        await publisher.wait_for_subscribers(1, timeout=20)
        filler = "x" * (size - 20)
        loop = asyncio.get_running_loop()
        begun, sent = loop.time(), 0
        while sent < rate * seconds:
            while sent < (loop.time() - begun) * rate:
                publisher.publish(
                    ControlCommand(cmd_id=sent, cmd=f"{time.monotonic_ns():020d}{filler}")
                )
                sent += 1
            await asyncio.sleep(0.001)
        await publisher.flush()
        print(sent, flush=True)
        await asyncio.get_running_loop().create_future()


async def receive(master: str, where: str) -> None:
    ages: list[int] = []
    stamps: list[int] = []

    def take(message: ControlCommand) -> None:
        now = time.monotonic_ns()
        stamps.append(now)
        ages.append(now - int(message.cmd[:20]))

    async with aio.NodeHandle("receiver", master=master, transports=ways(where, "edge")) as node:
        await node.subscribe("x", ControlCommand, take, qos=QOS)
        print("ready", flush=True)
        last = -1
        while len(ages) != last or not ages:
            last = len(ages)
            await asyncio.sleep(0.5)
    ages.sort()
    result = {
        "count": len(ages),
        "p50_ms": ages[len(ages) // 2] / 1e6,
        "p99_ms": ages[int(0.99 * len(ages))] / 1e6,
        "rate": (len(stamps) - 1) / ((stamps[-1] - stamps[0]) / 1e9),
    }
    print(json.dumps(result), flush=True)


async def child(*words: str) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        sys.executable, *words, stdout=asyncio.subprocess.PIPE
    )


async def one(where: str, rate: int, size: int, seconds: float) -> dict[str, float]:
    async with Master(host="127.0.0.1", port=0) as master:
        receiver = await child(__file__, "receive", master.address, where)
        await receiver.stdout.readline()
        sender = await child(
            __file__, "send", master.address, where, str(rate), str(size), str(seconds)
        )
        sent = int(await sender.stdout.readline())
        result = json.loads(await receiver.stdout.readline())
        sender.kill()
        await sender.wait()
        await receiver.wait()
        return result | {"sent": sent}


async def shaper(folder: str, data: dict) -> tuple[asyncio.subprocess.Process, str]:
    file = Path(folder) / "shaper.yaml"
    file.write_text(yaml.safe_dump(data | {"listen": "127.0.0.1:0"}))
    process = await child("-m", "simple_ros.cli.main", "link", "shape", str(file), "--no-node")
    line = (await process.stdout.readline()).decode()
    return process, line.split()[-1]


async def main(seconds: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for label, (rate, size) in KINDS.items():
            print(label)
            for name, data in (
                ("plain TCP", None),
                ("shaper, unconstrained", OPEN),
                ("shaper, 1000 Mbit/s, 10 ms, 2 ms jitter", SHAPED),
            ):
                process, where = (None, "") if data is None else await shaper(folder, data)
                found = await one(where, rate, size, seconds)
                cpu = ""
                if process is not None:
                    ticks = Path(f"/proc/{process.pid}/stat").read_text().split()[13:15]
                    cpu = f", shaper {sum(map(int, ticks)) / 100:.1f} s of processor time"
                    process.terminate()
                    await process.wait()
                print(
                    f"  {name:<42} {found['count']}/{found['sent']} arrived, {found['rate']:.0f}/s, "
                    f"{found['rate'] * size / 1e6:.1f} MB/s, p50 {found['p50_ms']:.2f} ms, "
                    f"p99 {found['p99_ms']:.2f} ms{cpu}",
                    flush=True,
                )


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["send", master, where, rate, size, seconds]:
            aio.run(send(master, where, int(rate), int(size), float(seconds)))
        case ["receive", master, where]:
            aio.run(receive(master, where))
        case [*rest]:
            asyncio.run(main(float(rest[0]) if rest else 5.0))
