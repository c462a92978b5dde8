"""The link shaper's settings from what a YAML file holds. Pure.

Unknown keys are errors that name the place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros_engines.radio.carrier import Carrier, resource_blocks
from simple_ros_engines.simulator.shaper_settings import (
    DIRECTIONS,
    EVERYTHING,
    Conditions,
    LinkSettings,
    Overflow,
    ShaperSettings,
    TopicClass,
)

__all__ = ["changed_conditions", "read_settings"]

_CONDITIONS = {
    "rate_mbps": ("rate_bps", 1e6),
    "delay_ms": ("delay_s", 1e-3),
    "jitter_ms": ("jitter_s", 1e-3),
    "loss": ("loss", 1.0),
    "min_share": ("min_share", 1.0),
    "max_share": ("max_share", 1.0),
}
_CLASS = {f.name for f in fields(TopicClass)} - {"deadline_s"} | {"deadline_ms"}
_CARRIER = {"scs_khz", "bandwidth_mhz", "share", "layers"}
_LINK = {"up", "down", "rnti", "channel", "pose_topic"}
_TOP = {"links", "classes", "carrier", "seed", "listen", "rrm_policy_file"}


def changed_conditions(before: Conditions, changes: Mapping[str, Any], where: str) -> Conditions:
    """Conditions after changes named as in settings (``rate_mbps``, ``delay_ms``, ...).

    Raises:
        ConfigError: A name or value is wrong.
    """
    _known(changes, set(_CONDITIONS), where)
    values = {
        _CONDITIONS[name][0]: _number(value, f"{where}: {name}") * _CONDITIONS[name][1]
        for name, value in changes.items()
    }
    try:
        return replace(before, **values)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def read_settings(data: Any, where: str = "settings") -> ShaperSettings:
    """Settings from what a YAML file holds (docs/wireless-shaper.md).

    Raises:
        ConfigError: Something is missing, unknown or impossible.
    """
    top = _mapping(data, where)
    _known(top, _TOP, where)
    links = {
        str(name): _link(str(name), value, f"{where}: links: {name}")
        for name, value in _mapping(top.get("links", {}), f"{where}: links").items()
    }
    if not links:
        raise ConfigError(f"{where}: links: name at least one site that is reached by radio")
    return ShaperSettings(
        links,
        _classes(top.get("classes", ()), f"{where}: classes"),
        _carrier(_mapping(top.get("carrier", {}), f"{where}: carrier"), f"{where}: carrier"),
        int(_number(top.get("seed", 1), f"{where}: seed")),
        str(top.get("listen", "127.0.0.1:7310")),
        str(top.get("rrm_policy_file", "")),
    )


def _link(name: str, data: Any, where: str) -> LinkSettings:
    values = _mapping(data, where)
    _known(values, _LINK, where)
    ways = {
        way: changed_conditions(
            Conditions(), _mapping(values.get(way, {}), f"{where}: {way}"), f"{where}: {way}"
        )
        for way in DIRECTIONS
    }
    rnti = values.get("rnti")
    return LinkSettings(
        name,
        ways["up"],
        ways["down"],
        None if rnti is None else int(_number(rnti, f"{where}: rnti")),
        _mapping(values.get("channel", {}), f"{where}: channel"),
        str(values.get("pose_topic", "")),
    )


def _classes(data: Any, where: str) -> tuple[TopicClass, ...]:
    if not isinstance(data, Sequence) or isinstance(data, str):
        raise ConfigError(f"{where}: must be a list")
    found = [_class(_mapping(item, where), where) for item in data]
    if not any("*" in item.topics for item in found):
        found.append(EVERYTHING)
    return tuple(found)


def _class(data: Mapping[str, Any], where: str) -> TopicClass:
    name = str(data.get("name", ""))
    if not name:
        raise ConfigError(f"{where}: every class needs a name")
    where = f"{where}: {name}"
    _known(data, _CLASS, where)
    deadline = data.get("deadline_ms")
    queue = int(_number(data.get("queue_bytes", 1_000_000), f"{where}: queue_bytes"))
    if queue < 1:
        raise ConfigError(f"{where}: queue_bytes is {queue}, must be 1 or more")
    overflow = str(data.get("overflow", "drop"))
    if overflow not in {item.value for item in Overflow}:
        raise ConfigError(f"{where}: overflow is {overflow!r}, must be drop or hold")
    topics, dscp = data.get("topics", ("*",)), data.get("dscp", ())
    return TopicClass(
        name,
        (topics,) if isinstance(topics, str) else tuple(map(str, topics)),
        int(_number(data.get("priority", 3), f"{where}: priority")),
        queue,
        None if deadline is None else _number(deadline, f"{where}: deadline_ms") / 1000,
        bool(data.get("discard_late", False)),
        Overflow(overflow),
        (dscp,) if isinstance(dscp, int) else tuple(int(item) for item in dscp),
    )


def _carrier(data: Mapping[str, Any], where: str) -> Carrier:
    _known(data, _CARRIER, where)
    scs = int(_number(data.get("scs_khz", 30), where))
    blocks = resource_blocks(scs, int(_number(data.get("bandwidth_mhz", 20), where)))
    share, layers = _number(data.get("share", 1.0), where), _number(data.get("layers", 1), where)
    return Carrier(scs, blocks, share, int(layers))


def _mapping(data: Any, where: str) -> Mapping[str, Any]:
    if data is None:
        return {}
    if not isinstance(data, Mapping):
        raise ConfigError(f"{where}: must be names with values, not {data!r}")
    return data


def _known(data: Mapping[str, Any], names: set[str], where: str) -> None:
    unknown = sorted(set(data) - names)
    if unknown:
        raise ConfigError(f"{where}: unknown key {unknown[0]!r}; there are {sorted(names)}")


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise ConfigError(f"{where}: {value!r} is no number")
    return float(value)
