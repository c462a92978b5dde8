"""Mermaid and Graphviz, also with names that mean harm."""

import re

from simple_ros.graph import GraphNode, GraphSnapshot, TopicKey, edges_between
from simple_ros.graph_drawings import to_mermaid, to_topic_dot
from simple_ros.graph_view import node_view, topic_view

SCAN = TopicKey("scan", "sensor_msgs.LaserScan")
POSE = TopicKey("pose", "geometry_msgs.Pose")
NODES = (
    GraphNode("lidar", publishes=(SCAN,)),
    GraphNode("slam", publishes=(POSE,), subscribes=(SCAN,)),
    GraphNode("view", subscribes=(POSE, SCAN)),
)
GRAPH = GraphSnapshot(NODES, edges_between(NODES))
EVIL = 'a"] --> x["\n%%{init}\\ <b>`;#&'
EVIL_GRAPH = GraphSnapshot((GraphNode(EVIL, publishes=(TopicKey(EVIL, EVIL),)),))


def test_mermaid_of_nodes():
    assert to_mermaid(node_view(GRAPH)) == (
        "flowchart LR\n"
        '  n0["lidar"]\n'
        '  n1["slam"]\n'
        '  n2["view"]\n'
        '  n0 -->|"scan"| n1\n'
        '  n0 -->|"scan"| n2\n'
        '  n1 -->|"pose"| n2\n'
    )


def test_mermaid_of_topics():
    lines = to_mermaid(topic_view(GRAPH)).splitlines()
    assert '  t1(["scan<br/>sensor_msgs.LaserScan"])' in lines
    assert "  n0 --> t1" in lines
    assert "  t1 --> n2" in lines


def test_several_topics_of_a_pair_share_an_arrow():
    nodes = (
        GraphNode("a", publishes=(POSE, SCAN)),
        GraphNode("b", subscribes=(POSE, SCAN)),
    )
    text = to_mermaid(node_view(GraphSnapshot(nodes, edges_between(nodes))))
    assert '  n0 -->|"pose<br/>scan"| n1\n' in text


def test_mermaid_takes_no_orders_from_names():
    for view in (node_view(EVIL_GRAPH), topic_view(EVIL_GRAPH)):
        labels = re.findall(r'"([^"]*)"', to_mermaid(view))
        for label in labels:
            assert not set(label.replace("<br/>", "")) & set('"[]<>`&{}%\\\n')
    assert '  n0["a#34;#93; --#62; x' in to_mermaid(node_view(EVIL_GRAPH))


def test_an_empty_name_still_is_a_label():
    assert '  n0[" "]\n' in to_mermaid(node_view(GraphSnapshot((GraphNode(""),))))


def test_dot_of_topics():
    assert to_topic_dot(topic_view(GRAPH)) == (
        "digraph RosGraph {\n"
        "  rankdir=LR;\n"
        "  node [shape=box, style=rounded];\n"
        '  n0 [label="lidar"];\n'
        '  n1 [label="slam"];\n'
        '  n2 [label="view"];\n'
        '  t0 [label="pose\\ngeometry_msgs.Pose", shape=ellipse, style=solid];\n'
        '  t1 [label="scan\\nsensor_msgs.LaserScan", shape=ellipse, style=solid];\n'
        "  n0 -> t1;\n"
        "  n1 -> t0;\n"
        "  t1 -> n1;\n"
        "  t0 -> n2;\n"
        "  t1 -> n2;\n"
        "}\n"
    )


def test_dot_takes_no_orders_from_names():
    (line,) = [line for line in to_topic_dot(topic_view(EVIL_GRAPH)).splitlines() if "n0 [" in line]
    quoted = line.removeprefix('  n0 [label="').removesuffix('"];')
    assert not re.search(r'(?<!\\)(\\\\)*"', quoted), "a quote that ends the label"
    assert "&amp;" in quoted
