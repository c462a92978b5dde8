from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from simple_ros.msg.example import SensorData
from simple_ros.qos import DEFAULT, LATCHED, QosProfile
from simple_ros.router import Router
from simple_ros.wire.framing import Run, encode_header

HEADER = encode_header("/sensor", "example.SensorData")


class FakeLink:
    def expect_life_within(self, seconds: float) -> None:
        raise AssertionError("nobody asked for a lease")


class FakeSink:
    wants_bytes = False
    takes_batches = False
    takes_payloads = False
    is_direct = True
    waits = False
    has_received = False
    qos: QosProfile = DEFAULT

    def __init__(self, **attributes: Any) -> None:
        self.got: list[Any] = []
        self.free = 10**9
        self.resume: Callable[[], None] | None = None
        self.source_changes = 0
        for name, value in attributes.items():
            setattr(self, name, value)

    def take(self, message: Any, size: int) -> None:
        self.got.append(message if self.wants_bytes else message.sensor_id)
        self.free -= 1

    def lone_taker(self, parse: Callable[[Any], Any], unparsable: Any) -> Callable[[bytes], None]:
        return lambda payload: self.take(parse(payload), len(payload))

    def take_payloads(
        self, payloads: list[Any], parse: Callable[[Any], Any], unparsable: Any
    ) -> None:
        for payload in payloads:
            self.take(parse(payload), len(payload))

    def take_batch(self, messages: list[Any]) -> None:
        self.got.append([m if self.wants_bytes else m.sensor_id for m in messages])

    def room(self, sizes: Sequence[int]) -> int:
        return min(self.free, len(sizes))

    def call_when_room(self, resume: Callable[[], None]) -> None:
        self.resume = resume

    def sources_changed(self) -> None:
        self.source_changes += 1


def make(*sinks: FakeSink) -> tuple[Router, list[bytes], list[object]]:
    pushes: list[bytes] = []
    ended: list[object] = []
    router = Router(
        {"TopicTargetsUpdate": lambda link, payload: pushes.append(payload)}, ended.append
    )
    for sink in sinks:
        router.add("sensor", "example.SensorData", SensorData.FromString, sink)
    return router, pushes, ended


def run(*ids: int, header: bytes = HEADER) -> Run:
    payloads = [memoryview(SensorData(sensor_id=i).SerializeToString()) for i in ids]
    return Run(header, payloads)


def no_resume() -> None:
    raise AssertionError("never called")


LINK = FakeLink()


def test_any_spelling_finds_the_topic_and_each_sink_its_form() -> None:
    objects, raw = FakeSink(), FakeSink(wants_bytes=True)
    router, _, _ = make(objects, raw)
    assert router.receive(LINK, run(1, 2), no_resume, force=False) == 2
    other = run(3, header=encode_header("sensor", "example.SensorData"))
    assert router.receive(LINK, other, no_resume, force=False) == 1
    assert objects.got == [1, 2, 3]
    assert [SensorData.FromString(data).sensor_id for data in raw.got] == [1, 2, 3]


def test_a_batch_sink_gets_all_that_one_read_brought_less_what_is_bad() -> None:
    sink = FakeSink(takes_batches=True)
    router, _, _ = make(sink)
    router.receive(LINK, run(1, 2, 3), no_resume, force=False)
    router.receive(
        LINK, Run(HEADER, [memoryview(b"\xff"), memoryview(b"\x08\x05")]), no_resume, force=False
    )
    assert sink.got == [[1, 2, 3], [5]]
    assert router.bad.counts == {"unparsable": 1}
    other = FakeSink(wants_bytes=True)
    router.add("sensor", "example.SensorData", SensorData.FromString, other)
    router.receive(LINK, run(6), no_resume, force=False)
    assert (sink.got[-1], other.got) == ([6], [b"\x08\x06"])


def test_a_lone_message_goes_straight_to_the_one_subscription() -> None:
    sink = FakeSink(takes_payloads=True)
    router, _, _ = make(sink)
    lane = router.lane_of(LINK, HEADER)
    assert lane.take_lone is None, "nothing has come on the link yet"
    router.receive(LINK, run(1), no_resume, force=False)
    lane = router.lane_of(LINK, HEADER)
    assert lane.take_lone is not None
    lane.take_lone(b"\x08\x02")
    assert sink.got == [1, 2]
    # One more subscription, then the first leaves, then all have left: the lane that is known says so.
    other = FakeSink(takes_payloads=True)
    router.add("sensor", "example.SensorData", SensorData.FromString, other)
    assert lane.take_lone is None
    router.remove("sensor", "example.SensorData", sink)
    assert lane.take_lone is not None
    lane.take_lone(b"\x08\x03")
    assert (sink.got, other.got) == ([1, 2], [3])
    router.remove("sensor", "example.SensorData", other)
    assert lane.take_lone is None
    assert router.lane_of(LINK, HEADER).take_lone is None


def test_a_lone_message_for_a_batch_sink_is_a_batch_of_one() -> None:
    sink = FakeSink(takes_batches=True, takes_payloads=True)
    router, _, _ = make(sink)
    router.receive(LINK, run(1), no_resume, force=False)
    take = router.lane_of(LINK, HEADER).take_lone
    assert take is not None
    take(b"\x08\x02")
    take(b"\xff")
    assert sink.got == [[1], [2]]
    assert router.bad.counts == {"unparsable": 1}


