"""What a topic needs, from its own QoS and from what it sends. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.qci import (
    AVERAGING_WINDOW_MS,
    ResourceType,
    qos_class,
)
from simple_ros_engines.network_exposure.qos_mapper import (
    MapperSettings,
    Requirement,
    Selection,
    select,
)
from simple_ros_engines.network_exposure.statistics import Traffic

__all__ = ["Advice", "FlowMapper", "FlowProfile", "delay_needed_ms", "wire_bandwidth"]

_LEAST_HZ = 1e-3
_PACKET_BYTES = 1400
_HEADER_BYTES = 100
"""IP, TCP and our frame, generously: a reserved rate has to carry them too."""


@dataclass(frozen=True, slots=True)
class FlowProfile:
    """What a topic's publisher offers, and what was said about the topic. Times of 0 are not set.

    Attributes:
        is_reliable: Whether messages must not be lost.
        deadline_ms: Longest time between two messages.
        lifespan_ms: Age after which a message is worth nothing.
        lease_ms: Of its liveliness.
        budget_ms: Latency budget said explicitly.
    """

    is_reliable: bool = True
    deadline_ms: float = 0.0
    lifespan_ms: float = 0.0
    lease_ms: float = 0.0
    budget_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class Advice:
    """What a policy asks for instead of what was measured. Numbers of 0 leave it as it is.

    Attributes:
        budget_ms: Latency budget.
        error_rate: Largest share of lost packets.
        qci: This class, whatever is needed.
        ends_s: When it ends by itself, unless it is said again: who gave it may be dead.

    Raises:
        ConfigError: A number makes no sense.
    """

    budget_ms: float = 0.0
    error_rate: float = 0.0
    qci: int = 0
    ends_s: float = math.inf

    def __post_init__(self) -> None:
        if not 0 <= self.budget_ms < math.inf:
            raise ConfigError(f"latency_budget_ms must be a number of ms, not {self.budget_ms:g}")
        if not 0 <= self.error_rate < 1:
            raise ConfigError(f"error_rate must be 0 to 1, not {self.error_rate:g}")


def delay_needed_ms(rate_hz: float, profile: FlowProfile, budget_ms: float = 0.0) -> float:
    """Longest delay: the time between messages, or the budget instead; never above lifespan and deadline."""
    wanted = budget_ms or profile.budget_ms or 1000 / max(_LEAST_HZ, rate_hz)
    limits = (profile.lifespan_ms, profile.deadline_ms)
    return min([wanted, *(limit for limit in limits if limit > 0)])


class FlowMapper:
    """Maps one flow, window after window.

    Args:
        settings: How it judges.
    """

    def __init__(self, settings: MapperSettings | None = None) -> None:
        self._settings = settings or MapperSettings()
        self._closed_s: float | None = None
        self._rate_hz = 0.0
        self._windows = 0
        self._steady = False

    def look(
        self,
        traffic: Traffic,
        burst_bytes: int,
        profile: FlowProfile,
        now_s: float,
        advice: Advice | None = None,
    ) -> Selection | None:
        """What to ask for, given what was sent lately; None while too little is known.

        Args:
            traffic: Of the window that ends now.
            burst_bytes: Most bytes within the delay that is needed.
            profile: Of the topic.
            now_s: The time.
            advice: Goes before what was measured.
        """
        if traffic.duration_s < self._settings.min_window_s or traffic.rate_hz <= 0:
            return None
        self._close_window(traffic.rate_hz, now_s)
        if self._windows < 2:
            return None
        told = advice or Advice()
        needed = self._requirement(traffic, burst_bytes, profile, told)
        chosen = select(needed, self._settings)
        asked = qos_class(told.qci) if told.qci else None
        if asked is not None:
            chosen = Selection(asked, (), needed)
        return replace(chosen, warnings=self._warnings(traffic, profile, told))

    def _close_window(self, rate_hz: float, now_s: float) -> None:
        if self._closed_s is not None and now_s - self._closed_s < self._settings.min_window_s:
            return
        if self._closed_s is not None:
            change = abs(rate_hz - self._rate_hz) / max(_LEAST_HZ, self._rate_hz)
            settings = self._settings
            limit = settings.unsteady if self._steady and self._windows > 1 else settings.steady
            self._steady = change < limit
        self._closed_s, self._rate_hz = now_s, rate_hz
        self._windows += 1

    def _requirement(
        self, traffic: Traffic, burst_bytes: int, profile: FlowProfile, told: Advice
    ) -> Requirement:
        settings = self._settings
        errors = (
            settings.reliable_error_rate if profile.is_reliable else settings.best_effort_error_rate
        )
        return Requirement(
            ResourceType.GBR if self._steady else ResourceType.NON_GBR,
            delay_needed_ms(traffic.rate_hz, profile, told.budget_ms),
            told.error_rate or errors,
            burst_bytes,
            8 * wire_bandwidth(traffic),
        )

    def _warnings(self, traffic: Traffic, profile: FlowProfile, told: Advice) -> tuple[str, ...]:
        warnings = []
        interval_ms = 1000 / traffic.rate_hz
        if 0 < profile.lifespan_ms < interval_ms:
            warnings.append(
                f"lifespan {profile.lifespan_ms:g} ms is shorter than the {interval_ms:.0f} ms between "
                "messages: they expire before the next one comes"
            )
        if 0 < profile.deadline_ms < interval_ms:
            warnings.append(
                f"deadline {profile.deadline_ms:g} ms is shorter than the {interval_ms:.0f} ms between messages"
            )
        if 1000 * traffic.duration_s < AVERAGING_WINDOW_MS:
            warnings.append(
                f"measured over {1000 * traffic.duration_s:.0f} ms, less than the {AVERAGING_WINDOW_MS} ms "
                "over which networks average"
            )
        if told.qci and qos_class(told.qci) is None:
            warnings.append(f"advice names QCI {told.qci}, which the tables do not have")
        return tuple(warnings)


def wire_bandwidth(traffic: Traffic) -> float:
    """Bytes a second with the headers that go with each message."""
    if traffic.rate_hz <= 0:
        return traffic.bandwidth
    packets = max(1, math.ceil(traffic.bandwidth / traffic.rate_hz / _PACKET_BYTES))
    return traffic.bandwidth + traffic.rate_hz * packets * _HEADER_BYTES
