"""The Master's brain: answers and effects for each rule, then any history against what must hold."""

import sys
from collections import defaultdict

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simple_ros.graph import ChangeKind, GraphChange, TopicKey, edges_between
from simple_ros.qos import DEFAULT, SENSOR_DATA, QosProfile
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc.convert import qos_to_proto
from simple_ros_master import directory as directory_module
from simple_ros_master import queries
from simple_ros_master.directory import Directory
from simple_ros_master.graph import Role
from simple_ros_master.link import frame_of
from simple_ros_master.matching import full_update
from simple_ros_master.peers import Address, CloseLink, EndLease, Notice, Push, Watch

ODOMETRY = "geometry_msgs.Odometry"
REGISTRATIONS = {
    "register_publisher": ros.RegisterPublisherRequest,
    "subscribe": ros.SubscribeRequest,
    "unregister_publisher": ros.UnregisterPublisherRequest,
    "unsubscribe": ros.UnsubscribeRequest,
}


def cpp(name: str, port: int) -> ros.NodeInfo:
    """A node as C++ simple_ros describes it."""
    return ros.NodeInfo(ip="127.0.0.1", port=port, node_name=name)


def ours(
    name: str, port: int, qos: QosProfile | None = None, instance: str | None = None
) -> ros.NodeInfo:
    """A node as this library describes it."""
    info = cpp(name, port)
    info.instance_id = f"{name}-1" if instance is None else instance
    if qos is not None:
        info.endpoint.qos.CopyFrom(qos_to_proto(qos))
    return info


class Bench:
    """A directory to call in short, remembering the effects of the last call."""

    def __init__(self) -> None:
        self.directory = Directory("id", "1.0")
        self.effects: list = []

    def _call(self, kind: str, topic: str, info: ros.NodeInfo | None, msg_type: str, **extra):
        request = REGISTRATIONS[kind](topic_name=topic, msg_type=msg_type, node_info=info, **extra)
        response, self.effects = getattr(self.directory, kind)(request)
        return response

    def advertise(self, topic, info, msg_type=ODOMETRY, **extra):
        return self._call("register_publisher", topic, info, msg_type, **extra)

    def subscribe(self, topic, info, msg_type=ODOMETRY, **extra):
        return self._call("subscribe", topic, info, msg_type, **extra)

    def unadvertise(self, topic, info, msg_type=ODOMETRY):
        return self._call("unregister_publisher", topic, info, msg_type)

    def unsubscribe(self, topic, info, msg_type=ODOMETRY):
        return self._call("unsubscribe", topic, info, msg_type)

    def lease(self, number: int, info: ros.NodeInfo) -> None:
        self.effects = self.directory.open_lease(number, info)

    def end_lease(self, number: int) -> None:
        self.effects = self.directory.close_lease(number)

    def of(self, kind: type) -> list:
        return [effect for effect in self.effects if isinstance(effect, kind)]

    def pushes(self) -> list[tuple[int, str, list[int], list[int]]]:
        """(port pushed to, topic, ports added, ports removed) of each push."""
        return [
            (
                push.address.port,
                push.update.topic,
                [target.port for target in push.update.add_targets],
                [target.port for target in push.update.remove_targets],
            )
            for push in self.of(Push)
        ]

    def notices(self, kind: str) -> dict[int, object]:
        return {
            notice.lease: getattr(notice.event, kind)
            for notice in self.of(Notice)
            if notice.event.WhichOneof("kind") == kind
        }

    def names(self) -> list[str]:
        response = queries.get_nodes(self.directory, ros.GetNodesRequest())
        return [node.node_name for node in response.nodes]


@pytest.fixture
def bench() -> Bench:
    return Bench()


# -- registering as C++ does -----------------------------------------------------------------------


def test_a_publisher_is_pushed_the_whole_list_even_when_empty_and_again(bench):
    response = bench.advertise("t", cpp("p", 1))
    assert (response.success, response.message) == (True, "Register publisher success")
    assert bench.pushes() == [(1, "t", [], [])]
    bench.subscribe("t", cpp("s", 2))
    bench.subscribe("t", cpp("u", 3))
    assert not bench.advertise("t", cpp("p", 1)).subscribers
    assert bench.pushes() == [(1, "t", [2, 3], [])]


