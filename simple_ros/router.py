"""From received frames to the subscriptions of a node.

A `Router` holds one `Route` per (canonical topic, type) that somebody in the node subscribes to. What
arrives and cannot be delivered (unknown topic, another type, unparsable, too large) is counted,
logged once per cause and dropped; the link it came on stays, since a C++ publisher never dials
again.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from google.protobuf.message import DecodeError

from simple_ros.names import canonical
from simple_ros.net import feeder
from simple_ros.net.feeder import NO_LANE, Source
from simple_ros.qos import Durability, QosProfile
from simple_ros.wire.framing import Payload, Run, header_names

__all__ = ["BadMessages", "Route", "Router", "Sink"]

logger = logging.getLogger(__name__)

_MOST_LOGGED = 1000


class Sink(Protocol):
    """A subscription as the router sees it."""

    wants_bytes: bool
    takes_batches: bool
    takes_payloads: bool
    is_direct: bool
    waits: bool
    qos: QosProfile

    @property
    def has_received(self) -> bool:
        """Whether any message was delivered to it."""

    def take(self, message: Any, size: int) -> None:
        """One message: an object, or its bytes if `wants_bytes`."""

    def take_payloads(
        self,
        payloads: list[Payload],
        parse: Callable[[Any], Any],
        unparsable: Callable[[Payload, DecodeError], None],
    ) -> None:
        """Messages that are still to be parsed; only called if `takes_payloads`."""

    def lone_taker(
        self, parse: Callable[[Any], Any], unparsable: Callable[[Payload, DecodeError], None]
    ) -> Callable[[bytes], None]:
        """What takes a message that came alone and is still to be parsed; only asked if `takes_payloads`."""

    def take_batch(self, messages: list[Any]) -> None:
        """All messages of one read; only called if `takes_batches`."""

    def room(self, sizes: Sequence[int]) -> int:
        """How many of the next messages, of so many bytes, fit its queue now.

        Only asked if not `is_direct`.
        """

    def call_when_room(self, resume: Callable[[], None]) -> None:
        """Call once, when there is room again; only asked if `waits`."""

    def sources_changed(self) -> None:
        """A link that brings its messages came or went."""


class Lane(feeder.Lane, Protocol):
    """Where the frames of one link with one header go."""

    def offer(self, payloads: list[Payload], resume: Callable[[], None], *, force: bool) -> int:
        """Take frames; see `Receiver.receive`."""

    def oversized(self, size: int) -> None:
        """A frame was too large to be delivered."""

    def link_ended(self, link: Source) -> None:
        """A link that uses this lane has ended."""


class BadMessages:
    """Counts what was dropped, by cause, and logs each cause and topic once.

    Attributes:
        counts: Messages by cause: ``unknown_topic``, ``type_mismatch``, ``unparsable``,
            ``oversized``, ``bad_name``; and streams closed for a ``violation`` of the framing.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._logged: set[tuple[str, str]] = set()

    def add(self, cause: str, topic: str, detail: str, count: int = 1) -> None:
        """Count ``count`` messages; ``detail`` is for the one log line."""
        self.counts[cause] += count
        if self._is_new(cause, topic):
            logger.warning("dropping messages on %r: %s (logged once)", topic, detail)

    def refused(self, host: str, reason: str) -> None:
        """Count a stream from ``host`` that could not be followed."""
        self.counts["violation"] += 1
        if self._is_new("violation", host):
            logger.warning("closed a link from %s: %s (logged once)", host, reason)

    def _is_new(self, cause: str, subject: str) -> bool:
        if (cause, subject) in self._logged or len(self._logged) >= _MOST_LOGGED:
            return False
        self._logged.add((cause, subject))
        return True


