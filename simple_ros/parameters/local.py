"""The parameters of a node: those it declared, kept here, and those of others, asked for.

Thin shell around `OwnParameters`: it asks the Master, answers when new values are offered, and calls the
user's code.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import logging
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any, TypeAlias

import grpc

from simple_ros.callbacks import CallbackGuard
from simple_ros.names import Scope
from simple_ros.net.master_client import ForeignMaster, LeaseStream, MasterClient
from simple_ros.parameters.calls import ParameterCalls
from simple_ros.parameters.convert import ParameterInfo, parameters_from_proto
from simple_ros.parameters.declaring import Declarer
from simple_ros.parameters.errors import ParameterError, ParameterRefused
from simple_ros.parameters.own import Own, OwnParameters
from simple_ros.parameters.tree import Origin, is_within, nested
from simple_ros.parameters.values import Descriptor, Value, checked, described, normalised
from simple_ros.parameters.watching import ParameterWatch, WatchCallback
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import parameters_pb2 as par
from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["NodeParameters", "SetCallback", "verdict"]

logger = logging.getLogger(__name__)

_THINK_S = 1.8
"""A little less than the Master waits, so that it hears why."""

SetCallback: TypeAlias = Callable[[dict[str, Value]], Any]
"""Judges values by name: returns a reason to refuse them, or raises it; anything else accepts."""


def verdict(result: object) -> str:
    """Why a callback refuses, by what it returned; empty if it does not."""
    if isinstance(result, str):
        return result
    return "its callback returned False" if result is False else ""


class NodeParameters:
    """Declares, reads, sets and watches parameters for one node.

    Args:
        scope: What names mean in the node.
        overrides: What the node was told to use, by full name.
        node_info: Describes the node.
        reach: Waits for a Master; raises `ForeignMaster` if it has no parameters.
        client: Gives the present connection to whichever Master.

    Attributes:
        own: What the node declared.
        declarer: Tells every Master that comes.
    """

    def __init__(
        self,
        scope: Scope,
        overrides: Mapping[str, Value],
        node_info: Callable[[], ros.NodeInfo],
        reach: Callable[[], Awaitable[MasterClient]],
        client: Callable[[], MasterClient],
    ) -> None:
        self.own = OwnParameters()
        self._scope = scope
        self._overrides = dict(overrides)
        self._node_info = node_info
        self._reach = reach
        self._client = client
        self._guard = CallbackGuard(f"parameters of {scope.node!r}")
        self._judges: list[tuple[SetCallback, SetCallback]] = []
        self._hooks: dict[str, list[Callable[[Any], Any]]] = {}
        self._watches: set[ParameterWatch] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self.declarer = Declarer(scope.node, self.own, node_info, self._call_hooks)

    def resolve(self, name: str) -> str:
        """The full name of a parameter."""
        return self._scope.resolve(name, "parameter")

    def override(self, name: str) -> Value | None:
        """What the node was told from outside to use for a parameter, if anything."""
        return self._overrides.get(self.resolve(name))

    def _group(self, prefix: str) -> str:
        if prefix in ("", "/"):
            return ""
        return self._scope.node if prefix in ("~", "~/") else self.resolve(prefix)

    # -- declaring -----------------------------------------------------------------------------

    async def declare(self, name: str, default: Any, said: Descriptor) -> Value:
        """Declare a parameter and return its value; see `NodeHandle.declare_parameter`."""
        self._client()  # raises if the node does not run
        full = self.resolve(name)
        value = normalised(full, default)
        descriptor = described(full, value, said)
        value = checked(full, descriptor, value)
        known = self.own.repeated(full, descriptor)
        if known is not None:
            return known.value
        origin = Origin.DEFAULT
        if full in self._overrides:
            value, origin = self._checked_override(full, descriptor), Origin.OVERRIDE
        await self.declarer.wish(Own(full, name, descriptor, value, origin))
        own = self.own[full]
        self._call_hooks([own])
        return own.value

    def _checked_override(self, name: str, descriptor: Descriptor) -> Value:
        try:
            return checked(name, descriptor, self._overrides[name])
        except ParameterError as error:
            reason = f"{error.reason} (so says the command line, launch or a parameter file)"
            raise type(error)(name, reason) from None

    # -- reading -------------------------------------------------------------------------------

    async def get(self, name: str) -> Any:
        """The value of a parameter, or a group as a dict; see `NodeHandle.get_parameter`."""
        full = self.resolve(name)
        if full in self.own:
            return self.own[full].value
        if full in self._overrides:
            return self._overrides[full]
        found = await ParameterCalls(await self._reach()).get(full)
        if full in found:
            return found[full]
        return nested({inside.removeprefix(f"{full}/"): value for inside, value in found.items()})

    async def has(self, name: str) -> bool:
        """Whether there is a parameter or a group of that name."""
        full = self.resolve(name)
        if full in self.own or full in self._overrides:
            return True
        return bool(await ParameterCalls(await self._reach()).list(full))

    async def names(self, prefix: str) -> list[str]:
        """Full names in a group."""
        return list(await ParameterCalls(await self._reach()).list(self._group(prefix)))

    async def describe(self, name: str) -> ParameterInfo:
        """All that is known of a parameter."""
        full = self.resolve(name)
        try:
            calls = ParameterCalls(await self._reach())
        except ForeignMaster:
            if full not in self.own:
                raise
            own = self.own[full]
            nodes = (self._scope.node,)
            return ParameterInfo(full, own.value, own.origin, nodes, own.descriptor, 0)
        found = {info.name: info for info in await calls.describe(full)}
        if full not in found:
            raise ParameterError(full, f"is a group of {len(found)} parameters")
        return found[full]

    async def watch(self, prefix: str, callback: WatchCallback | None) -> ParameterWatch:
        """Follow a group; see `NodeHandle.watch_parameters`."""
        await self._reach()
        watch = ParameterWatch(self._client, self._group(prefix), callback, self._forget)
        self._watches.add(watch)
        try:
            await watch.wait_ready()
        except BaseException:
            watch.abandon()
            raise
        return watch

    def _forget(self, watch: ParameterWatch) -> None:
        self._watches.discard(watch)

    # -- setting -------------------------------------------------------------------------------

    def judge_with(self, callback: SetCallback, *, here: SetCallback | None = None) -> None:
        """Ask a callback about every new value of declared parameters.

        Args:
            callback: Plain or a coroutine function.
            here: The one that `judge_here` asks instead.
        """
        self._judges.append((callback, here or callback))

    def judge_here(self, values: Mapping[str, Value]) -> None:
        """Ask the callbacks in this thread, whichever that is.

        Raises:
            ParameterRefused: One of them refuses.
        """
        spelled = self.own.spelled(values)
        for _, judge in self._judges if spelled else ():
            try:
                reason = verdict(judge(dict(spelled)))
            except Exception as error:  # whatever it is, it is a refusal
                reason = _said_by(error)
            if reason:
                raise ParameterRefused(self._first(values), f"this node refuses: {reason}")

    def _first(self, values: Mapping[str, Value]) -> str:
        return next(name for name in values if name in self.own)

    def planned(self, values: Mapping[str, Any]) -> dict[str, Value]:
        """What a program wants to set, by full name; those that it declared are checked.

        Raises:
            ParameterError: One of them cannot be set.
        """
        flat: dict[str, Value] = {}
        for name, value in values.items():
            flat |= _flat(self.resolve(name), value)
        return flat | self.own.checked(flat)

    async def set(self, values: Mapping[str, Value], *, judged: bool = False) -> None:
        """Set a group, as `planned`, all or nothing; ``judged`` if the callbacks were asked."""
        own = {name: value for name, value in values.items() if name in self.own}
        if own and not judged:
            reason = await self._refusal(own)
            if reason:
                raise ParameterRefused(self._first(own), f"this node refuses: {reason}")
        try:
            client = await self._reach()
            said, revision = await ParameterCalls(client).set(values, self._node_info())
        except ForeignMaster:
            if len(own) < len(values):
                raise
            self._call_hooks(self.own.apply(own))
            return
        self._call_hooks(self.own.apply(said, revision))

    async def delete(self, name: str) -> None:
        """Delete a parameter or a group."""
        full = self.resolve(name)
        mine = [own.name for own in self.own if is_within(own.name, full)]
        try:
            client = await self._reach()
            await ParameterCalls(client).delete(full, node=self._node_info())
        except ForeignMaster:
            if not mine:
                raise
        for gone in mine:
            self.own.remove(gone)

    # -- what the Master says ------------------------------------------------------------------

    def heard(self, event: master.LeaseEvent, lease: LeaseStream) -> bool:
        """An event on the lease; whether it was about parameters."""
        match event.WhichOneof("kind"):
            case "parameter_offer":
                task = asyncio.get_running_loop().create_task(
                    self._answer(event.parameter_offer, lease)
                )
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
            case "parameters_set":
                self._set(event.parameters_set)
            case _:
                return False
        return True

    async def _answer(self, offer: par.ParameterOffer, lease: LeaseStream) -> None:
        try:
            values = self.own.checked(parameters_from_proto(offer.parameters))
            async with asyncio.timeout(_THINK_S):
                reason = await self._refusal(values)
        except ParameterError as error:
            reason = error.reason
        except TimeoutError:
            reason = f"its callback gave no answer within {_THINK_S:g} s"
        answer = par.ParameterAnswer(id=offer.id, accepted=not reason, reason=reason)
        # A lease that has ended meanwhile was an answer already.
        with contextlib.suppress(grpc.aio.AioRpcError, asyncio.InvalidStateError):
            await lease.say(master.LeaseRequest(parameter_answer=answer))

    async def _refusal(self, values: Mapping[str, Value]) -> str:
        """Why a callback refuses new values of declared parameters; empty if none does."""
        spelled = self.own.spelled(values)
        try:
            for judge, _ in self._judges if spelled else ():
                result = judge(dict(spelled))
                if inspect.isawaitable(result):
                    result = await result
                reason = verdict(result)
                if reason:
                    return reason
        except Exception as error:  # whatever it is, it is a refusal
            logger.debug("parameters %s refused", list(values), exc_info=True)
            return _said_by(error)
        return ""

    def _set(self, said: par.ParametersSet) -> None:
        try:
            values = parameters_from_proto(said.parameters)
        except ParameterError as error:
            logger.error("from the Master: %s", error)  # noqa: TRY400
            return
        self.declarer.note_early(values, said.revision)
        self._call_hooks(self.own.apply(values, said.revision))

    # -- the user's code -----------------------------------------------------------------------

    def hook(self, name: str, callback: Callable[[Any], Any]) -> None:
        """Call with each new value of a declared parameter, and with the first."""
        full = self.resolve(name)
        self._hooks.setdefault(full, []).append(callback)
        if full in self.own:
            self._guard.call(self._run, callback, self.own[full].value)

    def _call_hooks(self, changed: Sequence[Own]) -> None:
        for own in changed:
            for callback in self._hooks.get(own.name, ()):
                self._guard.call(self._run, callback, own.value)

    def _run(self, callback: Callable[[Any], Any], value: Value) -> None:
        result = callback(value)
        if inspect.iscoroutine(result):
            task = asyncio.get_running_loop().create_task(self._awaited(result))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _awaited(self, result: Awaitable[object]) -> None:
        try:
            await result
        except Exception as error:
            self._guard.failed(error)

    def abandon(self) -> None:
        """End all at once, telling nobody."""
        for watch in list(self._watches):
            watch.abandon()
        for task in list(self._tasks):
            if task is not asyncio.current_task():
                task.cancel()
        self.declarer.abandon()


def _said_by(error: Exception) -> str:
    return str(error) or type(error).__name__


def _flat(name: str, value: Any) -> dict[str, Value]:
    """A value by name, or those of a dict by theirs."""
    if not isinstance(value, Mapping):
        return {name: normalised(name, value)}
    found: dict[str, Value] = {}
    for key, item in value.items():
        found |= _flat(f"{name}/{key}", item)
    return found
