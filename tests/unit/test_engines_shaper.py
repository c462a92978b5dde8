"""The pure link shaper: queues, shares, chance, channels."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.record import Quality
from simple_ros_engines.simulator.shaper import LinkShaper, ShapedConnection
from simple_ros_engines.simulator.shaper_channel import DeadZone, make_channel
from simple_ros_engines.simulator.shaper_policy import policy_shares
from simple_ros_engines.simulator.shaper_radio import divided
from simple_ros_engines.simulator.shaper_reading import read_settings
from simple_ros_engines.simulator.shaper_settings import class_of
from simple_ros_engines.simulator.shaper_trace import read_trace

CLASSES = [
    {"name": "command", "topics": ["/cmd_vel"], "priority": 5, "deadline_ms": 100},
    {"name": "sensor", "topics": ["/camera/*"], "priority": 1, "queue_bytes": 250_000},
]


def shaper(up: dict[str, Any] | None = None, now_s: float = 100.0, **more: Any) -> LinkShaper:
    data = {"links": {"robot": {"up": up or {}}}, "classes": CLASSES, "seed": 3} | more
    return LinkShaper(read_settings(data), now_s)


def run(
    machine: LinkShaper, sent: list[tuple[float, ShapedConnection, Any, int]], until_s: float
) -> list[tuple[float, Any]]:
    """Offer at given times, advancing exactly when the machine asks; what arrived when."""
    got: list[tuple[float, Any]] = []
    for at_s, connection, item, size in [*sent, (until_s, None, None, 0)]:
        while (event_s := machine.next_event_s()) < at_s:
            got += [(event_s, item) for _, item in machine.advance(event_s)]
        got += [(at_s, item) for _, item in machine.advance(at_s)]
        if connection is not None:
            assert machine.offer(connection, item, size, at_s)
    return got


def test_a_message_takes_its_size_over_the_rate_plus_the_delay() -> None:
    machine = shaper({"rate_mbps": 8, "delay_ms": 20})
    camera = machine.open("robot", "edge", "/camera/image")
    got = run(machine, [(100.0, camera, "a", 100_000), (100.0, camera, "b", 100_000)], 101.0)
    assert [item for _, item in got] == ["a", "b"]
    assert [at_s for at_s, _ in got] == pytest.approx([100.12, 100.22], abs=1e-6)


def test_an_urgent_class_interrupts_a_large_message() -> None:
    machine = shaper({"rate_mbps": 8})
    camera = machine.open("robot", "edge", "/camera/image")
    command = machine.open("robot", "edge", "/cmd_vel")
    sent = [(100.0, camera, "image", 200_000), (100.1, command, "stop", 1000)]
    got = run(machine, sent, 101.0)
    assert [item for _, item in got] == ["stop", "image"]
    assert [at_s for at_s, _ in got] == pytest.approx([100.101, 100.201], abs=1e-6)


def test_what_does_not_fit_is_dropped_whole_and_counted() -> None:
    machine = shaper({"rate_mbps": 0.8})
    camera = machine.open("robot", "edge", "/camera/image")
    got = run(machine, [(100.0, camera, n, 100_000) for n in range(4)], 110.0)
    assert [item for _, item in got] == [0, 1]
    counts = machine.radios["up"].queues["robot"].counts[1]
    assert (counts.offered, counts.delivered, counts.dropped) == (4, 2, 2)
    assert counts.latency_s(0.99) == pytest.approx(2.0, abs=1e-6)


def test_a_held_class_is_held_back_instead() -> None:
    machine = shaper(
        {"rate_mbps": 8}, classes=[{"name": "all", "overflow": "hold", "queue_bytes": 10_000}]
    )
    flow = machine.open("robot", "edge", "/anything")
    machine.advance(100.0)
    assert machine.offer(flow, 1, 9_000, 100.0)
    assert not machine.offer(flow, 2, 9_000, 100.0)
    assert [item for _, item in machine.advance(100.009)] == [1]
    assert machine.offer(flow, 2, 9_000, 100.009)
    counts = machine.radios["up"].queues["robot"].counts[0]
    assert (counts.offered, counts.dropped) == (2, 0)


def test_late_is_counted_and_given_up_only_if_asked() -> None:
    for discard, missed in ((False, (1, 0)), (True, (0, 1))):
        classes = [{"name": "x", "deadline_ms": 150, "discard_late": discard}]
        machine = shaper({"rate_mbps": 8}, classes=classes)
        flow = machine.open("robot", "edge", "/x")
        run(machine, [(100.0, flow, n, 200_000) for n in range(2)], 102.0)
        counts = machine.radios["up"].queues["robot"].counts[0]
        # The first is on its way for 0.2 s: late whatever is done about the second.
        assert (counts.late - 1, counts.expired) == missed
        assert counts.missed == 2


def test_wired_sites_and_a_site_with_itself_cost_nothing() -> None:
    machine = shaper({"rate_mbps": 1})
    assert machine.open("edge", "cloud", "/x").hops == []
    assert machine.open("robot", "robot", "/x").hops == []
    assert [hop[:2] for hop in machine.open("robot", "edge", "/x").hops] == [("up", "robot")]
    assert [hop[:2] for hop in machine.open("edge", "robot", "/x").hops] == [("down", "robot")]


def test_from_robot_to_robot_both_links_are_crossed() -> None:
    links = {"a": {"up": {"rate_mbps": 8}}, "b": {"down": {"rate_mbps": 4, "delay_ms": 5}}}
    machine = LinkShaper(read_settings({"links": links}), 100.0)
    flow = machine.open("a", "b", "/x")
    got = run(machine, [(100.0, flow, "hi", 10_000)], 101.0)
    assert got == [(pytest.approx(100.035, abs=1e-6), "hi")]


def test_a_message_for_a_quiet_downlink_does_not_travel_into_the_past() -> None:
    links = {"a": {"up": {"rate_mbps": 8}}, "b": {"down": {"rate_mbps": 8}}}
    machine = LinkShaper(read_settings({"links": links}), 0.0)
    flow = machine.open("a", "b", "/x")
    assert machine.advance(50.0) == []
    machine.offer(flow, "hi", 100_000, 50.0)
    assert machine.advance(50.15) == []
    assert [item for _, item in machine.advance(50.3)] == ["hi"]


def test_links_share_the_blocks_and_who_is_alone_gets_up_to_its_most() -> None:
    links = {
        "a": {"up": {"rate_mbps": 10, "max_share": 0.3}},
        "b": {"up": {"rate_mbps": 10}},
    }
    machine = LinkShaper(read_settings({"links": links}), 0.0)
    a, b = machine.open("a", "edge", "/x"), machine.open("b", "edge", "/x")
    got = {item: at for at, item in run(machine, [(1, a, "a", 375_000)], 3)}
    assert got["a"] == pytest.approx(2.0, abs=1e-6)
    sent = [(10, a, "a", 375_000), (10, b, "b", 875_000)]
    assert [(item, pytest.approx(at, abs=1e-5)) for at, item in run(machine, sent, 13)] in (
        [("a", 11.0), ("b", 11.0)],
        [("b", 11.0), ("a", 11.0)],
    )


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), max_size=6))
def test_shares_keep_their_limits_and_waste_nothing(pairs: list[tuple[float, float]]) -> None:
    wants = [(min(pair), max(pair)) for pair in pairs]
    shares = divided(wants)
    assert sum(shares) <= 1 + 1e-9
    assert all(share <= high + 1e-9 for share, (_, high) in zip(shares, wants, strict=True))
    if sum(low for low, _ in wants) <= 1:
        assert all(share >= low - 1e-9 for share, (low, _) in zip(shares, wants, strict=True))
    assert sum(shares) >= min(1, sum(high for _, high in wants)) - 1e-6 or (
        sum(low for low, _ in wants) > 1
    )


def test_decisions_follow_from_the_seed_not_from_how_often_time_is_told() -> None:
    outcomes = []
    for extra in (0, 1, 500):
        machine = shaper({"rate_mbps": 8, "delay_ms": 5, "jitter_ms": 3, "loss": 0.3})
        camera = machine.open("robot", "edge", "/camera/image")
        command = machine.open("robot", "edge", "/cmd_vel")
        generator = random.Random(extra)
        looks = sorted(100 + generator.random() * 2 for _ in range(extra))
        got: list[Any] = []
        for number in range(40):
            at_s = 100 + number * 0.05
            while looks and looks[0] < at_s:
                got += [item for _, item in machine.advance(looks.pop(0))]
            got += [item for _, item in machine.advance(at_s)]
            machine.offer(camera, ("image", number), 20_000, at_s)
            machine.offer(command, ("stop", number), 100, at_s)
        got += [item for _, item in machine.advance(110.0)]
        queue = machine.radios["up"].queues["robot"]
        latencies = [round(x, 9) for counts in queue.counts for x in counts.latencies_s]
        outcomes.append((sorted(got), latencies))
    assert outcomes[0] == outcomes[1] == outcomes[2]
    assert 40 < len(outcomes[0][0]) < 70


def test_jitter_never_reorders_a_connection() -> None:
    machine = shaper({"delay_ms": 1, "jitter_ms": 50})
    flow = machine.open("robot", "edge", "/cmd_vel")
    got = run(machine, [(100 + n / 100, flow, n, 10) for n in range(100)], 110)
    assert [item for _, item in got] == list(range(100))


def test_a_rate_that_changes_counts_from_then_on() -> None:
    machine = shaper({"rate_mbps": 8})
    camera = machine.open("robot", "edge", "/camera/image")
    machine.advance(100.0)
    machine.offer(camera, "image", 200_000, 100.0)
    assert machine.advance(100.1) == []
    machine.change("robot", "up", {"rate_mbps": 0}, 100.1)
    assert math.isinf(machine.next_event_s())
    assert machine.advance(200.0) == []
    machine.change("robot", "up", {"rate_mbps": 80}, 200.0)
    assert machine.next_event_s() == pytest.approx(200.01, abs=1e-6)
    assert len(machine.advance(200.02)) == 1


@pytest.mark.parametrize(
    ("link", "way", "changes", "words"),
    [
        ("nobody", "up", {}, "there are: robot"),
        ("robot", "sideways", {}, "none of up, down"),
        ("robot", "up", {"rate": 3}, "unknown key 'rate'"),
        ("robot", "", {"loss": 2}, "between 0 and 1"),
        ("robot", "up", {"min_share": 0.5, "max_share": 0.2}, "min <= max"),
        ("robot", "up", {"delay_ms": "soon"}, "no number"),
    ],
)
def test_wrong_changes_change_nothing(
    link: str, way: str, changes: dict[str, Any], words: str
) -> None:
    machine = shaper({"rate_mbps": 5})
    with pytest.raises(ConfigError, match=words):
        machine.change(link, way, changes, 100.0)
    assert machine.conditions("robot", "up").rate_bps == 5e6


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ([], "names with values"),
        ({}, "at least one site"),
        ({"links": {"r": {"upp": {}}}}, "links: r: unknown key 'upp'"),
        ({"links": {"r": {}}, "classes": [{"topics": ["/x"]}]}, "needs a name"),
        ({"links": {"r": {}}, "classes": [{"name": "x", "overflow": "explode"}]}, "drop or hold"),
        ({"links": {"r": {}}, "classes": [{"name": "x", "queue_bytes": 0}]}, "1 or more"),
        ({"links": {"r": {}}, "carrier": {"bandwidth_mhz": 7}}, "no channel of 7 MHz"),
    ],
)
def test_wrong_settings_name_the_place(data: Any, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_settings(data)


@pytest.mark.parametrize(
    ("channel", "words"),
    [
        ({"kind": "magic"}, "radio or trace"),
        ({"kind": "radio", "speed": 1}, "unknown key 'speed'"),
        ({"kind": "trace", "text": "a,b\n1,2\n"}, "columns are"),
        ({"kind": "trace", "text": "t_s,rate_mbps\n1,x\n"}, "line 2"),
        ({"kind": "trace", "text": "t_s,rate_mbps\n2,1\n1,1\n"}, "line 3"),
    ],
)
def test_wrong_channels_are_refused(channel: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        shaper(links={"robot": {"channel": channel}})


def test_topics_and_code_points_choose_the_class() -> None:
    settings = read_settings(
        {"links": {"r": {}}, "classes": [{"name": "ef", "topics": [], "dscp": [46]}, *CLASSES]}
    )
    names = [item.name for item in settings.classes]
    assert names == ["ef", "command", "sensor", "all"]
    assert class_of(settings.classes, "cmd_vel") == 1
    assert class_of(settings.classes, "/camera/image_raw") == 2
    assert class_of(settings.classes, "/odom") == 3
    assert class_of(settings.classes, "/camera/image_raw", 46) == 0


def test_a_trace_is_held_and_begins_again() -> None:
    rows = read_trace("t_s,way,rate_mbps,loss\n0,,10,\n1,up,1,0.5\n2,,20,\n")
    assert rows[1] == (1.0, "up", {"rate_mbps": 1.0, "loss": 0.5})
    text = "t_s,way,rate_mbps\n0,,10\n1,up,1\n2,,20\n"
    channel = {"kind": "trace", "text": text, "loop": True, "period_s": 0.5}
    machine = shaper(links={"robot": {"channel": channel}}, now_s=0.0)
    seen = []
    for half_seconds in range(6):
        machine.advance(half_seconds / 2)
        both = [machine.conditions("robot", way).rate_bps / 1e6 for way in ("up", "down")]
        seen.append(both)
    assert seen == [[10, 10], [10, 10], [1, 10], [1, 10], [10, 10], [10, 10]]


RADIO = {
    "kind": "radio",
    "route_m": [[20, 0], [140, 0]],
    "speed_mps": 10,
    "dead_zones": [[80, 0, 15]],
}


def test_the_radio_carries_nothing_in_its_dead_zone_and_much_near_the_station() -> None:
    machine = shaper(links={"robot": {"rnti": 0x4601, "channel": RADIO}}, now_s=0.0)
    rates: dict[int, float] = {}
    for step in range(121):
        machine.advance(step / 10)
        sample = machine.sample("robot")
        assert sample is not None
        assert sample.position_m is not None
        rates[round(sample.position_m[0])] = machine.conditions("robot", "up").rate_bps
    assert rates[20] > 10e6
    assert max(rates[x] for x in range(70, 90)) < 1e4
    (record,) = machine.records(5, 12.0)
    assert record.link_id == "4601"
    assert set(record.quality.values()) == {Quality.SIMULATED}
    assert {"ul_snr_db", "ul_mcs", "ul_bler", "dl_sinr_db", "prb_used"} <= record.values.keys()


def test_a_told_place_goes_before_the_route() -> None:
    machine = shaper(links={"robot": {"channel": RADIO}}, now_s=0.0)
    machine.moved_to("robot", 80.0, 0.0)
    machine.advance(0.5)
    assert machine.conditions("robot", "up").rate_bps < 1e4
    assert DeadZone(0, 0, 10).loss_at(20, 0) == 0


def test_no_channel_is_none() -> None:
    assert make_channel({}, read_settings({"links": {"r": {}}}).carrier, 1, "r") is None


def test_the_records_tell_rates_losses_and_the_share_of_the_blocks_since_last_time() -> None:
    machine = shaper({"rate_mbps": 8, "max_share": 0.5})
    flow = machine.open("robot", "edge", "/camera/image")
    run(machine, [(100 + n, flow, n, 100_000) for n in range(3)], 104.0)
    (record,) = machine.records(0, 104.0)
    assert record.values["ul_thr_bps"] == pytest.approx(3 * 8e5 / 4)
    assert record.values["prb_used"] == pytest.approx(51 * 0.5 * 0.6 / 4)
    assert record.values["loss"] == 0
    assert record.values["delivery_bps"] == 4e6
    (later,) = machine.records(0, 105.0)
    assert later.values["ul_thr_bps"] == 0
    assert "loss" not in later.values


def test_the_gnbs_policy_file_sets_shares() -> None:
    policy = {
        "subSlicePolicy": {
            "subSlices": [
                {"sub_slice_id": 1, "min_ratio": 0, "max_ratio": 20},
                {"sub_slice_id": 5, "min_ratio": 60, "max_ratio": 100},
            ]
        },
        "ueSliceMapping": {
            "0x4601": {"target_sub_slice": 5, "up_target_sub_slice": 5},
            "0x4602": {"target_sub_slice": 1, "up_target_sub_slice": 5},
        },
    }
    shares = policy_shares(policy)
    assert shares[0x4601] == {"down": (0.6, 1.0), "up": (0.3, 1.0)}
    assert shares[0x4602] == {"down": (0.0, 0.2), "up": (0.3, 1.0)}
    machine = shaper(links={"robot": {"rnti": 0x4602}})
    machine.take_shares(shares)
    assert machine.conditions("robot", "down").max_share == 0.2
    with pytest.raises(ConfigError, match="no slice policy"):
        policy_shares("nonsense")
