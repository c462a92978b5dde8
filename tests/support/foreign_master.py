"""A stand-in for the C++ Master, with the behaviours that a node has to be safe against.

Only the eight shared calls. Every push is a fresh connection: one frame, then end of stream, then it
waits for the node's own end. As in the original there is one slot per node address: a push that
begins while the previous one to that address has not ended kills the Master. Here that is noted in
``crashed`` instead.
"""

from __future__ import annotations

import asyncio
from collections import defaultdict
from typing import Any

import grpc

from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.wire.framing import TARGETS_UPDATE_TYPE, encode_frame, encode_header


class ForeignMaster:
    def __init__(self, port: int = 0) -> None:
        self.port = port
        self.crashed: list[str] = []
        self.pushes: list[tuple[str, ros.TopicTargetsUpdate]] = []
        self.calls: list[tuple[str, str]] = []
        self.nodes: dict[str, ros.NodeInfo] = {}
        self.publishers: dict[str, dict[str, None]] = defaultdict(dict)
        self.subscribers: dict[str, dict[str, None]] = defaultdict(dict)
        self._pushing: set[tuple[str, int]] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self.port}"

    async def __aenter__(self) -> ForeignMaster:
        self._server = grpc.aio.server(options=[("grpc.so_reuseport", 0)])
        handlers = {
            "RegisterPublisher": self._register_publisher,
            "Subscribe": self._subscribe,
            "Unsubscribe": self._unsubscribe,
            "UnregisterPublisher": self._unregister_publisher,
        }
        table = {
            "RegisterPublisher": methods.REGISTER_PUBLISHER,
            "Subscribe": methods.SUBSCRIBE,
            "Unsubscribe": methods.UNSUBSCRIBE,
            "UnregisterPublisher": methods.UNREGISTER_PUBLISHER,
        }
        self._server.add_generic_rpc_handlers(
            (
                grpc.method_handlers_generic_handler(
                    methods.ROS_RPC_SERVICE,
                    {
                        name: grpc.unary_unary_rpc_method_handler(
                            handler,
                            request_deserializer=table[name].request.FromString,
                            response_serializer=table[name].response.SerializeToString,
                        )
                        for name, handler in handlers.items()
                    },
                ),
            )
        )
        self.port = self._server.add_insecure_port(f"127.0.0.1:{self.port}")
        await self._server.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._server.stop(0)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _upsert(self, request: Any) -> ros.NodeInfo:
        info: ros.NodeInfo = request.node_info
        self.nodes[info.node_name] = info
        return info

    async def _register_publisher(
        self, request: ros.RegisterPublisherRequest, _: object
    ) -> ros.RegisterPublisherResponse:
        self.calls.append(("RegisterPublisher", request.topic_name))
        info = self._upsert(request)
        self.publishers[request.topic_name][info.node_name] = None
        targets = [self.nodes[name] for name in self.subscribers[request.topic_name]]
        self._push(info, ros.TopicTargetsUpdate(topic=request.topic_name, add_targets=targets))
        return ros.RegisterPublisherResponse(success=True, message="Register publisher success")

    async def _subscribe(self, request: ros.SubscribeRequest, _: object) -> ros.SubscribeResponse:
        self.calls.append(("Subscribe", request.topic_name))
        info = self._upsert(request)
        self.subscribers[request.topic_name][info.node_name] = None
        update = ros.TopicTargetsUpdate(topic=request.topic_name, add_targets=[info])
        for name in self.publishers[request.topic_name]:
            self._push(self.nodes[name], update)
        return ros.SubscribeResponse(success=True, message="Subscribe success")

    async def _unsubscribe(
        self, request: ros.UnsubscribeRequest, _: object
    ) -> ros.UnsubscribeResponse:
        self.calls.append(("Unsubscribe", request.topic_name))
        info = request.node_info
        self.subscribers[request.topic_name].pop(info.node_name, None)
        update = ros.TopicTargetsUpdate(topic=request.topic_name, remove_targets=[info])
        for name in self.publishers[request.topic_name]:
            self._push(self.nodes[name], update)
        return ros.UnsubscribeResponse(success=True, message="Unsubscribe success")

    async def _unregister_publisher(
        self, request: ros.UnregisterPublisherRequest, _: object
    ) -> ros.UnregisterPublisherResponse:
        self.calls.append(("UnregisterPublisher", request.topic_name))
        self.publishers[request.topic_name].pop(request.node_info.node_name, None)
        return ros.UnregisterPublisherResponse(success=True, message="Unregister publisher success")

    def _push(self, info: ros.NodeInfo, update: ros.TopicTargetsUpdate) -> None:
        key = info.ip, info.port
        if key in self._pushing:
            self.crashed.append(f"overlapping pushes to {info.node_name} about {update.topic}")
            return
        self._pushing.add(key)
        task = asyncio.create_task(self._send(key, info.node_name, update))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _send(self, key: tuple[str, int], name: str, update: ros.TopicTargetsUpdate) -> None:
        reader, writer = await asyncio.open_connection(*key)
        header = encode_header(update.topic or "__master_topic_update", TARGETS_UPDATE_TYPE)
        writer.write(encode_frame(header, update.SerializeToString()))
        writer.write_eof()
        while await reader.read(1024):
            pass
        writer.close()
        self._pushing.discard(key)
        self.pushes.append((name, update))
