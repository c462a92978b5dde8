"""The calls of the control plane as a typed table.

Paths and message types of `RosRpcService` are those of C++ simple_ros. Servers and clients are made
from this table over gRPC's generic handlers, so no generated service code is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from google.protobuf.message import Message

from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import parameters_pb2 as par
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc import services_pb2 as srv

__all__ = [
    "DECLARE_PARAMETERS",
    "DECLARE_TYPE",
    "DELETE_PARAMETERS",
    "DESCRIBE_PARAMETERS",
    "EXPORT_GRAPH",
    "FIND_SERVICE",
    "GET_NODES",
    "GET_NODE_INFO",
    "GET_PARAMETERS",
    "GET_SERVICES",
    "GET_TOPICS",
    "GET_TOPIC_INFO",
    "GET_TYPE",
    "LEASE",
    "LIST_PARAMETERS",
    "MASTER_SERVICE",
    "PARAMETER_SERVICE",
    "REGISTER_PUBLISHER",
    "REGISTER_SERVICE",
    "ROS_RPC_SERVICE",
    "SERVICE_DIRECTORY",
    "SET_PARAMETERS",
    "SUBSCRIBE",
    "UNREGISTER_PUBLISHER",
    "UNREGISTER_SERVICE",
    "UNSUBSCRIBE",
    "WATCH_GRAPH",
    "WATCH_PARAMETERS",
    "Method",
]

ROS_RPC_SERVICE = "simple_ros.RosRpcService"
"""The eight unary calls shared with C++ simple_ros."""
MASTER_SERVICE = "simple_ros.MasterService"
"""Lease, watch and export: ours only."""
SERVICE_DIRECTORY = "simple_ros.ServiceDirectory"
"""Which services there are: ours only."""

PARAMETER_SERVICE = "simple_ros.ParameterService"
"""The tree of parameters: ours only."""

Request = TypeVar("Request", bound=Message)
Response = TypeVar("Response", bound=Message)


@dataclass(frozen=True, slots=True)
class Method(Generic[Request, Response]):
    """One remote call: where it is and what it takes and gives."""

    service: str
    name: str
    request: type[Request]
    response: type[Response]

    @property
    def path(self) -> str:
        """The HTTP/2 path of the call."""
        return f"/{self.service}/{self.name}"


SUBSCRIBE = Method(ROS_RPC_SERVICE, "Subscribe", ros.SubscribeRequest, ros.SubscribeResponse)
REGISTER_PUBLISHER = Method(
    ROS_RPC_SERVICE,
    "RegisterPublisher",
    ros.RegisterPublisherRequest,
    ros.RegisterPublisherResponse,
)
UNSUBSCRIBE = Method(
    ROS_RPC_SERVICE, "Unsubscribe", ros.UnsubscribeRequest, ros.UnsubscribeResponse
)
UNREGISTER_PUBLISHER = Method(
    ROS_RPC_SERVICE,
    "UnregisterPublisher",
    ros.UnregisterPublisherRequest,
    ros.UnregisterPublisherResponse,
)
GET_NODES = Method(ROS_RPC_SERVICE, "GetNodes", ros.GetNodesRequest, ros.GetNodesResponse)
GET_NODE_INFO = Method(
    ROS_RPC_SERVICE, "GetNodeInfo", ros.GetNodeInfoRequest, ros.GetNodeInfoResponse
)
GET_TOPICS = Method(ROS_RPC_SERVICE, "GetTopics", ros.GetTopicsRequest, ros.GetTopicsResponse)
GET_TOPIC_INFO = Method(
    ROS_RPC_SERVICE, "GetTopicInfo", ros.GetTopicInfoRequest, ros.GetTopicInfoResponse
)

LEASE = Method(MASTER_SERVICE, "Lease", master.LeaseRequest, master.LeaseEvent)
"""Stream both ways."""
WATCH_GRAPH = Method(MASTER_SERVICE, "WatchGraph", master.WatchGraphRequest, master.GraphEvent)
"""Stream of answers."""
EXPORT_GRAPH = Method(
    MASTER_SERVICE, "ExportGraph", master.ExportGraphRequest, master.ExportGraphResponse
)
DECLARE_TYPE = Method(
    MASTER_SERVICE, "DeclareType", master.DeclareTypeRequest, master.DeclareTypeResponse
)
REGISTER_SERVICE = Method(
    SERVICE_DIRECTORY, "RegisterService", srv.RegisterServiceRequest, srv.RegisterServiceResponse
)
UNREGISTER_SERVICE = Method(
    SERVICE_DIRECTORY,
    "UnregisterService",
    srv.UnregisterServiceRequest,
    srv.UnregisterServiceResponse,
)
GET_SERVICES = Method(
    SERVICE_DIRECTORY, "GetServices", srv.GetServicesRequest, srv.GetServicesResponse
)
FIND_SERVICE = Method(
    SERVICE_DIRECTORY, "FindService", srv.FindServiceRequest, srv.FindServiceResponse
)
GET_TYPE = Method(MASTER_SERVICE, "GetType", master.GetTypeRequest, master.GetTypeResponse)
GET_PARAMETERS = Method(
    PARAMETER_SERVICE, "GetParameters", par.GetParametersRequest, par.GetParametersResponse
)
LIST_PARAMETERS = Method(
    PARAMETER_SERVICE, "ListParameters", par.ListParametersRequest, par.ListParametersResponse
)
DESCRIBE_PARAMETERS = Method(
    PARAMETER_SERVICE,
    "DescribeParameters",
    par.DescribeParametersRequest,
    par.DescribeParametersResponse,
)
SET_PARAMETERS = Method(
    PARAMETER_SERVICE, "SetParameters", par.SetParametersRequest, par.SetParametersResponse
)
DELETE_PARAMETERS = Method(
    PARAMETER_SERVICE, "DeleteParameters", par.DeleteParametersRequest, par.DeleteParametersResponse
)
DECLARE_PARAMETERS = Method(
    PARAMETER_SERVICE,
    "DeclareParameters",
    par.DeclareParametersRequest,
    par.DeclareParametersResponse,
)
WATCH_PARAMETERS = Method(
    PARAMETER_SERVICE, "WatchParameters", par.WatchParametersRequest, par.ParameterEvent
)
"""Stream of answers."""