@pytest.mark.parametrize(
    "attributes",
    [
        {"takes_payloads": False},
        {"takes_payloads": True, "is_direct": False},
        {"takes_batches": True, "is_direct": False},
        {"takes_payloads": True, "qos": LATCHED},
    ],
)
def test_who_needs_more_than_the_message_gets_it_the_usual_way(attributes: dict[str, Any]) -> None:
    router, _, _ = make(FakeSink(**attributes))
    router.receive(LINK, run(1), no_resume, force=False)
    assert router.lane_of(LINK, HEADER).take_lone is None


def test_a_full_queue_takes_part_then_waits_one_turn_then_drops() -> None:
    slow = FakeSink(is_direct=False, free=2, qos=DEFAULT.replace(depth=3))
    router, _, _ = make(slow)
    burst = run(*range(8))
    assert router.receive(LINK, burst, no_resume, force=False) == 2
    rest = burst._replace(payloads=burst.payloads[2:])
    assert router.receive(LINK, rest, no_resume, force=False) == 0
    assert router.receive(LINK, rest, no_resume, force=True) == 3
    assert slow.got == [0, 1, 2, 3, 4]


def test_a_blocking_sink_holds_the_link_until_it_has_room() -> None:
    blocking = FakeSink(is_direct=False, free=0, waits=True)
    router, _, _ = make(blocking)
    assert router.receive(LINK, run(1), no_resume, force=True) == -1
    assert blocking.resume is no_resume
    assert blocking.got == []


def test_what_cannot_be_delivered_is_counted_and_taken() -> None:
    sink = FakeSink()
    router, pushes, _ = make(sink)
    bad = [
        Run(HEADER, [memoryview(b"\xff"), memoryview(b"\x08\x05")]),
        Run(HEADER, [], oversized=99),
        run(1, 2, header=encode_header("elsewhere", "example.SensorData")),
        run(1, header=encode_header("sensor", "example.Heartbeat")),
        Run(b"\0\1\xff\0\1\xff", [memoryview(b"")]),
        Run(encode_header("x", "TopicTargetsUpdate"), [memoryview(b"push")]),
    ]
    for item in bad:
        assert router.receive(LINK, item, no_resume, force=False) == len(item.payloads)
    assert sink.got == [5]
    assert pushes == [b"push"]
    assert router.bad.counts == {
        "unparsable": 1,
        "oversized": 1,
        "unknown_topic": 2,
        "type_mismatch": 1,
        "bad_name": 1,
    }


def test_a_removed_sink_gets_nothing_and_a_new_one_everything() -> None:
    first, second = FakeSink(), FakeSink()
    router, _, _ = make(first)
    router.receive(LINK, run(1), no_resume, force=False)
    assert router.remove("sensor", "example.SensorData", first)
    router.receive(LINK, run(2), no_resume, force=False)
    router.add("sensor", "example.SensorData", SensorData.FromString, second)
    router.receive(LINK, run(3), no_resume, force=False)
    assert (first.got, second.got) == ([1], [3])
    assert router.bad.counts == {"unknown_topic": 1}


def test_sources_come_with_their_first_message_and_go_with_their_link() -> None:
    sink = FakeSink()
    router, _, ended = make(sink)
    route = router.add("other", "example.SensorData", SensorData.FromString, sink)
    router.receive(LINK, run(1), no_resume, force=False)
    router.receive(LINK, run(2), no_resume, force=False)
    assert sink.source_changes == 1
    assert not route.sources
    router.link_ended(LINK)
    assert sink.source_changes == 2
    assert ended == [LINK]


def test_memory_is_bounded_under_ever_new_names() -> None:
    router, _, _ = make(FakeSink())
    for i in range(5000):
        header = encode_header(f"noise{i}", "x.Y")
        router.receive(LINK, run(1, header=header), no_resume, force=False)
    assert router.bad.counts["unknown_topic"] == 5000
    assert len(router._by_link.get(LINK, {})) == 0
    assert len(router.bad._logged) <= 1000


def test_a_waiting_sink_gets_what_fits_beside_a_sibling_that_drops() -> None:
    waiting = FakeSink(is_direct=False, free=5, waits=True)
    full = FakeSink(is_direct=False, free=0, qos=DEFAULT.replace(depth=10))
    router, _, _ = make(waiting, full)
    burst = run(*range(20))
    assert router.receive(LINK, burst, no_resume, force=False) == 0
    assert router.receive(LINK, burst, no_resume, force=True) == 5
    assert waiting.got == full.got == [0, 1, 2, 3, 4]
    rest = burst._replace(payloads=burst.payloads[5:])
    assert router.receive(LINK, rest, no_resume, force=True) == -1


def test_a_route_ends_with_its_last_sink_and_forgets_its_links() -> None:
    sink = FakeSink()
    router, _, _ = make(sink)
    router.receive(LINK, run(1), no_resume, force=False)
    assert router.remove("sensor", "example.SensorData", sink)
    assert router.remove("sensor", "example.SensorData", sink)
    assert router._routes == {}
    assert router._by_link == {LINK: {}}


def test_the_shortest_lease_counts_for_a_link() -> None:
    expected: list[float] = []

    class LeasedLink:
        def expect_life_within(self, seconds: float) -> None:
            expected.append(seconds)

    router, _, _ = make(
        FakeSink(qos=DEFAULT.replace(liveliness_lease_s=60.0)),
        FakeSink(qos=DEFAULT.replace(liveliness_lease_s=3.0)),
        FakeSink(),
    )
    router.receive(LeasedLink(), run(1), no_resume, force=False)
    assert expected == [3.0]
