"""What a source of metrics is.

Sources are entry points in the group ``simple_ros.metrics_sources``; the Radio Information Engine makes the
one its parameter names, with its options.
"""

from __future__ import annotations

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from simple_ros import plugins
from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.node import NodeHandle
from simple_ros_engines.radio_information.record import LinkRecord

__all__ = ["GROUP", "Emit", "MetricsSource", "SourceDown", "make_source", "options_with_defaults"]

GROUP = "simple_ros.metrics_sources"
Emit = Callable[[LinkRecord], None]


class SourceDown(ConnectionError):
    """A source gives nothing now; it is tried again."""


class MetricsSource(ABC):
    """Gives records until it is cancelled.

    Attributes:
        summary: What it reads, in one line.
        period_s: How often it gives a record of each link.
        malformed: What it was given and could not read.
        live: Whether its records tell of the present; else their age means nothing.
        may_be_silent: Whether no record at all is in order, as where there is no link.
    """

    summary: ClassVar[str]
    period_s: float = 1.0
    malformed: int = 0
    live: bool = True
    may_be_silent: bool = False

    async def attach(self, node: NodeHandle) -> None:  # noqa: B027
        """The engine's node, before `run`: for sources that talk to other nodes.

        Args:
            node: Started; closed by the engine's caller.
        """

    async def discover(self) -> frozenset[str] | None:
        """Links heard of in the last minute, whether or not they say anything now.

        Returns:
            None if the source cannot tell more than its records do; it is then not asked again.

        Raises:
            SourceDown: Nothing comes at present.
        """
        return None

    @abstractmethod
    async def run(self, emit: Emit) -> None:
        """Give records.

        Args:
            emit: Takes each.

        Raises:
            SourceDown: Nothing comes at present; the engine waits and calls again.
        """


def options_with_defaults(name: str) -> dict[str, Any]:
    """Options of a source that can be parameters, with their defaults; one that must be given has "".

    A default of ``()`` is a list of integers.

    Raises:
        UnknownPlugin: No installed package offers it.
        BrokenPlugin: It cannot be imported.
    """
    try:
        signature = inspect.signature(plugins.load(GROUP, name))
    except (TypeError, ValueError):
        return {}
    found = {}
    for option in signature.parameters.values():
        if option.kind in (option.POSITIONAL_OR_KEYWORD, option.KEYWORD_ONLY):
            default = "" if option.default is option.empty else option.default
            if default == () or isinstance(default, bool | int | float | str):
                found[option.name] = default
    return found


def make_source(name: str, options: Mapping[str, Any]) -> MetricsSource:
    """A source by its name.

    Raises:
        UnknownPlugin: No installed package offers it.
        BrokenPlugin: It cannot be imported.
        ConfigError: It does not take these options, or lacks one.
    """
    factory = plugins.load(GROUP, name)
    lacking = [option for option in _needed(factory) if option not in options]
    if lacking:
        raise ConfigError(f"source {name!r} needs the option {lacking[0]!r}")
    try:
        source = factory(**options)
    except SimpleRosError as error:
        raise ConfigError(f"source {name!r}: {error}") from error
    except (TypeError, ValueError, OverflowError) as error:
        raise ConfigError(f"source {name!r} does not take {dict(options)}: {error}") from error
    if not isinstance(source, MetricsSource):
        raise ConfigError(f"source {name!r} is {source!r}, no MetricsSource")
    if not 0 < source.period_s < math.inf:
        raise ConfigError(f"source {name!r}: period_s is {source.period_s}, must be more than 0")
    return source


def _needed(factory: Callable[..., Any]) -> list[str]:
    """Options without a default."""
    try:
        options = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):
        return []
    named = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [item.name for item in options if item.kind in named and item.default is item.empty]
