"""``simple-ros demo robot_xl``: drives, can be looked at, leaves nothing behind."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path

import psutil
import pytest
from support.processes import python
from support.waiting import until
from websockets import Subprotocol
from websockets.asyncio.client import connect

from simple_ros_master import Master

DEMO = ("-m", "simple_ros.cli.main", "demo", "robot_xl")


def environment(master: Master, tmp_path: Path) -> dict[str, str]:
    directories = {"XDG_STATE_HOME": str(tmp_path), "SIMPLE_ROS_LOG_DIR": str(tmp_path / "log")}
    return {"SIMPLE_ROS_MASTER": master.address, **directories}


@pytest.mark.timeout(240)
async def test_it_drives_and_apps_find_what_the_layout_shows(
    master: Master, tmp_path: Path
) -> None:
    wanted = await topics_of_the_layout()
    words = (*DEMO, "--foxglove-port", "0")
    async with python(*words, **environment(master, tmp_path)) as process:
        while not (link := await process.line(60)).startswith("in Foxglove: open "):
            pass
        port = int(link.partition(";")[0].rpartition("%3A")[2])
        address, protocol = f"ws://127.0.0.1:{port}", Subprotocol("foxglove.sdk.v1")
        async with connect(address, subprotocols=[protocol]) as app:
            while wanted:
                said = await asyncio.wait_for(app.recv(), 30)
                channels = json.loads(said).get("channels", ()) if isinstance(said, str) else ()
                wanted -= {channel["topic"] for channel in channels}
        while True:
            line = await process.line(60)
            if "deg" in line and (float(line.split()[3]) > 0.3 or float(line.split()[8]) > 45):
                break
        process.signal(signal.SIGINT)
        assert await process.wait() == 0


@pytest.mark.timeout(240)
async def test_it_ends_after_its_time(master: Master, tmp_path: Path) -> None:
    words = (*DEMO, "--no-foxglove", "--duration", "0.5")
    async with python(*words, **environment(master, tmp_path)) as process:
        assert await process.wait(60) == 0


async def topics_of_the_layout() -> set[str]:
    async with python(*DEMO, "--layout") as process:
        out, _ = await process.process.communicate()
    panels = json.loads(out)["configById"].values()
    plotted = {path["value"] for panel in panels for path in panel.get("paths", ())}
    shown = {topic for panel in panels for topic in panel.get("topics", ())}
    raw = {panel["topicPath"] for panel in panels if "topicPath" in panel}
    return {path.partition(".")[0] for path in plotted} | shown | raw


@pytest.mark.timeout(240)
async def test_killed_with_minus_nine_it_leaves_nothing_running(
    master: Master, tmp_path: Path
) -> None:
    words = (*DEMO, "--no-foxglove")
    async with python(*words, **environment(master, tmp_path)) as process:
        while "deg" not in await process.line(60):
            pass
        started = psutil.Process(process.pid).children(recursive=True)
        names = [" ".join(it.cmdline()) for it in started]
        for part in ("launch", "pico simulator", "simple_ros_firmware_bridge", "pico controller"):
            assert any(part in name for name in names), part
        process.signal(signal.SIGKILL)
        await until(
            lambda: not any(it.is_running() and it.status() != "zombie" for it in started),
            "that all have ended",
        )