def test_every_publisher_is_pushed_a_new_subscriber(bench):
    bench.advertise("t", cpp("p", 1))
    bench.advertise("t", cpp("q", 2))
    response = bench.subscribe("t", cpp("s", 3))
    assert (response.success, response.message) == (True, "Subscribe success")
    assert not response.node_info
    assert bench.pushes() == [(1, "t", [3], []), (2, "t", [3], [])]


def test_the_sample_push_has_the_bytes_seen_on_the_wire(bench):
    bench.advertise("quad_odometry", cpp("quad_simulator", 60000))
    bench.subscribe("quad_odometry", cpp("quad_visualizer", 60001))
    (push,) = bench.of(Push)
    assert frame_of(push.update) == (
        b"\x00\x0dquad_odometry\x00\x12TopicTargetsUpdate\x00\x00\x00\x31"
        b"\x0a\x0dquad_odometry\x12\x20\x0a\x09127.0.0.1\x10\xe1\xd4\x03\x1a\x0fquad_visualizer"
    )


def test_unsubscribing_removes_the_target_and_unregistering_tells_nobody(bench):
    bench.advertise("t", cpp("p", 1))
    bench.subscribe("t", cpp("s", 2))
    response = bench.unsubscribe("t", cpp("s", 2))
    assert (response.success, response.message) == (True, "Unsubscribe success")
    assert bench.pushes() == [(1, "t", [], [2])]
    bench.subscribe("t", cpp("s", 2))
    response = bench.unadvertise("t", cpp("p", 1))
    assert (response.success, response.message) == (True, "Unregister publisher success")
    assert bench.pushes() == []
    assert bench.names() == ["s"]


@pytest.mark.parametrize("info", [None, ros.NodeInfo(), cpp("stranger", 9)])
def test_a_goodbye_always_succeeds(bench, info):
    bench.advertise("t", cpp("p", 1))
    bench.subscribe("t", cpp("p", 1))
    assert bench.unadvertise("t", info).success
    assert bench.unsubscribe("nothing", info).success
    assert bench.effects == []
    assert bench.names() == ["p"]


def test_only_equal_types_are_brought_together(bench):
    bench.advertise("t", cpp("p", 1), "a.A")
    bench.subscribe("t", cpp("s", 2), "b.B")
    assert bench.pushes() == []
    bench.advertise("t", cpp("q", 3), "b.B")
    assert bench.pushes() == [(3, "t", [2], [])]


def test_a_node_that_hears_itself_is_pushed_its_own_address_once(bench):
    bench.advertise("t", cpp("n", 1))
    bench.subscribe("t", cpp("n", 1))
    assert bench.pushes() == [(1, "t", [1], [])]


def test_nodes_that_share_an_address_are_pushed_once_per_event(bench):
    bench.advertise("t", cpp("p", 1))
    bench.advertise("t", cpp("q", 1))
    bench.subscribe("t", cpp("s", 2))
    assert bench.pushes() == [(1, "t", [2], [])]


@pytest.mark.parametrize(
    "info",
    [
        None,
        ros.NodeInfo(),
        cpp("", 7),
        cpp("n", 0),
        cpp("n", -5),
        cpp("n", 70000),
        ros.NodeInfo(ip="not an address", port=7, node_name="n"),
    ],
)
def test_nodes_that_cannot_be_dialled_are_listed_and_never_pushed_to(bench, info):
    assert bench.advertise("t", info).success
    bench.subscribe("t", cpp("s", 2))
    assert bench.subscribe("u", info).success
    assert bench.of(Push) == []
    assert not bench.of(Watch)
    assert bench.names() == sorted(["s", info.node_name if info else ""])


def test_a_subscriber_without_an_address_is_no_target(bench):
    bench.subscribe("t", ros.NodeInfo())
    bench.advertise("t", cpp("p", 1))
    assert bench.pushes() == [(1, "t", [], [])]


# -- spellings -------------------------------------------------------------------------------------


