from __future__ import annotations

import json
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simple_ros.foxglove import events
from simple_ros.foxglove.catalog import Catalog
from simple_ros.foxglove.events import Called, Event
from simple_ros.foxglove.frames import CAPABILITIES, Schema
from simple_ros.foxglove.session import MAX_IN_FLIGHT, Session


def offered() -> Catalog:
    """Channels 1 and 2, service 1."""
    catalog = Catalog()
    catalog.add_channel("/a", "std_msgs.String", "", metadata={"latched": "true"})
    catalog.add_channel("/b", "std_msgs.String", "")
    catalog.add_service("/s", "std_srvs.Empty", Schema("Q", "{}"), Schema("A", "{}"))
    return catalog


class Talk:
    """A session and what a client would have heard."""

    def __init__(self, *without: str, catalog: Catalog | None = None) -> None:
        self.catalog = catalog or offered()
        self.session = Session(self.catalog, CAPABILITIES - set(without))

    def say(self, op: str, **fields: Any) -> None:
        self.session.receive(json.dumps({"op": op, **fields}))

    def call(self, service: int, call: int, encoding: bytes = b"json") -> None:
        head = struct.pack("<BIII", 2, service, call, len(encoding))
        self.session.receive(head + encoding + b"{}")

    def heard(self) -> list[Any]:
        return [json.loads(f) if isinstance(f, str) else f for f in self.session.frames()]

    def statuses(self) -> list[tuple[int, str]]:
        return [(f["level"], f["message"]) for f in self.heard() if f["op"] == "status"]

    def events(self) -> list[Event]:
        return self.session.events()


def test_the_beginning() -> None:
    talk = Talk()
    talk.session.begin('{"op": "serverInfo"}')
    assert [frame["op"] for frame in talk.heard()] == [
        "serverInfo",
        "advertise",
        "advertiseServices",
    ]


def test_nothing_offered_is_not_advertised() -> None:
    talk = Talk(catalog=Catalog())
    talk.session.begin('{"op": "serverInfo"}')
    assert [frame["op"] for frame in talk.heard()] == ["serverInfo"]


def test_a_new_session_offers_the_same_once_more_and_keeps_subscriptions() -> None:
    talk = Talk()
    talk.session.begin('{"op": "serverInfo"}')
    _, offered_first, _ = talk.heard()
    (channel, *_) = offered_first["channels"]
    talk.say("subscribe", subscriptions=[{"id": 0, "channelId": channel["id"]}])
    talk.session.begin_again('{"op": "serverInfo"}')
    info, offered_again = talk.heard()
    assert info["op"] == "serverInfo"
    assert offered_again == offered_first
    assert talk.session.subscriptions == {channel["id"]: 0}


def test_many_channels_come_in_pieces() -> None:
    catalog = Catalog()
    for number in range(250):
        catalog.add_channel(f"/{number}", "t", "")
    talk = Talk(catalog=catalog)
    talk.session.begin('{"op": "serverInfo"}')
    assert [len(frame["channels"]) for frame in talk.heard()[1:]] == [100, 100, 50]


def test_metadata_is_for_the_newer_subprotocol() -> None:
    for newer in (False, True):
        session = Session(offered(), CAPABILITIES, with_metadata=newer)
        session.begin("{}")
        first = json.loads(session.frames()[1])["channels"][0]
        assert ("metadata" in first) is newer


# -- subscriptions ---------------------------------------------------------------------------------


def test_subscription_zero_is_one() -> None:
    talk = Talk()
    talk.say("subscribe", subscriptions=[{"id": 0, "channelId": 2}])
    assert talk.events() == [events.ChannelWanted(2, 0)]
    talk.say("unsubscribe", subscriptionIds=[0])
    assert talk.events() == [events.ChannelUnwanted(2)]
    assert talk.heard() == []


def test_one_bad_subscription_spoils_no_other() -> None:
    talk = Talk()
    wanted = [{"id": 0, "channelId": 9}, {"id": 1, "channelId": 1}, {"id": 1, "channelId": 2}]
    talk.say("subscribe", subscriptions=[*wanted, {"id": 2, "channelId": 1}])
    assert talk.events() == [events.ChannelWanted(1, 1)]
    levels = [level for level, _ in talk.statuses()]
    assert levels == [2, 2, 1]  # unknown channel, used id, channel subscribed already


def test_unknown_subscriptions_end_silently() -> None:
    talk = Talk()
    talk.say("unsubscribe", subscriptionIds=[7])
    assert (talk.heard(), talk.events()) == ([], [])


def test_a_channel_that_goes_takes_its_subscription_along() -> None:
    talk = Talk()
    talk.say("subscribe", subscriptions=[{"id": 5, "channelId": 1}])
    talk.events()
    talk.session.withdraw_channels(talk.catalog.remove_channels([1]))
    assert talk.events() == [events.ChannelUnwanted(1)]
    assert talk.heard() == [{"op": "unadvertise", "channelIds": [1]}]
    talk.say("unsubscribe", subscriptionIds=[5])
    assert talk.heard() == []
    again = talk.catalog.add_channel("/a", "other", "")
    talk.say("subscribe", subscriptions=[{"id": 5, "channelId": again.id}])
    assert talk.events() == [events.ChannelWanted(again.id, 5)]


