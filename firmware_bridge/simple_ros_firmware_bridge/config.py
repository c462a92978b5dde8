"""What the bridge is told: which boards there are and what their topics are called."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from simple_ros.errors import ConfigError, InvalidName
from simple_ros.names import topic_name
from simple_ros_firmware_bridge.mapping import plain
from simple_ros_firmware_bridge.xrce.objects import Profile

__all__ = ["DEFAULT_BAUD", "BoardConfig", "check_ports", "load_boards"]

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

    Raises:
        ConfigError: A value makes no sense.
        InvalidName: The prefix is no name.
    """

    port: str = ""
    baud: int = DEFAULT_BAUD
    prefix: str = ""
    remap: Mapping[str, str] = field(default_factory=dict)
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    restamp: bool = True

    def __post_init__(self) -> None:
        if type(self.baud) is not int or self.baud < 1:
            raise ConfigError(f"baud must be a positive number, not {self.baud!r}")
        for name in ("port", "prefix"):
            if not isinstance(getattr(self, name), str):
                raise ConfigError(f"{name} must be text, not {getattr(self, name)!r}")
        if not isinstance(self.restamp, bool):
            raise ConfigError(f"restamp must be true or false, not {self.restamp!r}")
        if self.prefix.strip("/"):
            topic_name(self.prefix.strip("/"))
        for old, new in self.remap.items():
            _check_remap(old, new)


def _check_remap(old: object, new: object) -> None:
    for name in (old, new):
        if not isinstance(name, str):
            raise ConfigError(f"remap: {name!r} is no name of a topic")
        try:
            topic_name(plain(name))
        except InvalidName as error:
            raise ConfigError(f"remap: {error}") from None


_KEYS = {item.name for item in fields(BoardConfig)}


def load_boards(path: Path) -> list[BoardConfig]:
    """The boards of a YAML file: a list below ``boards``.

    Raises:
        ConfigError: The file cannot be read, or says what makes no sense; names file and key.
    """
    import yaml

    try:
        content = yaml.safe_load(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if not isinstance(content, dict) or not isinstance(content.get("boards"), list):
        raise ConfigError(f"{path}: needs a key 'boards' with a list")
    for key in content.keys() - {"boards"}:
        raise ConfigError(f"{path}: there is no key {key!r} here, only 'boards'")
    boards = [_board(path, f"boards[{i}]", item) for i, item in enumerate(content["boards"])]
    if not boards:
        raise ConfigError(f"{path}: boards is an empty list")
    try:
        check_ports(boards)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return boards


def check_ports(boards: Sequence[BoardConfig]) -> None:
    """Each board has a port of its own.

    Raises:
        ConfigError: Two have the same one.
    """
    seen: set[str] = set()
    for board in boards:
        if board.port in seen:
            what = f"port {board.port}" if board.port else "'the first Pico that is found'"
            raise ConfigError(f"{what} is named twice; each board has one of its own")
        seen.add(board.port)


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
    except (ConfigError, InvalidName) as error:
        raise ConfigError(f"{path}: {where}: {error}") from None


def _profile(where: str, value: Any) -> Profile:
    if not isinstance(value, dict) or value.keys() != {"topic", "type"}:
        raise ConfigError(f"{where} needs 'topic' and 'type' (sensor_msgs/Imu)")
    package, _, name = str(value["type"]).replace("/msg/", "/").replace(".", "/").partition("/")
    if not (package.isidentifier() and name.isidentifier()):
        raise ConfigError(f"{where}.type must be like sensor_msgs/Imu, not {value['type']!r}")
    try:
        topic = topic_name(plain(str(value["topic"])))
    except InvalidName as error:
        raise ConfigError(f"{where}.topic: {error}") from None
    return Profile(f"rt/{topic}", f"{package}::msg::dds_::{name}_")
