"""The Foxglove bridge measured: ``python benchmarks/foxglove.py [--quick] [--only PART]``.

``server``   our server and that of PyPI ``foxglove-sdk`` (Rust core), each in a process of its own that
             makes the messages itself; the same client, a process that reads bytes from its socket and
             counts. Offered at several rates, in steps of 2 ms, the best rate delivered counts; CPU is
             that of the server's process per MB delivered.
``stalled``  500 kB and a small message, 50 times a second each; the client does not read for some
             seconds, then it does. Memory of the server, and how many small messages came.
``bridge``   all of it: a node that publishes, the Master, ``simple-ros foxglove``, the client.

The servers take turns, so that a noisy moment hits both alike.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import socket
import statistics
import struct
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import psutil

SIZES = {100: (50_000, 100_000, 200_000, 400_000, 0), 10_000: (20_000, 40_000, 80_000, 0)}
LARGE = {500_000: (1_000, 2_000, 4_000, 0)}
STEP_S = 0.002
_BURST = 100
SETTLE_S = 0.5
HANDSHAKE = (
    "GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
)


# -- servers: their processes ------------------------------------------------------------------------


def due_counts(rate: float) -> Iterator[int]:
    """How many messages are due at each step; as many as one may for rate 0."""
    begin, made = time.perf_counter(), 0
    while True:
        if not rate:
            yield _BURST
            continue
        wanted = int((time.perf_counter() - begin) * rate)
        yield wanted - made
        made = wanted


async def serve_ours(sizes: list[int], rates: list[float]) -> None:
    from simple_ros.foxglove import FoxgloveServer, ServerOptions

    server = FoxgloveServer(ServerOptions(), ("time",))
    channels = [server.add_channel(f"/{size}", "x", "") for size in sizes]
    async with server.listening(port=0):
        print(server.port, flush=True)
        counts = [due_counts(rate) for rate in rates]
        while True:
            for channel, size, due in zip(channels, sizes, counts, strict=True):
                # Each message has bytes of its own, as if it came from a socket.
                payloads = [bytes(size) for _ in range(next(due))]
                server.publish(channel.id, time.time_ns(), payloads)
            await asyncio.sleep(STEP_S if all(rates) else 0)


def serve_sdk(sizes: list[int], rates: list[float]) -> None:
    # This file is called like the package that is wanted.
    sys.path = [entry for entry in sys.path if Path(entry) != Path(__file__).parent]
    import foxglove

    server = foxglove.start_server(port=0)
    schema = foxglove.Schema(name="x", encoding="protobuf", data=b"")
    channels = [
        foxglove.Channel(f"/{size}", schema=schema, message_encoding="protobuf") for size in sizes
    ]
    print(server.port, flush=True)
    counts = [due_counts(rate) for rate in rates]
    while True:
        for channel, size, due in zip(channels, sizes, counts, strict=True):
            for _ in range(next(due)):
                channel.log(bytes(size), log_time=time.time_ns())
        time.sleep(STEP_S if all(rates) else 0)


# -- the client: its process -------------------------------------------------------------------------


def masked(opcode: int, payload: bytes) -> bytes:
    head = bytes((0x80 | opcode,))
    if len(payload) < 126:
        return head + bytes((0x80 | len(payload),)) + bytes(4) + payload
    return head + struct.pack(">BH", 0x80 | 126, len(payload)) + bytes(4) + payload


class Client:
    """Subscribes to all channels, then reads."""

    def __init__(self, port: int, wanted: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.sendall(HANDSHAKE.encode())
        self.buffer = bytearray()
        while b"\r\n\r\n" not in self.buffer:
            self.buffer += self.socket.recv(65536)
        del self.buffer[: self.buffer.index(b"\r\n\r\n") + 4]
        self.topics: dict[int, str] = {}
        while len(self.topics) < wanted:
            self.find_channels(next(self.frames()))
        subscriptions = [{"id": each, "channelId": each} for each in self.topics]
        request = json.dumps({"op": "subscribe", "subscriptions": subscriptions})
        self.socket.sendall(masked(1, request.encode()))

    def find_channels(self, frame: bytes) -> None:
        with contextlib.suppress(ValueError):
            document = json.loads(frame)
            if document["op"] == "advertise":
                self.topics |= {
                    channel["id"]: channel["topic"]
                    for channel in document["channels"]
                    if channel["topic"] != "/bridge/stats"
                }

    def frames(self) -> Iterator[bytes]:
        """Every message, slowly; pings are answered."""
        while True:
            frame = self.next_frame()
            while frame is None:
                self.buffer += self.socket.recv(1 << 20)
                frame = self.next_frame()
            opcode, payload = frame
            if opcode == 9:
                self.socket.sendall(masked(10, payload))
            else:
                yield payload

    def next_frame(self) -> tuple[int, bytes] | None:
        if len(self.buffer) < 2:
            return None
        length, begin = self.buffer[1], 2
        if length == 126:
            length, begin = int.from_bytes(self.buffer[2:4]), 4
        elif length == 127:
            length, begin = int.from_bytes(self.buffer[2:10]), 10
        if len(self.buffer) < begin + length:
            return None
        frame = self.buffer[0] & 15, bytes(self.buffer[begin : begin + length])
        del self.buffer[: begin + length]
        return frame


def count_bytes(port: int, seconds: float) -> None:
    client = Client(port, 1)
    view = memoryview(bytearray(1 << 20))
    begin = time.perf_counter() + SETTLE_S
    while time.perf_counter() < begin:
        client.socket.recv_into(view)
    total, begin = 0, time.perf_counter()
    while (now := time.perf_counter()) < begin + seconds:
        total += client.socket.recv_into(view)
    print(json.dumps({"bytes": total, "seconds": now - begin}))


def stall(port: int, seconds: float) -> None:
    client = Client(port, 2)
    for _, _frame in zip(range(40), client.frames(), strict=False):
        pass
    time.sleep(seconds)
    print("reading", flush=True)
    counts: dict[str, int] = defaultdict(int)
    stop = time.monotonic() + 4
    for frame in client.frames():
        if frame[0] == 1:
            counts[client.topics[int.from_bytes(frame[1:5], "little")]] += 1
        elif frame[:1] == b"{" and b"status" in frame[:20]:
            counts["statuses"] += 1
        if time.monotonic() > stop:
            break
    print(json.dumps(counts))


# -- measuring ---------------------------------------------------------------------------------------


def started(*words: Any) -> subprocess.Popen[str]:
    command = [sys.executable, __file__, *map(str, words)]
    # The other server writes a line for each message to a client that has left.
    quiet = subprocess.DEVNULL if "sdk" in words else None
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=quiet, text=True)


def line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


@contextlib.contextmanager
def serving(
    which: str, sizes: list[int], rates: list[float]
) -> Iterator[tuple[int, psutil.Process]]:
    words = [f"{size}:{rate}" for size, rate in zip(sizes, rates, strict=True)]
    process = started("--serve", which, *words)
    try:
        yield int(line(process)), psutil.Process(process.pid)
    finally:
        process.kill()
        process.wait()


def share(size: int) -> float:
    """How much of what travels is the message: the rest is 13 bytes and the WebSocket header."""
    return size / (size + 13 + (2 if size < 113 else 4 if size < 65523 else 10))


def delivered(which: str, size: int, rate: float, clients: int, seconds: float) -> dict[str, float]:
    """MB/s of messages over all clients, and CPU seconds of the server per MB."""
    with serving(which, [size], [rate]) as (port, process):
        readers = [started("--count", port, seconds) for _ in range(clients)]
        time.sleep(SETTLE_S * 2)
        before, begin = sum(process.cpu_times()[:2]), time.perf_counter()
        time.sleep(seconds - SETTLE_S)
        cpu = (sum(process.cpu_times()[:2]) - before) / (time.perf_counter() - begin)
        results = [json.loads(line(reader)) for reader in readers]
        for reader in readers:
            reader.wait()
    rate_mb = sum(item["bytes"] / item["seconds"] for item in results) * share(size) / 1e6
    return {"mb_s": rate_mb, "msg_s": rate_mb * 1e6 / size, "cpu_s_mb": cpu / max(rate_mb, 1e-9)}


def best(
    which: str, size: int, rates: tuple[int, ...], clients: int, args: Any
) -> dict[str, float]:
    found = [
        statistics_of(
            [delivered(which, size, rate, clients, args.seconds) for _ in range(args.runs)]
        )
        for rate in rates
    ]
    return max(found, key=lambda item: item["mb_s"])


def statistics_of(runs: list[dict[str, float]]) -> dict[str, float]:
    return {key: statistics.median(run[key] for run in runs) for key in runs[0]}


def compare_servers(args: Any) -> None:
    print("size      clients  server   MB/s     msg/s    CPU s/GB  ratio")
    for size, rates in (SIZES | LARGE).items():
        for clients in (1, 4):
            ours = best("ours", size, rates, clients, args)
            sdk = best("sdk", size, rates, clients, args)
            ratio = ours["mb_s"] / sdk["mb_s"]
            for name, item in (("ours", ours), ("sdk", sdk)):
                shown = f"{ratio:6.2f}" if name == "ours" else ""
                print(
                    f"{size:<9} {clients:<8} {name:<6} {item['mb_s']:7.1f} {item['msg_s']:10.0f} "
                    f"{item['cpu_s_mb'] * 1000:9.2f} {shown}",
                    flush=True,
                )


def compare_stalled(args: Any) -> None:
    seconds = 3 if args.quick else 12
    for which in ("ours", "sdk"):
        with serving(which, [500_000, 50], [50, 50]) as (port, process):
            before = process.memory_info().rss
            reader = started("--stall", port, seconds)
            line(reader)
            grown = process.memory_info().rss - before
            counts = json.loads(line(reader))
            reader.wait()
        made = round((seconds + 4) * 50)
        print(
            f"{which:<5} stalled for {seconds} s: +{grown / 1e6:.0f} MB; about {made} of each were made, "
            f"{counts.get('/500000', 0)} large and {counts.get('/50', 0)} small ones came, "
            f"{counts.get('statuses', 0)} statuses"
        )


def measure_bridge(args: Any) -> None:
    for size, rates in SIZES.items():
        found = {}
        for rate in rates[:-1]:
            master = started_module("simple_ros_master", "--port", "0")
            address = line(master).rsplit(" ", 1)[1].strip()
            publisher = started("--publish", address, size, rate)
            line(publisher)
            command = ("foxglove", "--port", "0", "--master", address)
            bridge = started_module("simple_ros.cli.main", *command)
            port = int(line(bridge).rsplit(":", 1)[1])
            reader = started("--count", port, args.seconds)
            item = json.loads(line(reader))
            found[rate] = item["bytes"] / item["seconds"] * share(size) / size
            for process in (bridge, publisher, master, reader):
                process.kill()
                process.wait()
        told = ", ".join(f"{value:.0f} of {rate}" for rate, value in found.items())
        print(f"bridge, {size} bytes, one client, msg/s: {told} offered", flush=True)


def started_module(module: str, *words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-u", "-m", module, *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


async def publish(address: str, size: int, rate: float) -> None:
    from simple_ros.msg.std_msgs import ByteMultiArray
    from simple_ros.node import NodeHandle

    payload = ByteMultiArray(data=bytes(size - 4)).SerializeToString()
    async with NodeHandle("bench", master=address) as node:
        publisher = await node.advertise("bench", ByteMultiArray)
        print("ready", flush=True)
        for due in due_counts(rate):
            for _ in range(due):
                publisher.publish_bytes(payload)
            await asyncio.sleep(STEP_S)


def measure(args: Any) -> None:
    try:
        version("foxglove-sdk")
    except PackageNotFoundError:
        sys.exit("the server to compare with is missing: pip install foxglove-sdk")
    if args.quick:
        args.runs, args.seconds = 1, 1.5
    parts = {"server": compare_servers, "stalled": compare_stalled, "bridge": measure_bridge}
    for name, part in parts.items():
        if args.only in (None, name):
            part(args)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="shorter, rougher")
    parser.add_argument("--only", choices=("server", "stalled", "bridge"))
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=3.0)
    for part in ("serve", "count", "stall", "publish"):
        parser.add_argument(f"--{part}", nargs="+", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve:
        which, *words = args.serve
        sizes = [int(word.partition(":")[0]) for word in words]
        rates = [float(word.partition(":")[2]) for word in words]
        if which == "ours":
            asyncio.run(serve_ours(sizes, rates))
        else:
            serve_sdk(sizes, rates)
    elif args.count:
        count_bytes(int(args.count[0]), float(args.count[1]))
    elif args.stall:
        stall(int(args.stall[0]), float(args.stall[1]))
    elif args.publish:
        asyncio.run(publish(args.publish[0], int(args.publish[1]), float(args.publish[2])))
    else:
        measure(args)


if __name__ == "__main__":
    main()
