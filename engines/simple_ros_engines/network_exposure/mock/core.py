"""The mock network's mind: admission, bearers that take time, downgrades, recoveries, expiry. Pure; nothing is a radio.

It is told the time and what is asked, and hands out events. Bearers with a reserved bit rate share a capacity. When that
shrinks, the least important lose first: they get the first of their alternatives that fits, without a reserved rate in the
end. When it grows, the most important are served first again.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from simple_ros_engines.network_exposure.qci import QosClass, qos_class

__all__ = ["Admission", "Bearer", "BearerEvent", "BearerState", "MockNetwork", "MockSettings"]

DEFAULT_QCI = 9


class BearerState(Enum):
    """Where a bearer stands."""

    SETTING_UP = "setting up"
    ACTIVE = "active"
    DEGRADED = "degraded"
    ENDED = "ended"


class Admission(Enum):
    """Why a bearer is not admitted."""

    NO_CAPACITY = "the capacity for reserved bit rates is used up"
    TOO_LOADED = "delays as short as these are not given now"
    TOO_MANY = "there are too many bearers"
    UNKNOWN_CLASS = "the class is not known"
    CONFLICT = "the flow has a session already"


@dataclass(frozen=True, slots=True)
class MockSettings:
    """How the network behaves.

    Attributes:
        setup_s: How long a dedicated bearer takes.
        capacity_bps: For reserved bit rates.
        max_bearers: At once.
        max_duration_s: No session is longer.
        base_delay_ms: Of the air, one way.
        least_delay_ms: Of a loaded cell: classes with a shorter budget are not given.
    """

    setup_s: float = 2.0
    capacity_bps: float = 100e6
    max_bearers: int = 256
    max_duration_s: float = 86_400.0
    base_delay_ms: float = 4.0
    least_delay_ms: float = 0.0


@dataclass(slots=True)
class Bearer:
    """One flow's quality.

    Attributes:
        id: Unique.
        flow: What tells its flow from others.
        wanted: Class asked for.
        alternatives: Others that do, in order.
        bit_rate: To reserve.
        ready_s: When it is set up.
        expires_s: When it ends.
        applied: Class given now.
        state: Where it stands.
    """

    id: str
    flow: str
    wanted: QosClass
    alternatives: tuple[QosClass, ...]
    bit_rate: float
    ready_s: float
    expires_s: float
    applied: QosClass
    state: BearerState = BearerState.SETTING_UP
    begun_s: float | None = None

    @property
    def reserved_bps(self) -> float:
        """What it takes of the capacity now."""
        return self.bit_rate if self.applied.is_gbr else 0.0


@dataclass(frozen=True, slots=True)
class BearerEvent:
    """What happened to a bearer.

    Attributes:
        bearer: Which; as it is now.
        before: Where it stood.
        reason: In words.
    """

    bearer: Bearer
    before: BearerState
    reason: str


@dataclass(slots=True)
class MockNetwork:
    """The network.

    Attributes:
        settings: May be replaced; `tick` applies them.
        bearers: By their id, those that have not ended.
        admitted: Bearers taken so far.
        refused: Requests not taken so far.
    """

    settings: MockSettings = field(default_factory=MockSettings)
    bearers: dict[str, Bearer] = field(default_factory=dict)
    admitted: int = 0
    refused: int = 0

    def ask(
        self,
        bearer_id: str,
        flow: str,
        qci: int,
        alternatives: tuple[int, ...],
        bit_rate: float,
        duration_s: float,
        now_s: float,
        *,
        may_share_flow: bool = True,
    ) -> Bearer | Admission:
        """A new bearer, or why not. An alternative is given if the class itself has no room."""
        wanted = qos_class(qci)
        others = tuple(row for number in alternatives if (row := qos_class(number)) is not None)
        reason = self._refusal(wanted, flow, may_share_flow)
        if wanted is None or reason is not None:
            self.refused += 1
            return reason or Admission.UNKNOWN_CLASS
        applied = self._fitting(wanted, others, bit_rate, self.free_bps)
        if applied is None:
            self.refused += 1
            return self._shortage(wanted)
        settings = self.settings
        bearer = Bearer(
            bearer_id,
            flow,
            wanted,
            others,
            bit_rate,
            now_s + settings.setup_s,
            now_s + min(duration_s, settings.max_duration_s),
            applied,
        )
        self.bearers[bearer_id] = bearer
        self.admitted += 1
        return bearer

    def change(
        self,
        bearer_id: str,
        qci: int,
        alternatives: tuple[int, ...],
        bit_rate: float,
        duration_s: float,
        now_s: float,
    ) -> Bearer | Admission:
        """Another class for a bearer: it is set up anew, unless only its end changes.

        Raises:
            KeyError: There is no such bearer.
        """
        bearer = self.bearers[bearer_id]
        wanted = qos_class(qci)
        if wanted is None:
            return Admission.UNKNOWN_CLASS
        others = tuple(row for number in alternatives if (row := qos_class(number)) is not None)
        applied = self._fitting(wanted, others, bit_rate, self.free_bps + bearer.reserved_bps)
        if applied is None:
            return self._shortage(wanted)
        is_same = (wanted, bit_rate) == (bearer.wanted, bearer.bit_rate)
        bearer.wanted, bearer.alternatives, bearer.bit_rate = wanted, others, bit_rate
        bearer.expires_s = now_s + min(duration_s, self.settings.max_duration_s)
        if not is_same:
            bearer.applied = applied
            bearer.state = BearerState.SETTING_UP
            bearer.ready_s = now_s + self.settings.setup_s
        return bearer

    def extend(self, bearer_id: str, seconds: float) -> Bearer:
        """Let a bearer last longer.

        Raises:
            KeyError: There is no such bearer.
        """
        bearer = self.bearers[bearer_id]
        bearer.expires_s += seconds
        return bearer

    def end(self, bearer_id: str) -> Bearer:
        """End a bearer on request; that is no event.

        Raises:
            KeyError: There is no such bearer.
        """
        bearer = self.bearers.pop(bearer_id)
        bearer.state = BearerState.ENDED
        return bearer

    def terminate(self, bearer_id: str) -> BearerEvent:
        """The network ends a bearer by itself.

        Raises:
            KeyError: There is no such bearer.
        """
        before = self.bearers[bearer_id].state
        return BearerEvent(self.end(bearer_id), before, "terminated by the network")

    def tick(self, now_s: float) -> list[BearerEvent]:
        """Let time pass; what happened."""
        events = [
            self._expired(bearer)
            for bearer in tuple(self.bearers.values())
            if bearer.expires_s <= now_s
        ]
        changed = self._share()
        for bearer in self.bearers.values():
            before = bearer.state
            if before is BearerState.SETTING_UP:
                if bearer.ready_s > now_s:
                    continue
                bearer.begun_s = now_s if bearer.begun_s is None else bearer.begun_s
            elif bearer.id not in changed:
                continue
            is_full = bearer.applied == bearer.wanted
            bearer.state = BearerState.ACTIVE if is_full else BearerState.DEGRADED
            reason = "as asked for" if is_full else f"class {bearer.applied.qci} instead"
            events.append(BearerEvent(bearer, before, reason))
        return events

    def next_s(self) -> float | None:
        """When something will happen by itself; None if nothing."""
        moments = [bearer.expires_s for bearer in self.bearers.values()]
        moments += [
            bearer.ready_s
            for bearer in self.bearers.values()
            if bearer.state is BearerState.SETTING_UP
        ]
        return min(moments, default=None)

    @property
    def free_bps(self) -> float:
        """Capacity that nobody reserved."""
        return self.settings.capacity_bps - sum(
            bearer.reserved_bps for bearer in self.bearers.values()
        )

    def delay_ms(self, bearer: Bearer) -> float:
        """What its packets take, one way: half the budget of what is given, three times the wanted one if less is."""
        if bearer.applied != bearer.wanted or bearer.state is BearerState.SETTING_UP:
            return max(self.settings.base_delay_ms, 3.0 * bearer.wanted.delay_ms)
        return max(self.settings.base_delay_ms, bearer.applied.delay_ms / 2)

    def _refusal(
        self, wanted: QosClass | None, flow: str, may_share_flow: bool
    ) -> Admission | None:
        if wanted is None:
            return Admission.UNKNOWN_CLASS
        if len(self.bearers) >= self.settings.max_bearers:
            return Admission.TOO_MANY
        if not may_share_flow and any(bearer.flow == flow for bearer in self.bearers.values()):
            return Admission.CONFLICT
        return None

    def _fitting(
        self,
        wanted: QosClass,
        alternatives: tuple[QosClass, ...],
        bit_rate: float,
        free_bps: float,
    ) -> QosClass | None:
        for row in (wanted, *alternatives):
            is_quick = row.delay_ms < self.settings.least_delay_ms
            if not is_quick and (not row.is_gbr or bit_rate <= free_bps):
                return row
        return None

    def _shortage(self, wanted: QosClass) -> Admission:
        """Why nothing that is asked for fits."""
        is_quick = wanted.delay_ms < self.settings.least_delay_ms
        return Admission.TOO_LOADED if is_quick else Admission.NO_CAPACITY

    def _share(self) -> set[str]:
        """Give the capacity to the most important; whose class has changed."""
        free_bps = self.settings.capacity_bps
        changed: set[str] = set()
        default = qos_class(DEFAULT_QCI)
        assert default is not None
        for bearer in sorted(self.bearers.values(), key=_rank):
            given = self._fitting(bearer.wanted, bearer.alternatives, bearer.bit_rate, free_bps)
            given = given or default
            if given != bearer.applied:
                bearer.applied = given
                changed.add(bearer.id)
            free_bps -= bearer.reserved_bps
        return changed

    def _expired(self, bearer: Bearer) -> BearerEvent:
        before = bearer.state
        self.end(bearer.id)
        return BearerEvent(bearer, before, "expired")


def _rank(bearer: Bearer) -> tuple[float, float]:
    return bearer.wanted.priority, bearer.ready_s