# -- what clients publish --------------------------------------------------------------------------


def test_a_client_publishes() -> None:
    talk = Talk()
    channel = {"id": 3, "topic": "/x", "encoding": "json", "schemaName": "T"}
    talk.say("advertise", channels=[channel])
    talk.session.receive(b"\x01" + struct.pack("<I", 3) + b"{}")
    talk.say("unadvertise", channelIds=[3])
    opened, published, closed = talk.events()
    assert isinstance(opened, events.ChannelOpened)
    assert published == events.Published(opened.channel, b"{}")
    assert closed == events.ChannelClosed(opened.channel)
    assert talk.heard() == []


def test_what_a_client_may_not_publish() -> None:
    talk = Talk()
    channel = {"id": 3, "topic": "/x", "encoding": "json", "schemaName": "T"}
    talk.say("advertise", channels=[channel, channel, channel | {"id": 4, "encoding": "cdr"}])
    talk.session.receive(b"\x01" + struct.pack("<I", 9) + b"{}")
    talk.say("unadvertise", channelIds=[9])
    assert [level for level, _ in talk.statuses()] == [1, 2, 2, 1]
    assert len(talk.events()) == 1


# -- services --------------------------------------------------------------------------------------


def called(talk: Talk) -> Called:
    (event,) = talk.events()
    assert isinstance(event, Called)
    return event


def test_a_call_is_answered_once() -> None:
    talk = Talk()
    talk.call(1, 7)
    call = called(talk)
    talk.session.answer(call, b"{}")
    talk.session.answer(call, b"{}")
    talk.session.fail(call, "late")
    assert talk.heard() == [struct.pack("<BIII", 3, 1, 7, 4) + b"json{}"]


def test_a_failure_is_also_shown() -> None:
    talk = Talk()
    talk.call(1, 7)
    talk.session.fail(called(talk), "it broke")
    failure, status = talk.heard()
    assert failure == {
        "op": "serviceCallFailure",
        "serviceId": 1,
        "callId": 7,
        "message": "it broke",
    }
    assert (status["level"], status["message"]) == (2, "Service /s: it broke")


@pytest.mark.parametrize(("service", "encoding"), [(9, b"json"), (1, b"protobuf")])
def test_calls_that_cannot_be_made(service: int, encoding: bytes) -> None:
    talk = Talk()
    talk.call(service, 7, encoding)
    assert [frame["op"] for frame in talk.heard()] == ["serviceCallFailure", "status"]
    assert talk.events() == []


def test_too_many_calls() -> None:
    talk = Talk()
    for number in range(MAX_IN_FLIGHT + 1):
        talk.call(1, number)
    calls = talk.events()
    assert len(calls) == MAX_IN_FLIGHT
    (failure, _) = talk.heard()
    assert failure["callId"] == MAX_IN_FLIGHT
    assert isinstance(calls[0], Called)
    talk.session.answer(calls[0], b"{}")
    talk.call(1, 99)
    assert len(talk.events()) == 1


# -- parameters, graph, assets ---------------------------------------------------------------------


def test_parameter_subscriptions() -> None:
    talk = Talk()
    talk.say("subscribeParameterUpdates", parameterNames=["/a", "b"])
    wants = talk.session.wants_parameter
    assert (wants("a"), wants("b"), wants("c")) == (True, True, False)
    talk.say("unsubscribeParameterUpdates", parameterNames=["/b"])
    assert not wants("b")
    talk.say("subscribeParameterUpdates", parameterNames=[])
    assert wants("c")
    talk.say("unsubscribeParameterUpdates", parameterNames=[])
    assert not wants("a")


def test_the_graph() -> None:
    talk = Talk()
    talk.say("subscribeConnectionGraph")
    assert talk.session.wants_graph
    assert talk.events() == [events.GraphWanted()]
    talk.say("unsubscribeConnectionGraph")
    assert not talk.session.wants_graph


def test_assets() -> None:
    talk = Talk()
    for number in range(MAX_IN_FLIGHT + 1):
        talk.say("fetchAsset", uri="package://x/y", requestId=number)
    assert len(talk.events()) == MAX_IN_FLIGHT
    (refused,) = talk.heard()
    assert refused.startswith(struct.pack("<BIB", 4, MAX_IN_FLIGHT, 1))
    talk.session.send_asset(0, b"data")
    assert talk.heard() == [struct.pack("<BIBI", 4, 0, 0, 0) + b"data"]


