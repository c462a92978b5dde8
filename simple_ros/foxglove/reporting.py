"""How the bridge and its clients do: as text, as JSON, as a topic."""

from __future__ import annotations

import asyncio
import time
from typing import Any

from simple_ros.foxglove.client import ClientStatistics
from simple_ros.foxglove.convert.ros_names import ros_definition, ros_name
from simple_ros.foxglove.server import FoxgloveServer
from simple_ros.foxglove.type_book import schema_text
from simple_ros.msg.diagnostic_msgs import DiagnosticArray, DiagnosticStatus, KeyValue

__all__ = [
    "STATS_TOPIC",
    "publish_statistics",
    "statistics_dict",
    "statistics_message",
    "topics_of",
]

STATS_TOPIC = "/bridge/stats"
_PERIOD_S = 1.0


def statistics_dict(item: ClientStatistics, topics: dict[int, str]) -> dict[str, Any]:
    """One client's counters as a value for JSON.

    Args:
        item: The counters.
        topics: Topics by channel id.
    """
    return {
        "client": item.peer,
        "subprotocol": item.subprotocol,
        "subscriptions": item.subscriptions,
        "sent": item.sent,
        "sent_bytes": item.sent_bytes,
        "waiting": item.waiting,
        "waiting_bytes": item.waiting_bytes,
        "dropped": item.dropped_total,
        "dropped_by_topic": {
            topics.get(channel, str(channel)): count for channel, count in item.dropped.items()
        },
        "refused_requests": item.refused,
    }


def topics_of(server: FoxgloveServer) -> dict[int, str]:
    """Topics by channel id."""
    return {channel.id: channel.topic for channel in server.catalog.channels.values()}


def statistics_message(server: FoxgloveServer, now_ns: int) -> DiagnosticArray:
    """The counters of all clients as diagnostics; a client that loses messages is a warning."""
    message = DiagnosticArray()
    message.header.stamp.FromNanoseconds(now_ns)
    topics = topics_of(server)
    for item in server.statistics:
        facts = statistics_dict(item, topics)
        lossy = item.dropped_total > 0
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if lossy else DiagnosticStatus.OK,
            name=f"foxglove client {item.peer}",
            message="messages fell, as the client is too slow" if lossy else "OK",
        )
        for key, value in facts.items():
            status.values.append(KeyValue(key=key, value=str(value)))
        message.status.append(status)
    return message


async def publish_statistics(server: FoxgloveServer) -> None:
    """Offer a channel with the counters, once a second while some client wants it."""
    schema = schema_text(ros_definition(DiagnosticArray))
    channel = server.add_channel(STATS_TOPIC, ros_name(DiagnosticArray), schema)
    while True:
        await asyncio.sleep(_PERIOD_S)
        if server.is_wanted(channel.id):
            now = time.time_ns()
            message = statistics_message(server, now)
            server.publish(channel.id, now, [message.SerializeToString()])
