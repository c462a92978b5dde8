"""Our samples against those of another implementation, for two releases of ROS 2."""

from __future__ import annotations

import importlib
import random
from functools import cache
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from simple_ros_firmware_bridge import cdr

PACKAGES = (
    "std_msgs",
    "geometry_msgs",
    "nav_msgs",
    "sensor_msgs",
    "visualization_msgs",
    "diagnostic_msgs",
    "tf2_msgs",
    "builtin_interfaces",
    "rosgraph_msgs",
    "action_msgs",
)
STORES = {"humble": Stores.ROS2_HUMBLE, "jazzy": Stores.ROS2_JAZZY}
OTHER_CONSTANTS = {("visualization_msgs.Marker", "type"), ("visualization_msgs.Marker", "action")}

store = cache(get_typestore)


def shipped() -> list[tuple[str, str]]:
    found = []
    for release, which in STORES.items():
        for package in PACKAGES:
            module = importlib.import_module(f"simple_ros.msg.{package}_pb2")
            for name in module.DESCRIPTOR.message_types_by_name:
                if f"{package}/msg/{name}" in store(which).types:
                    found.append((release, f"{package}.{name}"))
    return found


def random_value(types: Any, kind: Any, rng: random.Random) -> Any:
    node, what = kind
    if node == 1:
        return random_scalar(what[0], rng)
    if node == 2:
        return random_message(types, what, rng)
    inner, count = what
    length = count if node == 3 else rng.randrange(4)
    values = [random_value(types, inner, rng) for _ in range(length)]
    if inner[0] == 1 and inner[1][0] != "string":
        name = {"byte": "uint8", "char": "uint8"}.get(inner[1][0], inner[1][0])
        return np.array(values, dtype=name)
    return values


def random_scalar(name: str, rng: random.Random) -> Any:
    if name == "string":
        return rng.choice(["", "odom", "ä" * rng.randrange(9), "x" * rng.randrange(30)])
    if name == "bool":
        return rng.random() < 0.5
    if name.startswith("float"):
        return float(np.float32(rng.uniform(-1e3, 1e3)))
    if name in ("byte", "char"):
        return rng.randrange(128)  # the other one takes a byte to be signed
    bits = int(name.lstrip("uint"))
    return (
        rng.randrange(2**bits)
        if name[0] == "u"
        else rng.randrange(-(2 ** (bits - 1)), 2 ** (bits - 1))
    )


def random_message(types: Any, name: str, rng: random.Random) -> Any:
    _, fields = types.fielddefs[name]
    values = {field: random_value(types, kind, rng) for field, kind in fields}
    if name.startswith("builtin_interfaces/msg/"):
        values["nanosec"] = rng.randrange(10**9)
    if name.startswith("builtin_interfaces/msg/Duration"):
        values["sec"] = rng.randrange(2**20)  # a double holds nanoseconds of no more
    if name.endswith("/Marker"):
        values["type"], values["action"] = rng.randrange(13), rng.choice((0, 2, 3))
    if name.endswith("/Empty"):
        values["structure_needs_at_least_one_member"] = 0
    if name.endswith("/Image"):
        values["is_bigendian"] = rng.randrange(2)
    return types.types[name](**values)


def assert_same(ours: Any, theirs: Any) -> None:
    """Every field of theirs has its value in ours, by name."""
    for field in ours.DESCRIPTOR.fields:
        if not hasattr(theirs, field.name):
            assert (ours.DESCRIPTOR.full_name, field.name) in {
                ("std_msgs.Header", "seq"),
                ("sensor_msgs.Range", "variance"),
            }
            continue
        if (ours.DESCRIPTOR.full_name, field.name) in OTHER_CONSTANTS:
            continue
        assert_same_value(getattr(ours, field.name), getattr(theirs, field.name))


def assert_same_value(mine: Any, other: Any) -> None:
    if hasattr(mine, "DESCRIPTOR"):
        if mine.DESCRIPTOR.full_name.startswith("google."):
            assert (mine.seconds, mine.nanos) == (other.sec, other.nanosec)
        else:
            assert_same(mine, other)
    elif hasattr(other, "uuid"):
        assert mine == other.uuid.tobytes()
    elif hasattr(other, "nanosec"):
        assert mine == pytest.approx(other.sec + other.nanosec * 1e-9, abs=1e-9)
    elif isinstance(mine, bytes):
        assert mine == other.tobytes()
    elif hasattr(mine, "extend"):
        assert len(mine) == len(other)
        for left, right in zip(mine, other, strict=True):
            assert_same_value(left, right)
    else:
        assert mine == other


@pytest.mark.parametrize(("release", "type_name"), shipped())
@pytest.mark.parametrize("is_little", [True, False])
def test_samples_are_those_of_ros(release: str, type_name: str, is_little: bool) -> None:
    package, _, name = type_name.partition(".")
    module = importlib.import_module(f"simple_ros.msg.{package}_pb2")
    ros_name = f"{package}/msg/{name}"
    types = store(STORES[release])
    rng = random.Random(f"{type_name} {is_little}")
    order = "<" if is_little else ">"
    for _ in range(5):
        theirs = random_message(types, ros_name, rng)
        data = bytes(types.serialize_cdr(theirs, ros_name, little_endian=is_little))[4:]
        ours = cdr.decode(data, getattr(module, name), order)
        if name != "Empty":
            assert_same(ours, theirs)
        again = cdr.encode(ours, order)
        assert (
            again[: len(data)] == data
        )  # the other one sends padding at the end, or a member less
        assert len(again) - len(data) in ({0, 4} if name == "Range" else {0})
