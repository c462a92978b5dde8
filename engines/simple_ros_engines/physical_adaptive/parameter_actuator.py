"""An actuator for nodes that know nothing of strategies: it sets parameters they declared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar

from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.node import NodeHandle
from simple_ros_engines.physical_adaptive.actuators import Applied
from simple_ros_engines.physical_adaptive.strategy import Strategy

__all__ = ["STRATEGY_FIELDS", "ParameterActuator"]

STRATEGY_FIELDS = sorted(field.name for field in fields(Strategy))


class ParameterActuator:
    """Sets parameters of other nodes, which may refuse.

    Args:
        node: Through which.
        names: By field of `Strategy`: a parameter's name, in which ``{link}`` stands for the link.

    Raises:
        ConfigError: A field is none of a strategy.
    """

    name: ClassVar[str] = "parameters"

    def __init__(self, node: NodeHandle, names: Mapping[str, str]) -> None:
        unknown = sorted(set(names) - set(STRATEGY_FIELDS))
        if unknown:
            raise ConfigError(
                f"{unknown[0]!r} is no field of a strategy; there are {STRATEGY_FIELDS}"
            )
        self._node = node
        self._names = dict(names)

    async def apply(self, link_id: str, strategy: Strategy) -> Applied:
        """Set what has changed; a parameter that no live node declares is not applied."""
        wanted = {
            name.replace("{link}", link_id): getattr(strategy, field)
            for field, name in self._names.items()
        }
        changed: dict[str, Any] = {}
        try:
            for name, value in wanted.items():
                known = await self._node.describe_parameter(name)
                if not known.nodes:
                    return Applied(False, f"no live node declares the parameter {name!r}")
                if known.value != value:
                    changed[name] = value
            if changed:
                await self._node.set_parameters(changed)
        except (SimpleRosError, ConnectionError) as error:
            return Applied(False, f"{type(error).__name__}: {error}")
        return Applied(True, ", ".join(f"{name} = {value}" for name, value in wanted.items()))