def test_slashed_and_plain_names_are_one_to_our_nodes(bench):
    bench.advertise("/t", ours("p", 1))
    bench.subscribe("t", cpp("s", 2))
    (push,) = bench.of(Push)
    (target,) = push.update.add_targets
    assert push.update.topic == "/t"
    assert (target.endpoint.topic, target.endpoint.msg_type) == ("t", ODOMETRY)
    assert not target.endpoint.HasField("qos")
    bench.subscribe("/t", ours("/u", 3, SENSOR_DATA))
    (push,) = bench.of(Push)
    (target,) = push.update.add_targets
    assert (target.node_name, target.endpoint.topic) == ("u", "/t")
    assert target.endpoint.qos == qos_to_proto(SENSOR_DATA)
    assert target.instance_id == "/u-1"


def test_a_foreign_publisher_is_told_plainly_of_subscribers_of_ours(bench):
    bench.advertise("t", cpp("p", 1))
    bench.subscribe("/t", ours("s", 2, DEFAULT))
    (push,) = bench.of(Push)
    assert push.update == ros.TopicTargetsUpdate(topic="t", add_targets=[cpp("s", 2)])


def test_foreign_nodes_that_disagree_on_a_spelling_are_not_brought_together(bench):
    bench.advertise("t", cpp("p", 1))
    bench.subscribe("/t", cpp("s", 2))
    assert bench.pushes() == []
    bench.unsubscribe("/t", cpp("s", 2))
    assert bench.pushes() == []
    bench.subscribe("/t", cpp("s", 2))
    assert len(bench.directory.graph.edges) == 1
    bench.advertise("/t", cpp("q", 3))
    assert bench.pushes() == [(3, "/t", [2], [])]


def test_queries_answer_with_canonical_names(bench):
    bench.advertise("/t", cpp("/p", 1))
    directory = bench.directory
    node = queries.get_node_info(directory, ros.GetNodeInfoRequest(node_name="/p"))
    assert node.node_info == cpp("p", 1)
    assert list(node.publishes) == [ros.TopicInfo(topic_name="t", msg_type=ODOMETRY)]
    topic = queries.get_topic_info(directory, ros.GetTopicInfoRequest(topic_name="//t"))
    assert topic.topic_name == "t"
    for text in ("", "/t", "t", "/"):
        topics = queries.get_topics(directory, ros.GetTopicsRequest(filter=text)).topics
        assert [topic.topic_name for topic in topics] == ["t"]
        nodes = queries.get_nodes(directory, ros.GetNodesRequest(filter=text.replace("t", "p")))
        assert [node.node_name for node in nodes.nodes] == ["p"]


# -- queries ---------------------------------------------------------------------------------------


def test_the_words_of_the_four_queries(bench):
    bench.advertise("t", cpp("p", 1))
    bench.subscribe("only_subscribed", cpp("s", 2))
    directory = bench.directory
    nodes = queries.get_nodes(directory, ros.GetNodesRequest(filter="p"))
    assert (nodes.success, nodes.message) == (True, "Get nodes list success")
    assert list(nodes.nodes) == [cpp("p", 1)]
    topics = queries.get_topics(directory, ros.GetTopicsRequest())
    assert (topics.success, topics.message) == (True, "Get topics success")
    assert [topic.topic_name for topic in topics.topics] == ["only_subscribed", "t"]
    found = queries.get_node_info(directory, ros.GetNodeInfoRequest(node_name="s"))
    assert (found.success, found.message) == (True, "Get node info success")
    unknown = queries.get_node_info(directory, ros.GetNodeInfoRequest(node_name="/x"))
    assert (unknown.success, unknown.message) == (False, "Node not found: /x")
    topic = queries.get_topic_info(directory, ros.GetTopicInfoRequest(topic_name="t"))
    assert (topic.success, topic.message) == (True, "Get topic info success")
    assert [node.node_name for node in topic.publishers] == ["p"]
    assert queries.get_topic_info(directory, ros.GetTopicInfoRequest(topic_name="x")) is None


def test_topic_info_shows_every_node_of_the_first_type(bench):
    bench.advertise("t", cpp("b", 1), "a.A")
    bench.subscribe("t", cpp("s", 2), "b.B")
    bench.advertise("t", ours("a", 3, SENSOR_DATA), "a.A")
    topic = queries.get_topic_info(bench.directory, ros.GetTopicInfoRequest(topic_name="t"))
    assert topic.msg_type == "a.A"
    assert [node.node_name for node in topic.publishers] == ["a", "b"]
    assert topic.publishers[0].endpoint.qos == qos_to_proto(SENSOR_DATA)
    assert not topic.subscribers


