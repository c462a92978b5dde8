"""The agent, message by message. What a board sends is written out here by hand."""

from __future__ import annotations

import json
import random
import struct
from typing import Any

import pytest

from simple_ros.errors import MessageTooLarge
from simple_ros_firmware_bridge.serial_agent import SerialAgent
from simple_ros_firmware_bridge.simulator.client import BoardClient, Stage
from simple_ros_firmware_bridge.simulator.creation import Topic
from simple_ros_firmware_bridge.simulator.line import LineReader, frame
from simple_ros_firmware_bridge.xrce.agent import Agent
from simple_ros_firmware_bridge.xrce.creation import ObjectId
from simple_ros_firmware_bridge.xrce.downlink import Downlink
from simple_ros_firmware_bridge.xrce.events import (
    EndpointGone,
    EndpointRefused,
    ReaderReady,
    Sample,
    ServiceCalled,
    ServiceOffered,
    ServiceReplied,
    ServiceWanted,
    SessionClosed,
    SessionOpened,
    SessionResumed,
    WriterReady,
)
from simple_ros_firmware_bridge.xrce.objects import Profile
from simple_ros_firmware_bridge.xrce.output_stream import ReliableOutput
from simple_ros_firmware_bridge.xrce.session import UnknownReader

HELLO = bytes.fromhex("80000000 00011000 58524345 0100 010f 01020304 81 00 fc01")
ODOM = Topic(1, "/odom", "nav_msgs/Odometry")
IMU_XML = Topic(2, "/imu", "sensor_msgs/Imu", by_xml=True)
BEST_EFFORT = Topic(3, "/tof", "sensor_msgs/Range", is_reliable=False)
CMD_VEL = Topic(4, "/cmd_vel", "geometry_msgs/Twist", is_published=False)
WRITER = ODOM.endpoint_id


def agent(**options: Any) -> Agent:
    return Agent(lambda name: "Unknown" not in name, lambda: 5_000_000_007, **options)


def connected(*topics: Topic, **options: Any) -> tuple[Agent, BoardClient]:
    made, client = agent(**options), BoardClient(list(topics))
    exchange(made, client)
    return made, client


def exchange(made: Agent, client: BoardClient, now: float = 0.0, rounds: int = 100) -> list[Any]:
    events: list[Any] = []
    for _ in range(rounds):
        client.handle_timeout(now)
        for message in client.data_to_send():
            made.receive(message, now)
        made.handle_timeout(now)
        for message in made.data_to_send():
            client.receive(message, now)
        events += made.events()
        now += 2e-3
    return events


def write(number: int, data: bytes = b"data", stream: int = 0x80, session: int = 0x81) -> bytes:
    body = b"\x07\x01" + struct.pack("<H", 4 + len(data)) + b"\x00\x09" + WRITER + data
    return struct.pack("<BBH", session, stream, number) + body


def test_create_client_is_answered_as_every_client_expects() -> None:
    made = agent()
    made.receive(HELLO, 0.0)
    assert made.data_to_send() == [bytes.fromhex("81000000 04010b00 0000 58524345 0100 010f 00")]
    assert made.events() == [SessionOpened("01020304", is_same=False)]


def test_a_ping_says_whether_there_is_a_session() -> None:
    made = agent()
    ping = bytes.fromhex("80000000 02010800 000afffd 02000000")
    for session in (0, 1):
        made.receive(ping, 0.0)
        answer = made.data_to_send()[-1]
        assert answer[:8] == bytes.fromhex("80000000 06011c00")
        assert answer[8:] == bytes.fromhex("000afffd 00") + bytes((session,)) + bytes.fromhex(
            "010d 58524345 0100 010f 00 010d 00 0100 0000 00000000"
        )
        made.receive(HELLO, 0.0)


