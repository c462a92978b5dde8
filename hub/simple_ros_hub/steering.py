"""Setting parameters of the engines as the global policy says."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Mapping
from typing import Any

from simple_ros.errors import SimpleRosError
from simple_ros.node import NodeHandle
from simple_ros_hub.breaker import CircuitBreaker
from simple_ros_hub.components import NAMESPACE
from simple_ros_hub.policy import POLICY_PARAMETERS, changes_for

__all__ = ["Steering"]

_NAMED: dict[str, set[str]] = {}
for _sets in POLICY_PARAMETERS.values():
    for _engine, _values in _sets.items():
        _NAMED.setdefault(_engine, set()).update(_values)


class Steering:
    """Brings engines to what a policy wants, and back to what they were without it.

    An engine that does not answer is left alone for a while, longer each time.

    Args:
        node: The hub's node.
        base: Values without a policy, by engine, as an earlier hub knew them.
        on_trouble: Called with engine and text; with an empty text when it is over.
    """

    def __init__(
        self,
        node: NodeHandle,
        base: Mapping[str, Mapping[str, Any]],
        on_trouble: Callable[[str, str], None],
    ) -> None:
        self.base: dict[str, dict[str, Any]] = {name: dict(known) for name, known in base.items()}
        self._ours: dict[str, dict[str, Any]] = {}
        self._node = node
        self._on_trouble = on_trouble
        self._breakers: dict[str, CircuitBreaker] = {}
        self._busy = asyncio.Lock()

    def parameters(self, policy: str) -> list[tuple[str, str]]:
        """What a policy sets, as JSON objects by engine."""
        return [(name, json.dumps(values)) for name, values in POLICY_PARAMETERS[policy].items()]

    async def apply(self, policy: str, engines: list[str]) -> bool:
        """Set what differs, at those engines; whether all is set now."""
        async with self._busy:
            done = [await self._apply(policy, engine) for engine in engines if engine in _NAMED]
        return all(done)

    async def _apply(self, policy: str, engine: str) -> bool:
        breaker = self._breakers.setdefault(engine, CircuitBreaker(2, 1.0))
        if not breaker.allows(time.monotonic()):
            return False
        try:
            await self._set(policy, engine)
        except SimpleRosError as error:
            text = " ".join(str(error).split())
            if breaker.failed(time.monotonic(), text):
                self._on_trouble(engine, f"{engine} does not take policy {policy}: {text}")
            return False
        if breaker.succeeded():
            self._on_trouble(engine, "")
        return True

    async def _set(self, policy: str, engine: str) -> None:
        group = f"/{NAMESPACE}/{engine}"
        now = dict(await self._node.get_parameter(group, {}))
        if engine not in self.base:
            self.base[engine] = {name: now[name] for name in _NAMED[engine] if name in now}
        # What is not as it was set here, somebody chose meanwhile: that is what to come back to.
        for name, value in self._ours.get(engine, {}).items():
            if now.get(name, value) != value:
                self.base[engine][name] = now[name]
        changes = changes_for(policy, engine, self.base[engine], now)
        if changes:
            await self._node.set_parameters({f"{group}/{key}": v for key, v in changes.items()})
        self._ours[engine] = {**self.base[engine], **POLICY_PARAMETERS[policy].get(engine, {})}
        if not POLICY_PARAMETERS[policy].get(engine):
            # Nothing is overruled now: what somebody sets from here on is what to come back to.
            del self.base[engine], self._ours[engine]
