"""What a publisher or subscription reports besides messages, named as in ROS 2."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

__all__ = [
    "DeadlineMissed",
    "IncompatibleQos",
    "LivelinessChanged",
    "QosEvent",
    "QosEventCallback",
    "TypeConflict",
]


@dataclass(frozen=True, slots=True)
class DeadlineMissed:
    """No message within the deadline; ``total`` counts whole periods since the start."""

    topic: str
    deadline_s: float
    total: int


@dataclass(frozen=True, slots=True)
class LivelinessChanged:
    """A topic's publishers came to life (``alive``) or the last sign of life is too old."""

    topic: str
    alive: bool


@dataclass(frozen=True, slots=True)
class IncompatibleQos:
    """A publisher offers less than a subscription requests; no messages flow between them."""

    topic: str
    publisher: str
    subscriber: str
    policies: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TypeConflict:
    """Another node uses another message type on the topic; no messages flow between them."""

    topic: str
    node: str
    msg_type: str


QosEvent = DeadlineMissed | LivelinessChanged | IncompatibleQos | TypeConflict
QosEventCallback = Callable[[QosEvent], None]
