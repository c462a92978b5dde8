"""The wireless engines as nodes: the chain, services, actions, modes, sources that fail."""

from __future__ import annotations

import asyncio
import json
import socket
import time
import urllib.error
import urllib.request
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.engine import Engine, engine_named
from simple_ros.errors import GoalAborted
from simple_ros.msg.arrays import numpy_to_occupancy_grid, occupancy_grid_to_numpy
from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.nav_msgs import OccupancyGrid
from simple_ros.msg.nav_msgs import Path as PathMessage
from simple_ros.msg.sensor_msgs import Image
from simple_ros.msg.std_msgs import String
from simple_ros.msg.wireless_ros_msgs import (
    ActuationReport,
    ChannelState,
    Constraint,
    EngineStatus,
    EnhanceMap,
    EnhanceMapGoal,
    FieldQuality,
    Forecast,
    GetLinkQuality,
    GetLinkQualityRequest,
    MonitorQuality,
    MonitorQualityGoal,
    OptimizePath,
    OptimizePathRequest,
    OptimizeStrategy,
    OptimizeStrategyGoal,
    ReconfigureEngine,
    ReconfigureEngineRequest,
    TransmissionStrategy,
)
from simple_ros.qos import LATCHED
from simple_ros_engines.cross_domain.bridge_node import TopicBridge
from simple_ros_engines.cross_domain.node import CrossDomainEngine
from simple_ros_engines.physical_adaptive.node import PhysicalAdaptiveEngine
from simple_ros_engines.radio_information.node import RadioInformationEngine
from simple_ros_engines.radio_information.record import record
from simple_ros_engines.radio_information.sources.record_json import to_json
from simple_ros_engines.radio_information.sources.store import StoreSource
from simple_ros_engines.store.database import MetricsStore
from simple_ros_engines.store.server import StoreServer
from simple_ros_master import Master


@asynccontextmanager
async def running(engine: Engine, master: Master, **parameters: Any) -> AsyncIterator[NodeHandle]:
    """An engine at work, with parameters set before it starts."""
    async with NodeHandle(engine.node_name, master=master.address, arguments=Arguments()) as node:
        await node.set_parameters({f"~{name}": value for name, value in parameters.items()})
        task = asyncio.create_task(engine.run(node))
        try:
            yield node
        finally:
            task.cancel()
            (ended,) = await asyncio.gather(task, return_exceptions=True)
            if ended is not None and not isinstance(ended, asyncio.CancelledError):
                raise ended


@asynccontextmanager
async def user(master: Master) -> AsyncIterator[NodeHandle]:
    async with NodeHandle("user", master=master.address, arguments=Arguments()) as node:
        yield node


def synthetic(**options: Any) -> dict[str, Any]:
    return {"source": "synthetic", "source_options": json.dumps({"period_s": 0.02, **options})}


async def test_from_a_metric_to_a_strategy_that_is_applied(master: Master, tmp_path: Path) -> None:
    policy = tmp_path / "rrmPolicy_sub.json"
    states: list[ChannelState] = []
    constraints: list[Constraint] = []
    strategies: list[TransmissionStrategy] = []
    reports: list[ActuationReport] = []
    forecasts: list[Forecast] = []
    async with user(master) as node:
        await node.subscribe("/wireless_ros/channel_state", ChannelState, states.append)
        await node.subscribe("/wireless_ros/constraints", Constraint, constraints.append)
        await node.subscribe("/wireless_ros/bandwidth_forecast", Forecast, forecasts.append)
        await node.subscribe(
            "/wireless_ros/transmission_strategy", TransmissionStrategy, strategies.append
        )
        await node.subscribe("/wireless_ros/actuation_report", ActuationReport, reports.append)
        physical = PhysicalAdaptiveEngine()
        async with (
            running(CrossDomainEngine(), master),
            running(physical, master, rrm_policy_file=str(policy)),
            running(RadioInformationEngine(), master, **synthetic(links=2)),
        ):
            await until(lambda: len(reports) >= 10 and len(forecasts) >= 2, "the whole chain")
    assert {state.link_id for state in states} == {"4601", "4602"}
    assert states[0].field_quality["pusch_snr"] == FieldQuality.SIMULATED
    assert [state.header.seq for state in states] == list(range(len(states)))
    assert constraints[-1].constraint_type
    newest = strategies[-1]
    assert newest.target_prb >= 1
    assert 0.05 <= newest.compression_ratio <= 1
    assert newest.header.stamp.ToNanoseconds() in {
        state.header.stamp.ToNanoseconds() for state in states
    }
    assert reports[-1].applied
    assert "0x4601" in json.loads(policy.read_text())["ueSliceMapping"]
    assert ": 0 experiences" not in physical.core.learning_status("4601")


