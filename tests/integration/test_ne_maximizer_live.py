"""The maximizer's environments over live topics, for other people's checkers and for threads; networks and files in the node."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.engines import at_work, user
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.errors import ConfigError
from simple_ros.msg.network_exposure_msgs import (
    QosAdvice,
    Throttle,
    UniqueTopicFlowStats,
)
from simple_ros.msg.turtlesim_msgs import Mos
from simple_ros_engines.network_exposure.maximizer.clamp import SafetyClamp
from simple_ros_engines.network_exposure.maximizer.environment import TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.knobs import DELAYS, START, Setting
from simple_ros_engines.network_exposure.maximizer.live import LivePlant, LiveTopics
from simple_ros_engines.network_exposure.maximizer.live_session import (
    NothingToTrainOn,
    live_environment,
)
from simple_ros_engines.network_exposure.maximizer.network import ANY_TOPIC, Network, NetworkPolicy
from simple_ros_engines.network_exposure.maximizer.node import Maximizer
from simple_ros_engines.network_exposure.maximizer.policy_file import (
    network_text,
    policy_from_text,
    policy_text,
)
from simple_ros_engines.network_exposure.maximizer.wrappers import gymnasium_env, parallel_env
from simple_ros_master import Master

TOPICS = ("turtle1/pose", "turtle1/cmd_vel")
PERIOD_S = 0.03
RATE_HZ = 20.0


class Process:
    """A relay that obeys the throttle, and a process judged by how long messages are held."""

    def __init__(self, node: NodeHandle) -> None:
        self.node = node
        self.bears_ms = 1e9
        self.human: float | None = None
        self.throttles: dict[str, Throttle] = {}
        self.advice: dict[str, QosAdvice] = {}

    async def open(self) -> None:
        node = self.node
        await node.subscribe("/throttle", Throttle, self._throttle)
        await node.subscribe("/qos_advice", QosAdvice, self._advise)
        self._stats = await node.advertise("/unique_network_flow_stats", UniqueTopicFlowStats)
        self._scores = await node.advertise("/MOS", Mos)
        node.create_timer(0.01, lambda _: self._tell())

    @property
    def held_ms(self) -> float:
        return sum(one.delay_ms for one in self.throttles.values())

    @property
    def budgets_ms(self) -> dict[str, float]:
        return {topic: one.latency_budget_ms for topic, one in self.advice.items()}

    def _throttle(self, message: Throttle) -> None:
        self.throttles[message.topic] = message

    def _advise(self, message: QosAdvice) -> None:
        self.advice[message.topic] = message

    def _tell(self) -> None:
        stats = UniqueTopicFlowStats(relay="relay")
        for topic in TOPICS:
            now = self.throttles.get(topic, Throttle())
            stats.stats.add(
                topic=topic,
                window_rate=RATE_HZ,
                window_bandwidth=800.0,
                drop_every_nth=now.drop_every_nth,
                delay_ms=now.delay_ms,
            )
        self._stats.publish(stats)
        score = 4.9 if self.held_ms <= self.bears_ms else 2.0
        self._judge(Mos.AUTOMATIC, score)
        if self.human is not None:
            self._judge(Mos.HUMAN, self.human)

    def _judge(self, judge: Mos.Identifier.ValueType, score: float) -> None:
        self._scores.publish(Mos(identifier=judge, group="turtle1", topics=TOPICS, score=score))


@asynccontextmanager
async def process(master: Master) -> AsyncIterator[Process]:
    async with user(master) as node:
        made = Process(node)
        await made.open()
        yield made


async def live(around: Process, horizon: int = 1000) -> TopicEnvironment:
    topics = LiveTopics(around.node, probes=True)
    await topics.open()
    await until(lambda: topics.groups, "what is judged and relayed")
    plant = LivePlant(topics, asyncio.get_running_loop(), PERIOD_S)
    return TopicEnvironment(plant, clamp=SafetyClamp(plant.groups), horizon=horizon)


def network(delay: int) -> str:
    """The file of a network that moves the delay of each topic so, whatever it sees."""
    wanted = np.zeros((3, 3))
    wanted[:, 1] = 0.5
    wanted[0, delay + 1] = 1.0
    layers = [(np.zeros((9, 8)), wanted.reshape(9))]
    return network_text(NetworkPolicy({ANY_TOPIC: Network(layers)}))


# -- other people's checkers, on live topics -------------------------------------------------------


async def test_gymnasiums_checker_is_content_with_live_topics(master: Master) -> None:
    checker = pytest.importorskip("gymnasium.utils.env_checker", reason="needs gymnasium")
    async with process(master) as around:
        env = gymnasium_env(await live(around), TOPICS[0])
        # Live topics cannot be begun anew: the environment says so.
        assert env.spec.nondeterministic is True
        await asyncio.to_thread(checker.check_env, env)


async def test_pettingzoos_checker_is_content_with_live_topics(master: Master) -> None:
    tests = pytest.importorskip("pettingzoo.test", reason="needs pettingzoo")
    async with process(master) as around:
        env = parallel_env(await live(around, horizon=8))
        await asyncio.to_thread(tests.parallel_api_test, env, 20)
        assert set(env.possible_agents) == set(TOPICS)


# -- scripts that know no event loop ---------------------------------------------------------------


def in_a_script(master: Master, use: Callable[[TopicEnvironment], Any]) -> Any:
    with live_environment(master.address, period_s=PERIOD_S, wait_s=20) as environment:
        return use(environment)


async def test_a_script_steps_live_topics_and_puts_everything_back(master: Master) -> None:
    async with process(master) as around:
        loop = asyncio.get_running_loop()
        held = 1000 * DELAYS[2] / RATE_HZ

        def use(environment: TopicEnvironment) -> None:
            environment.reset()
            environment.step({TOPICS[0]: (1, 1, 0)})
            step = environment.step({TOPICS[0]: (1, 0, 0)})
            assert step.seen[TOPICS[0]].mos == pytest.approx(4.9)
            # What it said comes here a moment later.
            comes = until(lambda: around.held_ms == held, "the throttle")
            asyncio.run_coroutine_threadsafe(comes, loop).result()
            # A throttle ends by itself soon after whoever asked for it is killed.
            assert 3 * PERIOD_S < around.throttles[TOPICS[0]].valid_s < 60

        await asyncio.to_thread(in_a_script, master, use)
        await until(lambda: around.held_ms == 0, "everything put back")
        assert not around.throttles[TOPICS[0]].drop_every_nth


async def test_a_script_is_told_that_there_is_nothing_to_train_on(master: Master) -> None:
    def nothing() -> None:
        with live_environment(master.address, wait_s=0.1):
            raise AssertionError("there is no process")

    with pytest.raises(NothingToTrainOn, match="no process had its topics relayed") as told:
        await asyncio.to_thread(nothing)
    assert told.value.found == ()


# -- networks in the node --------------------------------------------------------------------------


async def test_networks_settle_by_trying_then_the_network_is_asked(
    master: Master, tmp_path: Path
) -> None:
    file = tmp_path / "networks.json"
    file.write_text(network(1))
    async with process(master) as around:
        around.bears_ms = 320
        engine = Maximizer()
        async with at_work(engine, master, policy=str(file), period_s=0.05, horizon=60):
            await until(lambda: around.held_ms > 0, "a delay that is tried")
            assert not any(around.budgets_ms.values())
            await until(lambda: any(around.budgets_ms.values()), "what was found is asked for", 30)
            # Both at once: 150 ms each is borne, 200 is not.
            wanted = {topic: Setting(3) for topic in TOPICS}
            assert engine.learners["turtle1"].best == wanted
            await until(lambda: around.held_ms == 0, "nothing is held any more")
            asked = dict.fromkeys(TOPICS, 1000 * DELAYS[3] / RATE_HZ)
            await until(lambda: around.budgets_ms == asked, "the budgets")
        await until(lambda: all(one.clear for one in around.advice.values()), "no advice")


async def test_a_person_outweighs_the_program(master: Master, tmp_path: Path) -> None:
    file = tmp_path / "policy.json"
    file.write_text(policy_text({"turtle1": {topic: Setting(2) for topic in TOPICS}}))
    async with process(master) as around:
        engine = Maximizer()
        async with at_work(engine, master, policy=str(file), period_s=0.05, horizon=8):
            await until(lambda: around.budgets_ms == dict.fromkeys(TOPICS, 100), "the policy")
            around.human = 2.0  # the program still says 4.9
            await until(lambda: not any(around.budgets_ms.values()), "taken back")
            learner = engine.learners["turtle1"]
            await until(lambda: all(one == START for one in learner.best.values()), "given up")


# -- files -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "learn", "why"),
    [
        (network(1)[:-40], False, "must be JSON"),
        (network(1).replace("0.5", "0.6", 1), False, "damaged policy"),
        (policy_text({"t": {"t/pose": START}}).replace("0", "1", 1), True, "damaged policy"),
        (network(1), True, "networks are trained by what made them"),
    ],
)
async def test_a_file_that_is_no_good_is_named_and_kept(
    master: Master, tmp_path: Path, text: str, learn: bool, why: str
) -> None:
    file = tmp_path / "policy.json"
    file.write_text(text)
    async with NodeHandle("m", master=master.address) as node:
        await node.set_parameters({"~policy": str(file), "~learn": learn})
        with pytest.raises(ConfigError, match=rf"policy\.json: .*{why}"):
            await Maximizer().run(node)
    assert file.read_text() == text


async def test_a_policy_is_written_whole(
    master: Master, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever looks at the file at any time sees a whole policy, and nothing is left beside it."""
    file = tmp_path / "policy.json"
    replaced: list[str] = []
    replace = Path.replace

    def noted(self: Path, target: Path) -> Path:
        replaced.append(self.read_text())
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", noted)
    async with process(master):
        async with at_work(
            Maximizer(), master, learn=True, policy=str(file), period_s=0.05, horizon=3
        ):
            await until(lambda: len(replaced) >= 2, "two episodes")
    assert all(policy_from_text(one) for one in replaced)
    assert await asyncio.to_thread(os.listdir, tmp_path) == [file.name]
