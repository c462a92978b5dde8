"""What camera and lidar have in common: a topic in, the same made smaller out."""

from __future__ import annotations

import asyncio
import math
import time
from abc import abstractmethod
from typing import Any, ClassVar

from google.protobuf.message import DecodeError, Message

from simple_ros.msg.wireless_ros_msgs import Constraint
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros_engines.cross_domain.adaptation import RateGate
from simple_ros_engines.cross_domain.treatment import FlowBudget, Treatment, TreatmentJudge
from simple_ros_hub.cells.topic_cell import TopicCell

__all__ = ["SensorCell"]

_FULL_HZ = 30.0
"""Taken for the rate of a source that nothing limits, to halve it."""


class SensorCell(TopicCell):
    """Hands messages of a sensor on, at the rate and size that its link's constraint and budget ask for.

    With full resolution the bytes go on untouched. Further parameters: ``source``, ``sink`` (topics), ``dwell``
    (s that the link must have been better before more is sent).

    Attributes:
        message_class: Of the source, and of what goes on untouched.
        source: Topic, unless the parameter says otherwise.
        sink: The same for what goes out.
    """

    message_class: ClassVar[type[Message]]
    source: ClassVar[str]
    sink: ClassVar[str]

    def __init__(self) -> None:
        super().__init__()
        self.judge = TreatmentJudge()
        self.flow = FlowBudget()
        self.malformed = 0
        self._rate = RateGate()
        self._publisher: Publisher[Any] | None = None
        self._busy = False

    @property
    def treatment(self) -> Treatment:
        """What is done to messages."""
        return self.judge.treatment

    async def set_up(self, node: NodeHandle) -> None:
        """Join source and sink."""
        get = node.declare_parameter
        source = str(await get("~source", self.source, read_only=True))
        sink = str(await get("~sink", self.sink, read_only=True))
        self.judge = TreatmentJudge(
            float(await get("~dwell", 2.0, minimum=0, maximum=60, read_only=True))
        )
        self._publisher = await self.advertise(node, sink)
        await node.subscribe(source, self.message_class.DESCRIPTOR.full_name, self._took, raw=True)

    async def advertise(self, node: NodeHandle, sink: str) -> Publisher[Any]:
        """The publisher of what goes out."""
        return await node.advertise(sink, self.message_class)

    def _on_constraint(self, constraint: Constraint) -> None:
        self.judge.constraint(constraint.resolution_scale, constraint.frame_rate, time.monotonic())

    def _rate_hz(self) -> float:
        """Messages a second, 0 for all."""
        rate = self.budget.bytes_per_s
        self.flow.rate_bps = 8 * rate if rate else math.inf
        hz = self.flow.rate_hz(self.treatment.rate_hz)
        if self.budget.rate_factor < 1:
            hz = min(hz, _FULL_HZ) * self.budget.rate_factor
        return 0.0 if math.isinf(hz) else hz

    async def _took(self, data: bytes) -> None:
        now_s = time.monotonic()
        self.came(len(data))
        self.flow.came(now_s)
        assert self._publisher is not None
        if not self._publisher.subscriber_count:
            return
        self._rate.rate_hz = self._rate_hz()
        may_go = self.budget.allows(self.priority) and not self._busy and self._rate.passes(now_s)
        if not may_go:
            self.held_back += 1
            return
        self._busy = True
        try:
            # Pixels and points take their time, and signs of life must not wait for them.
            is_quick = self.is_untouched
            smaller = (
                self.execute(data) if is_quick else await asyncio.to_thread(self.execute, data)
            )
        finally:
            self._busy = False
        if smaller is not None:
            self.flow.sent(len(smaller))
            self.send(self._publisher, smaller)

    @property
    def is_untouched(self) -> bool:
        """Whether bytes go on as they came."""
        return self.treatment.is_untouched

    def _execute(self, data: bytes) -> bytes | None:
        """A message made smaller as far as it must be; None if it is malformed."""
        if self.is_untouched:
            return data
        try:
            return self.shrink(data, self.treatment.scale)
        except DecodeError:
            self.malformed += 1
            return None

    @abstractmethod
    def shrink(self, data: bytes, percent: float) -> bytes | None:
        """A message with that share of its resolution; None if there is nothing to send.

        Raises:
            DecodeError: It is none.
        """
