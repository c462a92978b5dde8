"""Bags measured: ``python benchmarks/bag.py [--runs N]``.

``recorded`` a node publishes flat out, `simple_ros.bag.Recorder` writes what comes; from the first
             message's arrival to the finished file, every message in it
``raw``      a program that only writes the same messages with `mcap.writer.Writer`, the same
             compression and chunk size, nothing received, one flush at the end
``played``   1,000 messages a second from a file, by the command ``simple-ros bag play``; how late each
             comes at a subscriber in another process, beside the earliest of all

Recorded and raw take turns, so that a noisy moment hits both alike.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import harness
from mcap.writer import CompressionType, Writer

from simple_ros.bag import BagWriter, Recorder, SeriesOptions, TopicSelection
from simple_ros.bag.writer import DEFAULT_CHUNK_BYTES
from simple_ros.msg.definitions import definition_of
from simple_ros.msg.std_msgs import ByteMultiArray, Float64
from simple_ros.node import NodeHandle
from simple_ros.qos import DEFAULT

SIZES = {50: 300_000, 1_000: 200_000, 10_000: 40_000}
CACHE_BYTES = 512 * 1024 * 1024
"""Enough for a whole run: a publisher that is faster than the disk must lose nothing here."""
PLAYED = 5_000
PERIOD_NS = 1_000_000
TYPE = ByteMultiArray.DESCRIPTOR.full_name
DEFINITION = definition_of(ByteMultiArray).SerializeToString()


def payload(size: int) -> bytes:
    """A message of about ``size`` bytes, half of them noise, as sensor data compress."""
    data = os.urandom(size // 2) + bytes(size // 2 - 4)
    return ByteMultiArray(data=data).SerializeToString()


def raw(size: int, count: int, path: Path) -> dict[str, Any]:
    data = payload(size)
    begun = time.perf_counter()
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=DEFAULT_CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start()
        schema = writer.register_schema(TYPE, "protobuf", DEFINITION)
        channel = writer.register_channel("bench", "protobuf", schema)
        for number in range(count):
            now = time.time_ns()
            writer.add_message(channel, now, data, now, number)
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
    return report(size, count, time.perf_counter() - begun)


async def recorded(size: int, count: int, path: Path, address: str) -> dict[str, Any]:
    begun = 0.0

    def clock() -> int:
        nonlocal begun
        begun = begun or time.perf_counter()
        return time.time_ns()

    async with NodeHandle("recorder", master=address) as node:
        selection = TopicSelection.made(["bench"])
        recorder = Recorder(
            node, selection, SeriesOptions(path), max_cache_bytes=CACHE_BYTES, clock=clock
        )
        print("ready", flush=True)
        while sum(topic.received + topic.dropped for topic in recorder.topics) < count:
            await asyncio.sleep(0.005)
        summary = await recorder.stop()
        ended = time.perf_counter()
    if summary.messages != count:
        raise SystemExit(f"{summary.messages} of {count} messages recorded: {summary.drops}")
    return report(size, count, ended - begun)


def report(size: int, count: int, seconds: float) -> dict[str, Any]:
    return {"per_second": count / seconds, "mb_per_second": count * size / seconds / 1e6}


async def send(size: int, count: int, address: str) -> None:
    data = payload(size)
    async with NodeHandle("source", master=address) as node:
        qos = DEFAULT.replace(overflow="block", depth=1000)
        publisher = await node.advertise("bench", ByteMultiArray, qos=qos)
        await publisher.wait_for_subscribers(1, timeout=10)
        for _ in range(count):
            await publisher.publish_bytes_async(data)
        await publisher.flush(60)
        await node.spin()


async def watch(count: int, address: str) -> dict[str, Any]:
    late: list[float] = []
    done = asyncio.Event()

    def came(message: Float64) -> None:
        late.append(time.monotonic() - message.data * PERIOD_NS / 1e9)
        if len(late) == count:
            done.set()

    async with NodeHandle("watcher", master=address) as node:
        await node.subscribe("played", Float64, came)
        print("ready", flush=True)
        await done.wait()
    earliest = min(late)
    errors = sorted(1e3 * (one - earliest) for one in late)
    return {
        "p50_ms": statistics.median(errors),
        "p99_ms": errors[int(0.99 * len(errors))],
        "max_ms": errors[-1],
    }


def made_bag(path: Path) -> None:
    definition = definition_of(Float64).SerializeToString()
    with BagWriter(path) as writer:
        schema = writer.add_schema(Float64.DESCRIPTOR.full_name, "protobuf", definition)
        channel = writer.add_channel("played", schema)
        for number in range(PLAYED):
            data = Float64(data=float(number)).SerializeToString()
            writer.add(channel, 10**18 + number * PERIOD_NS, [data])
            if number % 1000 == 0:
                writer.flush()


def peer(role: str, *words: object) -> subprocess.Popen[str]:
    command = [sys.executable, __file__, "--role", role, *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def result_of(process: subprocess.Popen[str]) -> dict[str, Any]:
    output, _ = process.communicate(timeout=harness.LIMIT_S)
    if process.returncode:
        raise SystemExit(f"a peer failed with {process.returncode}")
    found: dict[str, Any] = json.loads(output.splitlines()[-1])
    return found


def one_recording(size: int, count: int, path: Path, address: str) -> dict[str, Any]:
    recorder = peer("recorded", size, count, path, address)
    assert recorder.stdout is not None
    recorder.stdout.readline()
    sender = peer("send", size, count, "-", address)
    try:
        return result_of(recorder)
    finally:
        sender.terminate()
        sender.wait(5)


def one_playback(path: Path, address: str) -> dict[str, Any]:
    watcher = peer("watch", 0, PLAYED, "-", address)
    assert watcher.stdout is not None
    watcher.stdout.readline()
    command = [sys.executable, "-m", "simple_ros.cli.main", "bag", "play", str(path), "-d", "0.5"]
    environment = os.environ | {"SIMPLE_ROS_MASTER": address}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment):
        return result_of(watcher)


def measure(runs: int) -> dict[str, Any]:
    found: dict[str, Any] = {"machine": harness.machine()}
    print(found["machine"])
    with tempfile.TemporaryDirectory() as name, harness.master() as address:
        path = Path(name) / "bench.mcap"
        for size, count in SIZES.items():
            found[str(size)] = compared(size, count, path, address, runs)
        made_bag(path)
        rounds = [one_playback(path, address) for _ in range(runs)]
        found["played"] = {field: harness.median(rounds, field) for field in rounds[0]}
    played = found["played"]
    print(
        f"played at 1 kHz: late by p50 {played['p50_ms']:.2f} ms, p99 {played['p99_ms']:.2f} ms, "
        f"most {played['max_ms']:.2f} ms   bar: p99 < 2 ms"
    )
    return found


def compared(size: int, count: int, path: Path, address: str, runs: int) -> dict[str, Any]:
    rounds: dict[str, list[dict[str, Any]]] = {"recorded": [], "raw": []}
    for _ in range(runs):
        path.unlink(missing_ok=True)
        rounds["recorded"].append(one_recording(size, count, path, address))
        path.unlink(missing_ok=True)
        rounds["raw"].append(result_of(peer("raw", size, count, path)))
        path.unlink(missing_ok=True)
    ratio = harness.paired_ratio(rounds["recorded"], rounds["raw"], "per_second")
    print(f"{size} bytes:")
    for kind, reports in rounds.items():
        rate = harness.median(reports, "per_second")
        print(f"  {kind:<9}{rate:>10,.0f} msg/s  {rate * size / 1e6:7.1f} MB/s")
    least, middle, most = ratio
    print(f"  ratio    {middle:10.2f} ({least:.2f} to {most:.2f})   bar: >= 0.7", flush=True)
    return {"ratio": ratio} | {
        kind: harness.median(reports, "per_second") for kind, reports in rounds.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--role", choices=["raw", "recorded", "send", "watch"])
    parser.add_argument("words", nargs="*", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.role is None:
        found = measure(args.runs)
        if args.json:
            args.json.write_text(json.dumps(found, indent=2) + "\n")
        return
    size, count, path, *rest = args.words
    match args.role:
        case "raw":
            print(json.dumps(raw(int(size), int(count), Path(path))))
        case "recorded":
            # As the command does.
            sys.setswitchinterval(0.001)
            print(json.dumps(asyncio.run(recorded(int(size), int(count), Path(path), *rest))))
        case "send":
            asyncio.run(send(int(size), int(count), *rest))
        case "watch":
            print(json.dumps(asyncio.run(watch(int(count), *rest))))


if __name__ == "__main__":
    main()
