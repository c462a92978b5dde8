"""The programs that are measured: each is a process that either sends or receives.

``python peers.py KIND ROLE ...`` with KIND one of

* ``ours``: simple_ros nodes over a Master at ``--master``, by TCP as everybody else;
* ``unix``: the same by Unix sockets, as nodes of one host talk unless told otherwise;
* ``blocking``: the same through the blocking face, callbacks in the thread that spins;
* ``bare``: the plainest asyncio program that does the same work, an `asyncio.Protocol` on each side,
  4-byte length prefix, one ``transport.write`` per message, the same protobuf parse and callback;
* ``tuned``: the same program with coalesced writes and `asyncio.BufferedProtocol`: what asyncio
  allows.

The receiver prints ``ready`` (with its port), then one line of JSON at the end.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import statistics
import struct
import time
from typing import Any

from simple_ros.msg.geometry_msgs import Twist

STAMP = struct.Struct("d")
TRANSPORTS = {"ours": ("tcp",), "blocking": ("tcp",), "unix": ("unix",)}


def message(stamp: float = 0.0) -> Twist:
    """About 50 bytes: five doubles and a time stamp."""
    twist = Twist()
    twist.linear.x, twist.linear.y, twist.linear.z = 1.1, 2.2, 3.3
    twist.angular.x, twist.angular.y = 4.4, 5.5
    twist.angular.z = stamp
    return twist


class Sink:
    """Counts messages, keeps latencies, and knows when it has them all."""

    def __init__(self, count: int, latency: bool) -> None:
        self.count = count
        self.done = asyncio.Event()
        self.received = 0
        self.begun = 0.0
        self.ended = 0.0
        self.latencies: list[float] = []
        self.cpu = 0.0
        self.callback = self.timed if latency else self.counted

    def counted(self, twist: Twist) -> None:
        self.received += 1
        if self.received == 1:
            self.begun, self.cpu = time.perf_counter(), time.process_time()
        elif self.received == self.count:
            self.ended, self.cpu = time.perf_counter(), time.process_time() - self.cpu
            self.done.set()

    def timed(self, twist: Twist) -> None:
        self.latencies.append(time.monotonic() - twist.angular.z)
        self.counted(twist)

    def report(self) -> dict[str, Any]:
        report: dict[str, Any] = {
            "received": self.received,
            "per_second": (self.received - 1) / (self.ended - self.begun),
            "cpu_us": 1e6 * self.cpu / self.received,
        }
        if self.latencies:
            kept = sorted(self.latencies[len(self.latencies) // 10 :])
            report |= {
                "p50_us": 1e6 * statistics.median(kept),
                "p95_us": 1e6 * kept[int(0.95 * len(kept))],
                "p99_us": 1e6 * kept[int(0.99 * len(kept))],
            }
        return report


class BareReceiver(asyncio.Protocol):
    """Length prefix, parse, callback."""

    def __init__(self, sink: Sink) -> None:
        self.callback = sink.callback
        self.buffer = b""

    def data_received(self, data: bytes) -> None:
        buffer = self.buffer + data
        position, end = 0, len(buffer)
        unpack, parse, callback = struct.Struct(">I").unpack_from, Twist.FromString, self.callback
        while end - position >= 4:
            (size,) = unpack(buffer, position)
            if end - position - 4 < size:
                break
            position += 4
            callback(parse(buffer[position : position + size]))
            position += size
        self.buffer = buffer[position:]


class TunedReceiver(asyncio.BufferedProtocol):
    """The same, read in place."""

    def __init__(self, sink: Sink) -> None:
        self.callback = sink.callback
        self.buffer = bytearray(256 * 1024)
        self.view = memoryview(self.buffer)
        self.end = 0

    def get_buffer(self, sizehint: int) -> memoryview:
        return self.view[self.end :]

    def buffer_updated(self, nbytes: int) -> None:
        position, end, view = 0, self.end + nbytes, self.view
        unpack, parse, callback = struct.Struct(">I").unpack_from, Twist.FromString, self.callback
        while end - position >= 4:
            (size,) = unpack(view, position)
            if end - position - 4 < size:
                break
            position += 4
            callback(parse(view[position : position + size]))
            position += size
        rest = end - position
        if position and rest:
            view[:rest] = view[position:end]
        self.end = rest


class BareSender(asyncio.Protocol):
    """One write per message; waits while the transport is full."""

    def __init__(self) -> None:
        self.writable = asyncio.Event()
        self.writable.set()
        self.connected = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: Any) -> None:
        self.transport = transport
        self.connected.set_result(None)

    def pause_writing(self) -> None:
        self.writable.clear()

    def resume_writing(self) -> None:
        self.writable.set()


async def bare_receive(args: argparse.Namespace, sink: Sink) -> None:
    factory = TunedReceiver if args.kind == "tuned" else BareReceiver
    loop = asyncio.get_running_loop()
    server = await loop.create_server(lambda: factory(sink), "127.0.0.1", 0)
    print(json.dumps({"ready": server.sockets[0].getsockname()[1]}), flush=True)
    await sink.done.wait()
    server.close()


async def bare_send(args: argparse.Namespace) -> None:
    loop = asyncio.get_running_loop()
    _, sender = await loop.create_connection(BareSender, "127.0.0.1", args.port)
    pack = struct.Struct(">I").pack
    transport, writable = sender.transport, sender.writable
    batch: list[bytes] = []

    async def put(twist: Twist) -> None:
        data = twist.SerializeToString()
        if args.kind == "bare" or args.rate:
            transport.write(pack(len(data)) + data)
        else:
            batch.append(pack(len(data)) + data)
            if len(batch) < 64:
                return
            transport.write(b"".join(batch))
            batch.clear()
            await asyncio.sleep(0)
        if not writable.is_set():
            await writable.wait()

    await pace(args, put)
    transport.write(b"".join(batch))
    transport.close()
    await asyncio.sleep(0.1)


async def pace(args: argparse.Namespace, put: Any) -> None:
    """Send ``count`` messages, flat out or at ``rate`` per second."""
    twist = message()
    if not args.rate:
        for _ in range(args.count):
            await put(twist)
        return
    loop = asyncio.get_running_loop()
    due = loop.time()
    for _ in range(args.count):
        due += 1 / args.rate
        delay = due - loop.time()
        if delay > 0:
            await asyncio.sleep(delay)
        twist.angular.z = time.monotonic()
        await put(twist)


async def our_receive(args: argparse.Namespace, sink: Sink) -> None:
    from simple_ros.aio import NodeHandle

    async with NodeHandle(
        f"sink{args.index}", master=args.master, transports=TRANSPORTS[args.kind]
    ) as node:
        await node.subscribe("bench", Twist, sink.callback)
        print(json.dumps({"ready": node.port}), flush=True)
        await sink.done.wait()


async def our_send(args: argparse.Namespace) -> None:
    from simple_ros.aio import NodeHandle
    from simple_ros.qos import DEFAULT

    async with NodeHandle("source", master=args.master, transports=TRANSPORTS[args.kind]) as node:
        qos = DEFAULT.replace(overflow="block", depth=1000)
        publisher = await node.advertise("bench", Twist, qos=qos)
        await publisher.wait_for_subscribers(args.subscribers, timeout=10)
        if args.rate:

            async def put(twist: Twist) -> None:
                publisher.publish(twist)

            await pace(args, put)
        else:
            await pace(args, publisher.publish_async)
        await publisher.flush(10)
        await asyncio.sleep(0.2)


def blocking_receive(args: argparse.Namespace, sink: Sink) -> None:
    from simple_ros import NodeHandle, SystemManager
    from simple_ros.qos import DEFAULT

    system = SystemManager.instance()
    system.init(f"sink{args.index}", master=args.master, transports=TRANSPORTS[args.kind])
    NodeHandle().subscribe(
        "bench", Twist, sink.callback, qos=DEFAULT.replace(overflow="block", depth=10_000)
    )
    print(json.dumps({"ready": NodeHandle().port}), flush=True)
    while not sink.done.is_set():
        system.spin_once(1.0)
    system.shutdown()


def blocking_send(args: argparse.Namespace) -> None:
    from simple_ros import NodeHandle, SystemManager
    from simple_ros.qos import DEFAULT

    system = SystemManager.instance()
    system.init("source", master=args.master, transports=TRANSPORTS[args.kind])
    qos = DEFAULT.replace(overflow="block", depth=1000)
    publisher = NodeHandle().advertise("bench", Twist, qos=qos)
    publisher.wait_for_subscribers(args.subscribers, timeout=10)
    twist = message()
    due = time.monotonic()
    for _ in range(args.count):
        if args.rate:
            due += 1 / args.rate
            time.sleep(max(0.0, due - time.monotonic()))
            twist.angular.z = time.monotonic()
        publisher.publish(twist)
    publisher.flush(30)
    time.sleep(0.2)
    system.shutdown()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("kind", choices=[*TRANSPORTS, "bare", "tuned"])
    parser.add_argument("role", choices=["send", "receive"])
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--rate", type=float, default=0.0)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--master", default="")
    parser.add_argument("--index", type=int, default=0)
    parser.add_argument("--subscribers", type=int, default=1)
    args = parser.parse_args()

    if args.kind == "blocking":
        if args.role == "send":
            blocking_send(args)
        else:
            sink = Sink(args.count, bool(args.rate))
            blocking_receive(args, sink)
            print(json.dumps(sink.report()), flush=True)
        return

    async def run() -> None:
        if args.role == "send":
            await (our_send(args) if args.kind in ("ours", "unix") else bare_send(args))
            return
        sink = Sink(args.count, bool(args.rate))
        await (
            our_receive(args, sink) if args.kind in ("ours", "unix") else bare_receive(args, sink)
        )
        print(json.dumps(sink.report()), flush=True)

    asyncio.run(run())


if __name__ == "__main__":
    main()
