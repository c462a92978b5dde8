"""The network runs short, from the mock network to the turtle that slows down, over sockets; and with messages lost."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

import pytest
from support.engines import at_work, user
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.msg.network_exposure_msgs import FlowQos, FlowQosArray, QosNotification
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, ControlStatus
from simple_ros.qos import LATCHED
from simple_ros_engines.network_exposure.maximizer.node import Maximizer
from simple_ros_engines.network_exposure.maximizer.shortage import Patience, Shortage
from simple_ros_engines.network_exposure.mock.core import MockSettings
from simple_ros_engines.network_exposure.mock.server import MockServer
from simple_ros_engines.network_exposure.relay import FlowRelay
from simple_ros_engines.network_exposure.topic_watcher import TopicWatcher
from simple_ros_engines.network_exposure.turtlesim.controller_node import TurtleController
from simple_ros_engines.network_exposure.turtlesim.node import Turtlesim
from simple_ros_master import Master

TOPICS = ("turtle1/pose", "turtle1/cmd_vel")
OWN = (84, 84)
"""Classes of poses each 40 ms and of commands each 50 ms."""


class Seen:
    """What is said of the turtle's topics and of the turtle."""

    def __init__(self) -> None:
        self.flows: dict[str, FlowQos] = {}
        self.status = ControlStatus()
        self.asked: list[AdaptationRequest] = []

    async def open(self, node: NodeHandle) -> None:
        await node.subscribe("/network_flow_state", FlowQosArray, self._states, qos=LATCHED)
        await node.subscribe("/turtle1/control_status", ControlStatus, self._status)
        await node.subscribe(
            "/application_adaptation_request", AdaptationRequest, self.asked.append
        )

    def _states(self, message: FlowQosArray) -> None:
        self.flows |= {flow.topic.lstrip("/"): flow for flow in message.flows}

    def _status(self, message: ControlStatus) -> None:
        self.status = message

    def has(self, state: str) -> bool:
        return any(flow.state == state for flow in self.flows.values())

    @property
    def classes(self) -> tuple[int, ...]:
        """Of the topics, where they are served; 0 for those that are not."""
        known = [self.flows.get(topic, FlowQos()) for topic in TOPICS]
        return tuple(flow.qci if flow.state == "active" else 0 for flow in known)


@asynccontextmanager
async def chain(master: Master, network: MockServer) -> AsyncIterator[Seen]:
    """A turtle over relayed topics, with watcher and maximizer, impatient."""
    seen = Seen()
    watcher = {"url": network.url, "mode": "ai", "dwell_s": 1.0, "monitors": False}
    patience = {"period_s": 0.3, "settle_s": 5.0, "patience_s": 8.0}
    async with AsyncExitStack() as stack:
        start = stack.enter_async_context
        node = await start(user(master))
        await seen.open(node)
        await start(at_work(Turtlesim(), master, page="127.0.0.1:0", rate=25.0))
        await start(at_work(TurtleController(), master, radius=1.0))
        await start(at_work(FlowRelay(), master, window_s=4.0, stats_period_s=0.2))
        await start(at_work(TopicWatcher(), master, **watcher))
        await until(lambda: seen.classes == OWN, "both topics are served", 40)
        await start(at_work(Maximizer(), master, **patience))
        yield seen


@pytest.mark.timeout(150)
async def test_it_goes_as_in_the_papers_figure_and_back(master: Master) -> None:
    async with (
        MockServer(MockSettings(setup_s=0.2)) as network,
        chain(master, network) as seen,
    ):
        await until(lambda: seen.status.mos > 4, "a score", 30)

        network.control({"least_delay_ms": 31.0})
        await until(lambda: seen.has("degraded"), "the downgrade", 20)
        await until(lambda: seen.classes == (75, 71), "lower requests", 40)
        assert seen.status.speed_factor == 1, "that was enough"
        assert not any(one.rate_factor < 1 for one in seen.asked)

        network.control({"least_delay_ms": 51.0})
        await until(lambda: seen.status.speed_factor == 0.5, "the turtle slows down", 40)
        assert seen.status.control_rate == pytest.approx(10.0)
        await until(lambda: any(one.rate_factor < 1 for one in seen.asked), "the request", 20)
        assert seen.asked[-1].requester == "mos_qos_ratio_maximizer"

        network.control({"least_delay_ms": 0.0})
        await until(lambda: seen.status.speed_factor == 1, "full speed", 60)
        await until(lambda: seen.classes == OWN, "the own request", 60)


# -- what the maximizer hears is lost ----------------------------------------------------------------


