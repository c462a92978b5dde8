"""Calls of a service: one process answers, the other calls one after another, at 1 kHz and many at a time.

``python -m simple_ros.benchmark.calls KIND ROLE JOB``; `measured` and `measured_blocking` are also for the programs of
other middleware. All of them serialise and parse ``std_srvs.SetBool``.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from collections.abc import Awaitable, Callable
from dataclasses import asdict, dataclass, replace
from struct import Struct
from typing import Any

from simple_ros.benchmark.sink import say

__all__ = ["Calls", "answer_bytes", "check", "measured", "measured_blocking", "run_calls"]

_WARM_UP = 300
_PERIOD_S = 0.001
_HOST = "127.0.0.1"
_LIMIT_S = 5.0


@dataclass(frozen=True, slots=True)
class Calls:
    """How many.

    Attributes:
        count: One after another.
        paced: At 1 kHz.
        pipelined: With ``window`` of them under way at a time.
        window: That.
        master: Where the Master is, for our nodes.
        at: What the server said when it was ready.
    """

    count: int = 3000
    paced: int = 1000
    pipelined: int = 20_000
    window: int = 100
    master: str = ""
    at: str = ""

    def with_server(self, at: str) -> Calls:
        """For the client."""
        return replace(self, at=at)

    def as_json(self) -> str:
        """For `run_calls`, in another process."""
        return json.dumps(asdict(self))


async def measured(call: Callable[[], Awaitable[Any]], calls: Calls) -> dict[str, float]:
    """The three ways, on an event loop."""
    for _ in range(_WARM_UP):
        await call()
    clock = time.perf_counter
    times = []
    begun = clock()
    for _ in range(calls.count):
        sent = clock()
        await call()
        times.append(clock() - sent)
    found = _sequential(times, clock() - begun)
    due, times = clock(), []
    for _ in range(calls.paced):
        due += _PERIOD_S
        await asyncio.sleep(max(0.0, due - clock()))
        sent = clock()
        await call()
        times.append(clock() - sent)

    async def worker() -> None:
        for _ in range(calls.pipelined // calls.window):
            await call()

    begun = clock()
    await asyncio.gather(*(worker() for _ in range(calls.window)))
    made = calls.pipelined // calls.window * calls.window
    return found | _paced(times) | {"pipelined_per_second": made / (clock() - begun)}


def measured_blocking(
    call: Callable[[], Any], calls: Calls, many: Callable[[int], None] | None = None
) -> dict[str, float]:
    """The same from a thread.

    Args:
        call: Makes one.
        calls: How many.
        many: Makes ``window`` calls together; None if that cannot be done.
    """
    for _ in range(_WARM_UP):
        call()
    clock = time.perf_counter
    times = []
    begun = clock()
    for _ in range(calls.count):
        sent = clock()
        call()
        times.append(clock() - sent)
    found = _sequential(times, clock() - begun)
    due, times = clock(), []
    for _ in range(calls.paced):
        due += _PERIOD_S
        time.sleep(max(0.0, due - clock()))
        sent = clock()
        call()
        times.append(clock() - sent)
    found |= _paced(times)
    if many is not None:
        turns = calls.pipelined // calls.window
        begun = clock()
        for _ in range(turns):
            many(calls.window)
        found["pipelined_per_second"] = turns * calls.window / (clock() - begun)
    return found


def _sequential(times: list[float], took_s: float) -> dict[str, float]:
    return {"per_second": len(times) / took_s} | _spread("sequential", times)


def _paced(times: list[float]) -> dict[str, float]:
    return _spread("paced", times)


def _spread(name: str, times: list[float]) -> dict[str, float]:
    kept = sorted(times)
    return {
        f"{name}_p50_us": 1e6 * kept[len(kept) // 2],
        f"{name}_p99_us": 1e6 * kept[int(0.99 * len(kept))],
    }


# -- what is asked and answered --------------------------------------------------------------------


def question() -> Any:
    """A request."""
    from simple_ros.msg.std_srvs_pb2 import SetBoolRequest

    return SetBoolRequest(data=True)


def answer(request: Any) -> Any:
    """The response to a request."""
    from simple_ros.msg.std_srvs_pb2 import SetBoolResponse

    return SetBoolResponse(success=request.data, message="done")


def answer_bytes(data: bytes) -> bytes:
    """The same, serialised."""
    from simple_ros.msg.std_srvs_pb2 import SetBoolRequest

    answered: bytes = answer(SetBoolRequest.FromString(data)).SerializeToString()
    return answered


def check(response: Any) -> None:
    """A response, parsed or not, must be right."""
    if isinstance(response, bytes):
        from simple_ros.msg.std_srvs_pb2 import SetBoolResponse

        response = SetBoolResponse.FromString(response)
    if not response.success:
        raise SystemExit("a wrong answer")


# -- ours ------------------------------------------------------------------------------------------


async def _serve(calls: Calls) -> None:
    from simple_ros.aio import NodeHandle
    from simple_ros.msg.std_srvs import SetBool

    async with NodeHandle("server", master=calls.master) as node:
        await node.advertise_service("bench", SetBool, answer)
        say(ready="")
        await node.spin()


async def _call(calls: Calls) -> dict[str, float]:
    from simple_ros.aio import NodeHandle
    from simple_ros.msg.std_srvs import SetBool

    async with NodeHandle("client", master=calls.master) as node:
        client = node.service_client("bench", SetBool, timeout=_LIMIT_S)

        async def call() -> None:
            check(await client.call(question()))

        return await measured(call, calls)


def _serve_blocking(calls: Calls) -> None:
    from simple_ros import NodeHandle
    from simple_ros.msg.std_srvs import SetBool

    node = NodeHandle("server", master=calls.master)
    node.advertise_service("bench", SetBool, answer)
    say(ready="")
    node.spin()


def _call_blocking(calls: Calls) -> dict[str, float]:
    from simple_ros import NodeHandle
    from simple_ros.msg.std_srvs import SetBool

    node = NodeHandle("client", master=calls.master)
    client = node.service_client("bench", SetBool, timeout=_LIMIT_S)

    def many(count: int) -> None:
        for future in [client.call_async(question()) for _ in range(count)]:
            check(future.result())

    return measured_blocking(lambda: check(client.call(question())), calls, many)


# -- the bare limit --------------------------------------------------------------------------------

_HEAD = Struct(">IQ")


class _Bare(asyncio.Protocol):
    """Cuts frames of length, number and message."""

    transport: Any

    def __init__(self, take: Callable[[_Bare, int, bytes], None]) -> None:
        self._take = take
        self._buffer = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        buffer = self._buffer + data
        position, end = 0, len(buffer)
        while end - position >= _HEAD.size:
            size, number = _HEAD.unpack_from(buffer, position)
            if end - position - _HEAD.size < size:
                break
            position += _HEAD.size
            self._take(self, number, buffer[position : position + size])
            position += size
        self._buffer = buffer[position:]

    def send(self, number: int, data: bytes) -> None:
        self.transport.write(_HEAD.pack(len(data), number) + data)


async def _serve_bare(calls: Calls) -> None:  # noqa: ARG001
    def take(protocol: _Bare, number: int, data: bytes) -> None:
        protocol.send(number, answer_bytes(data))

    loop = asyncio.get_running_loop()
    server = await loop.create_server(lambda: _Bare(take), _HOST, 0)
    say(ready=server.sockets[0].getsockname()[1])
    await asyncio.Event().wait()


async def _call_bare(calls: Calls) -> dict[str, float]:
    pending: dict[int, asyncio.Future[bytes]] = {}
    loop = asyncio.get_running_loop()

    def take(_: _Bare, number: int, data: bytes) -> None:
        pending.pop(number).set_result(data)

    _, bare = await loop.create_connection(lambda: _Bare(take), _HOST, int(calls.at))
    last = 0

    async def call() -> None:
        nonlocal last
        last += 1
        future = pending[last] = loop.create_future()
        bare.send(last, question().SerializeToString())
        check(await future)

    return await measured(call, calls)


def _on_own_loop(work: Callable[[Calls], Any]) -> Callable[[Calls], Any]:
    def run(calls: Calls) -> Any:
        from simple_ros.net.loop import new_loop  # later: rivals load nothing of the library

        with asyncio.Runner(loop_factory=new_loop) as runner:
            return runner.run(work(calls))

    return run


KINDS: dict[str, tuple[Callable[[Calls], Any], Callable[[Calls], Any]]] = {
    "ours": (_on_own_loop(_serve), _on_own_loop(_call)),
    "ours_blocking": (_serve_blocking, _call_blocking),
    "bare": (_serve_bare, _call_bare),
}


def run_calls(
    kinds: dict[str, tuple[Callable[[Calls], Any], Callable[[Calls], Any]]],
    argv: list[str] | None = None,
) -> None:
    """The main function of every program that answers or calls: ``KIND server|client CALLS``."""
    kind, role, text = argv or sys.argv[1:]
    made = kinds[kind][role == "client"](Calls(**json.loads(text)))
    report = asyncio.run(made) if asyncio.iscoroutine(made) else made
    if report is not None:
        say(report=report)


if __name__ == "__main__":
    run_calls(KINDS)
