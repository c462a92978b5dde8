"""The network as consumer over sockets: applications are seen there, and slow down when somebody there asks."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from typing import Any

import pytest
from support.engines import at_work, user
from support.waiting import until

from simple_ros.engine import engine_named
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, ControlStatus, Pose
from simple_ros.qos import SENSOR_DATA
from simple_ros_engines.network_exposure.mock.server import MockServer
from simple_ros_engines.network_exposure.turtlesim.controller_node import TurtleController
from simple_ros_engines.network_exposure.turtlesim.node import Turtlesim
from simple_ros_engines.network_exposure.vaseal.node import VasealServer
from simple_ros_master import Master


async def operator(network: MockServer, *words: str) -> tuple[int, str]:
    """Somebody at the network asks an application; exit code and what was printed."""
    program = (sys.executable, "-m", "simple_ros.cli.main", "network", "ask", "--url", network.url)
    process = await asyncio.create_subprocess_exec(
        *program, *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    out, _ = await process.communicate()
    assert process.returncode is not None
    return process.returncode, out.decode()


@asynccontextmanager
async def turtle(master: Master) -> AsyncIterator[None]:
    async with (
        at_work(Turtlesim(), master, tag="", page="127.0.0.1:0"),
        at_work(TurtleController(), master, tag="", radius=1.0),
    ):
        yield


def application(network: MockServer) -> dict[str, Any]:
    """What the network knows of the turtle."""
    return network.vaseal.applications.get("turtle1", {})


async def test_the_network_sees_an_application_and_slows_it_down(master: Master) -> None:
    statuses: list[ControlStatus] = []
    async with MockServer() as network, user(master) as node, turtle(master):
        await node.subscribe("turtle1/control_status", ControlStatus, statuses.append)
        engine = VasealServer()
        async with at_work(engine, master, url=network.url, period_s=0.2):
            await until(lambda: application(network).get("score"), "its score is seen", 30)
            assert application(network)["topics"] == ["turtle1/pose", "turtle1/cmd_vel"]
            assert network.state()["applications"] == [application(network)]
            code, out = await operator(
                network, "turtle1", "--speed", "0.5", "--rate", "0.1", "--for", "8"
            )
            assert (code, json.loads(out)["speedFactor"]) == (0, 0.5)
            # No slower than the application agrees to.
            await until(lambda: statuses[-1].control_rate == pytest.approx(5.0), "it obeys")
            assert statuses[-1].speed_factor == 0.5
            await until(lambda: application(network)["rateFactor"] == 0.25, "that is seen, too")
            await until(lambda: statuses[-1].speed_factor == 1.0, "the time is over", 30)
            code, out = await operator(network, "nobody")
            assert code == 1
            assert out.startswith("error: ")
            assert "there is no application 'nobody'" in out
        assert not network.vaseal.applications, "taken back at the end"


async def test_a_network_that_fails_stops_nothing(master: Master) -> None:
    statuses: list[ControlStatus] = []
    async with MockServer() as network, user(master) as node, turtle(master):
        await node.subscribe("turtle1/control_status", ControlStatus, statuses.append)
        network.faults.is_down = True
        engine = VasealServer()
        async with at_work(engine, master, url=network.url, period_s=0.2):
            await until(lambda: network.state()["applications"] == [] and statuses, "silence")
            network.faults.is_down = False
            await until(lambda: application(network).get("score"), "then it is told", 40)
            network.faults.malformed = True
            count = len(statuses)
            await until(lambda: len(statuses) > count + 2, "the turtle drives on")
            network.faults.malformed = False


async def test_a_maximizer_that_was_killed_leaves_nobody_slow(master: Master) -> None:
    statuses: list[ControlStatus] = []
    async with user(master) as node, turtle(master):
        await node.subscribe("turtle1/control_status", ControlStatus, statuses.append)
        asking = await node.advertise("/application_adaptation_request", AdaptationRequest)
        await until(lambda: statuses and asking.subscriber_count >= 2)
        request = AdaptationRequest(
            group="turtle1", speed_factor=0.5, rate_factor=0.5, requester="m", valid_s=4.0
        )
        asking.publish(request)
        await until(lambda: statuses[-1].speed_factor == 0.5, "slower")
        await until(lambda: statuses[-1].speed_factor == 1.0, "by itself", 20)
        assert statuses[-1].control_rate == pytest.approx(20.0)


async def test_poses_come_less_often_for_whom_is_asked(master: Master) -> None:
    sim = Turtlesim()
    async with user(master) as node, at_work(sim, master, tag="", turtles=2, page="127.0.0.1:0"):
        asking = await node.advertise("/application_adaptation_request", AdaptationRequest)
        await until(lambda: asking.subscriber_count and len(sim.world.turtles) == 2)
        asking.publish(AdaptationRequest(group="turtle2", rate_factor=0.25, requester="m"))
        counts = {"turtle1": 0, "turtle2": 0}

        def count(name: str, _: Pose) -> None:
            counts[name] += 1

        await until(lambda: sim._adaptations.get("turtle2"))
        for name in counts:
            told = partial(count, name)
            await node.subscribe(f"{name}/pose", Pose, told, qos=SENSOR_DATA)
        # Both count from here on: they were not heard from the same moment.
        await until(lambda: all(counts.values()), "poses of both", 20)
        counts |= dict.fromkeys(counts, 0)
        await until(lambda: counts["turtle2"] >= 20, "poses", 20)
        assert counts["turtle1"] / counts["turtle2"] == pytest.approx(4.0, rel=0.3)


def test_by_name() -> None:
    assert isinstance(engine_named("vaseal"), VasealServer)
