"""Messages on their way to callbacks that run in the thread that spins.

The names and behaviour are those of the seed's ``MessageQueue``: topics are registered, hold a bounded
number of messages and give up the oldest, and every callback of a topic gets every message. Unlike
there, each subscriber has a queue of its own, so that one does not take another's messages or bounds,
`MessageQueue.process_callbacks` handles all that is due, and callbacks run with no lock held: they may
subscribe, unsubscribe and push.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from simple_ros.callbacks import CallbackGuard
from simple_ros.errors import ConfigError
from simple_ros.names import canonical

__all__ = ["CallbackGroup", "MessageQueue", "Token"]

logger = logging.getLogger(__name__)

DEFAULT_MAX_QUEUE_SIZE = 100


class CallbackGroup:
    """Which callbacks may run at the same time when several threads spin, as in ROS 2.

    Callbacks of one mutually exclusive group never run at the same time; those of a reentrant group
    may, even two calls of one callback. Everything is in the default group, which is mutually
    exclusive, unless said otherwise.
    """

    def __init__(self, *, reentrant: bool = False) -> None:
        self.reentrant = reentrant


DEFAULT_GROUP = CallbackGroup()


class Token:
    """One subscriber of a `MessageQueue`: a callback and what waits for it.

    Attributes:
        topic: Canonical topic name.
        group: Its callback group.
        dropped: Messages given up because its queue was full.
        handled: Calls of the callback.
    """

    def __init__(
        self, topic: str, callback: Callable[[Any], object], depth: int, group: CallbackGroup
    ) -> None:
        self.topic = topic
        self.group = group
        self.dropped = 0
        self.handled = 0
        self.waiting: deque[Any] = deque(maxlen=depth)
        self.guard = CallbackGuard(f"the subscription to {topic!r}")
        self.on_room: Callable[[], None] | None = None
        self._callback = callback
        self._closed = False

    @property
    def is_closed(self) -> bool:
        """Whether it was removed."""
        return self._closed

    @property
    def depth(self) -> int:
        """Messages that may wait."""
        return self.waiting.maxlen or 1

    def room(self) -> int:
        """Messages that can be put with none given up. May be asked from any thread."""
        return self.depth - len(self.waiting)

    def resize(self, depth: int) -> None:
        """Let ``depth`` messages wait from now on; the oldest beyond are given up."""
        self.dropped += max(0, len(self.waiting) - depth)
        self.waiting = deque(self.waiting, maxlen=depth)

    def put(self, messages: Sequence[Any]) -> None:
        """Append; the oldest fall."""
        overflow = len(self.waiting) + len(messages) - self.depth
        if overflow > 0:
            self.dropped += overflow
        self.waiting.extend(messages)

    def call(self, message: Any) -> None:
        """Call the callback, unless removed meanwhile; an exception is logged and counted."""
        if not self._closed:
            self.handled += 1
            try:
                self._callback(message)
            except Exception as error:
                self.guard.failed(error)

    def call_all(self, messages: Iterable[Any]) -> None:
        """As `call`, for several."""
        callback = self._callback
        for message in messages:
            if self._closed:
                return
            self.handled += 1
            try:
                callback(message)
            except Exception as error:
                self.guard.failed(error)

    def close(self) -> None:
        """Deliver nothing more."""
        self._closed = True
        self.waiting.clear()


class MessageQueue:
    """Thread-safe queues of messages by topic, and the callbacks that take them.

    Args:
        on_arrival: Called, from whichever thread pushes, when there is something to process.
    """

    def __init__(self, on_arrival: Callable[[], None] = lambda: None) -> None:
        self._on_arrival = on_arrival
        self._lock = threading.Lock()
        self._tokens: dict[str, list[Token]] = {}
        self._kept: dict[str, deque[Any]] = {}
        self._sizes: dict[str, int] = {}
        self._ready: dict[Token, None] = {}

    # -- topics and subscribers ----------------------------------------------------------------

    def register_topic(self, topic: str) -> None:
        """Keep messages of a topic from now on, also while nobody subscribes."""
        name = canonical(topic)
        with self._lock:
            self._register(name)

    def _register(self, name: str) -> None:
        if name not in self._tokens:
            self._tokens[name] = []
            self._kept[name] = deque(maxlen=self._sizes.get(name, DEFAULT_MAX_QUEUE_SIZE))

    def set_topic_max_queue_size(self, topic: str, max_size: int) -> None:
        """Bound the queues of a topic; the oldest messages beyond are given up.

        Raises:
            ConfigError: ``max_size`` is less than 1.
        """
        if max_size < 1:
            raise ConfigError(f"a queue holds at least 1 message, not {max_size}")
        name = canonical(topic)
        with self._lock:
            self._sizes[name] = max_size
            if name in self._kept:
                self._kept[name] = deque(self._kept[name], maxlen=max_size)
            for token in self._tokens.get(name, ()):
                token.resize(max_size)

    def add_subscriber(
        self,
        topic: str,
        callback: Callable[[Any], object],
        *,
        depth: int | None = None,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> Token:
        """Call ``callback`` with each message of a topic; it is registered if it was not.

        Args:
            topic: Topic name; a leading slash means nothing.
            callback: Called by whoever processes callbacks.
            depth: Messages that may wait for it; None takes the topic's.
            group: What it may run at the same time with.

        Returns:
            What `remove_subscriber` takes.
        """
        name = canonical(topic)
        with self._lock:
            self._register(name)
            size = depth or self._sizes.get(name, DEFAULT_MAX_QUEUE_SIZE)
            token = Token(name, callback, size, group)
            self._tokens[name].append(token)
            if self._kept[name]:
                token.put(self._kept[name])
                self._kept[name].clear()
                self._ready[token] = None
        if token.waiting:
            self._on_arrival()
        return token

    def remove_subscriber(self, which: Token | str) -> None:
        """Remove one subscriber by its token, or by topic name all of them and the topic itself."""
        with self._lock:
            if isinstance(which, Token):
                tokens = [which]
            else:
                name = canonical(which)
                tokens = self._tokens.pop(name, [])
                self._kept.pop(name, None)
                self._sizes.pop(name, None)
            for token in tokens:
                token.close()
                self._ready.pop(token, None)
                others = self._tokens.get(token.topic, [])
                if token in others:
                    others.remove(token)

    # -- messages ------------------------------------------------------------------------------

    def push(self, topic: str, message: Any) -> None:
        """Queue a message for every subscriber of a topic; unregistered topics drop it."""
        name = canonical(topic)
        with self._lock:
            tokens = self._tokens.get(name)
            if tokens is None:
                logger.warning("dropped a message on %r: the topic is not registered", name)
                return
            if not tokens:
                self._kept[name].append(message)
                return
            for token in tokens:
                token.put((message,))
                self._ready[token] = None
        self._on_arrival()

    def deliver(self, token: Token, messages: Sequence[Any]) -> None:
        """Queue messages for one subscriber: one hand-over for all that one read brought."""
        with self._lock:
            if token.is_closed:
                return
            token.put(messages)
            self._ready[token] = None
        self._on_arrival()

    # -- processing ----------------------------------------------------------------------------

    def process_callbacks(self) -> int:
        """Call the callbacks of everything that is due now; return how many calls that were.

        What arrives meanwhile is left for the next time. Topics take turns: each subscriber's messages
        are in order, and none waits for another subscriber to run empty.
        """
        with self._lock:
            batches = [(token, self._take(token)) for token in list(self._ready)]
        calls = 0
        if len(batches) == 1:
            ((token, messages),) = batches
            token.call_all(messages)
            return len(messages)
        while batches:
            rest = []
            for token, messages in batches:
                token.call(messages.popleft())
                calls += 1
                if messages:
                    rest.append((token, messages))
            batches = rest
        return calls

    def _take(self, token: Token) -> deque[Any]:
        """All that waits for a subscriber; the caller holds the lock."""
        messages = token.waiting
        token.waiting = deque(maxlen=token.depth)
        self._ready.pop(token, None)
        if token.on_room is not None:
            token.on_room()
        return messages

    def take_one(self, allowed: Callable[[Token], bool]) -> tuple[Token, Any] | None:
        """The oldest message of the next subscriber that ``allowed`` accepts (for several threads)."""
        with self._lock:
            for token in list(self._ready):
                if allowed(token):
                    message = token.waiting.popleft()
                    del self._ready[token]
                    if token.waiting:
                        self._ready[token] = None
                    if token.on_room is not None:
                        token.on_room()
                    return token, message
        return None

    @property
    def has_due(self) -> bool:
        """Whether `process_callbacks` would call anything."""
        return bool(self._ready)

    def close_tokens(self, tokens: Iterable[Token]) -> None:
        """Remove several subscribers."""
        for token in tokens:
            self.remove_subscriber(token)
