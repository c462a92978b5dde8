"""The maximizer's environments for other people's algorithms, as their own checkers see them, and what those algorithms learnt."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.maximizer import rllib, sb3
from simple_ros_engines.network_exposure.maximizer.environment import (
    OBSERVATION_SIZE,
    TopicEnvironment,
)
from simple_ros_engines.network_exposure.maximizer.network import ANY_TOPIC
from simple_ros_engines.network_exposure.maximizer.plant import SimulatedTurtles
from simple_ros_engines.network_exposure.maximizer.wrappers import (
    ExtraMissing,
    gymnasium_env,
    imported,
    parallel_env,
)

EXAMPLES = Path(__file__).parents[2] / "examples" / "learning"
SIZES = (OBSERVATION_SIZE, 6, 9)


def turtles(horizon: int = 128, seed: int = 3) -> TopicEnvironment:
    plant = SimulatedTurtles.drawn(seed)
    return TopicEnvironment(plant, horizon=horizon)


# -- their own checkers ----------------------------------------------------------------------------


def test_gymnasiums_checker_is_content() -> None:
    checker = pytest.importorskip("gymnasium.utils.env_checker", reason="needs gymnasium")
    env = gymnasium_env(turtles(), "turtle1/cmd_vel")
    assert env.spec.nondeterministic is False
    checker.check_env(env)


def test_pettingzoos_checkers_are_content() -> None:
    pytest.importorskip("pettingzoo", reason="needs pettingzoo")
    tests = importlib.import_module("pettingzoo.test")
    tests.parallel_api_test(parallel_env(turtles(horizon=10)), num_cycles=25)
    tests.parallel_seed_test(lambda: parallel_env(turtles(horizon=10)), num_cycles=12)


# -- extras ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("use", "package", "extra"),
    [
        (lambda: sb3.vec_env([turtles()]), "stable_baselines3", "learning-sb3"),
        (lambda: rllib.multi_agent_env(turtles()), "ray", "learning-rllib"),
        (lambda: parallel_env(turtles()), "gymnasium", "learning"),
    ],
)
def test_what_is_missing_is_named_with_its_extra(
    monkeypatch: pytest.MonkeyPatch, use: Any, package: str, extra: str
) -> None:
    def absent(name: str) -> object:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(
        ExtraMissing, match=rf"{package} is not installed.*simple-ros\[{extra}\]"
    ) as told:
        use()
    assert (told.value.package, told.value.extra) == (package, extra)


# -- Stable-Baselines3 -----------------------------------------------------------------------------


class StandInVecEnv:
    """As much of Stable-Baselines3's base class as a subclass relies on."""

    def __init__(self, num_envs: int, observation_space: Any, action_space: Any) -> None:
        self.num_envs = num_envs
        self.observation_space, self.action_space = observation_space, action_space
        self._seeds: list[int | None] = [None] * num_envs

    def seed(self, seed: int) -> None:
        self._seeds = [seed + index for index in range(self.num_envs)]

    def _reset_seeds(self) -> None:
        self._seeds = [None] * self.num_envs

    def step(self, actions: Any) -> Any:
        self.step_async(actions)  # type: ignore[attr-defined]
        return self.step_wait()  # type: ignore[attr-defined]


@pytest.fixture
def columns(monkeypatch: pytest.MonkeyPatch) -> Any:
    pytest.importorskip("pettingzoo", reason="needs pettingzoo")

    def standing_in(name: str, extra: str = "learning") -> Any:
        if name.startswith("stable_baselines3"):
            return SimpleNamespace(VecEnv=StandInVecEnv)
        return imported(name, extra)

    monkeypatch.setattr(sb3, "imported", standing_in)
    return sb3.vec_env([turtles(3, 1), turtles(3, 2)])


def test_each_topic_of_each_world_is_a_column(columns: Any) -> None:
    assert columns.num_envs == 8
    assert columns.reset().shape == (8, OBSERVATION_SIZE)
    actions = np.ones((8, 3), dtype=int)
    actions[6, 0] = 2  # second world, third topic
    seen, rewards, ends, facts = columns.step(actions)
    assert (seen.shape, rewards.shape, rewards.dtype) == ((8, OBSERVATION_SIZE), (8,), np.float32)
    assert not ends.any()
    assert seen[:, 3].tolist() == [0, 0, 0, 0, 0, 0, 1 / 8, 0]
    assert all(fact["mos"] > 1 for fact in facts)


def test_episodes_end_by_truncation_and_the_next_begins(columns: Any) -> None:
    columns.reset()
    gained = np.zeros(8)
    for number in range(3):
        seen, rewards, ends, facts = columns.step(np.full((8, 3), 1))
        gained += rewards
        assert ends.all() == (number == 2)
    for index, fact in enumerate(facts):
        assert fact["TimeLimit.truncated"]
        assert fact["episode"] == {"r": pytest.approx(gained[index]), "l": 3}
        assert fact["terminal_observation"].shape == (OBSERVATION_SIZE,)
    *_, facts = columns.step(np.full((8, 3), 1))
    assert "episode" not in facts[0]
    assert seen.shape == (8, OBSERVATION_SIZE)


