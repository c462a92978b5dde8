from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros.qos import (
    DEFAULT,
    LATCHED,
    Durability,
    Liveliness,
    QosProfile,
    Reliability,
    incompatibilities,
)
from simple_ros.rpc.convert import qos_from_proto, qos_to_proto
from simple_ros.rpc.ros_rpc_pb2 import QosPolicies

seconds = st.none() | st.floats(0.001, 1000).map(lambda value: round(value, 6))
profiles = st.builds(
    QosProfile,
    depth=st.integers(1, 10_000),
    reliability=st.sampled_from(Reliability),
    durability=st.sampled_from(Durability),
    deadline_s=seconds,
    lifespan_s=seconds,
    liveliness=st.sampled_from(Liveliness),
    liveliness_lease_s=seconds,
)


@given(profiles)
def test_profiles_survive_the_wire(profile: QosProfile) -> None:
    assert qos_from_proto(qos_to_proto(profile)) == profile


@given(profiles)
def test_every_profile_fits_itself(profile: QosProfile) -> None:
    assert incompatibilities(profile, profile) == ()


def test_an_empty_message_means_defaults() -> None:
    assert qos_from_proto(QosPolicies()) == DEFAULT
    assert qos_from_proto(QosPolicies(reliability=99)) == DEFAULT  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("offered", "requested", "policies"),
    [
        ({"reliability": Reliability.BEST_EFFORT}, {}, ["reliability"]),
        ({}, {"reliability": Reliability.BEST_EFFORT}, []),
        ({}, {"durability": Durability.TRANSIENT_LOCAL}, ["durability"]),
        ({"durability": Durability.TRANSIENT_LOCAL}, {}, []),
        ({}, {"deadline_s": 1.0}, ["deadline"]),
        ({"deadline_s": 2.0}, {"deadline_s": 1.0}, ["deadline"]),
        ({"deadline_s": 0.5}, {"deadline_s": 1.0}, []),
        ({"deadline_s": 0.5}, {}, []),
        ({}, {"liveliness": Liveliness.MANUAL_BY_TOPIC}, ["liveliness"]),
        ({}, {"liveliness_lease_s": 1.0}, ["liveliness_lease"]),
        ({"depth": 1}, {"depth": 1000, "lifespan_s": 1.0, "overflow": "block"}, []),
    ],
)
def test_offered_against_requested(
    offered: dict[str, object], requested: dict[str, object], policies: list[str]
) -> None:
    found = incompatibilities(DEFAULT.replace(**offered), DEFAULT.replace(**requested))
    assert [item.policy for item in found] == policies


@pytest.mark.parametrize(
    "bad",
    [
        {"depth": 0},
        {"max_bytes": 0},
        {"deadline_s": 0.0},
        {"lifespan_s": -1.0},
        {"liveliness_lease_s": float("inf")},
        {"reliability": "reliable"},
        {"overflow": "explode"},
    ],
)
def test_settings_without_meaning_are_refused_by_name(bad: dict[str, object]) -> None:
    (name,) = bad
    with pytest.raises(ConfigError, match=name):
        QosProfile(**bad)  # type: ignore[arg-type]


def test_latched_keeps_one() -> None:
    assert LATCHED.depth == 1
    assert LATCHED.durability is Durability.TRANSIENT_LOCAL
