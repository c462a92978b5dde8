"""Plays bags: publishes what was recorded, at the pace at which it was recorded."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from google.protobuf.timestamp_pb2 import Timestamp

from simple_ros.bag.channel_qos import profile_in
from simple_ros.bag.errors import NothingToPlay
from simple_ros.bag.messages import BagMessage, Topic
from simple_ros.bag.ordering import in_order
from simple_ros.bag.plan import LatchedHistory
from simple_ros.bag.read_ahead import ReadAhead
from simple_ros.bag.reader import Bag
from simple_ros.bag.series import RECORDING
from simple_ros.bag.timeline import Timeline
from simple_ros.errors import (
    ConfigError,
    RegistrationRefused,
    TopicTypeMismatch,
    TypeDefinitionConflict,
    UnknownMessageType,
)
from simple_ros.msg.rosgraph_msgs import Clock
from simple_ros.names import canonical, topic_name
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher

__all__ = ["PlayOptions", "Player"]

logger = logging.getLogger(__name__)

CLOCK_TOPIC = "/clock"
_LEAST_DEPTH = 1000
_BURST = 256


@dataclass(frozen=True)
class PlayOptions:
    """How to play.

    Attributes:
        rate: Bag seconds per second.
        loop: Begin again at the end.
        wants: Whether a topic, named as in the bag, is played.
        remap: New names of topics by their names in the bag.
        start_offset_s: Begin so many seconds after the bag's beginning.
        duration_s: End after so many bag seconds; None for the bag's end.
        clock_hz: Publish ``/clock`` that often, in times per second; None for not at all.
        delay_s: Wait so many seconds before the first message, for subscribers to come.
        paused: Begin paused.

    Raises:
        ConfigError: A value is out of range.
        InvalidName: A new name breaks the rules.
    """

    rate: float = 1.0
    loop: bool = False
    wants: Callable[[str], bool] = lambda _: True
    remap: Mapping[str, str] = field(default_factory=dict)
    start_offset_s: float = 0.0
    duration_s: float | None = None
    clock_hz: float | None = None
    delay_s: float = 0.0
    paused: bool = False

    def __post_init__(self) -> None:
        for name in ("rate", "clock_hz", "duration_s"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ConfigError(f"{name} must be more than 0, not {value!r}")
        for name in ("start_offset_s", "delay_s"):
            if not getattr(self, name) >= 0:
                raise ConfigError(f"{name} must not be negative, is {getattr(self, name)!r}")

    def new_name(self, topic: str) -> str:
        """Where the messages of a topic are published."""
        for old, new in self.remap.items():
            if topic_name(old) == topic:
                return topic_name(new)
        return topic


class Player:
    """Plays bags through a node. `open`, then `run`; the other methods may be called meanwhile.

    Args:
        node: A started node, which publishes.
        bags: What is played, together if they overlap. They stay open.
        options: How.

    Attributes:
        published: Messages published so far.
        skipped: Topics that are not played, and why.
    """

    def __init__(self, node: NodeHandle, bags: Sequence[Bag], options: PlayOptions) -> None:
        self.published = 0
        self.skipped: dict[str, str] = {}
        self._node = node
        self._bags = [bag for bag in bags if bag.message_count]
        self._options = options
        self._loop = asyncio.get_running_loop()
        self._publishers: dict[int, Publisher[object]] = {}
        self._clock: Publisher[Clock] | None = None
        self._first_bag = min(self._bags, key=lambda bag: bag.start_ns, default=None)
        begin = 0 if self._first_bag is None else self._first_bag.start_ns
        self._begin_ns = begin + round(options.start_offset_s * 1e9)
        last = max((bag.end_ns for bag in self._bags), default=0)
        if options.duration_s is not None:
            last = min(last, self._begin_ns + round(options.duration_s * 1e9))
        self._end_ns = last
        self._timeline = Timeline(self._begin_ns, 0.0, rate=options.rate, paused=True)
        self._woken = asyncio.Event()
        self._jump_ns: int | None = None
        self._steps = 0

    # -- what may be asked and told while it runs ----------------------------------------------

    @property
    def topics(self) -> list[str]:
        """The topics that are published, by their new names."""
        return sorted({publisher.topic for publisher in self._publishers.values()})

    @property
    def position_s(self) -> float:
        """Where playback is, in seconds after the first bag's beginning."""
        position = min(self._timeline.position_ns(self._loop.time()), self._end_ns)
        return (position - self._begin_ns) / 1e9 + self._options.start_offset_s

    @property
    def end_s(self) -> float:
        """Where it ends, in seconds after the first bag's beginning."""
        return (self._end_ns - self._begin_ns) / 1e9 + self._options.start_offset_s

    @property
    def rate(self) -> float:
        """Bag seconds per second."""
        return self._timeline.rate

    @property
    def is_paused(self) -> bool:
        """Whether it waits for `resume`."""
        return self._timeline.is_paused

    @property
    def dropped(self) -> int:
        """Messages that a subscriber was too slow for, or whose link broke."""
        return sum(item.statistics.dropped for item in set(self._publishers.values()))

    def pause(self) -> None:
        """Stand still."""
        self._timeline.pause(self._loop.time())
        self._woken.set()

    def resume(self) -> None:
        """Go on."""
        self._timeline.resume(self._loop.time())
        self._woken.set()

    def set_rate(self, rate: float) -> None:
        """Play faster or slower from now on.

        Raises:
            ConfigError: The rate is not a positive number.
        """
        self._timeline.set_rate(rate, self._loop.time())
        self._woken.set()

    def step(self) -> None:
        """Publish the next message, while paused."""
        if self.is_paused:
            self._steps += 1
            self._woken.set()

    def seek(self, position_s: float) -> None:
        """Go on from a place in seconds after the first bag's beginning; latched messages come first."""
        offset_ns = round((position_s - self._options.start_offset_s) * 1e9)
        self._jump_ns = min(max(self._begin_ns + offset_ns, self._begin_ns), self._end_ns)
        self._woken.set()

    # -- playing -------------------------------------------------------------------------------

    async def open(self) -> None:
        """Advertise the topics.

        Raises:
            NothingToPlay: None of them can be played.
        """
        channels = [
            topic
            for bag in self._bags
            for topic in bag.topics.values()
            if self._options.wants(topic.name)
        ]
        made: dict[tuple[str, str], Publisher[object] | None] = {}
        for topic in channels:
            key = self._options.new_name(topic.name), topic.msg_type
            if self._options.clock_hz is not None and key[0] == canonical(CLOCK_TOPIC):
                self.skipped[topic.name] = "the player publishes the clock itself"
                continue
            if key not in made:
                made[key] = await self._advertised(key[0], topic)
            publisher = made[key]
            if publisher is not None:
                self._publishers[id(topic)] = publisher
        if not self._publishers:
            why = "; ".join(f"{name}: {reason}" for name, reason in self.skipped.items())
            raise NothingToPlay(f"nothing to play ({why or 'no messages of the topics asked for'})")
        if self._options.clock_hz is not None:
            self._clock = await self._node.advertise(CLOCK_TOPIC, Clock)

    async def _advertised(self, name: str, topic: Topic) -> Publisher[object] | None:
        qos = profile_in(topic.metadata)
        try:
            return await self._node.advertise(
                f"/{canonical(name)}",
                topic.message_class,
                qos=qos.replace(depth=max(qos.depth, _LEAST_DEPTH)),
            )
        except (
            UnknownMessageType,
            TypeDefinitionConflict,
            TopicTypeMismatch,
            RegistrationRefused,
        ) as error:
            self.skipped[topic.name] = str(error)
            return None

    async def run(self) -> None:
        """Play to the end; for ever, if in a loop.

        Raises:
            BagDamaged: A part of a bag cannot be read.
            HandleClosed: The node was closed.
        """
        await asyncio.sleep(self._options.delay_s)
        clock = None if self._clock is None else asyncio.create_task(self._tick(self._clock))
        begin = self._begin_ns
        self._timeline.seek(self._begin_ns, self._loop.time())
        if not self._options.paused:
            self._timeline.resume(self._loop.time())
        try:
            while True:
                await self._play_from(begin)
                if self._jump_ns is not None:
                    begin, self._jump_ns = self._jump_ns, None
                elif self._options.loop:
                    begin = self._begin_ns
                else:
                    break
        finally:
            if clock is not None:
                clock.cancel()
                await asyncio.gather(clock, return_exceptions=True)
        for publisher in set(self._publishers.values()):
            await publisher.flush()

    async def _play_from(self, begin_ns: int) -> None:
        """Play from a bag time to the end, or until playback is to go on elsewhere."""
        latched = await self._loop.run_in_executor(None, self._latched_before, begin_ns)
        for earlier in latched:
            self._publish(earlier)
        await asyncio.sleep(0)  # they are on their way before anything else is published
        ahead = ReadAhead(self._read(begin_ns))
        try:
            self._timeline.seek(begin_ns, self._loop.time())
            while (message := await ahead.peek()) is not None:
                if not await self._wait_for(message.log_time):
                    return
                self._publish_due(ahead)
                # A bag at full speed must leave its turn to the links.
                await asyncio.sleep(0)
            await self._wait_for(self._end_ns)
        finally:
            await ahead.close()

    def _publish_due(self, ahead: ReadAhead[BagMessage]) -> None:
        now = self._loop.time()
        for _ in range(_BURST):
            message = ahead.ready()
            if message is None:
                return
            if self._steps:
                self._steps -= 1
                self._timeline.seek(message.log_time, now)
            elif self._timeline.due(message.log_time) > now:
                return
            ahead.take()
            self._publish(message)

    def _publish(self, message: BagMessage) -> None:
        publisher = self._publishers.get(id(message.topic))
        if publisher is not None:
            publisher.publish_bytes(message.data)
            self.published += 1

    async def _wait_for(self, stamp_ns: int) -> bool:
        """Return when a message of that time is due, or False when playback goes on elsewhere."""
        while self._jump_ns is None:
            delay = self._timeline.due(stamp_ns) - self._loop.time()
            if delay <= 0 or self._steps:
                return True
            self._woken.clear()
            try:
                async with asyncio.timeout(None if delay > 1e9 else delay):
                    await self._woken.wait()
            except TimeoutError:
                return self._jump_ns is None
        return False

    def _read(self, begin_ns: int) -> Iterator[BagMessage]:
        """Messages from a bag time on. Later files of a recording repeat what the first has said."""

        def read(bag: Bag) -> Iterator[BagMessage]:
            begins_inside = bag is not self._first_bag and bag.start_ns > begin_ns
            is_split = bag.metadata().get(RECORDING, {}).get("split", "0") != "0"
            repeats_ns = bag.start_ns if begins_inside and is_split else None
            names = {t.name for t in bag.topics.values() if id(t) in self._publishers}
            for message in bag.messages(names, start_ns=begin_ns, end_ns=self._end_ns + 1):
                if message.log_time != repeats_ns or message.publish_time == repeats_ns:
                    yield message

        return (message for _, message in in_order(self._bags, read))

    def _latched_before(self, begin_ns: int) -> list[BagMessage]:
        """What a node that starts now would be given."""
        histories: dict[str, LatchedHistory] = {}
        found: dict[tuple[str, bytes], BagMessage] = {}
        latched: list[BagMessage] = []
        for bag in self._bags:
            names = {topic.name for topic in bag.topics.values() if topic.is_latched}
            latched += bag.last_before(names, begin_ns, LatchedHistory.max_messages)
        for message in sorted(latched, key=lambda message: message.log_time):
            history = histories.setdefault(message.topic.name, LatchedHistory())
            history.add(message.data, message.log_time)
            found[message.topic.name, message.data] = message
        kept = (
            found[name, payload]
            for name, history in histories.items()
            for payload, _ in history.messages()
        )
        return sorted(kept, key=lambda message: message.log_time)

    async def _tick(self, publisher: Publisher[Clock]) -> None:
        assert self._options.clock_hz is not None
        period = 1.0 / self._options.clock_hz
        due = self._loop.time()
        while True:
            stamp = Timestamp()
            position = self._timeline.position_ns(self._loop.time())
            stamp.FromNanoseconds(min(position, self._end_ns))
            publisher.publish(Clock(clock=stamp))
            due = max(due + period, self._loop.time())
            await asyncio.sleep(due - self._loop.time())
