"""Codecs: what a message class has to do with bytes.

Protobuf classes need none. A codec lets publishers and subscriptions use other classes, say a numpy
array for an image, or a dataclass; what stands on the wire is up to it, best the bytes of a protobuf
type, so that everybody else can read them. Codecs of other packages are found in the entry point group
``simple_ros.codecs``; `register_codec` adds one by hand.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from google.protobuf.message import DecodeError, Message

from simple_ros import plugins

__all__ = ["Codec", "ProtobufCodec", "codec_of", "register_codec"]

logger = logging.getLogger(__name__)


class Codec(ABC):
    """The contract. One object serves all topics; it may be asked from several threads."""

    @abstractmethod
    def handles(self, message_class: type) -> bool:
        """Whether messages of this class are its business."""

    @abstractmethod
    def type_name(self, message_class: type) -> str:
        """The type's name on the wire: what publishers and subscriptions must agree in.

        The full name of a protobuf type if the bytes are one.
        """

    @abstractmethod
    def encode(self, message: Any) -> bytes:
        """A message as bytes.

        Raises:
            ValueError: It cannot be written; ``publish`` raises this.
        """

    @abstractmethod
    def decode(self, data: memoryview, message_class: type) -> Any:
        """A message from bytes. ``data`` ends with the call: copy what you keep.

        Raises:
            ValueError: The bytes are none; counted and dropped.
        """

    def definition(self, message_class: type) -> type[Message] | None:  # noqa: ARG002
        """The protobuf class that describes the bytes to tools, if one does."""
        return None

    def encoder(self, message_class: type) -> Callable[[Any], bytes]:  # noqa: ARG002
        """What a publisher calls for each message."""
        return self.encode

    def parter(self, message_class: type) -> Callable[[Any], tuple[Any, ...]] | None:  # noqa: ARG002
        """What makes of a message the buffers that together are its bytes, if it is not one."""
        return None

    def decoder(self, message_class: type) -> Callable[[Any], Any]:
        """What a subscription calls for each message; equal for equal classes."""
        return _Decoder(self, message_class)


class _Decoder:
    """Decodes one class; what a codec finds wrong is malformed input."""

    __slots__ = ("codec", "message_class")

    def __init__(self, codec: Codec, message_class: type) -> None:
        self.codec = codec
        self.message_class = message_class

    def __call__(self, data: Any) -> Any:
        try:
            return self.codec.decode(memoryview(data), self.message_class)
        except ValueError as error:
            raise DecodeError(str(error)) from error

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Decoder) and (self.codec, self.message_class) == (
            other.codec,
            other.message_class,
        )

    def __hash__(self) -> int:
        return hash((id(self.codec), self.message_class))


class ProtobufCodec(Codec):
    """For protobuf classes: nothing stands between them and the wire."""

    def handles(self, message_class: type) -> bool:
        """Every generated message class, and those of `MsgFactory`."""
        return isinstance(message_class, type) and issubclass(message_class, Message)

    def type_name(self, message_class: type) -> str:
        """The full name, as ``geometry_msgs.Twist``."""
        return str(message_class.DESCRIPTOR.full_name)  # type: ignore[attr-defined]

    def encode(self, message: Any) -> bytes:
        """Serialise."""
        return bytes(message.SerializeToString())

    def decode(self, data: memoryview, message_class: type) -> Any:
        """Parse."""
        return message_class.FromString(data)  # type: ignore[attr-defined]

    def definition(self, message_class: type) -> type[Message] | None:
        """Itself."""
        return message_class

    def encoder(self, message_class: type) -> Callable[[Any], bytes]:
        """The class's own serialiser."""
        return message_class.SerializeToString  # type: ignore[attr-defined,no-any-return]

    def decoder(self, message_class: type) -> Callable[[Any], Any]:
        """The class's own parser."""
        return message_class.FromString  # type: ignore[attr-defined,no-any-return]


_PROTOBUF = ProtobufCodec()
_registered: list[Codec] = []
_installed: list[Codec] | None = None


def register_codec(codec: Codec) -> None:
    """Use a codec in this process; the last registered is asked first."""
    _registered.insert(0, codec)


def codec_of(message_class: Any) -> Codec:
    """The codec for a message class.

    Raises:
        TypeError: It is no protobuf class and no codec handles it.
    """
    if _PROTOBUF.handles(message_class):
        return _PROTOBUF
    if isinstance(message_class, type):
        for codec in (*_registered, *_from_packages()):
            if codec.handles(message_class):
                return codec
    known = [type(codec).__name__ for codec in (*_registered, *_from_packages())]
    also = f", and no codec handles it (installed: {', '.join(known) or 'none'})"
    raise TypeError(f"{message_class!r} is not a protobuf message class{also}")


def _from_packages() -> list[Codec]:
    global _installed
    if _installed is None:
        _installed = []
        for name, plugin in plugins.load_all(plugins.CODECS):
            codec = plugin() if isinstance(plugin, type) else plugin
            if isinstance(codec, Codec):
                _installed.append(codec)
            else:
                logger.warning("codec plug-in %r is left out: %s", name, _what(plugin))
    return _installed


def _what(plugin: object) -> str:
    if isinstance(plugin, plugins.BrokenPlugin):
        return plugin.reason
    return f"{plugin!r} is no simple_ros.codecs.Codec"
