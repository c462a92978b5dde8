"""What the bridge is told: which boards there are and what their topics are called."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros_firmware_bridge.xrce.objects import Profile

__all__ = ["DEFAULT_BAUD", "BoardConfig", "load_boards"]

DEFAULT_BAUD = 115200


@dataclass(frozen=True)
class BoardConfig:
    """One board.

    Attributes:
        port: Path of its serial port; empty for the first Pico that is found.
        baud: Bits per second of a UART; USB ignores it.
        prefix: Namespace for its topics.
        remap: Names in the graph by names on the board.
        profiles: For boards that create by reference: topic and type by name.
        restamp: Replace stamps that are no time of day (zero, or time since power-on).
    """

    port: str = ""
    baud: int = DEFAULT_BAUD
    prefix: str = ""
    remap: Mapping[str, str] = field(default_factory=dict)
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    restamp: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.baud, int) or self.baud < 1:
            raise ConfigError(f"baud must be a positive number, not {self.baud!r}")


_KEYS = {item.name for item in fields(BoardConfig)}


def load_boards(path: Path) -> list[BoardConfig]:
    """The boards of a YAML file: a list below ``boards``.

    Raises:
        ConfigError: The file cannot be read, or says what makes no sense; names file and key.
    """
    import yaml

    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if not isinstance(content, dict) or not isinstance(content.get("boards"), list):
        raise ConfigError(f"{path}: needs a key 'boards' with a list")
    for key in content.keys() - {"boards"}:
        raise ConfigError(f"{path}: there is no key {key!r} here, only 'boards'")
    return [_board(path, f"boards[{i}]", item) for i, item in enumerate(content["boards"])]


def _board(path: Path, where: str, item: Any) -> BoardConfig:
    if not isinstance(item, dict):
        raise ConfigError(f"{path}: {where} must be a mapping")
    for key in item.keys() - _KEYS:
        known = ", ".join(sorted(_KEYS))
        raise ConfigError(f"{path}: {where}.{key}: there is no such key (there are: {known})")
    for key in ("remap", "profiles"):
        if not isinstance(item.get(key, {}), dict):
            raise ConfigError(f"{path}: {where}.{key} must be a mapping")
    profiles = {
        name: _profile(f"{path}: {where}.profiles.{name}", value)
        for name, value in item.get("profiles", {}).items()
    }
    try:
        return BoardConfig(**{**item, "profiles": profiles})
    except ConfigError as error:
        raise ConfigError(f"{path}: {where}: {error}") from None


def _profile(where: str, value: Any) -> Profile:
    if not isinstance(value, dict) or value.keys() != {"topic", "type"}:
        raise ConfigError(f"{where} needs 'topic' and 'type' (sensor_msgs/Imu)")
    package, _, name = str(value["type"]).replace("/msg/", "/").partition("/")
    return Profile(f"rt/{str(value['topic']).lstrip('/')}", f"{package}::msg::dds_::{name}_")
