"""What is drawn, and what a filter leaves."""

import pytest

from simple_ros.graph import GraphNode, GraphService, GraphSnapshot, TopicKey, edges_between
from simple_ros.graph_view import Kind, filtered, node_view, printable, topic_view

IMAGE = TopicKey("camera/image", "sensor_msgs.Image")
OBJECTS = TopicKey("objects", "vision.Objects")
OTHER = TopicKey("objects", "vision.Other")
NODES = (
    GraphNode("camera", "10.0.0.1", 1, (IMAGE,)),
    GraphNode("detector", "10.0.0.1", 2, (OBJECTS,), (IMAGE,)),
    GraphNode("planner", "10.0.0.2", 3, (), (OBJECTS, OTHER)),
    GraphNode("recorder", "10.0.0.2", 4, (), (IMAGE, OBJECTS)),
)
GRAPH = GraphSnapshot(NODES, edges_between(NODES))


def test_nodes_are_linked_once_whatever_the_number_of_topics():
    both = (
        GraphNode("both", publishes=(IMAGE, OBJECTS)),
        GraphNode("end", "", 0, (), (IMAGE, OBJECTS)),
    )
    view = node_view(GraphSnapshot(both, edges_between(both)))
    assert [(arrow.src, arrow.dst, arrow.topics) for arrow in view.arrows] == [
        ("n0", "n1", (IMAGE, OBJECTS))
    ]


def test_topics_stand_between_nodes_and_two_types_are_two_topics():
    view = topic_view(GRAPH)
    topics = [vertex for vertex in view.vertices if vertex.kind is Kind.TOPIC]
    assert [(t.id, t.name, t.detail) for t in topics] == [
        ("t0", "camera/image", "sensor_msgs.Image"),
        ("t1", "objects", "vision.Objects"),
        ("t2", "objects", "vision.Other"),
    ]
    assert {(arrow.src, arrow.dst) for arrow in view.arrows} == {
        ("n0", "t0"), ("t0", "n1"), ("t0", "n3"), ("n1", "t1"),
        ("t1", "n2"), ("t1", "n3"), ("t2", "n2"),
    }  # fmt: skip
    assert [vertex.detail for vertex in view.vertices][:2] == ["10.0.0.1:1", "10.0.0.1:2"]


def test_a_node_by_name_comes_with_its_topics_and_the_other_ends():
    part = filtered(GRAPH, "/detector")
    assert [node.name for node in part.nodes] == ["camera", "detector", "planner", "recorder"]
    assert part.nodes[1] == NODES[1]
    assert part.nodes[2].subscribes == (OBJECTS,)  # not its other topic
    assert part.nodes[3].subscribes == (OBJECTS,)  # camera -> recorder is no matter of the detector
    assert {(edge.src, edge.dst) for edge in part.edges} == {
        ("camera", "detector"), ("detector", "planner"), ("detector", "recorder"),
    }  # fmt: skip


def test_a_topic_by_name_comes_with_all_that_use_it():
    part = filtered(GRAPH, "objects")
    assert [node.name for node in part.nodes] == ["detector", "planner", "recorder"]
    assert part.nodes[0].subscribes == ()
    assert part.nodes[1].subscribes == (OBJECTS, OTHER)


def test_a_service_by_name_comes_with_its_node():
    services = GraphService("save_map", "x.Save", "recorder"), GraphService("arm", "x.Arm", "base")
    part = filtered(GraphSnapshot(NODES, GRAPH.edges, services), "save_map")
    assert part.services == services[:1]
    assert [node.name for node in part.nodes] == ["recorder"]


def test_a_filter_that_fits_nothing_leaves_nothing():
    assert filtered(GRAPH, "nowhere") == GraphSnapshot()


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain/Ünïcode_雷达", "plain/Ünïcode_雷达"),
        ("a\x1b[2Jb", "a\\x1b[2Jb"),
        ("two\nlines\r", "two\\nlines\\r"),
        ("x\u202ey", "x\\u202ey"),
    ],
)
def test_what_moves_a_cursor_is_written_out(text, shown):
    assert printable(text) == shown
