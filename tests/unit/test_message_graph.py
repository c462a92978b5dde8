"""The Master's message graph: its rules one by one, then any history against a naive model."""

from hypothesis import given
from hypothesis import strategies as st

from simple_ros.graph import (
    ChangeKind,
    GraphChange,
    GraphEdge,
    GraphNode,
    GraphSnapshot,
    TopicKey,
    edges_between,
    to_dot,
    to_json,
    to_readable_string,
)
from simple_ros_master.graph import MessageGraph, Role

CHATTER = TopicKey("chatter", "std_msgs.String")
OTHER_TYPE = TopicKey("chatter", "example.SensorData")


def kinds(changes: list[GraphChange]) -> list[ChangeKind]:
    return [change.kind for change in changes]


def test_edges_need_equal_topic_and_equal_type():
    graph = MessageGraph()
    graph.add_publisher("p", CHATTER)
    graph.add_subscriber("s", CHATTER)
    graph.add_subscriber("t", OTHER_TYPE)
    assert graph.edges == {GraphEdge("p", "s", CHATTER)}


def test_a_node_may_hear_itself():
    graph = MessageGraph()
    graph.add_publisher("p", CHATTER)
    graph.add_subscriber("p", CHATTER)
    assert graph.edges == {GraphEdge("p", "p", CHATTER)}
    graph.remove_publisher("p", CHATTER)
    assert graph.edges == frozenset()


def test_adding_reports_the_node_first_and_adding_twice_reports_nothing():
    graph = MessageGraph()
    node = graph.upsert_node("p", "127.0.0.1", 60000)
    assert node == [GraphChange(ChangeKind.NODE_ADDED, "p", "127.0.0.1", 60000)]
    added = graph.add_publisher("p", CHATTER)
    assert added == [GraphChange(ChangeKind.PUBLISHER_ADDED, "p", "127.0.0.1", 60000, CHATTER)]
    assert graph.upsert_node("p", "127.0.0.1", 60000) == []
    assert graph.add_publisher("p", CHATTER) == []


def test_an_unknown_node_is_added_with_its_first_topic():
    graph = MessageGraph()
    changes = graph.add_subscriber("s", CHATTER)
    assert kinds(changes) == [ChangeKind.NODE_ADDED, ChangeKind.SUBSCRIBER_ADDED]
    assert graph.node("s") == GraphNode("s", subscribes=(CHATTER,))


def test_a_node_moves_with_its_topics():
    graph = MessageGraph()
    graph.add_publisher("p", CHATTER)
    assert kinds(graph.upsert_node("p", "10.0.0.1", 1)) == [ChangeKind.NODE_ADDED]
    assert graph.node("p") == GraphNode("p", "10.0.0.1", 1, publishes=(CHATTER,))


def test_a_node_goes_with_its_last_topic():
    graph = MessageGraph()
    graph.add_publisher("n", CHATTER)
    graph.add_subscriber("n", CHATTER)
    assert kinds(graph.remove_publisher("n", CHATTER)) == [ChangeKind.PUBLISHER_REMOVED]
    assert "n" in graph
    changes = graph.remove_subscriber("n", CHATTER)
    assert kinds(changes) == [ChangeKind.SUBSCRIBER_REMOVED, ChangeKind.NODE_REMOVED]
    assert "n" not in graph


def test_a_kept_node_stands_without_topics_until_it_is_removed():
    graph = MessageGraph()
    graph.upsert_node("n")
    graph.keep_node("n")
    graph.keep_node("nobody")
    graph.add_publisher("n", CHATTER)
    graph.remove_publisher("n", CHATTER)
    assert list(graph.nodes()) == [GraphNode("n")]
    assert kinds(graph.remove_node("n")) == [ChangeKind.NODE_REMOVED]
    assert len(graph) == 0


def test_removing_what_is_unknown_changes_nothing():
    graph = MessageGraph()
    graph.add_publisher("p", CHATTER)
    before = graph.snapshot()
    assert graph.remove_subscriber("p", CHATTER) == []
    assert graph.remove_publisher("p", OTHER_TYPE) == []
    assert graph.remove_publisher("q", CHATTER) == []
    assert graph.remove_node("q") == []
    assert graph.snapshot() == before


