"""The event log over the death of hubs: each event once, also what happened while there was no hub."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.hubs import Watcher, end_all, hub_process, watcher
from support.waiting import until

from simple_ros.msg.wireless_ros_msgs import (
    ControlComponent,
    ControlComponentRequest,
    GetSystemEvents,
    GetSystemEventsRequest,
    SystemEvent,
)
from simple_ros_hub.event_log import EventLog
from simple_ros_master import Master

LONG_S = 60.0
CONFIG = """
components:
  ear: {cell: telemetry}
  eye: {cell: camera}
  hand: {cell: command, required: false}
"""


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    end_all(tmp_path)


async def operating(seen: Watcher) -> None:
    await until(lambda: seen.operates, "operation", LONG_S)


def directory_of(place: Path) -> Path:
    return next(place.glob("hub-*"))


async def all_heard(seen: Watcher) -> list[SystemEvent]:
    """What the hub keeps, once all of it was heard: what a hub that is killed had not sent yet is lost."""
    ask = seen.node.service_client("/wireless_ros/get_system_events", GetSystemEvents)
    kept = (await ask.call(GetSystemEventsRequest())).events
    numbers = {event.number for event in kept}
    await until(lambda: {event.number for event in seen.events} >= numbers, "all events")
    return list(kept)


def count(seen: Watcher, words: str) -> int:
    return sum(words in text for text in seen.texts())


async def test_each_event_once_over_three_hubs(master: Master, place: Path) -> None:
    config = place / "components.yaml"
    config.write_text(CONFIG)
    words = ("--config", str(config))
    async with watcher(master) as seen:
        async with hub_process(master, place, *words, discovery_time=0.1) as first:
            await operating(seen)
            control = seen.node.service_client("/wireless_ros/control_component", ControlComponent)
            answer = await control.call(ControlComponentRequest(name="hand", action="stop"))
            assert answer.ok
            await until(lambda: count(seen, "Stopped hand") == 1, "a stop", LONG_S)
            await all_heard(seen)
            before = seen.pids
            # The hub first: nobody is there to see the other one end.
            first.signal(signal.SIGKILL)
            await first.wait()
            os.kill(before["ear"], signal.SIGKILL)
            seen.forget()
        async with hub_process(master, place, *words) as second:
            await operating(seen)
            assert seen.pids["eye"] == before["eye"]
            assert seen.pids["ear"] not in (0, before["ear"])
            # What somebody stopped by hand stays so.
            assert seen.component("hand").state == "stopped"
            await all_heard(seen)
            second.signal(signal.SIGKILL)
            await second.wait()
            seen.forget()
        async with hub_process(master, place, *words) as third:
            await operating(seen)
            # Whoever listens all the time hears each once, and misses none.
            kept = await all_heard(seen)
            numbers = [event.number for event in kept]
            assert numbers == list(range(1, len(kept) + 1))
            assert sum("hub before this one died" in event.text for event in kept) == 2
            failed = [event.text for event in kept if "ear failed: " in event.text]
            assert failed == [
                f"Required cell ear failed: process {before['ear']} ended while there was no hub"
            ]
            assert sum("Taken over" in event.text for event in kept) == 1 + 2
            assert not any("not started by this hub" in event.text for event in kept)
            assert len({event.number for event in seen.events}) == len(seen.events)
            third.signal(signal.SIGINT)
            assert await third.wait(LONG_S) == 0
    entries = EventLog(directory_of(place)).read(10_000)
    assert [entry.number for entry in entries] == list(range(1, len(entries) + 1))
    assert {entry.text for entry in entries[-3:]} == {"The hub ends", "Stopped ear", "Stopped eye"}


async def test_what_was_ended_by_stop_is_not_lost(master: Master, place: Path) -> None:
    config = place / "components.yaml"
    config.write_text("components: {ear: {cell: telemetry}}")
    words = ("--config", str(config))
    async with watcher(master) as seen:
        async with hub_process(master, place, *words, discovery_time=0.1) as hub:
            await operating(seen)
            hub.signal(signal.SIGKILL)
            await hub.wait()
            seen.forget()
        async with hub_process(master, place, "--stop", *words) as stopper:
            assert "ended ear" in await stopper.line()
            assert await stopper.wait(LONG_S) == 0
        async with hub_process(master, place, *words, discovery_time=0.1):
            await operating(seen)
    entries = EventLog(directory_of(place)).read(10_000)
    errors = [entry.text for entry in entries if entry.is_error]
    assert len(errors) == 1
    assert "hub before this one died" in errors[0]


async def test_a_hub_that_ended_in_order_is_not_missed(master: Master, place: Path) -> None:
    config = place / "components.yaml"
    config.write_text("components: {ear: {cell: telemetry}}")
    words = ("--config", str(config))
    async with watcher(master) as seen:
        for leaves in (("--leave-running",), ()):
            async with hub_process(master, place, *words, *leaves, discovery_time=0.1) as hub:
                await operating(seen)
                hub.signal(signal.SIGINT)
                assert await hub.wait(LONG_S) == 0
                seen.forget()
    entries = EventLog(directory_of(place)).read(10_000)
    assert [entry.text for entry in entries if entry.is_error] == []
    assert [entry.text for entry in entries if entry.text.startswith(("The hub", "Stopped"))] == [
        "The hub ends, components run on",
        "The hub ends",
        "Stopped ear",
    ]


async def test_a_master_that_is_away_is_told_once(place: Path) -> None:
    config = place / "components.yaml"
    config.write_text("components: {ear: {cell: telemetry}}")
    async with Master(host="127.0.0.1", port=0) as master:
        port = master.port
        async with (
            watcher(master) as seen,
            hub_process(master, place, "--config", str(config), discovery_time=0.1),
        ):
            await operating(seen)
            before = seen.pids
            await master.stop()
            await until(lambda: count(seen, "does not answer") == 1, "the news", LONG_S)
            assert seen.operates
            async with Master(host="127.0.0.1", port=port):
                await until(lambda: count(seen, "the Master answers again") == 1, "it", LONG_S)
                await operating(seen)
                assert seen.pids == before
                assert count(seen, "does not answer") == 1
