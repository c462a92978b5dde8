"""Which topics are recorded, when files begin, what is repeated and kept."""

from __future__ import annotations

import pytest

from simple_ros.bag.channel_qos import metadata_of, profile_in
from simple_ros.bag.plan import Cadence, LatchedHistory, SplitRule, TopicSelection
from simple_ros.bag.recent import RecentMessages
from simple_ros.bag.series import RecordedTopic
from simple_ros.bag.topics import PublishedTopics
from simple_ros.cli.bag.arguments import counted, pairs_of, remaps_of, size_of
from simple_ros.cli.bag.keyboard import LEFT, SPACE, UP, keys_in
from simple_ros.errors import ConfigError, InvalidName
from simple_ros.graph import ChangeKind, GraphChange, GraphNode, GraphSnapshot, TopicKey
from simple_ros.qos import LATCHED, Liveliness, QosProfile, Reliability


class TestSelection:
    @pytest.mark.parametrize(
        ("selection", "wanted"),
        [
            (TopicSelection.made(["/odom"]), {"odom"}),
            (TopicSelection.made(every=True), {"odom", "imu/raw", "imu/cooked", "clock"}),
            (TopicSelection.made(pattern="^/imu/"), {"imu/raw", "imu/cooked"}),
            (TopicSelection.made(pattern="^imu/.*w$"), {"imu/raw"}),
            (TopicSelection.made(every=True, exclude="imu"), {"odom", "clock"}),
            (TopicSelection.made(["imu/raw"], every=True, exclude="imu|o"), {"imu/raw"}),
            (TopicSelection.made(["odom"], pattern="clo"), {"odom", "clock"}),
            (TopicSelection.made(), set()),
        ],
    )
    def test_wants(self, selection: TopicSelection, wanted: set[str]) -> None:
        topics = ["/odom", "imu/raw", "imu/cooked", "clock"]
        assert {topic.lstrip("/") for topic in topics if selection.wants(topic)} == wanted
        assert selection.is_empty is (not wanted)

    def test_what_a_user_gets_wrong_is_told(self) -> None:
        with pytest.raises(ConfigError, match=r"the pattern '\*' is no regular expression"):
            TopicSelection.made(pattern="*")
        with pytest.raises(InvalidName):
            TopicSelection.made(["a b"])


class TestSplit:
    def test_by_size_and_by_time(self) -> None:
        assert not SplitRule().is_on
        assert not SplitRule().is_due(10**12, 0, 10**18)
        by_size = SplitRule(max_bytes=100)
        assert [by_size.is_due(size, 0, 0) for size in (99, 100)] == [False, True]
        by_time = SplitRule(max_duration_s=1.5)
        assert [by_time.is_due(0, 10, 10 + ns) for ns in (1_499_999_999, 1_500_000_000)] == [
            False,
            True,
        ]


def test_cadence_keeps_its_phase_and_makes_nothing_up() -> None:
    cadence = Cadence(1.0, now=10.0)
    assert [cadence.is_due(now) for now in (10.9, 11.0, 11.5, 12.0)] == [False, True, False, True]
    assert cadence.is_due(20.0)
    assert [cadence.is_due(now) for now in (20.0, 20.5)] == [True, False]


class TestLatchedHistory:
    def test_keeps_the_last_that_differ(self) -> None:
        history = LatchedHistory(max_messages=2)
        for stamp, payload in enumerate([b"a", b"b", b"a", b"c"]):
            history.add(payload, stamp)
        assert history.messages() == ((b"a", 2), (b"c", 3))

    def test_keeps_one_whatever_its_size(self) -> None:
        history = LatchedHistory(max_bytes=10)
        history.add(b"a" * 6, 1)
        history.add(b"b" * 4, 2)
        assert len(history.messages()) == 2
        history.add(b"c" * 11, 3)
        assert history.messages() == ((b"c" * 11, 3),)


