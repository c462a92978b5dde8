"""Parameters of the Master, for clients."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable, Mapping
from typing import Any

import grpc

from simple_ros.errors import MasterUnavailable, SimpleRosError
from simple_ros.foxglove import frames
from simple_ros.foxglove.access import Access
from simple_ros.foxglove.client import Client
from simple_ros.foxglove.errors import one_line
from simple_ros.foxglove.events import ParametersSet, ParametersWanted
from simple_ros.foxglove.parameter_values import from_protocol, to_protocol
from simple_ros.foxglove.server import FoxgloveServer
from simple_ros.names import canonical, parameter_name
from simple_ros.net.master_client import ForeignMaster
from simple_ros.node import NodeHandle
from simple_ros.parameters.calls import ParameterCalls
from simple_ros.parameters.errors import UnknownParameter
from simple_ros.parameters.feed import ParameterChanged
from simple_ros.parameters.values import Value
from simple_ros.parameters.watching import ParameterWatch

__all__ = ["ParameterDesk"]

logger = logging.getLogger(__name__)


class ParameterDesk:
    """Answers what clients ask about parameters, one request of a client after the other.

    Args:
        node: Whose Master is asked.
        server: Whose clients are told of changes.
        access: Which are shown, and whether they may be set.
    """

    def __init__(self, node: NodeHandle, server: FoxgloveServer, access: Access) -> None:
        self._node = node
        self._server = server
        self._access = access
        self._watch: ParameterWatch | None = None
        self._last: dict[Client, asyncio.Task[None]] = {}

    async def follow(self) -> None:
        """Tell clients of changes from now on; returns when the Master has told what there is."""
        try:
            self._watch = await self._node.watch_parameters("", self._changed)
        except ForeignMaster as error:
            logger.info("no parameters: %s", error)

    def _changed(self, change: ParameterChanged) -> None:
        if not self._access.parameters.wants(change.name):
            return
        frame = frames.parameter_values([to_protocol(change.name, change.value)])
        self._server.say_if(lambda session: session.wants_parameter(change.name), frame)

    def take(self, client: Client, request: ParametersWanted | ParametersSet) -> None:
        """A client asks for parameters, or sets some."""
        before = self._last.get(client)
        task = asyncio.get_running_loop().create_task(self._take(client, request, before))
        self._last[client] = task
        task.add_done_callback(lambda done: self._forget(client, done))

    def _forget(self, client: Client, task: asyncio.Task[None]) -> None:
        if self._last.get(client) is task:
            del self._last[client]

    async def _take(
        self,
        client: Client,
        request: ParametersWanted | ParametersSet,
        before: asyncio.Task[None] | None,
    ) -> None:
        if before is not None:
            await asyncio.wait([before])
        if isinstance(request, ParametersSet):
            names = [str(given["name"]) for given in request.parameters]
            await self._set(client, request.parameters)
            if request.id is None:
                return
            values = await self._values(client, names)
        else:
            values = await self._values(client, request.names or None)
        told = [to_protocol(name, value) for name, value in values.items()]
        client.session.say(frames.parameter_values(told, request.id))
        client.process()

    async def _values(self, client: Client, names: Iterable[str] | None) -> dict[str, Value]:
        """Values of the parameters of these names that there are; of all for None."""
        asked = self._node.client
        calls = ParameterCalls(asked)
        names = None if names is None else list(names)
        try:
            if names is None:
                wants = self._access.parameters.wants
                described = await calls.describe("")
                return {item.name: item.value for item in described if wants(item.name)}
            found: dict[str, Value] = {}
            for name in names:
                found |= await self._value(calls, canonical(name))
            return found
        except ForeignMaster:
            # Apps ask every 15 s: that a C++ Master keeps no parameters is no error each time.
            return {}
        except (SimpleRosError, grpc.aio.AioRpcError) as error:
            if isinstance(error, MasterUnavailable) and self._node.client is not asked:
                # The node dials anew when it learns of what kind its Master is.
                return await self._values(client, names)
            self._complain(client, f"Parameters cannot be read: {one_line(error)}")
            return {}

    async def _value(self, calls: ParameterCalls, name: str) -> dict[str, Value]:
        if not self._access.parameters.wants(name):
            return {}
        try:
            return await calls.get(name)
        except UnknownParameter:
            return {}

    async def _set(self, client: Client, parameters: tuple[Mapping[str, Any], ...]) -> None:
        """Set parameters one after the other."""
        unchanged = []
        for given in parameters:
            try:
                changed = await self._set_one(given)
            except (SimpleRosError, TypeError, grpc.aio.AioRpcError) as error:
                self._complain(client, f"Parameter {given['name']} is not set: {one_line(error)}")
                changed = False
            if not changed:
                unchanged.append(str(given["name"]))
        # Apps show what they have set until they are told: the watch tells only what is different.
        for name, value in (await self._values(client, unchanged)).items():
            self._changed(ParameterChanged(name, value, None))

    async def _set_one(self, given: Mapping[str, Any]) -> bool:
        """Set or delete a parameter; whether it is different now."""
        if self._access.read_only:
            raise ReadOnlyBridge
        calls = ParameterCalls(self._node.client)
        name = parameter_name(given["name"])
        if not self._access.parameters.wants(name):
            raise UnknownParameter(name, "it is not shown here")
        if given.get("value") is None:
            await calls.delete(name)
            return True
        present = (await self._value(calls, name)).get(name)
        values, _ = await calls.set({name: from_protocol(given, present)})
        return repr(values.get(name)) != repr(present)

    @staticmethod
    def _complain(client: Client, message: str) -> None:
        client.session.complain(message)
        client.process()

    async def end(self) -> None:
        """Answer nothing more."""
        tasks = list(self._last.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if self._watch is not None:
            await self._watch.close()


class ReadOnlyBridge(SimpleRosError, PermissionError):
    """Nothing may be changed by clients."""

    def __init__(self) -> None:
        super().__init__("this server is read-only")