# -- conflicts -------------------------------------------------------------------------------------


def test_a_strict_node_is_refused_another_type_and_nothing_is_registered(bench):
    bench.advertise("t", cpp("p", 1), "a.A")
    for register in (bench.subscribe, bench.advertise):
        response = register("/t", ours("n", 2), "b.B", strict=True)
        assert not response.success
        assert response.type_conflict.existing_type == "a.A"
        assert list(response.type_conflict.existing_nodes) == ["p"]
        assert bench.effects == []
    assert bench.names() == ["p"]


def test_an_intruder_does_not_lock_out_strict_nodes_of_the_first_type(bench):
    bench.advertise("t", ours("a", 1), "a.A", strict=True)
    bench.advertise("t", cpp("intruder", 2), "b.B")
    assert bench.subscribe("t", ours("c", 3), "a.A", strict=True).success
    assert not bench.subscribe("t", ours("d", 4), "b.B", strict=True).success


def test_a_strict_node_may_repeat_what_it_registered_before(bench):
    bench.advertise("t", cpp("p", 1), "a.A")
    assert bench.subscribe("t", ours("n", 2), "b.B").success
    assert bench.subscribe("t", ours("n", 2), "b.B", strict=True).success


def test_leased_nodes_hear_of_a_type_conflict_once(bench):
    bench.lease(1, ours("a", 1))
    bench.advertise("t", ours("a", 1), "a.A")
    bench.subscribe("t", ours("a", 1), "a.A")
    bench.advertise("t", cpp("intruder", 2), "b.B")
    (notice,) = bench.notices("type_conflict").values()
    assert (notice.topic, notice.msg_type, notice.node_name) == ("t", "b.B", "intruder")
    assert (notice.existing_type, list(notice.existing_nodes)) == ("a.A", ["a"])
    bench.advertise("t", cpp("intruder", 2), "b.B")
    assert bench.notices("type_conflict") == {}
    bench.lease(2, ours("c", 3))
    bench.subscribe("t", ours("c", 3), "c.C")
    assert sorted(bench.notices("type_conflict")) == [1, 2]
    bench.advertise("t", ours("c", 3), "c.C")
    assert bench.notices("type_conflict") == {}


def test_both_ends_hear_of_a_qos_conflict_and_still_meet(bench):
    bench.lease(1, ours("p", 1))
    bench.lease(2, ours("s", 2))
    bench.advertise("t", ours("p", 1, SENSOR_DATA))
    bench.subscribe("t", ours("s", 2, DEFAULT))
    notices = bench.notices("qos_conflict")
    assert sorted(notices) == [1, 2]
    assert (notices[1].publisher, notices[1].subscriber, notices[1].topic) == ("p", "s", "t")
    assert notices[1].offered == qos_to_proto(SENSOR_DATA)
    assert notices[2].requested == qos_to_proto(DEFAULT)
    assert bench.pushes() == [(1, "t", [2], [])]
    bench.subscribe("t", ours("s", 2, DEFAULT))
    assert bench.notices("qos_conflict") == {}
    bench.subscribe("t", ours("s", 2, SENSOR_DATA))
    assert bench.notices("qos_conflict") == {}
    bench.subscribe("t", ours("s", 2, DEFAULT))
    assert sorted(bench.notices("qos_conflict")) == [1, 2]


def test_a_node_in_qos_conflict_with_itself_hears_of_it_once(bench):
    bench.lease(1, ours("n", 1))
    bench.subscribe("t", ours("n", 1, DEFAULT))
    bench.advertise("t", ours("n", 1, SENSOR_DATA))
    assert len(bench.of(Notice)) == 1


def test_foreign_endpoints_fit_with_every_profile(bench):
    bench.lease(1, ours("p", 1))
    bench.advertise("t", ours("p", 1, SENSOR_DATA))
    bench.subscribe("t", cpp("s", 2))
    assert bench.of(Notice) == []