async def test_services_of_the_radio_information_engine(master: Master) -> None:
    engine = RadioInformationEngine()
    statuses: list[EngineStatus] = []
    async with user(master) as node, running(engine, master, **synthetic()):
        await node.subscribe("/wireless_ros/status", EngineStatus, statuses.append)
        await until(lambda: engine.newest, "a record")
        client = node.service_client("/wireless_ros/get_link_quality", GetLinkQuality, timeout=30)
        answer = await client.call(GetLinkQualityRequest(rnti=0x4601))
        assert answer.found
        assert 0 <= answer.metrics.link_quality <= 1
        assert answer.age_s < 5
        missing = await client.call(GetLinkQualityRequest(link_id="wlan7"))
        assert not missing.found
        assert missing.message == "no such link; there are: 4601"
        change = node.service_client(
            "/wireless_ros/reconfigure_engine", ReconfigureEngine, timeout=5
        )
        done = await change.call(
            ReconfigureEngineRequest(engine="radio_info_engine", json='{"mode": "optimized"}')
        )
        assert done.ok, done.message
        await until(lambda: statuses and statuses[-1].mode == "optimized", "the new mode")
        before = engine.processed
        await until(lambda: engine.processed > before, "records in the new mode")
        for name, values, why in (
            ("radio_info_engine", '{"mode": "fast"}', "mode"),
            ("radio_info_engine", "no json", "no JSON"),
            ("toaster", "{}", "is none of"),
        ):
            refused = await change.call(ReconfigureEngineRequest(engine=name, json=values))
            assert not refused.ok
            assert why in refused.message
    assert statuses[-1].links == 1
    assert statuses[-1].errors == 0


async def test_watching_a_link(master: Master) -> None:
    engine, seen = RadioInformationEngine(), []
    async with user(master) as node, running(engine, master, **synthetic()):
        await until(lambda: engine.newest, "a record")
        client = node.action_client("/wireless_ros/monitor_quality", MonitorQuality)
        await client.wait_for_server()
        goal = await client.send_goal(
            MonitorQualityGoal(rnti=0x4601, duration_s=0.2, period_s=0.02), feedback=seen.append
        )
        result = await goal.result()
        assert result.samples == 10
        assert result.minimum <= result.mean <= result.maximum
        assert seen
        other = await client.send_goal(MonitorQualityGoal(rnti=9, duration_s=0.02, period_s=0.02))
        with pytest.raises(GoalAborted, match="no sample"):
            await other.result()


async def test_searching_a_strategy(master: Master) -> None:
    physical = PhysicalAdaptiveEngine()
    async with (
        user(master) as node,
        running(CrossDomainEngine(), master),
        running(physical, master),
        running(RadioInformationEngine(), master, **synthetic()),
    ):
        await until(lambda: physical.strategies, "a strategy")
        client = node.action_client("/wireless_ros/optimize_strategy", OptimizeStrategy)
        await client.wait_for_server()
        goal = await client.send_goal(OptimizeStrategyGoal(rnti=0x4601, iterations=29))
        result = await goal.result()
        assert result.iterations == 29
        assert 0 < result.score <= 1
        assert result.best.link_id == "4601"
        unknown = await client.send_goal(OptimizeStrategyGoal(rnti=5))
        with pytest.raises(GoalAborted, match="nothing is known"):
            await unknown.result()