def topic(name: str, *, latched: bool = False) -> RecordedTopic:
    return RecordedTopic(name, "x.Y", b"", history=LatchedHistory() if latched else None)


class TestRecent:
    def test_the_newest_and_what_is_latched(self) -> None:
        recent = RecentMessages(max_bytes=4)
        chat, chart = topic("chat"), topic("map", latched=True)
        recent.add(chart, 1, [b"old", b"map"])
        for stamp in range(2, 9):
            recent.add(chat, stamp, [b"xx"])
        assert recent.taken() == [(chart, 1, [b"map"]), (chat, 7, [b"xx"]), (chat, 8, [b"xx"])]
        recent.add(chat, 9, [b"y"])
        assert recent.taken() == [(chart, 1, [b"map"]), (chat, 9, [b"y"])]


class TestPublishedTopics:
    def test_counts_publishers(self) -> None:
        key, other = TopicKey("a", "x.Y"), TopicKey("b", "x.Y")
        topics = PublishedTopics()
        assert topics.take(GraphSnapshot((GraphNode("n", publishes=(key,), subscribes=(other,)),)))
        assert topics.keys == {key}
        added = GraphChange(ChangeKind.PUBLISHER_ADDED, "m", key=key)
        removed = GraphChange(ChangeKind.PUBLISHER_REMOVED, "m", key=key)
        assert [topics.take(item) for item in (added, removed)] == [False, False]
        assert not topics.take(GraphChange(ChangeKind.SUBSCRIBER_ADDED, "m", key=other))
        assert topics.take(removed)
        assert topics.keys == frozenset()
        assert not topics.take(GraphChange(ChangeKind.NODE_REMOVED, "n"))


class TestChannelQos:
    @pytest.mark.parametrize(
        "profile",
        [
            QosProfile(),
            LATCHED,
            QosProfile(depth=7, reliability=Reliability.BEST_EFFORT, deadline_s=0.1),
            QosProfile(
                liveliness=Liveliness.MANUAL_BY_TOPIC, liveliness_lease_s=2.0, lifespan_s=0.5
            ),
        ],
    )
    def test_there_and_back(self, profile: QosProfile) -> None:
        assert profile_in(metadata_of(profile)) == profile

    @pytest.mark.parametrize(
        "qos", ["", "[]", "{", '{"depth": 0}', '{"reliability": "so so"}', '{"depth": "many"}']
    )
    def test_nonsense_is_the_default(self, qos: str) -> None:
        assert profile_in({"qos": qos}) == QosProfile()
        assert profile_in({"qos": qos, "latched": "true"}) == LATCHED


class TestArguments:
    @pytest.mark.parametrize(
        ("text", "size"),
        [("1", 1), ("4MiB", 4 << 20), ("1.5 kB", 1500), ("2g", 2 * 10**9), ("3KiB", 3072)],
    )
    def test_sizes(self, text: str, size: int) -> None:
        assert size_of(text) == size

    @pytest.mark.parametrize("text", ["", "0", "-1", "many", "1TB", "1e9"])
    def test_no_sizes(self, text: str) -> None:
        with pytest.raises(ConfigError, match="is no size; write"):
            size_of(text)

    def test_pairs(self) -> None:
        assert pairs_of(["a=1", "b=c=d"], "-o") == {"a": "1", "b": "c=d"}
        assert remaps_of(["/a:=b", "c:=/d"]) == {"/a": "b", "c": "/d"}
        with pytest.raises(ConfigError, match="'a=b' is not as in --remap OLD:=NEW"):
            remaps_of(["a=b"])

    def test_counted(self) -> None:
        assert [counted(0), counted(1), counted(2, "chunk")] == [
            "0 messages",
            "1 message",
            "2 chunks",
        ]

    def test_keys(self) -> None:
        assert keys_in(f"a{UP}{SPACE}{LEFT}") == ["a", UP, SPACE, LEFT]
        assert keys_in("\x1b") == ["\x1b"]
