"""Two links to choose from: the hub takes one, couriers carry."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from support.hubs import Watcher, end_all, hub_process, watcher
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.errors import ConfigError
from simple_ros.msg.std_msgs import Int32
from simple_ros.msg.wireless_ros_msgs import PhyLayerMetrics
from simple_ros_hub.cells.courier import CourierCell
from simple_ros_master import Master

LONG_S = 60.0
TOPICS = ("_source:=/soft", "_sink:=/hard", "_type:=std_msgs/Int32")


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    end_all(tmp_path)


@asynccontextmanager
async def courier(master: Master, link: str, *words: str) -> AsyncIterator[CourierCell]:
    cell = CourierCell()
    arguments = Arguments.parse([f"_link:={link}", *TOPICS, *words])
    async with NodeHandle(
        f"wireless_ros/courier_{link}", master=master.address, arguments=arguments
    ) as node:
        task = asyncio.create_task(cell.run(node))
        try:
            yield cell
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


def events(seen: Watcher) -> list[str]:
    return [text for text in seen.texts() if text.startswith("Route")]


async def test_messages_take_the_link_that_works(master: Master, place: Path) -> None:
    config = place / "components.yaml"
    config.write_text("components: {ear: {cell: telemetry}}")
    quality = {"wifi": 0.9, "lte": 0.6}
    got: list[int] = []
    async with (
        watcher(master) as seen,
        courier(master, "wifi", "_first:=true") as wifi,
        courier(master, "lte") as lte,
    ):
        node = seen.node
        metrics = await node.advertise("/wireless_ros/phy_layer_metrics", PhyLayerMetrics)
        numbers = await node.advertise("/soft", Int32)
        await node.subscribe("/hard", Int32, lambda message: got.append(message.data))
        sent = 0

        def send() -> None:
            nonlocal sent
            sent += 1
            numbers.publish(Int32(data=sent))
            for link, value in quality.items():
                metrics.publish(PhyLayerMetrics(link_id=link, link_quality=value))

        node.create_timer(0.05, lambda _: send())
        # Nobody has told a route yet: the first one carries.
        await until(lambda: len(got) > 5, "messages", LONG_S)
        assert lte.messages_out == 0
        words = ("--config", str(config))
        async with hub_process(master, place, *words, discovery_time=0.1, routes="wifi,lte"):
            await until(lambda: wifi.route == lte.route == "wifi", "a route", LONG_S)
            await until(lambda: seen.operates, "operation", LONG_S)
            await until(lambda: "wifi" in wifi.route and sent > 20, "links", LONG_S)
            quality["wifi"] = 0.1
            await until(lambda: lte.messages_out > 5, "messages by the other link", LONG_S)
            # Events come another way than routes and messages do.
            await until(lambda: events(seen), "the event")
            assert events(seen) == ["Route lte is taken: wifi has quality 0.10"]
            quality["wifi"] = 0.9
            came = wifi.messages_out
            await until(lambda: wifi.messages_out > came + 5, "the way back", LONG_S)
            await until(lambda: len(events(seen)) > 1, "the event")
            assert events(seen)[1:] == ["Route wifi is taken: wifi is good again"]
        # At a change one may be missing or come twice, not more.
        assert len(set(got)) > 0.8 * (got[-1] - got[0])
        assert len(got) - len(set(got)) < 5


async def test_a_courier_without_a_link_says_so(master: Master) -> None:
    cell = CourierCell()
    arguments = Arguments.parse(["_source:=/soft", "_sink:=/hard", "_type:=Int32"])
    async with NodeHandle("alone", master=master.address, arguments=arguments) as node:
        with pytest.raises(ConfigError, match="'link'"):
            await cell.run(node)
