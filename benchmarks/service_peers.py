"""The programs that are measured by ``services.py``: each is a process that answers calls or makes them.

``python service_peers.py KIND ROLE ...`` with KIND one of

* ``ours``: simple_ros nodes, the asyncio face; ``blocking``: the blocking face
* ``bare``: the plainest asyncio program that does the same: the same protobuf messages, 4-byte length,
  8-byte id, a future a call, one ``transport.write`` a message
* ``zenoh``: a queryable and a querier; ``zmq``: REQ/REP, pipelined with DEALER/ROUTER; ``grpc``: unary
  calls of ``grpc.aio``

The server prints where it is, the client a line of JSON at the end. All of them serialise and parse
``std_srvs.SetBool``. The peer of ROS 1 is ``rospy_peer.py``.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import statistics
import struct
import time
from collections.abc import Awaitable, Callable
from typing import Any

from simple_ros.msg.std_srvs import SetBool, SetBoolRequest, SetBoolResponse

WARM_UP = 300
PERIOD_S = 0.001
PAUSE_S = 3600.0


def answer(request: SetBoolRequest) -> SetBoolResponse:
    return SetBoolResponse(success=request.data, message="done")


def answer_bytes(data: bytes) -> bytes:
    return answer(SetBoolRequest.FromString(data)).SerializeToString()


def check(response: SetBoolResponse) -> None:
    if not response.success:
        raise SystemExit("a wrong answer")


def tell(ready: Any) -> None:
    print(json.dumps({"ready": ready}), flush=True)


def spread(name: str, times: list[float]) -> dict[str, float]:
    kept = sorted(times)
    return {
        f"{name}_p50_us": 1e6 * statistics.median(kept),
        f"{name}_p99_us": 1e6 * kept[int(0.99 * len(kept))],
    }


async def measured(call: Callable[[], Awaitable[Any]], args: argparse.Namespace) -> dict[str, Any]:
    """One after another, at 1 kHz, and ``--window`` at a time."""
    for _ in range(WARM_UP):
        await call()
    clock = time.perf_counter
    times = []
    begun = clock()
    for _ in range(args.count):
        sent = clock()
        await call()
        times.append(clock() - sent)
    report: dict[str, Any] = {"per_second": args.count / (clock() - begun)}
    report |= spread("sequential", times)
    due, times = clock(), []
    for _ in range(args.paced):
        due += PERIOD_S
        await asyncio.sleep(max(0.0, due - clock()))
        sent = clock()
        await call()
        times.append(clock() - sent)
    report |= spread("paced", times)

    async def worker() -> None:
        for _ in range(args.pipelined // args.window):
            await call()

    begun = clock()
    await asyncio.gather(*(worker() for _ in range(args.window)))
    report["pipelined_per_second"] = args.pipelined // args.window * args.window / (clock() - begun)
    return report


def measured_blocking(call: Callable[[], Any], args: argparse.Namespace) -> dict[str, Any]:
    """One after another, and at 1 kHz."""
    for _ in range(WARM_UP):
        call()
    clock = time.perf_counter
    times = []
    begun = clock()
    for _ in range(args.count):
        sent = clock()
        call()
        times.append(clock() - sent)
    report: dict[str, Any] = {"per_second": args.count / (clock() - begun)}
    report |= spread("sequential", times)
    due, times = clock(), []
    for _ in range(args.paced):
        due += PERIOD_S
        time.sleep(max(0.0, due - clock()))
        sent = clock()
        call()
        times.append(clock() - sent)
    return report | spread("paced", times)


# -- ours ------------------------------------------------------------------------------------------


async def our_server(args: argparse.Namespace) -> None:
    from simple_ros.aio import NodeHandle

    async with NodeHandle("server", master=args.master) as node:
        await node.advertise_service("bench", SetBool, answer)
        tell("")
        await node.spin()


async def our_client(args: argparse.Namespace) -> dict[str, Any]:
    from simple_ros.aio import NodeHandle

    async with NodeHandle("client", master=args.master) as node:
        client = node.service_client("bench", SetBool, timeout=5.0)

        async def call() -> None:
            check(await client.call(SetBoolRequest(data=True)))

        return await measured(call, args)


def blocking_server(args: argparse.Namespace) -> None:
    from simple_ros import NodeHandle

    node = NodeHandle("server", master=args.master)
    node.advertise_service("bench", SetBool, answer)
    tell("")
    node.spin()


def blocking_client(args: argparse.Namespace) -> dict[str, Any]:
    from simple_ros import NodeHandle

    node = NodeHandle("client", master=args.master)
    client = node.service_client("bench", SetBool, timeout=5.0)
    report = measured_blocking(lambda: check(client.call(SetBoolRequest(data=True))), args)
    begun = time.perf_counter()
    for _ in range(args.pipelined // args.window):
        futures = [client.call_async(SetBoolRequest(data=True)) for _ in range(args.window)]
        for future in futures:
            check(future.result())
    made = args.pipelined // args.window * args.window
    return report | {"pipelined_per_second": made / (time.perf_counter() - begun)}


# -- bare asyncio ----------------------------------------------------------------------------------

HEAD = struct.Struct(">IQ")


class Bare(asyncio.Protocol):
    """Cuts frames; what is done with each is left to the subclass."""

    def __init__(self) -> None:
        self.buffer = b""

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        buffer = self.buffer + data
        position, end = 0, len(buffer)
        while end - position >= HEAD.size:
            size, number = HEAD.unpack_from(buffer, position)
            if end - position - HEAD.size < size:
                break
            position += HEAD.size
            self.frame(number, buffer[position : position + size])
            position += size
        self.buffer = buffer[position:]

    def send(self, number: int, data: bytes) -> None:
        self.transport.write(HEAD.pack(len(data), number) + data)

    def frame(self, number: int, data: bytes) -> None:
        raise NotImplementedError


class BareServer(Bare):
    def frame(self, number: int, data: bytes) -> None:
        self.send(number, answer_bytes(data))


class BareClient(Bare):
    def __init__(self) -> None:
        super().__init__()
        self.pending: dict[int, asyncio.Future[SetBoolResponse]] = {}
        self.number = 0

    def frame(self, number: int, data: bytes) -> None:
        self.pending.pop(number).set_result(SetBoolResponse.FromString(data))

    async def call(self) -> None:
        self.number += 1
        future = self.pending[self.number] = asyncio.get_running_loop().create_future()
        self.send(self.number, SetBoolRequest(data=True).SerializeToString())
        check(await future)


async def bare_server(args: argparse.Namespace) -> None:
    server = await asyncio.get_running_loop().create_server(BareServer, "127.0.0.1", 0)
    tell(server.sockets[0].getsockname()[1])
    await asyncio.sleep(PAUSE_S)


async def bare_client(args: argparse.Namespace) -> dict[str, Any]:
    loop = asyncio.get_running_loop()
    _, client = await loop.create_connection(BareClient, "127.0.0.1", int(args.at))
    return await measured(client.call, args)


# -- others ----------------------------------------------------------------------------------------


def zenoh_session(args: argparse.Namespace, role: str) -> Any:
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    endpoint = json.dumps([f"tcp/127.0.0.1:{args.at}"])
    config.insert_json5(f"{role}/endpoints", endpoint)
    return zenoh.open(config)


def zenoh_server(args: argparse.Namespace) -> None:
    session = zenoh_session(args, "listen")

    def reply(query: Any) -> None:
        query.reply("bench", answer_bytes(query.payload.to_bytes()))

    session.declare_queryable("bench", reply)
    tell(args.at)
    time.sleep(PAUSE_S)


def zenoh_client(args: argparse.Namespace) -> dict[str, Any]:
    session = zenoh_session(args, "connect")
    querier = session.declare_querier("bench")
    while not querier.matching_status.matching:
        time.sleep(0.01)

    def ask() -> Any:
        return querier.get(payload=SetBoolRequest(data=True).SerializeToString())

    def take(replies: Any) -> None:
        for reply in replies:
            check(SetBoolResponse.FromString(reply.ok.payload.to_bytes()))

    report = measured_blocking(lambda: take(ask()), args)
    begun = time.perf_counter()
    for _ in range(args.pipelined // args.window):
        for replies in [ask() for _ in range(args.window)]:
            take(replies)
    made = args.pipelined // args.window * args.window
    return report | {"pipelined_per_second": made / (time.perf_counter() - begun)}


def zmq_server(args: argparse.Namespace) -> None:
    import zmq

    socket = zmq.Context.instance().socket(zmq.ROUTER)  # serves REQ and DEALER alike
    tell(socket.bind_to_random_port("tcp://127.0.0.1"))
    while True:
        *envelope, data = socket.recv_multipart()
        socket.send_multipart([*envelope, answer_bytes(data)])


def zmq_client(args: argparse.Namespace) -> dict[str, Any]:
    import zmq

    def connected(kind: int) -> Any:
        socket = zmq.Context.instance().socket(kind)
        socket.connect(f"tcp://127.0.0.1:{args.at}")
        return socket

    req, dealer = connected(zmq.REQ), connected(zmq.DEALER)

    def call() -> None:
        req.send(SetBoolRequest(data=True).SerializeToString())
        check(SetBoolResponse.FromString(req.recv()))

    report = measured_blocking(call, args)
    begun = time.perf_counter()
    for number in range(args.pipelined + args.window):
        if number < args.pipelined:
            dealer.send_multipart([b"", SetBoolRequest(data=True).SerializeToString()])
        if number >= args.window:
            check(SetBoolResponse.FromString(dealer.recv_multipart()[-1]))
    return report | {"pipelined_per_second": args.pipelined / (time.perf_counter() - begun)}


async def grpc_server(args: argparse.Namespace) -> None:
    import grpc

    async def handle(request: SetBoolRequest, context: Any) -> SetBoolResponse:
        return answer(request)

    handler = grpc.unary_unary_rpc_method_handler(
        handle, SetBoolRequest.FromString, SetBoolResponse.SerializeToString
    )
    server = grpc.aio.server()
    server.add_generic_rpc_handlers(
        (grpc.method_handlers_generic_handler("Bench", {"Call": handler}),)
    )
    port = server.add_insecure_port("127.0.0.1:0")
    await server.start()
    tell(port)
    await asyncio.sleep(PAUSE_S)


async def grpc_client(args: argparse.Namespace) -> dict[str, Any]:
    import grpc

    async with grpc.aio.insecure_channel(f"127.0.0.1:{args.at}") as channel:
        stub = channel.unary_unary(
            "/Bench/Call", SetBoolRequest.SerializeToString, SetBoolResponse.FromString
        )

        async def call() -> None:
            check(await stub(SetBoolRequest(data=True)))

        return await measured(call, args)


PEERS: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
    "ours": (our_server, our_client),
    "blocking": (blocking_server, blocking_client),
    "bare": (bare_server, bare_client),
    "zenoh": (zenoh_server, zenoh_client),
    "zmq": (zmq_server, zmq_client),
    "grpc": (grpc_server, grpc_client),
}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("kind", choices=PEERS)
    parser.add_argument("role", choices=["server", "client"])
    parser.add_argument("--count", type=int, default=5_000)
    parser.add_argument("--paced", type=int, default=2_000)
    parser.add_argument("--pipelined", type=int, default=50_000)
    parser.add_argument("--window", type=int, default=100)
    parser.add_argument("--master", default="")
    parser.add_argument("--at", default="")
    args = parser.parse_args()
    function = PEERS[args.kind][args.role == "client"]
    made = function(args)
    report = asyncio.run(made) if asyncio.iscoroutine(made) else made
    if report is not None:
        print(json.dumps(report), flush=True)


if __name__ == "__main__":
    main()
