from __future__ import annotations

import pytest

from simple_ros.cli.diag import items_json, items_text
from simple_ros.diagnostics import (
    ERROR,
    OK,
    STALE,
    WARN,
    Aggregator,
    DelayMonitor,
    FrequencyMonitor,
    Heartbeat,
    Status,
    Tasks,
    TopicStatistics,
)
from simple_ros.diagnostics.aggregator import MAX_ITEMS
from simple_ros.diagnostics.status import level_name, worst
from simple_ros.diagnostics.tasks import Check
from simple_ros.diagnostics.topic_statistics import write
from simple_ros.errors import ConfigError
from simple_ros.msg.diagnostic_msgs import DiagnosticArray, DiagnosticStatus, KeyValue
from simple_ros.time import Time

# -- status --------------------------------------------------------------------------------------


def test_status_message() -> None:
    status = Status("arm", "motor 3")
    status.summary(WARN, "warm")
    status.add("temperature", 71.23456789)
    status.add("joints", 6)
    status.add("joints", 7)
    assert status.to_message() == DiagnosticStatus(
        level=WARN,
        name="arm",
        message="warm",
        hardware_id="motor 3",
        values=[KeyValue(key="temperature", value="71.2346"), KeyValue(key="joints", value="7")],
    )


def test_merging() -> None:
    status = Status("arm")
    status.merge_summary(OK, "fine")
    status.merge_summary(OK, "still fine")
    assert (status.level, status.message) == (OK, "fine")
    status.merge_summary(WARN, "warm")
    assert (status.level, status.message) == (WARN, "warm")
    status.merge_summary(OK, "other part is fine")
    status.merge_summary(ERROR, "stuck")
    status.merge_summary(WARN, "loud")
    assert (status.level, status.message) == (ERROR, "warm; stuck; loud")
    assert worst([OK, STALE, ERROR]) == STALE
    assert worst([]) == OK
    assert [level_name(level) for level in (0, 3, 7)] == ["ok", "stale", "7"]


# -- monitors ------------------------------------------------------------------------------------


def run(monitor: Check, now_s: float) -> Status:
    status = Status("it")
    monitor.run(status, now_s)
    return status


def ticking(monitor: FrequencyMonitor, hz: float, begin_s: float, end_s: float) -> None:
    count = round((end_s - begin_s) * hz)
    for number in range(count):
        monitor.tick(begin_s + (number + 1) / hz)


def test_frequency() -> None:
    monitor = FrequencyMonitor(9, 11, window=2)
    assert run(monitor, 0.0).level == ERROR
    ticking(monitor, 10, 0.0, 1.0)
    right = run(monitor, 1.0)
    assert (right.level, right.message) == (OK, "10.00 Hz")
    assert right.values["highest right rate (Hz)"] == "11"
    ticking(monitor, 5, 1.0, 3.0)
    assert "too seldom" in run(monitor, 3.0).message
    ticking(monitor, 30, 3.0, 4.0)
    often = run(monitor, 4.0)
    assert often.level == WARN
    assert run(monitor, 5.0).message == "too often: 15.00 Hz", "30 in the 2 s of the window"
    assert run(monitor, 6.0).message == "nothing happens"


def test_frequency_tolerance_and_no_upper_limit() -> None:
    monitor = FrequencyMonitor(10, tolerance=0.2)
    run(monitor, 0.0)
    ticking(monitor, 8.5, 0.0, 2.0)
    assert run(monitor, 2.0).level == OK
    ticking(monitor, 1000, 2.0, 3.0)
    assert run(monitor, 3.0).level == OK
    for wrong in ((5, 4, 0.1, 5), (-1, 4, 0.1, 5), (1, 2, -0.1, 5), (1, 2, 0.1, 0)):
        with pytest.raises(ConfigError):
            FrequencyMonitor(wrong[0], wrong[1], tolerance=wrong[2], window=int(wrong[3]))


