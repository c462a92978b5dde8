"""Boards over UDP and TCP, and that a restart of the bridge does not touch them."""

from __future__ import annotations

import asyncio
import contextlib
import random
import socket
import struct
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Protocol

import pytest
from support.pico_net import NetBoard, tcp_board, udp_board
from support.waiting import until

from simple_ros import aio
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.std_msgs import Float64
from simple_ros_firmware_bridge import net_boards
from simple_ros_firmware_bridge.bridge import PicoBridge
from simple_ros_firmware_bridge.memory_file import MemoryBook
from simple_ros_firmware_bridge.simulator.client import Stage
from simple_ros_master import Master


class BoardMaker(Protocol):
    def __call__(
        self, port: int, key: bytes = ..., *, gives_up: bool = ...
    ) -> AbstractAsyncContextManager[NetBoard]: ...


BOARDS = pytest.mark.parametrize("made", [udp_board, tcp_board])


def ports(made: BoardMaker, port: int) -> dict[str, int]:
    return {"udp_port" if made is udp_board else "tcp_port": port}


@asynccontextmanager
async def bridged(
    master: Master, made: BoardMaker, port: int = 0, state: Path | None = None
) -> AsyncIterator[int]:
    """A bridge that listens for boards; gives the port."""
    async with aio.NodeHandle("pico_bridge", master=master.address) as node:
        async with PicoBridge(node, [], state, **ports(made, port)) as bridge:
            listening = bridge.udp or bridge.tcp
            assert listening is not None
            yield listening.port


@asynccontextmanager
async def looker(master: Master) -> AsyncIterator[tuple[list[float], aio.NodeHandle]]:
    async with aio.NodeHandle("looker", master=master.address) as node:
        seen: list[float] = []
        await node.subscribe("light", Float64, lambda message: seen.append(message.data))
        yield seen, node


def keep_commanding(node: aio.NodeHandle, commands: aio.Publisher[Twist]) -> None:
    command = Twist()
    command.linear.x = 0.25
    node.create_timer(0.02, lambda _: commands.publish(command))


@BOARDS
async def test_topics_both_ways(master: Master, made: BoardMaker) -> None:
    async with bridged(master, made) as port, looker(master) as (seen, node):
        async with made(port) as board:
            await until(lambda: len(seen) > 20, "samples")
            assert seen == sorted(set(seen))
            keep_commanding(node, await node.advertise("cmd_vel", Twist))
            await until(lambda: board.commands, "a command")
            assert struct.unpack_from("<d", board.commands[0]) == (0.25,)


@BOARDS
async def test_a_restart_of_the_bridge_goes_unnoticed(
    master: Master, made: BoardMaker, tmp_path: Path
) -> None:
    async with looker(master) as (seen, node):
        keep_commanding(node, await node.advertise("cmd_vel", Twist))
        async with bridged(master, made, state=tmp_path) as port:
            # It would begin anew if it were told that nobody knows it.
            context = made(port, gives_up=True)
            board = await context.__aenter__()
            await until(lambda: len(seen) > 20, "samples")
        async with bridged(master, made, port, tmp_path):
            count, heard = len(seen), len(board.commands)
            await until(lambda: len(seen) > count + 20, "samples after the restart")
            await until(lambda: len(board.commands) > heard, "commands after the restart")
            assert board.client.counters.resets == 0
            assert board.client.stage is Stage.RUNNING
            await context.__aexit__(None, None, None)


async def test_a_board_that_only_listens_is_found_again(master: Master, tmp_path: Path) -> None:
    """Nothing of it would ever come by itself, so it is asked."""
    async with aio.NodeHandle("looker", master=master.address) as node:
        keep_commanding(node, await node.advertise("cmd_vel", Twist))
        async with bridged(master, udp_board, state=tmp_path) as port:
            context = udp_board(port)
            board = await context.__aenter__()
            await until(lambda: board.client.counters.published > 5, "samples")
        board.client.topics.pop(0)
        board.client.publish = lambda *_: False  # type: ignore[method-assign]
        heard = len(board.commands)
        async with bridged(master, udp_board, port, tmp_path):
            await until(lambda: len(board.commands) > heard, "commands after the restart")
            await context.__aexit__(None, None, None)


