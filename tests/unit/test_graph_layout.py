"""Places of vertices: none overlaps another, equal input gives equal drawings."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.graph_layout import Layout, layered

SIZE = (100.0, 40.0)


def sizes(names):
    return dict.fromkeys(names, SIZE)


def overlaps(layout: Layout) -> list[tuple[str, str]]:
    """Pairs that overlap; vertices are swept from left to right."""
    found = []
    boxes = sorted(layout.boxes.items(), key=lambda item: item[1].x)
    for index, (name, box) in enumerate(boxes):
        for other, rival in boxes[index + 1 :]:
            if rival.x >= box.x + box.width:
                break
            if rival.y < box.y + box.height and box.y < rival.y + rival.height:
                found.append((name, other))
    return found


def test_a_chain_goes_to_the_right():
    boxes = layered(sizes("abc"), [("a", "b"), ("b", "c")]).boxes
    assert boxes["a"].x < boxes["b"].x < boxes["c"].x
    assert {box.y for box in boxes.values()} == {0.0}


def test_a_source_stands_right_before_what_it_feeds():
    boxes = layered(sizes("abcs"), [("a", "b"), ("b", "c"), ("s", "c")]).boxes
    assert boxes["s"].x == boxes["b"].x


def test_neighbours_are_at_the_same_height():
    boxes = layered(sizes("abcxyz"), [("a", "z"), ("b", "y"), ("c", "x")]).boxes
    for source, end in ("az", "by", "cx"):
        assert boxes[source].y == boxes[end].y


def test_cycles_and_self_loops_are_no_trouble():
    layout = layered(sizes("abc"), [("a", "b"), ("b", "c"), ("c", "a"), ("b", "b")])
    assert len({box.x for box in layout.boxes.values()}) == 3


def test_nothing_gives_nothing():
    assert layered({}, []) == Layout({}, 0.0, 0.0)


def test_the_whole_contains_all():
    layout = layered({"a": (50, 20), "b": (150, 60), "c": (70, 20)}, [("a", "b"), ("a", "c")])
    for box in layout.boxes.values():
        assert box.x >= 0
        assert box.y >= 0
        assert box.x + box.width <= layout.width
        assert box.y + box.height <= layout.height


@pytest.mark.parametrize("rings", [False, True])
def test_two_thousand_topics_stay_in_the_shape_of_a_screen(rings):
    nodes = [f"n{index}" for index in range(200)]
    topics = [f"t{index}" for index in range(2000)]
    arrows = [(nodes[index % 200], topic) for index, topic in enumerate(topics)]
    reader = (lambda index: (index * 7 + 3) % 200) if rings else (lambda index: 199)
    arrows += [(topic, nodes[reader(index)]) for index, topic in enumerate(topics)]
    layout = layered(sizes(nodes + topics), arrows)
    assert overlaps(layout) == []
    assert 0.3 < layout.width / layout.height < 6


@st.composite
def graphs(draw):
    count = draw(st.integers(1, 40))
    names = [f"v{index}" for index in range(count)]
    size = st.tuples(st.integers(10, 300), st.integers(10, 80))
    pair = st.tuples(st.sampled_from(names), st.sampled_from(names))
    return {name: draw(size) for name in names}, draw(st.lists(pair, max_size=80))


@given(graphs())
def test_no_two_vertices_overlap_and_the_same_is_drawn_again(graph):
    layout = layered(*graph)
    assert layout.boxes.keys() == graph[0].keys()
    assert overlaps(layout) == []
    assert layered(*graph) == layout


def test_columns_of_a_folded_layer_are_apart():
    names = [f"v{index:03}" for index in range(100)]
    xs = sorted({box.x for box in layered(sizes(names), [], gap=10.0).boxes.values()})
    assert len(xs) > 1
    assert all(right - left == SIZE[0] + 10.0 for left, right in pairwise(xs))
