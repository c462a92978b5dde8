"""One topic as clients see it: a channel with its messages, and channels derived from them."""

from __future__ import annotations

from collections.abc import Container, Sequence

from google.protobuf.message import DecodeError

from simple_ros.callbacks import CallbackGuard
from simple_ros.foxglove.client import Client
from simple_ros.foxglove.convert import Context, Converter, converters_for
from simple_ros.foxglove.convert.ros_names import as_shown, completion_for
from simple_ros.foxglove.errors import one_line, shortened
from simple_ros.foxglove.frames import Channel, Level
from simple_ros.foxglove.graph_model import shown
from simple_ros.foxglove.server import FoxgloveServer
from simple_ros.foxglove.type_book import schema_text

__all__ = ["ShownTopic"]


class ShownTopic:
    """Offers a topic.

    Args:
        server: Where.
        topic: Canonical name.
        msg_type: Full protobuf name.
        definition: The type's ``FileDescriptorSet``, serialised.
        taken: Canonical names of other topics: no derived channel is called like one of them.

    Attributes:
        topic: Canonical name.
        msg_type: Full protobuf name.
        channels: Ids of all its channels.
        derived_names: Canonical names of the derived channels.
    """

    def __init__(
        self,
        server: FoxgloveServer,
        topic: str,
        msg_type: str,
        definition: bytes,
        taken: Container[str] = (),
    ) -> None:
        self.topic = topic
        self.msg_type = msg_type
        self._server = server
        self._complete = completion_for(msg_type)
        self._guard = CallbackGuard(f"the conversion of {topic!r}")
        self._complaints: set[str] = set()
        schema_name, schema = as_shown(msg_type, definition)
        self._channel = server.add_channel(
            shown(topic),
            schema_name,
            schema_text(schema),
            recorded_as=None if schema_name == msg_type else (msg_type, definition),
        )
        self._taken = taken
        self._converters = self._made()
        self.derived_names = frozenset(topic + converter.suffix for converter in self._converters)
        self._derived: list[Channel] = [
            server.add_channel(
                shown(topic) + converter.suffix,
                converter.schema_name,
                schema_text(converter.schema),
            )
            for converter in self._converters
        ]
        self.channels = (self._channel.id, *(channel.id for channel in self._derived))

    def restart(self) -> None:
        """Messages come anew, as if there had been none before."""
        self._converters = self._made()
        self._forget_complaints()

    def _made(self) -> list[Converter]:
        """New converters, which remember nothing."""
        found = converters_for(self.msg_type)
        return [item for item in found if self.topic + item.suffix not in self._taken]

    @property
    def is_wanted(self) -> bool:
        """Whether any client is subscribed to one of its channels."""
        return any(map(self._server.is_wanted, self.channels))

    def mark_latched(self) -> None:
        """Its messages count for long."""
        for channel in self.channels:
            self._server.mark_latched(channel)

    def withdraw(self) -> None:
        """Offer it no more."""
        self._server.remove_channels(self.channels)
        self._forget_complaints()

    def publish(self, stamp_ns: int, payloads: Sequence[bytes]) -> None:
        """Send messages that came at one time to all who want them, as they want them."""
        self._server.publish(self._channel.id, stamp_ns, self._completed(payloads, stamp_ns))
        for channel, converter in zip(self._derived, self._converters, strict=True):
            if self._server.is_wanted(channel.id):
                made = [self._converted(converter, payload, stamp_ns) for payload in payloads]
                known = [payload for payload in made if payload is not None]
                self._server.publish(channel.id, stamp_ns, known)

    def publish_to(
        self, client: Client, channel: int, messages: Sequence[tuple[bytes, int]]
    ) -> None:
        """Send messages, given with their times in ns, to one client on one of the channels."""
        if channel == self._channel.id:
            for payload, stamp_ns in messages:
                for whole in self._completed([payload], stamp_ns):
                    self._server.publish_to(client, channel, stamp_ns, whole)
            return
        # Converters remember: what is told again must not count twice.
        converter = self._made()[self.channels.index(channel) - 1]
        for payload, stamp_ns in messages:
            made = self._converted(converter, payload, stamp_ns)
            if made is not None:
                self._server.publish_to(client, channel, stamp_ns, made)

    def _completed(self, payloads: Sequence[bytes], stamp_ns: int) -> Sequence[bytes]:
        """The messages of the topic itself, as published but for what its panels cannot do without."""
        if self._complete is None:
            return payloads
        whole = []
        for payload in payloads:
            try:
                whole.append(self._complete(payload, stamp_ns))
            except DecodeError as error:
                self._guard.failed(error)
        return whole

    def _context(self, stamp_ns: int) -> Context:
        return Context(stamp_ns, shown(self.topic), self._server.options.frame_id)

    def _converted(self, converter: Converter, payload: bytes, stamp_ns: int) -> bytes | None:
        try:
            return converter.convert(payload, self._context(stamp_ns))
        except Exception as error:
            # One bad message must not end the subscription; the guard counts and logs it.
            self._guard.failed(error)
            self._complain(converter, error)
            return None

    def _complain(self, converter: Converter, error: Exception) -> None:
        """Say in the app why a panel stays empty: once, as apps keep every text that is another one."""
        name = f"unshown-{self.topic}{converter.suffix}"
        if name not in self._complaints:
            self._complaints.add(name)
            reason = shortened(one_line(error))
            text = f"{shown(self.topic)}{converter.suffix}: {reason}"
            self._server.say_status(Level.WARNING, text, name)

    def _forget_complaints(self) -> None:
        while self._complaints:
            self._server.take_back_status(self._complaints.pop())