# -- leases and names ------------------------------------------------------------------------------


def test_a_lease_is_granted_and_lists_its_node(bench):
    bench.lease(1, ours("n", 1))
    granted = bench.notices("granted")[1]
    assert (granted.master_id, granted.master_version) == ("id", "1.0")
    assert bench.names() == ["n"]
    bench.advertise("t", ours("n", 1))
    bench.unadvertise("t", ours("n", 1))
    assert bench.names() == ["n"]


def test_a_publisher_of_ours_gets_the_list_in_its_answer_too(bench):
    bench.subscribe("t", cpp("s", 2))
    response = bench.advertise("t", ours("p", 1))
    (push,) = bench.of(Push)
    assert list(response.subscribers) == list(push.update.add_targets)
    assert [target.port for target in response.subscribers] == [2]


@pytest.mark.parametrize("info", [cpp("n", 1), ours("", 1), ours("/", 1), ros.NodeInfo()])
def test_a_lease_needs_a_name_and_an_instance(bench, info):
    bench.lease(1, info)
    assert bench.effects == [EndLease(1, "a lease needs node_name and instance_id")]
    assert bench.names() == []


def test_the_end_of_a_lease_removes_its_node_and_tells_publishers(bench):
    bench.advertise("t", cpp("p", 1))
    bench.lease(1, ours("s", 2))
    bench.subscribe("t", ours("s", 2))
    bench.subscribe("u", ours("s", 2))
    bench.advertise("t", ours("s", 2))
    bench.end_lease(1)
    assert bench.pushes() == [(1, "t", [], [2])]
    assert bench.of(CloseLink) == [CloseLink(Address("127.0.0.1", 2))]
    assert bench.names() == ["p"]
    bench.end_lease(1)
    assert bench.effects == []


def test_a_new_lease_of_the_same_instance_replaces_the_old_stream(bench):
    bench.lease(1, ours("n", 1))
    bench.advertise("t", ours("n", 1))
    bench.lease(2, ours("n", 1))
    assert bench.of(EndLease) == [EndLease(1)]
    assert list(bench.notices("granted")) == [2]
    bench.end_lease(1)
    assert bench.names() == ["n"]
    bench.end_lease(2)
    assert bench.names() == []


def test_a_newer_node_takes_the_name_with_all_that_hangs_on_it(bench):
    bench.advertise("t", cpp("p", 9))
    bench.lease(1, ours("n", 1, instance="old"))
    bench.subscribe("t", ours("n", 1, instance="old"))
    bench.lease(2, ours("/n", 2, instance="new"))
    taken = bench.notices("name_taken")[1]
    assert (taken.taken_by.port, taken.taken_by.instance_id) == (2, "new")
    assert bench.of(EndLease) == [EndLease(1)]
    assert bench.pushes() == [(9, "t", [], [1])]
    node = queries.get_node_info(bench.directory, ros.GetNodeInfoRequest(node_name="n"))
    assert node.node_info.port == 2
    assert not node.subscribes
    bench.end_lease(1)
    assert "n" in bench.names()


def test_a_replaced_instance_is_refused_and_never_takes_back(bench):
    bench.lease(1, ours("n", 1, instance="old"))
    bench.lease(2, ours("n", 2, instance="new"))
    for register in (bench.advertise, bench.subscribe):
        response = register("t", ours("n", 1, instance="old"))
        assert not response.success
        assert "a newer node took the name 'n'" in response.message
        assert bench.effects == []
    bench.lease(3, ours("n", 1, instance="old"))
    assert bench.notices("name_taken")[3].taken_by.instance_id == "new"
    assert bench.of(EndLease) == [EndLease(3)]
    bench.end_lease(2)
    bench.lease(4, ours("n", 1, instance="old"))
    assert list(bench.notices("name_taken")) == [4]


def test_replaced_instances_are_remembered_in_bounds(bench, monkeypatch):
    monkeypatch.setattr(directory_module, "REMEMBERED_INSTANCES", 2)
    for number in range(4):
        bench.advertise("t", ours("n", number + 1, instance=str(number)))
    assert [
        bench.advertise("t", ours("other", 9, instance=str(number))).success for number in range(4)
    ] == [True, False, False, True]


