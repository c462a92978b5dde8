"""The calls of `ParameterService`, for nodes and tools."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Iterable, Mapping, Sequence

from simple_ros.net.master_client import MasterClient
from simple_ros.parameters.convert import (
    ParameterInfo,
    declaration_to_proto,
    description_from_proto,
    error_from_proto,
    parameters_from_proto,
    parameters_to_proto,
)
from simple_ros.parameters.tree import Declaration
from simple_ros.parameters.values import Value
from simple_ros.rpc import methods
from simple_ros.rpc import parameters_pb2 as par
from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["ParameterCalls"]

_SET_TIMEOUT_S = 10.0
"""More than the nodes that declared a parameter may think about it, for some that set it at once."""


class ParameterCalls:
    """Reads and changes the Master's parameters; all names are full.

    Each call raises `MasterUnavailable` if nobody answers, `ForeignMaster` with a Master of C++
    simple_ros, and a `ParameterError` if the Master says no.

    Args:
        client: Connection to the Master.
    """

    def __init__(self, client: MasterClient) -> None:
        self._client = client

    async def get(self, *names: str) -> dict[str, Value]:
        """Values of parameters, and of all within groups.

        Raises:
            UnknownParameter: There is none of such a name.
        """
        request = par.GetParametersRequest(names=names)
        answer = await self._client.call(methods.GET_PARAMETERS, request)
        _check(answer)
        return parameters_from_proto(answer.parameters)

    async def list(self, prefix: str = "") -> Sequence[str]:
        """Names in a group, in order; all for ``""``."""
        request = par.ListParametersRequest(prefix=prefix)
        return (await self._client.call(methods.LIST_PARAMETERS, request)).names[:]

    async def describe(self, prefix: str = "") -> Sequence[ParameterInfo]:
        """All that is known of a parameter, or of those in a group, by name in order.

        Raises:
            UnknownParameter: There is none of that name.
        """
        request = par.DescribeParametersRequest(prefix=prefix)
        answer = await self._client.call(methods.DESCRIBE_PARAMETERS, request)
        _check(answer)
        return [description_from_proto(item) for item in answer.parameters]

    async def set(
        self, values: Mapping[str, Value], node: ros.NodeInfo | None = None
    ) -> tuple[dict[str, Value], int]:
        """Set a group, all or nothing.

        Args:
            values: By name, normalised.
            node: Who asks, if it is a node, which then is not asked itself.

        Returns:
            The values in their declared types, and the tree's revision.

        Raises:
            ParameterError: One of them cannot be set.
        """
        request = par.SetParametersRequest(parameters=parameters_to_proto(values), node_info=node)
        answer = await self._client.call(methods.SET_PARAMETERS, request, _SET_TIMEOUT_S)
        _check(answer)
        return parameters_from_proto(answer.parameters), answer.revision

    async def delete(self, *names: str, node: ros.NodeInfo | None = None) -> Sequence[str]:
        """Delete parameters and groups, all or nothing; returns the names of what has gone.

        Raises:
            ParameterError: One of them is not there, or a live node declares it.
        """
        request = par.DeleteParametersRequest(names=names, node_info=node)
        answer = await self._client.call(methods.DELETE_PARAMETERS, request)
        _check(answer)
        return answer.names[:]

    async def declare(
        self, node: ros.NodeInfo, declarations: Iterable[Declaration]
    ) -> tuple[Sequence[ParameterInfo], int]:
        """Declare parameters of a node that holds a lease, all or nothing.

        Returns:
            What they are now, and the tree's revision.

        Raises:
            ParameterError: One of them cannot be declared so.
        """
        request = par.DeclareParametersRequest(
            node_info=node, declarations=[declaration_to_proto(item) for item in declarations]
        )
        answer = await self._client.call(methods.DECLARE_PARAMETERS, request)
        _check(answer)
        return [description_from_proto(item) for item in answer.parameters], answer.revision

    def watch(self, prefix: str = "") -> AsyncGenerator[par.ParameterEvent, None]:
        """A snapshot of a group, then its changes, until the Master goes away."""
        request = par.WatchParametersRequest(prefix=prefix)
        return self._client.stream(methods.WATCH_PARAMETERS, request)


def _check(answer: object) -> None:
    problem: par.ParameterProblem = getattr(answer, "problem")  # noqa: B009
    if problem.kind:
        raise error_from_proto(problem)