def test_questions_by_topic_take_one_type_or_any():
    graph = MessageGraph()
    graph.add_subscriber("s", CHATTER)
    graph.add_publisher("b", OTHER_TYPE)
    graph.add_publisher("a", CHATTER)
    graph.add_publisher("b", CHATTER)
    assert graph.types_of("chatter") == ("std_msgs.String", "example.SensorData")
    assert graph.publishers_of("chatter") == ("a", "b")
    assert graph.publishers_of("chatter", "example.SensorData") == ("b",)
    assert graph.subscribers_of("chatter") == ("s",)
    assert graph.using(CHATTER) == ("a", "b", "s")
    assert graph.publishers_of("nothing") == graph.subscribers_of("chatter", "x.Y") == ()
    assert graph.types_of("nothing") == ()


def test_the_first_type_that_is_still_in_use_is_the_type_of_a_topic():
    graph = MessageGraph()
    graph.add_publisher("a", OTHER_TYPE)
    graph.add_publisher("b", CHATTER)
    assert list(graph.topics()) == [OTHER_TYPE]
    graph.remove_publisher("a", OTHER_TYPE)
    graph.add_publisher("a", OTHER_TYPE)
    assert list(graph.topics()) == [CHATTER]


# -- any history, against a model that is only a set of registrations ------------------------------

NAMES = st.sampled_from(["a", "b", "c", ""])
KEYS = st.builds(TopicKey, st.sampled_from(["x", "y"]), st.sampled_from(["T", "U"]))
STEPS = st.one_of(
    st.tuples(st.just("add"), st.sampled_from(Role), NAMES, KEYS),
    st.tuples(st.just("remove"), st.sampled_from(Role), NAMES, KEYS),
    st.tuples(st.just("remove_node"), NAMES),
)


def naive_snapshot(registered: set[tuple[Role, str, TopicKey]]) -> GraphSnapshot:
    nodes = tuple(
        GraphNode(
            name,
            publishes=tuple(sorted(k for r, n, k in registered if (r, n) == (0, name))),
            subscribes=tuple(sorted(k for r, n, k in registered if (r, n) == (1, name))),
        )
        for name in sorted({name for _, name, _ in registered})
    )
    return GraphSnapshot(nodes, edges_between(nodes))


def step_naively(registered: set[tuple[Role, str, TopicKey]], step: tuple) -> None:
    match step:
        case ("add", *entry):
            registered.add(tuple(entry))
        case ("remove", *entry):
            registered.discard(tuple(entry))
        case ("remove_node", name):
            registered -= {entry for entry in registered if entry[1] == name}


def replay(changes: list[GraphChange]) -> set[tuple[Role, str, TopicKey]]:
    """What a watcher knows who only hears the changes."""
    known: set[tuple[Role, str, TopicKey]] = set()
    ends = {
        ChangeKind.PUBLISHER_ADDED: (known.add, Role.PUBLISHER),
        ChangeKind.SUBSCRIBER_ADDED: (known.add, Role.SUBSCRIBER),
        ChangeKind.PUBLISHER_REMOVED: (known.remove, Role.PUBLISHER),
        ChangeKind.SUBSCRIBER_REMOVED: (known.remove, Role.SUBSCRIBER),
    }
    nodes: set[str] = set()
    for change in changes:
        if change.kind is ChangeKind.NODE_ADDED:
            assert change.node not in nodes
            nodes.add(change.node)
        elif change.kind is ChangeKind.NODE_REMOVED:
            assert not any(entry[1] == change.node for entry in known)
            nodes.remove(change.node)
        else:
            act, role = ends[change.kind]
            assert change.node in nodes
            act((role, change.node, change.key))
    assert nodes == {entry[1] for entry in known}
    return known


@given(st.lists(STEPS, max_size=40))
def test_any_history_equals_the_naive_model(steps):
    graph = MessageGraph()
    registered: set[tuple[Role, str, TopicKey]] = set()
    changes: list[GraphChange] = []
    for name, *arguments in steps:
        changes += getattr(graph, name)(*arguments)
        step_naively(registered, (name, *arguments))
        assert graph.snapshot() == naive_snapshot(registered)
    assert replay(changes) == registered
    assert len(graph) == len(graph.snapshot().nodes)
    for role in Role:
        for key in {key for _, _, key in registered}:
            expected = {name for r, name, k in registered if (r, k) == (role, key)}
            assert set(graph.at(role, key)) == expected
    assert [key.topic for key in graph.topics()] == sorted({k.topic for _, _, k in registered})


@given(st.lists(STEPS, max_size=20))
def test_the_print_outs_are_those_of_the_snapshot(steps):
    graph = MessageGraph()
    for name, *arguments in steps:
        getattr(graph, name)(*arguments)
    snapshot = graph.snapshot()
    assert graph.to_readable_string() == to_readable_string(snapshot)
    assert graph.to_dot() == to_dot(snapshot)
    assert graph.to_json() == to_json(snapshot)
