"""The hub with real engines and cells in processes: start, kills, hangs, takeover, end."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import urllib.error
import urllib.request
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
from support.hubs import SYNTHETIC, Watcher, end_all, hub_process, started, watcher
from support.waiting import until
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin

from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.wireless_ros_msgs import (
    ChannelState,
    ControlComponent,
    ControlComponentRequest,
    GetLinkQuality,
    GetLinkQualityRequest,
    GetSystemEvents,
    GetSystemEventsRequest,
    GlobalPolicy,
    MonitorQuality,
    MonitorQualityGoal,
    OptimizePath,
    OptimizePathRequest,
    ReconfigureEngine,
    ReconfigureEngineRequest,
    ResourceGrants,
    SetGlobalPolicy,
    SetGlobalPolicyRequest,
    SystemEvent,
)
from simple_ros.qos import LATCHED
from simple_ros_master import Master

ENGINES = ["radio_info_engine", "cross_domain_engine", "physical_adaptive_engine"]
CELL = ("--cell", "telemetry")
LONG_S = 60.0
QUICK = {"discovery_time": 0.1}


async def operating(seen: Watcher) -> None:
    await until(lambda: seen.operates, "operation", LONG_S)


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    """Where hubs of a test live; whatever they leave running is ended."""
    yield tmp_path
    end_all(tmp_path)


@pytest.fixture
async def seen(master: Master) -> AsyncIterator[Watcher]:
    async with watcher(master) as made:
        yield made


async def told(seen: Watcher, words: str) -> None:
    """Wait for an event: statuses and events come on topics of their own."""
    await until(lambda: any(words in text for text in seen.texts()), words, LONG_S)


async def lost(
    seen: Watcher, victim: str, number: signal.Signals, errors: int
) -> list[SystemEvent]:
    """Strike a component down; it comes back, nobody else is touched. So many errors are told."""
    before, count = seen.pids, len(seen.events)

    def bad() -> list[SystemEvent]:
        return [event for event in seen.events[count:] if event.is_error]

    os.kill(before[victim], number)
    await until(lambda: seen.pids[victim] not in (0, before[victim]), "a restart", LONG_S)
    await operating(seen)
    changed = {name for name, pid in seen.pids.items() if pid != before[name]}
    assert changed == {victim}
    assert seen.component(victim).restarts == 1
    await until(lambda: len(bad()) >= errors, "the errors", LONG_S)
    return bad()


async def parameter_is(seen: Watcher, name: str, value: str) -> None:
    """Wait until a parameter has a value."""
    async for change in await seen.node.watch_parameters(name):
        if change.value == value:
            return


async def test_start_kills_hangs_and_end(master: Master, place: Path, seen: Watcher) -> None:
    async with hub_process(master, place, *SYNTHETIC, *CELL, **QUICK) as hub:
        await operating(seen)
        names = [*ENGINES, "telemetry_cell"]
        assert [item.name for item in seen.newest.components] == names
        await told(seen, "Operation phase")
        order = [text for text in seen.texts() if text.startswith("Started")]
        assert [text.split()[2] for text in order] == names
        phases = [text for text in seen.texts() if text.endswith("phase")]
        assert phases == ["Discovery phase", "Initialization phase", "Operation phase"]
        assert len(started(place)) == 4

        for victim, number, how in (
            ("cross_domain_engine", signal.SIGKILL, "killed by SIGKILL"),
            ("physical_adaptive_engine", signal.SIGSTOP, "hangs: silent for"),
            ("telemetry_cell", signal.SIGKILL, "killed by SIGKILL"),
        ):
            errors = 2 if number == signal.SIGSTOP else 1
            bad = await lost(seen, victim, number, errors)
            assert how in bad[0].text
            assert bad[0].component == victim
            assert len(bad) == errors

        hub.signal(signal.SIGINT)
        assert await hub.wait() == 0
        assert started(place) == []


async def test_a_new_hub_takes_over_without_restarting(
    master: Master, place: Path, seen: Watcher
) -> None:
    states: list[ChannelState] = []
    await seen.node.subscribe("/wireless_ros/channel_state", ChannelState, states.append)
    mode = "/wireless_ros/radio_info_engine/mode"
    async with hub_process(master, place, *SYNTHETIC, *CELL, **QUICK) as first:
        await operating(seen)
        before = seen.pids
        pin = seen.node.service_client("/wireless_ros/set_global_policy", SetGlobalPolicy)
        assert (await pin.call(SetGlobalPolicyRequest(policy="HIGH_EFFICIENCY"))).ok
        await parameter_is(seen, mode, "optimized")
        async with hub_process(master, place, *SYNTHETIC) as refused:
            assert await refused.wait() == 1
            assert f"a hub runs already (pid {first.pid}" in await refused.errors()
        async with hub_process(master, place, *SYNTHETIC, *CELL, "--standby") as second:
            assert "standing by" in await second.line()
            first.signal(signal.SIGKILL)
            await first.wait()
            count = len(states)
            seen.forget()
            await until(lambda: len(states) > count + 5, "engines that work without a hub")
            await operating(seen)
            assert seen.pids == before
            assert sorted(started(place)) == sorted(before.values())
            again = "Operation phase"
            await until(lambda: sum(again in t for t in seen.texts()) == 2, "its events", LONG_S)
            assert sum("Taken over" in text for text in seen.texts()) == 4
            assert seen.newest.policy == "HIGH_EFFICIENCY"
            # What was before the policy is known to the second hub, too.
            pin = seen.node.service_client("/wireless_ros/set_global_policy", SetGlobalPolicy)
            assert (await pin.call(SetGlobalPolicyRequest(policy="BALANCED_OPERATION"))).ok
            await parameter_is(seen, mode, "realtime")


async def test_a_crash_loop_is_given_up_with_its_reason(
    master: Master, place: Path, seen: Watcher
) -> None:
    config = place / "components.yaml"
    config.write_text(
        "components:\n"
        "  radio_info_engine: {engine: radio-information, parameters: {source: synthetic}}\n"
        "  broken:\n"
        "    command: [python3, -c, 'raise SystemExit(\"no camera at /dev/video9\")']\n"
        "    kind: cell\n"
        "    respawn: {limit: 2, delay_s: 0.05}\n"
    )
    async with hub_process(master, place, "--config", str(config), **QUICK):
        await until(lambda: seen.newest.phase == "OPERATION", "operation", LONG_S)
        await until(lambda: seen.component("broken").state == "given up", "giving up", LONG_S)
        assert "no camera at /dev/video9" in seen.component("broken").message
        assert "restarted 2 times" in seen.component("broken").message
        assert seen.component("radio_info_engine").state == "active"
        await told(seen, "is given up")
        given_up = [event.text for event in seen.events if event.component == "broken"]
        assert sum("is given up" in text for text in given_up) == 1
        control = seen.node.service_client("/wireless_ros/control_component", ControlComponent)
        again = await control.call(ControlComponentRequest(name="broken", action="start"))
        assert again.ok
        await until(lambda: seen.component("broken").restarts == 4, "two more restarts", LONG_S)


async def test_a_source_that_is_absent_degrades_the_start(
    master: Master, place: Path, seen: Watcher
) -> None:
    words = (
        "--set",
        "radio_info_engine.source=srsran",
        "--set",
        'radio_info_engine.source_options={"url": "ws://127.0.0.1:9"}',
    )
    async with hub_process(master, place, *words, **QUICK):
        await until(lambda: seen.newest.phase == "OPERATION", "operation", LONG_S)
        assert seen.newest.degraded
        assert seen.component("radio_info_engine").state == "degraded"
        assert seen.component("physical_adaptive_engine").state == "active"
        await told(seen, "Operation phase, degraded")


async def test_links_share_and_one_too_many_is_refused(
    master: Master, place: Path, seen: Watcher
) -> None:
    grants: list[ResourceGrants] = []
    await seen.node.subscribe(
        "/wireless_ros/resource_grants", ResourceGrants, grants.append, qos=LATCHED
    )
    words = (*SYNTHETIC, "--set", 'radio_info_engine.source_options={"links": 3}')
    few = {"max_total_prbs": 12, "max_users": 2}
    async with hub_process(master, place, *words, **QUICK, **few):
        await operating(seen)
        await until(
            lambda: grants and grants[-1].refused and grants[-1].conflict, "a conflict", LONG_S
        )
        newest = grants[-1]
        assert newest.total_prb == 12
        assert len(newest.grants) == 2
        assert sum(grant.granted_prb for grant in newest.grants) == 12
        assert all(grant.granted_prb >= min(5, grant.requested_prb) for grant in newest.grants)
        assert newest.refused[0].reason.startswith("2 of at most 2 users are admitted")
        # Grants and events come on topics of their own.
        await told(seen, "conflict detected")
        assert sum("conflict detected" in text for text in seen.texts()) == 1
        await seen.node.set_parameters(
            {"/wireless_ros/hub/max_users": 3, "/wireless_ros/hub/max_total_prbs": 100}
        )
        await until(lambda: len(grants[-1].grants) == 3, "room for all", LONG_S)
        assert not grants[-1].refused
        await told(seen, "is admitted, or gone")


async def test_the_dashboard_shows_and_switches(master: Master, place: Path, seen: Watcher) -> None:
    async with hub_process(master, place, *SYNTHETIC, "--dashboard", "0", **QUICK):
        await operating(seen)
        found = seen.node.service_client("/wireless_ros/get_system_events", GetSystemEvents)
        texts = [event.text for event in (await found.call(GetSystemEventsRequest())).events]
        (url,) = [text.split()[-1] for text in texts if text.startswith("Dashboard at")]
        page = await asyncio.to_thread(fetched, url)
        assert "<title>Wireless hub</title>" in page
        assert "new WebSocket" in await asyncio.to_thread(fetched, f"{url}app.js")
        with pytest.raises(urllib.error.HTTPError, match="404"):
            await asyncio.to_thread(fetched, f"{url}../hub.py")
        feed = f"{url.replace('http', 'ws')}feed"
        with pytest.raises(InvalidStatus, match="403"):
            await connect(feed, origin=Origin("http://elsewhere.example"))
        async with connect(feed) as page_feed:
            state = json.loads(await page_feed.recv())
            assert state["phase"] == "OPERATION"
            assert [item["name"] for item in state["components"]] == ENGINES
            assert state["events"][0]["number"] == 1

            async def answer(**said: str) -> str:
                await page_feed.send(json.dumps(said))
                while (message := json.loads(await page_feed.recv()))["op"] != "answer":
                    pass
                return f"{'ok' if message['ok'] else 'no'}: {message['message']}"

            assert await answer(op="policy", policy="RELIABILITY_FOCUS") == (
                "ok: policy is RELIABILITY_FOCUS"
            )
            assert (await answer(op="policy", policy="x")).startswith("no: policy 'x' is none of")
            assert (await answer(op="mode", engine=ENGINES[1], mode="burst")).startswith("ok")
            await parameter_is(seen, f"/wireless_ros/{ENGINES[1]}/mode", "burst")
            assert (await answer(op="mode", engine="nose", mode="burst")).startswith("no")
            assert (await answer(op="nonsense")).startswith("no: not understood")
            stopped = await answer(op="component", name=ENGINES[2], action="stop")
            assert stopped == f"ok: {ENGINES[2]} is stopping"
            await until(lambda: seen.component(ENGINES[2]).state == "stopped", "the stop")


def fetched(url: str) -> str:
    with urllib.request.urlopen(url, timeout=30) as answer:
        return str(answer.read().decode())


async def test_services_actions_and_diagnostics_of_the_whole(
    master: Master, place: Path, seen: Watcher
) -> None:
    arrays: list[DiagnosticArray] = []
    policies: list[GlobalPolicy] = []
    grants: list[ResourceGrants] = []
    async with hub_process(master, place, *SYNTHETIC, **QUICK):
        node = seen.node
        await node.subscribe("/diagnostics", DiagnosticArray, arrays.append)
        await node.subscribe(
            "/wireless_ros/global_policy", GlobalPolicy, policies.append, qos=LATCHED
        )
        await node.subscribe(
            "/wireless_ros/resource_grants", ResourceGrants, grants.append, qos=LATCHED
        )
        await operating(seen)
        await until(lambda: grants and grants[-1].grants, "grants")
        grant = grants[-1].grants[0]
        assert (grant.link_id, grant.rnti) == ("4601", 0x4601)
        assert 1 <= grant.granted_prb <= grants[-1].total_prb

        quality = node.service_client("/wireless_ros/get_link_quality", GetLinkQuality)
        assert (await quality.call(GetLinkQualityRequest(rnti=0x4601))).found
        path = node.service_client("/wireless_ros/optimize_path", OptimizePath)
        assert (await path.call(OptimizePathRequest())).message
        change = node.service_client("/wireless_ros/reconfigure_engine", ReconfigureEngine)
        done = await change.call(
            ReconfigureEngineRequest(engine="cross_domain_engine", json='{"mode": "burst"}')
        )
        assert done.ok
        monitor = node.action_client("/wireless_ros/monitor_quality", MonitorQuality)
        goal = await monitor.send_goal(MonitorQualityGoal(rnti=0x4601, duration_s=1.5))
        assert (await goal.result()).samples > 0

        policy = node.service_client("/wireless_ros/set_global_policy", SetGlobalPolicy)
        assert not (await policy.call(SetGlobalPolicyRequest(policy="FASTER"))).ok
        assert (await policy.call(SetGlobalPolicyRequest(policy="RELIABILITY_FOCUS"))).ok
        updated = "Global Policy Updated: RELIABILITY_FOCUS"
        await until(lambda: policies and policies[-1].text == updated, "the policy")
        assert policies[-1].pinned

        def named(name: str) -> str:
            newest = arrays[-1].status if arrays else ()
            found = [item for item in newest if item.name == name]
            return found[0].message if found else ""

        await until(lambda: named("WirelessROS Hub") == "All systems operational", "diagnostics")
        assert named("WirelessROS Engine: radio_info_engine") == "Engine running normally"
        hub = arrays[-1].status[-1]
        values = {item.key: item.value for item in hub.values}
        assert values["Active Engines"] == "3"
        assert values["Total RNTIs"] == "1"
        events = node.service_client("/wireless_ros/get_system_events", GetSystemEvents)
        newest = (await events.call(GetSystemEventsRequest(limit=2))).events
        assert len(newest) == 2
        every = (await events.call(GetSystemEventsRequest())).events
        (number,) = (event.number for event in every if event.text == updated)
        # The newest: it, or what has happened since.
        assert newest[-1].number >= number
        await told(seen, updated)
        numbers = [event.number for event in seen.events]
        assert numbers == sorted(set(numbers))