def test_seeds_begin_simulations_anew(columns: Any) -> None:
    def run() -> Any:
        columns.seed(5)
        columns.reset()
        return columns.step(np.full((8, 3), 2))[0]

    assert (run() == run()).all()


def test_columns_know_their_worlds(columns: Any) -> None:
    assert columns.get_attr("render_mode", [0]) == [None]
    assert columns.env_is_wrapped(int, 1) == [False]
    assert len(columns.get_attr("possible_agents")) == 8
    columns.set_attr("marked", 7, indices=[4])
    assert columns.get_attr("marked") == [None] * 4 + [7] * 4
    assert columns.env_method("observation_space", "turtle1/pose", indices=0)[0].shape == (8,)
    columns.close()
    with pytest.raises(ConfigError, match="no environment"):
        sb3.vec_env([])


class Tensor:
    """As torch's: numbers that must be asked for."""

    def __init__(self, numbers: Any) -> None:
        self._numbers = numbers

    def detach(self) -> Tensor:
        return self

    def cpu(self) -> Tensor:
        return self

    def numpy(self) -> Any:
        return self._numbers


class Linear:
    def __init__(self, before: int, after: int) -> None:
        draw = np.random.default_rng(before + after)
        self.weight, self.bias = Tensor(draw.normal(size=(after, before))), Tensor(np.ones(after))


class Tanh:
    pass


class ReLU:
    pass


class SiLU:
    pass


class Parts(list[Any]):
    """As torch's modules that have parts."""

    def modules(self) -> list[Any]:
        return [self, *self]


def forward(parts: list[Any], seen: Any) -> Any:
    for part in parts:
        seen = part.weight.numpy() @ seen + 1 if isinstance(part, Linear) else np.tanh(seen)
    return seen


def test_what_stable_baselines_learnt_is_a_network() -> None:
    hidden, head = Linear(*SIZES[:2]), Linear(*SIZES[1:])
    policy = SimpleNamespace(
        mlp_extractor=SimpleNamespace(policy_net=[hidden, Tanh()]),
        action_net=head,
        activation_fn=Tanh,
    )
    learnt = sb3.policy_of(SimpleNamespace(policy=policy), "me")
    network = learnt.of("anything")
    assert network is not None
    seen = np.linspace(0, 1, OBSERVATION_SIZE)
    assert network.logits(seen) == pytest.approx(forward([hidden, Tanh(), head], seen))
    assert learnt.made_by == "me"
    with pytest.raises(ConfigError, match="no actor with layers"):
        sb3.policy_of(SimpleNamespace(policy=object()))


# -- RLlib -----------------------------------------------------------------------------------------


def module(*between: Any, shared: bool = False) -> Any:
    actor = Parts([Linear(*SIZES[:2]), *between])
    name = "encoder" if shared else "actor_encoder"
    return SimpleNamespace(encoder=SimpleNamespace(**{name: actor}), pi=Parts([Linear(*SIZES[1:])]))


@pytest.mark.parametrize("shared", [True, False])
def test_what_rllib_learnt_is_a_network(shared: bool) -> None:
    one = module(Tanh(), shared=shared)
    learnt = rllib.policy_of({"pose": one, ANY_TOPIC: module(ReLU())})
    network = learnt.of("turtle1/pose")
    assert network is not None
    seen = np.linspace(0, 1, OBSERVATION_SIZE)
    actor = getattr(one.encoder, "encoder" if shared else "actor_encoder")
    assert network.logits(seen) == pytest.approx(forward([*actor, *one.pi], seen))
    other = learnt.of("turtle1/cmd_vel")
    assert other is not None
    assert other.activation == "relu"


def test_other_modules_are_refused() -> None:
    with pytest.raises(ConfigError, match="no encoder and head"):
        rllib.policy_of({"pose": object()})
    with pytest.raises(ConfigError, match="different activations"):
        rllib.policy_of({"pose": module(Tanh(), ReLU())})
    with pytest.raises(ConfigError, match="tanh or relu"):
        rllib.policy_of({"pose": module(SiLU())})


def test_topics_of_a_kind_learn_together() -> None:
    assert rllib.module_for("turtle1/pose", None, extra=1) == "pose"
    assert rllib.module_for("camera") == "camera"


# -- the scripts in examples/learning --------------------------------------------------------------


@pytest.mark.parametrize("name", ["sb3_maximizer.py", "rllib_maximizer.py"])
def test_scripts_use_what_there_is(name: str) -> None:
    """They are run by hand, since they take minutes and torch; what they take from us exists, at least."""
    tree = ast.parse((EXAMPLES / name).read_text())
    imports = [
        (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("simple_ros")
        for alias in node.names
    ]
    assert imports
    for package, wanted in imports:
        assert hasattr(importlib.import_module(package or ""), wanted), f"{package}: {wanted}"
