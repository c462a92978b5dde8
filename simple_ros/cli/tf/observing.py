"""What the commands share that listen to all transforms."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

from simple_ros.cli.text import duration_text, json_line
from simple_ros.cli.topic.following import cli_node

if TYPE_CHECKING:
    from simple_ros.clock import Clock
    from simple_ros.msg.tf2_msgs import TFMessage
    from simple_ros.node import NodeHandle
    from simple_ros.tf.observation import Edge, Observation

__all__ = ["edge_cells", "observation_json", "observing"]


@asynccontextmanager
async def observing(master: str | None) -> AsyncIterator[tuple[NodeHandle, Observation, Clock]]:
    """A node that takes every transform into an observation."""
    from simple_ros.clock import Clock
    from simple_ros.msg.tf2_msgs import TFMessage
    from simple_ros.qos import QosProfile, Reliability
    from simple_ros.tf.observation import Observation

    qos = QosProfile(depth=1000, reliability=Reliability.BEST_EFFORT)
    async with cli_node("tf", master) as node:
        observation, clock = Observation(), Clock.attach(node)

        def take(message: TFMessage, is_static: bool) -> None:
            now_s = clock.now().seconds
            for transform in message.transforms:
                observation.receive(transform, now_s, is_static=is_static)

        await node.subscribe("/tf", TFMessage, lambda message: take(message, False), qos=qos)
        await node.subscribe("/tf_static", TFMessage, lambda message: take(message, True), qos=qos)
        yield node, observation, clock


def edge_cells(edge: Edge | None) -> tuple[str, str]:
    """Rate and age of a frame."""
    if edge is None:
        return ("", "")
    if edge.is_static:
        return ("static", "")
    rate = "once" if edge.rate_hz is None else f"{edge.rate_hz:.1f} Hz"
    return (rate, "" if edge.age_s is None else f"age {duration_text(edge.age_s)}")


def _edge_json(edge: Edge) -> dict[str, Any]:
    """A frame as a value for JSON."""
    return {
        "frame": edge.frame,
        "parent": edge.parent,
        "static": edge.is_static,
        "count": edge.count,
        "rate_hz": edge.rate_hz,
        "age_s": edge.age_s,
        "delay_s": edge.delay_s,
        "max_delay_s": edge.max_delay_s,
        "parents": list(edge.parents),
    }


def observation_json(observation: Observation, now_s: float) -> str:
    """The roots, the frames and what is broken, as JSON in one line."""
    return json_line(
        {
            "roots": list(observation.roots()),
            "frames": [_edge_json(edge) for edge in observation.edges(now_s)],
            "problems": [
                {"frame": problem.frame, "text": problem.text}
                for problem in observation.problems(now_s)
            ],
        }
    )