def test_a_board_of_another_session_is_told_that_there_is_none() -> None:
    made, _ = connected(ODOM)
    for session, alive in ((0x81, 1), (0x82, 0), (0x80, 1)):
        made.receive(bytes((session,)) + bytes.fromhex("000000 02010800 000afffd 02000000"), 0.0)
        (answer,) = made.data_to_send()
        assert answer[13] == alive


def test_time_is_told() -> None:
    made = agent()
    made.receive(bytes.fromhex("81000000 0e010800 01000000 02000000"), 0.0)
    (answer,) = made.data_to_send()
    assert answer[4:8] == bytes.fromhex("0f011800")
    assert struct.unpack("<iIiIiI", answer[8:]) == (5, 7, 5, 7, 1, 2)


def test_a_board_connects_creates_publishes_and_subscribes() -> None:
    made, client = agent(), BoardClient([ODOM, IMU_XML, BEST_EFFORT, CMD_VEL])
    events = exchange(made, client)
    assert client.stage is Stage.RUNNING
    writers = [event.endpoint for event in events if isinstance(event, WriterReady)]
    assert [(item.topic, item.type_name, item.reliable) for item in writers] == [
        ("rt/odom", "nav_msgs::msg::dds_::Odometry_", True),
        ("rt/imu", "sensor_msgs::msg::dds_::Imu_", True),
        ("rt/tof", "sensor_msgs::msg::dds_::Range_", False),
    ]
    (reader,) = [event.endpoint for event in events if isinstance(event, ReaderReady)]
    assert reader.topic == "rt/cmd_vel"
    sample = bytes(range(256)) * 3
    for index, data in ((0, sample), (1, b"imu"), (2, b"tof")):
        assert client.publish(index, data, 1.0)
        assert [event.data for event in exchange(made, client, 1.0)] == [data]
    made.write(reader.object_id, b"twist" * 200, "cmd_vel", 1.0)
    exchange(made, client, 1.0)
    assert client.take_samples() == [(3, b"twist" * 200)]


def test_the_answer_is_there_before_the_sample() -> None:
    made, _ = connected(ODOM)
    session = made.session
    assert session is not None
    number = session.streams.inputs[0].expected
    assert number is not None
    made.receive(write(number), 1.0)
    first = struct.pack("<H", number + 1)
    assert made.data_to_send() == [b"\x81\x00\x00\x00\x0a\x01\x05\x00" + first + b"\0\0\x80"]
    (sample,) = made.events()
    assert sample == Sample(ObjectId(WRITER), b"data", "<")


def test_messages_come_in_order_each_once() -> None:
    made, _ = connected(ODOM)
    assert made.session is not None
    base = made.session.streams.inputs[0].expected or 0
    texts = []
    for offset in (1, 1, 3, 0, 2, 0):
        made.receive(write(base + offset, b"%d" % offset), 1.0)
        texts += [event.data for event in made.events()]
    assert texts == [b"0", b"1", b"2", b"3"]
    assert made.session.streams.inputs[0].counters.duplicates == 2


def test_holes_are_asked_for_once_per_wait() -> None:
    made, _ = connected(ODOM)
    assert made.session is not None
    base = made.session.streams.inputs[0].expected or 0
    made.data_to_send()
    asked = []
    for offset, now in ((1, 1.0), (2, 1.0001), (3, 1.0002), (4, 3.0)):
        made.receive(write(base + offset), now)
        (answer,) = made.data_to_send()
        assert answer[8:10] == struct.pack("<H", base)
        asked.append(int.from_bytes(answer[10:12], "big"))
    assert asked == [1, 0, 0, 1]


