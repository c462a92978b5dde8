"""The maximizer without a network: knobs, requests, clamp, learner, environment, policies, depletion."""

from __future__ import annotations

import importlib
import math
import random
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.maximizer.agent import LoopLearner, SearchRules
from simple_ros_engines.network_exposure.maximizer.clamp import SafetyClamp
from simple_ros_engines.network_exposure.maximizer.depletion import Depletion, Measure
from simple_ros_engines.network_exposure.maximizer.environment import (
    OBSERVATION_SIZE,
    TopicEnvironment,
    paper_reward,
    saved,
)
from simple_ros_engines.network_exposure.maximizer.knobs import (
    DELAYS,
    DROPS,
    SPEEDS,
    START,
    STAY,
    Setting,
)
from simple_ros_engines.network_exposure.maximizer.plant import LoopSetup, Seen, SimulatedTurtles
from simple_ros_engines.network_exposure.maximizer.policy_file import (
    policy_from_text,
    policy_text,
    settings_for,
)
from simple_ros_engines.network_exposure.maximizer.resource import (
    TopicTraffic,
    capacity_bps,
    request_of,
    requested_bps,
)
from simple_ros_engines.network_exposure.maximizer.training import (
    learners_for,
    random_actions,
    run_episode,
    stay_actions,
    train,
)
from simple_ros_engines.network_exposure.maximizer.wrappers import (
    ExtraMissing,
    gymnasium_env,
    parallel_env,
)

settings = st.builds(
    Setting,
    st.integers(0, len(DELAYS) - 1),
    st.integers(0, len(DROPS) - 1),
    st.integers(0, len(SPEEDS) - 1),
)
notch = st.integers(-1, 1)
POSES = TopicTraffic(62.5, 33.0, 1e-2)
GROUPS = {"t": ("t/pose", "t/cmd_vel")}
WORST_SETTING = Setting(len(DELAYS) - 1, len(DROPS) - 1, len(SPEEDS) - 1)


def seen(mos: float, setting: Setting = START) -> Seen:
    return Seen(10.0, 100.0, 0.001, mos, setting)


# -- knobs and requests ----------------------------------------------------------------------------


@given(settings, st.tuples(notch, notch, notch))
def test_knobs_turn_one_notch_and_stop_at_their_ends(
    here: Setting, action: tuple[int, ...]
) -> None:
    there = here.moved(action)
    assert all(abs(a - b) <= 1 for a, b in zip(here.notches, there.notches, strict=True))


@given(settings, settings)
def test_one_setting_is_reached_from_any_other(here: Setting, goal: Setting) -> None:
    for _ in range(len(DELAYS) + len(DROPS)):
        here = here.moved(here.towards(goal))
    assert here == goal


def test_what_is_no_action_or_setting_is_told() -> None:
    with pytest.raises(ConfigError, match="three of"):
        START.moved((1, 0))
    with pytest.raises(ConfigError, match="three of"):
        START.moved((2, 0, 0))
    with pytest.raises(ConfigError, match="drop has values 0 to 8"):
        Setting(0, 9, 0)


def test_a_request_is_that_of_the_mapper() -> None:
    # The mapper's own test vector: 62.5 Hz, steady, 1e-2.
    assert request_of(POSES, START).qci == 83
    assert request_of(POSES, Setting(delay=DELAYS.index(8.0))).qci == 1


def test_capacity_is_that_of_a_queue() -> None:
    # 100 messages of 1,000 bit; each 0.1 s and one of e^-5 later: 100 + 5 / 0.1 served a second.
    assert capacity_bps(100_000, 125, 100, math.exp(-5)) == pytest.approx(150_000)


@given(settings)
def test_a_longer_budget_and_fewer_messages_never_cost_more(setting: Setting) -> None:
    for action in ((1, 0, 0), (0, 1, 0)):
        there = setting.moved(action)
        for by_class in (False, True):
            after = requested_bps(POSES, there, by_class=by_class)
            assert after <= requested_bps(POSES, setting, by_class=by_class) * 1.0001
    assert saved(POSES, START) == 0
    assert saved(POSES, setting) < 1


