"""Recordings for apps: messages of bags at the pace at which they came, controlled by clients."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from simple_ros.bag.errors import BagDamaged, NothingToPlay
from simple_ros.bag.messages import BagMessage, Topic
from simple_ros.bag.ordering import in_order
from simple_ros.bag.read_ahead import ReadAhead
from simple_ros.bag.reader import Bag
from simple_ros.bag.timeline import Timeline
from simple_ros.foxglove import frames
from simple_ros.foxglove.client import Client
from simple_ros.foxglove.errors import one_line
from simple_ros.foxglove.events import ChannelWanted, Event, PlaybackWanted
from simple_ros.foxglove.frames import PlaybackState, Playing
from simple_ros.foxglove.look_back import LookBack
from simple_ros.foxglove.requests import PlaybackControl
from simple_ros.foxglove.server import FoxgloveServer, ServerOptions
from simple_ros.foxglove.shown_topic import ShownTopic

__all__ = ["BagPlayback", "PlaybackOptions"]

_BURST = 256
_MOST_SPEED = 1000.0


@dataclass(frozen=True)
class PlaybackOptions:
    """How to play.

    Attributes:
        speed: Bag seconds per second.
        loop: Begin again at the end.
        paused: Wait for a client that wants it to play; else it begins when the first one comes.
    """

    speed: float = 1.0
    loop: bool = False
    paused: bool = False


class BagPlayback:
    """Plays bags to the clients of a server. Let `server` listen and await `run`.

    Args:
        bags: What is played, together if they overlap. They stay open.
        server: How to serve.
        options: How to play.

    Raises:
        NothingToPlay: The bags hold no message whose type is known.
        ConfigError: The speed is not a positive number.

    Attributes:
        server: To listen with.
        skipped: Topics that are not shown, and why.
    """

    def __init__(
        self, bags: Sequence[Bag], server: ServerOptions, options: PlaybackOptions
    ) -> None:
        self.skipped: dict[str, str] = {}
        self._bags = [bag for bag in bags if bag.message_count]
        self._options = options
        self._loop = asyncio.get_running_loop()
        self._begin_ns = min((bag.start_ns for bag in self._bags), default=0)
        self._end_ns = max((bag.end_ns for bag in self._bags), default=0)
        self._timeline = Timeline(
            self._begin_ns, self._loop.time(), rate=options.speed, paused=True
        )
        self._has_begun = options.paused
        self._has_ended = False
        self._jump_ns: int | None = None
        self._jumps = 0
        self._played_ns = self._begin_ns
        self._look_back = LookBack(bag.path for bag in self._bags)
        self._woken = asyncio.Event()
        self._settled = asyncio.Event()
        self._settled.set()
        self._tasks: set[asyncio.Task[None]] = set()
        self.server = FoxgloveServer(
            server,
            {"time", "playbackControl"} - server.access.hidden,
            self._now_ns,
            (self._begin_ns, self._end_ns),
        )
        self.server.on_event = self._event
        self.server.on_client = self._client_came
        self._shown: dict[tuple[str, str], ShownTopic] = {}
        self._said: Counter[str] = Counter()
        self._by_channel: dict[int, ShownTopic] = {}
        self._latched: set[str] = set()
        self._offer()

    def _offer(self) -> None:
        made: dict[str, ShownTopic] = {}
        names = frozenset(topic.name for bag in self._bags for topic in bag.topics.values())
        for topic in [topic for bag in self._bags for topic in bag.topics.values()]:
            reason = self._why_not(topic, made)
            if reason:
                self.skipped[topic.name] = reason
                continue
            item = made.get(topic.name)
            if item is None:
                item = ShownTopic(self.server, topic.name, topic.msg_type, topic.definition, names)
                made[topic.name] = item
            self._shown[topic.name, topic.msg_type] = item
            self._by_channel |= dict.fromkeys(item.channels, item)
            if topic.is_latched:
                self._latched.add(topic.name)
                item.mark_latched()
        if not made:
            why = "; ".join(f"{name}: {reason}" for name, reason in self.skipped.items())
            raise NothingToPlay(f"nothing to play ({why or 'no messages'})")

    def _why_not(self, topic: Topic, made: dict[str, ShownTopic]) -> str:
        """Why a topic is not shown; empty if it is."""
        if not self.server.options.access.wants(topic.name):
            return "left out by --topics or --exclude"
        if topic.encoding != "protobuf" or not topic.definition:
            return f"no definition of its type {topic.msg_type or '(none)'} is recorded"
        known = made.get(topic.name)
        if known is not None and known.msg_type != topic.msg_type:
            return f"its type changes from {known.msg_type} to {topic.msg_type}; the first is shown"
        return ""

    # -- state ---------------------------------------------------------------------------------

    def _now_ns(self) -> int:
        return min(self._timeline.position_ns(self._loop.time()), self._end_ns)

    @property
    def state(self) -> PlaybackState:
        """Where playback is."""
        playing = Playing.PAUSED if self._timeline.is_paused else Playing.PLAYING
        status = Playing.ENDED if self._has_ended else playing
        return PlaybackState(status, self._now_ns(), self._timeline.rate)

    def _tell_state(self) -> None:
        self.server.say_if(
            lambda session: session.controls_playback, frames.playback_state(self.state)
        )

    # -- what clients do -----------------------------------------------------------------------

    def _client_came(self, client: Client) -> None:  # noqa: ARG002
        if not self._has_begun:
            self._has_begun = True
            self._resume()

    def _event(self, client: Client, event: Event) -> None:
        match event:
            case PlaybackWanted(control):
                self._control(client, control)
            case ChannelWanted(channel):
                item = self._by_channel.get(channel)
                if item is not None:
                    state = self._jumps, self._said[item.topic]
                    task = self._loop.create_task(self._replay(client, channel, item, state))
                    self._tasks.add(task)
                    task.add_done_callback(self._tasks.discard)

    def _control(self, client: Client, control: PlaybackControl) -> None:
        self._has_begun = True
        if 0 < control.speed <= _MOST_SPEED:
            self._timeline.set_rate(control.speed, self._loop.time())
        else:
            client.session.complain(
                f"The speed must be above 0 and at most {_MOST_SPEED:g}, not {control.speed:g}"
            )
        if control.seek_ns is not None:
            self._seek(control.seek_ns)
        elif control.is_play and self._has_ended:
            self._seek(self._begin_ns)
        if control.is_play:
            self._resume()
        else:
            self._timeline.pause(self._loop.time())
        self._woken.set()
        did_seek = control.seek_ns is not None
        answer = frames.playback_state(self.state, did_seek=did_seek, request_id=control.request_id)
        client.session.say(answer)
        others = frames.playback_state(self.state, did_seek=did_seek)
        self.server.say_if(
            lambda session: session.controls_playback and session is not client.session, others
        )

    def _seek(self, stamp_ns: int) -> None:
        self._jump_ns = min(max(stamp_ns, self._begin_ns), self._end_ns)
        self._played_ns = self._jump_ns + 1
        self._jumps += 1
        self._settled.clear()
        self._timeline.seek(self._jump_ns, self._loop.time())
        self._has_ended = False
        self.server.time_jumped()
        self._restart()

    def _restart(self) -> None:
        for item in self._shown.values():
            item.restart()

    def _resume(self) -> None:
        self._timeline.resume(self._loop.time())
        self._woken.set()

    # -- what was said before ------------------------------------------------------------------

    async def _before(self, topics: set[str]) -> list[BagMessage]:
        """What topics said last before what is to come."""
        find = self._look_back.find
        return await self._loop.run_in_executor(None, find, topics, self._latched, self._played_ns)

    async def _replay(
        self, client: Client, channel: int, item: ShownTopic, state: tuple[int, int]
    ) -> None:
        """Give a client that subscribed what stood then, unless it was told more since."""
        await self._settled.wait()
        try:
            found = await self._before({item.topic})
        except BagDamaged as error:
            client.session.complain(one_line(error))
            client.process()
            return
        if state == (self._jumps, self._said[item.topic]):
            known = [message for message in found if self._shown_as(message) is item]
            item.publish_to(
                client, channel, [(message.data, message.log_time) for message in known]
            )

    async def _show_what_stood(self) -> None:
        """After a jump, tell what stands there, as if it had been played up to there."""
        wanted = {item.topic for item in self._shown.values() if item.is_wanted}
        for message in await self._before(wanted | self._latched):
            # Whoever jumps again meanwhile must not see this any more.
            if self._jump_ns is None:
                self._publish(message)
        if self._jump_ns is None:
            self._settled.set()

    # -- playing -------------------------------------------------------------------------------

    async def run(self) -> None:
        """Play until cancelled; at the end, wait for a client that goes back.

        Raises:
            BagDamaged: A part of a bag cannot be read.
        """
        try:
            while True:
                if await self._play() and self._options.loop:
                    self._timeline.seek(self._begin_ns, self._loop.time())
                    self._played_ns = self._begin_ns
                    self._restart()
                    self.server.reset_session()
                    continue
                await self._until_jump()
                self._jump_ns = None
                await self._show_what_stood()
        finally:
            for task in list(self._tasks):
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)
            await self._loop.run_in_executor(None, self._look_back.close)

    async def _until_jump(self) -> None:
        """Return when a client went elsewhere; at the end of the bags that is waited for."""
        if self._jump_ns is None:
            self._has_ended = True
            self._timeline.pause(self._loop.time())
            self._timeline.seek(self._end_ns, self._loop.time())
            self._tell_state()
        while self._jump_ns is None:
            self._woken.clear()
            await self._woken.wait()

    async def _play(self) -> bool:
        """Play what has not been played; whether that came to the end, and not to a jump."""
        ahead = ReadAhead(self._read(self._played_ns))
        try:
            while (message := await ahead.peek()) is not None:
                if not await self._wait_for(message.log_time):
                    return False
                self._publish_due(ahead)
                # A bag at full speed must leave its turn to the clients.
                await asyncio.sleep(0)
            return await self._wait_for(self._end_ns)
        finally:
            await ahead.close()

    def _publish_due(self, ahead: ReadAhead[BagMessage]) -> None:
        now = self._loop.time()
        for _ in range(_BURST):
            message = ahead.ready()
            if message is None or self._timeline.due(message.log_time) > now:
                return
            ahead.take()
            self._publish(message)

    def _shown_as(self, message: BagMessage) -> ShownTopic | None:
        return self._shown.get((message.topic.name, message.topic.msg_type))

    def _publish(self, message: BagMessage) -> None:
        self._played_ns = max(self._played_ns, message.log_time + 1)
        item = self._shown_as(message)
        if item is not None:
            self._said[item.topic] += 1
            item.publish(message.log_time, [message.data])

    async def _wait_for(self, stamp_ns: int) -> bool:
        """Return when a message of that time is due, or False when playback goes on elsewhere."""
        while self._jump_ns is None:
            delay = self._timeline.due(stamp_ns) - self._loop.time()
            if delay <= 0:
                return True
            self._woken.clear()
            try:
                async with asyncio.timeout(None if delay > 1e9 else delay):
                    await self._woken.wait()
            except TimeoutError:
                continue
        return False

    def _read(self, begin_ns: int) -> Iterator[BagMessage]:
        names = {item.topic for item in self._shown.values()}
        return (
            message
            for _, message in in_order(
                self._bags, lambda bag: bag.messages(names, start_ns=begin_ns)
            )
        )
