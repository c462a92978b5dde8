"""The Master, and what it knows."""

from __future__ import annotations

import asyncio
import ipaddress
import os
import socket
import uuid
from collections.abc import Coroutine, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import grpc

from simple_ros.doctor.judge_graph import Master, MasterKind, NodeAnswer, Offer, Surroundings
from simple_ros.doctor.look_network import is_own
from simple_ros.doctor.looking import Unknown, in_thread, within
from simple_ros.errors import MasterUnavailable, SimpleRosError
from simple_ros.graph import GraphSnapshot, edges_between
from simple_ros.graph_source import fetch_graph
from simple_ros.net.addresses import is_loopback, join_address, split_address
from simple_ros.net.master_client import ForeignMaster, MasterClient
from simple_ros.qos import incompatibilities
from simple_ros.rpc import master_pb2, methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc.convert import qos_from_proto

__all__ = ["look_at_master"]

_RESOLVE_LIMIT_S = 0.8
_CONNECT_LIMIT_S = 0.8
_CALL_LIMIT_S = 0.8
_NODE_LIMIT_S = 1.0
_NODES_LIMIT_S = 1.2
_ROUND_TRIPS = 5
_RETRY_S = 0.05
_AT_ONCE = 128
_OWN_NAME = "cli_doctor_"
_START_ONE = "start one with 'simple-ros-master', or point SIMPLE_ROS_MASTER at the one that runs"


async def look_at_master(
    address: str, own_version: str
) -> tuple[Master, Surroundings | Unknown[Surroundings]]:
    """What can be told of a Master; the graph is `Unknown` if it was not found or took too long."""
    none: Unknown[Surroundings] = Unknown("no Master")
    found = await _reached(Master(address, own_version=own_version))
    if found.problem:
        return replace(found, hint=_START_ONE), none
    async with MasterClient(address) as client:
        calls = await within(_CALL_LIMIT_S, _round_trips(client))
        if isinstance(calls, Unknown):
            problem = f"something listens at {address} but does not answer as a Master"
            hint = "see who it is with 'simple-ros doctor --verbose' (port ...); a Master that hangs has to be started again"
            return replace(found, problem=problem, hint=hint), none
        infos, times = calls
        found = replace(found, round_trips_ms=times)
        graph, kind = await asyncio.gather(
            within(_CALL_LIMIT_S, fetch_graph(client)), within(_CALL_LIMIT_S, _kind(client))
        )
        if not isinstance(kind, Unknown):
            found = replace(found, kind=kind[0], version=kind[1])
        if isinstance(graph, Unknown):
            return found, Unknown(graph.reason)
        return found, await _surroundings(client, found, _without_doctors(graph), infos)


async def _reached(master: Master) -> Master:
    """With the time it took to connect, or why that failed."""
    host, port = split_address(master.address)
    infos = await within(
        _RESOLVE_LIMIT_S, in_thread(socket.getaddrinfo, host, port, 0, socket.SOCK_STREAM)
    )
    if isinstance(infos, Unknown):
        return replace(master, problem=f"its host {host!r} does not resolve ({infos.reason})")
    literals = list(dict.fromkeys(str(info[4][0]) for info in infos))
    master = replace(master, is_local=is_own(literals))
    problem = ""
    limit_s = _CONNECT_LIMIT_S / len(literals)
    for literal in literals:
        taken_ms, why, _ = await _connected(literal, port, limit_s)
        if not why:
            return replace(master, connect_ms=taken_ms)
        problem = problem or why
    return replace(master, problem=f"no Master answers at {master.address}: {problem}")


async def _connected(host: str, port: int, limit_s: float) -> tuple[float, str, bool]:
    """Milliseconds to connect, why it failed (empty: it did not), and whether nobody listened."""
    loop = asyncio.get_running_loop()
    start = loop.time()
    try:
        async with asyncio.timeout(limit_s):
            _, writer = await asyncio.open_connection(host, port)
    except ConnectionRefusedError:
        return 0.0, "nobody listens", True
    except TimeoutError:
        return 0.0, f"there is no answer within {limit_s:g} s", False
    except OSError as error:
        return 0.0, error.strerror or str(error), False
    taken_ms = (loop.time() - start) * 1e3
    writer.close()
    return taken_ms, "", False


async def _round_trips(client: MasterClient) -> tuple[list[ros.NodeInfo], tuple[float, ...]]:
    """The nodes, and how many milliseconds small calls took."""
    infos = await _patiently(client)
    loop = asyncio.get_running_loop()
    times = []
    for _ in range(_ROUND_TRIPS):
        start = loop.time()
        await client.get_nodes(_OWN_NAME + uuid.uuid4().hex)
        times.append((loop.time() - start) * 1e3)
    return infos, tuple(times)


async def _patiently(client: MasterClient) -> list[ros.NodeInfo]:
    """The nodes; tries again, since gRPC gives up early on a slow link."""
    while True:
        with suppress(MasterUnavailable):
            return await client.get_nodes()
        await asyncio.sleep(_RETRY_S)


