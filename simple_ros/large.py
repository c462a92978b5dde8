"""Messages whose largest field never passes through a protobuf object.

A camera image is a few numbers and six megabytes of pixels. `large` makes a class for such a type: the numbers
are a protobuf message, the pixels stay whatever buffer they are, a numpy array for instance, and are sent from
there and received in place. On the wire stand the same plain protobuf bytes, so that every other node and
tool, C++ ones included, reads them as ever::

    LargeImage = large(Image)
    publisher = await node.advertise("image", LargeImage)
    publisher.publish(LargeImage(Image(height=1080, width=1920, encoding="rgb8", step=5760), pixels))

    await node.subscribe("image", LargeImage, lambda image: show(image_to_numpy(image)))
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar, Generic, TypeVar

from google.protobuf.message import DecodeError, Message

from simple_ros.codecs import Codec, register_codec
from simple_ros.protobuf_wire import field_head, split_field
from simple_ros.wire.framing import LENT_BYTES

__all__ = ["LargeCodec", "LargeMessage", "large"]

MessageT = TypeVar("MessageT", bound=Message)

_BYTES_FIELD = 12


class LargeMessage(Generic[MessageT]):
    """A message with one large field beside it. Made by the classes that `large` returns.

    Other fields can be read as if they were its own: ``image.height``.

    Args:
        fields: The message, without the large field.
        data: The large field: any C-contiguous buffer. It may be changed once ``publish`` has returned.

    Attributes:
        fields: The message, without the large field.
        data: The large field, as flat bytes. Of a received message a read-only view, valid as long
            as it is held.

    Raises:
        TypeError: ``data`` is no buffer, or ``fields`` of another type.
        ValueError: ``data`` is not C-contiguous; numpy's ``ascontiguousarray`` helps.
    """

    message_class: ClassVar[type[Message]]
    field: ClassVar[str]
    number: ClassVar[int]

    __slots__ = ("data", "fields")

    def __init__(self, fields: MessageT, data: Any) -> None:
        if not isinstance(fields, self.message_class):
            wanted = self.message_class.DESCRIPTOR.full_name
            raise TypeError(f"fields must be a {wanted}, not {type(fields).__name__}")
        view = memoryview(data)
        if not view.c_contiguous:
            raise ValueError(f"the field {self.field!r} must be C-contiguous; copy it first")
        self.fields = fields
        self.data = view if view.ndim == 1 and view.format == "B" else view.cast("B")

    def __getattr__(self, name: str) -> Any:
        if name == self.field:
            return self.data
        return getattr(self.fields, name)

    def to_message(self) -> MessageT:
        """The same as one protobuf message; copies the large field."""
        whole = type(self.fields)()
        whole.CopyFrom(self.fields)
        setattr(whole, self.field, bytes(self.data))
        return whole

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LargeMessage) or other.message_class is not self.message_class:
            return NotImplemented
        return self.fields == other.fields and bool(self.data == other.data)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"<Large {self.message_class.DESCRIPTOR.full_name}: {len(self.data)} bytes {self.field}>"


@cache
def large(message_class: type[MessageT], field: str = "") -> type[LargeMessage[MessageT]]:
    """The class of messages of a type whose largest field is kept apart.

    Args:
        message_class: For instance ``sensor_msgs.Image``.
        field: Name of the field, of type bytes; may be left out if the type has only one.

    Raises:
        ValueError: There is no such field, or more than one.
    """
    fields = {
        item.name: item.number
        for item in message_class.DESCRIPTOR.fields
        if item.type == _BYTES_FIELD and not _repeated(item)
    }
    name = message_class.DESCRIPTOR.full_name
    if field and field not in fields:
        raise ValueError(
            f"{name} has no bytes field {field!r}; it has {', '.join(fields) or 'none'}"
        )
    if not field and len(fields) != 1:
        raise ValueError(f"name the field of {name} to keep apart: {', '.join(fields) or 'none'}")
    chosen = field or next(iter(fields))
    attributes = {
        "message_class": message_class,
        "field": chosen,
        "number": fields[chosen],
        "__slots__": (),
        "__doc__": f"A {name} whose {chosen} is kept apart.",
    }
    return type(f"Large{message_class.__name__}", (LargeMessage,), attributes)


def _repeated(field: Any) -> bool:
    return bool(field.is_repeated if hasattr(field, "is_repeated") else field.label == 3)


class LargeCodec(Codec):
    """Splits and joins them; see `LargeMessage`."""

    def handles(self, message_class: type) -> bool:
        """Classes that `large` made."""
        return isinstance(message_class, type) and issubclass(message_class, LargeMessage)

    def type_name(self, message_class: Any) -> str:
        """That of the protobuf type."""
        return str(message_class.message_class.DESCRIPTOR.full_name)

    def definition(self, message_class: Any) -> type[Message] | None:
        """The protobuf class."""
        found: type[Message] = message_class.message_class
        return found

    def encode(self, message: Any) -> bytes:
        """Join; copies the large field."""
        return b"".join(self.encode_parts(message))

    def encode_parts(self, message: Any) -> tuple[Any, ...]:
        """Everything but the large field, and that as it is."""
        data = message.data
        head = field_head(message.number, len(data))
        return message.fields.SerializeToString() + head, data

    def parter(self, message_class: type) -> Callable[[Any], tuple[Any, ...]] | None:  # noqa: ARG002
        """`encode_parts`."""
        return self.encode_parts

    def decode(self, data: memoryview, message_class: Any) -> Any:
        """Split; a large field stays where it was received."""
        rest, field = split_field(data, message_class.number)
        try:
            fields = message_class.message_class.FromString(rest)
        except DecodeError as error:
            raise ValueError(str(error)) from error
        kept = field.toreadonly() if len(data) >= LENT_BYTES else memoryview(bytes(field))
        return message_class(fields, kept)


register_codec(LargeCodec())
