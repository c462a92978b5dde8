"""What the bridge says, in plain words, when something is wrong with a board or its line."""

from __future__ import annotations

import logging
import os
import random
import termios
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
import serial
from support.waiting import until

from simple_ros import aio
from simple_ros_firmware_bridge import board as board_module
from simple_ros_firmware_bridge import judgement
from simple_ros_firmware_bridge.bridge import PicoBridge
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.serial_line import find_boards
from simple_ros_firmware_bridge.simulator.firmware import Firmware
from simple_ros_firmware_bridge.simulator.pty_board import PtyBoard
from simple_ros_master import Master

RNG = random.Random(20261122)
LONGER_THAN_A_STALL_S = 1.5
"""As `_SILENT_S` where nothing must be called silent only since this process stood still."""


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(board_module, "_LOOK_S", 0.1)
    monkeypatch.setattr(judgement, "_SILENT_S", 0.5)
    monkeypatch.setattr(judgement, "_ENOUGH_S", 0.5)
    caplog.set_level(logging.INFO)


@asynccontextmanager
async def bridge(master: Master, *configs: BoardConfig) -> AsyncIterator[PicoBridge]:
    async with aio.NodeHandle("pico_bridge", master=master.address) as node:
        async with PicoBridge(node, configs) as made:
            yield made


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda data: data.replace(b"\n", b"\r\n"), "PICO_STDIO_ENABLE_CRLF_SUPPORT"),
        (lambda data: RNG.randbytes(len(data)), "is 115200 baud right"),
        (lambda data: b"count is 4 and rising\r\n", "is it micro-ROS"),
        (lambda data: b"", "is it running, and is this its port"),
        (lambda data: data if RNG.random() > 0.1 else data[:-3] + b"xyz", "a bad cable?"),
    ],
)
async def test_what_is_wrong_is_said(
    master: Master,
    caplog: pytest.LogCaptureFixture,
    spoil: Callable[[bytes], bytes],
    words: str,
) -> None:
    async with PtyBoard(Firmware(), spoil_up=spoil) as board:
        async with bridge(master, BoardConfig(board.path)) as made:
            judged = made.boards[0]
            await until(lambda: words in caplog.text and words in judged.judged.text, words)


async def test_silence_is_told_once_and_its_end(
    master: Master, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judgement, "_SILENT_S", LONGER_THAN_A_STALL_S)
    muted = False

    def spoil(data: bytes) -> bytes:
        return b"" if muted else data

    async with PtyBoard(Firmware(), spoil_up=spoil) as board:
        async with bridge(master, BoardConfig(board.path)):
            await until(lambda: "connected" in caplog.text, "a session")
            muted = True
            await until(lambda: "the board is silent" in caplog.text, "that it is silent")
            muted = False
            await until(lambda: "well again" in caplog.text, "that it is back")
    assert caplog.text.count("is silent") == 1


async def test_a_board_that_only_listens_is_not_called_silent(
    master: Master, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judgement, "_SILENT_S", LONGER_THAN_A_STALL_S)
    firmware = Firmware()
    firmware.client.publish = lambda *_: False  # type: ignore[method-assign]
    async with PtyBoard(firmware) as board, bridge(master, BoardConfig(board.path)) as made:
        agent = made.boards[0].host.agent
        await until(lambda: "subscribes rt/cmd_vel" in caplog.text, "a session")
        assert agent.session is not None
        (down,) = agent.session.streams.downlinks
        asked = down.output.counters.heartbeats
        await until(
            lambda: down.output.counters.heartbeats > asked + 20, "questions whether it is there"
        )
        assert "silent" not in caplog.text
        await until(lambda: made.boards[0].judged.text == "connected", "a good judgement")


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("missing", "there is no such port"),
        ("file", "no serial port"),
        (".", "a directory"),
    ],
)
async def test_a_wrong_port(
    master: Master, tmp_path: Path, caplog: pytest.LogCaptureFixture, path: str, words: str
) -> None:
    (tmp_path / "file").touch()
    async with bridge(master, BoardConfig(str(tmp_path / path))):
        await until(lambda: words in caplog.text, words)


async def test_a_speed_that_no_port_has(master: Master, caplog: pytest.LogCaptureFixture) -> None:
    async with PtyBoard(Firmware()) as board:
        async with bridge(master, BoardConfig(board.path, 99_999_999_999)):
            await until(
                lambda: "no such speed as 99999999999 baud" in caplog.text, "that it is wrong"
            )


async def test_a_port_that_goes_while_it_is_opened_is_opened_again(
    master: Master, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = serial.Serial
    errors = [termios.error(5, "Input/output error")]

    def opened(*arguments: object, **options: object) -> serial.Serial:
        if errors:
            raise errors.pop()
        return real(*arguments, **options)

    monkeypatch.setattr(serial, "Serial", opened)
    async with PtyBoard(Firmware()) as board:
        async with bridge(master, BoardConfig(board.path)):
            await until(lambda: "connected" in caplog.text, "a session")
    assert "Input/output error" in caplog.text


async def test_a_port_that_somebody_has(master: Master, caplog: pytest.LogCaptureFixture) -> None:
    async with PtyBoard(Firmware()) as board:
        async with bridge(master, BoardConfig(board.path), BoardConfig(board.path, prefix="b")):
            await until(lambda: "another program has it" in caplog.text, "that it is taken")


def test_picos_are_found_by_their_lasting_names(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    for name in ("usb-Raspberry_Pi_Pico_E661-if00", "usb-FTDI_FT232R_A50285BI-if00-port0"):
        (tmp_path / name).symlink_to(os.ttyname(theirs))
    (tmp_path / "usb-Raspberry_Pi_Pico_GONE-if00").symlink_to("/dev/nowhere")
    assert find_boards(tmp_path) == [str(tmp_path / "usb-Raspberry_Pi_Pico_E661-if00")]
    assert find_boards(tmp_path / "missing") == []
    os.close(ours)
    os.close(theirs)


async def test_boards_keep_their_names_when_they_change_sockets(
    master: Master, tmp_path: Path
) -> None:
    """Two boards are unplugged and put into each other's place: each comes back as itself."""
    by_id, state = tmp_path / "by-id", tmp_path / "state"
    by_id.mkdir()
    links = {name: by_id / f"usb-Raspberry_Pi_Pico_{name}-if00" for name in ("left", "right")}
    boards = {name: Firmware(key=name[:4].encode()) for name in links}
    configs = [BoardConfig(str(link), prefix=name) for name, link in links.items()]
    async with aio.NodeHandle("pico_bridge", master=master.address) as node:
        async with PicoBridge(node, configs, state) as made:
            for order in (("left", "right"), ("right", "left")):
                # Pseudo terminals are numbered as they are opened, like ttyACM0 and ttyACM1.
                first, second = order
                async with (
                    PtyBoard(boards[first], links[first]),
                    PtyBoard(boards[second], links[second]),
                ):
                    for name in order:
                        counters = boards[name].client.counters
                        enough = counters.published + 20
                        await until(lambda c=counters, n=enough: c.published > n, name)  # type: ignore[misc]
                for name in order:
                    boards[name].client.reset(0.0)
            keys = [board.host.agent.session for board in made.boards]
            assert [key and key.identity.key for key in keys] == [b"left", b"righ"]
    assert sorted(path.name.partition("Pico_")[2] for path in state.iterdir()) == [
        "left-if00.json",
        "right-if00.json",
    ]