def test_on_a_line_that_damages_messages_answers_go_twice_and_questions_once() -> None:
    made, _ = connected(ODOM)
    assert made.session is not None
    base = made.session.streams.inputs[0].expected or 0
    made.receive(write(base), 1.0)
    assert len(made.data_to_send()) == 1
    made.line_damaged(b"", 1.1)
    assert len(made.data_to_send()) == 1
    made.receive(write(base + 1), 1.2)
    first, second = made.data_to_send()
    assert (
        first == second == b"\x81\0\0\0\x0a\x01\x05\0" + struct.pack("<H", base + 2) + b"\0\0\x80"
    )
    made.receive(write(base + 3), 1.3)
    assert len(made.data_to_send()) == 1
    for number in range(2, 200):
        made.receive(write(base + number), 2.0)
        made.data_to_send()
    made.receive(write(base + 200), 3.0)
    assert len(made.data_to_send()) == 1


def test_numbers_wrap() -> None:
    made, client = connected(ODOM)
    texts = []
    for number in range(70_000):
        if number % 500 == 0:
            assert client.publish(0, b"%d" % number, 1.0)
            texts += [event.data for event in exchange(made, client, 1.0, rounds=2)]
    assert len(texts) == 140
    assert made.session is not None
    stream = made.session.streams.inputs[0]
    stream.expected = 0xFFFE
    for number in (0xFFFE, 0xFFFF, 0, 1):
        made.receive(write(number), 2.0)
    assert stream.expected == 2


def test_big_endian_boards_and_boards_with_a_key_in_each_header() -> None:
    made = agent()
    key = b"\x0a\x0b\x0c\x0d"
    hello = b"XRCE\x01\x00\x01\x0f" + key + b"\x01\x00" + struct.pack(">H", 512)
    head = b"\x00\x00\x00\x00" + key
    made.receive(head + b"\x00\x00" + struct.pack(">H", len(hello)) + hello, 0.0)
    (answer,) = made.data_to_send()
    assert answer[:8] == b"\x01\x00\x00\x00" + key
    name, kind = b"rt/odom\0", b"nav_msgs::msg::dds_::Odometry_\0"
    body = struct.pack(">I", len(name)) + name + b"\0\x01\0\0" + struct.pack(">I", len(kind)) + kind
    made.receive(keyed(0, created(b"\x00\x12", 2, 3, body), key), 0.0)
    end = b"\x00\x12\x01\x00" + struct.pack(">H", 1) + b"\0\0\0\0\0"
    made.receive(keyed(1, created(b"\x00\x15", 5, 3, end), key), 0.0)
    data = b"\x07\x00" + struct.pack(">H", 8) + b"\x00\x09\x00\x15" + b"\0\0\0\x07"
    made.receive(keyed(2, data, key), 0.0)
    *_, ready, sample = made.events()
    assert ready.endpoint.type_name == "nav_msgs::msg::dds_::Odometry_"
    assert sample == Sample(ObjectId(b"\x00\x15"), b"\0\0\0\x07", ">")
    assert all(message[:1] + message[4:8] == b"\x01" + key for message in made.data_to_send())


def keyed(number: int, body: bytes, key: bytes) -> bytes:
    return struct.pack("<BBH", 0x01, 0x80, number) + key + body


def created(object_id: bytes, kind: int, form: int, body: bytes, order: str = ">") -> bytes:
    payload = b"\x00\x07" + object_id + bytes((kind, form, 0, 0))
    payload += struct.pack(order + "I", len(body)) + body + b"\x00\x13"
    flags = b"\x01\x07" if order == "<" else b"\x01\x06"
    return flags + struct.pack(order + "H", len(payload)) + payload


def test_profiles_of_boards_that_create_by_reference() -> None:
    profiles = {"odom": Profile("rt/odom", "nav_msgs::msg::dds_::Odometry_")}
    made = agent(profiles=profiles)
    made.receive(HELLO, 0.0)
    for number, (object_id, kind, text) in enumerate(
        (
            (b"\x00\x12", 2, b"odom__t\0"),
            (b"\x00\x15", 5, b"odom__dw\0"),
            (b"\x00\x25", 5, b"lux__dw\0"),
        )
    ):
        body = created(object_id, kind, 1, text, "<")
        made.receive(struct.pack("<BBH", 0x81, 0x80, number) + body, 0.0)
    _, ready, refused = made.events()
    assert ready.endpoint.topic == "rt/odom"
    assert isinstance(refused, EndpointRefused)
    assert "lux__dw" in refused.reason


