"""Saved policies of the maximizer: networks, files that were damaged, and following what is in them."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.maximizer.clamp import SafetyClamp
from simple_ros_engines.network_exposure.maximizer.environment import (
    OBSERVATION_SIZE,
    TopicEnvironment,
)
from simple_ros_engines.network_exposure.maximizer.follower import NetworkFollower
from simple_ros_engines.network_exposure.maximizer.knobs import DELAYS, START, STAY, Setting
from simple_ros_engines.network_exposure.maximizer.network import ANY_TOPIC, Network, NetworkPolicy
from simple_ros_engines.network_exposure.maximizer.plant import Seen, SimulatedTurtles
from simple_ros_engines.network_exposure.maximizer.policy_file import (
    SettingsPolicy,
    network_text,
    policy_from_text,
    policy_text,
    read_policy,
)
from simple_ros_engines.network_exposure.maximizer.resource import TopicTraffic
from simple_ros_engines.network_exposure.maximizer.training import run_episode, scattered
from simple_ros_engines.network_exposure.maximizer.trial import trial_lines, try_network

TOPICS = ("t/pose", "t/cmd_vel")
OUTPUTS = 9


def random_network(seed: int = 1, activation: str = "tanh") -> Network:
    draw = np.random.default_rng(seed)
    sizes = (OBSERVATION_SIZE, 5, OUTPUTS)
    layers = [
        (draw.normal(size=(after, before)), draw.normal(size=after))
        for before, after in itertools.pairwise(sizes)
    ]
    return Network(layers, activation)


def always(delay: int, drop: int = 0, speed: int = 0) -> Network:
    """A network that sees nothing and does always the same."""
    wanted = np.zeros((3, 3))
    for knob, step in enumerate((delay, drop, speed)):
        wanted[knob, step + 1] = 1.0
    return Network([(np.zeros((OUTPUTS, OBSERVATION_SIZE)), wanted.reshape(OUTPUTS))])


class Brittle:
    """A process that breaks when its topics are held back by more notches than it bears."""

    def __init__(self, bears: int) -> None:
        self.bears = bears
        self.worst = 5.0

    @property
    def groups(self) -> Mapping[str, tuple[str, ...]]:
        return {"t": TOPICS}

    def traffic(self, topic: str) -> TopicTraffic:
        return TopicTraffic(20.0, 40.0, 1e-5)

    def advance(self, settings: Mapping[str, Setting]) -> dict[str, Seen]:
        mos = 4.9 if sum(one.delay for one in settings.values()) <= self.bears else 2.0
        self.worst = min(self.worst, mos)
        return {
            topic: Seen(20.0, 800.0, 0.001, mos, setting) for topic, setting in settings.items()
        }


# -- networks --------------------------------------------------------------------------------------


@given(
    st.lists(st.floats(0, 1, width=32), min_size=8, max_size=8), st.sampled_from(["tanh", "relu"])
)
def test_a_network_survives_its_file(seen: list[float], activation: str) -> None:
    network = random_network(3, activation)
    policy = NetworkPolicy({"pose": network}, "somebody")
    read = read_policy(network_text(policy))
    assert isinstance(read, NetworkPolicy)
    assert read.made_by == "somebody"
    again = read.networks["pose"]
    assert (again.logits(seen) == network.logits(seen)).all()
    assert again.act(seen) == network.act(seen)
    assert all(step in (-1, 0, 1) for step in network.act(seen))


def test_a_network_is_layers_with_an_activation_between_them() -> None:
    eye = np.zeros((OUTPUTS, 2))
    eye[2, 0] = eye[3, 1] = eye[7, 0] = 1.0
    first = np.zeros((2, OBSERVATION_SIZE))
    first[0, 0], first[1, 1] = 2.0, -2.0
    network = Network([(first, [0.0, 0.5]), (eye, np.zeros(OUTPUTS))], "relu")
    seen = [1.0, 1.0, 0, 0, 0, 0, 0, 0]
    assert network.logits(seen).tolist() == [0, 0, 2, 0, 0, 0, 0, 2, 0]
    assert network.act(seen) == (1, -1, 0)


@pytest.mark.parametrize(
    ("layers", "activation", "why"),
    [
        ([], "tanh", "last layer must have 9"),
        ([(np.zeros((9, 8)), np.zeros(9))], "swish", "tanh or relu"),
        ([(np.zeros((9, 7)), np.zeros(9))], "tanh", "takes 7 numbers, but 8 come"),
        ([(np.zeros((8, 8)), np.zeros(8))], "tanh", "not 8"),
        ([(np.zeros((9, 8)), np.zeros(8))], "tanh", r"shape \(9, 8\) and biases"),
        ([(np.zeros(8), np.zeros(9))], "tanh", "must be"),
        ([(np.full((9, 8), np.nan), np.zeros(9))], "tanh", "not finite"),
        ([([[1, 2], [3]], [1, 2])], "tanh", "rows of numbers"),
        ([("x", [1, 2])], "tanh", "rows of numbers"),
        ([(np.zeros((5000, 8)), np.zeros(5000))], "tanh", "at most 4096"),
    ],
)
def test_what_is_no_network_is_told(layers: Any, activation: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        Network(layers, activation)


def test_a_network_is_found_by_name_then_by_last_part_then_any() -> None:
    one, two, three = (random_network(seed) for seed in range(3))
    policy = NetworkPolicy({"bob/pose": one, "pose": two, ANY_TOPIC: three})
    assert policy.of("/bob/pose") is one
    assert policy.of("eve/pose") is two
    assert policy.of("eve/cmd_vel") is three
    assert NetworkPolicy({"pose": two}).of("eve/cmd_vel") is None


# -- files -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        policy_text({"t": {"t/pose": Setting(4, 2, 2)}}),
        network_text(NetworkPolicy({ANY_TOPIC: random_network()})),
    ],
    ids=["settings", "networks"],
)
def test_no_damaged_file_is_followed(text: str) -> None:
    read_policy(text)
    for where in range(0, len(text) - 1, max(1, len(text) // 60)):
        with pytest.raises(ConfigError):
            read_policy(text[:where])
        changed = text[:where] + ("1" if text[where] != "1" else "2") + text[where + 1 :]
        if json.dumps(_parsed(changed)) == json.dumps(_parsed(text)):
            continue  # blanks between parts
        with pytest.raises(ConfigError):
            read_policy(changed)


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return None


def test_version_1_is_still_read() -> None:
    old = {
        "format": "simple_ros maximizer policy",
        "version": 1,
        "processes": {"t": {"t/pose": {"delay": 4, "drop": 2, "speed": 2}}},
    }
    assert policy_from_text(json.dumps(old)) == {"t": {"t/pose": Setting(4, 2, 2)}}


def test_other_kinds_are_told_apart() -> None:
    networks = network_text(NetworkPolicy({ANY_TOPIC: random_network()}))
    with pytest.raises(ConfigError, match="networks, no settings"):
        policy_from_text(networks)
    assert isinstance(read_policy(policy_text({})), SettingsPolicy)


# -- following -------------------------------------------------------------------------------------


def episode(plant: Brittle, policy: NetworkPolicy, horizon: int = 60) -> NetworkFollower:
    environment = TopicEnvironment(plant, clamp=SafetyClamp(plant.groups), horizon=horizon)
    follower = NetworkFollower(environment, policy)
    run_episode(environment, follower.choose, follower.told)
    return follower


def test_what_harmed_is_not_tried_again() -> None:
    plant = Brittle(bears=5)
    follower = episode(plant, NetworkPolicy({ANY_TOPIC: always(1)}))
    assert plant.worst == 2.0  # once it went too far
    settled = follower.settled["t"]
    assert sum(one.delay for one in settled.values()) == 4  # both at once: 2, 4, not 6
    plant.worst = 5.0
    environment = TopicEnvironment(plant, clamp=SafetyClamp(plant.groups), horizon=60)
    environment.reset(settled)
    again = NetworkFollower(environment, NetworkPolicy({ANY_TOPIC: always(0)}))
    run_episode(environment, again.choose, again.told)
    assert plant.worst == 4.9
    assert again.settled["t"] == settled


def test_a_topic_without_a_network_is_left_alone() -> None:
    follower = episode(Brittle(bears=99), NetworkPolicy({"pose": always(1)}))
    assert follower.settled["t"] == {
        "t/pose": Setting(len(DELAYS) - 1),
        "t/cmd_vel": START,
    }


def test_nothing_is_settled_on_that_was_never_good() -> None:
    plant = Brittle(bears=-1)
    assert episode(plant, NetworkPolicy({ANY_TOPIC: always(1)})).settled["t"] == dict.fromkeys(
        TOPICS, START
    )


def test_a_network_sees_what_the_environment_shows() -> None:
    """One that goes on as long as its delay is below a third of the scale."""
    weights = np.zeros((OUTPUTS, OBSERVATION_SIZE))
    biases = np.zeros(OUTPUTS)
    weights[2, 3], biases[2] = -3.0, 1.0  # delay up, unless observation 3 is large
    for stay in (1, 4, 7):
        biases[stay] = 0.01
    policy = NetworkPolicy({ANY_TOPIC: Network([(weights, biases)])})
    settled = episode(Brittle(bears=99), policy).settled["t"]
    assert {one.delay for one in settled.values()} == {3}


# -- environments that begin elsewhere, trials -----------------------------------------------------


def test_episodes_begin_where_they_are_told_to() -> None:
    environment = TopicEnvironment(Brittle(99), horizon=5, begin=scattered(TOPICS, 1))
    starts = []
    for _ in range(20):
        environment.reset()
        starts.append(dict(environment.settings))
    assert {"start", "elsewhere"} == {
        "start" if all(one == START for one in where.values()) else "elsewhere" for where in starts
    }
    environment.reset(dict.fromkeys(TOPICS, Setting(1, 1, 1)))
    assert environment.settings == dict.fromkeys(TOPICS, Setting(1, 1, 1))


def test_a_seed_begins_a_simulation_anew() -> None:
    plant = SimulatedTurtles.drawn(4)
    environment = TopicEnvironment(plant, clamp=SafetyClamp(plant.groups))
    runs = []
    for _ in range(2):
        environment.reset(seed=7)
        assert all(one == START for one in environment.settings.values())
        environment.step({"turtle1/pose": (1, 1, 0)})
        runs.append(environment.observations)
    assert all((runs[0][topic] == runs[1][topic]).all() for topic in runs[0])


def test_a_real_speed_is_that_of_an_onlooker() -> None:
    plant = SimulatedTurtles.drawn(1)
    wanted = {name: plant.wanted_mps(f"{name}/pose") for name in plant.groups}
    for _ in range(20):
        plant.advance(dict.fromkeys([t for ts in plant.groups.values() for t in ts], START))
    for name, speed in plant.speeds_mps.items():
        assert speed == pytest.approx(wanted[name], rel=0.01)


def test_a_trial_compares_with_doing_nothing() -> None:
    nothing = try_network(NetworkPolicy({ANY_TOPIC: always(0)}), 10_000)
    assert nothing.speed == 1
    assert nothing.paper_over_idle == 0
    assert nothing.saved_by_class == nothing.saved_by_requirement == 0
    assert nothing.paper_over_untrained > 0
    lines = trial_lines(NetworkPolicy({ANY_TOPIC: always(0)}), [10_001])
    assert any(line.startswith("MOS of the worse turtle") for line in lines)


def test_observations_of_a_downgrade_stop_the_clamp() -> None:
    here = dict.fromkeys(TOPICS, Setting(2, 0, 2))
    clamp = SafetyClamp({"t": TOPICS})
    bad = {t: Seen(20.0, 800.0, 0.0, 1.5, here[t]) for t in TOPICS}
    moved = {t: one.moved((1, 0, 0)) for t, one in here.items()}
    assert clamp.guard(bad, here, moved)[0] == dict.fromkeys(TOPICS, START)
    short = {t: replace(one, is_downgraded=True) for t, one in bad.items()}
    assert SafetyClamp({"t": TOPICS}).guard(short, here, moved) == (here, ())
    assert STAY == (0, 0, 0)
