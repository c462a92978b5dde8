"""The HTML page: complete, self-contained, and safe whatever the names are."""

import base64
import hashlib
import re
import shutil
import subprocess
from html.parser import HTMLParser
from importlib.resources import files

import pytest

from simple_ros.graph import GraphNode, GraphService, GraphSnapshot, TopicKey, edges_between
from simple_ros.graph_page import to_html
from simple_ros.graph_view import node_view, topic_view

STYLE = files("simple_ros.cli").joinpath("graph_page.css").read_text(encoding="utf-8")
SCRIPT = files("simple_ros.cli").joinpath("graph_page.js").read_text(encoding="utf-8")
EVIL = "</title></script><script>alert(1)</script>\"' onload=x &amp;\x1b\u202e"
VOID = {"meta", "input", "rect", "path", "br"}


class Page(HTMLParser):
    """Elements with their attributes, and a check that all are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self._open.pop() == tag

    def handle_data(self, data):
        if self._open and self._open[-1] not in ("script", "style"):
            self.text += data

    def all(self, tag: str, kind: str = "") -> list[dict[str, str | None]]:
        return [
            attributes
            for name, attributes in self.found
            if name == tag and (not kind or kind in (attributes.get("class") or "").split())
        ]


def page_of(graph: GraphSnapshot, view=topic_view, heading: str = "graph") -> str:
    return to_html(graph, view(graph), heading, style=STYLE, script=SCRIPT)


def graph_of(*nodes: GraphNode) -> GraphSnapshot:
    return GraphSnapshot(nodes, edges_between(nodes))


SCAN = TopicKey("scan", "sensor_msgs.LaserScan")
GRAPH = graph_of(
    GraphNode("lidar", "10.0.0.7", 4001, (SCAN,)), GraphNode("slam", "10.0.0.7", 4002, (), (SCAN,))
)


def test_the_drawing_says_who_is_linked_to_whom():
    page = Page(page_of(GRAPH))
    names = {v["data-id"]: v["data-name"] for v in page.all("g", "vertex")}
    assert names == {"n0": "lidar", "n1": "slam", "t0": "scan"}
    arrows = {(a["data-from"], a["data-to"]) for a in page.all("g", "arrow")}
    assert arrows == {("n0", "t0"), ("t0", "n1")}
    assert {arrow["data-to"] for arrow in Page(page_of(GRAPH, node_view)).all("g", "arrow")} == {
        "n1"
    }


def test_the_tables_say_it_too():
    page = Page(page_of(GRAPH))
    assert len(page.all("table")) == 2
    for text in ("2 nodes, 1 topic, 1 connection", "10.0.0.7:4001", "scan : sensor_msgs.LaserScan"):
        assert text in page.text


def test_services_have_a_table_where_there_are_any():
    services = (GraphService(EVIL, "x.Save", "slam"),)
    page = Page(page_of(GraphSnapshot(GRAPH.nodes, GRAPH.edges, services)))
    assert len(page.all("table")) == 3
    assert len(page.all("script")) == 1


def test_nothing_is_fetched():
    text = page_of(GRAPH)
    assert "http://" not in text
    assert "https://" not in text
    tags = {tag for tag, _ in Page(text).found}
    assert not tags & {"link", "img", "iframe", "object", "base", "image", "use"}
    assert not any("src" in attributes for _, attributes in Page(text).found)
    assert "url(" not in STYLE.replace("url(#tip)", "")


def test_the_policy_allows_this_script_and_style_and_nothing_else():
    (policy,) = (
        meta["content"] for meta in Page(page_of(GRAPH)).all("meta") if "http-equiv" in meta
    )
    for text in (STYLE, SCRIPT):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert policy.startswith("default-src 'none'; ")
    assert "unsafe" not in policy


@pytest.mark.parametrize("view", [node_view, topic_view])
def test_names_are_text_and_nothing_else(view):
    key = TopicKey(EVIL, EVIL)
    graph = graph_of(GraphNode(EVIL, EVIL, 1, (key,)), GraphNode("b", subscribes=(key,)))
    text = page_of(graph, view, heading=EVIL)
    page = Page(text)
    assert len(page.all("script")) == 1
    assert not any("onload" in attributes for _, attributes in page.found)
    shown = EVIL.replace("\x1b", "\\x1b").replace("\u202e", "\\u202e")
    assert page.all("g", "vertex")[0]["data-name"] == shown
    assert shown in page.text
    assert "\x1b" not in text
    assert "\u202e" not in text


def test_a_long_name_is_cut_in_the_drawing_only():
    name = "robot/" + "very_" * 40 + "long"
    page = Page(page_of(graph_of(GraphNode(name))))
    assert page.all("g", "vertex")[0]["data-name"] == name
    assert float(page.all("rect")[0]["width"]) < 400


def test_two_thousand_topics():
    keys = [TopicKey(f"robot/part_{index}/data", "a.B") for index in range(2000)]
    graph = graph_of(
        *(
            GraphNode(
                f"n{i:03}", "h", i, tuple(keys[i::100]), tuple(sorted(keys[(i + 7) % 100 :: 100]))
            )
            for i in range(100)
        )
    )
    page = Page(page_of(graph))
    assert len(page.all("g", "vertex")) == 2100
    assert len(page.all("g", "arrow")) == 4000


def test_an_empty_graph_is_a_page_too():
    assert "0 nodes, 0 topics, 0 connections" in Page(page_of(GraphSnapshot())).text


def test_the_script_uses_only_ids_and_classes_that_are_there():
    text = page_of(GRAPH)
    ids = set(re.findall(r'getElementById\("(\w+)"\)', SCRIPT))
    assert ids
    for name in ids:
        assert f'id="{name}"' in text


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node, a JavaScript interpreter")
def test_the_script_is_javascript(tmp_path):
    path = tmp_path / "page.js"
    path.write_text(SCRIPT)
    subprocess.run(["node", "--check", path], check=True, timeout=30)
