"""The launch files of the wireless engines."""

from __future__ import annotations

import json
import signal
from importlib.resources import files
from pathlib import Path

import pytest
from support.cli import PROGRAM, run
from support.engines import user
from support.processes import python
from support.waiting import until

from simple_ros.msg.wireless_ros_msgs import EngineStatus, TransmissionStrategy
from simple_ros_master import Master

FILE = str(files("simple_ros_engines") / "launch" / "wireless_ros.yaml")
ENGINES = {"cross_domain_engine", "physical_adaptive_engine", "radio_info_engine"}


@pytest.mark.parametrize("mode", ["realtime", "burst", "optimized"])
async def test_each_mode_reaches_each_engine(mode: str) -> None:
    code, text, errors = await run(
        "launch",
        FILE,
        f"mode:={mode}",
        "budget:=7",
        "bridge:=true",
        "link:=wlan0",
        "--show",
        "--json",
    )
    assert (code, errors) == (0, "")
    found = {item["name"].rpartition("/")[2]: item for item in json.loads(text)["processes"]}
    assert set(found) == {*ENGINES, "topic_bridge"}
    for name in ENGINES:
        words = json.dumps(found[name])
        assert f"_mode:={mode}" in words
        assert "_budget:=7" in words
        assert "_link:=wlan0" in words
    assert "_mode" not in json.dumps(found["topic_bridge"])


async def test_without_recovery_nothing_starts_again() -> None:
    _, with_it, _ = await run("launch", FILE, "--show")
    _, without, _ = await run("launch", FILE, "recovery_enabled:=false", "--show")
    assert with_it.count("respawn: on failure") == 3
    assert "respawn: on failure" not in without


@pytest.mark.parametrize(
    ("word", "why"), [("mode:=fast", "realtime, burst, optimized"), ("scs_khz:=20", "15, 30, 60")]
)
async def test_what_has_no_meaning_is_refused(word: str, why: str) -> None:
    code, _, errors = await run("launch", FILE, word, "--show")
    assert code != 0
    assert why in errors


@pytest.mark.timeout(240)
@pytest.mark.parametrize(("mode", "one_process"), [("burst", "false"), ("optimized", "true")])
async def test_they_run(master: Master, tmp_path: Path, mode: str, one_process: str) -> None:
    statuses: dict[str, EngineStatus] = {}
    strategies: list[TransmissionStrategy] = []

    def told(message: EngineStatus) -> None:
        statuses[message.name.rpartition("/")[2]] = message

    async with user(master) as node:
        await node.subscribe("/wireless_ros/status", EngineStatus, told)
        topic = "/wireless_ros/transmission_strategy"
        await node.subscribe(topic, TransmissionStrategy, strategies.append)
        async with python(
            *PROGRAM,
            "launch",
            FILE,
            "--plain",
            f"mode:={mode}",
            "burst_interval:=0.2",
            "source:=synthetic",
            'source_options:={"links": 2}',
            f"one_process:={one_process}",
            SIMPLE_ROS_MASTER=master.address,
            SIMPLE_ROS_LOG_DIR=str(tmp_path),
        ) as launch:
            await until(lambda: set(statuses) == ENGINES and strategies, "all engines", 60)
            await until(lambda: {s.link_id for s in strategies} == {"4601", "4602"}, "both links")
            assert {status.mode for status in statuses.values()} == {mode}
            launch.signal(signal.SIGINT)
            assert await launch.wait() == 0