def test_a_foreign_node_is_replaced_by_the_same_name_elsewhere(bench):
    bench.subscribe("t", cpp("n", 1))
    bench.advertise("t", cpp("p", 9))
    bench.advertise("u", cpp("n", 1))
    assert bench.names() == ["n", "p"]
    bench.advertise("u", cpp("n", 2))
    assert bench.pushes()[0] == (9, "t", [], [1])
    node = queries.get_node_info(bench.directory, ros.GetNodeInfoRequest(node_name="n"))
    assert (node.node_info.port, len(node.subscribes), len(node.publishes)) == (2, 0, 1)


def test_a_foreign_node_takes_the_name_of_a_leased_one(bench):
    bench.lease(1, ours("n", 1))
    bench.advertise("t", cpp("n", 2))
    assert bench.notices("name_taken")[1].taken_by == cpp("n", 2)


def test_a_late_goodbye_does_not_remove_the_successor(bench):
    bench.subscribe("t", ours("n", 1, instance="old"))
    bench.subscribe("t", ours("n", 1, instance="new"))
    bench.unsubscribe("t", ours("n", 1, instance="old"))
    assert bench.effects == []
    bench.subscribe("t", cpp("m", 3))
    bench.unsubscribe("t", cpp("m", 4))
    assert bench.names() == ["m", "n"]


def test_nameless_nodes_share_one_entry(bench):
    bench.advertise("t", ros.NodeInfo())
    bench.subscribe("u", ros.NodeInfo(port=12345))
    bench.subscribe("v", ours("", 7))
    assert bench.names() == [""]


def test_a_roaming_node_keeps_its_registrations(bench):
    bench.lease(1, ours("n", 1))
    bench.advertise("t", ours("p", 9))
    bench.subscribe("t", ours("n", 1))
    bench.advertise("u", ours("n", 1))
    bench.lease(2, ours("n", 2))
    assert bench.pushes() == [(9, "t", [], [1]), (2, "u", [], []), (9, "t", [2], [])]
    assert CloseLink(Address("127.0.0.1", 1)) in bench.effects
    assert bench.directory.graph.node("n").port == 2


def test_further_addresses_follow_the_last_word(bench):
    first, second = ours("s", 1), ours("s", 1)
    first.addresses.append("10.0.0.1:1")
    second.addresses.append("10.0.0.2:1")
    bench.lease(1, first)
    bench.subscribe("t", ours("s", 1))
    bench.subscribe("t", second)
    bench.advertise("t", ours("p", 2))
    (push,) = bench.of(Push)
    assert list(push.update.add_targets[0].addresses) == ["10.0.0.2:1"]


# -- liveness --------------------------------------------------------------------------------------


def test_nodes_without_a_lease_are_watched_until_they_hold_one(bench):
    address = Address("127.0.0.1", 1)
    bench.advertise("t", ours("n", 1))
    assert bench.of(Watch) == [Watch(address, True)]
    bench.lease(1, ours("n", 1))
    assert bench.of(Watch) == [Watch(address, False)]
    bench.advertise("u", ours("n", 1))
    assert bench.of(Watch) == []
    assert bench.directory.address_dead(address) == []
    assert bench.names() == ["n"]


def test_a_dead_address_takes_its_nodes_with_it(bench):
    bench.advertise("t", cpp("p", 9))
    bench.subscribe("t", cpp("s", 1))
    bench.lease(1, ours("leased", 1))
    bench.effects = bench.directory.address_dead(Address("127.0.0.1", 1))
    assert bench.pushes() == [(9, "t", [], [1])]
    assert bench.of(Watch) == [Watch(Address("127.0.0.1", 1), False)]
    assert bench.names() == ["leased", "p"]
    assert bench.directory.address_dead(Address("10.0.0.1", 5)) == []


def test_a_resync_says_everything_as_a_snapshot(bench):
    bench.advertise("/t", ours("p", 1))
    bench.advertise("u", ours("p", 1))
    bench.subscribe("t", cpp("s", 2))
    updates = bench.directory.resync(Address("127.0.0.1", 1))
    assert [(update.topic, update.snapshot) for update in updates] == [("/t", True), ("u", True)]
    assert [[t.port for t in update.add_targets] for update in updates] == [[2], []]
    assert bench.directory.resync(Address("127.0.0.1", 2)) == []


