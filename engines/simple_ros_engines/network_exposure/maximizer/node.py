"""The maximizer as a node: finds out, or follows what was found out, how little of the network topics need."""

from __future__ import annotations

import asyncio
import logging
import os
from pathlib import Path
from statistics import fmean
from typing import ClassVar

from simple_ros.engine import Engine
from simple_ros.errors import ConfigError
from simple_ros.node import NodeHandle
from simple_ros_engines.network_exposure.maximizer.agent import LoopLearner
from simple_ros_engines.network_exposure.maximizer.clamp import SafetyClamp
from simple_ros_engines.network_exposure.maximizer.environment import TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.follower import NetworkFollower
from simple_ros_engines.network_exposure.maximizer.knobs import Setting
from simple_ros_engines.network_exposure.maximizer.live import LivePlant, LiveTopics, NotLive
from simple_ros_engines.network_exposure.maximizer.network import NetworkPolicy
from simple_ros_engines.network_exposure.maximizer.policy_file import (
    policy_text,
    read_policy,
    settings_for,
)
from simple_ros_engines.network_exposure.maximizer.shortage import Patience
from simple_ros_engines.network_exposure.maximizer.training import run_episode, train

__all__ = ["Maximizer"]

logger = logging.getLogger(__name__)

_LOOK_S = 0.2


class Maximizer(Engine):
    """Lowers what topics ask of the network as far as the score of their process stays good.

    It waits until relays tell of topics and ``/MOS`` of processes. Parameters of its node: ``learn`` (try things on
    the live process; otherwise go to what the policy says), ``policy`` (file; read at the start if it is there, written
    after each episode of learning; one with networks lets them try for an episode, then goes to where they stayed), ``period_s`` (a decision stands so long), ``horizon`` (decisions in an episode),
    ``least_score`` (below it settings are taken back), ``settle_s`` (after a measure against a shortage of the network
    so long before the next), ``patience_s`` (before more is asked for again).

    Attributes:
        learners: By process.
        episodes: That have ended.
    """

    node_name: ClassVar[str] = "mos_qos_ratio_maximizer"
    summary: ClassVar[str] = "Lowers what topics ask of the network while their score stays good."

    def __init__(self) -> None:
        self.learners: dict[str, LoopLearner] = {}
        self.episodes = 0
        self._learns = False
        self._file: Path | None = None
        self._policy: dict[str, dict[str, Setting]] = {}
        self._networks: NetworkPolicy | None = None

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends.

        Raises:
            ConfigError: The policy's file is none, or has networks while ``learn`` is set.
        """
        get = node.declare_parameter
        self._learns = bool(await get("~learn", False, read_only=True))
        policy = str(await get("~policy", "", read_only=True))
        period_s = float(await get("~period_s", 4.0, minimum=0.05, maximum=600, read_only=True))
        horizon = int(await get("~horizon", 128, minimum=1, maximum=100_000, read_only=True))
        least = float(await get("~least_score", 4.0, minimum=1, maximum=5, read_only=True))
        self._file = Path(policy) if policy else None
        if self._file is not None and (self._file.exists() or not self._learns):
            self._take(self._file, await asyncio.to_thread(self._file.read_text))
        patience = Patience(
            float(await get("~settle_s", 8.0, minimum=0, maximum=600, read_only=True)),
            float(await get("~patience_s", 15.0, minimum=0.5, maximum=3600, read_only=True)),
        )
        topics = LiveTopics(node, probes=self._learns, patience=patience)
        await topics.open()
        working = asyncio.create_task(self._work(topics, period_s, horizon, least))
        spinning = asyncio.create_task(node.spin())
        try:
            await asyncio.wait((working, spinning), return_when=asyncio.FIRST_COMPLETED)
            if working.done():
                await working
            await spinning
        finally:
            topics.ended.set()
            spinning.cancel()
            # It waits for a thread, which ends with what it waits for.
            await asyncio.gather(working, spinning, return_exceptions=True)
            if not node.is_closed:
                topics.release()

    async def _work(self, topics: LiveTopics, period_s: float, horizon: int, least: float) -> None:
        loop = asyncio.get_running_loop()
        while not topics.ended.is_set():
            if not topics.groups:
                await asyncio.sleep(_LOOK_S)
                continue
            plant = LivePlant(topics, loop, period_s)
            clamp = SafetyClamp(plant.groups, least)
            environment = TopicEnvironment(plant, clamp=clamp, horizon=horizon)
            for group, members in plant.groups.items():
                if group not in self.learners or self.learners[group].topics != members:
                    self.learners[group] = self._learner(members)
            logger.info("looking after %s", ", ".join(plant.groups))
            try:
                if self._networks is not None:
                    await self._settle(environment, topics, self._networks)
                await self._episodes(environment, topics)
            except NotLive:
                return

    async def _episodes(self, environment: TopicEnvironment, topics: LiveTopics) -> None:
        """Until there are other processes than at the beginning."""
        known = environment.plant.groups
        learners = {group: self.learners[group] for group in known}
        while topics.groups == known:
            (episode,) = await asyncio.to_thread(train, environment, learners, 1)
            self.episodes += 1
            logger.info(
                "episode %d: score %.2f, %d settings taken back",
                self.episodes,
                fmean(episode.mos.values()),
                episode.reverted,
            )
            if self._learns and self._file is not None:
                text = policy_text({group: one.best for group, one in learners.items()})
                await asyncio.to_thread(_write, self._file, text)

    async def _settle(
        self, environment: TopicEnvironment, topics: LiveTopics, networks: NetworkPolicy
    ) -> None:
        """Let networks find settings for an episode; they were trained on topics that are really delayed."""
        follower = NetworkFollower(environment, networks)
        topics.probes = True
        try:
            await asyncio.to_thread(run_episode, environment, follower.choose, follower.told)
        finally:
            topics.probes = False
        for group, settings in follower.settled.items():
            self.learners[group].best = settings
        logger.info("the policy's networks have settled")

    def _take(self, file: Path, text: str) -> None:
        try:
            policy = read_policy(text)
        except ConfigError as error:
            raise ConfigError(f"{file}: {error}") from None
        if isinstance(policy, NetworkPolicy):
            if self._learns:
                raise ConfigError(
                    f"{file}: networks are trained by what made them; learn goes on from settings only"
                )
            self._networks = policy
        else:
            self._policy = policy.processes

    def _learner(self, members: tuple[str, ...]) -> LoopLearner:
        learner = LoopLearner(members, learns=self._learns)
        if self._policy:
            learner.best = settings_for(self._policy, members)
        return learner


def _write(file: Path, text: str) -> None:
    """So that whoever is killed meanwhile leaves the whole old file or the whole new one."""
    beside = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        beside.write_text(text)
        beside.replace(file)
    finally:
        beside.unlink(missing_ok=True)