def test_the_papers_reward_without_its_hole() -> None:
    whole, half = paper_reward(seen(5.0)), paper_reward(seen(5.0, Setting(drop=len(DROPS) - 1)))
    assert (whole, half) == (1000 - 256, 1000 - 2)
    assert paper_reward(seen(5.0, Setting(delay=2))) == whole + DELAYS[2]


# -- clamp -----------------------------------------------------------------------------------------


def worse() -> dict[str, Setting]:
    return dict.fromkeys(GROUPS["t"], Setting(3, 3, 2))


def start() -> dict[str, Setting]:
    return dict.fromkeys(GROUPS["t"], START)


def test_the_clamp_takes_back_what_harmed() -> None:
    clamp = SafetyClamp(GROUPS, 4.0)
    good = {topic: seen(4.9) for topic in GROUPS["t"]}
    bad = {topic: seen(2.0) for topic in GROUPS["t"]}
    assert clamp.guard(good, start(), worse()) == (worse(), ())
    assert clamp.guard(bad, worse(), worse()) == (start(), ("t",))
    # Already back: time to recover, whatever is wanted.
    assert clamp.guard(bad, start(), worse())[0] == start()


def test_what_was_good_and_is_not_any_more_is_left_step_by_step() -> None:
    clamp = SafetyClamp(GROUPS, 4.0, recovery=1)
    now = worse()
    clamp.guard({topic: seen(4.9) for topic in now}, now, now)
    bad = {topic: seen(1.0) for topic in now}
    for _ in range(20):
        now, _reverted = clamp.guard(bad, now, worse())
    assert now == start()


def test_a_clamp_needs_a_score() -> None:
    with pytest.raises(ConfigError, match="from 1 to 5"):
        SafetyClamp(GROUPS, 6)


# -- learner ---------------------------------------------------------------------------------------


def play(
    learner: LoopLearner,
    reward: Mapping[int, float],
    limit: int,
    steps: int = 2000,
) -> dict[str, Setting]:
    """A process whose score breaks when the delays together exceed a limit; delay is worth a reward."""
    here = dict.fromkeys(learner.topics, START)
    for _ in range(steps):
        actions = learner.act(here)
        here = {topic: here[topic].moved(actions[topic]) for topic in here}
        delays = sum(one.delay for one in here.values())
        mos = 4.9 if delays <= limit and here[learner.topics[-1]].speed >= 2 else 2.0
        gained = sum(reward[one.delay] for one in here.values())
        learner.learn(here, gained + (mos - 5), mos)
    return learner.best


@pytest.mark.parametrize("seed", range(5))
def test_the_learner_finds_the_edge_and_stays_inside(seed: int) -> None:
    learner = LoopLearner(GROUPS["t"], SearchRules(), random.Random(seed))
    worth = {notches: 1 - 1 / (1 + notches) for notches in range(len(DELAYS))}
    best = play(learner, worth, 6)
    assert sum(one.delay for one in best.values()) == 6
    # Worth is concave: sharing is better than one topic with all.
    assert all(2 <= one.delay <= 4 for one in best.values())


def test_a_learner_that_does_not_learn_goes_where_it_is_told() -> None:
    learner = LoopLearner(GROUPS["t"], learns=False)
    goal = {"t/pose": Setting(4, 2, 2), "t/cmd_vel": Setting(1, 0, 2)}
    learner.best = goal
    assert play(learner, dict.fromkeys(range(20), 0.0), 99, 20) == goal
    assert learner.trials == 0


def test_harm_makes_it_step_back_even_when_it_does_not_learn() -> None:
    learner = LoopLearner(GROUPS["t"], learns=False)
    learner.best = worse()
    for _ in range(4):
        learner.learn(worse(), 0.0, 1.0)
    learner.harmed()
    assert learner.best == {topic: one.moved((-1, -1, 0)) for topic, one in worse().items()}


def test_what_is_no_number_is_not_learnt() -> None:
    learner = LoopLearner(GROUPS["t"])
    for _ in range(30):
        learner.learn(start(), math.nan, 5.0)
    assert learner.act(start()) == dict.fromkeys(GROUPS["t"], STAY)


# -- environment -----------------------------------------------------------------------------------


