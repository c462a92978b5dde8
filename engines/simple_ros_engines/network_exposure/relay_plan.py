"""Which topics a relay takes up, from the graph. Pure.

A topic is relayed by one relay only: who comes second leaves it alone, and takes it up once the first is gone. Two that
began at the same moment see each other; then the one whose name comes first in the alphabet goes on.
"""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field

from simple_ros.graph import GraphNode, GraphSnapshot
from simple_ros_engines.network_exposure.tags import Role, Tagged, TagRules

__all__ = ["FLOWS_TOPIC", "PlanSettings", "RelayPlan", "Wanted", "plan"]

FLOWS_TOPIC = "/unique_network_flow"
"""Every relay publishes it: by it they know each other."""


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


def plan(
    graph: GraphSnapshot,
    own_name: str,
    settings: PlanSettings,
    held: AbstractSet[Wanted] = frozenset(),
) -> RelayPlan:
    """What a relay does with a graph.

    Args:
        graph: All nodes.
        own_name: The relay's node; what it publishes is no reason to relay.
        settings: What it is for.
        held: What it relays already.
    """
    found: dict[Wanted, Tagged] = {}
    tunnels: dict[str, dict[str, int]] = {}
    publishers: dict[str, set[str]] = {}
    for node in graph.nodes:
        for key in node.publishes:
            tagged = settings.rules.parse(key.topic)
            if node.name != own_name:
                publishers.setdefault(key.topic, set()).add(node.name)
            if tagged is None:
                continue
            if tagged.role is Role.TUNNEL:
                tunnels.setdefault(tagged.base, {})[key.topic] = tagged.qci
            elif _takes_up(tagged, node, own_name, settings):
                found[Wanted(tagged.role, tagged.base, key.topic, key.msg_type)] = tagged
    found |= _ends(graph, tunnels, settings)
    rivals = _Rivals(publishers, _relays(graph, own_name), own_name)
    refused = _refused(found, tunnels, rivals, held, settings.rules)
    wanted = frozenset(want for want, tagged in found.items() if tagged.topic not in refused)
    return RelayPlan(wanted, tunnels, refused)


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
) -> dict[Wanted, Tagged]:
    """Tunnels to take messages out of: those with somebody who wants them."""
    if Role.TUNNEL_END not in settings.roles:
        return {}
    rules = settings.rules
    heard = {
        key.topic
        for node in graph.nodes
        if settings.local_ip in ("", node.ip)
        for key in node.subscribes
    }
    return {
        Wanted(Role.TUNNEL_END, base, rules.tunnel_topic(base)): Tagged(out, base, Role.TUNNEL_END)
        for base in tunnels
        if (out := rules.out_topic(base)) in heard
        and (not settings.topics or out in settings.topics)
    }


@dataclass(frozen=True, slots=True)
class _Rivals:
    """Who else publishes what a relay would publish, or takes it out of its tunnels."""

    publishers: dict[str, set[str]]
    relays: dict[str, GraphNode]
    own_name: str

    def objection(self, targets: Iterable[str], *, is_held: bool) -> str:
        """Why topics must not be published by this relay, too; empty if they may."""
        for target in sorted(targets):
            for name in sorted(self.publishers.get(target, ())):
                if name not in self.relays:
                    return f"{target} is published by {name} already"
                if self._goes_before(name, is_held):
                    return f"it is relayed to {target} by {name} already"
        return ""

    def other_end(self, tunnels: Iterable[str], *, is_held: bool) -> str:
        """Who takes a topic out of its tunnels already; it publishes only when something comes."""
        inside = set(tunnels)
        for name, node in sorted(self.relays.items()):
            hears = any(key.topic in inside for key in node.subscribes)
            if hears and self._goes_before(name, is_held):
                return f"{name} takes it out of its tunnel already"
        return ""

    def _goes_before(self, name: str, is_held: bool) -> bool:
        return not is_held or name < self.own_name


def _relays(graph: GraphSnapshot, own_name: str) -> dict[str, GraphNode]:
    mark = FLOWS_TOPIC.strip("/")
    return {
        node.name: node
        for node in graph.nodes
        if node.name != own_name and any(key.topic.strip("/") == mark for key in node.publishes)
    }


def _refused(
    found: dict[Wanted, Tagged],
    tunnels: dict[str, dict[str, int]],
    rivals: _Rivals,
    held: AbstractSet[Wanted],
    rules: TagRules,
) -> dict[str, str]:
    refused = {}
    for want, tagged in found.items():
        is_held = want in held
        inside = tunnels.get(want.base, ())
        match want.role:
            case Role.RELAY:
                reason = rivals.objection([want.base], is_held=is_held)
            case Role.TUNNEL_START:
                reason = rivals.objection(inside, is_held=is_held)
            case _:
                reason = rivals.objection([rules.out_topic(want.base)], is_held=is_held)
                reason = reason or rivals.other_end(inside, is_held=is_held)
        if reason:
            refused[tagged.topic] = reason
    return refused
