"""Quectel modems over their serial port. Never run on hardware."""

from __future__ import annotations

import asyncio
import time
from typing import ClassVar

import serial

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.sources.at_dialog import AtAnswer, AtDialog
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.modem_text import parse_qeng

__all__ = ["QuectelSource"]

_ANSWER_S = 2.0
_SILENCES = 3
_QUESTION = 'AT+QENG="servingcell"'


class QuectelSource(MetricsSource):
    """The serving cell of a modem, asked by AT commands.

    Args:
        port: Its port for AT commands, such as ``/dev/ttyUSB2``.
        baudrate: Of the port; over USB any will do.
        period_s: Between questions.
        link: Key of the link; empty: the last part of the port's name.
    """

    summary: ClassVar[str] = (
        "Quectel modems by AT commands on a serial port (never run on hardware)"
    )

    def __init__(
        self,
        port: str = "/dev/ttyUSB2",
        baudrate: int = 115_200,
        period_s: float = 1.0,
        link: str = "",
    ) -> None:
        if period_s <= 0:
            raise ConfigError(f"period_s is {period_s}, must be more than 0")
        self.period_s = period_s
        self._port = port
        self._baudrate = baudrate
        self._link = link or port.rsplit("/", 1)[-1]

    async def run(self, emit: Emit) -> None:
        """Ask, and give a record of each answer that has one.

        Raises:
            SourceDown: There is no such port, it vanished, or the modem does not answer or refuses.
        """
        try:
            port = serial.Serial(self._port, self._baudrate, timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            raise SourceDown(f"{self._port} cannot be opened: {error}") from error
        line = _Line(port)
        try:
            await line.ask("ATE0")
            await self._ask_on(line, emit)
        except SourceDown:
            raise
        except OSError as error:
            raise SourceDown(f"{self._port} failed: {error}") from error
        finally:
            line.close()

    async def _ask_on(self, line: _Line, emit: Emit) -> None:
        silences = 0
        while True:
            answer = await line.ask(_QUESTION)
            silences = silences + 1 if answer is None else 0
            if silences >= _SILENCES:
                raise SourceDown(f"the modem at {self._port} does not answer")
            if answer is not None:
                self._read(answer, emit)
            await asyncio.sleep(self.period_s)

    def _read(self, answer: AtAnswer, emit: Emit) -> None:
        if answer.refused:
            raise SourceDown(f"the modem at {self._port} says {answer.refused}")
        records = parse_qeng(answer.text, time.time_ns(), self._link)
        if "+QENG:" not in answer.text:
            self.malformed += 1
        # With two radios in use the 5G one comes first; one link has one record.
        for item in records[:1]:
            emit(item)


class _Line:
    """A serial port in the event loop."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self._dialog = AtDialog()
        self._answer: asyncio.Future[AtAnswer] | None = None
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(port.fileno(), self._readable)

    async def ask(self, command: str) -> AtAnswer | None:
        """The answer to a command; None if none comes within 2 s.

        Raises:
            OSError: The port vanished.
        """
        self._answer = self._loop.create_future()
        self._port.write(self._dialog.ask(command))
        try:
            async with asyncio.timeout(_ANSWER_S):
                return await self._answer
        except TimeoutError:
            return None
        finally:
            self._answer = None

    def _readable(self) -> None:
        try:
            answer = self._dialog.receive(self._port.read(4096))
        except OSError as error:
            self._loop.remove_reader(self._port.fileno())
            if self._answer is not None and not self._answer.done():
                self._answer.set_exception(error)
            return
        if answer is not None and self._answer is not None and not self._answer.done():
            self._answer.set_result(answer)

    def close(self) -> None:
        """Close the port."""
        if self._port.is_open:
            self._loop.remove_reader(self._port.fileno())
            self._port.close()
