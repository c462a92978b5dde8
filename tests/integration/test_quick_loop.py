"""The event loop of ``aio.run``: what it promises beyond asyncio's, and what it must not change."""

from __future__ import annotations

import asyncio
import contextvars
import socket
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from support.waiting import until

from simple_ros.net.inbound_stream import InboundStream, take_connection
from simple_ros.net.quick_loop import QuickLoop, add_quick_reader
from simple_ros.net.stream import connected_tcp

Main = Callable[[], Coroutine[Any, Any, None]]


def run(main: Main) -> None:
    with asyncio.Runner(loop_factory=QuickLoop) as runner:
        runner.run(main())


@contextmanager
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.setblocking(False)
        yield ours, theirs


def test_a_quick_reader_is_called_before_what_is_queued() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        with pair() as (ours, theirs):
            order: list[str] = []
            add_quick_reader(loop, ours.fileno(), lambda: order.append(ours.recv(9).decode()))
            theirs.send(b"came")
            loop.call_soon(order.append, "queued")
            await until(lambda: len(order) == 2)
            assert order == ["came", "queued"]
            loop.remove_reader(ours)

    run(main)


def test_it_runs_in_the_context_it_was_added_in() -> None:
    async def main() -> None:
        loop, variable = asyncio.get_running_loop(), contextvars.ContextVar("variable", default=0)
        with pair() as (ours, theirs):
            seen: list[int] = []

            def read() -> None:
                ours.recv(9)
                seen.append(variable.get())
                variable.set(variable.get() + 1)

            variable.set(3)
            add_quick_reader(loop, ours.fileno(), read)
            variable.set(70)
            for number in (1, 2):
                theirs.send(b"x")
                await until(lambda number=number: len(seen) == number)  # type: ignore[misc]
            assert seen == [3, 4]
            loop.remove_reader(ours)

    run(main)


def test_what_a_reader_raises_is_reported_and_the_others_go_on() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        reported: list[dict[str, Any]] = []
        loop.set_exception_handler(lambda _, context: reported.append(context))
        with pair() as (bad, to_bad), pair() as (good, to_good):
            got: list[bytes] = []

            def fail() -> None:
                bad.recv(9)
                raise ValueError("no")

            add_quick_reader(loop, bad.fileno(), fail)
            add_quick_reader(loop, good.fileno(), lambda: got.append(good.recv(9)))
            to_bad.send(b"x")
            to_good.send(b"y")
            await until(lambda: reported and got)
            assert [str(one["exception"]) for one in reported] == ["no"]
            assert got == [b"y"]
            loop.remove_reader(bad)
            loop.remove_reader(good)

    run(main)


@pytest.mark.parametrize("error", [SystemExit, KeyboardInterrupt])
def test_who_wants_to_end_the_program_does(error: type[BaseException]) -> None:
    async def main() -> None:
        with pair() as (ours, theirs):

            def read() -> None:
                ours.recv(9)
                raise error

            add_quick_reader(asyncio.get_running_loop(), ours.fileno(), read)
            theirs.send(b"x")
            await asyncio.Event().wait()

    with pytest.raises(error):
        run(main)


def test_a_reader_that_is_gone_is_called_no_more() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        with pair() as (ours, theirs), pair() as (other, to_other):
            quick: list[bytes] = []
            plain: list[bytes] = []
            add_quick_reader(loop, ours.fileno(), lambda: quick.append(ours.recv(9)))
            theirs.send(b"1")
            await until(lambda: quick == [b"1"])
            # One that is added as ever takes its place.
            loop.add_reader(ours, lambda: plain.append(ours.recv(9)))
            theirs.send(b"2")
            await until(lambda: plain == [b"2"])
            loop.remove_reader(ours)
            # Both are readable in the same turn: the first to be called removes the other.
            hers, his = ours.fileno(), other.fileno()
            called: list[str] = []

            def first(name: str, mine: socket.socket, theirs: int) -> None:
                mine.recv(9)
                called.append(name)
                loop.remove_reader(theirs)

            add_quick_reader(loop, hers, lambda: first("hers", ours, his))
            add_quick_reader(loop, his, lambda: first("his", other, hers))
            theirs.send(b"3")
            to_other.send(b"3")
            await until(lambda: called)
            for _ in range(10):
                await asyncio.sleep(0)
            assert len(called) == 1
            assert quick == [b"1"]
            loop.remove_reader(hers)
            loop.remove_reader(his)

    run(main)


def test_a_descriptor_with_an_old_number_is_a_new_one() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        old, to_old = socket.socketpair()
        called: list[str] = []
        number = old.fileno()
        add_quick_reader(loop, number, lambda: called.append("old"))
        loop.remove_reader(number)
        old.close()
        to_old.close()
        with pair() as (ours, theirs):
            reader, writer = await asyncio.open_connection(sock=ours)
            assert ours.fileno() == number
            theirs.send(b"line\n")
            assert await reader.readline() == b"line\n"
            writer.close()
            await writer.wait_closed()
        assert called == []

    run(main)


def test_reading_goes_on_while_somebody_waits_to_write() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        with pair() as (ours, theirs):
            got: list[bytes] = []
            writable: list[bool] = []

            def write() -> None:
                loop.remove_writer(ours)
                writable.append(True)

            add_quick_reader(loop, ours.fileno(), lambda: got.append(ours.recv(9)))
            theirs.send(b"1")
            loop.add_writer(ours, write)
            await until(lambda: got == [b"1"] and writable)
            theirs.send(b"2")
            await until(lambda: got == [b"1", b"2"])
            loop.remove_reader(ours)

    run(main)


