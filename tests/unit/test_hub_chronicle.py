"""What outlives a hub: the event log and what it remembers."""

from __future__ import annotations

import dataclasses
import json
from itertools import count
from pathlib import Path

import pytest

from simple_ros_hub.chronicle import Chronicle
from simple_ros_hub.event_log import EventLog
from simple_ros_hub.journal import Entry
from simple_ros_hub.memory import Memory
from simple_ros_hub.place import Place

SECOND = 1_000_000_000


def entry(number: int, text: str = "something") -> Entry:
    return Entry(number, number * SECOND, "eye", text, is_error=number % 2 == 0)


def chronicle(directory: Path) -> Chronicle:
    stamps = count(1)
    return Chronicle(EventLog(directory), lambda: next(stamps) * SECOND)


def texts(made: Chronicle) -> list[str]:
    return [item.text for item in made.journal.system_events]


def test_entries_come_back_as_they_were(tmp_path: Path) -> None:
    written = [entry(1), entry(2, "Kamera fällt aus\nzweite Zeile"), entry(3)]
    log = EventLog(tmp_path)
    assert log.read(10) == []
    for item in written:
        log.append(item)
    assert EventLog(tmp_path).read(10) == written
    assert EventLog(tmp_path).read(2) == written[1:]


def test_a_full_file_is_kept_as_one_generation(tmp_path: Path) -> None:
    log = EventLog(tmp_path, max_bytes=1000)
    for number in range(100):
        log.append(entry(number))
    sizes = {path.name: path.stat().st_size for path in tmp_path.iterdir()}
    assert max(sizes.values()) < 1200
    assert len(sizes) == 2
    kept = [item.number for item in log.read(1000)]
    assert kept == list(range(kept[0], 100))
    assert len(kept) >= 10


def test_lines_that_make_no_sense_are_left_out(tmp_path: Path) -> None:
    log = EventLog(tmp_path)
    log.append(entry(1))
    with (tmp_path / "events.jsonl").open("ab") as file:
        file.write(b'[1]\n{"number": 7}\n\xff\xfe\n{"number": 2, "stamp')
    log.append(entry(3))
    assert [item.number for item in log.read(10)] == [1, 3]


def test_what_cannot_be_written_is_told_once_and_known_all_the_same(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    gone = tmp_path / "gone"
    made = chronicle(gone)
    made.log_error("one")
    made.log_error("two")
    assert texts(made) == ["one", "two"]
    assert sum("events are not kept" in record.message for record in caplog.records) == 1
    gone.mkdir()
    made.log_error("three")
    assert [item.text for item in EventLog(gone).read(10)] == ["three"]


def test_the_next_hub_goes_on_counting(tmp_path: Path) -> None:
    first = chronicle(tmp_path)
    first.log_event("one")
    first.log_error("two", "eye")
    second = chronicle(tmp_path)
    assert texts(second) == ["one", "two"]
    assert [item.text for item in second.journal.error_logs] == ["two"]
    # What the first one told is not told again on the topic.
    assert second.take_unsent() == []
    second.log_event("three")
    assert [(item.number, item.text) for item in second.take_unsent()] == [(3, "three")]
    assert [item.number for item in EventLog(tmp_path).read(10)] == [1, 2, 3]


def test_a_condition_that_outlives_the_hub_is_told_once(tmp_path: Path) -> None:
    first = chronicle(tmp_path)
    first.condition("conflict", "conflict 120/100", "over")
    second = chronicle(tmp_path)
    second.go_on(first.journal.present)
    second.condition("conflict", "conflict 121/100", "over")
    assert texts(second) == ["conflict 120/100"]
    for _ in range(10):
        second.condition("conflict", "", "over")
    assert texts(second) == ["conflict 120/100", "over"]


def test_memory_comes_back_whole(tmp_path: Path) -> None:
    memory = Memory(
        hub=7,
        pids={"eye": 8},
        stopped=("ear",),
        present=("conflict", "refused b"),
        level=2,
        policy="BALANCED_OPERATION",
        pinned=True,
        base={"radio": {"mode": "burst"}},
    )
    with Place(tmp_path) as place:
        place.remember(memory.facts())
        assert Memory.of(place.remembered()) == memory


def test_processes_of_another_run_of_the_computer_are_nobodys(tmp_path: Path) -> None:
    with Place(tmp_path) as place:
        place.remember(Memory(hub=7, pids={"eye": 8}, policy="BALANCED_OPERATION").facts())
        file = tmp_path / "state.json"
        file.write_text(json.dumps({**json.loads(file.read_text()), "boot": "another"}))
        assert Memory.of(place.remembered()) == Memory(policy="BALANCED_OPERATION")


@pytest.mark.parametrize(
    "facts",
    [
        {},
        {"hub": "x", "pids": [1], "stopped": 3, "present": None, "level": {}, "base": ["a"]},
        {"hub": None, "pids": {"eye": "y"}, "base": {"radio": 1}},
    ],
)
def test_memory_that_makes_no_sense_is_no_memory(facts: dict[str, object]) -> None:
    assert Memory.of(facts) == Memory()


def test_a_level_out_of_range_is_the_nearest() -> None:
    assert [Memory.of({"level": level}).level for level in (-1, 2, 9)] == [0, 2, 3]
    assert dataclasses.replace(Memory(), level=1) == Memory.of({"level": 1.0})
