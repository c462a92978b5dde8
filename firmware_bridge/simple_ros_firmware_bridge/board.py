"""One board on one serial port: opened, and kept open."""

from __future__ import annotations

import asyncio
import copy
import logging
from pathlib import Path

from simple_ros.aio import NodeHandle
from simple_ros.diagnostics import Status
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.host import AgentHost
from simple_ros_firmware_bridge.judgement import LineFacts, judge_line
from simple_ros_firmware_bridge.memory_file import MemoryFile
from simple_ros_firmware_bridge.serial_agent import SerialAgent
from simple_ros_firmware_bridge.serial_framing import LineCounters
from simple_ros_firmware_bridge.serial_line import SerialLine, find_boards

__all__ = ["Board"]

logger = logging.getLogger(__name__)

_RETRY_S = 0.25


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
            node, config, self.name, memory, self._send, lambda: self._line is not None
        )
        self.serial = SerialAgent(self.host.agent)
        self._why_closed = "it was not opened yet"
        self._lost = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._heard_at = self._loop.time()
        self._seen = LineCounters()
        self._seen_strangers = 0
        self._task = self._loop.create_task(self._keep_open())

    async def _keep_open(self) -> None:
        while True:
            self._open()
            if self._line is not None:
                await self._lost.wait()
            await asyncio.sleep(_RETRY_S)

    def _open(self) -> None:
        path = self.config.port or next(iter(find_boards()), "")
        if not path:
            self._close_because("no Pico was found; name its port by --port")
            return
        self._lost.clear()
        try:
            self._line = SerialLine(path, self.config.baud, self._received, self._line_lost)
        except (OSError, ValueError) as error:
            self._close_because(_without_repetition(error, path))
            return
        self.serial.line_opened()
        self._heard_at = self._loop.time()
        logger.info("board %s: port %s is open", self.name, path)
        self.host.flush()

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

    def diagnose(self, status: Status) -> None:
        """A task of a `DiagnosticUpdater`: the line, the session, the topics."""
        counters = self.serial.reader.counters
        new = LineCounters(
            **{name: value - getattr(self._seen, name) for name, value in vars(counters).items()}
        )
        self._seen = copy.copy(counters)
        agent = self.host.agent
        strangers = agent.counters.strangers - self._seen_strangers
        self._seen_strangers = agent.counters.strangers
        level, text = judge_line(
            LineFacts(
                is_open=self._line is not None,
                why_closed=self._why_closed,
                has_session=agent.session is not None,
                counters=new,
                silence_s=self._loop.time() - self._heard_at,
                strangers=strangers,
                baud=self.config.baud,
            )
        )
        status.summary(level, text)
        status.add("port", self.config.port or "any")
        for name, value in vars(counters).items():
            status.add(name.replace("_", " "), value)
        self.host.add_values(status)

    async def close(self) -> None:
        """Leave the port; the session is kept for the next start."""
        self._task.cancel()
        if self._line is not None:
            self._line.close()
            self._line = None
        await self.host.close()


def _without_repetition(error: Exception, path: str) -> str:
    reason = getattr(error, "strerror", None) or str(error)
    return reason if path in reason else f"{path}: {reason}"
