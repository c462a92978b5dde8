"""Engines as nodes: wrong input, silence, and parameters that are written as people write them."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import numpy as np
import pytest
from support.waiting import until

from simple_ros.arguments import Arguments
from simple_ros.engine import Engine
from simple_ros.errors import SimpleRosError
from simple_ros.msg.arrays import numpy_to_occupancy_grid
from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.nav_msgs import OccupancyGrid, Path
from simple_ros.msg.wireless_ros_msgs import (
    PhyLayerMetrics,
    ReconfigureEngine,
    ReconfigureEngineRequest,
)
from simple_ros.node import NodeHandle
from simple_ros.qos import LATCHED
from simple_ros_engines.cross_domain import node as cross_domain
from simple_ros_engines.cross_domain.node import CrossDomainEngine
from simple_ros_engines.physical_adaptive.node import PhysicalAdaptiveEngine
from simple_ros_engines.radio_information.node import RadioInformationEngine
from simple_ros_engines.radio_information.sources.store import StoreSource
from simple_ros_engines.radio_information.sources.transport import TransportSource
from simple_ros_master import Master


def handle(name: str, master: Master, *words: str) -> NodeHandle:
    return NodeHandle(name, master=master.address, arguments=Arguments.parse(list(words)))


@asynccontextmanager
async def at_work(engine: Engine, master: Master, *words: str) -> AsyncIterator[NodeHandle]:
    async with handle(engine.node_name, master, *words) as node:
        task = asyncio.create_task(engine.run(node))
        try:
            yield node
        finally:
            task.cancel()
            (ended,) = await asyncio.gather(task, return_exceptions=True)
            if ended is not None and not isinstance(ended, asyncio.CancelledError):
                raise ended


def metrics(**values: Any) -> PhyLayerMetrics:
    usual = {"link_id": "4601", "link_quality": 0.7, "reliability": 0.9, "available_bps": 12e6}
    return PhyLayerMetrics(**(usual | values))


async def test_a_place_gets_no_quality_that_was_measured_elsewhere(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = CrossDomainEngine()
    async with handle("user", master) as user, at_work(engine, master):
        maps = await user.advertise("/map", OccupancyGrid, qos=LATCHED)
        maps.publish(numpy_to_occupancy_grid(np.zeros((10, 10), np.int8), 1.0))
        poses = await user.advertise("/robot/pose", PoseStamped)
        told = await user.advertise("/wireless_ros/phy_layer_metrics", PhyLayerMetrics)
        await poses.wait_for_subscribers(1, timeout=30)
        await told.wait_for_subscribers(1, timeout=30)
        here = PoseStamped()
        here.pose.position.x = here.pose.position.y = 1.5
        await until(lambda: engine.quality is not None, "the map")
        quality = engine.quality
        assert quality is not None
        told.publish(metrics())
        await until(lambda: engine.newest, "the link")
        # As if the link had been silent for longer than that.
        monkeypatch.setattr(cross_domain, "_FRESH_S", -1.0)
        engine._pose(here)
        assert not quality.known_cells()
        monkeypatch.setattr(cross_domain, "_FRESH_S", 60.0)
        poses.publish(here)
        await until(quality.known_cells, "the place")
        assert quality.at(1.5, 1.5) == pytest.approx(0.7)


async def test_a_planned_path_is_answered_by_a_better_one(master: Master) -> None:
    engine = CrossDomainEngine()
    found: list[Path] = []
    async with AsyncExitStack() as stack:
        user = await stack.enter_async_context(handle("user", master))
        # Before the engine advertises it: then its publisher has this subscriber from the beginning.
        await user.subscribe("/wireless_ros/comm_aware_path", Path, found.append)
        await stack.enter_async_context(at_work(engine, master))
        maps = await user.advertise("/map", OccupancyGrid, qos=LATCHED)
        maps.publish(numpy_to_occupancy_grid(np.zeros((300, 300), np.int8), 0.05))
        plans = await user.advertise("/planned_path", Path)
        await plans.wait_for_subscribers(1, timeout=30)
        await until(lambda: engine.quality is not None, "the map")
        for x in (math.nan, 1e15, 14.0):
            path = Path(poses=[PoseStamped(), PoseStamped()])
            path.poses[0].pose.position.x = 1.0
            path.poses[1].pose.position.x = x
            plans.publish(path)
        await until(lambda: found and found[-1].poses[-1].pose.position.x == 14.0, "the way")


async def test_what_is_no_number_is_told_and_not_used(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    engine = PhysicalAdaptiveEngine()
    async with handle("user", master) as user, at_work(engine, master):
        told = await user.advertise("/wireless_ros/phy_layer_metrics", PhyLayerMetrics)
        await told.wait_for_subscribers(1, timeout=30)
        told.publish(metrics(snr_db=math.nan, channel_capacity=3.0))
        await until(lambda: engine.errors, "the error")
        assert not engine._views
        assert "phy_layer_metrics with snr_db that is no number" in caplog.text
        message = metrics(snr_db=12.0, channel_capacity=3.0)
        message.header.seq = 1
        told.publish(message)
        await until(lambda: engine._views, "a number")


async def test_an_engine_that_is_not_there_is_not_reconfigured(master: Master) -> None:
    words = ("_source:=synthetic", "_synthetic/period_s:=0.05")
    async with handle("user", master) as user, at_work(RadioInformationEngine(), master, *words):
        client = user.service_client(
            "/wireless_ros/reconfigure_engine", ReconfigureEngine, timeout=30
        )
        await client.wait_for_service(30)
        for engine, json in (
            ("cross_domain_engine", '{"mode": "x"}'),
            ("radio_info_engine", '{"nosuch": 1}'),
        ):
            answer = await client.call(ReconfigureEngineRequest(engine=engine, json=json))
            assert not answer.ok
            assert answer.message
        name = "/wireless_ros/cross_domain_engine/mode"
        with pytest.raises(SimpleRosError):
            await user.get_parameter(name)


async def test_a_long_interval_ends_when_it_is_changed_and_nothing_is_lost(master: Master) -> None:
    engine = CrossDomainEngine()
    words = ("_mode:=burst", "_burst_interval:=60.0")
    async with handle("user", master) as user, at_work(engine, master, *words) as node:
        told = await user.advertise("/wireless_ros/phy_layer_metrics", PhyLayerMetrics)
        await told.wait_for_subscribers(1, timeout=30)
        told.publish(metrics())
        await until(lambda: engine.newest, "the first")
        assert engine.processed == 0
        await node.set_parameters({"~budget": 7})
        await until(lambda: engine.processed == 1, "what waited")
        await node.set_parameters({"~burst_interval": 0.05})
        message = metrics()
        message.header.seq = 1
        told.publish(message)
        await until(lambda: engine.processed == 2, "the next burst", 20)


@pytest.mark.parametrize(
    "words",
    [
        ['_source_options:={"links": 2, "period_s": 0.02}'],
        ["_source_options:={links: 2, period_s: 0.02}"],
        ["_source_options/links:=2", "_source_options/period_s:=0.02"],
        ["_synthetic/links:=2", "_synthetic/period_s:=0.02"],
    ],
)
async def test_options_as_people_write_them(master: Master, words: list[str]) -> None:
    engine = RadioInformationEngine()
    async with at_work(engine, master, "_source:=synthetic", *words):
        await until(lambda: len(engine.newest) == 2, "two links")


async def test_parameters_that_take_a_strategy_as_people_write_them(master: Master) -> None:
    engine = PhysicalAdaptiveEngine()
    async with at_work(engine, master, "_apply_parameters:={rate_bps: /camera/max_bps}"):
        await until(lambda: engine.state == "active", "the engine")
        assert engine._parameters is not None
        assert engine._parameters._names == {"rate_bps": "/camera/max_bps"}


async def test_ports_are_a_list(master: Master) -> None:
    engine = RadioInformationEngine()
    async with at_work(engine, master, "_transport/ports:=[22, 80]"):
        await until(lambda: engine.state == "active", "the engine")
        assert isinstance(engine.source, TransportSource)
        assert engine.source._ports == {22, 80}


async def test_a_writer_whose_clock_is_wrong_is_heard_and_told(master: Master) -> None:
    engine = RadioInformationEngine()
    words = ("_source:=store", "_store/port:=0", "_store/udp_port:=0", "_store/period_s:=0.02")
    async with at_work(engine, master, *words):
        await until(lambda: isinstance(engine.source, StoreSource) and engine.source.server)
        assert isinstance(engine.source, StoreSource)
        assert engine.source.server is not None
        for seconds in range(3):
            ahead_ns = time.time_ns() + (60 + seconds) * 10**9
            engine.source.server.take(f"glasses_18,rnti=4601 snr_pusch=200 {ahead_ns}")
            await until(lambda count=seconds: engine.processed > count, "the record")
        assert "ahead: clocks differ" in engine.verdict()[1]
