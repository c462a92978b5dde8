"""What watchers of the graph hear."""

from simple_ros.graph import TopicKey
from simple_ros_master import feed as feed_module
from simple_ros_master.feed import ChangeLog, Feed
from simple_ros_master.graph import MessageGraph

KEY = TopicKey("t", "a.A")


def publish(graph: MessageGraph, log: ChangeLog, name: str) -> None:
    for change in graph.add_publisher(name, KEY):
        log.add(change)


def everything(feed: Feed) -> list[tuple[int, str]]:
    events = iter(feed.take, None)
    return [(event.sequence, event.WhichOneof("kind")) for event in events]


def test_a_feed_starts_with_the_graph_as_it_is_and_goes_on_with_changes():
    graph = MessageGraph()
    log = ChangeLog(graph)
    publish(graph, log, "before")
    feed = log.open()
    publish(graph, log, "still in the snapshot")
    event = feed.take()
    assert event.sequence == 4
    assert [node.node_info.node_name for node in event.snapshot.nodes] == [
        "before",
        "still in the snapshot",
    ]
    publish(graph, log, "after")
    assert everything(feed) == [(5, "change"), (6, "change")]
    assert everything(feed) == []


def test_a_slow_watcher_gets_a_fresh_snapshot_instead_of_a_long_queue(monkeypatch):
    monkeypatch.setattr(feed_module, "MAX_WAITING", 10)
    graph = MessageGraph()
    log = ChangeLog(graph)
    slow, quick = log.open(), log.open()
    assert everything(slow) == everything(quick) == [(0, "snapshot")]
    for number in range(50):
        publish(graph, log, str(number))
        assert len(everything(quick)) == 2
    assert everything(slow) == [(100, "snapshot")]
    publish(graph, log, "more")
    assert everything(slow) == [(101, "change"), (102, "change")]


def test_a_closed_feed_hears_nothing():
    graph = MessageGraph()
    log = ChangeLog(graph)
    feed = log.open()
    feed.take()
    log.close(feed)
    log.close(feed)
    publish(graph, log, "n")
    assert everything(feed) == []
