"""JSON, schemas, parameters, the graph, access: the small pure parts of the Foxglove bridge."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.struct_pb2 import Struct
from hypothesis import given
from hypothesis import strategies as st
from websockets.datastructures import Headers

from simple_ros.errors import ConfigError
from simple_ros.foxglove.access import Access
from simple_ros.foxglove.assets import AssetRoots
from simple_ros.foxglove.catalog import Catalog
from simple_ros.foxglove.errors import AssetRefused, InvalidRequest, PublishRefused
from simple_ros.foxglove.frames import Schema, message_parts
from simple_ros.foxglove.graph_model import ConnectionGraph, GraphModel, difference
from simple_ros.foxglove.json_input import json_of, message_of
from simple_ros.foxglove.json_schema import json_schema
from simple_ros.foxglove.parameter_values import from_protocol, to_protocol
from simple_ros.foxglove.publishing import spelt_out
from simple_ros.foxglove.rates import TopicLimits
from simple_ros.foxglove.services import message_names
from simple_ros.graph import (
    ChangeKind,
    GraphChange,
    GraphNode,
    GraphService,
    GraphSnapshot,
    TopicKey,
)
from simple_ros.msg.builtin_interfaces import Time
from simple_ros.msg.geometry_msgs import PoseStamped, Twist
from simple_ros.msg.sensor_msgs import Image, LaserScan
from simple_ros.msg.std_msgs import Bool, String
from simple_ros.parameters.errors import ParameterTypeMismatch

# -- JSON ------------------------------------------------------------------------------------------


def test_what_apps_send() -> None:
    value = {
        "header": {"seq": 0, "stamp": {"sec": 12, "nsec": 34}, "frame_id": "map"},
        "pose": {"position": {"x": 1, "y": None}, "unknown": {"a": [1]}},
    }
    message = message_of(PoseStamped, json.dumps(value).encode())
    assert (message.header.stamp.seconds, message.header.stamp.nanos) == (12, 34)
    assert message.header.frame_id == "map"
    assert (message.pose.position.x, message.pose.position.y) == (1.0, 0.0)


@pytest.mark.parametrize("data", [[1, 2, 255], "AQL/", {"0": 1, "1": 2, "2": 255}])
def test_bytes_in_any_form(data: Any) -> None:
    assert message_of(Image, json.dumps({"data": data}).encode()).data == b"\x01\x02\xff"


def test_typed_arrays() -> None:
    message = message_of(LaserScan, b'{"ranges": {"1": 2.5, "0": "NaN", "2": 3}}')
    assert math.isnan(message.ranges[0])
    assert list(message.ranges[1:]) == [2.5, 3.0]


def test_numbers_that_javascript_cannot_write() -> None:
    scan = message_of(LaserScan, b'{"ranges": [1, null, 2], "range_max": null}')
    assert scan.ranges[0::2] == [1, 2]
    assert math.isnan(scan.ranges[1])
    assert scan.range_max == 0


def test_ros_times() -> None:
    assert message_of(Time, b'{"sec": 5, "nsec": 6}') == Time(sec=5, nanosec=6)
    assert message_of(Time, b'{"sec": 5, "nanosec": 6}') == Time(sec=5, nanosec=6)


def test_a_number_for_a_bool() -> None:
    assert message_of(Bool, b'{"data": 1}').data is True


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"[]",
        b"\xff",
        b'{"data": {"a": 1}}',
        b'{"data": [300]}',
        b'{"data": "not base64!"}',
        b'{"header": {"stamp": {"sec": "x"}}}',
        b'{"header": {"stamp": {"sec": 1e400}}}',
        b'{"header": 3}',
        b'{"height": "x"}',
    ],
)
def test_what_is_no_message(text: bytes) -> None:
    with pytest.raises(PublishRefused, match=r"not a sensor_msgs\.Image"):
        message_of(Image, text)


@given(st.binary(max_size=30) | st.text(max_size=30).map(str.encode))
def test_garbage_is_refused_or_understood(text: bytes) -> None:
    try:
        message_of(LaserScan, text)
    except PublishRefused:
        return


def test_json_of_a_message_has_every_field() -> None:
    assert json.loads(json_of(String())) == {"data": ""}
    assert json.loads(json_of(Twist(linear={"x": 1})))["linear"] == {"x": 1.0, "y": 0.0, "z": 0.0}


def test_a_schema() -> None:
    schema = json.loads(json_schema(PoseStamped.DESCRIPTOR))
    header = schema["properties"]["header"]["properties"]
    assert schema["title"] == "geometry_msgs.PoseStamped"
    assert header["stamp"] == {"type": "string", "format": "date-time"}
    position = schema["properties"]["pose"]["properties"]["position"]
    assert position["properties"]["x"] == {"type": "number"}
    assert json.loads(json_schema(LaserScan.DESCRIPTOR))["properties"]["ranges"] == {
        "type": "array",
        "items": {"type": "number"},
    }
    assert json.loads(json_schema(Struct.DESCRIPTOR))["type"] == "object"


@pytest.mark.parametrize(
    "spelling",
    [
        "geometry_msgs/Twist",
        "geometry_msgs.Twist",
        "geometry_msgs/msg/Twist",
        "ros.geometry_msgs.Twist",
        "geometry_msgs::msg::Twist",
    ],
)
def test_spellings(spelling: str) -> None:
    assert spelt_out(spelling) == "geometry_msgs.Twist"


def test_spellings_of_types_that_are_not_here() -> None:
    assert spelt_out("their_msgs/msg/Thing") == "their_msgs.Thing"


def test_service_types() -> None:
    assert message_names(GraphService("s", "p.Do", "n")) == ("p.DoRequest", "p.DoResponse")
    assert message_names(GraphService("s", "p.A -> q.B", "n")) == ("p.A", "q.B")


# -- frames ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0, 112, 113, 65522, 65523, 70000])
def test_message_frames_are_what_the_library_would_make(size: int) -> None:
    from websockets.frames import Frame, Opcode

    head, stamp, data = message_parts(7, bytes(size))
    message = b"\x01" + (5).to_bytes(4, "little") + (7).to_bytes(8, "little") + bytes(size)
    wanted = Frame(Opcode.BINARY, message).serialize(mask=False)
    assert head + (5).to_bytes(4, "little") + stamp + data == wanted


# -- parameters ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (2.5, {"value": 2.5, "type": "float64"}),
        (3, {"value": 3}),
        (True, {"value": True}),
        ("x", {"value": "x"}),
        (b"\x01", {"value": "AQ==", "type": "byte_array"}),
        ([1.0, 2.0], {"value": [1.0, 2.0], "type": "float64_array"}),
        ([1, 2], {"value": [1, 2]}),
        ([], {"value": []}),
        (math.nan, {"value": "NaN"}),
        (None, {}),
    ],
)
def test_parameters_as_clients_see_them(value: Any, told: dict[str, Any]) -> None:
    found = to_protocol("a/b", value)
    assert found == {"name": "/a/b", **told}
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize(
    ("given_", "present", "wanted"),
    [
        ({"value": 3}, 2.5, 3.0),
        ({"value": 3, "type": "float64"}, None, 3.0),
        ({"value": 3}, None, 3),
        ({"value": 3.0}, 7, 3),
        ({"value": [1, 2]}, [0.5], [1.0, 2.0]),
        ({"value": [1, 2], "type": "float64_array"}, None, [1.0, 2.0]),
        ({"value": "AQ==", "type": "byte_array"}, None, b"\x01"),
        ({"value": "AQ=="}, b"", b"\x01"),
        ({"value": "AQ=="}, "x", "AQ=="),
        ({"value": "NaN"}, 1.0, math.nan),
        ({"value": True}, False, True),
    ],
)
def test_parameters_keep_their_type(given_: dict[str, Any], present: Any, wanted: Any) -> None:
    found = from_protocol({"name": "p", **given_}, present)
    assert repr(found) == repr(wanted)


def test_parameters_that_make_no_sense() -> None:
    with pytest.raises(InvalidRequest):
        from_protocol({"name": "p", "value": "?", "type": "byte_array"}, None)
    with pytest.raises(ParameterTypeMismatch):
        from_protocol({"name": "p", "value": {"a": 1}}, None)


# -- the graph -------------------------------------------------------------------------------------

CHATTER = TopicKey("chatter", "std_msgs.String")
OTHER = TopicKey("chatter", "std_msgs.Bool")


def graph(*nodes: GraphNode, services: tuple[GraphService, ...] = ()) -> GraphModel:
    model = GraphModel()
    model.take(GraphSnapshot(nodes, services=services))
    return model


def everything(_: str) -> bool:
    return True


def test_a_graph_and_its_changes() -> None:
    model = graph(
        GraphNode("talker", publishes=(CHATTER,)), services=(GraphService("s", "p.Do", "talker"),)
    )
    before = model.connections(everything)
    assert before.published == {"/chatter": ("/talker",)}
    assert before.services == {"/s": ("/talker",)}
    model.take(GraphChange(ChangeKind.SUBSCRIBER_ADDED, "listener", key=CHATTER))
    after = model.connections(everything)
    told = json.loads(difference(before, after) or "")
    assert told["subscribedTopics"] == [{"name": "/chatter", "subscriberIds": ["/listener"]}]
    assert told["publishedTopics"] == []
    assert difference(after, after) is None


def test_what_goes_is_told() -> None:
    model = graph(GraphNode("talker", publishes=(CHATTER,)), GraphNode("l", subscribes=(CHATTER,)))
    before = model.connections(everything)
    model.take(GraphChange(ChangeKind.PUBLISHER_REMOVED, "talker", key=CHATTER))
    between = model.connections(everything)
    told = json.loads(difference(before, between) or "")
    assert told["publishedTopics"] == [{"name": "/chatter", "publisherIds": []}]
    assert told["removedTopics"] == []
    model.take(GraphChange(ChangeKind.SUBSCRIBER_REMOVED, "l", key=CHATTER))
    told = json.loads(difference(between, model.connections(everything)) or "")
    assert told["removedTopics"] == ["/chatter"]
    assert told["publishedTopics"] == told["subscribedTopics"] == []
    wanted = {"op", "publishedTopics", "subscribedTopics", "advertisedServices"}
    assert told.keys() == wanted | {"removedTopics", "removedServices"}


def test_services_that_go() -> None:
    before = ConnectionGraph(services={"/s": ("/n",)})
    told = json.loads(difference(before, ConnectionGraph()) or "")
    assert (told["removedServices"], told["advertisedServices"]) == (["/s"], [])


def test_a_topic_keeps_its_type_while_somebody_publishes_it() -> None:
    model = graph(GraphNode("a", publishes=(CHATTER,)))
    assert model.published() == {"chatter": "std_msgs.String"}
    model.take(GraphChange(ChangeKind.PUBLISHER_ADDED, "b", key=OTHER))
    assert model.published() == {"chatter": "std_msgs.String"}
    model.take(GraphChange(ChangeKind.PUBLISHER_REMOVED, "a", key=CHATTER))
    assert model.published() == {"chatter": "std_msgs.Bool"}
    assert model.type_of("/chatter") == "std_msgs.Bool"


def test_topics_that_are_not_wanted_are_not_in_the_graph() -> None:
    model = graph(GraphNode("a", publishes=(CHATTER, TopicKey("secret", "x"))))
    found = model.connections(lambda topic: topic != "secret")
    assert list(found.published) == ["/chatter"]


# -- access ----------------------------------------------------------------------------------------


def refused(access: Access, path: str = "/", **headers: str) -> int | None:
    plain = Headers({"Sec-WebSocket-Protocol": "foxglove.sdk.v1"})
    for name, value in headers.items():
        plain[name] = value
    found = access.refusal(path, plain)
    return None if found is None else int(found.status)


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("http://localhost:8080", None),
        ("https://127.0.0.1", None),
        ("http://[::1]:3000", None),
        ("https://app.foxglove.dev", None),
        ("https://studio.foxglove.dev", None),
        ("https://evil.example", 403),
        ("https://localhost.evil.example", 403),
        ("https://app.foxglove.dev.evil.example", 403),
        ("null", 403),
        ("http://[", 403),
        ("https://mine.example", None),
    ],
)
def test_origins(origin: str, status: int | None) -> None:
    assert refused(Access.made(origins=["https://mine.example/"]), Origin=origin) == status


def test_all_origins() -> None:
    assert refused(Access.made(origins=["*"]), Origin="https://evil.example") is None


def test_tokens() -> None:
    access = Access.made(token="geheim")
    assert refused(access) == 401
    assert refused(access, "/?token=nix") == 401
    assert refused(access, "/?token=geheim") is None
    assert refused(access, Authorization="Bearer geheim") is None
    assert refused(access, Authorization="Basic geheim") == 401
    assert refused(Access.made(token="")) is None


@pytest.mark.parametrize("written", ["a+b/c=", "a%2Bb%2Fc%3D", "a%2Bb/c="])
def test_a_token_in_base64(written: str) -> None:
    assert refused(Access.made(token="a+b/c="), f"/?token={written}") is None


def test_a_token_with_a_space() -> None:
    assert refused(Access.made(token="a b"), "/?token=a+b") is None


def test_what_is_no_origin() -> None:
    with pytest.raises(ConfigError, match="'robot'"):
        Access.made(origins=["robot"])


def test_subprotocols() -> None:
    access = Access()
    assert (
        access.refusal("/", Headers({"Sec-WebSocket-Protocol": "x, foxglove.websocket.v1"})) is None
    )
    refusal = access.refusal("/", Headers({"Sec-WebSocket-Protocol": "x"}))
    assert refusal is not None
    assert refusal.status == 400
    assert "foxglove.sdk.v1" in refusal.reason
    assert "foxglove.websocket.v1" in refusal.reason


def test_selections() -> None:
    access = Access.made("^/cam", "raw$")
    assert access.wants("camera/image")
    assert not access.wants("/camera/raw")
    assert not access.wants("/odom")
    with pytest.raises(ConfigError):
        Access.made("(")


def test_what_clients_may_publish() -> None:
    access = Access.made("^/cam|^/cmd", "raw$", client_topics="^/cmd")
    assert access.lets_publish("/cmd_vel")
    assert not access.lets_publish("/camera/image"), "shown, not published"
    assert not access.lets_publish("/cmd_raw"), "not even shown"


def test_capabilities_that_are_withheld() -> None:
    assert Access.made(without=["time"]).hidden == {"time"}
    assert Access.made(without=["parameters"]).hidden == {"parameters", "parametersSubscribe"}
    both = Access.made(without=["assets"], read_only=True).hidden
    assert both == {"assets", "clientPublish", "services"}
    with pytest.raises(ConfigError, match="'colours'; there are assets, "):
        Access.made(without=["colours"])


def test_services_keep_their_ids() -> None:
    catalog = Catalog()
    request, response = Schema("Q", "{}"), Schema("A", "{}")
    first = catalog.add_service("/a", "t", request, response)
    other = catalog.add_service("/b", "t", request, response)
    assert catalog.remove_services([first.id, 77]) == [first.id]
    changed = catalog.add_service("/a", "u", request, response)
    again = catalog.add_service("/a", "t", request, response)
    assert again == first
    assert len({first.id, other.id, changed.id}) == 3


def test_services_that_never_come_back_are_forgotten() -> None:
    catalog = Catalog()
    schema = Schema("Q", "{}")
    ids = [catalog.add_service(f"/{n}", "t", schema, schema).id for n in range(1001)]
    catalog.remove_services(ids)
    assert catalog.add_service("/1", "t", schema, schema).id == ids[1]
    assert catalog.add_service("/0", "t", schema, schema).id > ids[-1]


# -- limits ----------------------------------------------------------------------------------------


def test_limits_by_topic() -> None:
    limits = TopicLimits.made(["/imu=50", "camera/*=2.5"], "--max-rate")
    assert limits.of("imu") == 50
    assert limits.of("/camera/left") == 2.5
    assert limits.of("/odom") is None


@pytest.mark.parametrize("text", ["imu", "imu=", "=5", "imu=0", "imu=-1", "imu=nan", "imu=x"])
def test_limits_that_make_no_sense(text: str) -> None:
    with pytest.raises(ConfigError, match="--max-rate"):
        TopicLimits.made([text], "--max-rate")


def test_limits_in_whole_numbers() -> None:
    with pytest.raises(ConfigError, match="whole"):
        TopicLimits.made(["a=1.5"], "--queue", whole=True)


# -- assets ----------------------------------------------------------------------------------------


def test_assets(tmp_path: Path) -> None:
    root = tmp_path / "robot"
    (root / "meshes").mkdir(parents=True)
    (root / "meshes" / "left-arm 2.stl").write_bytes(b"mesh")
    (tmp_path / "secret").write_text("no")
    (root / "link").symlink_to(tmp_path / "secret")
    roots = AssetRoots.made([f"robot={root}"])
    assert roots.read("package://robot/meshes/left-arm%202.stl") == b"mesh"
    for uri, reason in [
        ("package://robot/../secret", "out of its package"),
        ("package://robot/%2e%2e/secret", "out of its package"),
        ("package://robot//etc/passwd", "no such file"),
        ("package://robot/link", "out of its package"),
        ("package://robot/meshes", "no such file"),
        ("package://other/x", "no package 'other'"),
        (f"file://{tmp_path}/secret", "only package://"),
        ("package://robot/a%00b", "null"),
        ("package://[", "no URI"),
    ]:
        with pytest.raises(AssetRefused, match=reason):
            roots.read(uri)


def test_assets_that_fit_a_pattern(tmp_path: Path) -> None:
    for name in ("left-arm.v1.stl", "notes.txt"):
        (tmp_path / name).write_text(name)
    roots = AssetRoots.made([f"robot={tmp_path}"], r"\.(stl|urdf)$")
    assert roots.read("package://robot/left-arm.v1.stl")
    with pytest.raises(AssetRefused, match="not among"):
        roots.read("package://robot/notes.txt")
    with pytest.raises(ConfigError, match="no regular expression"):
        AssetRoots.made([f"robot={tmp_path}"], "(")


def test_asset_roots_that_make_no_sense(tmp_path: Path) -> None:
    for text in ("robot", f"={tmp_path}", f"robot={tmp_path}/nothing"):
        with pytest.raises(ConfigError):
            AssetRoots.made([text])
