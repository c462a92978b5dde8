"""Which topics a relay takes up, from the graph. Pure."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field

from simple_ros.graph import GraphNode, GraphSnapshot
from simple_ros_engines.network_exposure.tags import Role, Tagged, TagRules, collisions

__all__ = ["PlanSettings", "RelayPlan", "Wanted", "plan"]


@dataclass(frozen=True, slots=True)
class Wanted:
    """One topic to take up.

    Attributes:
        role: What for.
        base: Its name without a tag.
        source: Where its messages come from; for the end of a tunnel, the tunnel without a class.
        msg_type: Of its messages; empty at the end of a tunnel, where they say it themselves.
    """

    role: Role
    base: str
    source: str
    msg_type: str = ""


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """What a relay is for.

    Attributes:
        rules: The tags.
        roles: Which it plays.
        topics: Tagged topics it cares for, as they are published; empty for all.
        local_ip: Only topics that begin (or, out of a tunnel, end) on this host; empty for any host.
    """

    rules: TagRules = field(default_factory=TagRules)
    roles: AbstractSet[Role] = frozenset({Role.RELAY, Role.TUNNEL_START, Role.TUNNEL_END})
    topics: AbstractSet[str] = frozenset()
    local_ip: str = ""


@dataclass(frozen=True, slots=True)
class RelayPlan:
    """What to do.

    Attributes:
        wanted: Topics to take up.
        tunnels: Of each that comes out of a tunnel, the topics inside it with their classes.
        refused: Tagged topics that must be left alone, and why.
    """

    wanted: frozenset[Wanted]
    tunnels: dict[str, dict[str, int]]
    refused: dict[str, str]


def plan(graph: GraphSnapshot, own_name: str, settings: PlanSettings) -> RelayPlan:
    """What a relay does with a graph.

    Args:
        graph: All nodes.
        own_name: The relay's node; what it publishes is no reason to relay.
        settings: What it is for.
    """
    found: dict[Wanted, Tagged] = {}
    tunnels: dict[str, dict[str, int]] = {}
    published: dict[str, str] = {}
    for node in graph.nodes:
        for key in node.publishes:
            tagged = settings.rules.parse(key.topic)
            if tagged is None:
                if node.name != own_name:
                    published[key.topic] = node.name
            elif tagged.role is Role.TUNNEL:
                tunnels.setdefault(tagged.base, {})[key.topic] = tagged.qci
            elif _takes_up(tagged, node, own_name, settings):
                found[Wanted(tagged.role, tagged.base, key.topic, key.msg_type)] = tagged
    refused = collisions(sorted(found.values(), key=lambda item: item.topic), published)
    wanted = {want for want, tagged in found.items() if tagged.topic not in refused}
    ends = _ends(graph, tunnels, settings)
    return RelayPlan(frozenset(wanted | ends), tunnels, refused)


def _takes_up(tagged: Tagged, node: GraphNode, own_name: str, settings: PlanSettings) -> bool:
    return (
        tagged.role in (Role.RELAY, Role.TUNNEL_START)
        and tagged.role in settings.roles
        and node.name != own_name
        and (not settings.topics or tagged.topic in settings.topics)
        and settings.local_ip in ("", node.ip)
    )


def _ends(
    graph: GraphSnapshot, tunnels: dict[str, dict[str, int]], settings: PlanSettings
) -> set[Wanted]:
    """Tunnels to take messages out of: those with somebody who wants them."""
    if Role.TUNNEL_END not in settings.roles:
        return set()
    rules = settings.rules
    heard = {
        key.topic
        for node in graph.nodes
        if settings.local_ip in ("", node.ip)
        for key in node.subscribes
    }
    return {
        Wanted(Role.TUNNEL_END, base, rules.tunnel_topic(base))
        for base in tunnels
        if rules.out_topic(base) in heard
        and (not settings.topics or rules.out_topic(base) in settings.topics)
    }
