"""Keeps a node known to the Master, whichever Master comes and goes.

With our own Master a node holds a *lease*, one open stream that is its sign of life, and registers
everything again within a moment of a Master's return. With a C++ Master (which answers UNIMPLEMENTED
to the lease) it works as that program demands: one registration at a time, each waiting for the end of
the push connection it causes, since overlapping pushes kill that Master.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable
from typing import Any

import grpc

from simple_ros.endpoints import Endpoints
from simple_ros.errors import (
    HandleClosed,
    MasterUnavailable,
    NodeNameTaken,
    RegistrationRefused,
    SimpleRosError,
    TopicTypeMismatch,
)
from simple_ros.identity import Identity
from simple_ros.net.addresses import join_address
from simple_ros.net.master_client import ForeignMaster, LeaseStream, MasterConnector
from simple_ros.parameters.local import NodeParameters
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc import services_pb2 as srv
from simple_ros.rpc.convert import qos_to_proto
from simple_ros.tasks import first_of, run_all, said_when_slow
from simple_ros.wire.session import Backoff, EndpointKey, EndpointKind, Registrations

__all__ = ["Registrar"]

logger = logging.getLogger(__name__)

_PIPELINED = 64
_SHIPPED = "simple_ros/msg/"
_FOREIGN_PUSH_S = 1.0
_FOREIGN_MOMENT_S = 0.001
_FOREIGN_SPACING_S = 0.02
_GOODBYE_S = 0.4
_FAREWELL_S = 1.0


class Registrar:
    """Tells the Master what a node publishes and subscribes.

    Args:
        identity: Who the node is.
        endpoints: What it publishes and subscribes.
        parameters: What it declares.
        connect: Makes a connection to the Master.
        on_failed: Called when the node is no longer registered, for good.

    Attributes:
        client: The connection to the Master, for further calls.
        is_foreign: Whether the present Master is C++ simple_ros; None before the first contact.
    """

    def __init__(
        self,
        identity: Identity,
        endpoints: Endpoints,
        parameters: NodeParameters,
        connect: MasterConnector,
        on_failed: Callable[[SimpleRosError], None],
    ) -> None:
        self._connect = connect
        self.client = connect(keepalive=True)
        self.is_foreign: bool | None = None
        self._identity = identity
        self._endpoints = endpoints
        self._parameters = parameters
        self._on_failed = on_failed
        self._address = self.client.address
        self._registrations = Registrations()
        self._waiting: dict[EndpointKey, list[asyncio.Future[None]]] = {}
        self._wake = asyncio.Event()
        self._contact = asyncio.Event()
        self._push_ended: dict[str, asyncio.Event] = {}
        self._said: dict[EndpointKey, asyncio.Event] = {}
        self._declared: set[str] = set()
        self._ended = False
        self._idle = asyncio.Event()
        self._lease: LeaseStream | None = None
        self._leaving = False
        self._task = asyncio.get_running_loop().create_task(self._run(), name="registrar")

    # -- wishes --------------------------------------------------------------------------------

    async def register(self, key: EndpointKey) -> None:
        """Register now and with every later Master; returns when the Master knows.

        Raises:
            TopicTypeMismatch: The topic has another type; nothing stays registered.
            RegistrationRefused: The Master said no.
        """
        if self._ended:
            raise HandleClosed(f"node {self._identity.name!r}")
        self._registrations.want(key)
        if self._registrations.is_told(key):
            return
        future = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(key, []).append(future)
        self._wake.set()
        try:
            await future
        finally:
            waiting = self._waiting.get(key, [])
            if future in waiting:
                waiting.remove(future)
            if not waiting:
                self._waiting.pop(key, None)

    def changed(self, key: EndpointKey) -> None:
        """Tell the Master anew: the QoS of a registration has changed."""
        if self._registrations.is_told(key):
            self._registrations.want_anew(key)
            self._wake.set()

    async def unregister(self, key: EndpointKey) -> None:
        """Take a registration back; returns when the Master knows, or after 1 s without it."""
        self._registrations.unwant(key)
        self._wake.set()
        if self._contact.is_set() and self._registrations.has_farewell(key):
            said = self._said.setdefault(key, asyncio.Event())
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_FAREWELL_S):
                    await said.wait()

    async def wait_for_master(self) -> None:
        """Return when a Master has answered.

        Raises:
            HandleClosed: The node ended meanwhile.
        """
        await self._contact.wait()
        if self._ended:
            raise HandleClosed(f"node {self._identity.name!r}")

    def push_connection_ended(self, topic: str) -> None:
        """A connection that brought a push about ``topic`` (canonical) has ended."""
        event = self._push_ended.get(topic)
        if event is not None:
            event.set()

    # -- keeping contact -----------------------------------------------------------------------

    async def _run(self) -> None:
        backoff = Backoff(0.05, 0.5)
        while not self._leaving:
            try:
                await self._session()
                backoff.reset()
            except NodeNameTaken as error:
                self._end(error)
                return
            except (grpc.aio.AioRpcError, MasterUnavailable, ConnectionError) as error:
                logger.debug("Master at %s: %s", self._address, error)
            except Exception:
                # Nothing may end this task unseen: the node would wait for ever.
                logger.exception("registration with the Master at %s failed", self._address)
            self._contact.clear()
            self._registrations.master_changed()
            self._endpoints.master_lost()
            if not self._leaving:
                await asyncio.sleep(backoff.next_delay())

    async def _session(self) -> None:
        """One life of one Master, from its first answer to its end."""
        await self._identity.refresh()
        lease = self.client.lease()
        try:
            async with said_when_slow(self._address):
                granted = await lease.open(self._identity.node_info())
        except grpc.aio.AioRpcError as error:
            lease.cancel()
            if error.code() is not grpc.StatusCode.UNIMPLEMENTED:
                raise
            await self._foreign_session()
            return
        except BaseException:
            lease.cancel()
            raise
        logger.debug("leased by Master %s at %s", granted.master_id, self._address)
        self._lease = lease
        self._met(foreign=False)
        try:
            await first_of(
                self._listen(lease),
                self._tell_all(),
                self._parameters.declarer.session(self.client, granted.master_id),
            )
        finally:
            self._lease = None
            lease.cancel()

    async def _foreign_session(self) -> None:
        """The same with a C++ Master, which would cut a connection that it sees probed."""
        probing, self.client = self.client, self._connect(keepalive=False)
        await probing.close()
        self._met(foreign=True)
        try:
            await first_of(
                self.client.wait_until_lost(),
                self._tell_foreign(),
                self._parameters.declarer.session_alone(),
            )
        finally:
            plain, self.client = self.client, self._connect(keepalive=True)
            await plain.close()

    def _met(self, *, foreign: bool) -> None:
        self.is_foreign = foreign
        self._registrations.master_changed()
        self._declared.clear()
        self._endpoints.master_changed()
        self._contact.set()

    async def _listen(self, lease: LeaseStream) -> None:
        while (event := await lease.next_event()) is not None:
            if event.WhichOneof("kind") == "name_taken":
                by = event.name_taken.taken_by
                raise NodeNameTaken(self._identity.name, join_address(by.ip, by.port))
            if not self._parameters.heard(event, lease):
                self._endpoints.notice(event)

    # -- telling our Master --------------------------------------------------------------------

    async def _tell_all(self) -> None:
        while True:
            self._wake.clear()
            for key in iter(self._registrations.next_farewell, None):
                await self._say_farewell(key)
            keys = [key for key in self._registrations.wanted if not self._is_told(key)]
            for start in range(0, len(keys), _PIPELINED):
                await run_all(map(self._tell_one, keys[start : start + _PIPELINED]))
            if not self._wake.is_set():
                await self._wake.wait()

    def _is_told(self, key: EndpointKey) -> bool:
        return self._registrations.is_told(key)

    async def _tell_one(self, key: EndpointKey) -> None:
        if self._registrations.is_wanted(key):
            self._answered(key, await self._tell_safely(key))

    async def _tell_safely(self, key: EndpointKey) -> Exception | None:
        """As `_tell`; what goes wrong with this one registration is no matter of the others."""
        try:
            refusal = await self._tell(key)
        except (MasterUnavailable, asyncio.CancelledError):
            raise
        except (grpc.aio.AioRpcError, SimpleRosError, ValueError) as error:
            refusal = error
        if self._registrations.has_farewell(key):
            self._wake.set()
        return refusal

    async def _tell(self, key: EndpointKey) -> Exception | None:
        """Register; return why the Master refused, if it did."""
        await self._declare(key)
        if key.kind is EndpointKind.SERVICE:
            return await self._tell_service(key)
        self._endpoints.registering(key.topic)
        fields: dict[str, Any] = {
            "topic_name": key.topic,
            "msg_type": key.msg_type,
            "node_info": self._endpoint_info(key),
            "strict": key in self._waiting,
        }
        response: ros.SubscribeResponse | ros.RegisterPublisherResponse
        if key.kind is EndpointKind.PUBLISHER:
            answer = await self.client.call(
                methods.REGISTER_PUBLISHER, ros.RegisterPublisherRequest(**fields)
            )
            self._registrations.told(key)
            if answer.subscribers:
                self._endpoints.subscribers_known(key.topic, list(answer.subscribers))
            response = answer
        else:
            response = await self.client.call(methods.SUBSCRIBE, ros.SubscribeRequest(**fields))
            self._registrations.told(key)
        return self._refusal(key, response)

    async def _tell_service(self, key: EndpointKey) -> Exception | None:
        info = self._endpoints.service_info(key, self._identity.node_info())
        answer = await self.client.call(
            methods.REGISTER_SERVICE, srv.RegisterServiceRequest(service=info)
        )
        self._registrations.told(key)
        return None if answer.success else RegistrationRefused(answer.message)

    async def _declare(self, key: EndpointKey) -> None:
        """Give the Master the definitions of the user's types, once in its life."""
        for message_class in self._endpoints.definitions_of(key):
            name = message_class.DESCRIPTOR.full_name
            if name in self._declared or self.is_foreign:
                continue
            if not message_class.DESCRIPTOR.file.name.startswith(_SHIPPED):
                # A Master of ours that is older has no such call; its tools know fewer types.
                with contextlib.suppress(ForeignMaster):
                    await self.client.declare_type(message_class)
            self._declared.add(name)

    def _refusal(
        self, key: EndpointKey, response: ros.SubscribeResponse | ros.RegisterPublisherResponse
    ) -> SimpleRosError | None:
        if response.success:
            return None
        if not response.HasField("type_conflict"):
            return RegistrationRefused(f"{key.kind.value} of {key.topic!r}: {response.message}")
        conflict = response.type_conflict
        return TopicTypeMismatch(
            key.topic,
            self._identity.name,
            key.msg_type,
            conflict.existing_type,
            tuple(conflict.existing_nodes),
        )

    def _answered(self, key: EndpointKey, refusal: Exception | None = None) -> None:
        waiting = self._waiting.pop(key, [])
        if refusal is not None:
            if waiting:
                self._registrations.unwant(key)
                self._registrations.farewell_said(key)
            else:
                self._registrations.told(key)
                logger.error("not registered: %s", refusal)
        for future in waiting:
            if future.done():
                continue
            if refusal is None:
                future.set_result(None)
            else:
                future.set_exception(refusal)

    async def _say_farewell(self, key: EndpointKey) -> None:
        self._registrations.farewell_said(key)
        try:
            await self._unregistered(key)
        finally:
            said = self._said.pop(key, None)
            if said is not None:
                said.set()

    async def _unregistered(self, key: EndpointKey) -> None:
        if key.kind is EndpointKind.SERVICE:
            await self.client.call(
                methods.UNREGISTER_SERVICE,
                srv.UnregisterServiceRequest(name=key.topic, node_info=self._identity.node_info()),
            )
            return
        fields: dict[str, Any] = {
            "topic_name": key.topic,
            "msg_type": key.msg_type,
            "node_info": self._identity.node_info(),
        }
        if key.kind is EndpointKind.PUBLISHER:
            await self.client.call(
                methods.UNREGISTER_PUBLISHER, ros.UnregisterPublisherRequest(**fields)
            )
        else:
            await self.client.call(methods.UNSUBSCRIBE, ros.UnsubscribeRequest(**fields))

    def _endpoint_info(self, key: EndpointKey) -> ros.NodeInfo:
        info = self._identity.node_info()
        info.endpoint.topic = key.topic
        info.endpoint.msg_type = key.msg_type
        profile = self._endpoints.qos_of(key)
        if profile is not None:
            info.endpoint.qos.CopyFrom(qos_to_proto(profile))
        return info

    # -- telling a C++ Master ------------------------------------------------------------------

    async def _tell_foreign(self) -> None:
        while True:
            self._wake.clear()
            self._idle.clear()
            await self._tell_foreign_what_is_due()
            if not self._wake.is_set():
                self._idle.set()
                await self._wake.wait()

    async def _tell_foreign_what_is_due(self) -> None:
        for key in iter(self._registrations.next_farewell, None):
            await self._say_farewell(key)
            if key.kind is EndpointKind.SUBSCRIBER:
                # That one makes the Master push; the other does not.
                await asyncio.sleep(_FOREIGN_SPACING_S)
        for key in iter(self._registrations.next_registration, None):
            ended = self._push_ended.setdefault(key.topic, asyncio.Event())
            ended.clear()
            refusal = await self._tell_safely(key)
            if key.kind is EndpointKind.PUBLISHER:
                # The push always comes, even with no targets, and its connection then ends.
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_FOREIGN_PUSH_S):
                        await ended.wait()
                # The Master learns a moment later that it has ended.
                await asyncio.sleep(_FOREIGN_MOMENT_S)
            else:
                await asyncio.sleep(_FOREIGN_SPACING_S)
            self._push_ended.pop(key.topic, None)
            self._answered(key, refusal)

    # -- the end -------------------------------------------------------------------------------

    def _end(self, error: SimpleRosError) -> None:
        logger.error("%s", error)
        for key in list(self._waiting):
            for future in self._waiting.pop(key):
                if not future.done():
                    future.set_exception(error)
        self._ended = True
        self._contact.set()
        self._on_failed(error)

    async def close(self) -> None:
        """Say goodbye, if a Master is there (up to 0.4 s), and stop."""
        with contextlib.suppress(
            TimeoutError, grpc.aio.AioRpcError, SimpleRosError, asyncio.InvalidStateError
        ):
            async with asyncio.timeout(_GOODBYE_S):
                await self._say_goodbye()
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        self._end_waiting()
        await self.client.close()

    async def _say_goodbye(self) -> None:
        self._leaving = True
        if self._lease is not None:
            await self._lease.leave()
            await asyncio.wait([self._task])
        elif self.is_foreign and self._contact.is_set():
            for key in self._registrations.wanted:
                self._registrations.unwant(key)
            self._idle.clear()
            self._wake.set()
            await self._idle.wait()

    def _end_waiting(self) -> None:
        self._ended = True
        self._contact.set()
        for futures in self._waiting.values():
            for future in futures:
                if not future.done():
                    future.set_exception(HandleClosed(f"node {self._identity.name!r}"))
        self._waiting.clear()