class Route:
    """The subscriptions of one topic and type.

    Attributes:
        take_lone: Takes a message that came alone, if there is one subscription and nothing else to do.
    """

    def __init__(self, topic: str, msg_type: str, bad: BadMessages) -> None:
        self.topic = topic
        self.msg_type = msg_type
        self.sinks: tuple[Sink, ...] = ()
        self.sources: set[Source] = set()
        self._parsers: dict[Sink, Callable[[Any], Any]] = {}
        self._bad = bad
        self._latches = False
        self._all_direct = True
        self._last: bytes | None = None
        self.take_lone: Callable[[bytes], object] | None = None

    def add(self, sink: Sink, parse: Callable[[Any], Any]) -> None:
        """Deliver to ``sink`` too; ``parse`` is how it wants its messages made, if not as bytes."""
        self._parsers[sink] = bytes if sink.wants_bytes else parse
        self.sinks = (*self.sinks, sink)
        self._all_direct = all(other.is_direct for other in self.sinks)
        if sink.qos.durability is Durability.TRANSIENT_LOCAL:
            self._latches = True
        self._choose_lone()

    def discard(self, sink: Sink) -> None:
        """Deliver to ``sink`` no more."""
        self.sinks = tuple(other for other in self.sinks if other is not sink)
        self._all_direct = all(other.is_direct for other in self.sinks)
        self._parsers.pop(sink, None)
        self._choose_lone()

    def _choose_lone(self) -> None:
        self.take_lone = None
        if len(self.sinks) != 1 or self._latches or not self._all_direct:
            return
        sink = self.sinks[0]
        if sink.takes_batches:
            self.take_lone = lambda payload: self._deliver_batch(sink, [payload])
        elif sink.takes_payloads:
            self.take_lone = sink.lone_taker(self._parsers[sink], self._unparsable)

    def replay(self, sink: Sink) -> None:
        """Give a late joiner of this node the last message that earlier ones had already."""
        wants = sink.qos.durability is Durability.TRANSIENT_LOCAL and not sink.has_received
        if self._last is not None and wants and sink in self.sinks:
            self._deliver_to(sink, memoryview(self._last))

    def expect_life(self) -> None:
        """Let links end that give no sign of life for the shortest lease anybody here asks for."""
        leases = [sink.qos.liveliness_lease_s for sink in self.sinks]
        shortest = min((lease for lease in leases if lease is not None), default=None)
        if shortest is not None:
            for source in self.sources:
                source.expect_life_within(shortest)

    def sources_changed(self) -> None:
        """Tell the subscriptions that a link came or went."""
        self.expect_life()
        for sink in self.sinks:
            sink.sources_changed()

    def link_ended(self, link: Source) -> None:
        """A link that brought messages has ended."""
        self.sources.discard(link)
        self.sources_changed()

    def oversized(self, size: int) -> None:
        """A message was too large."""
        self._bad.add("oversized", self.topic, f"{size} bytes are over the limit")

    def offer(self, payloads: list[Payload], resume: Callable[[], None], *, force: bool) -> int:
        """Deliver as much as the queues take; see `Receiver.receive`."""
        if self._all_direct:
            self.deliver(payloads)
            return len(payloads)
        taken = self._room_for([len(payload) for payload in payloads], resume, force=force)
        if taken < 0:
            return taken
        self.deliver(payloads if taken == len(payloads) else payloads[:taken])
        return taken

    def _room_for(self, sizes: list[int], resume: Callable[[], None], *, force: bool) -> int:
        """How many of the next messages the queues take; see `Receiver.receive`."""
        queued = [sink for sink in self.sinks if not sink.is_direct]
        if not queued:
            return len(sizes)
        rooms = {sink: sink.room(sizes) for sink in queued}
        room = min(rooms.values())
        if room >= len(sizes):
            return len(sizes)
        for sink in queued:
            if sink.waits and not rooms[sink]:
                sink.call_when_room(resume)
                return -1
        if not room and force:
            # Those that do not wait drop their oldest; those that do get what fits.
            room = min(rooms[sink] if sink.waits else sink.qos.depth for sink in queued)
        return min(room, len(sizes))

    def offer_objects(
        self,
        messages: list[Any],
        parse: Callable[[Any], Any],
        encode: Callable[[Any], bytes],
        resume: Callable[[], None],
        *,
        force: bool,
    ) -> int:
        """As `offer`, for messages that need no parsing where ``parse`` is what a subscription uses."""
        taken = self._room_for([1] * len(messages), resume, force=force)
        for message in messages[: max(taken, 0)]:
            for sink in self.sinks:
                mine = self._parsers.get(sink)
                if mine is None:
                    continue
                if mine == parse:
                    self._hand(sink, message, 1)
                else:
                    self._deliver_to(sink, memoryview(encode(message)))
        return taken

    def deliver(self, payloads: list[Payload]) -> None:
        """Parse once and hand to every subscription; the views end with the call."""
        if self._latches and payloads:
            self._last = bytes(payloads[-1])
        if len(self.sinks) == 1:
            sink = self.sinks[0]
            if sink.takes_batches:
                self._deliver_batch(sink, payloads)
                return
            if sink.takes_payloads:
                sink.take_payloads(payloads, self._parsers[sink], self._unparsable)
            else:
                self._deliver_to_one(sink, payloads)
            return
        for payload in payloads:
            self._deliver_to_each(payload)

    def _deliver_batch(self, sink: Sink, payloads: list[Payload]) -> None:
        messages = self._batch(sink, payloads)
        if messages:
            sink.take_batch(messages)

    def _batch(self, sink: Sink, payloads: list[Payload]) -> list[Any]:
        parse = self._parsers[sink]
        try:
            return [parse(payload) for payload in payloads]
        except DecodeError:
            parsed = (self._parsed(parse, payload) for payload in payloads)
            return [message for message in parsed if message is not None]

    def _deliver_to_each(self, payload: Payload) -> None:
        """To several subscriptions: those that want the same class get the same object."""
        made: dict[Callable[[Any], Any], Any] = {}
        for sink in self.sinks:
            parse = self._parsers.get(sink)
            if parse is None:
                continue
            if parse not in made:
                made[parse] = self._parsed(parse, payload)
            if made[parse] is not None:
                self._hand(sink, made[parse], len(payload))

    def _deliver_to(self, sink: Sink, payload: Payload) -> None:
        message = self._parsed(self._parsers[sink], payload)
        if message is not None:
            self._hand(sink, message, len(payload))

    def _hand(self, sink: Sink, message: Any, size: int) -> None:
        if sink.takes_batches:
            sink.take_batch([message])
        else:
            sink.take(message, size)

    def _parsed(self, parse: Callable[[Any], Any], payload: Payload) -> Any:
        """The message, or None if it cannot be parsed, which is counted."""
        try:
            return parse(payload)
        except DecodeError as error:
            self._unparsable(payload, error)
            return None

    def _deliver_to_one(self, sink: Sink, payloads: list[Payload]) -> None:
        parse, take = self._parsers[sink], sink.take
        for payload in payloads:
            try:
                message = parse(payload)
            except DecodeError as error:
                self._unparsable(payload, error)
                continue
            take(message, len(payload))

    def _unparsable(self, payload: Payload, error: DecodeError) -> None:
        detail = f"{len(payload)} bytes are no {self.msg_type} ({error})"
        self._bad.add("unparsable", self.topic, detail)