@pytest.mark.parametrize(
    ("capability", "document"),
    [
        ("clientPublish", {"op": "advertise", "channels": []}),
        ("parameters", {"op": "getParameters", "parameterNames": []}),
        ("parametersSubscribe", {"op": "subscribeParameterUpdates", "parameterNames": []}),
        ("connectionGraph", {"op": "subscribeConnectionGraph"}),
    ],
)
def test_what_is_not_offered(capability: str, document: dict[str, Any]) -> None:
    talk = Talk(capability)
    talk.session.receive(json.dumps(document))
    assert talk.statuses() == [(2, f"This server does not offer {capability}")]
    assert talk.events() == []


def test_playback() -> None:
    talk = Talk()
    request = struct.pack("<BBfBQI", 3, 1, 2.5, 1, 77, 2) + b"id"
    talk.session.receive(request)
    (event,) = talk.events()
    assert isinstance(event, events.PlaybackWanted)
    control = event.control
    found = control.is_play, control.speed, control.seek_ns, control.request_id
    assert found == (False, 2.5, 77, "id")
    assert talk.session.controls_playback


def test_the_end() -> None:
    talk = Talk()
    talk.say("subscribe", subscriptions=[{"id": 0, "channelId": 1}])
    talk.say("advertise", channels=[{"id": 1, "topic": "x", "encoding": "json"}])
    talk.events()
    talk.session.end()
    assert [type(event) for event in talk.events()] == [
        events.ChannelUnwanted,
        events.ChannelClosed,
    ]


# -- garbage ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "frame",
    [
        "garbage",
        "[]",
        "{}",
        '{"op": 3}',
        '{"op": "fly"}',
        '{"op": "subscribe"}',
        '{"op": "subscribe", "subscriptions": [1]}',
        '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}',
        '{"op": "subscribe", "subscriptions": [{"id": true, "channelId": 1}]}',
        '{"op": "unsubscribe", "subscriptionIds": ["a"]}',
        '{"op": "getParameters", "parameterNames": [1]}',
        '{"op": "setParameters", "parameters": [{"value": 1}]}',
        '{"op": "getParameters", "parameterNames": ["\\ud800"], "id": "a"}',
        '{"op": "setParameters", "parameters": [{"name": "\\ud800", "value": 1}]}',
        '{"op": "advertise", "channels": [{"id": 1, "topic": "\\udfff", "encoding": "json"}]}',
        '{"op": "fetchAsset", "uri": 1, "requestId": 1}',
        '{"op": "advertise", "channels": [{"id": 1}]}',
        "[" * 100_000,
        b"\x01\x00",
        b"\x02\x00",
        b"\x02" + struct.pack("<III", 1, 1, 100) + b"json",
        b"\x02" + struct.pack("<III", 1, 1, 1) + b"\xff",
        b"\x03\x00",
        b"\x63",
    ],
)
def test_garbage_gets_a_status(frame: str | bytes) -> None:
    talk = Talk()
    talk.session.receive(frame)
    (status,) = talk.statuses()
    assert status[0] == 2
    assert status[1].startswith("Invalid message: ")
    assert talk.events() == []


def test_what_a_client_sent_is_not_sent_back_at_length() -> None:
    talk = Talk()
    talk.say("x" * 1_000_000)
    talk.say("subscribe", subscriptions=[{"id": "y" * 1_000_000, "channelId": 1}])
    for _, message in talk.statuses():
        assert message.startswith("Invalid message: ")
        assert len(message) < 2000


def test_an_empty_frame_means_nothing() -> None:
    talk = Talk()
    talk.session.receive(b"")
    assert (talk.heard(), talk.events()) == ([], [])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)
OPS = st.sampled_from(
    [
        ("subscribe", "subscriptions"),
        ("unsubscribe", "subscriptionIds"),
        ("advertise", "channels"),
        ("unadvertise", "channelIds"),
        ("getParameters", "parameterNames"),
        ("setParameters", "parameters"),
        ("fetchAsset", "uri"),
        ("subscribeParameterUpdates", "parameterNames"),
    ]
)
NEARLY = st.fixed_dictionaries(
    {},
    optional={
        "id": JSON,
        "channelId": JSON,
        "topic": JSON,
        "encoding": st.sampled_from(["json", "protobuf", 1]),
        "name": JSON,
        "value": JSON,
    },
)


@st.composite
def requests(draw: st.DrawFn) -> str:
    op, field = draw(OPS)
    value = draw(JSON | st.lists(NEARLY, max_size=3))
    return json.dumps({"op": op, field: value, "id": draw(JSON), "requestId": draw(JSON)})


@settings(max_examples=300, deadline=None)
@given(st.lists(requests() | st.binary(max_size=40) | st.text(max_size=40), max_size=6))
def test_nothing_raises(frames: list[str | bytes]) -> None:
    talk = Talk()
    for frame in frames:
        talk.session.receive(frame)
        for out in talk.heard():
            assert isinstance(out, dict | bytes)
    talk.session.end()


@settings(max_examples=200, deadline=None)
@given(st.integers(1, 3), st.binary(max_size=60))
def test_no_binary_frame_raises(opcode: int, rest: bytes) -> None:
    talk = Talk()
    talk.session.receive(bytes((opcode,)) + rest)
    talk.heard()