def turtles(seed: int = 0, slip: float = 0.15) -> SimulatedTurtles:
    return SimulatedTurtles((LoopSetup(slip=slip), LoopSetup(radius_m=1.5, slip=slip)), seed, 2.0)


def topics_of(plant: SimulatedTurtles) -> list[str]:
    return [topic for topics in plant.groups.values() for topic in topics]


def test_turtles_run_well_until_they_are_made_worse() -> None:
    plant = turtles()
    for _ in range(3):
        first = plant.advance(dict.fromkeys(topics_of(plant), START))
    for _ in range(3):
        last = plant.advance(dict.fromkeys(topics_of(plant), WORST_SETTING))
    assert all(one.mos > 4.5 for one in first.values())
    assert all(one.mos < 3 for one in last.values())
    pose = first["turtle1/pose"]
    assert pose.rate_hz == pytest.approx(62.5, rel=0.02)
    assert last["turtle1/pose"].rate_hz == pytest.approx(31.25, rel=0.02)


def test_the_same_seed_gives_the_same_world() -> None:
    runs = [turtles(5).advance(dict.fromkeys(topics_of(turtles()), START)) for _ in range(2)]
    assert runs[0] == runs[1]


def test_an_environment_is_truncated_and_goes_on() -> None:
    environment = TopicEnvironment(turtles(), horizon=3)
    seen = environment.reset()
    assert set(seen) == {f"turtle{n}/{end}" for n in (1, 2) for end in ("pose", "cmd_vel")}
    assert all(
        one.shape == (OBSERVATION_SIZE,) and one.dtype == np.float32 for one in seen.values()
    )
    steps = [environment.step({"turtle1/pose": (1, 1, 0)}) for _ in range(3)]
    assert [step.is_truncated for step in steps] == [False, False, True]
    environment.reset()
    assert environment.settings["turtle1/pose"] == Setting(3, 3, 2)
    assert environment.settings["turtle2/pose"] == START
    environment.reset(start())
    assert environment.settings["turtle1/pose"] == START
    for one in steps[-1].observations.values():
        assert ((one >= 0) & (one <= 1)).all()


def test_a_trained_agent_asks_for_less_and_keeps_the_score() -> None:
    """A short training; the yardstick is benchmarks/network_exposure/maximizer.py."""
    plant = turtles(1)
    environment = TopicEnvironment(plant, clamp=SafetyClamp(plant.groups), horizon=300)
    learners = learners_for(environment, 1)
    train(environment, learners, 1)
    for learner in learners.values():
        learner.learns = False
    trial = turtles(2)
    result = train(TopicEnvironment(trial, horizon=40), learners, 1)[0]
    assert min(result.mos.values()) > 4.4
    topics = result.settings.items()
    asked = sum(requested_bps(trial.traffic(t), one, by_class=False) for t, one in topics)
    own = sum(requested_bps(trial.traffic(t), START, by_class=False) for t, _ in topics)
    assert asked < 0.8 * own
    untrained = run_episode(TopicEnvironment(turtles(2), horizon=40), random_actions(3))
    assert result.paper_reward > untrained.paper_reward
    idle = run_episode(TopicEnvironment(turtles(2), horizon=40), stay_actions)
    assert result.reward > idle.reward


# -- policies --------------------------------------------------------------------------------------


def test_policies_survive_a_file_and_serve_other_turtles() -> None:
    policy = {"t": {"t/pose": Setting(4, 2, 2), "t/cmd_vel": Setting(1, 0, 3)}}
    read = policy_from_text(policy_text(policy))
    assert read == policy
    other = settings_for(read, ("/bob/pose", "bob/cmd_vel", "bob/other"))
    assert list(other.values()) == [Setting(4, 2, 2), Setting(1, 0, 3), START]


