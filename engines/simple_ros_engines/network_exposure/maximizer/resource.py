"""What a request costs the network. Pure.

The measure is the capacity that a queue needs so that a message is later than the delay budget no more often than the
error rate allows. With messages that come at random at rate r, of random lengths with mean L bits (M/M/1), the share that takes
longer than T is exp(-(m - r) T) when m of them can be served a second; so ``m = r + ln(1/e) / T`` and the capacity is L m.
It is a model, not what an operator would bill; what it is used for are ratios of two requests of the same topic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from simple_ros_engines.network_exposure.maximizer.knobs import Setting
from simple_ros_engines.network_exposure.qci import ResourceType
from simple_ros_engines.network_exposure.qos_mapper import Requirement, Selection, select

__all__ = ["TopicTraffic", "capacity_bps", "request_of", "requested_bps"]

_LEAST_HZ = 1e-3


@dataclass(frozen=True, slots=True)
class TopicTraffic:
    """What a topic sends when nothing is left out.

    Attributes:
        rate_hz: Messages a second.
        size_bytes: Of one, on the wire.
        error_rate: That its reliability requires.
    """

    rate_hz: float
    size_bytes: float
    error_rate: float


def request_of(traffic: TopicTraffic, setting: Setting) -> Selection:
    """What the mapper asks for when a topic stands so: the delay it bears is its budget."""
    rate_hz = max(_LEAST_HZ, traffic.rate_hz * (1 - setting.drop_rate))
    return select(
        Requirement(
            ResourceType.GBR,
            setting.delay_ms(traffic.rate_hz) or 1000 / max(_LEAST_HZ, traffic.rate_hz),
            traffic.error_rate,
            math.ceil(traffic.size_bytes),
            8 * rate_hz * traffic.size_bytes,
        )
    )


def requested_bps(traffic: TopicTraffic, setting: Setting, *, by_class: bool) -> float:
    """Capacity in bit/s that the request of a topic costs as it stands.

    Args:
        traffic: Of the topic.
        setting: Of its knobs.
        by_class: By the delay and error rate of the QoS class, which is what the network must keep; else by those
            that are required.
    """
    selection = request_of(traffic, setting)
    needed, chosen = selection.requirement, selection.chosen
    delay_ms, errors = needed.delay_ms, needed.error_rate
    if by_class:
        delay_ms, errors = chosen.delay_ms, chosen.error_rate
    return capacity_bps(needed.bit_rate, traffic.size_bytes, delay_ms, errors)


def capacity_bps(bit_rate: float, size_bytes: float, delay_ms: float, error_rate: float) -> float:
    """Capacity in bit/s that keeps a delay and an error rate; see the module.

    Args:
        bit_rate: bit/s, on average.
        size_bytes: Of a message.
        delay_ms: Budget.
        error_rate: Share that may be later.
    """
    return bit_rate + 8 * size_bytes * math.log(1 / error_rate) * 1000 / delay_ms