def test_an_unknown_type_is_refused_and_told() -> None:
    made, client = agent(), BoardClient([Topic(1, "/a", "my_msgs/Unknown")])
    events = exchange(made, client, rounds=20)
    assert any(isinstance(event, EndpointRefused) and "rt/a" in event.reason for event in events)
    assert client.counters.resets > 0


def test_no_more_than_four_messages_are_under_way_and_the_newest_sample_wins() -> None:
    made, client = connected(CMD_VEL)
    reader = ObjectId(CMD_VEL.endpoint_id)
    for number in range(100):
        made.write(reader, b"%3d " % number, "cmd_vel", 1.0)
    under_way = made.data_to_send()
    assert len(under_way) == 4
    for message in under_way:
        client.receive(message, 1.0)
    exchange(made, client, 1.0)
    assert [data for _, data in client.take_samples()] == [
        b"  0 ",
        b"  1 ",
        b"  2 ",
        b"  3 ",
        b" 99 ",
    ]


def test_what_a_board_could_never_put_together_is_refused() -> None:
    made, client = connected(CMD_VEL)
    reader = ObjectId(CMD_VEL.endpoint_id)
    with pytest.raises(MessageTooLarge, match="'cmd_vel'") as caught:
        made.write(reader, bytes(1993), "cmd_vel", 1.0)
    assert (caught.value.size, caught.value.limit) == (1993, 1992)
    made.write(reader, bytes(1992), "cmd_vel", 1.0)
    messages = made.data_to_send()
    assert len(messages) == 4
    assert max(map(len, messages)) <= 508
    for message in messages:
        client.receive(message, 1.0)
    assert client.take_samples() == [(0, bytes(1992))]


def test_a_best_effort_reader_takes_one_message() -> None:
    made, client = connected(Topic(4, "/led", "std_msgs/String", False, False))
    (reader,) = made.session.objects.reads if made.session else ()
    with pytest.raises(MessageTooLarge):
        made.write(reader, bytes(497), "led", 1.0)
    made.write(reader, bytes(496), "led", 1.0)
    (message,) = made.data_to_send()
    assert len(message) == 508
    client.receive(message, 1.0)
    assert client.take_samples() == [(0, bytes(496))]


def test_lost_samples_down_are_sent_again_when_the_board_asks() -> None:
    made, client = connected(CMD_VEL)
    reader = ObjectId(CMD_VEL.endpoint_id)
    made.write(reader, b"lost", "cmd_vel", 1.0)
    made.data_to_send()
    exchange(made, client, 1.0)
    assert client.take_samples() == [(0, b"lost")]
    assert made.session is not None
    assert made.session.streams.downlinks[0].output.room == 4


def test_deleting() -> None:
    made, _ = connected(ODOM, CMD_VEL)
    assert made.session is not None
    base = made.session.streams.inputs[0].expected or 0
    made.data_to_send()
    delete = b"\x03\x01\x04\x00\x00\x09" + WRITER
    made.receive(struct.pack("<BBH", 0x81, 0x80, base) + delete, 1.0)
    assert made.events() == [EndpointGone(ObjectId(WRITER))]
    assert made.data_to_send()[-1][4:] == b"\x05\x01\x06\x00\x00\x09" + WRITER + b"\0\0"
    made.receive(b"\x81\x00\x00\x00\x03\x01\x04\x00\x00\x09\xff\xfe", 1.0)
    assert made.data_to_send() == [b"\x81\x00\x00\x00\x05\x01\x06\x00\x00\x09\xff\xfe\0\0"]
    (closed,) = made.events()
    assert isinstance(closed, SessionClosed)
    made.receive(b"\x81\x00\x00\x00\x03\x01\x04\x00\x00\x0a\xff\xfe", 1.0)
    assert len(made.data_to_send()) == 1
    with pytest.raises(UnknownReader):
        made.write(ObjectId(CMD_VEL.endpoint_id), b"", "cmd_vel", 1.0)


