from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from support.bags import SECOND, START_NS, make_bag, text, texts
from support.foxglove import FoxClient, bridged, connected
from support.waiting import until

from simple_ros import aio
from simple_ros.bag import Bag, BagExists, NothingToPlay
from simple_ros.foxglove import (
    Access,
    BagPlayback,
    PlaybackOptions,
    Recording,
    ServerOptions,
)
from simple_ros.msg.diagnostic_msgs import DiagnosticArray, DiagnosticStatus
from simple_ros.msg.std_msgs import String
from simple_ros_master import Master

FAST = PlaybackOptions(speed=100.0, paused=True)


@pytest.fixture
def bag(tmp_path: Path) -> Iterator[Bag]:
    """10 s of a number every 0.1 s, and a latched map at the beginning."""
    messages = [("map", 0.0, "map")] + [("count", n / 10, str(n)) for n in range(101)]
    with Bag(make_bag(tmp_path / "a.mcap", messages, latched=["map"])) as opened:
        yield opened


@asynccontextmanager
async def played(bag: Bag, options: PlaybackOptions) -> AsyncIterator[BagPlayback]:
    playback = BagPlayback([bag], ServerOptions(), options)
    async with playback.server.listening(port=0):
        running = asyncio.create_task(playback.run())
        try:
            yield playback
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)


async def control(
    client: FoxClient,
    *,
    play: bool,
    speed: float = 100.0,
    seek_s: float | None = None,
    request: str = "",
) -> None:
    stamp = 0 if seek_s is None else START_NS + round(seek_s * SECOND)
    head = struct.pack("<BBfBQI", 3, not play, speed, seek_s is not None, stamp, len(request))
    await client.socket.send(head + request.encode())


def states(client: FoxClient) -> list[tuple[int, float, float, int, str]]:
    """Status, seconds after the start, speed, whether it jumped, and the request's id."""
    found = []
    for frame in client.binary:
        if frame[0] == 5:
            status, now, speed, jumped, _ = struct.unpack_from("<BQfBI", frame, 1)
            found.append((status, (now - START_NS) / SECOND, speed, jumped, frame[19:].decode()))
    return found


def said(client: FoxClient, topic: str) -> list[str]:
    return [String.FromString(data).data for data in client.on(topic)]