# -- cost ------------------------------------------------------------------------------------------


def calls_made_by(action) -> int:
    """How many function calls something takes: a cost that no busy machine changes."""
    count = 0

    def note(_frame, event, _argument) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        action()
    finally:
        sys.setprofile(before)
    return count


def cost_of_a_life_among(topics: int, nodes: int) -> int:
    bench = Bench()
    for number in range(topics):
        bench.advertise(f"t{number}", cpp(f"n{number % nodes}", 1 + number % nodes))
        bench.subscribe(f"t{number}", cpp(f"n{(number + 1) % nodes}", 1 + (number + 1) % nodes))

    def life() -> None:
        bench.lease(1, ours("me", 9999))
        bench.advertise("t0", ours("me", 9999))
        bench.subscribe("t1", ours("me", 9999))
        bench.unsubscribe("t1", ours("me", 9999))
        bench.end_lease(1)

    return calls_made_by(life)


def test_what_a_node_does_costs_the_same_in_a_large_graph():
    assert cost_of_a_life_among(10, 5) == cost_of_a_life_among(2000, 200)


# -- any history -----------------------------------------------------------------------------------

# Everybody has an address of their own and one way to spell; types differ by name.
CAST = {
    "a1": ours("a", 1, DEFAULT, "a1"),
    "a2": ours("/a", 2, SENSOR_DATA, "a2"),
    "a1 moved": ours("a", 3, DEFAULT, "a1"),
    "b": cpp("b", 4),
    "b elsewhere": cpp("/b", 5),
    "c": ours("c", 6, None, "c1"),
    "d": cpp("d", 7),
    "nameless": ros.NodeInfo(),
}
SLASHED = {"a2", "b elsewhere", "c"}
TYPES = {"c": "c.C"}
WHO = st.sampled_from(sorted(CAST))
REGISTRATION = st.tuples(
    st.sampled_from(["register_publisher", "subscribe"]),
    WHO,
    st.sampled_from(["t", "t", "u"]),
    st.booleans(),
)
STEPS = st.one_of(
    REGISTRATION,
    REGISTRATION.map(lambda step: (*step[:3], False)),
    st.tuples(
        st.sampled_from(["unregister_publisher", "unsubscribe"]), WHO, st.just("t"), st.just(False)
    ),
    st.tuples(st.just("lease"), WHO),
    st.tuples(st.just("end_lease"), st.integers(1, 12))
    | st.tuples(st.just("address_dead"), st.integers(1, 7)),
)


class Listeners:
    """What publishers know who only hear the pushes, and watchers who only hear the changes."""

    def __init__(self) -> None:
        self.targets: dict[tuple[Address, str], set[int]] = defaultdict(set)
        self.nodes: dict[str, Address] = {}
        self.ends: set[tuple[ChangeKind, str, TopicKey]] = set()
        self.leases: set[int] = set()

    def hear(self, effects: list) -> None:
        for effect in effects:
            match effect:
                case Push(address, update):
                    known = self.targets[address, update.topic]
                    known -= {target.port for target in update.remove_targets}
                    known |= {target.port for target in update.add_targets}
                case GraphChange():
                    self.change(effect)
                case Notice(lease, _):
                    assert lease in self.leases
                case EndLease(lease):
                    self.leases.remove(lease)

    def change(self, change: GraphChange) -> None:
        match change.kind:
            case ChangeKind.NODE_ADDED:
                self.nodes[change.node] = Address(change.ip, change.port)
            case ChangeKind.NODE_REMOVED:
                del self.nodes[change.node]
            case ChangeKind.PUBLISHER_ADDED | ChangeKind.SUBSCRIBER_ADDED:
                self.ends.add((change.kind, change.node, change.key))
            case ChangeKind.PUBLISHER_REMOVED:
                self.ends.remove((ChangeKind.PUBLISHER_ADDED, change.node, change.key))
            case ChangeKind.SUBSCRIBER_REMOVED:
                self.ends.remove((ChangeKind.SUBSCRIBER_ADDED, change.node, change.key))


