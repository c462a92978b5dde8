"""Reading a bag without any node: what stands in it, and messages as objects."""

import tempfile
from pathlib import Path

from simple_ros.bag import Bag, BagWriter
from simple_ros.msg.definitions import definition_of
from simple_ros.msg.geometry_msgs import Point

with tempfile.TemporaryDirectory() as directory:
    path = Path(directory) / "points.mcap"
    with BagWriter(path) as writer:
        definition = definition_of(Point).SerializeToString()
        schema = writer.add_schema("geometry_msgs.Point", "protobuf", definition)
        channel = writer.add_channel("goal", schema)
        for second in range(3):
            writer.add(channel, second * 10**9, [Point(x=second).SerializeToString()])

    with Bag(path) as bag:
        names = [f"{topic.name} [{topic.msg_type}]" for topic in bag.topics.values()]
        print(f"{bag.message_count} messages of {', '.join(names)}")
        for message in bag.messages(["goal"], start_ns=10**9):
            print(f"{message.log_time / 1e9:.0f} s: x {message.decoded().x:.0f}")
