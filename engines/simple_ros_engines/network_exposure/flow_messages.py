"""Flows and what is known of them, to and from messages. Pure."""

from __future__ import annotations

from simple_ros.msg.network_exposure_msgs import Locator, UniqueTopicFlow, UniqueTopicFlowStat
from simple_ros_engines.network_exposure.exposure.model import FiveTuple
from simple_ros_engines.network_exposure.requirement import FlowProfile
from simple_ros_engines.network_exposure.statistics import Traffic

__all__ = ["five_tuple", "flow_message", "locator", "profile_of", "traffic_of"]

_KINDS = {
    ("UDP", False): Locator.UDPV4,
    ("UDP", True): Locator.UDPV6,
    ("TCP", False): Locator.TCPV4,
    ("TCP", True): Locator.TCPV6,
}
_UDP = (Locator.UDPV4, Locator.UDPV6)


def locator(protocol: str, address: str, port: int) -> Locator:
    """One end of a flow."""
    return Locator(kind=_KINDS[protocol, ":" in address], address=address, port=port)


def flow_message(
    message: UniqueTopicFlow, flow: FiveTuple, profile: FlowProfile
) -> UniqueTopicFlow:
    """The same message, with its flow and its profile filled in."""
    message.source.CopyFrom(locator(flow.protocol, flow.source_ip, flow.source_port))
    message.destination.CopyFrom(locator(flow.protocol, flow.destination_ip, flow.destination_port))
    message.is_reliable = profile.is_reliable
    message.deadline_ms = profile.deadline_ms
    message.lifespan_ms = profile.lifespan_ms
    message.lease_ms = profile.lease_ms
    message.latency_budget_ms = profile.budget_ms
    return message


def five_tuple(message: UniqueTopicFlow) -> FiveTuple:
    """Of a flow."""
    source, destination = message.source, message.destination
    protocol = "UDP" if source.kind in _UDP else "TCP"
    return FiveTuple(protocol, source.address, source.port, destination.address, destination.port)


def profile_of(message: UniqueTopicFlow) -> FlowProfile:
    """What the topic of a flow needs by its QoS."""
    return FlowProfile(
        message.is_reliable,
        message.deadline_ms,
        message.lifespan_ms,
        message.lease_ms,
        message.latency_budget_ms,
    )


def traffic_of(message: UniqueTopicFlowStat) -> Traffic:
    """What a topic sends."""
    return Traffic(
        message.window_duration_s,
        round(message.window_rate * message.window_duration_s),
        round(message.window_bandwidth * message.window_duration_s),
        message.window_rate,
        message.window_bandwidth,
        message.window_average_delta,
        message.window_jitter,
    )
