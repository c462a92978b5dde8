"""Strategies that are really applied, and acknowledged; the bridge with JPEG; marks on live sockets."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest
from support.waiting import until

from simple_ros.arguments import Arguments
from simple_ros.engine import Engine
from simple_ros.errors import ConfigError
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.sensor_msgs import CompressedImage, Image
from simple_ros.msg.std_msgs import Float32
from simple_ros.msg.wireless_ros_msgs import (
    ActuationReport,
    Constraint,
    PhyLayerMetrics,
    TransmissionStrategy,
)
from simple_ros.node import NodeHandle
from simple_ros_engines.cross_domain.adaptation import RateGate
from simple_ros_engines.cross_domain.bridge_node import TopicBridge
from simple_ros_engines.marking import Marks, marked
from simple_ros_engines.physical_adaptive.actuators import Actuator, Applied
from simple_ros_engines.physical_adaptive.node import PhysicalAdaptiveEngine
from simple_ros_engines.physical_adaptive.sending import (
    JpegActuator,
    PriorityActuator,
    RateActuator,
    StrategyApplier,
    VoxelActuator,
)
from simple_ros_master import Master

pytest.importorskip("PIL")


@asynccontextmanager
async def running(engine: Engine, master: Master, **parameters: Any) -> AsyncIterator[NodeHandle]:
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


def node(name: str, master: Master, transports: Any = ("tcp",)) -> NodeHandle:
    return NodeHandle(name, master=master.address, transports=transports, arguments=Arguments())


async def strategist(user: NodeHandle, reports: list[ActuationReport]) -> Any:
    await user.subscribe("/wireless_ros/actuation_report", ActuationReport, reports.append)
    return await user.advertise("/wireless_ros/transmission_strategy", TransmissionStrategy)


def strategy(stamp_s: int = 7, **values: Any) -> TransmissionStrategy:
    message = TransmissionStrategy(link_id="4601", priority=3, compression_ratio=1.0, rate_bps=5e6)
    message.header.stamp.FromSeconds(stamp_s)
    for name, value in values.items():
        setattr(message, name, value)
    return message


class Broken(Actuator):
    name = "broken"

    def apply(self, link_id: str, rnti: int | None, strategy: Any) -> Applied:
        raise OSError("no such radio")


async def test_in_the_senders_node_rate_quality_voxels_and_priority_are_set_and_told(
    master: Master,
) -> None:
    gate, seen, reports = RateGate(), {}, []
    async with node("user", master) as user, node("robot", master) as robot:
        ways, marks = marked(robot.transports)
        publisher = await robot.advertise("data", Float32, transports=ways)
        for name in ("data", "more"):
            await user.subscribe(name, Float32, lambda _: None)
        await publisher.wait_for_subscribers(1, timeout=30)
        actuators = [
            RateActuator(lambda hz: setattr(gate, "rate_hz", hz), lambda: 12_500, share=0.5),
            JpegActuator(lambda quality: seen.update(quality=quality)),
            VoxelActuator(lambda leaf: seen.update(leaf=leaf)),
            PriorityActuator(marks),
            Broken(),
        ]
        # First who hears the reports: then their publisher has that subscriber from the beginning.
        strategies = await strategist(user, reports)
        await StrategyApplier(robot, actuators, "4601").start()
        await strategies.wait_for_subscribers(1, timeout=30)
        strategies.publish(strategy(link_id="4602"))
        strategies.publish(strategy(priority=5, compression_ratio=0.25))
        await until(lambda: len(reports) == 5)
        assert gate.rate_hz == pytest.approx(25)
        assert seen == {"quality": 44, "leaf": pytest.approx(0.1)}
        assert {item.link_id for item in reports} == {"4601"}
        assert {item.header.stamp.seconds for item in reports} == {7}
        told = {item.actuator: (item.applied, item.detail) for item in reports}
        assert told["application_rate"] == (True, "at most 25.00 messages/s")
        assert told["topic_priority"] == (
            True,
            "DSCP 46, socket priority 5 on 1 of 1 connections",
        )
        assert told["broken"] == (False, "OSError: no such radio")
        (sock,) = marks._open()
        assert sock.getsockopt(socket.IPPROTO_IP, socket.IP_TOS) >> 2 == 46
        assert sock.getsockopt(socket.SOL_SOCKET, socket.SO_PRIORITY) == 5


async def test_marks_hold_for_connections_to_come(master: Master) -> None:
    async with node("robot", master) as robot, node("user", master) as user:
        ways, marks = marked(robot.transports)
        publisher = await robot.advertise("data", Float32, transports=ways)
        assert marks.set(dscp=34, priority=4).connections == 0
        for count in (1, 2):
            async with node(f"listener{count}", master) as listener:
                await listener.subscribe("data", Float32, lambda _: None)
                await publisher.wait_for_subscribers(1, timeout=30)
                found = marks.check()
                assert (found.connections, found.marked) == (1, 1)
            await until(lambda: publisher.subscriber_count == 0)
        assert user.name == "user"


async def test_unix_sockets_have_no_code_point_but_a_priority(master: Master) -> None:
    async with node("robot", master, ("unix",)) as robot, node("user", master, ("unix",)) as user:
        ways, marks = marked(robot.transports)
        publisher = await robot.advertise("data", Float32, transports=ways)
        await user.subscribe("data", Float32, lambda _: None)
        await publisher.wait_for_subscribers(1, timeout=30)
        assert marks.set(dscp=46, priority=5).marked == 1


def test_impossible_marks_are_refused_and_what_the_kernel_refuses_is_told() -> None:
    marks = Marks()
    with pytest.raises(ConfigError, match="0 to 63"):
        marks.set(dscp=64)
    with pytest.raises(ConfigError, match="0 to 15"):
        marks.set(priority=16)

    class Refusing(socket.socket):
        def setsockopt(self, *args: Any) -> None:  # type: ignore[override]
            raise PermissionError(1, "Operation not permitted")

    with Refusing() as sock:
        marks.came(sock)
        found = marks.set(dscp=46, priority=7)
    assert (found.connections, found.marked) == (1, 0)
    assert found.problems == ("DSCP 46, priority 7: Operation not permitted",)


async def test_the_engine_sets_parameters_of_others_and_tells_what_was_refused(
    master: Master,
) -> None:
    reports: list[ActuationReport] = []
    names = {"rate_bps": "/camera/link_{link}/max_bps"}
    async with (
        node("user", master) as user,
        running(
            PhysicalAdaptiveEngine(),
            master,
            apply_parameters=json.dumps(names),
            use_reinforcement_learning=False,
        ),
    ):
        await strategist(user, reports)
        metrics = await user.advertise("/wireless_ros/phy_layer_metrics", PhyLayerMetrics)
        constraints = await user.advertise("/wireless_ros/constraints", Constraint)
        await metrics.wait_for_subscribers(1, timeout=30)
        await constraints.wait_for_subscribers(1, timeout=30)

        async def ask(condition: Any) -> None:
            number = 0
            while not condition():
                number += 1
                metrics.publish(PhyLayerMetrics(link_id="4601", available_bps=2e7))
                constraint = Constraint(link_id="4601", max_data_rate=3.0 + number / 100)
                constraint.constraint_type = "STANDARD"
                constraint.header.stamp.FromSeconds(number)
                constraints.publish(constraint)
                with contextlib.suppress(AssertionError):
                    await until(condition, limit=0.2)

        await ask(lambda: reports)
        assert (reports[0].actuator, reports[0].applied) == ("parameters", False)
        assert "camera/link_4601/max_bps" in reports[0].detail
        async with node("camera", master) as camera:
            await camera.declare_parameter("/camera/link_4601/max_bps", 1e6, maximum=1e12)
            await ask(lambda: any(item.applied for item in reports))
            await until(lambda: camera.parameters["/camera/link_4601/max_bps"] != 1e6)
        await user.delete_parameter("/camera/link_4601/max_bps")
        async with node("camera", master) as camera:
            await camera.declare_parameter("/camera/link_4601/max_bps", 1.0, maximum=2.0)
            refused = len(reports)
            await ask(lambda: any("OutOfRange" in item.detail for item in reports[refused:]))


async def test_only_a_report_on_the_newest_strategy_counts(master: Master) -> None:
    engine = PhysicalAdaptiveEngine()
    newest = strategy(stamp_s=9)
    engine._newest["4601"] = newest
    link = engine.core._link("4601")
    old = ActuationReport(link_id="4601", applied=True)
    old.header.stamp.FromSeconds(8)
    engine._reported(old)
    assert not link.applied
    old.header.stamp.FromSeconds(9)
    old.applied = False
    engine._reported(old)
    assert not link.applied
    old.applied = True
    engine._reported(old)
    assert link.applied


async def test_wrong_parameter_maps_are_refused(master: Master) -> None:
    for text, words in (
        ("[1]", "no JSON object"),
        ("{", "no JSON"),
        ('{"speed": "x"}', "no field"),
    ):
        engine = PhysicalAdaptiveEngine()
        async with node(engine.node_name, master) as made:
            await made.set_parameters({"~apply_parameters": text})
            with pytest.raises(ConfigError, match=words):
                await engine.run(made)


def photo() -> Image:
    noise = np.random.default_rng(1).integers(0, 60, (120, 160, 3))
    rows, columns = np.mgrid[0:120, 0:160]
    smooth = np.stack([rows, columns, rows + columns], -1) % 190
    data = (smooth + noise).astype(np.uint8).tobytes()
    return Image(height=120, width=160, encoding="rgb8", step=480, data=data)


async def test_the_bridge_sends_jpeg_while_a_strategy_asks_for_less(master: Master) -> None:
    raw: list[bytes] = []
    jpeg: list[CompressedImage] = []
    reports: list[ActuationReport] = []
    bridge = TopicBridge()
    async with (
        node("user", master) as user,
        running(bridge, master, image_format="jpeg", dwell_s=0.05, cloud_in=""),
    ):
        await user.subscribe("/camera/mobile/image_raw", "sensor_msgs.Image", raw.append, raw=True)
        await user.subscribe("/camera/mobile/image_raw/compressed", CompressedImage, jpeg.append)
        camera = await user.advertise("/camera/image_raw", Image)
        strategies = await strategist(user, reports)
        await camera.wait_for_subscribers(1, timeout=30)
        await strategies.wait_for_subscribers(1, timeout=30)
        flow = bridge.flows["/camera/image_raw"]
        assert flow.jpeg is not None
        heard = flow.jpeg
        await until(lambda: flow.publisher.subscriber_count and heard.subscriber_count)
        image = photo()
        camera.publish(image)
        await until(lambda: raw)
        assert raw[0] == image.SerializeToString()
        strategies.publish(strategy(compression_ratio=0.3, rate_bps=50e6))
        await until(lambda: reports)
        camera.publish(image)
        await until(lambda: jpeg)
        first = len(jpeg[0].data)
        assert first < 0.5 * len(image.data)
        strategies.publish(strategy(compression_ratio=0.3, rate_bps=4 * first))
        await until(lambda: flow.rules.budget.rate_bps < 1e6)
        while len(jpeg) < 40 and (not jpeg[-1].data or len(jpeg[-1].data) > 0.8 * first):
            count = len(jpeg)
            camera.publish(image)
            with contextlib.suppress(AssertionError):
                await until(lambda count=count: len(jpeg) > count, limit=1.0)
        assert len(jpeg[-1].data) <= 0.8 * first
        assert len(raw) == 1
        told = {item.actuator: item for item in reports}
        assert told["topic_bridge/compression"].applied
        assert "JPEG" in told["topic_bridge/compression"].detail
        assert told["topic_bridge/topic_priority"].applied
        # Well again: bytes as they came.
        while raw[-1] is raw[0]:
            strategies.publish(strategy(compression_ratio=1.0, rate_bps=1e9))
            camera.publish(image)
            with contextlib.suppress(AssertionError):
                await until(lambda: len(raw) > 1, limit=0.1)
        assert raw[-1] == image.SerializeToString()


async def test_an_engine_says_how_it_is_in_the_diagnostics(master: Master) -> None:
    found: list[DiagnosticArray] = []
    async with (
        node("user", master) as user,
        running(PhysicalAdaptiveEngine(), master),
    ):
        await user.subscribe("/diagnostics", DiagnosticArray, found.append)
        await until(lambda: found)
    (status,) = found[0].status
    assert status.name == "wireless_ros/physical_adaptive_engine: engine"
    assert status.message == "Engine running normally"
    assert {item.key for item in status.values} == {"Active RNTIs", "Inputs", "Errors"}
