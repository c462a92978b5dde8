"""What the publishers of a topic offer, as the Master knows it."""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros.net.master_client import MasterClient, TopicNotFound
from simple_ros.qos import Liveliness, QosProfile, Reliability, weakest
from simple_ros.rpc.convert import qos_from_proto
from simple_ros_engines.network_exposure.requirement import FlowProfile

__all__ = ["Offered", "offered_by"]


@dataclass(frozen=True, slots=True)
class Offered:
    """What all of them offer at least.

    Attributes:
        qos: As a profile.
    """

    qos: QosProfile

    @property
    def relayed(self) -> QosProfile:
        """The same for who hands the messages on: the lease stays with who makes them."""
        return self.qos.replace(liveliness=Liveliness.AUTOMATIC, liveliness_lease_s=None)

    def profile(self, budget_ms: float) -> FlowProfile:
        """What the topic needs by that, with a latency budget (0 for none)."""
        qos = self.qos
        return FlowProfile(
            qos.reliability is Reliability.RELIABLE,
            1000 * (qos.deadline_s or 0.0),
            1000 * (qos.lifespan_s or 0.0),
            1000 * (qos.liveliness_lease_s or 0.0),
            budget_ms,
        )


async def offered_by(client: MasterClient, topic: str) -> Offered:
    """What the publishers of a topic offer; the default if none says so.

    Raises:
        MasterUnavailable: Nobody answers.
    """
    try:
        known = await client.get_topic_info(topic)
    except TopicNotFound:
        return Offered(QosProfile())
    offers = [
        qos_from_proto(node.endpoint.qos)
        for node in known.publishers
        if node.HasField("endpoint") and node.endpoint.HasField("qos")
    ]
    return Offered(_least(offers) if offers else QosProfile())


def _least(offers: list[QosProfile]) -> QosProfile:
    """The least of each policy; messages live as long as those that live longest."""
    lifespans = [offer.lifespan_s for offer in offers]
    longest = None if None in lifespans else max(filter(None, lifespans), default=None)
    return weakest(offers).replace(lifespan_s=longest)
