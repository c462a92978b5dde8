"""The parameters of the relay, and what is made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from simple_ros.errors import ConfigError
from simple_ros.node import NodeHandle
from simple_ros_engines.network_exposure.offers import Offered
from simple_ros_engines.network_exposure.raw import Raw
from simple_ros_engines.network_exposure.relay_plan import PlanSettings, Wanted
from simple_ros_engines.network_exposure.relayed import TopicSettings
from simple_ros_engines.network_exposure.reorder import DropLate, HoldBack, Reorder
from simple_ros_engines.network_exposure.requirement import FlowProfile
from simple_ros_engines.network_exposure.tags import Role, TagRules

__all__ = ["RelaySettings", "relay_settings"]

_ROLES = {"relay": Role.RELAY, "out": Role.TUNNEL_START, "in": Role.TUNNEL_END}


@dataclass(frozen=True, slots=True)
class RelaySettings:
    """How a relay works.

    Attributes:
        plan: Which topics it takes up.
        transports: How messages travel, most wanted first.
        window_s: Of the statistics.
        stats_period_s: Between two messages of them.
        qcis: Tunnels of each topic, one for each class; none for one without.
        hold_s: At a tunnel's end: how long what is missing is waited for; None drops what is late.
        budgets: Latency budgets in ms, by topic.
        dscp: Code points, by topic.
    """

    plan: PlanSettings = field(default_factory=PlanSettings)
    transports: tuple[str, ...] = ("tcp",)
    window_s: float = 5.0
    stats_period_s: float = 1.0
    qcis: tuple[int, ...] = ()
    hold_s: float | None = None
    budgets: Mapping[str, float] = field(default_factory=dict)
    dscp: Mapping[str, float] = field(default_factory=dict)

    def outputs(self, want: Wanted) -> dict[str, int]:
        """Where a topic goes, with the classes of its tunnels (0 for none)."""
        if want.role is not Role.TUNNEL_START:
            return {want.base: 0}
        rules = self.plan.rules
        by_class = {rules.tunnel_topic(want.base, qci): qci for qci in self.qcis}
        return by_class or {rules.tunnel_topic(want.base): 0}

    def of(self, want: Wanted, offered: Offered) -> TopicSettings:
        """How one topic is handed on."""
        dscp = _said(self.dscp, want)
        return TopicSettings(
            self.transports,
            self.window_s,
            self.qcis if want.role is Role.TUNNEL_START else (),
            self.profile(want, offered),
            offered.relayed,
            None if dscp is None else int(dscp),
        )

    def profile(self, want: Wanted, offered: Offered) -> FlowProfile:
        """What a topic needs by what its publishers offer, and by what was said about it."""
        return offered.profile(_said(self.budgets, want) or 0.0)

    def order(self) -> Reorder[Raw]:
        """What puts the messages of a tunnel in order."""
        return DropLate() if self.hold_s is None else HoldBack(self.hold_s)


async def relay_settings(node: NodeHandle) -> RelaySettings:
    """Declare them.

    Raises:
        ConfigError: One makes no sense.
    """
    get = node.declare_parameter
    await get("~mark", True)
    await get("~throttle_valid_s", 30.0, minimum=0.0, maximum=86_400.0)
    orders = ("drop_late", "hold")
    order = await get("~reorder", orders[0], choices=orders, read_only=True)
    hold_ms = await get("~hold_ms", 50.0, minimum=0.0, maximum=10_000.0, read_only=True)
    window_s = await get("~window_s", 5.0, minimum=2.0, maximum=10.0, read_only=True)
    period_s = await get("~stats_period_s", 1.0, minimum=0.05, maximum=60.0, read_only=True)
    budgets = await get("~latency_budgets", [], type="string[]", read_only=True)
    return RelaySettings(
        await _plan(node),
        tuple(await get("~transports", ["tcp"], read_only=True)),
        float(window_s),
        float(period_s),
        tuple(await get("~qcis", [], type="int[]", read_only=True)),
        float(hold_ms) / 1000 if order == "hold" else None,
        _pairs("latency_budgets", budgets),
        _pairs("dscp", await get("~dscp", [], type="string[]", read_only=True)),
    )


async def _plan(node: NodeHandle) -> PlanSettings:
    get = node.declare_parameter
    tags = TagRules()
    rules = TagRules(
        str(await get("~tag", tags.relay, read_only=True)),
        str(await get("~out_tag", tags.start, read_only=True)),
        str(await get("~in_tag", tags.end, read_only=True)),
        str(await get("~tunnel_tag", tags.tunnel, read_only=True)),
        str(await get("~qci_tag", tags.per_qci, read_only=True)),
    )
    topics = await get("~topics", [], type="string[]", read_only=True)
    roles = await get("~roles", list(_ROLES), read_only=True)
    only_local = bool(await get("~only_local", False, read_only=True))
    unknown = set(roles) - _ROLES.keys()
    if unknown:
        raise ConfigError(f"roles: {', '.join(unknown)} is none of {', '.join(_ROLES)}")
    return PlanSettings(
        rules,
        frozenset(_ROLES[name] for name in roles),
        frozenset(node.resolve_name(topic) for topic in topics),
        node.ip if only_local else "",
    )


def _said(values: Mapping[str, float], want: Wanted) -> float | None:
    """What was said about a topic, by its name with or without the tag."""
    return values.get(want.base, values.get(want.source))


def _pairs(what: str, items: Sequence[str]) -> dict[str, float]:
    """``TOPIC=NUMBER`` as a table.

    Raises:
        ConfigError: One is of another form.
    """
    found = {}
    for item in items:
        topic, _, number = item.rpartition("=")
        try:
            found[topic.strip("/")] = float(number)
        except ValueError as error:
            raise ConfigError(f"{what}: {item!r} is not TOPIC=NUMBER") from error
    return found