def pose(x: float, y: float) -> PoseStamped:
    message = PoseStamped()
    message.pose.position.x, message.pose.position.y = x, y
    message.pose.orientation.w = 1.0
    return message


async def test_maps_and_ways(master: Master) -> None:
    engine = CrossDomainEngine()
    cells = np.zeros((20, 20), np.int8)
    enhanced: list[OccupancyGrid] = []
    async with user(master) as node, running(engine, master):
        client = node.service_client("/wireless_ros/optimize_path", OptimizePath, timeout=30)
        wanted = PathMessage(poses=[pose(1.5, 10.5), pose(18.5, 10.5)])
        await client.wait_for_service(timeout=30)
        refused = await client.call(OptimizePathRequest(path=wanted))
        assert "no map" in refused.message
        maps = await node.advertise("/map", OccupancyGrid, qos=LATCHED)
        maps.publish(numpy_to_occupancy_grid(cells, 1.0))
        await until(lambda: engine.quality is not None, "the map")
        assert engine.quality is not None
        engine.quality.quality[:] = 0.9
        engine.quality.quality[6:14, 8:12] = 0.05
        answer = await client.call(OptimizePathRequest(path=wanted))
        assert answer.success
        assert answer.before.dead_zone_m > 3
        assert answer.after.dead_zone_m == 0
        assert answer.path.poses[-1].pose.position.x == 18.5
        action = node.action_client("/wireless_ros/enhance_map", EnhanceMap)
        await action.wait_for_server()
        result = await (await action.send_goal(EnhanceMapGoal())).result()
        enhanced.append(result.map)
        too_short = await client.call(OptimizePathRequest(path=PathMessage(poses=[pose(1, 1)])))
        assert "two poses" in too_short.message
    costs = occupancy_grid_to_numpy(enhanced[0])
    assert costs[0, 0] == 5
    assert costs[10, 10] == 47


async def test_a_robot_writes_the_quality_of_its_own_link(master: Master) -> None:
    engine = CrossDomainEngine()
    async with (
        user(master) as node,
        running(engine, master, link="4602"),
        running(RadioInformationEngine(), master, **synthetic(links=3)),
    ):
        maps = await node.advertise("/map", OccupancyGrid, qos=LATCHED)
        maps.publish(numpy_to_occupancy_grid(np.zeros((10, 10), np.int8), 1.0))
        poses = await node.advertise("/robot/pose", PoseStamped)
        await poses.wait_for_subscribers(1, timeout=30)
        await until(lambda: engine.quality is not None and len(engine.newest) == 3, "map and links")
        assert engine.quality is not None
        poses.publish(pose(2.5, 3.5))
        await until(lambda: engine.quality.at(2.5, 3.5) is not None, "the pose")
        assert engine.quality.known_cells() == 1


async def test_a_critical_task_is_heard(master: Master) -> None:
    constraints: list[Constraint] = []
    async with (
        user(master) as node,
        running(CrossDomainEngine(), master),
        running(RadioInformationEngine(), master, **synthetic()),
    ):
        await node.subscribe("/wireless_ros/constraints", Constraint, constraints.append)
        status = await node.advertise("/task_status", String)
        await status.wait_for_subscribers(1, timeout=30)
        await until(lambda: constraints, "a constraint")
        status.publish(String(data="CRITICAL"))
        await until(lambda: constraints[-1].constraint_type.startswith("CRITICAL_"), "the task")
        assert constraints[-1].criticality == pytest.approx(0.9)


