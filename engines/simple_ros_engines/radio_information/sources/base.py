"""What a source of metrics is.

Sources are entry points in the group ``simple_ros.metrics_sources``; the Radio Information Engine makes the
one its parameter names, with its options.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from simple_ros import plugins
from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.record import LinkRecord

__all__ = ["GROUP", "Emit", "MetricsSource", "SourceDown", "make_source"]

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
    """

    summary: ClassVar[str]
    period_s: float = 1.0
    malformed: int = 0

    @abstractmethod
    async def run(self, emit: Emit) -> None:
        """Give records.

        Args:
            emit: Takes each.

        Raises:
            SourceDown: Nothing comes at present; the engine waits and calls again.
        """


def make_source(name: str, options: Mapping[str, Any]) -> MetricsSource:
    """A source by its name.

    Raises:
        UnknownPlugin: No installed package offers it.
        BrokenPlugin: It cannot be imported.
        ConfigError: It does not take these options.
    """
    factory = plugins.load(GROUP, name)
    try:
        source = factory(**options)
    except TypeError as error:
        raise ConfigError(f"source {name!r} does not take {dict(options)}: {error}") from error
    if not isinstance(source, MetricsSource):
        raise ConfigError(f"source {name!r} is {source!r}, no MetricsSource")
    return source
