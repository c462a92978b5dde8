"""Message types of the user's, known to tools that have never seen them."""

from __future__ import annotations

import pytest
from google.protobuf import descriptor_pb2
from google.protobuf.message import Message
from support.processes import master_process, program
from support.waiting import until

from simple_ros.aio import MasterClient, NodeHandle
from simple_ros.errors import TypeDefinitionConflict, UnknownMessageType
from simple_ros.msg.definitions import message_class
from simple_ros.msg.std_msgs import String
from simple_ros_master import Master

KINDS = descriptor_pb2.FieldDescriptorProto


def thing(second: int = KINDS.TYPE_STRING) -> type[Message]:
    """What a user's generated module would hold."""
    proto = descriptor_pb2.FileDescriptorProto(name="mine.proto", package="mine", syntax="proto3")
    message = proto.message_type.add(name="Thing")
    for number, kind in [(1, KINDS.TYPE_INT32), (2, second)]:
        message.field.add(
            name=f"field{number}", number=number, type=kind, label=KINDS.LABEL_OPTIONAL
        )
    return message_class(descriptor_pb2.FileDescriptorSet(file=[proto]), "mine.Thing")


async def test_a_tool_decodes_a_type_it_has_never_seen(master: Master) -> None:
    got: list[bytes] = []
    mine = thing()
    async with (
        NodeHandle("robot", master=master.address) as robot,
        NodeHandle("tool", master=master.address) as tool,
    ):
        publisher = await robot.advertise("things", mine)
        (topic,) = await tool.client.get_topics("things")
        theirs = await tool.client.message_class(topic.msg_type)
        assert theirs is not mine
        await tool.subscribe("things", topic.msg_type, got.append, raw=True)
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(mine(field1=7, field2="seven"))
        await until(lambda: got)
        decoded = theirs.FromString(got[0])
        assert (decoded.field1, decoded.field2) == (7, "seven")  # type: ignore[attr-defined]
        assert await tool.client.message_class("std_msgs.String") is String
        with pytest.raises(UnknownMessageType, match="Thong"):
            await tool.client.message_class("mine.Thong")


async def test_another_definition_of_the_same_name_is_refused_with_the_difference(
    master: Master,
) -> None:
    async with (
        NodeHandle("robot", master=master.address) as robot,
        NodeHandle("other", master=master.address) as other,
    ):
        publisher = await robot.advertise("things", thing())
        with pytest.raises(TypeDefinitionConflict) as caught:
            await other.subscribe("things", thing(KINDS.TYPE_DOUBLE), print)
        assert caught.value.difference.splitlines() == ["-string field2 = 2", "+double field2 = 2"]
        subscription = await other.subscribe("things", thing(), print)
        await subscription.close()
        await publisher.close()
        await other.advertise("things", thing(KINDS.TYPE_DOUBLE))


ROBOT = """
    from google.protobuf import descriptor_pb2
    from simple_ros import aio
    from simple_ros.msg.definitions import message_class

    K = descriptor_pb2.FieldDescriptorProto
    proto = descriptor_pb2.FileDescriptorProto(name="mine.proto", package="mine", syntax="proto3")
    field = proto.message_type.add(name="Thing").field.add(name="n", number=1)
    field.type, field.label = K.TYPE_INT32, K.LABEL_OPTIONAL
    Thing = message_class(descriptor_pb2.FileDescriptorSet(file=[proto]), "mine.Thing")

    async def main():
        async with aio.NodeHandle("robot") as node:
            await node.advertise("things", Thing)
            print("ready", flush=True)
            await node.spin()

    aio.run(main())
"""


async def test_a_restarted_master_is_told_the_types_again() -> None:
    async with master_process() as (first, address):
        port = int(address.rsplit(":", 1)[1])
        async with program(ROBOT, master=address) as robot, MasterClient(address) as client:
            assert await robot.line() == "ready"
            assert (await client.message_class("mine.Thing"))(n=3)  # type: ignore[call-arg]
            await first.kill()
            async with master_process(port):
                async with NodeHandle("waiter", master=address) as waiter:
                    await waiter.wait_for_master(30)

                    async def known() -> bool:
                        try:
                            await waiter.client.message_class("mine.Thing")
                        except UnknownMessageType:
                            return False
                        return True

                    while not await known():
                        pass