class Router:
    """Finds the route of each run of frames.

    Args:
        on_control: What to call, with the link and the payload, for each frame of certain types,
            whatever its topic: pushes of a Master, say.
        on_link_ended: Called with each link that ended.
        find_lane: Asked, with the link, the name and the type of frames that no subscription is for,
            where they go; None if nowhere.
    """

    def __init__(
        self,
        on_control: Mapping[str, Callable[[Source, bytes], None]],
        on_link_ended: Callable[[Source], None],
        find_lane: Callable[[Source, str, str], Lane | None] = lambda *_: None,
    ) -> None:
        self.bad = BadMessages()
        self._on_control = on_control
        self._on_link_ended = on_link_ended
        self._routes: dict[tuple[str, str], Route] = {}
        self._find_lane = find_lane
        self._by_link: dict[Source, dict[bytes, Lane]] = {}
        self.local_links: dict[Source, Callable[[], None]] = {}

    def add(self, topic: str, msg_type: str, parse: Callable[[Any], Any], sink: Sink) -> Route:
        """Deliver a topic to ``sink`` from now on."""
        key = topic, msg_type
        route = self._routes.get(key)
        if route is None:
            route = self._routes[key] = Route(topic, msg_type, self.bad)
        route.add(sink, parse)
        return route

    def remove(self, topic: str, msg_type: str, sink: Sink) -> bool:
        """Deliver nothing more to ``sink``; True if the topic has no other sink of that type."""
        route = self._routes.get((topic, msg_type))
        if route is None:
            return True
        route.discard(sink)
        if route.sinks:
            return False
        del self._routes[topic, msg_type]
        for source in route.sources:
            known = self._by_link[source]
            for header in [header for header, other in known.items() if other is route]:
                del known[header]
        return True

    def receive(self, link: Source, run: Run, resume: Callable[[], None], *, force: bool) -> int:
        """Deliver one run of frames that came on ``link``; see `Receiver.receive`."""
        routes = self._by_link.get(link)
        route = None if routes is None else routes.get(run.header)
        if route is None:
            route = self._find(link, run)
        if route is None:
            return len(run.payloads)
        if run.oversized:
            route.oversized(run.oversized)
            return 0
        return route.offer(run.payloads, resume, force=force)

    def lane_of(self, link: Source, header: bytes) -> feeder.Lane:
        """Where the last frames went that came on a link with a header; `NO_LANE` if nowhere."""
        return self._by_link.get(link, {}).get(header, NO_LANE)

    def receive_objects(
        self,
        link: Source,
        run: Run,
        parse: Callable[[Any], Any],
        encode: Callable[[Any], bytes],
        resume: Callable[[], None],
        *,
        force: bool,
    ) -> int:
        """As `receive`, for a run of messages instead of bytes; see `Route.offer_objects`."""
        lane = self._by_link.get(link, {}).get(run.header) or self._find(link, run)
        if not isinstance(lane, Route):
            return len(run.payloads)
        return lane.offer_objects(run.payloads, parse, encode, resume, force=force)

    def _find(self, link: Source, run: Run) -> Lane | None:
        """The lane of a header this link has not brought yet; None if handled otherwise."""
        count = len(run.payloads) or 1
        names = header_names(run.header)
        if names is None:
            self.bad.add("bad_name", repr(run.header[:80]), "its name is not UTF-8", count)
            return None
        spelling, msg_type = names
        control = self._on_control.get(msg_type)
        if control is not None:
            for payload in run.payloads:
                control(link, bytes(payload))
            return None
        topic = canonical(spelling)
        lane = self._find_lane(link, topic, msg_type)
        if lane is not None:
            self._by_link.setdefault(link, {})[run.header] = lane
            return lane
        route = self._routes.get((topic, msg_type))
        if route is None:
            self._undeliverable(topic, msg_type, count)
            return None
        self._by_link.setdefault(link, {})[run.header] = route
        route.sources.add(link)
        route.sources_changed()
        return route

    def _undeliverable(self, topic: str, msg_type: str, count: int) -> None:
        here = sorted({kind for name, kind in self._routes if name == topic})
        if here:
            detail = f"they are {msg_type}, subscribed as {' and '.join(here)}"
            self.bad.add("type_mismatch", topic, detail, count)
        else:
            self._unknown(topic, count)

    def _unknown(self, topic: str, count: int) -> None:
        self.bad.add("unknown_topic", topic, "nobody here subscribes to it", count)

    def close(self) -> None:
        """The node ends: tell the links of this process, which have no connection that could."""
        for peer_ended in list(self.local_links.values()):
            peer_ended()

    def link_refused(self, peer: str, reason: str) -> None:
        """A stream that could not be followed was closed."""
        self.bad.refused(peer.rpartition(":")[0], reason)

    def link_ended(self, link: Source) -> None:
        """A link is gone."""
        for lane in self._by_link.pop(link, {}).values():
            lane.link_ended(link)
        self._on_link_ended(link)