def test_a_sample_for_a_reader_that_nobody_created_is_refused() -> None:
    made, _ = connected(ODOM)
    assert made.session is not None
    base = made.session.streams.inputs[0].expected or 0
    made.data_to_send()
    made.receive(
        struct.pack("<BBH", 0x81, 0x80, base)
        + b"\x08\x01\x10\x00\x00\x09\x00\x76\x80\0\0\x01"
        + bytes(8),
        1.0,
    )
    assert made.data_to_send()[-1][4:] == b"\x05\x01\x06\x00\x00\x09\x00\x76\x84\x00"


def test_the_same_board_again_keeps_its_objects_and_another_does_not() -> None:
    made, client = connected(ODOM)
    client.reset(2.0)
    events = exchange(made, client, 2.0)
    assert events == [SessionOpened("01020304", is_same=True)]
    other = BoardClient([ODOM], b"new!")
    closed, opened, ready = exchange(made, other, 9.0)
    assert isinstance(closed, SessionClosed)
    assert opened == SessionOpened(b"new!".hex(), is_same=False)
    assert isinstance(ready, WriterReady)


def restarted(made: Agent) -> Agent:
    return agent(remembered=json.loads(json.dumps(made.remembered())))


def test_a_restart_goes_unnoticed() -> None:
    made, client = connected(ODOM, CMD_VEL)
    for _ in range(5):
        client.publish(0, bytes(720), 1.0)
        made.write(ObjectId(CMD_VEL.endpoint_id), b"before", "cmd_vel", 1.0)
        exchange(made, client, 1.0)
    client.take_samples()
    again = restarted(made)
    client.publish(0, b"blocked", 2.0)
    events = exchange(again, client, 2.0)
    resumed, ready, reader, sample = events
    assert isinstance(resumed, SessionResumed)
    assert isinstance(ready, WriterReady)
    assert isinstance(reader, ReaderReady)
    assert isinstance(sample, Sample)
    again.write(ObjectId(CMD_VEL.endpoint_id), b"after", "cmd_vel", 2.1)
    exchange(again, client, 2.1)
    assert client.take_samples() == [(1, b"after")]
    assert client.counters.resets == 0
    client.publish(0, bytes(720), 2.2)
    assert [len(event.data) for event in exchange(again, client, 2.2)] == [720]


def test_a_restart_between_two_fragments_loses_that_sample_only() -> None:
    made, client = connected(ODOM)
    again = restarted(made)
    client.publish(0, bytes(720), 2.0)
    _, second = client.data_to_send()
    again.receive(second, 2.0)
    for message in again.data_to_send():
        client.receive(message, 2.0)
    assert not any(isinstance(event, Sample) for event in again.events())
    client.publish(0, b"next", 2.1)
    assert [event.data for event in exchange(again, client, 2.1)] == [b"next"]


def test_after_a_restart_another_firmware_is_not_taken_for_the_old_one() -> None:
    made, _ = connected(CMD_VEL)
    again = restarted(made)
    again.receive(write(17), 1.0)
    assert isinstance(again.events()[-1], SessionClosed)
    again.data_to_send()
    again.receive(bytes.fromhex("80000000 02010800 000afffd 02000000"), 1.0)
    assert again.data_to_send()[0][13] == 0


@pytest.mark.parametrize("kept", [{}, {"version": 1}, {"version": 1, "objects": 3}, {"version": 9}])
def test_a_memory_that_makes_no_sense_is_none(kept: dict[str, Any]) -> None:
    assert agent(remembered=kept).session is None


