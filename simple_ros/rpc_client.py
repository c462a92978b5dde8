"""The eight calls of the control plane, blocking, under the names of the seed's ``RosRpcClient``."""

from __future__ import annotations

from simple_ros.net.loop import BackgroundLoop
from simple_ros.net.master_client import MasterClient
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc.methods import Method, Request, Response

__all__ = ["RosRpcClient"]


class RosRpcClient:
    """Calls a Master, ours or C++ simple_ros's. Made by `SystemManager.get_rpc_client`.

    Every call raises `MasterUnavailable` if nobody answers within 5 s.
    """

    def __init__(self, loop: BackgroundLoop, address: str) -> None:
        self._loop = loop
        self._address = address

    def _call(self, method: Method[Request, Response], request: Request) -> Response:
        return self._loop.run(self._called(method, request))

    async def _called(self, method: Method[Request, Response], request: Request) -> Response:
        async with MasterClient(self._address) as client:
            return await client.call(method, request)

    def subscribe(
        self, topic_name: str, msg_type: str, node_info: ros.NodeInfo
    ) -> ros.SubscribeResponse:
        """Register a subscription of a node."""
        request = ros.SubscribeRequest(
            topic_name=topic_name, msg_type=msg_type, node_info=node_info
        )
        return self._call(methods.SUBSCRIBE, request)

    def register_publisher(
        self, topic_name: str, msg_type: str, node_info: ros.NodeInfo
    ) -> ros.RegisterPublisherResponse:
        """Register a publisher of a node."""
        request = ros.RegisterPublisherRequest(
            topic_name=topic_name, msg_type=msg_type, node_info=node_info
        )
        return self._call(methods.REGISTER_PUBLISHER, request)

    def unsubscribe(
        self, topic_name: str, msg_type: str, node_info: ros.NodeInfo
    ) -> ros.UnsubscribeResponse:
        """Take a subscription back."""
        request = ros.UnsubscribeRequest(
            topic_name=topic_name, msg_type=msg_type, node_info=node_info
        )
        return self._call(methods.UNSUBSCRIBE, request)

    def unregister_publisher(
        self, topic_name: str, msg_type: str, node_info: ros.NodeInfo
    ) -> ros.UnregisterPublisherResponse:
        """Take a publisher back."""
        request = ros.UnregisterPublisherRequest(
            topic_name=topic_name, msg_type=msg_type, node_info=node_info
        )
        return self._call(methods.UNREGISTER_PUBLISHER, request)

    def get_nodes(self, filter: str = "") -> ros.GetNodesResponse:  # noqa: A002
        """Nodes whose name contains ``filter``."""
        return self._call(methods.GET_NODES, ros.GetNodesRequest(filter=filter))

    def get_node_info(self, node_name: str) -> ros.GetNodeInfoResponse:
        """One node with its topics; ``success`` is False if it is not known."""
        return self._call(methods.GET_NODE_INFO, ros.GetNodeInfoRequest(node_name=node_name))

    def get_topics(self, filter: str = "") -> ros.GetTopicsResponse:  # noqa: A002
        """Topics whose name contains ``filter``."""
        return self._call(methods.GET_TOPICS, ros.GetTopicsRequest(filter=filter))

    def get_topic_info(self, topic_name: str) -> ros.GetTopicInfoResponse:
        """Type, publishers and subscribers of a topic.

        Raises:
            TopicNotFound: The Master does not know the topic.
        """
        return self._loop.run(self._topic_info(topic_name))

    async def _topic_info(self, topic_name: str) -> ros.GetTopicInfoResponse:
        async with MasterClient(self._address) as client:
            return await client.get_topic_info(topic_name)