async def test_records_of_a_file_and_what_is_wrong_in_it(master: Master, tmp_path: Path) -> None:
    lines = [
        to_json(
            record("4601", at * 10**8, "test", {"ul_snr_db": 20, "ul_bler": 0.05, "ul_mcs": 12})
        )
        for at in range(1, 21)
    ]
    lines.insert(5, "half a rec")
    lines.insert(6, '{"link": "4601", "stamp_ns": 550000000, "values": {"ul_snr_db": 215}}')
    file = tmp_path / "records.jsonl"
    file.write_text("\n".join(lines))
    states: list[ChannelState] = []
    engine = RadioInformationEngine()
    options = json.dumps({"path": str(file), "speed": 0})
    async with user(master) as node:
        await node.subscribe("/wireless_ros/channel_state", ChannelState, states.append)
        async with running(engine, master, source="replay", source_options=options):
            await until(lambda: len(states) == 21, "all records")
            await until(lambda: engine.state == "degraded", "the end of the file")
    assert engine.source is not None
    assert engine.source.malformed == 1
    flagged = [s for s in states if s.field_quality["pusch_snr"] == FieldQuality.OUT_OF_RANGE]
    assert len(flagged) == 1
    assert flagged[0].pusch_snr == 0.0


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def test_what_others_write_into_the_store(master: Master) -> None:
    engine = RadioInformationEngine()
    options = {"fields": "flexric_mac", "port": 0, "udp_port": 0, "period_s": 0.02}
    async with (
        user(master),
        running(engine, master, source="store", source_options=json.dumps(options)),
    ):
        await until(
            lambda: isinstance(engine.source, StoreSource) and engine.source.server, "store"
        )
        source = engine.source
        assert isinstance(source, StoreSource)
        assert source.server is not None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            stamp = time.time_ns() // 1000
            line = f"mac_stats: tstamp={stamp},pusch_snr=21.5,ul_bler=0.05,ul_mcs1=12,rnti=4601"
            sender.sendto(line.encode(), ("127.0.0.1", source.server.udp_port))
            await until(lambda: "4601" in engine.newest, "the datagram")
        assert engine.newest["4601"][0].snr_db == pytest.approx(21.5)
        url = f"http://127.0.0.1:{source.server.port}"
        line = f"mac_stats,rnti=4602 pusch_snr=11,ul_bler=0.5 {time.time_ns()}"
        status, _ = await asyncio.to_thread(http, f"{url}/api/v2/write?precision=ns", line)
        assert status == 204
        await until(lambda: "4602" in engine.newest, "the written line")
        flux = 'from(bucket: "b") |> range(start: -1m) |> group(columns: ["rnti"])'
        body = json.dumps({"query": f'{flux} |> distinct(column: "rnti")'})
        status, text = await asyncio.to_thread(
            http, f"{url}/api/v2/query", body, "application/json"
        )
        assert status == 200
        assert [row.split(",")[3] for row in text.splitlines()[4:]] == ["4601", "4602"]
        for path, body in (
            ("/write?precision=fortnight", "a b=1"),
            ("/write", "garbage"),
            ("/api/v2/query", "drop everything()"),
        ):
            status, text = await asyncio.to_thread(http, url + path, body)
            assert status == 400
            assert json.loads(text)["code"] == "invalid"
        assert (await asyncio.to_thread(http, f"{url}/nothing", ""))[0] == 404


async def test_an_influxdb_server_is_asked(master: Master) -> None:
    """The embedded store stands in for the server: it answers the same query in the same form."""
    store = MetricsStore()
    server = StoreServer(store)
    await server.start(port=0, udp_port=None)
    engine = RadioInformationEngine()
    options = {"url": f"http://127.0.0.1:{server.port}", "fields": "srsran", "period_s": 0.02}
    common = {"source": "influx2", "discovery_interval": 0.1}
    try:
        async with (
            user(master),
            running(engine, master, **common, source_options=json.dumps(options)),
        ):
            line = "ue,rnti=17921,pci=1 pusch_snr_db=21.5,ul_nof_ok=90i,ul_nof_nok=10i,ul_mcs=9i"
            server.take(f"{line} {time.time_ns()}\nue,rnti=none pusch_snr_db=3 {time.time_ns()}")
            await until(lambda: "4601" in engine.newest, "the point")
            assert engine.newest["4601"][0].bler == pytest.approx(0.1)
            assert engine.newest["4601"][0].snr_db == pytest.approx(21.5)
            assert engine.source is not None
            assert engine.source.malformed == 1
            await until(lambda: engine.discovered == {"4601"}, "the devices of the last minute")
            await server.close()
            await until(lambda: engine.state == "degraded", "the missing server")
            assert "does not answer" in engine.detail
    finally:
        await server.close()
        store.close()


