"""Parameters of the blocking face."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from types import MappingProxyType
from typing import Any, Self

from simple_ros.callbacks import is_async
from simple_ros.errors import HandleClosed
from simple_ros.executor import Executor
from simple_ros.net.loop import BackgroundLoop
from simple_ros.node import NodeHandle as AsyncNodeHandle
from simple_ros.parameters.convert import ParameterInfo
from simple_ros.parameters.face import NOTHING, DeclaredParameters, parameters_of
from simple_ros.parameters.feed import ParameterChanged
from simple_ros.parameters.local import SetCallback
from simple_ros.parameters.values import Scalar, Value
from simple_ros.parameters.watching import ParameterWatch as AsyncParameterWatch

__all__ = ["ParameterMethods", "ParameterWatch"]


class ParameterWatch:
    """Tells what parameters there are in a group, and every change. Made by `NodeHandle.watch_parameters`."""

    def __init__(self, loop: BackgroundLoop, watch: AsyncParameterWatch) -> None:
        self._loop = loop
        self._watch = watch

    @property
    def prefix(self) -> str:
        """Full name of the group; empty for all."""
        return self._watch.prefix

    @property
    def values(self) -> MappingProxyType[str, Value]:
        """The parameters as last told, by full name."""
        return MappingProxyType(dict(self._watch.values))

    @property
    def errors(self) -> int:
        """Exceptions of the callback so far."""
        return self._watch.errors

    def receive(self, timeout: float | None = None) -> ParameterChanged:
        """The next change (of a watch without callback).

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
            HandleClosed: The watch is closed.
        """
        return self._loop.run(self._watch.receive(timeout))

    def __iter__(self) -> Iterator[ParameterChanged]:
        """Changes until the watch is closed."""
        while True:
            try:
                change = self.receive()
            except HandleClosed:
                return
            yield change

    def close(self) -> None:
        """Watch no more."""
        self._loop.run(self._watch.close())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class ParameterMethods:
    """Part of `BlockingNode`; see `simple_ros.aio.NodeHandle` for what each does."""

    _loop: BackgroundLoop
    _executor: Executor
    _node: AsyncNodeHandle

    @property
    def parameters(self) -> DeclaredParameters:
        """What this node declared, as it is now, by the names it declared it under."""
        return self._node.parameters

    def declare_parameter(
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
        """Declare a parameter and return its value; waits for a Master."""
        return self._loop.run(
            self._node.declare_parameter(
                name,
                default,
                type=type,
                description=description,
                minimum=minimum,
                maximum=maximum,
                step=step,
                choices=choices,
                read_only=read_only,
            )
        )

    def get_parameter(self, name: str, default: Any = NOTHING) -> Any:
        """The value of a parameter: one of the node's own at once, another one from the Master."""
        if name in self.parameters:
            return self.parameters[name]
        return self._loop.run(self._node.get_parameter(name, default))

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Set parameters of any node, all or none; callbacks of this node are asked in this thread."""
        parameters = parameters_of(self._node)
        planned = parameters.planned(values)
        parameters.judge_here(planned)
        self._loop.run(parameters.set(planned, judged=True))

    def has_parameter(self, name: str) -> bool:
        """Whether there is a parameter or a group of that name."""
        return self._loop.run(self._node.has_parameter(name))

    def list_parameters(self, prefix: str = "") -> list[str]:
        """Full names of all parameters in a group: ``~`` for the node's own, ``""`` for all."""
        return self._loop.run(self._node.list_parameters(prefix))

    def describe_parameter(self, name: str) -> ParameterInfo:
        """Value, origin and declaration of a parameter."""
        return self._loop.run(self._node.describe_parameter(name))

    def delete_parameter(self, name: str) -> None:
        """Delete a parameter or a group, also of what this node declared."""
        self._loop.run(self._node.delete_parameter(name))

    def watch_parameters(
        self, prefix: str = "", callback: Callable[[ParameterChanged], object] | None = None
    ) -> ParameterWatch:
        """Follow the parameters of a group; a callback is called in a thread that spins."""
        handed = None if callback is None else self._awaited_there(callback)
        watch = self._loop.run(self._node.watch_parameters(prefix, handed))
        return ParameterWatch(self._loop, watch)

    def on_set_parameters(self, callback: SetCallback) -> None:
        """Let a callback judge new values before they are set, in a thread that spins.

        What this node sets itself is judged in the thread that does. While nobody spins, what others
        set is refused after 2 s.
        """
        if is_async(callback):
            raise TypeError("the blocking face takes plain callbacks, not coroutine functions")
        parameters_of(self._node).judge_with(self._awaited_there(callback), here=callback)

    def on_parameter_changed(self, name: str, callback: Callable[[Value], object]) -> None:
        """Call with the value of a declared parameter now and when it changes, in a thread that spins."""

        def hand_over(value: Value) -> None:
            self._executor.call_soon(lambda: callback(value))

        self._loop.run(self._hook(name, hand_over))

    async def _hook(self, name: str, callback: Callable[[Value], object]) -> None:
        self._node.on_parameter_changed(name, callback)

    def _awaited_there(self, callback: Callable[[Any], Any]) -> Callable[[Any], Awaitable[Any]]:
        """The same callback, called in a thread that spins and awaited on the loop."""

        async def call(item: Any) -> Any:
            future: Future[Any] = Future()

            def run() -> None:
                if future.set_running_or_notify_cancel():
                    try:
                        future.set_result(callback(item))
                    except Exception as error:
                        future.set_exception(error)

            self._executor.call_soon(run)
            return await asyncio.wrap_future(future)

        return call
