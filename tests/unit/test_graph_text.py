"""The print-outs of a graph against those of C++ simple_ros, byte for byte."""

import json

import pytest

from simple_ros.graph import (
    GraphEdge,
    GraphNode,
    GraphSnapshot,
    TopicKey,
    edges_between,
    to_dot,
    to_json,
    to_readable_string,
)

ODOMETRY = TopicKey("quad_odometry", "geometry_msgs.Odometry")
MARKERS = TopicKey("quad_marker_array", "visualization_msgs.MarkerArray")
VISUALIZER = GraphNode("quad_visualizer", "127.0.0.1", 60001, (MARKERS,), (ODOMETRY,))
SIMULATOR = GraphNode("quad_simulator", "127.0.0.1", 60000, (ODOMETRY,))
# A C++ Master lists nodes in the order of a hash table; the renderers keep the order they are given.
GRAPH = GraphSnapshot(
    (VISUALIZER, SIMULATOR), (GraphEdge("quad_simulator", "quad_visualizer", ODOMETRY),)
)

READABLE = """\
==== Message Graph ====
Nodes: 2, Edges: 1

[Nodes]
 - quad_visualizer (ip=127.0.0.1, port=60001)
    publishes:
      - quad_marker_array : visualization_msgs.MarkerArray
    subscribes:
      - quad_odometry : geometry_msgs.Odometry
 - quad_simulator (ip=127.0.0.1, port=60000)
    publishes:
      - quad_odometry : geometry_msgs.Odometry

[Edges]
 - quad_simulator -> quad_visualizer  [quad_odometry : geometry_msgs.Odometry]
"""

JSON = """\
{
  "edges": [
    {
      "dst": "quad_visualizer",
      "msg": "geometry_msgs.Odometry",
      "src": "quad_simulator",
      "topic": "quad_odometry"
    }
  ],
  "nodes": [
    {
      "ip": "127.0.0.1",
      "name": "quad_visualizer",
      "port": 60001,
      "publishes": [
        {
          "msg": "visualization_msgs.MarkerArray",
          "topic": "quad_marker_array"
        }
      ],
      "subscribes": [
        {
          "msg": "geometry_msgs.Odometry",
          "topic": "quad_odometry"
        }
      ]
    },
    {
      "ip": "127.0.0.1",
      "name": "quad_simulator",
      "port": 60000,
      "publishes": [
        {
          "msg": "geometry_msgs.Odometry",
          "topic": "quad_odometry"
        }
      ],
      "subscribes": []
    }
  ]
}"""

DOT = """\
digraph RosGraph {
  rankdir=LR;
  node [shape=box, style=rounded];
  "quad_visualizer";
  "quad_simulator";
  "quad_simulator" -> "quad_visualizer" [label="quad_odometry\\ngeometry_msgs.Odometry"];
}
"""


@pytest.mark.parametrize(
    ("render", "text"), [(to_readable_string, READABLE), (to_json, JSON), (to_dot, DOT)]
)
def test_two_nodes_and_an_edge_print_as_in_cpp(render, text):
    assert render(GRAPH) == text


def test_an_empty_graph_prints_as_in_cpp():
    empty = GraphSnapshot()
    assert to_readable_string(empty) == (
        "==== Message Graph ====\nNodes: 0, Edges: 0\n\n[Nodes]\n\n[Edges]\n"
    )
    assert to_json(empty) == '{\n  "edges": [],\n  "nodes": []\n}'
    assert to_dot(empty) == (
        "digraph RosGraph {\n  rankdir=LR;\n  node [shape=box, style=rounded];\n}\n"
    )


def test_quotes_in_names_do_not_break_dot_or_json():
    graph = GraphSnapshot((GraphNode('a"\\b'),))
    assert '  "a\\"\\\\b";\n' in to_dot(graph)
    assert json.loads(to_json(graph))["nodes"][0]["name"] == 'a"\\b'


def test_edges_follow_from_the_nodes_in_print_order():
    loop = GraphNode("loop", publishes=(ODOMETRY,), subscribes=(ODOMETRY,))
    other_type = GraphNode("typed", subscribes=(TopicKey("quad_odometry", "a.B"),))
    edges = edges_between((SIMULATOR, VISUALIZER, loop, other_type))
    assert edges == (
        GraphEdge("loop", "loop", ODOMETRY),
        GraphEdge("loop", "quad_visualizer", ODOMETRY),
        GraphEdge("quad_simulator", "loop", ODOMETRY),
        GraphEdge("quad_simulator", "quad_visualizer", ODOMETRY),
    )
