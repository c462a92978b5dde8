"""What a node offers its program about parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from simple_ros.parameters.convert import ParameterInfo
from simple_ros.parameters.errors import UnknownParameter
from simple_ros.parameters.local import NodeParameters, SetCallback
from simple_ros.parameters.values import Descriptor, Scalar, Value
from simple_ros.parameters.watching import ParameterWatch, WatchCallback

__all__ = ["NOTHING", "DeclaredParameters", "ParameterFace", "parameters_of"]

NOTHING: Any = object()
"""No default."""


class DeclaredParameters(Mapping[str, Any]):
    """Present values of the parameters that a node declared, to read without waiting.

    Names may be written as everywhere in the node: ``parameters["~gain"]``.
    """

    def __init__(self, parameters: NodeParameters) -> None:
        self._parameters = parameters

    def __getitem__(self, name: str) -> Any:
        full = self._parameters.resolve(name)
        if full not in self._parameters.own:
            raise UnknownParameter(full, "this node has not declared it")
        return self._parameters.own[full].value

    def __iter__(self) -> Iterator[str]:
        return iter([own.spelling for own in self._parameters.own])

    def __len__(self) -> int:
        return len(self._parameters.own)

    def __repr__(self) -> str:
        return f"<DeclaredParameters {dict(self)}>"


class ParameterFace:
    """Parameters of a node, as part of `NodeHandle`.

    Names: ``~gain`` is the node's own, ``gain`` is in the node's namespace, ``/gain`` is global.
    """

    _parameters: NodeParameters

    @property
    def parameters(self) -> DeclaredParameters:
        """What this node declared, as it is now, by the names it declared it under."""
        return DeclaredParameters(self._parameters)

    async def declare_parameter(
        self,
        name: str,
        default: Any,
        *,
        type: str = "",  # noqa: A002
        description: str = "",
        minimum: float | None = None,
        maximum: float | None = None,
        step: float | None = None,
        choices: Sequence[Scalar] = (),
        read_only: bool = False,
    ) -> Any:
        """Declare a parameter and return its value; waits for a Master.

        The value is the first there is of: what the command line, launch or a parameter file says;
        what somebody has set on the Master; the default. To declare it twice in the same way is fine.

        Args:
            name: ``~gain`` for one of the node's own.
            default: Its type is the parameter's: bool, int, float, str, bytes, or a list of these.
            type: The type in words, such as ``"float[]"``, where the default does not tell.
            description: For people; one line.
            minimum: Least value (of each number of a list).
            maximum: Greatest value.
            step: Values are so far apart, counted from the minimum.
            choices: The only values there are.
            read_only: Nobody may set it once it is declared.

        Raises:
            InvalidName: The name breaks the rules.
            ParameterTypeMismatch: The value it is to have is of another type.
            ParameterOutOfRange: The value it is to have is not allowed.
            ParameterConflict: The declaration contradicts itself, or another one.
            HandleClosed: The node is closed.
        """
        said = Descriptor(type, description, minimum, maximum, step, tuple(choices), read_only)
        return await self._parameters.declare(name, default, said)

    async def get_parameter(self, name: str, default: Any = NOTHING) -> Any:
        """The value of a parameter: one of the node's own at once, another one from the Master.

        Args:
            name: Of the parameter; that of a group gives a dict.
            default: What to return if there is none.

        Raises:
            UnknownParameter: There is none, and no default.
            MasterUnavailable: Nobody answers.
            ForeignMaster: It is another node's, and the Master a C++ one.
        """
        try:
            return await self._parameters.get(name)
        except UnknownParameter:
            if default is NOTHING:
                raise
            return default

    async def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Set parameters of any node, all or none; the nodes that declared them may refuse.

        Args:
            values: By name; a dict as value is a group.

        Raises:
            ParameterTypeMismatch: A declared type is another.
            ParameterOutOfRange: A declaration does not allow the value.
            ParameterReadOnly: One is declared read-only.
            ParameterRefused: A node that declared one refuses, or did not answer within 2 s.
            ParameterConflict: A name is that of a group, or within a parameter.
            MasterUnavailable: Nobody answers.
            ForeignMaster: One is not declared by this node, and the Master a C++ one.
        """
        await self._parameters.set(self._parameters.planned(values))

    async def has_parameter(self, name: str) -> bool:
        """Whether there is a parameter or a group of that name."""
        return await self._parameters.has(name)

    async def list_parameters(self, prefix: str = "") -> list[str]:
        """Full names of all parameters in a group: ``~`` for the node's own, ``""`` for all."""
        return await self._parameters.names(prefix)

    async def describe_parameter(self, name: str) -> ParameterInfo:
        """Value, origin and declaration of a parameter.

        Raises:
            UnknownParameter: There is none of that name.
        """
        return await self._parameters.describe(name)

    async def delete_parameter(self, name: str) -> None:
        """Delete a parameter or a group, also of what this node declared.

        Raises:
            UnknownParameter: There is none of that name.
            ParameterConflict: Another node that lives declares it.
        """
        await self._parameters.delete(name)

    async def watch_parameters(
        self, prefix: str = "", callback: WatchCallback | None = None
    ) -> ParameterWatch:
        """Follow the parameters of a group; returns when the Master has told what there is.

        Args:
            prefix: A group or a parameter; ``~`` for the node's own, ``""`` for all.
            callback: Called with a `ParameterChanged` for each that is there and each change; plain
                or a coroutine function. None leaves them to ``async for change in watch``.

        Raises:
            ForeignMaster: It is a C++ Master.
        """
        return await self._parameters.watch(prefix, callback)

    def on_set_parameters(self, callback: SetCallback) -> None:
        """Let a callback judge new values before they are set, whoever sets them.

        Args:
            callback: Given the new values by name, as this node declared them; plain or a coroutine
                function. It refuses them by returning a reason or False, or by raising. It only
                judges: other nodes may still refuse the group.
        """
        self._parameters.judge_with(callback)

    def on_parameter_changed(self, name: str, callback: Callable[[Value], Any]) -> None:
        """Call with the value of a declared parameter when it is declared and whenever it changes.

        Args:
            name: Of the parameter; it may be declared later.
            callback: Plain or a coroutine function.
        """
        self._parameters.hook(name, callback)


def parameters_of(node: ParameterFace) -> NodeParameters:
    """What carries out these calls, for the blocking face."""
    return node._parameters