async def test_boards_of_one_host_do_not_get_each_other_s_session(
    master: Master, tmp_path: Path
) -> None:
    async with looker(master) as (seen, _):
        async with bridged(master, tcp_board, state=tmp_path) as port:
            contexts = [tcp_board(port, key) for key in (b"one!", b"two!")]
            boards = [await context.__aenter__() for context in contexts]
            for board in boards:
                await until(lambda it=board: it.client.counters.published > 5, "samples")  # type: ignore[misc]
        async with bridged(master, tcp_board, port, tmp_path):
            for context in contexts:
                await context.__aexit__(None, None, None)
            async with tcp_board(port, b"new!") as board:
                count = len(seen)
                await until(lambda: len(seen) > count + 5, "samples of a new board")


@pytest.mark.parametrize("made", [udp_board, tcp_board])
async def test_a_taken_port_is_named(master: Master, made: BoardMaker) -> None:
    kind = socket.SOCK_DGRAM if made is udp_board else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("0.0.0.0", 0))
        if kind is socket.SOCK_STREAM:
            taken.listen()
        number = taken.getsockname()[1]
        with pytest.raises(OSError, match=f"port {number}: Address already in use"):
            async with bridged(master, made, number):
                pass


async def test_garbage_over_tcp_harms_nobody(master: Master) -> None:
    rng = random.Random(20261122)
    async with bridged(master, tcp_board) as port, looker(master) as (seen, _):
        async with tcp_board(port):
            for _ in range(20):
                _, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(rng.randbytes(20_000))
                await writer.drain()
                writer.close()
            count = len(seen)
            await until(lambda: len(seen) > count + 20, "samples of the good board")


@BOARDS
async def test_who_never_begins_a_session_keeps_no_board_away(
    master: Master, made: BoardMaker
) -> None:
    kind = socket.SOCK_DGRAM if made is udp_board else socket.SOCK_STREAM
    with contextlib.ExitStack() as strangers:
        async with bridged(master, made) as port, looker(master) as (seen, _):
            for _ in range(70):
                stranger = strangers.enter_context(socket.socket(socket.AF_INET, kind))
                stranger.connect(("127.0.0.1", port))
                stranger.send(b"\x08\x00nonsense")
                await asyncio.sleep(0)
            async with made(port):
                await until(lambda: len(seen) > 20, "samples")


@BOARDS
async def test_a_board_that_only_listens_is_not_forgotten(
    master: Master, made: BoardMaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(net_boards, "_LOOK_S", 0.1)
    monkeypatch.setattr(net_boards, "_FORGOTTEN_S", 0.5)
    loop = asyncio.get_running_loop()
    async with bridged(master, made) as port, looker(master) as (seen, node):
        async with made(port) as board:
            await until(lambda: len(seen) > 5, "samples")
            board.client.publish = lambda *_: False  # type: ignore[method-assign]
            quiet_since = loop.time()
            await until(lambda: loop.time() > quiet_since + 1.5, "a long silence")
            keep_commanding(node, await node.advertise("cmd_vel", Twist))
            await until(lambda: board.commands, "a command")
            assert board.client.counters.resets == 0


def test_a_book_keeps_the_newest(tmp_path: Path) -> None:
    book = MemoryBook(tmp_path, "udp_1")
    for number in range(70):
        book.page(f"10.0.0.1:{number}").keep({"number": number})
    again = MemoryBook(tmp_path, "udp_1")
    assert len(again.addresses()) == 64
    assert again.page("10.0.0.1:5").load() is None
    again.move("10.0.0.1:69", "10.0.0.1:5")
    assert again.page("10.0.0.1:5").load() == {"number": 69}
    for text in again.addresses():
        again.page(text).keep(None)
    assert MemoryBook(tmp_path, "udp_1").addresses() == []


def test_a_board_at_a_new_port_is_forgotten_at_the_old_one() -> None:
    book = MemoryBook(None, "tcp_1")
    for address in ("10.0.0.1:1", "10.0.0.2:1", "10.0.0.1:2"):
        book.page(address).keep({"key": "01020304"})
    book.page("10.0.0.1:3").keep({"key": "00000000"})
    assert book.addresses() == ["10.0.0.2:1", "10.0.0.1:2", "10.0.0.1:3"]
