"""The message types that nodes bring, for tools that have never seen them.

Pure. A definition stays while nothing contradicts it, also when the node that brought it has left. One
that is contradicted gives way if no node uses it any more: people change their messages.
"""

from __future__ import annotations

from collections.abc import Callable

from simple_ros.errors import ConfigError, SimpleRosError, TypeDefinitionConflict
from simple_ros.msg.definitions import TypeStore
from simple_ros.rpc import master_pb2 as master

__all__ = ["declare_type", "get_type"]


def declare_type(
    types: TypeStore, in_use: Callable[[], set[str]], request: master.DeclareTypeRequest
) -> master.DeclareTypeResponse:
    """A node brings a message type; what no node uses any more may be redefined."""
    try:
        try:
            types.add(request.type_name, request.files)
        except (TypeDefinitionConflict, ConfigError):
            types.keep_only(in_use())
            types.add(request.type_name, request.files)
    except TypeDefinitionConflict as conflict:
        return master.DeclareTypeResponse(
            conflicting_type=conflict.type_name, difference=conflict.difference
        )
    except SimpleRosError as error:
        return master.DeclareTypeResponse(conflicting_type=request.type_name, difference=str(error))
    return master.DeclareTypeResponse(success=True)


def get_type(types: TypeStore, request: master.GetTypeRequest) -> master.GetTypeResponse:
    """The definition of a type that some node brought."""
    files = types.get(request.type_name)
    return master.GetTypeResponse(known=files is not None, files=files)
