"""The links of one publisher: which subscribers it has, and the way to each of them."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from simple_ros.errors import FrameError
from simple_ros.local import LocalLink, ReferenceLink
from simple_ros.net.peer import OutboundLink
from simple_ros.net.transport import InProcess, Transport
from simple_ros.qos import Durability, QosProfile, incompatibilities
from simple_ros.wire.framing import encode_header
from simple_ros.wire.session import Target, TargetChanges, TargetSet

if TYPE_CHECKING:
    from simple_ros.codecs import Codec
    from simple_ros.router import Router

__all__ = ["Link", "LinkTotals", "Spelling", "SubscriberLinks"]

logger = logging.getLogger(__name__)

Link = OutboundLink | LocalLink

_UNCONFIRMED_S = 10.0


@dataclass(slots=True)
class Spelling:
    """The links whose peers spell the topic alike: they share bytes."""

    header: bytes
    links: list[Link] = field(default_factory=list)
    batch: list[bytes] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class LinkTotals:
    """Counters of links, those that are gone included."""

    sent: int = 0
    dropped: int = 0
    expired: int = 0
    waiting: int = 0


class SubscriberLinks:
    """Who a publisher is linked to.

    Args:
        topic: Canonical topic name.
        msg_type: Type name on the wire.
        codec: Makes bytes of its messages.
        message_class: Class of its messages.
        qos: What the publisher offers.
        transports: How messages may travel, most wanted first.
        local_router: Finds the router of a node of this event loop by its instance id.
        before_change: Called before the links change: send what waits for those there are.
        on_up: Called with a link that has come up.
        on_change: Called when links or the room in them have changed.
        on_incompatible: Called with a subscriber that requests more than is offered, and the policies.

    Attributes:
        spellings: The links that want frames, by the header these carry.
        references: The links that take messages as they are.
    """

    def __init__(
        self,
        topic: str,
        msg_type: str,
        codec: Codec,
        message_class: type,
        qos: QosProfile,
        transports: Sequence[Transport | InProcess],
        *,
        local_router: Callable[[str], Router | None],
        before_change: Callable[[], None],
        on_up: Callable[[Link], None],
        on_change: Callable[[], None],
        on_incompatible: Callable[[Target, list[str]], None],
    ) -> None:
        self.spellings: list[Spelling] = []
        self.references: list[ReferenceLink] = []
        self._topic = topic
        self._msg_type = msg_type
        self._codec = codec
        self._message_class = message_class
        self._qos = qos
        self._transports = transports
        inside = [way for way in transports if isinstance(way, InProcess)]
        self._in_process = inside[0] if inside else None
        self._local_router = local_router
        self._before_change = before_change
        self._on_up = on_up
        self._on_change = on_change
        self._on_incompatible = on_incompatible
        self._loop = asyncio.get_running_loop()
        self._targets = TargetSet()
        self._links: dict[tuple[str, int], Link] = {}
        self._incompatible: set[tuple[str, int]] = set()
        self._gone = LinkTotals()
        self._confirm_timer: asyncio.TimerHandle | None = None

    @property
    def all(self) -> tuple[Link, ...]:
        """Every link, up or not."""
        return tuple(self._links.values())

    @property
    def up_count(self) -> int:
        """Links that stand now."""
        return sum(link.is_up for link in self._links.values())

    @property
    def are_busy(self) -> bool:
        """Whether a link still sends what came before."""
        return any(link.is_busy for link in self._links.values())

    def have_room(self, size: int, count: int = 1) -> bool:
        """Whether every link can take ``count`` messages of ``size`` bytes in all."""
        return all(link.has_room(size, count) for link in self._links.values())

    @property
    def targets(self) -> tuple[Target, ...]:
        """The subscribers the Master has named."""
        return self._targets.targets

    @property
    def totals(self) -> LinkTotals:
        """Counters so far."""
        total = self._gone
        for link in self._links.values():
            total = _added(total, link)
        return total

    def header_of(self, target: Target) -> bytes:
        """What begins each frame to a target."""
        return encode_header(target.topic or self._topic, self._msg_type)

    # -- what the Master says ------------------------------------------------------------------

    def update(self, add: Iterable[Target], remove: Iterable[Target], *, snapshot: bool) -> None:
        """Take an update of the Master."""
        self._apply(self._targets.apply(add, remove, snapshot=snapshot))

    def reregistered(self) -> None:
        """A Master that knew nothing was told about the publisher."""
        self._targets.reregistered()
        self.master_lost()
        self._confirm_timer = self._loop.call_later(
            _UNCONFIRMED_S, lambda: self._apply(self._targets.drop_unconfirmed())
        )

    def master_lost(self) -> None:
        """The Master is gone: who it did not name stays, until the next one."""
        if self._confirm_timer is not None:
            self._confirm_timer.cancel()

    def _apply(self, changes: TargetChanges) -> None:
        for target in changes.closed:
            self._unlink(target)
        for target in changes.opened:
            self._link(target)
        for target in changes.updated:
            self._relink(target)
        self._on_change()

    # -- the links -----------------------------------------------------------------------------

    def _relink(self, target: Target) -> None:
        """A subscriber's requests have changed."""
        link = self._links.get(target.key)
        if link is None or (target.qos is not None and incompatibilities(self._qos, target.qos)):
            self._unlink(target)
            self._link(target)
        elif target.qos is not None and target.qos.durability is Durability.TRANSIENT_LOCAL:
            self._on_up(link)

    def _link(self, target: Target) -> None:
        try:
            header = self.header_of(target)
        except FrameError as error:
            logger.warning("node %r cannot be sent %r: %s", target.node, self._topic, error)
            return
        if target.qos is not None:
            problems = incompatibilities(self._qos, target.qos)
            if problems:
                self._report_incompatible(target, [problem.policy for problem in problems])
                return
        link = self._made(target)
        self._before_change()
        self._links[target.key] = link
        if isinstance(link, ReferenceLink):
            self.references = [*self.references, link]
            self._on_up(link)
            return
        spelling = next((item for item in self.spellings if item.header == header), None)
        if spelling is None:
            spelling = Spelling(header)
            self.spellings = [*self.spellings, spelling]
        spelling.links.append(link)
        if isinstance(link, LocalLink):
            self._on_up(link)

    def _made(self, target: Target) -> Link:
        router = self._local_router(target.instance_id) if self._in_process else None
        if router is not None and self._in_process is InProcess.REFERENCE:
            return ReferenceLink(
                target,
                self._qos,
                router,
                self.header_of(target),
                self._codec.decoder(self._message_class),
                self._codec.encoder(self._message_class),
                on_room=self._on_change,
                on_broken=self._local_broke,
            )
        if router is not None:
            return LocalLink(
                target,
                self._qos,
                router,
                on_room=self._on_change,
                on_broken=self._local_broke,
            )
        return OutboundLink(
            target,
            self._qos,
            on_up=self._on_up,
            on_broken=self._link_broke,
            on_room=self._on_change,
            transports=self._transports,
        )

    def _report_incompatible(self, target: Target, policies: list[str]) -> None:
        if target.key not in self._incompatible:
            self._incompatible.add(target.key)
            self._on_incompatible(target, policies)

    def _local_broke(self, link: LocalLink) -> None:
        self.update((), (link.target,), snapshot=False)

    def _link_broke(self, link: OutboundLink) -> None:
        self._apply(self._targets.link_broke(link.target.key))

    def _unlink(self, target: Target) -> None:
        self._incompatible.discard(target.key)
        link = self._links.pop(target.key, None)
        if link is None:
            return
        self._before_change()
        self.references = [other for other in self.references if other is not link]
        for spelling in self.spellings:
            if link in spelling.links:
                spelling.links.remove(link)
        self.spellings = [spelling for spelling in self.spellings if spelling.links]
        link.close()
        gone = _added(self._gone, link)
        self._gone = LinkTotals(gone.sent, gone.dropped, gone.expired)

    # -- the end -------------------------------------------------------------------------------

    async def flush(self) -> None:
        """Wait until everything queued has been handed to the operating system."""
        await asyncio.gather(*(link.flush() for link in self.all))

    def close(self) -> None:
        """End all links; what still waits is given up."""
        self.master_lost()
        for link in self.all:
            self._unlink(link.target)


def _added(total: LinkTotals, link: Link) -> LinkTotals:
    too_large = link.too_large if isinstance(link, OutboundLink) else 0
    queue = link.queue
    return LinkTotals(
        total.sent + link.sent,
        total.dropped + queue.dropped + too_large,
        total.expired + queue.expired,
        total.waiting + len(queue),
    )
