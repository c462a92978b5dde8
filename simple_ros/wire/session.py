"""Who is linked to whom, and for how long: decisions about links as pure state.

* `Backoff` says when to dial again.
* `TargetSet` says which subscribers a publisher should be linked to, from the Master's pushes.
* `Registrations` says what a node still has to tell the Master.
* `Expectation` says whether something that should happen regularly is overdue (deadline, liveliness).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum

from simple_ros.qos import QosProfile

__all__ = [
    "Backoff",
    "EndpointKey",
    "EndpointKind",
    "Expectation",
    "Registrations",
    "Target",
    "TargetChanges",
    "TargetSet",
]

Address = tuple[str, int]


class Backoff:
    """Growing delays between attempts, in seconds."""

    def __init__(self, first_s: float = 0.1, limit_s: float = 2.0, factor: float = 2.0) -> None:
        self._first = first_s
        self._limit = limit_s
        self._factor = factor
        self._next = first_s

    def next_delay(self) -> float:
        """How long to wait before the next attempt."""
        delay = self._next
        self._next = min(delay * self._factor, self._limit)
        return delay

    def reset(self) -> None:
        """An attempt succeeded: start small again."""
        self._next = self._first


@dataclass(frozen=True, slots=True)
class Target:
    """A subscriber as a publisher sees it.

    Attributes:
        ip, port: Where to dial; together the identity of a target, as in C++ simple_ros.
        node: Its node name, for people.
        instance_id: Which start of that node; empty for other implementations.
        addresses: Further ``host:port`` to try.
        topic: Its own spelling of the topic, which frames to it must carry.
        qos: What it requests; None if it did not say.
    """

    ip: str
    port: int
    node: str = ""
    instance_id: str = ""
    addresses: tuple[str, ...] = ()
    topic: str = ""
    qos: QosProfile | None = None

    @property
    def key(self) -> Address:
        """What tells targets apart."""
        return self.ip, self.port

    @property
    def is_foreign(self) -> bool:
        """Whether the target runs another implementation, which registers only once."""
        return not self.instance_id


@dataclass(slots=True)
class TargetChanges:
    """Links to close, to open and to look at again, in this order.

    An updated target is the same peer under the same address that requests another QoS.
    """

    closed: list[Target] = field(default_factory=list)
    opened: list[Target] = field(default_factory=list)
    updated: list[Target] = field(default_factory=list)


class TargetSet:
    """The subscribers of one publisher.

    A Master that was restarted knows nobody yet, while the links of its previous life still carry
    data. After `reregistered`, targets are therefore only *unconfirmed*: they stay until the new
    Master names them, `drop_unconfirmed` is called (nodes of ours register again by themselves, so
    silence means they left), or their link breaks. Foreign targets never register again; only
    their link tells.
    """

    def __init__(self) -> None:
        self._targets: dict[Address, Target] = {}
        self._unconfirmed: set[Address] = set()

    def __len__(self) -> int:
        return len(self._targets)

    def __contains__(self, key: object) -> bool:
        return key in self._targets

    @property
    def targets(self) -> tuple[Target, ...]:
        """All of them."""
        return tuple(self._targets.values())

    def apply(
        self, add: Iterable[Target], remove: Iterable[Target] = (), *, snapshot: bool = False
    ) -> TargetChanges:
        """Take one update of the Master; ``snapshot`` means ``add`` is everybody."""
        changes = TargetChanges()
        added = list(add)
        for target in remove:
            self._close(target.key, changes, instance_id=target.instance_id)
        if snapshot:
            named = {target.key for target in added}
            for key in [key for key in self._targets if key not in named]:
                self._close(key, changes)
        for target in added:
            self._add(target, changes)
        return changes

    def _add(self, target: Target, changes: TargetChanges) -> None:
        known = self._targets.get(target.key)
        self._unconfirmed.discard(target.key)
        if known == target:
            return
        self._targets[target.key] = target
        if known is not None and replace(known, qos=target.qos) == target:
            changes.updated.append(target)
            return
        if known is not None:
            changes.closed.append(known)
        changes.opened.append(target)

    def _close(self, key: Address, changes: TargetChanges, instance_id: str = "") -> None:
        known = self._targets.get(key)
        if known is None or (instance_id and known.instance_id not in ("", instance_id)):
            return
        del self._targets[key]
        self._unconfirmed.discard(key)
        changes.closed.append(known)

    def reregistered(self) -> None:
        """A Master was told anew about this publisher: everybody is unconfirmed."""
        self._unconfirmed = set(self._targets)

    def drop_unconfirmed(self) -> TargetChanges:
        """Give up our own kind that did not register again."""
        changes = TargetChanges()
        for key in [key for key in self._unconfirmed if not self._targets[key].is_foreign]:
            self._close(key, changes)
        return changes

    def link_broke(self, key: Address) -> TargetChanges:
        """A link failed; an unconfirmed target is given up, others are dialled again."""
        changes = TargetChanges()
        if key in self._unconfirmed:
            self._close(key, changes)
        return changes


class EndpointKind(Enum):
    """What a node registers."""

    PUBLISHER = "publisher"
    SUBSCRIBER = "subscriber"
    SERVICE = "service"


@dataclass(frozen=True, slots=True)
class EndpointKey:
    """One registration of a node: several publishers of one topic in a node share it.

    For a service, ``topic`` is its name and ``msg_type`` the name of its type.
    """

    kind: EndpointKind
    topic: str
    msg_type: str


class Registrations:
    """What a node wants registered, and what the present Master has been told.

    The order of wishes is kept. A wish taken back before it was told is forgotten.
    """

    def __init__(self) -> None:
        self._wanted: dict[EndpointKey, None] = {}
        self._told: set[EndpointKey] = set()
        self._farewells: dict[EndpointKey, None] = {}

    @property
    def wanted(self) -> tuple[EndpointKey, ...]:
        """Everything the node wants registered."""
        return tuple(self._wanted)

    def want(self, key: EndpointKey) -> None:
        """Register from now on, with every Master that comes.

        A farewell that is due is still said first: what is wanted anew is registered anew.
        """
        self._wanted[key] = None

    def want_anew(self, key: EndpointKey) -> None:
        """Tell the Master once more, since something about it has changed."""
        self._told.discard(key)

    def unwant(self, key: EndpointKey) -> None:
        """Take a wish back."""
        self._wanted.pop(key, None)
        if key in self._told:
            self._farewells[key] = None

    def is_told(self, key: EndpointKey) -> bool:
        """Whether the present Master knows, and will not be told otherwise."""
        return key in self._told and key not in self._farewells

    def is_wanted(self, key: EndpointKey) -> bool:
        """Whether it is to be registered."""
        return key in self._wanted

    def has_farewell(self, key: EndpointKey) -> bool:
        """Whether the Master is still to be told of its end."""
        return key in self._farewells

    def master_changed(self) -> None:
        """The Master that was told is gone; the next one knows nothing."""
        self._told.clear()
        self._farewells.clear()

    def next_farewell(self) -> EndpointKey | None:
        """Something to unregister, or None."""
        return next(iter(self._farewells), None)

    def next_registration(self) -> EndpointKey | None:
        """Something to register, or None."""
        return next((key for key in self._wanted if key not in self._told), None)

    def told(self, key: EndpointKey) -> None:
        """The Master knows of a registration; one taken back meanwhile is due a farewell."""
        self._told.add(key)
        if key not in self._wanted:
            self._farewells[key] = None

    def farewell_said(self, key: EndpointKey) -> None:
        """The Master knows that a registration has ended."""
        self._farewells.pop(key, None)
        self._told.discard(key)


class Expectation:
    """Something that should happen at least every ``period_s`` seconds.

    Attributes:
        misses: How often it did not, ever; each whole period counts once.
    """

    __slots__ = ("_due", "misses", "period_s")

    def __init__(self, period_s: float, now: float) -> None:
        self.period_s = period_s
        self.misses = 0
        self._due = now + period_s

    @property
    def due(self) -> float:
        """When it will be overdue."""
        return self._due

    def happened(self, now: float) -> None:
        """It happened."""
        self._due = now + self.period_s

    def overdue(self, now: float) -> int:
        """How many whole periods have passed without it since last asked."""
        if now < self._due:
            return 0
        missed = 1 + int((now - self._due) / self.period_s)
        self._due += missed * self.period_s
        self.misses += missed
        return missed