async def _kind(client: MasterClient) -> tuple[MasterKind, str]:
    """Whose Master it is, and its version: ours tells it to a node that opens a lease."""
    try:
        await client.call(methods.GET_TYPE, master_pb2.GetTypeRequest())
    except ForeignMaster:
        return MasterKind.CPP, ""
    lease = client.lease()
    try:
        granted = await lease.open(
            ros.NodeInfo(node_name=f"{_OWN_NAME}{os.getpid()}", instance_id=uuid.uuid4().hex)
        )
        await lease.leave()
        while await lease.next_event() is not None:
            pass
    finally:
        lease.cancel()
    return MasterKind.OURS, granted.master_version


def _without_doctors(graph: GraphSnapshot) -> GraphSnapshot:
    nodes = tuple(node for node in graph.nodes if not node.name.startswith(_OWN_NAME))
    return GraphSnapshot(nodes, edges_between(nodes))


async def _surroundings(
    client: MasterClient, master: Master, graph: GraphSnapshot, infos: Iterable[ros.NodeInfo]
) -> Surroundings:
    nodes = [info for info in infos if not info.node_name.startswith(_OWN_NAME)]
    answers, offers = await asyncio.gather(
        _answers(nodes, master), _offers(client, graph, master.kind)
    )
    return Surroundings(graph, answers, *offers)


async def _as_far_as_time(limit_s: float, looks: Sequence[Coroutine[Any, Any, None]]) -> None:
    """Run looks, some at once, as far as they come; errors of one are its own matter."""
    gate = asyncio.Semaphore(_AT_ONCE)

    async def one(look: Coroutine[Any, Any, None]) -> None:
        async with gate:
            await look

    tasks = [asyncio.create_task(one(look)) for look in looks]
    if tasks:
        _, late = await asyncio.wait(tasks, timeout=limit_s)
        for task in late:
            task.cancel()
        await asyncio.gather(*late, return_exceptions=True)
    for look in looks:
        look.close()  # one that never had its turn


# -- nodes -----------------------------------------------------------------------------------------


async def _answers(infos: Sequence[ros.NodeInfo], master: Master) -> tuple[NodeAnswer, ...]:
    found = {
        info.node_name: NodeAnswer(
            info.node_name,
            join_address(info.ip, info.port),
            was_tried=False,
            has_lease=bool(info.instance_id),
            is_misplaced=master.is_local is False and is_loopback(info.ip),
        )
        for info in infos
    }

    async def ask(info: ros.NodeInfo) -> None:
        found[info.node_name] = await _answer(info, found[info.node_name])

    await _as_far_as_time(_NODES_LIMIT_S, [ask(info) for info in infos])
    return tuple(found[name] for name in sorted(found))


async def _answer(info: ros.NodeInfo, answer: NodeAnswer) -> NodeAnswer:
    if not (_is_literal(info.ip) and info.port):
        return replace(answer, was_tried=True, problem="nobody can connect to that address")
    _, problem, refused = await _connected(info.ip, info.port, _NODE_LIMIT_S / 2)
    if problem:
        for address in info.addresses:
            if not (await _connected(*split_address(address), _NODE_LIMIT_S / 4))[1]:
                return replace(answer, was_tried=True, elsewhere=address)
    return replace(answer, was_tried=True, problem=problem, refused=refused)


def _is_literal(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


# -- quality of service ----------------------------------------------------------------------------


async def _offers(
    client: MasterClient, graph: GraphSnapshot, kind: MasterKind
) -> tuple[tuple[Offer, ...], tuple[int, int] | None]:
    """The pairs that do not fit, and how many topics were asked about, of how many."""
    if kind is MasterKind.CPP:
        return (), None
    published = {key for node in graph.nodes for key in node.publishes}
    subscribed = {key for node in graph.nodes for key in node.subscribes}
    topics = sorted({key.topic for key in published & subscribed})
    found: list[Offer] = []
    asked: list[str] = []

    async def ask(topic: str) -> None:
        try:
            info = await client.get_topic_info(topic)
        except (SimpleRosError, grpc.aio.AioRpcError):
            return  # counted as not asked: the topic has gone, or the Master has
        asked.append(topic)
        found.extend(_misfits(info))

    await _as_far_as_time(_NODES_LIMIT_S, [ask(topic) for topic in topics])
    return tuple(sorted(found, key=lambda offer: (offer.topic, offer.publisher))), (
        len(asked),
        len(topics),
    )


def _misfits(info: ros.GetTopicInfoResponse) -> Iterable[Offer]:
    for publisher in info.publishers:
        for subscriber in info.subscribers:
            offered, requested = publisher.endpoint, subscriber.endpoint
            if offered.HasField("qos") and requested.HasField("qos"):
                policies = incompatibilities(
                    qos_from_proto(offered.qos), qos_from_proto(requested.qos)
                )
                if policies:
                    yield Offer(
                        info.topic_name,
                        publisher.node_name,
                        subscriber.node_name,
                        "; ".join(map(str, policies)),
                    )
