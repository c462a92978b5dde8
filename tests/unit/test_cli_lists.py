"""Lists of nodes and topics as text, and names that are not found."""

from __future__ import annotations

import pytest

from simple_ros.cli.lookup import UnknownName
from simple_ros.cli.node import listing as node
from simple_ros.cli.options import Style
from simple_ros.cli.topic import listing as topic
from simple_ros.errors import UnknownMessageType
from simple_ros.rpc import ros_rpc_pb2 as ros


class TestUnknownName:
    def test_near_matches(self) -> None:
        error = UnknownName("topic", "odm", ["odom", "scan", "tf"])
        assert (error.near, str(error)) == (("odom",), "no topic 'odm'; did you mean 'odom'?")
        assert UnknownName("node", "quad", ["quad_simulator"]).near == ("quad_simulator",)

    def test_none(self) -> None:
        assert str(UnknownName("node", "x")) == "no node 'x'; see 'simple-ros node list'"


class TestTopicsOfType:
    TOPICS = (
        ros.TopicInfo(topic_name="b", msg_type="geometry_msgs.Twist"),
        ros.TopicInfo(topic_name="a", msg_type="geometry_msgs.Twist"),
        ros.TopicInfo(topic_name="c", msg_type="their_msgs.Thing"),
    )

    @pytest.mark.parametrize(
        "spelling",
        ["geometry_msgs.Twist", "geometry_msgs/Twist", "geometry_msgs::msg::Twist", "Twist"],
    )
    def test_any_spelling(self, spelling: str) -> None:
        assert topic.topics_of_type(list(self.TOPICS), spelling) == ["a", "b"]

    def test_a_type_that_is_unknown_here(self) -> None:
        assert topic.topics_of_type(list(self.TOPICS), "their_msgs/msg/Thing") == ["c"]

    def test_none(self) -> None:
        assert topic.topics_of_type(list(self.TOPICS), "std_msgs/String") == []
        with pytest.raises(UnknownMessageType):
            topic.topics_of_type(list(self.TOPICS), "no_msgs/Such")


class TestGraphTexts:
    """The C++ texts are those that rosnode and rostopic printed, with their trailing spaces."""

    ROBOT = ros.NodeInfo(node_name="quad_simulator", ip="127.0.0.1", port=60000)
    OTHER = ros.NodeInfo(node_name="a", ip="::1", port=1, addresses=["10.0.0.1:1"])
    TOPIC = ros.TopicInfo(topic_name="quad_odometry", msg_type="geometry_msgs.Odometry")

    def test_nodes(self) -> None:
        nodes = [self.ROBOT, self.OTHER]
        assert node.written_list(nodes, Style.READABLE) == (
            "a               [::1]:1\nquad_simulator  127.0.0.1:60000"
        )
        assert node.written_list(nodes[:1], Style.CPP) == (
            "Active nodes:\n * quad_simulator (127.0.0.1:60000)\nTotal nodes: 1"
        )
        assert node.written_list([], Style.CPP) == "Active nodes:\nTotal nodes: 0"

    def test_a_node(self) -> None:
        found = ros.GetNodeInfoResponse(node_info=self.ROBOT, publishes=[self.TOPIC])
        assert node.written_info(found, Style.CPP).splitlines() == [
            "Node: quad_simulator",
            " - IP: 127.0.0.1",
            " - Port: 60000",
            "Published topics: ",
            "  * quad_odometry (geometry_msgs.Odometry)",
            "Subscribed topics: ",
            "  None",
        ]
        alone = ros.GetNodeInfoResponse(node_info=self.OTHER)
        assert node.written_info(alone, Style.READABLE).splitlines() == [
            "Node: a",
            "Address: [::1]:1 (also 10.0.0.1:1)",
            "Publishes: nothing",
            "Subscribes: nothing",
        ]

    def test_topics(self) -> None:
        line = topic.written_list([self.TOPIC], Style.READABLE)
        assert line == "quad_odometry  geometry_msgs.Odometry"
        assert topic.written_list([self.TOPIC], Style.CPP) == (
            "Active topics:\n * quad_odometry [geometry_msgs.Odometry]"
        )

    def test_a_topic(self) -> None:
        found = ros.GetTopicInfoResponse(msg_type="geometry_msgs.Odometry", publishers=[self.ROBOT])
        assert topic.written_info("quad_odometry", found, Style.CPP).splitlines() == [
            "Topic: quad_odometry",
            "Type: geometry_msgs.Odometry",
            "Publishers: ",
            "  * quad_simulator (127.0.0.1:60000)",
            "Subscribers: None",
        ]
        assert topic.written_info("quad_odometry", found, Style.READABLE).splitlines() == [
            "Topic: quad_odometry",
            "Type: geometry_msgs.Odometry",
            "Publishers:",
            "  quad_simulator  127.0.0.1:60000",
            "Subscribers: none",
        ]
