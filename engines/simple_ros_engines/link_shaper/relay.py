"""The shell of the link shaper: connections of real nodes, whose messages the machine delays, drops, hands on."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import time
from pathlib import Path
from typing import Self

from simple_ros.errors import ConfigError
from simple_ros.net.addresses import join_address, split_address
from simple_ros_engines.link_shaper.dscp import code_points
from simple_ros_engines.link_shaper.incoming import Incoming
from simple_ros_engines.link_shaper.transport import TcpListener
from simple_ros_engines.radio_information.sources.record_json import to_json
from simple_ros_engines.simulator.shaper import LinkShaper
from simple_ros_engines.simulator.shaper_policy import policy_shares
from simple_ros_engines.simulator.shaper_settings import ShaperSettings

__all__ = ["Relay"]

logger = logging.getLogger(__name__)

_RECORDS_S = 0.1
_LOOK_S = 0.25


class Relay:
    """Listens, and carries messages between sites.

    Args:
        settings: Links and classes.

    Attributes:
        machine: Decides.

    Raises:
        ConfigError: The settings make no sense.
        OSError: The port is taken.
    """

    def __init__(self, settings: ShaperSettings) -> None:
        self._loop = asyncio.get_running_loop()
        self.machine = LinkShaper(settings, time.monotonic())
        self.incoming: set[Incoming] = set()
        self._held: dict[Incoming, None] = {}
        self._ending: set[Incoming] = set()
        self._watchers: set[Incoming] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._timer_s = math.inf
        self._policy_stamp = 0
        self._knows_code_points = any(item.dscp for item in settings.classes)
        host, port = split_address(settings.listen)
        self._listener = TcpListener(host, port, lambda: Incoming(self))
        self.address = join_address(host, self._listener.port)
        self._tasks = [
            self._loop.create_task(self._tell_records()),
            self._loop.create_task(self._look_around()),
        ]

    # -- moving messages -------------------------------------------------------------------------

    def catch_up(self) -> float:
        """Hand on what has arrived by now; tells the time. Comes before every other call of the machine."""
        # Not the loop's: uvloop's has milliseconds only.
        now_s = time.monotonic()
        touched: dict[Incoming, None] = {}
        for connection, frame in self.machine.advance(now_s):
            incoming: Incoming = connection.handle
            incoming.arrived.append(frame)
            touched[incoming] = None
        for incoming in touched:
            incoming.hand_on()
        return now_s

    def pump(self) -> float:
        """Hand on what has arrived, let in what was held back, and look when to do so again; tells the time."""
        now_s = self.catch_up()
        # What is handed on makes room, and who waits for room is not woken again by an empty machine.
        while self._let_in(now_s):
            now_s = self.catch_up()
        self._ending = {incoming for incoming in self._ending if not incoming.end_if_done()}
        self._schedule()
        return now_s

    def _let_in(self, now_s: float) -> bool:
        """Let in what was held back, as far as there is room; tells whether there was any."""
        is_any = False
        for incoming in list(self._held):
            before = incoming.pending_count
            if incoming.offer_pending(now_s):
                del self._held[incoming]
            elif incoming.pending_count < before:
                # It had its turn.
                del self._held[incoming]
                self._held[incoming] = None
            is_any = is_any or incoming.pending_count < before
        return is_any

    def hold(self, incoming: Incoming) -> None:
        """There is no room for a connection's message."""
        self._held[incoming] = None

    def _schedule(self) -> None:
        due_s = self.machine.next_event_s()
        if due_s == self._timer_s:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer_s = due_s
        if math.isinf(due_s):
            self._timer = None
        else:
            self._timer = self._loop.call_later(max(0.0, due_s - time.monotonic()), self._timed)

    def _timed(self) -> None:
        self._timer, self._timer_s = None, math.inf
        self.pump()

    def forget(self, incoming: Incoming) -> None:
        """A publisher is gone; what is on its way still arrives."""
        self.incoming.discard(incoming)
        self._watchers.discard(incoming)
        if not incoming.end_if_done():
            self._ending.add(incoming)

    # -- besides ---------------------------------------------------------------------------------

    def watch(self, incoming: Incoming) -> None:
        """A connection wants to be told of the links."""
        self._watchers.add(incoming)

    async def _tell_records(self) -> None:
        while True:
            await asyncio.sleep(_RECORDS_S)
            now_s = self.pump()
            if self._watchers:
                records = self.machine.records(time.time_ns(), now_s)
                lines = "".join(to_json(record) + "\n" for record in records).encode()
                for watcher in list(self._watchers):
                    watcher.tell(lines)

    async def _look_around(self) -> None:
        """Look at the slice policy file, and at the code points of connections."""
        while True:
            try:
                self._read_policy()
            except OSError as error:
                logger.warning("%s is not obeyed: %s", self.machine.settings.rrm_policy_file, error)
            if self._knows_code_points:
                try:
                    self._read_code_points()
                except OSError as error:
                    logger.warning("code points (DSCP) are not known here: %s", error)
                    self._knows_code_points = False
            await asyncio.sleep(_LOOK_S)

    def _read_policy(self) -> None:
        name = self.machine.settings.rrm_policy_file
        path = Path(name)
        if not name or not path.exists() or path.stat().st_mtime_ns == self._policy_stamp:
            return
        self._policy_stamp = path.stat().st_mtime_ns
        try:
            shares = policy_shares(json.loads(path.read_text(encoding="utf-8")))
        except (ConfigError, ValueError) as error:
            logger.warning("%s is not obeyed: %s", path, error)
            return
        self.catch_up()
        self.machine.take_shares(shares)
        self.pump()
        logger.info("obeying %s", path)

    def _read_code_points(self) -> None:
        known = code_points()
        for incoming in self.incoming:
            incoming.code_point_is(known.get(incoming.ports, 0))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """End everything."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._listener.close()
        for incoming in [*self.incoming, *self._ending]:
            await incoming.abandon()
        if self._timer is not None:
            self._timer.cancel()
