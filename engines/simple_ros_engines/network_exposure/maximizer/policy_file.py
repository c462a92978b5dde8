"""Policies in files: the settings that were learnt for each process, as JSON. Pure."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.maximizer.knobs import KNOBS, START, Setting

__all__ = ["policy_from_text", "policy_text", "settings_for"]

_FORMAT = "simple_ros maximizer policy"
_VERSION = 1
Policy = dict[str, dict[str, Setting]]


def policy_text(policy: Mapping[str, Mapping[str, Setting]]) -> str:
    """A policy as the text of a file.

    Args:
        policy: Settings by process and topic.
    """
    processes = {
        group: {topic: dict(zip(KNOBS, one.notches, strict=True)) for topic, one in topics.items()}
        for group, topics in policy.items()
    }
    return json.dumps({"format": _FORMAT, "version": _VERSION, "processes": processes}, indent=2)


def policy_from_text(text: str) -> Policy:
    """The policy of a file.

    Raises:
        ConfigError: It is none, of another version, or has values that there are not.
    """
    try:
        read: Any = json.loads(text)
    except ValueError as error:
        raise ConfigError(f"a policy must be JSON: {error}") from None
    if not isinstance(read, dict) or read.get("format") != _FORMAT:
        raise ConfigError(f"no policy: its format is not {_FORMAT!r}")
    if read.get("version") != _VERSION:
        raise ConfigError(f"policy of version {read.get('version')!r}; known is {_VERSION}")
    try:
        return {
            str(group): {str(topic): _setting(one) for topic, one in topics.items()}
            for group, topics in read["processes"].items()
        }
    except (AttributeError, KeyError, TypeError) as error:
        raise ConfigError(f"policy with missing or wrong parts: {error}") from None


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


def _setting(read: Mapping[str, Any]) -> Setting:
    notches = [read[name] for name in KNOBS]
    if any(isinstance(notch, bool) or not isinstance(notch, int) for notch in notches):
        raise ConfigError(f"notches are whole numbers, not {notches}")
    return Setting(*notches)
