"""Round trips of the programs themselves: a heartbeat on one topic that comes back on another.

The kernel times its own acknowledgements; what a heartbeat takes includes the queues of both programs. It is
timed by the steady clock of who asks, so clocks of hosts need not agree.
"""

from __future__ import annotations

import re
import socket
import time
from typing import ClassVar

from simple_ros.engine import Engine
from simple_ros.msg.wireless_ros_msgs import Heartbeat
from simple_ros.node import NodeHandle
from simple_ros.qos import QosProfile, Reliability

__all__ = ["HeartbeatAsker", "HeartbeatEcho", "answer_heartbeats"]

_QUESTIONS = "/wireless_ros/heartbeat"
_ANSWERS = "/wireless_ros/heartbeat_echo"
# One that waits in a queue would tell of the past.
_QOS = QosProfile(depth=1, reliability=Reliability.BEST_EFFORT)


async def answer_heartbeats(node: NodeHandle) -> None:
    """Send back each heartbeat of other nodes, as long as the node lives."""
    answers = await node.advertise(_ANSWERS, Heartbeat, qos=_QOS)

    def asked(message: Heartbeat) -> None:
        if message.sender != node.name:
            answer = Heartbeat()
            answer.CopyFrom(message)
            answer.responder, answer.responder_host = node.name, node.ip
            answers.publish(answer)

    await node.subscribe(_QUESTIONS, Heartbeat, asked, qos=_QOS)


class HeartbeatEcho(Engine):
    """Sends heartbeats back from a host that has no other engine."""

    node_name: ClassVar[str] = "wireless_ros/heartbeat_echo_" + re.sub(
        r"\W", "_", socket.gethostname()
    )
    summary: ClassVar[str] = "Sends heartbeats back, for a host that has no other engine."

    async def run(self, node: NodeHandle) -> None:
        """Answer until cancelled or the node ends."""
        await answer_heartbeats(node)
        await node.spin()


class HeartbeatAsker:
    """Asks, and keeps how long the answers took.

    Args:
        period_s: Between questions.
    """

    def __init__(self, period_s: float = 0.5) -> None:
        self._period_s = period_s
        self._seq = 0
        self._newest: dict[str, float] = {}

    async def attach(self, node: NodeHandle) -> None:
        """Begin to ask, as long as the node lives."""
        questions = await node.advertise(_QUESTIONS, Heartbeat, qos=_QOS)

        def ask() -> None:
            message = Heartbeat(sender=node.name, sent_ns=time.monotonic_ns())
            message.header.seq = self._seq
            message.header.stamp.FromNanoseconds(node.clock.now().nanoseconds)
            self._seq = (self._seq + 1) & 0xFFFFFFFF
            questions.publish(message)

        def answered(message: Heartbeat) -> None:
            if message.sender == node.name:
                taken_ms = (time.monotonic_ns() - message.sent_ns) / 1e6
                self._newest[message.responder_host] = taken_ms

        await node.subscribe(_ANSWERS, Heartbeat, answered, qos=_QOS)
        node.create_timer(self._period_s, lambda _: ask())

    def take(self) -> dict[str, float]:
        """The newest round trip of each host that answered since this was asked the last time, ms."""
        taken, self._newest = self._newest, {}
        return taken
