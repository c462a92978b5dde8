"""The link shaper: what happens to messages between sites that are joined by simulated radio. SIMULATED; pure.

A machine: it is told the time and what came, and says what arrives. `LinkShaper.offer` takes a message of a
connection, `LinkShaper.advance` gives back what has arrived, `LinkShaper.next_event_s` when to call again. Its
decisions follow from the seed and from when messages came, from nothing else. A shell carries the bytes
(`simple_ros_engines.link_shaper`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.record import LinkRecord, Quality, link_id_of, record
from simple_ros_engines.simulator.shaper_channel import make_channel
from simple_ros_engines.simulator.shaper_queue import DirectionQueue, Flow
from simple_ros_engines.simulator.shaper_radio import SharedRadio
from simple_ros_engines.simulator.shaper_reading import changed_conditions
from simple_ros_engines.simulator.shaper_settings import (
    DIRECTIONS,
    Conditions,
    LinkSettings,
    ShaperSettings,
    class_of,
)
from simple_ros_engines.simulator.shaper_trace import Channel, Sample

__all__ = ["SOURCE", "LinkShaper", "ShapedConnection"]

SOURCE = "link_shaper"


@dataclass(slots=True, eq=False)
class ShapedConnection:
    """One connection from site to site, over no, one or two links.

    Attributes:
        source: Site of the publisher.
        target: Site of the subscriber.
        topic: Of its messages.
        handle: Whatever the caller wants to know it by.
        hops: Direction, link and flow of each link it crosses.
    """

    source: str
    target: str
    topic: str
    handle: Any = None
    hops: list[tuple[str, str, Flow]] = field(default_factory=list)

    @property
    def is_idle(self) -> bool:
        """Whether none of its messages is on the way."""
        return not any(flow.on_way for _, _, flow in self.hops)


@dataclass(slots=True)
class _Driven:
    channel: Channel
    due_s: float
    begun_s: float
    sample: Sample


class LinkShaper:
    """All links of a shaper.

    Args:
        settings: Links, classes, carrier, seed.
        now_s: Time of the start, of a monotonic clock.

    Raises:
        ConfigError: A channel's settings are wrong.
    """

    def __init__(self, settings: ShaperSettings, now_s: float) -> None:
        self.settings = settings
        self.radios = {
            way: SharedRadio(
                {name: _conditions(link, way) for name, link in settings.links.items()},
                settings.classes,
                settings.seed,
                way,
            )
            for way in DIRECTIONS
        }
        self._now_s = now_s
        self._channels: dict[str, _Driven] = {}
        self._counted: dict[tuple[str, str], tuple[int, int, int, float]] = {}
        self._recorded_s = now_s
        for name, link in settings.links.items():
            channel = make_channel(link.channel, settings.carrier, settings.seed, name)
            if channel is not None:
                sample = channel.at(0.0)
                self._apply(name, sample)
                self._channels[name] = _Driven(channel, now_s + channel.period_s, now_s, sample)

    # -- connections -----------------------------------------------------------------------------

    def open(
        self, source: str, target: str, topic: str, handle: Any = None, dscp: int | None = None
    ) -> ShapedConnection:
        """A connection from a site to another; sites that are no links are wired."""
        connection = ShapedConnection(source, target, topic, handle)
        if source == target:
            return connection
        index = class_of(self.settings.classes, topic, dscp)
        for way, link in (("up", source), ("down", target)):
            if link in self.settings.links:
                queue = self.radios[way].queues[link]
                hop = len(connection.hops)
                connection.hops.append((way, link, queue.flow(topic, index, (connection, hop))))
        return connection

    def reclass(self, connection: ShapedConnection, dscp: int | None) -> None:
        """A connection has another code point now; what comes from now on is classed by it."""
        index = class_of(self.settings.classes, connection.topic, dscp)
        for _, _, flow in connection.hops:
            flow.class_index = index

    def offer(self, connection: ShapedConnection, item: Any, size: int, now_s: float) -> bool:
        """A message came. False: hold it back, and offer it again after the next `advance`.

        Call `advance` with the same time first.
        """
        way, link, flow = connection.hops[0]
        return self.radios[way].offer(link, flow, (item, size), size, now_s)

    def advance(self, now_s: float) -> list[tuple[ShapedConnection, Any]]:
        """Let time pass; what has arrived by now, in order."""
        arrived: list[tuple[ShapedConnection, Any]] = []
        while True:
            due_s = min((driven.due_s for driven in self._channels.values()), default=math.inf)
            until_s = min(now_s, due_s)
            arrived += self._pass(until_s)
            self._now_s = max(self._now_s, until_s)
            if due_s > now_s:
                return arrived
            for name, driven in self._channels.items():
                if driven.due_s <= due_s:
                    self._step(name, driven, now_s)

    def _pass(self, now_s: float) -> list[tuple[ShapedConnection, Any]]:
        arrived = []
        # What has crossed an uplink may have to cross a downlink still, which must have come to this time.
        for way in ("down", "up", "down"):
            for flow, (item, size) in self.radios[way].advance(now_s):
                connection, hop = flow.handle
                following = connection.hops[hop + 1 : hop + 2]
                if not following:
                    arrived.append((connection, item))
                for next_way, link, next_flow in following:
                    radio = self.radios[next_way]
                    if not radio.offer(link, next_flow, (item, size), size, now_s):
                        # Nobody can be held back in the middle of the way.
                        radio.queues[link].refuse(next_flow, size)
        return arrived

    def _step(self, name: str, driven: _Driven, now_s: float) -> None:
        period_s = driven.channel.period_s
        driven.sample = driven.channel.at(driven.due_s - driven.begun_s)
        self._apply(name, driven.sample)
        driven.due_s += period_s
        if driven.due_s < now_s - 1.0:
            # The computer slept: there is nothing to be gained from all that was missed.
            driven.due_s = now_s

    def _apply(self, name: str, sample: Sample) -> None:
        for way, side in sample.sides.items():
            if side.changes:
                self._change(name, way, side.changes)

    def next_event_s(self) -> float:
        """When to call `advance` again; infinite if there is nothing to wait for."""
        times = [radio.next_event_s() for radio in self.radios.values()]
        times += [driven.due_s for driven in self._channels.values()]
        return min(times)

    # -- control ---------------------------------------------------------------------------------

    def change(self, link: str, way: str, changes: Mapping[str, Any], now_s: float) -> Conditions:
        """Change conditions, named as in settings; what a channel drives it soon drives again.

        Args:
            link: Its name.
            way: ``up``, ``down``, or empty for both.
            changes: ``rate_mbps``, ``delay_ms``, ``jitter_ms``, ``loss``, ``min_share``, ``max_share``.
            now_s: Call `advance` with the same time first.

        Returns:
            The conditions now; of the downlink, for both.

        Raises:
            ConfigError: There is no such link, or a change makes no sense; then nothing has changed.
        """
        if link not in self.settings.links:
            known = ", ".join(self.settings.links)
            raise ConfigError(f"there is no link {link!r}; there are: {known}")
        if way not in ("", *DIRECTIONS):
            raise ConfigError(f"direction {way!r} is none of up, down")
        ways = DIRECTIONS if not way else (way,)
        for one in ways:
            changed_conditions(self.conditions(link, one), changes, f"link {link} {one}")
        self._now_s = max(self._now_s, now_s)
        for one in ways:
            self._change(link, one, changes)
        return self.conditions(link, ways[-1])

    def _change(self, link: str, way: str, changes: Mapping[str, Any]) -> None:
        before = self.conditions(link, way)
        where = f"link {link} {way}"
        self.radios[way].change(link, changed_conditions(before, changes, where))

    def take_shares(self, shares: Mapping[int, Mapping[str, tuple[float, float]]]) -> None:
        """Obey a slice policy (`shaper_policy.policy_shares`)."""
        for name, link in self.settings.links.items():
            for way, (low, high) in shares.get(link.rnti or -1, {}).items():
                before = self.conditions(name, way)
                self.radios[way].change(name, replace(before, min_share=low, max_share=high))

    def conditions(self, link: str, way: str) -> Conditions:
        """Of a direction of a link, now."""
        return self.radios[way].queues[link].conditions

    def moved_to(self, link: str, x_m: float, y_m: float) -> None:
        """A link's device is here."""
        driven = self._channels.get(link)
        if driven is not None:
            driven.channel.moved_to(x_m, y_m)

    # -- what it knows ---------------------------------------------------------------------------

    def queues(self) -> Iterator[tuple[str, str, DirectionQueue]]:
        """Link, direction, queue: all of them."""
        for name in self.settings.links:
            for way in DIRECTIONS:
                yield name, way, self.radios[way].queues[name]

    def sample(self, link: str) -> Sample | None:
        """The newest of a link's channel; None if it has none."""
        driven = self._channels.get(link)
        return None if driven is None else driven.sample

    def records(self, stamp_ns: int, now_s: float) -> list[LinkRecord]:
        """A record of each link, for the Radio Information Engine; every field is marked simulated.

        Rates and losses are those since the last call.
        """
        span_s = max(1e-3, now_s - self._recorded_s)
        self._recorded_s = now_s
        return [self._record(link, stamp_ns, span_s) for link in self.settings.links.values()]

    def _record(self, link: LinkSettings, stamp_ns: int, span_s: float) -> LinkRecord:
        values: dict[str, float | None] = {"prb_total": self.settings.carrier.n_prb}
        sample = self.sample(link.name)
        if sample is not None:
            values |= _radio_values(sample)
        offered = missed = 0
        wait_s = used = 0.0
        for way, short in (("up", "ul"), ("down", "dl")):
            queue = self.radios[way].queues[link.name]
            fresh_offered, fresh_missed, fresh_bytes, share_s = self._since(link.name, way, queue)
            offered, missed = offered + fresh_offered, missed + fresh_missed
            used += share_s / span_s
            waiting = sum(queue.waiting_bytes)
            could = queue.conditions.rate_bps * queue.conditions.max_share
            wait_s += queue.conditions.delay_s + queue.conditions.jitter_s
            wait_s += 0.0 if math.isinf(could) else min(60.0, 8 * waiting / max(1e3, could))
            values[f"{short}_thr_bps"] = 8 * fresh_bytes / span_s
            values[f"{short}_bytes_total"] = sum(c.delivered_bytes for c in queue.counts)
            if way == "up":
                values["buffer_bytes"] = waiting
                values["delivery_bps"] = min(1e12, could)
                values["prb_used"] = min(1.0, share_s / span_s) * self.settings.carrier.n_prb
        values["rtt_ms"] = 1000 * wait_s
        values["loss"] = min(1.0, missed / offered) if offered else None
        return record(
            link.name if link.rnti is None else link_id_of(link.rnti),
            stamp_ns,
            SOURCE,
            values,
            rnti=link.rnti,
            quality=Quality.SIMULATED,
        )

    def _since(self, name: str, way: str, queue: DirectionQueue) -> tuple[int, int, int, float]:
        """Messages offered, messages missed, bytes delivered, share used times seconds: since last time."""
        now = (
            sum(counts.offered for counts in queue.counts),
            sum(counts.missed for counts in queue.counts),
            sum(counts.delivered_bytes for counts in queue.counts),
            queue.used_share_s,
        )
        before = self._counted.get((name, way), (0, 0, 0, 0.0))
        self._counted[name, way] = now
        return now[0] - before[0], now[1] - before[1], now[2] - before[2], now[3] - before[3]


def _conditions(link: LinkSettings, way: str) -> Conditions:
    return link.up if way == "up" else link.down


def _radio_values(sample: Sample) -> dict[str, float | None]:
    up, down = sample.sides["up"], sample.sides["down"]
    if up.snr_db is None:
        return {}
    return {
        "in_sync": 1,
        "rsrp_dbm": sample.rsrp_dbm,
        "ul_snr_db": up.snr_db,
        "ul_mcs": up.mcs,
        "ul_bler": up.bler,
        "dl_sinr_db": down.snr_db,
        "dl_mcs": down.mcs,
        "dl_bler": down.bler,
        "cqi": max(0, min(15, round(((down.snr_db or 0.0) + 6) / 2))),
        "ri": 1,
    }
