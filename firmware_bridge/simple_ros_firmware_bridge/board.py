"""One board on one serial port: opened, and kept open."""

from __future__ import annotations

import asyncio
import copy
import logging
from pathlib import Path

from simple_ros.aio import NodeHandle
from simple_ros.diagnostics import ERROR, OK, Status
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.host import AgentHost
from simple_ros_firmware_bridge.judgement import Judgement, LineFacts, Standing, judge_line
from simple_ros_firmware_bridge.memory_file import MemoryFile
from simple_ros_firmware_bridge.serial_agent import SerialAgent
from simple_ros_firmware_bridge.serial_framing import LineCounters
from simple_ros_firmware_bridge.serial_line import SerialLine, find_boards, open_problem

__all__ = ["Board"]

logger = logging.getLogger(__name__)

_RETRY_S = 0.25
_LOOK_S = 1.0
_QUIET_LOOKS = 0.5
_TOLD_AGAIN_S = 60.0
_TOLD_ELSEWHERE = (Standing.CLOSED, Standing.NOT_CONNECTED)


class Board:
    """Runs until it is closed.

    Args:
        node: The node it belongs to.
        config: What is known of it.
        directory: Where sessions are kept; None for nowhere.
    """

    def __init__(self, node: NodeHandle, config: BoardConfig, directory: Path | None) -> None:
        self.config = config
        self.name = config.prefix or config.port or "pico"
        memory = MemoryFile(directory, config.port or "any")
        self._line: SerialLine | None = None
        self.host = AgentHost(
            node, config, self.name, memory, self._send, self._is_open, self._is_backed_up
        )
        self.serial = SerialAgent(self.host.agent)
        self._why_closed = "it was not opened yet"
        self._others: list[str] = []
        self._lost = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._heard_at = self._loop.time()
        self._seen = LineCounters()
        self._vain, self._vain_since = LineCounters(), self._heard_at
        self._told_at: dict[Standing, float] = {}
        self._seen_strangers = 0
        self.judged = self._judge()
        self._tasks = [
            self._loop.create_task(work) for work in (self._keep_open(), self._keep_looking())
        ]

    def _is_open(self) -> bool:
        return self._line is not None

    def _is_backed_up(self) -> bool:
        return self._line is not None and self._line.is_backed_up

    async def _keep_open(self) -> None:
        while True:
            self._open()
            if self._line is not None:
                await self._lost.wait()
            await asyncio.sleep(_RETRY_S)

    def _open(self) -> None:
        path = self.config.port or self._found()
        if not path:
            self._close_because("no Pico was found; name its port by --port")
            return
        self._lost.clear()
        try:
            self._line = SerialLine(path, self.config.baud, self._received, self._line_lost)
        except (OSError, ValueError) as error:
            reason = open_problem(error)
            self._close_because(reason if path == self.name else f"{path}: {reason}")
            return
        self.serial.line_opened()
        self._heard_at = self._loop.time()
        logger.info("board %s: port %s is open", self.name, path)
        self.host.flush()

    def _found(self) -> str:
        first, *others = find_boards() or [""]
        if others and others != self._others:
            names = ", ".join(others)
            logger.warning("there are more boards, each needs a --port of its own: %s", names)
        self._others = others
        return first

    def _line_lost(self, reason: str) -> None:
        self._close_because(reason)
        self._lost.set()

    def _close_because(self, reason: str) -> None:
        if reason != self._why_closed or self._line is not None:
            logger.warning("board %s: %s", self.name, reason)
        self._line = None
        self._why_closed = reason

    def _received(self, data: bytes) -> None:
        now = self._heard_at = self._loop.time()
        self.serial.receive(data, now)
        self.host.worked(now)
        for line in self.serial.reader.take_text():
            logger.info("board %s says: %s", self.name, line)

    def _send(self) -> None:
        data = self.serial.data_to_send()
        if data and self._line is not None:
            self._line.write(data)

    async def _keep_looking(self) -> None:
        while True:
            await asyncio.sleep(_LOOK_S)
            self._look()
            if self._loop.time() - self._heard_at >= _QUIET_LOOKS * _LOOK_S:
                self.host.probe()

    def _look(self) -> None:
        """Judge the line, and say so in the log when it is another kind of judgement than before."""
        judged = self._judge()
        before, self.judged = self.judged, judged
        if judged.standing is before.standing or judged.standing in _TOLD_ELSEWHERE:
            return
        now = self._loop.time()
        if judged.level == OK:
            if before.standing not in _TOLD_ELSEWHERE:
                logger.info("board %s: well again", self.name)
            return
        if now - self._told_at.get(judged.standing, -_TOLD_AGAIN_S) >= _TOLD_AGAIN_S:
            self._told_at[judged.standing] = now
            level = logging.ERROR if judged.level == ERROR else logging.WARNING
            logger.log(level, "board %s: %s", self.name, judged.text)

    def _judge(self) -> Judgement:
        counters = self.serial.reader.counters
        new = LineCounters(
            **{name: value - getattr(self._seen, name) for name, value in vars(counters).items()}
        )
        self._seen = copy.copy(counters)
        now = self._loop.time()
        if new.frames or self._line is None:
            self._vain, self._vain_since = LineCounters(), now
        else:
            self._vain.bytes += new.bytes
            self._vain.text_lines += new.text_lines
        agent = self.host.agent
        strangers = agent.counters.strangers - self._seen_strangers
        self._seen_strangers = agent.counters.strangers
        return judge_line(
            LineFacts(
                is_open=self._line is not None,
                why_closed=self._why_closed,
                has_session=agent.session is not None,
                counters=new,
                vain_bytes=self._vain.bytes,
                vain_lines=self._vain.text_lines,
                vain_s=now - self._vain_since,
                silence_s=now - self._heard_at,
                strangers=strangers,
                baud=self.config.baud,
            )
        )

    def diagnose(self, status: Status) -> None:
        """A task of a `DiagnosticUpdater`: the line, the session, the topics."""
        status.summary(self.judged.level, self.judged.text)
        status.add("port", self.config.port or "any")
        for name, value in vars(self.serial.reader.counters).items():
            status.add(name.replace("_", " "), value)
        status.add("misaddressed frames", self.serial.misaddressed)
        if self._line is not None:
            status.add("bytes dropped since the port took no more", self._line.dropped_bytes)
        self.host.add_values(status)

    async def close(self) -> None:
        """Leave the port; the session is kept for the next start."""
        for task in self._tasks:
            task.cancel()
        if self._line is not None:
            self._line.close()
            self._line = None
        await self.host.close()