def http(url: str, body: str, content_type: str = "text/plain") -> tuple[int, str]:
    request = urllib.request.Request(
        url, body.encode(), {"Content-Type": content_type}, method="POST"
    )
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


async def test_a_source_that_is_down_is_told_and_tried_again(master: Master) -> None:
    engine = RadioInformationEngine()
    port = free_port()
    statuses: list[EngineStatus] = []
    options = json.dumps({"url": f"ws://127.0.0.1:{port}"})
    async with (
        user(master) as node,
        running(engine, master, source="srsran", source_options=options),
    ):
        await node.subscribe("/wireless_ros/status", EngineStatus, statuses.append)
        await until(lambda: statuses and statuses[-1].state == "degraded", "the state")
        assert str(port) in statuses[-1].detail
        from websockets.asyncio.server import serve

        async def gnb(connection: Any) -> None:
            assert json.loads(await connection.recv()) == {"cmd": "metrics_subscribe"}
            device = {"rnti": 17921, "pusch_snr_db": 22.5, "ul_mcs": 20}
            await connection.send(json.dumps({"cells": [{"ue_list": [device]}]}))
            await connection.wait_closed()

        async with serve(gnb, "127.0.0.1", port):
            await until(lambda: "4601" in engine.newest, "the gNB")
        assert engine.state in ("active", "degraded")


async def test_live_tcp_links_are_seen(master: Master) -> None:
    engine = RadioInformationEngine()
    options = json.dumps({"loopback": True, "period_s": 0.05})
    async with user(master), running(engine, master, source="transport", source_options=options):
        await until(lambda: "127.0.0.1" in engine.newest, "the Master's connection")
    metrics, _ = engine.newest["127.0.0.1"]
    assert 0 < metrics.channel_response_time < 1000
    assert metrics.channel_capacity == 0


async def test_the_bridge_hands_on_untouched_bytes_until_the_link_is_bad(master: Master) -> None:
    bridge = TopicBridge()
    got: list[bytes] = []
    image = Image(height=4, width=6, encoding="rgb8", step=18, data=bytes(72))
    async with user(master) as node, running(bridge, master):
        await node.subscribe("/camera/mobile/image_raw", "sensor_msgs.Image", got.append, raw=True)
        camera = await node.advertise("/camera/image_raw", Image)
        constraints = await node.advertise("/wireless_ros/constraints", Constraint)
        await camera.wait_for_subscribers(1, timeout=30)
        await constraints.wait_for_subscribers(1, timeout=30)
        flow = bridge.flows["/camera/image_raw"]
        await until(lambda: flow.publisher.subscriber_count, "the listener")
        camera.publish(image)
        await until(lambda: got, "the picture")
        assert got[0] == image.SerializeToString()
        constraints.publish(Constraint(link_id="4601", resolution_scale=50, frame_rate=1000))
        await until(lambda: bridge.scale == 50, "the constraint")
        camera.publish(image)
        await until(lambda: len(got) == 2, "the smaller picture")
        smaller = Image.FromString(got[1])
        assert (smaller.width, smaller.height, smaller.step) == (3, 2, 9)
        camera.publish_bytes(b"\xff\xff")
        await until(lambda: flow.malformed == 1, "what is no picture")
        assert "2 of 3 messages" in bridge.statistics()


@pytest.mark.parametrize(
    "name", ["radio-information", "cross-domain", "physical-adaptive", "topic-bridge"]
)
def test_engines_are_found_by_name(name: str) -> None:
    engine = engine_named(name)
    assert engine.node_name.startswith("wireless_ros/")
    assert engine.summary
