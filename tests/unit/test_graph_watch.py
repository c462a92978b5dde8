"""The lines of ``simple-ros graph --watch``."""

import json

import pytest

from simple_ros.cli.graph_watch import change_json, change_line
from simple_ros.graph import ChangeKind, GraphChange, TopicKey

KEY = TopicKey("name", "pkg.Type")


def change(kind: ChangeKind, key: TopicKey | None = KEY) -> GraphChange:
    return GraphChange(kind, "base", "10.0.0.1", 4000, key)


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        (ChangeKind.PUBLISHER_ADDED, "+ base publishes name : pkg.Type"),
        (ChangeKind.SUBSCRIBER_REMOVED, "- base subscribes name : pkg.Type"),
        (ChangeKind.SERVICE_ADDED, "+ base provides name : pkg.Type"),
    ],
)
def test_lines(kind, line):
    assert change_line(change(kind)) == line


def test_a_node():
    node = change(ChangeKind.NODE_REMOVED, None)
    assert change_line(node) == "- node base (ip=10.0.0.1, port=4000)"
    assert json.loads(change_json(node)) == {
        "event": "node_removed", "name": "base", "ip": "10.0.0.1", "port": 4000,
    }  # fmt: skip


@pytest.mark.parametrize("kind", list(ChangeKind))
def test_every_kind_has_a_line_and_a_document(kind):
    key = None if kind.value.startswith("node") else KEY
    assert "base" in change_line(change(kind, key))
    assert json.loads(change_json(change(kind, key)))["event"] == kind.value


def test_a_service_is_not_called_a_topic():
    document = json.loads(change_json(change(ChangeKind.SERVICE_ADDED)))
    assert (document["service"], document["type"]) == ("name", "pkg.Type")
    assert "topic" not in document
