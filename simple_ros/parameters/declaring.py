"""Tells every Master that comes what a node declares."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence

from simple_ros.errors import HandleClosed
from simple_ros.net.master_client import ForeignMaster, MasterClient
from simple_ros.parameters.calls import ParameterCalls
from simple_ros.parameters.convert import ParameterInfo
from simple_ros.parameters.errors import ParameterConflict, ParameterError
from simple_ros.parameters.own import Own, OwnParameters
from simple_ros.parameters.values import Value
from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["Declarer"]

logger = logging.getLogger(__name__)


class Declarer:
    """Declares parameters to the present Master, and again to the next one.

    Args:
        node: Full name of the node.
        own: What it declared; a declaration that was granted is added.
        node_info: Describes the node.
        changed: Called with parameters that have another value now.
    """

    def __init__(
        self,
        node: str,
        own: OwnParameters,
        node_info: Callable[[], ros.NodeInfo],
        changed: Callable[[Sequence[Own]], None],
    ) -> None:
        self._node = node
        self._own = own
        self._node_info = node_info
        self._changed = changed
        self._wishes: dict[str, tuple[Own, asyncio.Future[None]]] = {}
        self._early: dict[str, tuple[Value, int]] = {}
        self._wake = asyncio.Event()
        self._master_id = ""
        self._closed = False

    async def wish(self, own: Own) -> None:
        """Declare a parameter; returns when a Master has granted it.

        Raises:
            ParameterError: The Master says no.
            HandleClosed: The node is closed.
        """
        if self._closed:
            raise HandleClosed(f"node {self._node!r}")
        if own.name in self._wishes:
            raise ParameterConflict(own.name, "is just being declared")
        future = asyncio.get_running_loop().create_future()
        self._wishes[own.name] = (own, future)
        self._wake.set()
        try:
            await future
        finally:
            self._wishes.pop(own.name, None)
            self._early.pop(own.name, None)

    async def session(self, client: MasterClient, master_id: str) -> None:
        """Tell a Master of ours what was declared and is declared, until cancelled."""
        is_other = master_id != self._master_id
        self._master_id = master_id
        self._own.new_master()
        calls = ParameterCalls(client)
        try:
            await self._repeat(calls, other_master=is_other)
            while True:
                self._wake.clear()
                for own, future in list(self._wishes.values()):
                    await self._grant(calls, own, future)
                if not self._wake.is_set():
                    await self._wake.wait()
        except ForeignMaster:
            # An older Master of ours; it goes on without.
            await self.session_alone()

    async def session_alone(self) -> None:
        """Keep what is declared here only, with a Master that knows no parameters."""
        while True:
            self._wake.clear()
            for own, future in list(self._wishes.values()):
                if not future.done():
                    self._own.add(own)
                    future.set_result(None)
            await self._wake.wait()

    async def _repeat(self, calls: ParameterCalls, *, other_master: bool) -> None:
        """Declare again to a Master that may not know; one that is refused hurts no other."""
        again = [own.repetition(other_master=other_master) for own in self._own]
        if not again:
            return
        try:
            self._settle(*await calls.declare(self._node_info(), again))
        except ParameterError:
            for declaration in again:
                try:
                    self._settle(*await calls.declare(self._node_info(), [declaration]))
                except ParameterError as error:
                    logger.error("not declared again, this node keeps its value: %s", error)  # noqa: TRY400

    async def _grant(self, calls: ParameterCalls, own: Own, future: asyncio.Future[None]) -> None:
        try:
            infos, revision = await calls.declare(self._node_info(), [own.declaration()])
        except ParameterError as error:
            if not future.done():
                future.set_exception(error)
            return
        if not future.done():
            self._own.add(own)
            self._settle(infos, revision)
            if own.name in self._early:
                value, revision = self._early[own.name]
                self._own.apply({own.name: value}, revision)
            future.set_result(None)

    def _settle(self, infos: Sequence[ParameterInfo], revision: int) -> None:
        for info in infos:
            self._changed(self._own.settle(info.name, info.value, info.origin, revision))

    def note_early(self, values: Mapping[str, Value], revision: int) -> None:
        """Values are set, perhaps of a parameter whose declaration is not answered yet."""
        for name in self._wishes.keys() & values.keys():
            self._early[name] = values[name], revision

    def abandon(self) -> None:
        """End all at once, telling nobody."""
        self._closed = True
        for _, future in self._wishes.values():
            if not future.done():
                future.set_exception(HandleClosed(f"node {self._node!r}"))