async def test_from_the_beginning_to_the_end(bag: Bag) -> None:
    async with played(bag, FAST) as playback, connected(playback.server.port) as client:
        info = client.heard("serverInfo")[0]
        assert sorted(info["capabilities"]) == ["playbackControl", "time"]
        assert info["dataStartTime"] == {"sec": START_NS // SECOND, "nsec": 0}
        assert info["dataEndTime"] == {"sec": START_NS // SECOND + 10, "nsec": 0}
        await client.subscribe("/count")
        await until(lambda: playback.server.is_wanted(client.subscription_channel("/count")))
        await control(client, play=True, request="a")
        await until(lambda: len(said(client, "/count")) == 101)
        assert said(client, "/count") == [str(n) for n in range(101)]
        assert [stamp for _, stamp, _ in client.messages] == [
            START_NS + n * SECOND // 10 for n in range(101)
        ]
        await until(lambda: states(client)[-1][:2] == (3, 10.0), "the end is told")
        assert states(client)[0][0] == 0
        assert states(client)[0][4] == "a"
        assert client.times == sorted(client.times)
        await control(client, play=True)
        await until(lambda: len(said(client, "/count")) == 202, "again from the beginning")


async def test_seeking_and_pausing(bag: Bag) -> None:
    async with played(bag, FAST) as playback, connected(playback.server.port) as client:
        await client.subscribe("/count")
        await client.subscribe("/map")
        await control(client, play=False, seek_s=9.5, request="jump")
        await until(lambda: states(client))
        assert states(client)[0] == (1, 9.5, 100.0, 1, "jump")
        await until(lambda: said(client, "/map") == ["map"], "what was latched before")
        await until(lambda: said(client, "/count") == ["95"], "what stands there")
        await control(client, play=True)
        await until(lambda: said(client, "/count") == ["95", "96", "97", "98", "99", "100"])
        await until(lambda: states(client)[-1][0] == 3)
        await until(lambda: client.times[-1] == START_NS + 10 * SECOND)
        await control(client, play=False, seek_s=9.9)
        await until(lambda: client.times[-1] == START_NS + round(9.9 * SECOND), "time goes back")
        await control(client, play=True)
        await until(lambda: said(client, "/count")[6:] == ["99", "100"])


async def test_between_messages_the_last_one_stands(bag: Bag) -> None:
    async with played(bag, FAST) as playback, connected(playback.server.port) as client:
        await client.subscribe("/count")
        for seek_s, wanted in [(5.05, "50"), (2.0, "20"), (7.19, "71"), (0.0, "0"), (10.0, "100")]:
            await control(client, play=False, seek_s=seek_s)
            await until(lambda wanted=wanted: said(client, "/count")[-1:] == [wanted], wanted)
        stamps = [stamp for _, stamp, _ in client.messages]
        assert stamps[-3] == START_NS + 71 * SECOND // 10, "with the time at which it came"


async def test_jumps_in_quick_succession(bag: Bag) -> None:
    async with played(bag, FAST) as playback, connected(playback.server.port) as client:
        await client.subscribe("/count")
        for tenth in range(100, 0, -1):
            await control(client, play=False, seek_s=tenth / 10)
        await until(lambda: said(client, "/count")[-1:] == ["1"])
        await control(client, play=True)
        await until(lambda: said(client, "/count")[-1] == "100")
        played_on = said(client, "/count")[said(client, "/count").index("1") :]
        assert played_on == [str(n) for n in range(1, 101)]


async def test_who_begins_to_look_while_paused_sees_what_stands(bag: Bag) -> None:
    async with played(bag, FAST) as playback, connected(playback.server.port) as client:
        await control(client, play=False, seek_s=4.2)
        await until(lambda: states(client))
        await client.subscribe("/count")
        await until(lambda: said(client, "/count") == ["42"])
        async with connected(playback.server.port) as late:
            await late.subscribe("/count")
            await until(lambda: said(late, "/count") == ["42"])
        assert said(client, "/count") == ["42"], "told once"
        await control(client, play=True)
        await until(lambda: len(said(client, "/count")) == 59)
        assert said(client, "/count") == [str(n) for n in range(42, 101)]


async def test_all_that_is_latched_stands_not_only_the_last(tmp_path: Path) -> None:
    messages = [("tf_static", 0.0, "a"), ("tf_static", 0.1, "b"), ("count", 5.0, "5")]
    with Bag(make_bag(tmp_path / "a.mcap", messages, latched=["tf_static"])) as bag:
        async with played(bag, FAST) as playback, connected(playback.server.port) as client:
            await client.subscribe("/tf_static")
            await control(client, play=False, seek_s=4)
            await until(lambda: said(client, "/tf_static") == ["a", "b"])


async def test_looking_back_disturbs_no_playing(tmp_path: Path) -> None:
    messages = [("map", 0.0, "map")]
    messages += [("count", n / 1000, f"{n:05} {'x' * 500}") for n in range(5000)]
    with Bag(make_bag(tmp_path / "a.mcap", messages, latched=["map"])) as bag:
        async with played(bag, PlaybackOptions(speed=5.0, paused=True)) as playback:
            async with connected(playback.server.port) as client:
                await client.subscribe("/count")
                await until(
                    lambda: playback.server.is_wanted(client.subscription_channel("/count"))
                )
                await control(client, play=True, speed=5.0)
                while len(said(client, "/count")) < 5000:
                    async with connected(playback.server.port) as late:
                        await late.subscribe("/map")
                        await until(lambda late=late: said(late, "/map") == ["map"])
                assert said(client, "/count") == [text for _, _, text in messages[1:]]


async def test_a_late_client_gets_latched_messages(bag: Bag) -> None:
    async with played(bag, FAST) as playback:
        async with connected(playback.server.port) as client:
            await client.subscribe("/count")
            await control(client, play=True, seek_s=5)
            await until(lambda: len(said(client, "/count")) == 51)
        async with connected(playback.server.port) as late:
            await late.subscribe("/map")
            await until(lambda: said(late, "/map") == ["map"])


async def test_it_begins_when_somebody_comes_and_loops(bag: Bag) -> None:
    options = PlaybackOptions(speed=200.0, loop=True)
    async with played(bag, options) as playback, connected(playback.server.port) as client:
        await client.subscribe("/count")
        await until(lambda: said(client, "/count").count("100") >= 2)
        sessions = {info["sessionId"] for info in client.heard("serverInfo")}
        assert len(sessions) >= 2
        assert not states(client), "only for clients that know these frames"


async def test_a_client_of_the_older_subprotocol(bag: Bag) -> None:
    async with (
        played(bag, FAST) as playback,
        connected(playback.server.port, ("foxglove.websocket.v1",)) as client,
    ):
        assert "dataStartTime" not in client.heard("serverInfo")[0]


async def test_speeds_that_make_no_sense(bag: Bag) -> None:
    async with played(bag, FAST) as playback, connected(playback.server.port) as client:
        for speed in (0.0, -1.0, float("nan"), float("inf")):
            await control(client, play=False, speed=speed)
        await until(lambda: len(client.statuses()) == 4)
        assert playback.state.speed == 100.0


async def test_nothing_to_play(tmp_path: Path, bag: Bag) -> None:
    with pytest.raises(NothingToPlay, match="--topics"):
        BagPlayback([bag], ServerOptions(access=Access.made("^nothing")), FAST)


# -- recording -------------------------------------------------------------------------------------


async def test_recording_what_clients_see(master: Master, tmp_path: Path) -> None:
    path = tmp_path / "seen.mcap"
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        recording = Recording(path)
        bridge.server.tap(recording)
        with pytest.raises(BagExists):
            Recording(path)
        seen = await node.advertise("seen", String)
        unseen = await node.advertise("unseen", String)
        await client.subscribe("/seen")
        await seen.wait_for_subscribers(1, timeout=30)
        unseen.publish(String(data="no"))
        for number in range(20):
            seen.publish(String(data=str(number)))
        await until(lambda: len(client.on("/seen")) == 20)
        bridge.server.tap(None)
        assert await recording.finish() == 20
    assert texts(path) == [str(n) for n in range(20)]
    with Bag(path) as bag:
        (topic,) = bag.topics.values()
        assert (topic.name, topic.msg_type) == ("seen", "std_msgs.String")
        (first, *_) = bag.messages()
        assert first.data == text("0")
        json.dumps(bag.metadata())


async def test_diagnostics_as_the_panel_asks_for_them(master: Master, tmp_path: Path) -> None:
    path = tmp_path / "seen.mcap"
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        bridged(master.address) as bridge,
        connected(bridge.server.port) as client,
    ):
        recording = Recording(path)
        bridge.server.tap(recording)
        publisher = await node.advertise("diagnostics", DiagnosticArray)
        await client.subscribe("/diagnostics")
        decoder = client.decoder("/diagnostics")
        assert decoder.DESCRIPTOR.full_name == "ros.diagnostic_msgs.DiagnosticArray"
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(DiagnosticArray(status=[DiagnosticStatus(name="motor")]))
        await until(lambda: client.on("/diagnostics"))
        seen = decoder.FromString(client.on("/diagnostics")[0])
        assert seen.header.HasField("stamp")  # type: ignore[attr-defined]
        assert seen.status[0].name == "motor"  # type: ignore[attr-defined]
        bridge.server.tap(None)
        assert await recording.finish() == 1
    with Bag(path) as bag:
        (topic,) = bag.topics.values()
        assert (topic.name, topic.msg_type) == ("diagnostics", "diagnostic_msgs.DiagnosticArray")
        (message,) = bag.messages()
        assert DiagnosticArray.FromString(message.data).status[0].name == "motor"
