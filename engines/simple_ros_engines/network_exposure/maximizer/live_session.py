"""Live topics as an environment, for programs that know no event loop: scripts that train."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from simple_ros.aio import NodeHandle
from simple_ros.errors import SimpleRosError
from simple_ros.net.loop import BackgroundLoop
from simple_ros_engines.network_exposure.maximizer.clamp import SafetyClamp
from simple_ros_engines.network_exposure.maximizer.environment import HORIZON, TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.live import LivePlant, LiveTopics

__all__ = ["NothingToTrainOn", "live_environment"]

_LOOK_S = 0.05


class NothingToTrainOn(SimpleRosError, TimeoutError):
    """Too few processes are both relayed and judged.

    Attributes:
        found: Those that are.
        wait_s: It was waited for so long.
    """

    def __init__(self, found: tuple[str, ...], wait_s: float) -> None:
        self.found = found
        self.wait_s = wait_s
        super().__init__(
            f"within {wait_s:g} s only {', '.join(found) or 'no process'} had its topics relayed (a flow-relay "
            "and /unique_network_flow_stats) and its score published (/MOS)"
        )


@dataclass(slots=True)
class _Session:
    node: NodeHandle
    topics: LiveTopics
    spinning: asyncio.Task[None]


@contextmanager
def live_environment(
    master: str | None = None,
    *,
    name: str = "maximizer_training",
    period_s: float = 4.0,
    least_score: float = 4.0,
    horizon: int = HORIZON,
    processes: int = 1,
    wait_s: float = 30.0,
) -> Iterator[TopicEnvironment]:
    """The topics that are relayed and judged now, to be stepped from this thread.

    Delays are tried on the topics themselves, by the relay's throttle; what makes a score bad is taken back. At the end
    everything is put back.

    Args:
        master: Its address; None is the usual one.
        name: Of the node.
        period_s: A decision stands so long, s.
        least_score: Below it settings are taken back.
        horizon: Decisions in an episode.
        processes: Wait for so many; those that come later are left out.
        wait_s: So long it is waited for them, s.

    Raises:
        NothingToTrainOn: There are fewer.
        ConfigError: ``least_score`` is no score.
    """
    background = BackgroundLoop()
    session: _Session | None = None
    try:
        session = background.run(_open(master, name))
        background.run(_until_judged(session.topics, processes, wait_s))
        plant = LivePlant(session.topics, session.spinning.get_loop(), period_s)
        clamp = SafetyClamp(plant.groups, least_score)
        yield TopicEnvironment(plant, clamp=clamp, horizon=horizon)
    finally:
        if session is not None:
            background.run(_close(session))
        background.stop()


async def _open(master: str | None, name: str) -> _Session:
    node = NodeHandle(name, master=master)
    try:
        await node.start()
        topics = LiveTopics(node, probes=True)
        await topics.open()
    except BaseException:
        await node.close()
        raise
    spinning = asyncio.create_task(_end_with(node, topics))
    return _Session(node, topics, spinning)


async def _end_with(node: NodeHandle, topics: LiveTopics) -> None:
    """Let nobody wait for a node that has ended."""
    try:
        await node.wait_ended()
    finally:
        topics.ended.set()


async def _until_judged(topics: LiveTopics, processes: int, wait_s: float) -> None:
    loop = asyncio.get_running_loop()
    until_s = loop.time() + wait_s
    while len(topics.groups) < processes:
        if loop.time() > until_s:
            raise NothingToTrainOn(tuple(topics.groups), wait_s)
        await asyncio.sleep(_LOOK_S)


async def _close(session: _Session) -> None:
    if not session.node.is_closed:
        session.topics.release()
    session.spinning.cancel()
    await session.node.close()
