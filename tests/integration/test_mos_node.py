"""The node of scores: what is published, and its page in a real browser."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from support.browser import BROWSER
from support.devtools import opened
from support.engines import at_work, user
from support.waiting import until
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin

from simple_ros.aio import NodeHandle
from simple_ros.msg.network_exposure_msgs import (
    FlowQosArray,
    UniqueTopicFlows,
    UniqueTopicFlowStats,
)
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, Mos
from simple_ros.qos import LATCHED
from simple_ros_engines.network_exposure.mos.node import MeanOpinionScoring
from simple_ros_master import Master

TOPICS = ("turtle1/pose", "turtle1/cmd_vel")


async def relayed(node: NodeHandle) -> None:
    """Say what a relay says."""
    flows = await node.advertise("unique_network_flow", UniqueTopicFlows, qos=LATCHED)
    message = UniqueTopicFlows(relay="relay")
    for topic in TOPICS:
        message.flows.add(topic=topic)
    flows.publish(message)
    stats = await node.advertise("unique_network_flow_stats", UniqueTopicFlowStats)
    told = UniqueTopicFlowStats(relay="relay")
    told.stats.add(topic=TOPICS[0], window_rate=62.5, window_bandwidth=1500.0, window_jitter=0.0012)
    node.create_timer(0.1, lambda _: stats.publish(told))


async def answered(socket: Any, **said: Any) -> dict[str, Any]:
    """What the page is told, in between states."""
    await socket.send(json.dumps(said))
    async for text in socket:
        message: dict[str, Any] = json.loads(text)
        if message["op"] == "answer":
            return message
    raise AssertionError("closed")


async def test_stars_are_published_said_again_and_taken_back(master: Master) -> None:
    heard: list[Mos] = []
    engine = MeanOpinionScoring()
    async with user(master) as node, at_work(engine, master, page="127.0.0.1:0"):
        await node.subscribe("/MOS", Mos, heard.append)
        await relayed(node)
        await until(lambda: engine.url and engine.board.topics.keys() >= set(TOPICS))
        async with connect(engine.url.replace("http", "ws") + "feed") as socket:
            done = await answered(socket, op="group", name="left", topics=list(TOPICS))
            assert done["ok"], done
            assert (await answered(socket, op="rate", name="left", stars=4))["ok"]
            await until(lambda: len(heard) >= 2, "said again")
            first = heard[0]
            assert (first.identifier, first.group, first.score) == (Mos.HUMAN, "left", 4.0)
            assert tuple(first.topics) == TOPICS
            heard.clear()
            await answered(socket, op="ungroup", name="left")
            await until(lambda: heard and heard[-1].score == 0, "taken back")
            refused = await answered(socket, op="rate", name="left", stars=4)
            assert (refused["ok"], refused["message"]) == (False, "there is no group 'left'")
            for nonsense in ("[]", "{", "{}", '{"op": 1, "name": "x"}'):
                await socket.send(nonsense)
            assert not (await answered(socket, op="fly", name="x"))["ok"]


async def test_a_persons_score_counts_before_a_programs(master: Master) -> None:
    engine = MeanOpinionScoring()
    async with user(master) as node, at_work(engine, master, page="0"):
        scores = await node.advertise("/MOS", Mos)
        await relayed(node)
        await until(lambda: engine.url and engine.board.topics)
        automatic = Mos(identifier=Mos.AUTOMATIC, group="turtle1", topics=TOPICS, score=4.9)
        node.create_timer(0.05, lambda _: scores.publish(automatic))

        def shown() -> tuple[float | None, str | None]:
            pose = next(one for one in engine.state()["topics"] if one["name"] == TOPICS[0])
            return pose["score"], pose["judge"]

        await until(lambda: shown() == (4.9, "automatic"), "the program's")
        async with connect(engine.url.replace("http", "ws") + "feed") as socket:
            await answered(socket, op="group", name="mine", topics=[TOPICS[0]])
            await answered(socket, op="rate", name="mine", stars=2)
            await until(lambda: shown() == (2.0, "human"), "the person's")
            await answered(socket, op="withdraw", name="mine")
            await until(lambda: shown() == (4.9, "automatic"), "the program's again")


async def test_it_shows_what_the_network_gives_and_asks(master: Master) -> None:
    engine = MeanOpinionScoring()
    async with user(master) as node, at_work(engine, master, page="0"):
        await relayed(node)
        states = await node.advertise("network_flow_state", FlowQosArray, qos=LATCHED)
        asking = await node.advertise("application_adaptation_request", AdaptationRequest)
        told = FlowQosArray()
        told.flows.add(topic=TOPICS[0], state="degraded", qci=83, applied_qci=9)
        told.flows.add(topic=TOPICS[0], state="active", qci=83)
        told.flows.add(topic=TOPICS[1], state="active", qci=84)
        states.publish(told)
        await until(lambda: asking.subscriber_count)
        request = AdaptationRequest(
            group="turtle1", speed_factor=0.5, rate_factor=0.5, reason="why", requester="m"
        )
        asking.publish(request)
        shown = {"group": "turtle1", "speed": 0.5, "rate": 0.5, "reason": "why"}
        await until(lambda: engine.state()["asked"] == [shown])

        def network() -> dict[str, str]:
            return {one["name"]: one["network"] for one in engine.state()["topics"]}

        await until(lambda: network() == {TOPICS[0]: "QCI 9 instead of 83", TOPICS[1]: "QCI 84"})
        assert not engine.state()["simulated"]
        states.publish(FlowQosArray(is_simulated=True))
        await until(lambda: network() == dict.fromkeys(TOPICS, ""), "released")
        assert engine.state()["simulated"]
        asking.publish(AdaptationRequest(speed_factor=1, rate_factor=1, requester="m"))
        asking.publish(
            AdaptationRequest(group="turtle1", speed_factor=1, rate_factor=1, requester="m")
        )
        await until(lambda: not engine.state()["asked"])


async def test_stars_may_end_by_themselves(master: Master) -> None:
    heard: list[Mos] = []
    engine = MeanOpinionScoring()
    async with user(master) as node, at_work(engine, master, page="0", valid_s=0.3):
        await node.subscribe("/MOS", Mos, heard.append)
        await relayed(node)
        await until(lambda: engine.url and engine.board.topics)
        async with connect(engine.url.replace("http", "ws") + "feed") as socket:
            await answered(socket, op="group", name="g", topics=[TOPICS[0]])
            await answered(socket, op="rate", name="g", stars=5)
            await until(lambda: heard and heard[-1].score == 0, "the end of the stars")


async def test_a_strange_page_may_not_and_a_taken_port_stops_nothing(master: Master) -> None:
    first, second = MeanOpinionScoring(), MeanOpinionScoring()
    async with user(master) as node, at_work(first, master, page="0"):
        await relayed(node)
        await until(lambda: first.url)
        feed = first.url.replace("http", "ws") + "feed"
        with pytest.raises(InvalidStatus, match="403"):
            await connect(feed, origin=Origin("http://evil.example"))
        with pytest.raises(InvalidStatus, match="404"):
            await connect(first.url.replace("http", "ws") + "../secret")
        port = first.url.rstrip("/").rpartition(":")[2]
        async with at_work(second, master, name="second", page=port):
            await until(lambda: second.board.topics, "work without a page")
            assert second.url == ""


@pytest.mark.skipif(BROWSER is None, reason="needs chromium")
async def test_a_person_groups_and_gives_stars_in_a_browser(master: Master, tmp_path: Path) -> None:
    heard: list[Mos] = []
    engine = MeanOpinionScoring()
    async with user(master) as node, at_work(engine, master, page="127.0.0.1:0"):
        await node.subscribe("/MOS", Mos, heard.append)
        await relayed(node)
        await until(lambda: engine.url and engine.board.topics)
        async with opened(engine.url, tmp_path) as page:
            await page.becomes("document.querySelectorAll('#topics input').length === 2")
            await page.becomes("document.querySelector('#topics').textContent.includes('62.5')")
            await page.evaluate(
                "document.getElementById('group-name').value = 'kept';"
                "document.querySelector('#new-group button').click()"
            )
            answer = "document.getElementById('answer').textContent"
            await page.becomes(f"{answer} === 'a group needs topics'", "a refusal")
            assert await page.evaluate("document.getElementById('group-name').value") == "kept"
            for topic in TOPICS:
                await page.evaluate(
                    f"document.querySelector('#topics input[value=\"{topic}\"]').click()"
                )
            await page.evaluate(
                "document.getElementById('group-name').value = 'my <b>turtle</b>';"
                "document.querySelector('#new-group button').click()"
            )
            await page.becomes("document.querySelectorAll('.star').length === 5", "the stars")
            assert await page.evaluate("document.querySelectorAll('.group b').length") == 0
            await page.evaluate("document.querySelectorAll('.star')[3].click()")
            await page.becomes("document.querySelectorAll('.star.on').length === 4", "4 stars")
            await until(lambda: heard and heard[-1].score == 4, "the score on /MOS")
            assert set(heard[-1].topics) == set(TOPICS)
            await page.becomes("document.getElementById('scores').textContent.includes('human')")