@pytest.mark.parametrize("seed", range(4))
def test_garbage_never_raises_and_the_session_goes_on(seed: int) -> None:
    rng = random.Random(seed)
    made, _ = connected(ODOM, IMU_XML, CMD_VEL)
    for _ in range(5000):
        made.receive(rng.randbytes(rng.randrange(60)), 1.0)
        body = bytes((rng.randrange(16), rng.randrange(256), rng.randrange(40), 0)) + rng.randbytes(
            40
        )
        made.receive(bytes((0x81, 0x01, rng.randrange(256), rng.randrange(256))) + body, 1.0)
        made.handle_timeout(1.0)
        made.data_to_send()
        made.events()
        made.line_damaged(rng.randbytes(rng.randrange(9)), 1.0)
    fresh = BoardClient([ODOM], b"last")
    events = exchange(made, fresh, 5.0)
    assert fresh.stage is Stage.RUNNING
    assert any(isinstance(event, WriterReady) for event in events)


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value) + 1) + value + b"\0"


def with_service(kind: int) -> tuple[Agent, bytes]:
    """A board with one requester (7) or replier (8) that asked for what comes to it."""
    made = agent()
    made.receive(HELLO, 0.0)
    object_id = bytes((0x00, 0x10 | kind))
    body = b""
    for item in (
        b"/add",
        b"example_interfaces::srv::dds_::AddTwoInts_Request_",
        b"a::srv::dds_::B_Response_",
    ):
        body += bytes(-len(body) % 4) + text(item)
    reads = b"\x08\x01\x10\x00\x00\x21" + object_id + b"\x80\0\0\x01\xff\xff" + bytes(6)
    for number, item in enumerate((created(object_id, kind, 3, body, "<"), reads)):
        made.receive(struct.pack("<BBH", 0x81, 0x80, number) + item, 0.0)
    made.data_to_send()
    made.receive(b"\x81\x00\x00\x00\x0a\x01\x05\x00\x01\x00\x00\x00\x80", 0.0)
    return made, object_id


def test_a_board_provides_a_service() -> None:
    made, object_id = with_service(8)
    offered = made.events()[-1]
    assert isinstance(offered, ServiceOffered)
    assert (offered.endpoint.topic, offered.endpoint.reply_type) == (
        "/add",
        "a::srv::dds_::B_Response_",
    )
    session = restarted(made).session
    assert session is not None
    assert session.ready_events() == [offered]
    assert made.session is not None
    for call in (5, 6):  # requests do not replace each other
        made.session.request(ObjectId(object_id), call, b"request", "add", 1.0)
    first, second = made.data_to_send()
    assert first[8:] == b"\x00\x21" + object_id + bytes(20) + b"\x05\0\0\0" + b"request"
    assert second[32:36] == b"\x06\0\0\0"
    reply = b"\x00\x30" + object_id + first[12:36] + b"reply"
    body = b"\x07\x01" + struct.pack("<H", len(reply)) + reply
    made.receive(struct.pack("<BBH", 0x81, 0x80, 2) + body, 1.0)
    assert made.events() == [ServiceReplied(ObjectId(object_id), 5, b"reply", "<")]


def test_a_board_calls_a_service() -> None:
    made, object_id = with_service(7)
    assert isinstance(made.events()[-1], ServiceWanted)
    call = b"\x00\x30" + object_id
    body = b"\x07\x01\x0b\x00" + call + b"request"
    made.receive(struct.pack("<BBH", 0x81, 0x80, 2) + body, 1.0)
    made.data_to_send()
    assert made.events() == [ServiceCalled(ObjectId(object_id), call, b"request", "<")]
    assert made.session is not None
    made.session.reply(ObjectId(object_id), call, b"reply", "add", 1.0)
    (answer,) = made.data_to_send()
    assert answer[8:] == b"\x00\x21" + object_id + call + b"reply"


