"""Sharing out physical resource blocks: weighted max-min fairness with floors. Pure.

Everybody first gets a floor. The rest is given so that the smallest share, divided by its weight, is as
large as possible, then the second smallest, and so on (Bertsekas and Gallager, Data Networks, 6.5.2): a link
is below its wish only where no other link could give without being worse off itself. With lower
bounds f, wishes d and weights w the shares are ``min(d, max(f, w L))`` with the one level L that uses up the total.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter

from simple_ros.errors import ConfigError

__all__ = ["Allocation", "Grant", "Request", "allocate", "jain_index", "managed", "scaled_floors"]

_TINY = 1e-9
_WEIGHTS = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)


@dataclass(frozen=True, slots=True)
class Request:
    """What a link wishes.

    Attributes:
        key: Of the link.
        wanted: Blocks.
        priority: 1 lowest to 5; each step counts double.
        floor: Blocks it gets at least, as far as it wishes them.
    """

    key: str
    wanted: int
    priority: int = 3
    floor: int = 5

    def __post_init__(self) -> None:
        if self.wanted < 0 or self.floor < 0:
            raise ConfigError(f"link {self.key!r} wishes {self.wanted} blocks, floor {self.floor}")
        if not 1 <= self.priority <= 5:
            raise ConfigError(f"link {self.key!r} has priority {self.priority}, not 1..5")

    @property
    def weight(self) -> float:
        """Share beside others."""
        return _WEIGHTS[self.priority]


@dataclass(frozen=True, slots=True)
class Grant:
    """What a link gets."""

    key: str
    wanted: int
    granted: int
    floor: int
    priority: int


@dataclass(frozen=True, slots=True)
class Allocation:
    """What all links get.

    Attributes:
        grants: In the order of the requests.
        total: Blocks there are.
        floors_scaled: Whether the floors did not fit together.
    """

    grants: tuple[Grant, ...]
    total: int
    floors_scaled: bool

    @property
    def requested(self) -> int:
        """Sum of the wishes."""
        return sum(grant.wanted for grant in self.grants)

    @property
    def granted(self) -> int:
        """Sum of the grants."""
        return sum(grant.granted for grant in self.grants)

    @property
    def is_conflict(self) -> bool:
        """Whether more is wished than there is."""
        return self.requested > self.total

    @property
    def jain(self) -> float:
        """Jain's index of granted over wished, 0..1; 1 where nobody wishes anything."""
        return jain_index([grant.granted / grant.wanted for grant in self.grants if grant.wanted])

    def text(self, names: Mapping[str, str] | None = None) -> str:
        """In words, as WirelessROS says it.

        Args:
            names: How to call the links; "RNTI" and the key otherwise.
        """
        lines = [
            f"PRB Conflict Resolution: Total requested={self.requested}, Allocated={self.granted}"
        ]
        for grant in self.grants:
            share = round(100 * grant.granted / grant.wanted) if grant.wanted else 100
            name = (names or {}).get(grant.key, f"RNTI {grant.key}")
            lines.append(f"{name}: {grant.wanted}->{grant.granted} ({share}%)")
        return "\n".join(lines)


def jain_index(shares: Iterable[float]) -> float:
    """Fairness of shares, 1/n to 1 (Jain, Chiu, Hawe 1984); 1 for none or all zero."""
    values = list(shares)
    squares = sum(value * value for value in values)
    return sum(values) ** 2 / (len(values) * squares) if squares else 1.0


def allocate(requests: Sequence[Request], total: int) -> Allocation:
    """Share out ``total`` blocks.

    The sum of the grants is the smaller of ``total`` and the sum of the wishes. Nobody gets less than its
    floor, or its scaled floor where floors do not fit together, or its wish if that is less.

    Args:
        requests: One a link.
        total: Blocks there are.

    Raises:
        ConfigError: Two requests have one key, or the total is negative.
    """
    if total < 0:
        raise ConfigError(f"there cannot be {total} blocks")
    if len({request.key for request in requests}) < len(requests):
        raise ConfigError("two requests are of the same link")
    floors = [min(request.floor, request.wanted) for request in requests]
    is_scaled = sum(floors) > total
    if is_scaled:
        floors = scaled_floors(floors, total)
        shares = floors
    elif sum(request.wanted for request in requests) <= total:
        shares = [request.wanted for request in requests]
    else:
        shares = _whole(requests, floors, _level(requests, floors, total), total)
    grants = tuple(
        Grant(request.key, request.wanted, share, floor, request.priority)
        for request, share, floor in zip(requests, shares, floors, strict=True)
    )
    return Allocation(grants, total, is_scaled)


def scaled_floors(floors: Sequence[int], total: int) -> list[int]:
    """Floors in proportion, that fit; the blocks that rounding leaves go to the largest remainders."""
    whole = sum(floors)
    if whole <= total:
        return list(floors)
    scaled = [floor * total // whole for floor in floors]
    order = sorted(range(len(floors)), key=lambda index: (-(floors[index] * total % whole), index))
    for index in order[: total - sum(scaled)]:
        scaled[index] += 1
    return scaled


def _level(requests: Sequence[Request], floors: Sequence[int], total: int) -> float:
    """The level L at which the shares use up the total.

    The sum of the shares grows with L in straight pieces: a link adds its weight to the slope from where
    it leaves its floor to where it has its wish.
    """
    bends = []
    for request, floor in zip(requests, floors, strict=True):
        bends.append((floor / request.weight, request.weight))
        bends.append((request.wanted / request.weight, -request.weight))
    bends.sort(key=itemgetter(0))
    level, slope, left = 0.0, 0.0, float(total - sum(floors))
    for place, change in bends:
        piece = slope * (place - level)
        if slope > 0 and piece >= left:
            break
        left -= piece
        level, slope = place, slope + change
    return level + left / slope if slope > 0 else level


def _whole(
    requests: Sequence[Request], floors: Sequence[int], level: float, total: int
) -> list[int]:
    exact = [
        min(float(request.wanted), max(float(floor), request.weight * level))
        for request, floor in zip(requests, floors, strict=True)
    ]
    shares = [int(share + _TINY) for share in exact]
    left = total - sum(shares)
    order = sorted(
        (index for index, share in enumerate(shares) if share < requests[index].wanted),
        key=lambda index: (shares[index] - exact[index], -requests[index].weight, index),
    )
    for index in order[:left]:
        shares[index] += 1
    return shares


def managed(
    requests: Iterable[Request], load: float, critical: Mapping[str, float] | None = None
) -> list[Request]:
    """Requests with managed priorities: critical links rise by one, others are cut back under load.

    It goes by what was requested, never by what was managed before, so doing it again changes nothing.

    Args:
        requests: As the engines made them.
        load: Sum of the wishes over the blocks there are.
        critical: Criticality of the tasks behind the links, 0..1.
    """
    found = []
    for request in requests:
        criticality = (critical or {}).get(request.key, 0.0)
        priority = min(5, request.priority + 1) if criticality > 0.8 else request.priority
        wanted = request.wanted
        if load > 0.9 and priority <= 2:
            wanted = max(min(request.floor, wanted), int(0.8 * wanted))
        found.append(Request(request.key, wanted, priority, request.floor))
    return found
