"""The maximizer over live topics: what it tells throttle, mapper and application, and when it takes it back."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path

import pytest
from support.engines import at_work, user
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.errors import ConfigError
from simple_ros.msg.network_exposure_msgs import (
    FlowQosArray,
    QosAdvice,
    QosNotification,
    Throttle,
    UniqueTopicFlows,
    UniqueTopicFlowStats,
)
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, Mos
from simple_ros.qos import LATCHED
from simple_ros_engines.network_exposure.maximizer.environment import TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.knobs import START, Setting
from simple_ros_engines.network_exposure.maximizer.live import LivePlant, LiveTopics
from simple_ros_engines.network_exposure.maximizer.node import Maximizer
from simple_ros_engines.network_exposure.maximizer.policy_file import policy_from_text, policy_text
from simple_ros_master import Master

TOPICS = ("turtle1/pose", "turtle1/cmd_vel")
QUICK = {"period_s": 0.05, "horizon": 8, "settle_s": 0.3}


class System:
    """What is around the maximizer: a relay that obeys, a process that suffers when messages are held too long."""

    def __init__(self, node: NodeHandle) -> None:
        self.node = node
        self.mos = 4.9
        self.throttles: dict[str, Throttle] = {}
        self.advice: dict[str, QosAdvice] = {}
        self.asked: list[AdaptationRequest] = []
        self.bears_ms = 1e9

    async def open(self) -> None:
        node = self.node
        await node.subscribe("/throttle", Throttle, self._throttle)
        await node.subscribe("/qos_advice", QosAdvice, self._advice)
        await node.subscribe(
            "/application_adaptation_request", AdaptationRequest, self.asked.append
        )
        flows = await node.advertise("/unique_network_flow", UniqueTopicFlows, qos=LATCHED)
        message = UniqueTopicFlows(relay="relay")
        for topic in TOPICS:
            message.flows.add(topic=topic, is_reliable=topic.endswith("cmd_vel"))
        flows.publish(message)
        self._stats = await node.advertise("/unique_network_flow_stats", UniqueTopicFlowStats)
        self._scores = await node.advertise("/MOS", Mos)
        self.network = await node.advertise("/qos_notifications", QosNotification)
        node.create_timer(0.02, lambda _: self._tell())

    def _throttle(self, message: Throttle) -> None:
        self.throttles[message.topic] = message

    def _advice(self, message: QosAdvice) -> None:
        self.advice[message.topic] = message

    def _tell(self) -> None:
        stats = UniqueTopicFlowStats(relay="relay")
        for topic in TOPICS:
            now = self.throttles.get(topic, Throttle())
            stats.stats.add(
                topic=topic,
                window_rate=20.0,
                window_bandwidth=800.0,
                drop_every_nth=now.drop_every_nth,
                delay_ms=now.delay_ms,
            )
        self._stats.publish(stats)
        held_ms = sum(one.delay_ms for one in self.throttles.values())
        score = self.mos if held_ms <= self.bears_ms else 2.0
        self._scores.publish(
            Mos(identifier=Mos.AUTOMATIC, group="turtle1", topics=TOPICS, score=score)
        )

    def said(self, event: QosNotification.Event.ValueType) -> None:
        self.network.publish(QosNotification(event=event, topic=TOPICS[0]))

    def throttle(self, topic: str) -> Throttle:
        """The newest for a topic."""
        return self.throttles.get(topic, Throttle())

    @property
    def budgets_ms(self) -> dict[str, float]:
        return {topic: one.latency_budget_ms for topic, one in self.advice.items()}


@asynccontextmanager
async def system(master: Master) -> AsyncIterator[System]:
    async with user(master) as node:
        made = System(node)
        await made.open()
        yield made


def policy(path: Path) -> Path:
    file = path / "policy.json"
    file.write_text(
        policy_text({"turtle1": {TOPICS[0]: Setting(2, 8, 2), TOPICS[1]: Setting(1, 0, 3)}})
    )
    return file


async def test_a_policy_is_followed_and_put_back_at_the_end(master: Master, tmp_path: Path) -> None:
    file = str(policy(tmp_path))
    async with system(master) as around:
        async with at_work(Maximizer(), master, policy=file, **QUICK):
            # Two intervals of 50 ms, one and a half of them.
            await until(lambda: around.budgets_ms == {TOPICS[0]: 100, TOPICS[1]: 75}, "the advice")
            await until(lambda: around.throttle(TOPICS[0]).drop_every_nth == 2, "the throttle")
            # Who is killed cannot take anything back: it ends by itself.
            assert all(one.valid_s > 0 for one in around.advice.values())
            assert all(one.valid_s > 0 for one in around.throttles.values())
            # What is asked of the network is not tried on the topic, too.
            assert around.throttle(TOPICS[0]).delay_ms == 0
            await until(lambda: any(one.speed_factor == 2 for one in around.asked), "the speed")
        await until(lambda: all(one.clear for one in around.advice.values()), "no advice")
        await until(lambda: not around.throttle(TOPICS[0]).drop_every_nth, "no throttle")
        await until(lambda: around.asked[-1].speed_factor == 1, "the own speed")


async def test_a_bad_score_takes_the_policy_back(master: Master, tmp_path: Path) -> None:
    async with system(master) as around:
        engine = Maximizer()
        async with at_work(engine, master, policy=str(policy(tmp_path)), **QUICK):
            await until(lambda: around.budgets_ms == {TOPICS[0]: 100, TOPICS[1]: 75}, "the advice")
            around.mos = 2.0
            await until(
                lambda: all(one == START for one in engine.learners["turtle1"].best.values()),
                "nothing made worse any more",
            )
            await until(lambda: not any(around.budgets_ms.values()), "no advice")


async def test_it_learns_on_live_topics_and_writes_what_it_learnt(
    master: Master, tmp_path: Path
) -> None:
    file = tmp_path / "learnt.json"
    async with system(master) as around:
        around.bears_ms = 300
        engine = Maximizer()
        async with at_work(engine, master, learn=True, policy=str(file), period_s=0.05, horizon=20):
            await until(lambda: any(one.delay_ms for one in around.throttles.values()), "a trial")
            assert not any(around.budgets_ms.values())
            await until(lambda: engine.learners["turtle1"].kept >= 1, "something better", 60)
            written = engine.episodes
            await until(lambda: engine.episodes > written and file.exists(), "the file")
        (learnt,) = policy_from_text(file.read_text()).values()
        assert set(learnt) == set(TOPICS)


async def test_depletion_lowers_the_request_then_slows_the_application(
    master: Master, tmp_path: Path
) -> None:
    async with system(master) as around:
        async with at_work(Maximizer(), master, policy=str(policy(tmp_path)), **QUICK):
            await until(lambda: around.budgets_ms == {TOPICS[0]: 100, TOPICS[1]: 75}, "the advice")
            await around.network.wait_for_subscribers(1, 30)
            around.asked.clear()
            around.said(QosNotification.DOWNGRADED)
            # As many notches as another class takes: 200 ms is class 2, and 71 if it is reliable.
            await until(lambda: around.budgets_ms == {TOPICS[0]: 200, TOPICS[1]: 200}, "less")
            assert all(one.rate_factor == 1 for one in around.asked)

            def ask_again() -> bool:
                around.said(QosNotification.DOWNGRADED)
                return any(one.rate_factor < 1 for one in around.asked)

            await until(ask_again, "the adaptation")
            assert (around.asked[-1].group, around.asked[-1].speed_factor) == ("turtle1", 0.5)
            assert around.asked[-1].rate_factor == 0.5
            around.said(QosNotification.RECOVERED)
            await until(lambda: around.asked[-1].rate_factor == 1, "the application's own rate")
            await until(lambda: around.budgets_ms == {TOPICS[0]: 100, TOPICS[1]: 75}, "as before")


async def test_a_refused_request_slows_the_application_too(master: Master, tmp_path: Path) -> None:
    async with system(master) as around:
        states = await around.node.advertise("/network_flow_state", FlowQosArray, qos=LATCHED)

        def state_is(state: str, requests: int) -> None:
            told = FlowQosArray()
            told.flows.add(
                topic=TOPICS[0], state=state, is_refused=state == "failed", requests=requests
            )
            states.publish(told)

        tries = count(2)
        async with at_work(Maximizer(), master, policy=str(policy(tmp_path)), **QUICK):
            await until(lambda: around.budgets_ms == {TOPICS[0]: 100, TOPICS[1]: 75}, "the advice")
            await around.network.wait_for_subscribers(1, 30)
            await states.wait_for_subscribers(1, 30)
            # Not served before anything was downgraded: that is no depletion.
            state_is("failed", 1)
            around.asked.clear()
            around.said(QosNotification.DOWNGRADED)
            await until(lambda: around.budgets_ms[TOPICS[0]] == 200, "less")

            def refused_again() -> bool:
                # The lower request, as often as it is tried.
                state_is("failed", next(tries))
                return any(one.rate_factor < 1 for one in around.asked)

            await until(refused_again, "the adaptation")
            assert around.asked[-1].rate_factor == 0.5
            around.said(QosNotification.RECOVERED)
            await until(lambda: around.asked[-1].rate_factor == 1, "the application's own rate")


async def test_live_topics_are_an_environment_like_any_other(master: Master) -> None:
    async with system(master) as around:
        topics = LiveTopics(around.node, probes=True)
        await topics.open()
        await until(lambda: topics.groups, "what is judged and relayed")
        plant = LivePlant(topics, asyncio.get_running_loop(), 0.05)
        environment = TopicEnvironment(plant, horizon=2)
        await asyncio.to_thread(environment.reset)
        step = await asyncio.to_thread(environment.step, {TOPICS[0]: (1, 1, 0)})
        assert step.seen[TOPICS[0]].mos == pytest.approx(4.9)
        assert step.rewards[TOPICS[0]] > step.rewards[TOPICS[1]]
        await until(lambda: around.throttle(TOPICS[0]).delay_ms == 75)


async def test_a_wrong_policy_is_told_at_the_start(master: Master, tmp_path: Path) -> None:
    file = tmp_path / "policy.json"
    file.write_text("[]")
    async with NodeHandle("m", master=master.address) as node:
        await node.set_parameters({"~policy": str(file)})
        with pytest.raises(ConfigError, match="no policy"):
            await Maximizer().run(node)