def test_delay() -> None:
    monitor = DelayMonitor(0.5, -0.1)
    assert run(monitor, 1.0).message == "nothing arrived"
    monitor.tick(9.9, 10.0)
    right = run(monitor, 10.0)
    assert (right.level, right.message) == (OK, "stamps are right")
    assert right.values["largest delay (s)"] == "0.1"
    monitor.tick(9.0, 10.0)
    monitor.tick(11.0, 10.0)
    wrong = run(monitor, 10.0)
    assert wrong.level == ERROR
    assert wrong.message == "stamps are 1.000 s in the future; stamps are 1.000 s old"
    assert wrong.values["wrong delays in all"] == "2"
    monitor.tick(0, 10.0)
    assert run(monitor, 10.0).message == "no stamp was set"
    with pytest.raises(ConfigError):
        DelayMonitor(0, 1)


def test_heartbeat() -> None:
    assert run(Heartbeat(), 5.0).message == "alive"
    heart = Heartbeat(within_s=1.0)
    assert run(heart, 5.0).level == WARN
    heart.beat(5.0)
    assert run(heart, 5.9).level == OK
    assert run(heart, 6.1).level == ERROR


# -- tasks ---------------------------------------------------------------------------------------


def test_tasks(caplog: pytest.LogCaptureFixture) -> None:
    tasks = Tasks("robot", "serial 1")
    works = [False]

    def camera(status: Status) -> None:
        if not works[0]:
            raise RuntimeError("unplugged")
        status.summary(OK, "sees")

    tasks.add("camera", camera)
    tasks.add("both", lambda status: status.merge_summary(WARN, "warm"), Heartbeat())
    for _ in range(2):
        array = tasks.look(Time.of(7))
    assert (array.header.seq, array.header.stamp.seconds) == (2, 7)
    first, second = array.status
    assert (first.name, first.level) == ("robot: camera", ERROR)
    assert first.message == "the task raised RuntimeError: unplugged"
    assert (second.message, second.hardware_id) == ("warm", "serial 1")
    assert len(caplog.records) == 1, "told once until it works again"
    works[0] = True
    assert tasks.look(Time.of(8)).status[0].message == "sees"
    started = tasks.say(Time.of(9), WARN, "starting")
    assert {status.message for status in started.status} == {"starting"}
    with pytest.raises(ConfigError, match="already"):
        tasks.add("camera", camera)
    with pytest.raises(ConfigError, match="nothing to look at"):
        tasks.add("empty")
    tasks.remove("camera")
    with pytest.raises(LookupError):
        tasks.remove("camera")


# -- topics --------------------------------------------------------------------------------------


def test_topic_rate_bandwidth_and_age() -> None:
    statistics = TopicStatistics(100.0)
    for number in range(10):
        statistics.message(500, 100 + number / 10, stamp_s=100 + number / 10 - 0.02 * (number % 2))
    facts = statistics.look(101.0, dropped=3, waiting=2)
    assert (facts.messages, facts.rate_hz, facts.bandwidth_bps) == (10, 10, 5000)
    assert facts.mean_age_s == pytest.approx(0.01)
    assert facts.max_age_s == pytest.approx(0.02)
    assert (facts.dropped, facts.waiting) == (3, 2)
    again = statistics.look(102.0, dropped=5)
    assert (again.messages, again.rate_hz, again.mean_age_s) == (0, 0, None)
    assert (again.dropped, again.dropped_in_all) == (2, 5)
    assert statistics.look(102.0).rate_hz == 0.0


def counted(*numbers: int) -> tuple[int, int, int]:
    statistics = TopicStatistics(0.0)
    for seq in numbers:
        statistics.message(1, 0.0, seq=seq)
    facts = statistics.look(1.0)
    return facts.gaps, facts.duplicates, facts.late


def test_gaps_and_duplicates() -> None:
    assert counted(5, 6, 7) == (0, 0, 0)
    assert counted(1, 2, 5, 6) == (2, 0, 0)
    assert counted(1, 2, 2, 3) == (0, 1, 0)
    assert counted(1, 3, 2, 4) == (0, 0, 1), "it was late, not lost"
    assert counted(1000, 1001, 1, 2) == (0, 0, 0), "the publisher began anew"
    assert counted(0, 0, 0) == (0, 0, 0), "without numbers"


