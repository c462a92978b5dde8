"""``simple-ros demo wireless``: drives without engines and with them, leaves a plot and nothing else."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import psutil
import pytest
from support.processes import python
from websockets import Subprotocol
from websockets.asyncio.client import connect

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments

DEMO = ("-m", "simple_ros.cli.main", "demo", "wireless")


async def topics_of_the_layout() -> set[str]:
    async with python(*DEMO, "--layout") as process:
        out, _ = await process.process.communicate()
    panels = json.loads(out)["configById"].values()
    plotted = {path["value"].partition(".")[0] for one in panels for path in one.get("paths", ())}
    shown = {topic for one in panels for topic in one.get("topics", ())}
    raw = {one["topicPath"] for one in panels if "topicPath" in one}
    pictures = {one["imageMode"].get("imageTopic") for one in panels if "imageMode" in one}
    return plotted | shown | raw | (pictures - {None})


@pytest.mark.timeout(240)
async def test_both_runs_are_driven_seen_and_plotted(tmp_path: Path) -> None:
    wanted, master = await topics_of_the_layout(), ""
    plot = tmp_path / "both.svg"
    words = ("--laps", "2", "--speed", "20", "--plot", str(plot))
    ports = ("--dashboard", "0", "--foxglove-port", "0")
    async with python(*DEMO, *words, *ports) as process:
        while not (link := await process.line(60)).startswith("in Foxglove: open "):
            pass
        port = int(link.partition(";")[0].rpartition("%3A")[2])
        address, protocol = f"ws://127.0.0.1:{port}", Subprotocol("foxglove.sdk.v1")
        async with connect(address, subprotocols=[protocol]) as app:
            while wanted:
                said = await asyncio.wait_for(app.recv(), 30)
                channels = json.loads(said).get("channels", ()) if isinstance(said, str) else ()
                wanted -= {channel["topic"] for channel in channels}
        while not master:
            master = (await process.line(60)).partition("SIMPLE_ROS_MASTER=")[2].partition(" ")[0]
        async with NodeHandle("person", master=master, arguments=Arguments()) as person:
            while "engines on" not in await process.line(60):
                pass
            await person.set_parameters({"/wireless_demo/engines": False})
            while "engines off" not in await process.line(60):
                pass
            await person.set_parameters({"/wireless_demo/engines": True})
        while "engines on" not in await process.line(60):
            pass
        started = psutil.Process(process.pid).children(recursive=True)
        assert len(started) >= 10
        assert await process.wait(60) == 0
    _, alive = await asyncio.to_thread(psutil.wait_procs, started, 10)
    assert not alive
    assert "dead zone" in plot.read_text()
    seconds = json.loads(plot.with_suffix(".json").read_text())
    on = [one for one in seconds if one["engines"]]
    assert {one["engines"] for one in seconds} == {False, True}
    assert any(one["pose_age_ms"] for one in on)
    assert any(one["pictures_hz"] for one in on)