BY_HAND = policy_text({"t": {"a": START}}).replace('"version": 2', '"version": 1')
"""Version 1 has no checksum."""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "must be JSON"),
        ("[]", "format"),
        ("{}", "format"),
        ('{"format": "simple_ros maximizer policy", "version": 3}', "version 3"),
        ('{"format": "simple_ros maximizer policy", "version": 1}', "missing"),
        (BY_HAND.replace('"drop": 0', '"drop": 99'), "0 to 8"),
        (BY_HAND.replace('"drop": 0', '"drop": "x"'), "whole numbers"),
        (BY_HAND.replace('"drop"', '"drip"'), "missing"),
    ],
)
def test_what_is_no_policy_is_told(text: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        policy_from_text(text)


# -- depletion -------------------------------------------------------------------------------------


def test_depletion_goes_as_in_the_papers_figure() -> None:
    state = Depletion(settle_s=2.0)
    assert state.downgraded("a", 0.0) is Measure.LOWER_REQUEST
    assert state.downgraded("b", 0.5) is None
    assert state.downgraded("a", 3.0) is Measure.ADAPT
    assert state.downgraded("a", 9.0) is None
    assert state.recovered("a", 10.0) is None
    assert state.is_short
    assert state.recovered("b", 11.0) is Measure.RESTORE
    assert (state.level, state.is_short) == (0, False)
    assert state.recovered("b", 12.0) is None


def test_a_lower_request_that_is_granted_stays() -> None:
    state = Depletion()
    state.downgraded("a", 0.0)
    assert state.granted("a", 1.0) is None
    assert (state.level, state.is_short) == (1, False)
    assert state.recovered("a", 5.0) is Measure.RESTORE


def test_the_last_topic_that_is_served_again_ends_a_recovery() -> None:
    state = Depletion(settle_s=0.0)
    state.downgraded("a", 0.0)
    assert state.downgraded("b", 1.0) is Measure.ADAPT
    assert state.recovered("a", 2.0) is None
    assert state.granted("b", 3.0) is Measure.RESTORE


def test_more_is_tried_after_a_while_and_more_rarely_when_that_fails() -> None:
    state = Depletion(settle_s=1.0, patience_s=10.0)
    state.downgraded("a", 0.0)
    state.downgraded("a", 2.0)
    assert state.tick(100.0) is None
    state.granted("a", 3.0)
    assert state.tick(11.0) is None
    assert state.tick(12.0) is Measure.RESTORE
    assert state.downgraded("a", 14.0) is Measure.ADAPT
    state.granted("a", 15.0)
    assert state.tick(33.0) is None
    assert state.tick(34.0) is Measure.RESTORE
    assert state.tick(54.0) is Measure.RAISE_REQUEST
    assert (state.level, state.tick(99.0)) == (0, None)


def test_the_clamp_does_not_blame_settings_for_the_network() -> None:
    clamp = SafetyClamp(GROUPS, 4.0)
    bad = {topic: replace(seen(2.0), is_downgraded=True) for topic in GROUPS["t"]}
    assert clamp.guard(bad, worse(), start()) == (worse(), ())


# -- other people's algorithms ---------------------------------------------------------------------


def test_without_their_packages_the_wrappers_say_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def absent(name: str) -> object:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    environment = TopicEnvironment(turtles())
    with pytest.raises(ExtraMissing, match=r"simple-ros\[learning\]") as told:
        gymnasium_env(environment, "turtle1/pose")
    assert told.value.package == "gymnasium"
    with pytest.raises(ImportError):
        parallel_env(environment)


def test_gymnasium_takes_it_for_one_of_its_own() -> None:
    pytest.importorskip("gymnasium", reason="gymnasium is not installed")
    environment = TopicEnvironment(turtles(), horizon=4)
    made = gymnasium_env(environment, "turtle1/pose", others=stay_actions)
    made.reset(seed=1)
    *_, terminated, truncated, facts = made.step(np.array([2, 1, 1]))
    assert environment.settings["turtle1/pose"].delay == 1
    assert (terminated, truncated) == (False, False)
    assert 1 <= facts["mos"] <= 5
    assert made.observation_space.contains(made.reset()[0])
    assert isinstance(made, importlib.import_module("gymnasium").Env)
    with pytest.raises(LookupError, match="turtle2/pose"):
        gymnasium_env(environment, "nothing")


def test_pettingzoo_takes_it_for_one_of_its_own() -> None:
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed")
    api = importlib.import_module("pettingzoo.test")
    api.parallel_api_test(parallel_env(TopicEnvironment(turtles(), horizon=10)), num_cycles=25)
