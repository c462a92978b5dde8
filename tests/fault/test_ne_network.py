"""Tagged topics flow whatever becomes of the network's interface, of the watcher, of a relay: all as processes."""

from __future__ import annotations

import asyncio
import json
import shlex
import signal
import socket
import urllib.request
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

import psutil
import pytest
from support.cli import PROGRAM
from support.engines import user
from support.processes import Process, python
from support.waiting import until

from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.network_exposure_msgs import FlowQos, FlowQosArray, UniqueTopicFlows
from simple_ros.qos import LATCHED
from simple_ros_master import Master

pytestmark = pytest.mark.timeout(180)

LAUNCH_FILE = str(files("simple_ros_engines.network_exposure") / "launch" / "network_exposure.yaml")
QUICK = {"min_window_s": 0.2, "dwell_s": 0.2, "retry_s": 0.1, "timeout_s": 0.5, "session_s": 2.0}
SLOW_S = 60


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


@dataclass
class Robot:
    """An application with a tagged topic, and what the programs around it say."""

    master: Master
    port: int
    got: list[Twist] = field(default_factory=list)
    states: list[FlowQosArray] = field(default_factory=list)
    relays: dict[str, UniqueTopicFlows] = field(default_factory=dict)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def state(self) -> FlowQos:
        flows = self.states[-1].flows if self.states else ()
        return next((flow for flow in flows if flow.topic == "cmd_vel"), FlowQos())

    async def is_active(self) -> None:
        await until(lambda: self.state.state == "active", f"active: {self.state}", SLOW_S)

    async def flows_on(self) -> None:
        before = len(self.got)
        await until(lambda: len(self.got) > before + 10, "the topic flows")

    def control(self, **changes: Any) -> dict[str, Any]:
        """Changes settings and faults of the mock, which is another process; its state."""
        data = json.dumps(changes).encode() if changes else None
        path = "/mock/control" if changes else "/mock/state"
        with urllib.request.urlopen(self.url + path, data, 10) as answer:
            return dict(json.loads(answer.read()))

    def bearers(self) -> set[str]:
        return {bearer["id"] for bearer in self.control()["bearers"]}

    def mock(self) -> Any:
        return python(*PROGRAM, "network", "mock", "--port", str(self.port), "--setup", "0")

    def engine(self, name: str, node: str = "", **parameters: Any) -> Any:
        words = [f"_{key}:={value}" for key, value in parameters.items()]
        if node:
            words.append(f"__name:={node}")
        return python(
            *PROGRAM, "engine", "run", name,
            SIMPLE_ROS_MASTER=self.master.address, SIMPLE_ROS_ARGS=shlex.join(words),
        )  # fmt: skip

    def watcher(self, **parameters: Any) -> Any:
        return self.engine("topic-watcher", **{"url": self.url} | QUICK | parameters)


@asynccontextmanager
async def robot_of(master: Master) -> AsyncIterator[Robot]:
    robot = Robot(master, free_port())
    async with user(master) as node:
        publisher = await node.advertise("cmd_vel_qos", Twist)
        await node.subscribe("cmd_vel", Twist, robot.got.append)
        await node.subscribe("/network_flow_state", FlowQosArray, robot.states.append, qos=LATCHED)
        await node.subscribe(
            "/unique_network_flow",
            UniqueTopicFlows,
            lambda told: robot.relays.__setitem__(told.relay, told),
            qos=LATCHED,
        )
        node.create_timer(0.02, lambda _: publisher.publish(Twist()))
        yield robot


async def mock_is_up(mock: Process) -> None:
    assert "listens on" in await mock.line(SLOW_S)


async def test_whatever_the_network_answers(master: Master) -> None:
    faults: list[dict[str, Any]] = [
        {"is_down": True},
        {"delay_s": 3.0},
        {"status": 401},
        {"status": 429, "retry_after_s": 1},
        {"status": 500},
        {"status": 503},
        {"malformed": True},
        {"loses_notifications": True, "status": 502},
    ]
    async with robot_of(master) as robot, robot.mock() as mock:
        await mock_is_up(mock)
        async with robot.engine("flow-relay", stats_period_s=0.05), robot.watcher():
            for fault in faults:
                await robot.is_active()
                robot.control(**fault)
                await until(lambda: robot.state.state == "failed", str(fault), SLOW_S)
                assert robot.state.detail, fault
                await robot.flows_on()
                robot.control(**{name: type(item)(0) for name, item in fault.items()})
            await robot.is_active()
            # What was made and never told of is gone, too: released or expired.
            await until(lambda: len(robot.bearers()) == 1, "one bearer", SLOW_S)


