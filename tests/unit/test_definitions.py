from __future__ import annotations

import pytest
from google.protobuf import descriptor_pb2

from simple_ros.errors import TypeDefinitionConflict, UnknownMessageType
from simple_ros.graph import TopicKey
from simple_ros.msg.definitions import TypeStore, definition_of, message_class, parts
from simple_ros.msg.nav_msgs import Odometry
from simple_ros.rpc import master_pb2 as master
from simple_ros_master.graph import MessageGraph
from simple_ros_master.type_registry import declare_type, get_type

KINDS = descriptor_pb2.FieldDescriptorProto


def made(
    *fields: tuple[str, int, int], file: str = "mine.proto", name: str = "Thing"
) -> descriptor_pb2.FileDescriptorSet:
    proto = descriptor_pb2.FileDescriptorProto(name=file, package="mine", syntax="proto3")
    message = proto.message_type.add(name=name)
    for field, number, kind in fields:
        message.field.add(name=field, number=number, type=kind, label=KINDS.LABEL_OPTIONAL)  # type: ignore[arg-type]
    return descriptor_pb2.FileDescriptorSet(file=[proto])


A = ("a", 1, KINDS.TYPE_INT32)
B = ("b", 2, KINDS.TYPE_STRING)


def test_a_definition_is_complete_and_makes_an_equal_class() -> None:
    files = definition_of(Odometry)
    names = [file.name for file in files.file]
    assert names.index("google/protobuf/timestamp.proto") < names.index(
        "simple_ros/msg/std_msgs.proto"
    )
    copy = message_class(files, "nav_msgs.Odometry")
    assert copy is not Odometry
    original = Odometry(child_frame_id="base")
    original.pose.pose.position.x = 1.5
    original.header.stamp.seconds = 7
    again = copy.FromString(original.SerializeToString())
    assert again.SerializeToString() == original.SerializeToString()
    assert {"nav_msgs.Odometry", "std_msgs.Header", "google.protobuf.Timestamp"} <= parts(
        files, "nav_msgs.Odometry"
    ).keys()


def test_equal_definitions_from_other_files_agree() -> None:
    store = TypeStore()
    store.add("mine.Thing", made(A, B))
    store.add("mine.Thing", made(A, B, file="elsewhere/mine.proto"))
    assert store.names() == ("mine.Thing",)


def test_a_conflict_shows_the_fields_that_differ() -> None:
    store = TypeStore()
    store.add("mine.Thing", made(A, B))
    with pytest.raises(TypeDefinitionConflict) as caught:
        store.add("mine.Thing", made(A, ("b", 2, KINDS.TYPE_DOUBLE), ("c", 3, KINDS.TYPE_BOOL)))
    error = caught.value
    assert error.type_name == "mine.Thing"
    assert error.difference.splitlines() == ["-string b = 2", "+double b = 2", "+bool c = 3"]
    assert "- as known, + as given" in str(error)


def test_a_conflict_in_a_part_names_the_part() -> None:
    def outer(kind: int, name: str) -> descriptor_pb2.FileDescriptorSet:
        files = made(("x", 1, kind), file=f"{name}.proto", name="Inner")
        holder = files.file[0].message_type.add(name=name)
        holder.field.add(
            name="inner",
            number=1,
            type=KINDS.TYPE_MESSAGE,
            type_name=".mine.Inner",
            label=KINDS.LABEL_REPEATED,
        )
        return files

    store = TypeStore()
    store.add("mine.One", outer(KINDS.TYPE_INT32, "One"))
    with pytest.raises(TypeDefinitionConflict) as caught:
        store.add("mine.Two", outer(KINDS.TYPE_INT64, "Two"))
    assert caught.value.type_name == "mine.Inner"


def test_what_is_missing_or_broken_is_named() -> None:
    with pytest.raises(UnknownMessageType, match=r"mine\.Other"):
        TypeStore().add("mine.Other", made(A))
    with pytest.raises(UnknownMessageType):
        message_class(descriptor_pb2.FileDescriptorSet(), "mine.Thing")
    incomplete = definition_of(Odometry)
    del incomplete.file[0]
    with pytest.raises(UnknownMessageType):
        TypeStore().add("nav_msgs.Odometry", incomplete)


def declare(
    types: TypeStore, graph: MessageGraph, files: descriptor_pb2.FileDescriptorSet
) -> master.DeclareTypeResponse:
    request = master.DeclareTypeRequest(type_name="mine.Thing", files=files)
    return declare_type(types, graph.types_in_use, request)


def test_a_type_in_use_cannot_be_redefined_one_that_is_not_can() -> None:
    types, graph = TypeStore(), MessageGraph()
    assert declare(types, graph, made(A)).success
    graph.upsert_node("node", "127.0.0.1", 1)
    graph.add_publisher("node", TopicKey("t", "mine.Thing"))
    refused = declare(types, graph, made(B))
    assert not refused.success
    assert refused.conflicting_type == "mine.Thing"
    assert refused.difference.splitlines() == ["-int32 a = 1", "+string b = 2"]
    graph.remove_publisher("node", TopicKey("t", "mine.Thing"))
    assert declare(types, graph, made(B)).success
    assert get_type(types, master.GetTypeRequest(type_name="mine.Thing")).files == made(B)
    assert not get_type(types, master.GetTypeRequest(type_name="mine.None")).known


def test_garbage_is_refused_not_raised() -> None:
    types, graph = TypeStore(), MessageGraph()
    broken = made(A)
    broken.file[0].message_type[0].field[0].type_name = ".mine.Nowhere"
    for files in (descriptor_pb2.FileDescriptorSet(), broken):
        assert not declare(types, graph, files).success