# -- the receiving end of a stream ------------------------------------------------------------------


class Taking(asyncio.BufferedProtocol):
    """Keeps what comes."""

    def __init__(self, size: int = 16) -> None:
        self.room: memoryview | None = None
        self.got = b""
        self.asked = 0
        self.paused = 0
        self.lost: list[Exception | None] = []
        self._buffer = memoryview(bytearray(size))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, InboundStream)
        self.transport = transport

    def get_buffer(self, sizehint: int) -> memoryview:
        self.asked += 1
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        data = bytes(self._buffer[:nbytes])
        if data == b"fail":
            raise ValueError("no")
        self.got += data

    def pause_writing(self) -> None:
        self.paused += 1

    def resume_writing(self) -> None:
        self.paused -= 1

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost.append(exc)


@pytest.fixture(params=[QuickLoop, asyncio.SelectorEventLoop])
def anywhere(request: pytest.FixtureRequest) -> Callable[[Main], None]:
    def run_there(main: Main) -> None:
        with asyncio.Runner(loop_factory=request.param) as runner:
            runner.run(main())

    return run_there


def test_it_reads_into_the_buffer_it_is_given(anywhere: Callable[[Main], None]) -> None:
    async def main() -> None:
        with pair() as (ours, theirs):
            taking = Taking()
            await take_connection(lambda: taking, ours)
            theirs.send(b"0123456789" * 5)
            await until(lambda: len(taking.got) == 50)
            assert taking.got == b"0123456789" * 5
            asked = taking.asked
            taking.room = taking.get_buffer(-1)
            theirs.send(b"more")
            await until(lambda: taking.got.endswith(b"more"))
            assert taking.asked == asked + 1
            theirs.close()
            await until(lambda: taking.lost)
            assert taking.lost == [None]
            assert ours.fileno() == -1

    anywhere(main)


def test_it_rests_when_told_to(anywhere: Callable[[Main], None]) -> None:
    async def main() -> None:
        with pair() as (ours, theirs):
            taking = Taking()
            await take_connection(lambda: taking, ours)
            transport = taking.transport
            assert transport.is_reading()
            transport.pause_reading()
            transport.pause_reading()
            theirs.send(b"later")
            for _ in range(10):
                await asyncio.sleep(0)
            assert taking.got == b""
            assert not transport.is_reading()
            transport.resume_reading()
            transport.resume_reading()
            await until(lambda: taking.got == b"later")
            transport.close()
            transport.resume_reading()
            await until(lambda: taking.lost)

    anywhere(main)


def test_an_answer_that_waits_is_sent_although_the_peer_sends_no_more(
    anywhere: Callable[[Main], None],
) -> None:
    answer = bytes(4_000_000)

    async def main() -> None:
        with pair() as (ours, theirs):
            taking = Taking()
            await take_connection(lambda: taking, ours)
            taking.transport.write(answer)
            assert taking.paused == 1
            theirs.shutdown(socket.SHUT_WR)
            await until(taking.transport.is_closing)
            assert taking.lost == []
            theirs.setblocking(False)
            loop, got = asyncio.get_running_loop(), 0
            while data := await loop.sock_recv(theirs, 1 << 20):
                got += len(data)
            assert got == len(answer)
            await until(lambda: taking.lost)
            assert taking.lost == [None]

    anywhere(main)


def test_a_protocol_that_fails_ends_its_connection_and_no_other(
    anywhere: Callable[[Main], None],
) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        reported: list[dict[str, Any]] = []
        loop.set_exception_handler(lambda _, context: reported.append(context))
        with pair() as (ours, theirs), pair() as (other, to_other):
            failing, taking = Taking(), Taking()
            await take_connection(lambda: failing, ours)
            await take_connection(lambda: taking, other)
            theirs.send(b"fail")
            to_other.send(b"fine")
            await until(lambda: failing.lost and taking.got == b"fine")
            assert [str(error) for error in failing.lost] == ["no"]
            assert [str(one["exception"]) for one in reported] == ["no"]
            assert ours.fileno() == -1
            taking.transport.abort()
            await until(lambda: taking.lost == [None])

    anywhere(main)


def test_only_little_of_a_large_message_is_under_way_inside_this_host(
    anywhere: Callable[[Main], None],
) -> None:
    def under_way(sock: socket.socket) -> int:
        return sock.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)

    async def main() -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            ours = await connected_tcp("127.0.0.1", server.getsockname()[1])
            theirs, _ = server.accept()
            with ours, theirs:
                taking = Taking()
                await take_connection(lambda: taking, ours)
                before = under_way(ours)
                taking.transport.write(b"small")
                assert under_way(ours) == before
                taking.transport.writelines([b"large", bytes(300_000)])
                # The kernel takes twice what it is asked for, or as much as it allows.
                assert under_way(ours) <= 1 << 20
                assert under_way(ours) != before
                assert theirs.recv(10, socket.MSG_WAITALL) == b"smalllarge"
                taking.transport.abort()
                await until(lambda: taking.lost)

    anywhere(main)


def test_a_connection_that_ends_at_once_leaves_nothing_behind(
    anywhere: Callable[[Main], None],
) -> None:
    class Refusing(Taking):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            raise ConnectionResetError("gone already")

    async def main() -> None:
        with pair() as (ours, _):
            refusing = Refusing()
            with pytest.raises(ConnectionResetError):
                await take_connection(lambda: refusing, ours)
            await until(lambda: refusing.lost)
            assert ours.fileno() == -1

    anywhere(main)