async def test_the_network_hangs_dies_and_comes_back_empty(master: Master) -> None:
    async with robot_of(master) as robot, AsyncExitStack() as others:
        async with robot.mock() as mock:
            await mock_is_up(mock)
            await others.enter_async_context(robot.engine("flow-relay", stats_period_s=0.05))
            await others.enter_async_context(robot.watcher())
            await robot.is_active()
            mock.signal(signal.SIGSTOP)
            await until(lambda: robot.state.state == "failed", "hangs", SLOW_S)
            assert "does not answer within" in robot.state.detail
            await robot.flows_on()
            mock.signal(signal.SIGCONT)
            await robot.is_active()
        await until(lambda: robot.state.state == "failed", "dies", SLOW_S)
        await robot.flows_on()
        async with robot.mock() as mock:
            await mock_is_up(mock)
            await robot.is_active()
            await until(lambda: len(robot.bearers()) == 1, "one bearer", SLOW_S)


async def test_a_watcher_that_is_killed(master: Master) -> None:
    """Its sessions end by themselves; the next watcher has its own."""
    async with robot_of(master) as robot, robot.mock() as mock:
        await mock_is_up(mock)
        async with robot.engine("flow-relay", stats_period_s=0.05):
            async with robot.watcher() as watcher:
                await robot.is_active()
                # One that was asked for in vain, since the network stood still, is there until it expires.
                await until(lambda: len(robot.bearers()) == 1, "one bearer", SLOW_S)
                watcher.signal(signal.SIGKILL)
                await watcher.wait()
            await robot.flows_on()
            await until(lambda: not robot.bearers(), "expired", SLOW_S)
            robot.states.clear()
            # It waits for a network that stands still, and what it does not release would stay.
            async with robot.watcher(timeout_s=10.0, session_s=600.0) as watcher:
                await robot.is_active()
                watcher.signal(signal.SIGINT)
                assert await watcher.wait() == 0
            assert not robot.bearers()
            await robot.flows_on()


async def test_a_relay_that_is_killed(master: Master) -> None:
    """Another one stands by, and has flows of its own."""
    async with robot_of(master) as robot, robot.mock() as mock:
        await mock_is_up(mock)
        async with (
            robot.watcher(idle_s=1.0),
            robot.engine("flow-relay", "first", stats_period_s=0.05) as first,
        ):
            await robot.is_active()
            async with robot.engine("flow-relay", "second", stats_period_s=0.05):
                await until(lambda: "second" in robot.relays, "stands by", SLOW_S)
                await robot.flows_on()
                assert not robot.relays["second"].flows
                before = robot.bearers()
                first.signal(signal.SIGKILL)
                await until(lambda: robot.relays["second"].flows, "takes over", SLOW_S)
                await robot.flows_on()
                # The other's flow has its own session, and the session of the flow that is gone is released.
                await until(lambda: robot.bearers() and not robot.bearers() & before, "", SLOW_S)


def said(process: psutil.Process) -> str:
    return str(process.environ().get("SIMPLE_ROS_ARGS", ""))


async def test_the_launch_file(master: Master, tmp_path_factory: pytest.TempPathFactory) -> None:
    """All of it by one command: asked for, taken over by the relay that stands by, ended by Ctrl-C."""
    logs = tmp_path_factory.mktemp("logs")
    words = (
        "mock:=true",
        "standby:=true",
        "recovery_enabled:=false",
        "window_s:=2",
        "backend:=seal",
    )
    async with robot_of(master) as robot:
        where = (f"mock_port:={robot.port}", f"url:={robot.url}", "gpsi:=extid-robot@example.org")
        async with python(
            *PROGRAM, "launch", LAUNCH_FILE, "--plain", *words, *where,
            SIMPLE_ROS_MASTER=master.address, SIMPLE_ROS_LOG_DIR=str(logs),
        ) as launch:  # fmt: skip
            await robot.is_active()
            assert robot.control()["groups"] == ["simple_ros"]
            processes = psutil.Process(launch.pid).children(recursive=True)
            assert len(processes) >= 4
            names = ("flow_relay", "flow_relay_standby")
            await until(lambda: set(names) <= robot.relays.keys(), "both relays", SLOW_S)
            busy = next(name for name in names if robot.relays[name].flows)
            other = next(name for name in names if name != busy)
            (relay,) = [one for one in processes if f"__name:={busy}" in said(one).split()]
            relay.kill()
            await until(lambda: robot.relays[other].flows, "takes over", SLOW_S)
            await robot.flows_on()
            launch.signal(signal.SIGINT)
            await launch.wait(30)
            gone, alive = await asyncio.to_thread(psutil.wait_procs, processes, 10)
            assert not alive
            assert gone