class Told:
    """A watcher that we are, and what comes of what it says."""

    def __init__(self, shortage: Shortage, node: NodeHandle) -> None:
        self.shortage = shortage
        self._node = node
        self.changes = 0
        self.asked: list[AdaptationRequest] = []

    async def open(self) -> None:
        self._states = await self._node.advertise("/network_flow_state", FlowQosArray, qos=LATCHED)
        self._notes = await self._node.advertise("/qos_notifications", QosNotification)
        await self._node.subscribe(
            "/application_adaptation_request", AdaptationRequest, self.asked.append
        )
        # Each request is said once.
        await self.shortage._requests.wait_for_subscribers(1, 30)

    def state(self, state: str, requests: int, *, refused: bool = False) -> None:
        told = FlowQosArray()
        told.flows.add(topic=TOPICS[0], state=state, requests=requests, is_refused=refused)
        self._states.publish(told)

    def notify(self, event: QosNotification.Event.ValueType) -> None:
        self._notes.publish(QosNotification(event=event, topic=f"/{TOPICS[0]}"))

    @property
    def level(self) -> int:
        return self.shortage.level("turtle1")

    @property
    def heard(self) -> int:
        """Requests that the newest state counts."""
        return max((flow.requests for flow in self.shortage._latest.values()), default=0)


@asynccontextmanager
async def shortage(
    master: Master, patience: Patience, groups: dict[str, tuple[str, ...]] | None = None
) -> AsyncIterator[Told]:
    known = {"turtle1": TOPICS} if groups is None else groups
    async with user(master) as node:
        made = Shortage(node, lambda: known, lambda: None, patience)
        await made.open()
        told = Told(made, node)
        await told.open()
        yield told


async def test_a_lost_notification_is_made_up_for_by_the_state(master: Master) -> None:
    async with shortage(master, Patience(0.0, 60.0)) as told:
        told.state("degraded", 1)
        await until(lambda: told.level == 1, "the first downgrade")
        told.state("degraded", 1)
        told.state("pending", 2)
        told.notify(QosNotification.MEASURED)
        told.state("degraded", 2)
        await until(lambda: told.level == 2, "the lower request is not served either")
        told.state("active", 3)
        await until(lambda: not told.shortage._known["turtle1"].is_short, "served")
        assert told.level == 2


async def test_a_downgrade_before_anybody_knew_whose_topic_it_is_is_made_up_for(
    master: Master,
) -> None:
    groups: dict[str, tuple[str, ...]] = {}
    async with shortage(master, Patience(0.0, 60.0), groups) as told:
        told.notify(QosNotification.DOWNGRADED)
        told.state("degraded", 1)
        await until(lambda: told.heard == 1)
        told.shortage.tick(0.0)
        assert told.level == 0
        groups["turtle1"] = TOPICS
        told.shortage.tick(0.0)
        assert told.level == 1


async def test_a_downgrade_that_is_said_twice_counts_once(master: Master) -> None:
    async with shortage(master, Patience(0.0, 60.0)) as told:
        told.state("active", 1)
        await until(lambda: told.heard == 1)
        told.notify(QosNotification.DOWNGRADED)
        await until(lambda: told.level == 1)
        told.state("degraded", 1)
        told.state("requesting", 2)
        await until(lambda: told.heard == 2)
        assert told.level == 1


async def test_who_cannot_be_asked_is_not_refused(master: Master) -> None:
    async with shortage(master, Patience(0.0, 60.0)) as told:
        told.state("failed", 1, refused=True)
        told.state("active", 2)
        await until(lambda: told.heard == 2)
        assert told.level == 0, "a permission may be missing"
        told.notify(QosNotification.DOWNGRADED)
        await until(lambda: told.level == 1)
        told.state("failed", 3)
        await until(lambda: told.heard == 3)
        assert told.level == 1, "the interface is down, the network is not short"
        told.state("failed", 4, refused=True)
        await until(lambda: told.level == 2)


async def test_the_application_is_told_again_until_it_may_be_fast(master: Master) -> None:
    async with shortage(master, Patience(0.0, 60.0)) as told:
        told.shortage.ask("turtle1", 1.0, 0.1)
        told.notify(QosNotification.DOWNGRADED)
        await until(lambda: told.level == 1)
        told.notify(QosNotification.DOWNGRADED)
        await until(lambda: told.level == 2)
        for _ in range(2):
            told.shortage.ask("turtle1", 2.0, 0.1)
        await until(lambda: len(told.asked) == 2)
        assert {(one.speed_factor, one.rate_factor, one.valid_s) for one in told.asked} == {
            (0.5, 0.5, 2.0)
        }
        told.notify(QosNotification.RECOVERED)
        await until(lambda: told.level == 0)
        for _ in range(2):
            told.shortage.ask("turtle1", 1.0, 0.1)
        await until(lambda: len(told.asked) == 3)
        assert (told.asked[-1].speed_factor, told.asked[-1].rate_factor) == (1.0, 1.0)
        told.shortage.release()
        assert len(told.asked) == 3
