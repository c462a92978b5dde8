"""``simple-ros demo turtlesim`` as a user runs it: the whole story, its pages, and nothing left behind."""

from __future__ import annotations

import asyncio
import json
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from urllib.request import urlopen

import psutil
import pytest
from support.processes import Process, python
from support.waiting import until
from websockets import Subprotocol
from websockets.asyncio.client import connect

LIMIT_S = 150.0
"""A dozen programs start, and a story is played: that takes its time where others want the processor, too."""
DEMO = ("-m", "simple_ros.cli.main", "demo", "turtlesim")
ANY = ("--plain", "--port", "0", "--turtles-port", "0", "--scores-port", "0")


def has_ended(process: psutil.Process) -> bool:
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


class Told:
    """What a demo prints."""

    def __init__(self, process: Process) -> None:
        self._process = process
        self._lines: list[str] = []
        self._next = 0

    async def has(self, text: str) -> str:
        """What follows a text, whenever it was or will be printed."""
        known = self._find(text, 0)
        while known is None:
            self._lines.append(await self._process.line(LIMIT_S))
            known = self._find(text, len(self._lines) - 1)
        return self._lines[known].partition(text)[2]

    async def then(self, text: str) -> None:
        """Wait for a text after the one before."""
        async with asyncio.timeout(LIMIT_S):
            while (known := self._find(text, self._next)) is None:
                self._lines.append(await self._process.line(LIMIT_S))
        self._next = known + 1

    def _find(self, text: str, first: int) -> int | None:
        numbers = range(first, len(self._lines))
        return next((number for number in numbers if text in self._lines[number]), None)


@asynccontextmanager
async def demo(*words: str) -> AsyncIterator[tuple[Process, list[psutil.Process]]]:
    """A demo whose programs run, and its children."""
    async with python(*DEMO, *ANY, *words) as process:
        await Told(process).has("scores: ")
        children = psutil.Process(process.pid).children(recursive=True)
        assert len(children) >= 8
        yield process, children


async def topics_of_the_layout() -> set[str]:
    async with python(*DEMO, "--layout") as process:
        out, _ = await process.process.communicate()
    panels = json.loads(out)["configById"].values()
    plotted = {path["value"].partition(".")[0] for one in panels for path in one.get("paths", ())}
    shown = {topic for one in panels for topic in one.get("topics", ())}
    return plotted | shown | {one["topicPath"] for one in panels if "topicPath" in one}


async def channels(link: str, wanted: set[str]) -> None:
    """Wait until a bridge offers topics."""
    port = int(link.partition(";")[0].rpartition("%3A")[2])
    missing = set(wanted)
    address, protocol = f"ws://127.0.0.1:{port}", Subprotocol("foxglove.sdk.v1")
    async with connect(address, subprotocols=[protocol]) as app, asyncio.timeout(40):
        while missing:
            said = await app.recv()
            told = json.loads(said).get("channels", ()) if isinstance(said, str) else ()
            missing -= {channel["topic"] for channel in told}


@pytest.mark.slow
@pytest.mark.timeout(500)
async def test_the_whole_story_is_played_and_nothing_is_left(tmp_path: Path) -> None:
    wanted, bag = await topics_of_the_layout(), tmp_path / "story.mcap"
    words = ("--pace", "3", "--setup", "0.3", "--rounds", "1", "--foxglove-port", "0")
    async with python(*DEMO, *ANY, *words, "--record", str(bag)) as process:
        told = Told(process)
        for text in ("turtles: ", "scores: "):
            url = await told.has(text)
            page = await asyncio.to_thread(lambda url=url: urlopen(url, timeout=10).read())
            assert b"<!doctype html>" in page
        await channels(await told.has("in Foxglove: open "), wanted)
        children = psutil.Process(process.pid).children(recursive=True)
        assert len(children) >= 11
        for topic in ("turtle1/pose", "turtle2/cmd_vel"):
            await told.has(f"{topic}_qos is relayed as {topic}")
            await told.has(f"flow       {topic}: TCP 127.0.0.1:")
            await told.has(f"request    {topic} needs ")
            await told.has(f"bearer     {topic}: QCI ")
        for happening in (
            "the maximizer begins",
            "the cell is loaded: ",
            "downgrade ",
            "request ",
            "bearer ",
            "the cell is loaded even more: ",
            "50 % of its speed, 50 % of its rate",
            "drives at 0.50 m/s with 10 commands a second now",
            "MOS ",
            "the cell has recovered",
            "may be as fast as it was made for",
            "drives at 1.00 m/s with 20 commands a second now",
            "the end: the network ran short and recovered once",
        ):
            await told.then(happening)
        assert await process.wait(20) == 0
    await until(lambda: all(map(has_ended, children)), "nothing is left", 10)
    assert bag.stat().st_size > 10_000


@pytest.mark.timeout(240)
async def test_it_ends_in_time_and_says_so() -> None:
    async with python(*DEMO, *ANY, "--no-foxglove", "--duration", "1") as process:
        await Told(process).has("the end: the network ran short and recovered 0 times")
        assert await process.wait(20) == 0
        assert await process.errors() == ""


@pytest.mark.timeout(240)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_a_signal_ends_all_of_it(number: int) -> None:
    async with demo("--no-foxglove") as (process, children):
        process.signal(number)
        assert await process.wait(20) == 0
        assert all(map(has_ended, children))
        assert await process.errors() == ""


@pytest.mark.timeout(240)
async def test_when_it_is_killed_nothing_stays_either() -> None:
    async with demo("--no-foxglove") as (process, children):
        process.signal(signal.SIGKILL)
        await until(lambda: all(map(has_ended, children)), "all have ended", 20)


@pytest.mark.timeout(240)
async def test_a_program_that_ends_is_named() -> None:
    async with demo("--no-foxglove") as (process, children):
        mock = next(child for child in children if "mock" in child.cmdline())
        mock.kill()
        assert await process.wait(30) == 1
        assert (await process.errors()).startswith("error: mock network ")
        assert all(map(has_ended, children))