def test_a_million_bytes_of_garbage_on_the_line_of_a_board() -> None:
    serial = SerialAgent(agent())
    client, reader = BoardClient([ODOM, CMD_VEL]), LineReader()
    garbage = random.Random(20261122).randbytes(1_000_000)

    def step(now: float) -> None:
        client.handle_timeout(now)
        for message in client.data_to_send():
            serial.receive(frame(message), now)
        serial.agent.handle_timeout(now)
        for message in reader.feed(serial.data_to_send()):
            client.receive(message, now)

    for number in range(100):
        step(number * 0.01)
    assert client.stage is Stage.RUNNING
    for start in range(0, len(garbage), 1024):
        serial.receive(garbage[start : start + 1024], 2.0)
        assert len(serial.data_to_send()) < 200
    serial.agent.events()
    assert client.publish(0, b"after", 3.0)
    for number in range(20):
        step(3.0 + number * 0.01)
    assert [event.data for event in serial.agent.events() if isinstance(event, Sample)] == [
        b"after"
    ]


def test_fragments_within_fragments_have_an_end() -> None:
    made, _ = connected(ODOM)
    assert made.session is not None
    expected = made.session.streams.inputs[0].expected
    assert expected is not None
    head = struct.pack("<BBH", 0x81, 0x80, expected)
    made.receive(head + bytes.fromhex("0d030000") * 1000, 1.0)
    assert made.session.malformed == 1
    made.data_to_send()
    made.receive(write(expected + 1), 1.0)
    assert made.events() == [Sample(ObjectId(WRITER), b"data", "<")]


def test_a_best_effort_board_that_counted_on_unheard_is_heard_again() -> None:
    made, _ = connected(ODOM)
    counts = ((10, True), (9, False), (10, False), (40_000, True), (39_990, False), (3, True))
    for number, is_new in counts:
        made.receive(write(number, stream=0x01), 1.0)
        assert bool(made.events()) is is_new, number


def test_no_more_than_a_submessage_can_say_goes_down() -> None:
    down = Downlink(ReliableOutput(0x80), mtu=0xFFFF)
    with pytest.raises(MessageTooLarge) as caught:
        down.offer(("reader", None), "map", bytes(70_004), 70_000)
    limit = caught.value.limit
    down.offer(("reader", None), "map", bytes(4 + limit), limit)
    assert sum(len(body) for _, body in down.due(0.0)) > limit


def test_a_board_that_only_listens_is_asked_for_a_sign_of_life() -> None:
    made, client = connected(CMD_VEL)
    made.probe()
    (question,) = made.data_to_send()
    client.receive(question, 1.0)
    (answer,) = client.data_to_send()
    assert answer[4] == 10
    made.receive(answer, 1.0)
    assert made.data_to_send() == []
    made.write(ObjectId(CMD_VEL.endpoint_id), b"twist", "cmd_vel", 1.0)
    made.probe()
    assert len(made.data_to_send()) == 1
    assert agent().data_to_send() == []


def test_what_a_former_program_of_the_board_had_is_forgotten() -> None:
    made, _ = connected(ODOM, BEST_EFFORT, CMD_VEL)
    client = BoardClient([ODOM])
    exchange(made, client)
    assert client.stage is Stage.RUNNING
    for now, gone in ((5.0, []), (11.0, [BEST_EFFORT, CMD_VEL]), (30.0, [])):
        assert client.publish(0, b"odom", now)
        events = exchange(made, client, now)
        found = {event.object_id for event in events if isinstance(event, EndpointGone)}
        assert found == {topic.endpoint_id for topic in gone}
    assert made.session is not None
    assert ObjectId(WRITER) in made.session.objects.created


def test_a_board_that_creates_nothing_anew_keeps_what_it_has() -> None:
    made, _ = connected(ODOM)
    made.receive(HELLO, 20.0)
    made.events()
    for number, now in enumerate((20.1, 40.0, 60.0)):
        made.receive(write(number), now)
        assert made.events() == [Sample(ObjectId(WRITER), b"data", "<")]
