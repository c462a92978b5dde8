"""What a board creates at the agent, as XRCE's CREATE submessages in their binary form."""

from struct import pack

PARTICIPANT = b"\x00\x11"
_TOPIC, _PUBLISHER, _SUBSCRIBER, _WRITER, _READER = 2, 3, 4, 5, 6
_KEEP_LAST, _RELIABLE = 2, 1


class Topic:
    """A topic that the board publishes, or listens to.

    Args:
        number: From 1 to 4095, its own on this board.
        name: As in ``imu/data_raw``.
        type_name: As in ``sensor_msgs/Imu``.
        is_reliable: Whether what gets lost on the line is sent again.
        handler: For a topic to listen to: called with a buffer, a position and a size, plain CDR.
    """

    def __init__(self, number, name, type_name, is_reliable, handler=None):
        self.number = number
        self.name = name
        self.type_name = type_name
        self.is_reliable = is_reliable
        self.handler = handler
        self.endpoint = self.id(_WRITER if handler is None else _READER)

    def id(self, kind):
        """Id of its object of a kind: two bytes."""
        return pack(">H", self.number << 4 | kind)


def _text(text):
    data = text.encode() + b"\0"
    return pack("<I", len(data)) + data


def _dds_type(name):
    package, _, short = name.partition("/")
    return f"{package}::msg::dds_::{short}_"


def _padded(data):
    return data + bytes(-len(data) % 4)


def _create(request, object_id, body, parent):
    """CREATE: replaces an object of the same id (flags REUSE and REPLACE)."""
    head = pack(">H", request) + object_id + bytes((object_id[1] & 15, 3, 0, 0))
    payload = head + pack("<I", len(body)) + body
    if object_id == PARTICIPANT:
        payload += bytes(len(payload) % 2)
    payload += parent
    return _padded(pack("<BBH", 1, 0x07, len(payload)) + payload)


def participant(request, name):
    """The board itself, in domain 0."""
    return _create(request, PARTICIPANT, b"\0\x01\0\0" + _text(name), b"\0\0")


def steps(topic):
    """Kinds of objects of a topic, in the order in which they are created."""
    return (
        (_TOPIC, _PUBLISHER, _WRITER) if topic.handler is None else (_TOPIC, _SUBSCRIBER, _READER)
    )


def one_step(request, topic, kind):
    """The CREATE of one object of a topic."""
    if kind == _TOPIC:
        body = _padded(_text("rt/" + topic.name) + b"\0\x01") + _text(_dds_type(topic.type_name))
        return _create(request, topic.id(_TOPIC), body, PARTICIPANT)
    if kind in (_PUBLISHER, _SUBSCRIBER):
        return _create(request, topic.id(kind), b"\0\0", PARTICIPANT)
    quality = _KEEP_LAST | (_RELIABLE if topic.is_reliable else 0)
    none_more = bytes(4 if kind == _WRITER else 5)
    body = topic.id(_TOPIC) + pack("<BBHBBH", 1, 0, quality, 1, 0, 1) + none_more
    return _create(request, topic.endpoint, body, topic.id(kind - 2))


def read_request(request, topic):
    """READ_DATA: send whatever comes on that topic, for ever."""
    stream = 0x80 if topic.is_reliable else 0x01
    payload = pack(">H", request) + topic.endpoint + bytes((stream, 0, 0, 1))
    payload += pack("<HHHH", 0xFFFF, 0, 0, 0)
    return pack("<BBH", 8, 1, len(payload)) + payload