def play(bench: Bench, listeners: Listeners, number: int, step: tuple) -> None:
    match step:
        case ("lease", who):
            listeners.leases.add(number)
            bench.lease(number, CAST[who])
        case ("end_lease", lease):
            bench.end_lease(lease)
            listeners.leases.discard(lease)
        case ("address_dead", port):
            bench.effects = bench.directory.address_dead(Address("127.0.0.1", port))
        case (kind, who, topic, strict):
            spelled = f"/{topic}" if who in SLASHED else topic
            extra = {"strict": strict} if kind in ("register_publisher", "subscribe") else {}
            bench._call(kind, spelled, CAST[who], TYPES.get(who, ODOMETRY), **extra)
    listeners.hear(bench.effects)


def check(bench: Bench, listeners: Listeners) -> None:
    directory = bench.directory
    snapshot = directory.graph.snapshot()
    assert set(directory.peers) == {node.name for node in snapshot.nodes} == set(listeners.nodes)
    assert snapshot.edges == edges_between(snapshot.nodes)
    leases = set()
    listening = set()
    for node in snapshot.nodes:
        peer = directory.peers[node.name]
        assert Address(node.ip, node.port) == peer.address == listeners.nodes[node.name]
        assert peer.lease is not None or node.publishes or node.subscribes
        leases |= {peer.lease} - {None}
        published, subscribed = peer.endpoints
        assert (node.publishes, node.subscribes) == (
            tuple(sorted(published)),
            tuple(sorted(subscribed)),
        )
        for key, endpoint in published.items() if peer.pushable else ():
            told = listeners.targets[peer.address, endpoint.topic]
            update = full_update(directory.graph, directory.peers, peer, key)
            assert told == {target.port for target in update.add_targets}
            listening.add((peer.address, endpoint.topic))
    assert leases == listeners.leases
    known = {(kind, name, key) for kind, name, key in listeners.ends}
    assert len(known) == sum(len(node.publishes) + len(node.subscribes) for node in snapshot.nodes)
    for place in set(listeners.targets) - listening:
        del listeners.targets[place]


@settings(max_examples=200)
@given(st.lists(STEPS, min_size=12, max_size=40))
def test_any_history_keeps_everybody_in_the_picture(steps):
    bench, listeners = Bench(), Listeners()
    for number, step in enumerate(steps, start=1):
        play(bench, listeners, number, step)
        check(bench, listeners)


TEXTS = st.text(max_size=8)
INFOS = st.none() | st.builds(
    ros.NodeInfo,
    ip=TEXTS | st.just("127.0.0.1"),
    port=st.integers(-(2**31), 2**31 - 1),
    node_name=TEXTS,
    instance_id=TEXTS,
    addresses=st.lists(TEXTS, max_size=2),
    endpoint=st.none()
    | st.builds(
        ros.Endpoint,
        qos=st.builds(
            ros.QosPolicies,
            reliability=st.integers(0, 9),
            depth=st.integers(0, 2**32 - 1),
            deadline_ns=st.integers(-(2**63), 2**63 - 1),
        ),
    ),
)


@given(
    st.lists(st.tuples(st.sampled_from(sorted(REGISTRATIONS)), TEXTS, TEXTS, INFOS), max_size=12)
)
def test_no_input_makes_it_raise(calls):
    bench = Bench()
    for number, (kind, topic, msg_type, info) in enumerate(calls):
        bench._call(kind, topic, info, msg_type)
        bench.lease(number, info or ros.NodeInfo())
        for push in bench.of(Push):
            assert frame_of(push.update)
        queries.get_node_info(bench.directory, ros.GetNodeInfoRequest(node_name=topic))
        queries.get_topic_info(bench.directory, ros.GetTopicInfoRequest(topic_name=topic))
    assert set(bench.directory.peers) == {n.name for n in bench.directory.graph.nodes()}


def test_roles_index_the_tables_of_a_peer(bench):
    bench.advertise("t", cpp("n", 1))
    assert bench.directory.peers["n"].endpoints[Role.PUBLISHER]
    assert not bench.directory.peers["n"].endpoints[Role.SUBSCRIBER]
