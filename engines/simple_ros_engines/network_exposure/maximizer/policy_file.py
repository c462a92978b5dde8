"""Policies in files, as JSON: settings that were learnt for each process, or networks that decide. Pure.

Version 2 has a checksum over everything else in the file, so that a damaged one is refused and not followed. Version 1 (settings
only, without a checksum) is still read; who edits a policy by hand writes that.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.maximizer.knobs import KNOBS, START, Setting
from simple_ros_engines.network_exposure.maximizer.network import Network, NetworkPolicy

__all__ = [
    "SettingsPolicy",
    "network_text",
    "policy_from_text",
    "policy_text",
    "read_policy",
    "settings_for",
]

_FORMAT = "simple_ros maximizer policy"
_UNCHECKED, _VERSION = 1, 2
_SUM = "sha256"
_SETTINGS, _NETWORKS = "settings", "networks"
Policy = dict[str, dict[str, Setting]]


@dataclass(frozen=True, slots=True)
class SettingsPolicy:
    """Settings that were learnt.

    Attributes:
        processes: By process and topic.
    """

    processes: Policy


def policy_text(policy: Mapping[str, Mapping[str, Setting]]) -> str:
    """Settings as the text of a file.

    Args:
        policy: By process and topic.
    """
    processes = {
        group: {topic: dict(zip(KNOBS, one.notches, strict=True)) for topic, one in topics.items()}
        for group, topics in policy.items()
    }
    return json.dumps(_summed({"kind": _SETTINGS, "processes": processes}), indent=2) + "\n"


def network_text(policy: NetworkPolicy) -> str:
    """Networks as the text of a file."""
    networks = {topic: one.as_numbers() for topic, one in policy.networks.items()}
    body = {"kind": _NETWORKS, "made_by": policy.made_by, "networks": networks}
    return json.dumps(_summed(body)) + "\n"


def read_policy(text: str) -> SettingsPolicy | NetworkPolicy:
    """The policy of a file.

    Raises:
        ConfigError: It is none, of another version, damaged, or has values that there are not.
    """
    try:
        read: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"a policy must be JSON: {error}") from None
    if not isinstance(read, dict) or read.get("format") != _FORMAT:
        raise ConfigError(f"no policy: its format is not {_FORMAT!r}")
    version = read.get("version")
    if version not in (_UNCHECKED, _VERSION):
        raise ConfigError(f"policy of version {version!r}; known are {_UNCHECKED} and {_VERSION}")
    if version == _VERSION and read.get(_SUM) != _checksum(read):
        raise ConfigError("damaged policy: its checksum is not that of what is in it")
    kind = _SETTINGS if version == _UNCHECKED else read.get("kind")
    if kind not in (_SETTINGS, _NETWORKS):
        raise ConfigError(f"policy of kind {kind!r}; known are {_SETTINGS} and {_NETWORKS}")
    try:
        return _settings(read) if kind == _SETTINGS else _networks(read)
    except (AttributeError, KeyError, TypeError) as error:
        raise ConfigError(f"policy with missing or wrong parts: {error}") from None


def policy_from_text(text: str) -> Policy:
    """The settings of a file.

    Raises:
        ConfigError: As of `read_policy`, or it has networks.
    """
    read = read_policy(text)
    if not isinstance(read, SettingsPolicy):
        raise ConfigError("this policy has networks, no settings")
    return read.processes


def settings_for(
    policy: Mapping[str, Mapping[str, Setting]], topics: tuple[str, ...]
) -> dict[str, Setting]:
    """What a policy says for topics: for one of the same name, else of the same last part, else nothing made worse."""
    known = {
        topic.lstrip("/"): one for process in policy.values() for topic, one in process.items()
    }
    by_end: dict[str, Setting] = {}
    for topic, one in known.items():
        by_end.setdefault(topic.rpartition("/")[2], one)
    return {
        topic: known.get(topic.lstrip("/"), by_end.get(topic.rpartition("/")[2], START))
        for topic in topics
    }


def _summed(body: Mapping[str, Any]) -> dict[str, Any]:
    whole = {"format": _FORMAT, "version": _VERSION, **body}
    return {**whole, _SUM: _checksum(whole)}


def _checksum(read: Mapping[str, Any]) -> str:
    """Of all but itself, however it is spaced and ordered."""
    body = {name: part for name, part in read.items() if name != _SUM}
    text = json.dumps(body, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _settings(read: Mapping[str, Any]) -> SettingsPolicy:
    return SettingsPolicy(
        {
            str(group): {str(topic): _setting(one) for topic, one in topics.items()}
            for group, topics in read["processes"].items()
        }
    )


def _networks(read: Mapping[str, Any]) -> NetworkPolicy:
    networks = {str(topic): Network.from_numbers(one) for topic, one in read["networks"].items()}
    return NetworkPolicy(networks, str(read.get("made_by", "")))


def _setting(read: Mapping[str, Any]) -> Setting:
    notches = [read[name] for name in KNOBS]
    if any(isinstance(notch, bool) or not isinstance(notch, int) for notch in notches):
        raise ConfigError(f"notches are whole numbers, not {notches}")
    return Setting(*notches)