def test_several_publishers_have_no_gaps() -> None:
    statistics = TopicStatistics(0.0)
    for seq in (1, 50, 2, 51):
        statistics.message(1, 0.0, seq=seq, several=True)
    statistics.message(1, 0.0, seq=60)
    assert statistics.look(1.0).gaps == 0


def test_topic_status() -> None:
    statistics = TopicStatistics(0.0)
    statistics.message(10, 0.5)
    status = Status("topic")
    write(statistics.look(1.0, dropped=4), status, needs_messages=True)
    assert (status.level, status.message) == (WARN, "4 messages were dropped")
    assert status.values["bandwidth (B/s)"] == "10"
    assert "mean age (s)" not in status.values
    for needs, level in ((True, ERROR), (False, OK)):
        quiet = Status("topic")
        write(statistics.look(2.0, dropped=4), quiet, needs_messages=needs)
        assert (quiet.level, quiet.message) == (level, "nothing flows")


# -- the aggregator ------------------------------------------------------------------------------


def sent(**levels: DiagnosticStatus.Level.ValueType) -> DiagnosticArray:
    return DiagnosticArray(
        status=[
            DiagnosticStatus(name=name.replace("__", ": "), level=level, message=f"is {level}")
            for name, level in levels.items()
        ]
    )


def test_groups_and_what_is_stale() -> None:
    gathered = Aggregator({"Sensors": ["lidar", "camera"], "Front": ["camera: front"]}, base="R")
    gathered.receive(sent(lidar__scan=OK, camera__front=WARN, camera__back=OK), 0.0)
    gathered.receive(sent(arm=ERROR), 6.0)
    report = gathered.report(Time.of(9), 6.0)
    found = {status.name: (level_name(status.level), status.message) for status in report.status}
    assert found == {
        "/R": ("stale", "4 of 4 are not ok"),
        "/R/Front": ("stale", "1 of 1 are not ok"),
        "/R/Front/camera: front": ("stale", "not heard for 6 s; before: is 1"),
        "/R/Other": ("error", "1 of 1 are not ok"),
        "/R/Other/arm": ("error", "is 2"),
        "/R/Sensors": ("stale", "2 of 2 are not ok"),
        "/R/Sensors/camera: back": ("stale", "not heard for 6 s; before: is 0"),
        "/R/Sensors/lidar: scan": ("stale", "not heard for 6 s; before: is 0"),
    }
    assert report.header.stamp.seconds == 9
    gathered.receive(sent(lidar__scan=OK), 7.0)
    for name in ("arm", "camera: front", "camera: back", "never heard"):
        gathered.forget(name)
    assert gathered.report(Time.of(9), 7.0).status[0].message == "1 are ok"


def test_groups_that_make_no_sense() -> None:
    for groups in ({"A": [""]}, {"A": ["x"], "B": ["x"]}):
        with pytest.raises(ConfigError, match="prefix"):
            Aggregator(groups)
    with pytest.raises(ConfigError):
        Aggregator(stale_after_s=0)


def test_no_end_of_names() -> None:
    gathered = Aggregator()
    array = DiagnosticArray(status=[DiagnosticStatus(name=str(n)) for n in range(MAX_ITEMS + 5)])
    gathered.receive(array, 0.0)
    gathered.receive(array, 1.0)
    assert len(gathered.items(1.0)) == MAX_ITEMS
    assert gathered.refused == 10


def test_what_the_command_shows() -> None:
    gathered = Aggregator()
    array = sent(arm=ERROR)
    array.status[0].values.append(KeyValue(key="joint", value="3\x1b"))
    gathered.receive(array, 0.0)
    items = list(gathered.items(1.5))
    assert items_text(items, verbose=True).splitlines() == [
        "level  name  message  age",
        "error  arm   is 2     1.5 s",
        "       joint: 3\\x1b",
    ]
    assert len(items_text(items, verbose=False).splitlines()) == 2
    assert items_text([], verbose=True) == "no diagnostics"
    assert '"values": {"joint": ' in items_json(items)
