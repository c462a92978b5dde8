"""Figures, tables and text of the measurements, without a process."""

from __future__ import annotations

import json
from typing import ClassVar

import pytest

from simple_ros.benchmark.figures import Spread, latencies, noise, ratios
from simple_ros.benchmark.frames import LENGTH, FrameReader
from simple_ros.benchmark.peers import LIMITS, OURS, known_transports
from simple_ros.benchmark.report import amount, machine_line, table_lines
from simple_ros.benchmark.results import (
    call_table,
    first_message_table,
    noisy_lines,
    traffic_table,
)
from simple_ros.benchmark.session import FULL, QUICK, peers_for
from simple_ros.benchmark.workloads import WORKLOADS, Job, job_from


def round_of(rate: float, lost: float = 0) -> dict[str, float]:
    return {"per_second": rate, "lost": lost, "first_ms": 100.0}


class TestFigures:
    def test_spread(self) -> None:
        assert Spread.of([3.0, 1.0, 2.0]).as_json() == {"median": 2.0, "min": 1.0, "max": 3.0}

    def test_latencies_leave_out_the_first_tenth(self) -> None:
        times = [1.0] * 10 + [i / 1e6 for i in range(90)]
        found = latencies(times)
        assert found["p50_us"] == pytest.approx(44.5)
        assert found["p95_us"] == pytest.approx(85)
        assert found["p99_ms"] == pytest.approx(0.089)

    def test_no_latencies(self) -> None:
        assert latencies([]) == {}

    def test_ratios_pair_the_rounds_and_skip_those_that_failed(self) -> None:
        assert ratios([4.0, None, 9.0, 5.0], [2.0, 2.0, 3.0, 0.0]) == Spread(2.5, 2.0, 3.0)
        assert ratios([], [1.0]) is None

    def test_noise(self) -> None:
        assert noise([2.0, 3.0]) == 1.5
        assert noise([]) == 1.0


class TestWorkloads:
    def test_a_job_survives_the_command_line(self) -> None:
        job = Job("send", WORKLOADS["mib"], 2, (1, "a"), {"master": "h:1"}, {"transport": "tcp"})
        assert job_from(json.loads(json.dumps(job.as_json()))) == job

    def test_shortened(self) -> None:
        assert WORKLOADS["small"].shortened(0.5).count == WORKLOADS["small"].count // 2
        assert WORKLOADS["image30"].shortened(0.0).count == 10

    @pytest.mark.parametrize(
        ("name", "larger"), [("small", True), ("latency", False), ("image30", False), ("mib", True)]
    )
    def test_what_is_better(self, name: str, larger: bool) -> None:
        assert WORKLOADS[name].is_better_larger is larger

    def test_extents_name_workloads(self) -> None:
        for extent in (FULL, QUICK):
            assert set(extent.workloads) <= set(WORKLOADS)
            assert "latency" in extent.workloads


class TestPeers:
    def test_transports(self) -> None:
        assert {"tcp", "unix"} <= set(known_transports())
        assert "local" not in known_transports()

    def test_chosen(self) -> None:
        assert [peer.name for peer in peers_for([])] == ["ours", "ours_host", "buffered"]
        peers = peers_for(["unix", "tcp"])
        assert [peer.name for peer in peers] == ["ours_unix", "ours_tcp", "buffered"]
        assert peers[0].options == {"transport": "unix"}

    def test_names_are_keys(self) -> None:
        for name, peer in (OURS | LIMITS).items():
            assert peer.name == name


class TestTables:
    peers: ClassVar = (OURS["ours"], LIMITS["buffered"])
    found: ClassVar = {
        "ours": [round_of(200.0), round_of(300.0), None],
        "buffered": [round_of(100.0), round_of(100.0), round_of(130.0)],
    }

    def table(self) -> dict[str, object]:
        return traffic_table(WORKLOADS["small"], self.peers, self.found, "ours", "buffered")

    def test_traffic(self) -> None:
        table = self.table()
        rows = table["peers"]
        assert isinstance(rows, dict)
        assert rows["ours"]["value"] == {"median": 250.0, "min": 200.0, "max": 300.0}
        assert rows["ours"]["rounds"] == [200.0, 300.0, None]
        assert rows["buffered"]["ours_to_it"] == {"median": 2.5, "min": 2.0, "max": 3.0}
        assert table["noise"] == pytest.approx(1.3)

    def test_a_run_that_lost_has_no_rate(self) -> None:
        found = self.found | {"ours": [round_of(0.0, lost=7)]}
        table = traffic_table(WORKLOADS["small"], self.peers, found, "ours", "buffered")
        assert table["peers"]["ours"]["value"] is None
        assert "lost 7" in "\n".join(table_lines(table, "buffered"))

    def test_first_message(self) -> None:
        table = first_message_table(self.peers, self.found, "ours", "buffered")
        assert table["peers"]["ours"]["value"]["median"] == 100.0

    def test_calls_leave_out_who_cannot(self) -> None:
        found = {"ours": [{"pipelined_per_second": 9.0}], "rospy": [{"sequential_p50_us": 1.0}]}
        whats = {"ours": ("ours", "simple_ros"), "rospy": ("rival", "rospy")}
        table = call_table("pipelined_per_second", whats, found, "ours")
        assert list(table["peers"]) == ["ours"]

    def test_lines(self) -> None:
        title, ours, bare = table_lines(self.table(), "buffered")
        assert title == "small messages flat out (msg/s):"
        assert ours.split("  ")[1:] != []
        assert "250 (200 to 300)" in ours
        assert ours.endswith("2.50 of bare")
        assert bare.endswith("100 (100 to 130)")

    def test_warnings(self) -> None:
        quiet = {"load": 0.1, "cores": 2}
        table = {"small": self.table()}
        assert ["factor of 1.30" in line for line in noisy_lines(table, quiet, 3)] == [True]
        assert noisy_lines({}, quiet, 3) == []
        assert len(noisy_lines({}, {"load": 3.0, "cores": 2}, 1)) == 2

    @pytest.mark.parametrize(
        ("value", "text"), [(123456.7, "123,457"), (12.34, "12.3"), (1.234, "1.23")]
    )
    def test_amount(self, value: float, text: str) -> None:
        assert amount(value) == text

    def test_machine(self) -> None:
        facts = {"cpu": "X", "cores": 2, "system": "Linux 6", "python": "CPython 3", "gil": False}
        assert machine_line(facts) == "X, cores 2, Linux 6, CPython 3, no GIL"


@pytest.mark.parametrize("chunk", [1, 3, 7, 1000])
def test_frames_are_cut_the_same_however_they_come(chunk: int) -> None:
    messages = [b"", b"a", b"bc" * 20, bytes(400_000), b"end"]
    stream = b"".join(LENGTH.pack(len(message)) + message for message in messages)
    taken: list[bytes] = []
    reader = FrameReader(lambda view: taken.append(bytes(view)))
    position = 0
    while position < len(stream):
        room = reader.room()
        step = chunk if len(stream) - position < 2000 or position < 2000 else 50_000
        count = min(step, len(room), len(stream) - position)
        room[:count] = stream[position : position + count]
        reader.received(count)
        position += count
    assert taken == messages
