"""The Physical Adaptive Engine's algorithms."""

from __future__ import annotations

import json
import math
import random
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import pytest

from simple_ros.errors import ConfigError
from simple_ros_engines.forecasting import LinearForecaster
from simple_ros_engines.physical_adaptive.actuators import RrmPolicyFile, rrm_policy
from simple_ros_engines.physical_adaptive.congestion import CongestionWatch, prevent
from simple_ros_engines.physical_adaptive.core import (
    Demand,
    LinkView,
    PhysicalAdaptive,
    PhysicalSettings,
)
from simple_ros_engines.physical_adaptive.goodput import GoodputAdapter, SampledGoodput
from simple_ros_engines.physical_adaptive.harq import advised_retransmissions, residual_loss
from simple_ros_engines.physical_adaptive.link_adaptation import (
    LinkAdapter,
    OuterLoop,
    feedback_step,
)
from simple_ros_engines.physical_adaptive.q_learning import QLearner, QSettings, discretize_state
from simple_ros_engines.physical_adaptive.resources import resource_need
from simple_ros_engines.physical_adaptive.strategy import (
    Bounds,
    Strategy,
    recommended,
    score,
    validated,
)
from simple_ros_engines.radio.bler import block_error_rate, required_snr_db
from simple_ros_engines.radio.carrier import Carrier
from simple_ros_engines.radio.mcs import McsTable, mcs_entry

TABLE = McsTable.QAM64
STRATEGY = Strategy(10, 20, 0.5, 3, True, 2, "BALANCED", 1e6)
VIEW = LinkView(12.0, 0.05, 12, 25.0, 0.0, 3e6, 20e6, 51)
DEMAND = Demand("STANDARD", 4e6, 0.5)


class TestOuterLoop:
    def test_it_stands_still_at_the_target(self):
        loop = OuterLoop(0.1, 0.02).after(arrived=90, lost=10)
        assert loop.offset_db == pytest.approx(0.0)

    def test_one_lost_block_weighs_as_much_as_nine_that_arrived(self):
        assert OuterLoop(0.1, 0.02).after(0, 1).offset_db == pytest.approx(-0.18)

    def test_it_stays_within_its_limit(self):
        assert OuterLoop(limit_db=2.0).after(0, 1000).offset_db == -2.0

    def test_settings_without_meaning(self):
        with pytest.raises(ConfigError, match="target_bler"):
            OuterLoop(1.0)
        with pytest.raises(ConfigError):
            OuterLoop(step_up_db=0.0)

    @pytest.mark.parametrize("hidden_db", [-2.0, 0.0, 2.0])
    def test_it_finds_an_offset_that_nobody_told(self, hidden_db):
        adapter, draw = LinkAdapter(TABLE, OuterLoop(0.1, 0.02)), random.Random(1)
        lost = 0
        for step in range(6000):
            mcs = adapter.choose(12.0)
            is_lost = draw.random() < block_error_rate(mcs_entry(TABLE, mcs), 12.0 + hidden_db)
            adapter.feedback(not is_lost, is_lost)
            lost += is_lost and step >= 2000
        assert lost / 4000 == pytest.approx(0.1, abs=0.02)

    @pytest.mark.parametrize("hidden_db", [-2.0, 1.5])
    def test_it_learns_from_schemes_that_somebody_else_chose(self, hidden_db):
        """A network holds its own target; how the radio differs is seen nevertheless."""
        adapter, draw = LinkAdapter(TABLE), random.Random(1)
        for _ in range(400):
            snr_db = draw.uniform(5, 15)
            mcs = draw.choice(range(max(0, adapter.choose(snr_db) - 3), adapter.mcs + 4))
            rate = block_error_rate(mcs_entry(TABLE, mcs), snr_db + hidden_db)
            adapter.calibrate(snr_db, mcs, rate)
        assert adapter.loop.offset_db == pytest.approx(hidden_db, abs=0.3)

    def test_no_lost_block_says_only_that_the_offset_is_not_less(self):
        adapter = LinkAdapter(TABLE)
        adapter.calibrate(30.0, 5, 0.0)
        assert adapter.loop.offset_db == 0.0
        adapter.calibrate(-10.0, 5, 1.0)
        assert adapter.loop.offset_db == 0.0

    def test_it_is_frozen_at_the_ends_of_the_table(self):
        top = LinkAdapter(TABLE)
        top.choose(60.0)
        top.feedback(1000, 0)
        assert top.loop.offset_db == 0.0
        bottom = LinkAdapter(TABLE)
        bottom.choose(-30.0)
        bottom.feedback(0, 1000)
        assert bottom.loop.offset_db == 0.0

    def test_a_scheme_limit_holds(self):
        assert LinkAdapter(TABLE, max_index=10).choose(60.0) == 10


class TestSampledGoodput:
    """What an engine sees: some samples a second, of schemes that the network chose."""

    @pytest.mark.parametrize("hidden_db", [-2.0, 0.0, 2.0])
    def test_it_finds_the_offset_and_loses_what_it_may(self, hidden_db):
        link, draw, lost = SampledGoodput(0.1), random.Random(2), []
        for _ in range(2500):
            snr_db = draw.gauss(10, 0.5)
            mcs = link.choose(snr_db)
            lost.append(block_error_rate(mcs_entry(TABLE, mcs), snr_db + hidden_db))
            link.calibrate(snr_db, mcs, lost[-1])
        assert fmean(lost[-1000:]) == pytest.approx(0.1, abs=0.03)
        assert link.offset_db == pytest.approx(hidden_db, abs=1.0)
        assert link.deviation_db == pytest.approx(0.5 * math.sqrt(2), abs=0.2)

    def test_it_learns_from_schemes_that_the_network_chose(self):
        told, draw = SampledGoodput(0.1), random.Random(3)
        for _ in range(600):
            snr_db = draw.gauss(10, 0.5)
            told.choose(snr_db)
            mcs = draw.choice((10, 12, 14))
            told.calibrate(snr_db, mcs, block_error_rate(mcs_entry(TABLE, mcs), snr_db - 4.0))
        assert told.offset_db == pytest.approx(-4.0, abs=1.0)

    def test_another_target_changes_what_it_loses(self):
        lost = {}
        for target in (0.3, 0.03):
            link, draw, seen = SampledGoodput(0.1), random.Random(4), []
            link.aim(target)
            for _ in range(2500):
                snr_db = draw.gauss(10, 0.5)
                mcs = link.choose(snr_db)
                seen.append(block_error_rate(mcs_entry(TABLE, mcs), snr_db))
                link.calibrate(snr_db, mcs, seen[-1])
            lost[target] = fmean(seen[-500:])
        assert lost[0.3] > 2 * lost[0.03]
        with pytest.raises(ConfigError, match="target_bler is 1"):
            SampledGoodput(0.1).aim(1.0)

    def test_the_engine_decides_with_it_if_asked(self):
        settings = PhysicalSettings(learn=False, adaptation="goodput")
        core, sampled = PhysicalAdaptive(settings, random.Random(1)), SampledGoodput(0.1)
        for _ in range(50):
            core.observe("link", VIEW)
            sampled.calibrate(VIEW.snr_db, VIEW.mcs, VIEW.bler)
            assert core.decide("link", VIEW, DEMAND).mcs == sampled.choose(VIEW.snr_db)
        core.change(target_bler=0.05, max_harq_retx=2)
        assert core.settings.target_bler == 0.05


class TestGoodputAdapter:
    def run(self, adapter, hidden_db, spread_db, blocks=6000):
        """Share of blocks lost and mean goodput of the second half, on a channel that is foretold so badly."""
        draw, lost, bits = random.Random(1), 0, 0.0
        for step in range(blocks):
            expected_db = draw.uniform(4, 16)
            choice = adapter.choose(expected_db, spread_db)
            snr_db = expected_db + hidden_db + draw.gauss(0, spread_db)
            entry = mcs_entry(TABLE, choice.mcs)
            is_lost = draw.random() < block_error_rate(entry, snr_db)
            adapter.feedback(choice, not is_lost, is_lost)
            if step >= blocks // 2:
                lost += is_lost
                bits += 0.0 if is_lost else entry.efficiency
        return lost / (blocks / 2), bits / (blocks / 2)

    @pytest.mark.parametrize("hidden_db", [-2.0, 0.0, 2.0])
    def test_it_finds_an_offset_and_loses_what_it_may(self, hidden_db):
        adapter = GoodputAdapter(0.1)
        # The price has a long way to go where the target allows more than pays.
        self.run(adapter, hidden_db, 1.0)
        lost, _ = self.run(adapter, hidden_db, 1.0)
        assert lost == pytest.approx(0.1, abs=0.02)
        assert adapter.offset_db == pytest.approx(hidden_db, abs=0.5)

    def test_without_a_target_it_brings_more_than_with_one(self):
        lost, free = self.run(GoodputAdapter(None), 1.0, 1.0)
        _, bound = self.run(GoodputAdapter(0.3), 1.0, 1.0)
        assert lost < 0.15
        assert free > bound

    def test_an_uncertain_forecast_makes_careful(self):
        adapter = GoodputAdapter()
        assert adapter.choose(12.0, 3.0).mcs < adapter.choose(12.0, 0.0).mcs
        assert adapter.choose(-40.0).mcs == 0
        assert adapter.choose(80.0, 0.5) == adapter.choose(90.0, 0.5)

    def test_the_ends_of_the_table_say_nothing_about_the_price(self):
        adapter = GoodputAdapter()
        for snr_db in (-40.0, 60.0):
            for _ in range(1000):
                choice = adapter.choose(snr_db)
                adapter.feedback(choice, snr_db > 0, snr_db < 0)
        assert adapter.price == 0.0

    def test_a_cheap_loss_is_no_reason_to_send_in_vain(self):
        adapter = GoodputAdapter(0.5)
        adapter.price = -3.0
        for snr_db in (-40.0, -6.0, 0.0, 6.0, 20.0):
            choice = adapter.choose(snr_db, 1.0)
            assert choice.mcs == 0 or choice.expected >= 0.7

    def test_settings_without_meaning(self):
        with pytest.raises(ConfigError, match="target_bler"):
            GoodputAdapter(1.0)
        with pytest.raises(ConfigError, match="rate_db"):
            GoodputAdapter(rate_db=0.0)


class TestFeedbackStep:
    @pytest.mark.parametrize(
        ("bler", "expected"), [(0.16, 8), (0.12, 9), (0.05, 10), (0.0, 11), (1.0, 8)]
    )
    def test_the_rule(self, bler, expected):
        assert feedback_step(TABLE, 10, bler, 30.0, 0.9) == expected

    def test_up_needs_stability_and_three_decibels(self):
        needed = required_snr_db(mcs_entry(TABLE, 11), 0.1)
        assert feedback_step(TABLE, 10, 0.0, 30.0, 0.6) == 10
        assert feedback_step(TABLE, 10, 0.0, needed + 2.9, 0.9) == 10
        assert feedback_step(TABLE, 10, 0.0, needed + 3.1, 0.9) == 11
        assert feedback_step(TABLE, 28, 0.0, 60.0, 0.9) == 28
        assert feedback_step(TABLE, 0, 1.0, 0.0, 0.9) == 0


class TestHarq:
    @pytest.mark.parametrize(
        ("current", "bler", "stability", "criticality", "expected"),
        [(2, 0.2, 0.5, 0.5, 3), (2, 0.0, 0.9, 0.5, 1), (2, 0.0, 0.7, 0.5, 2),
         (2, 0.05, 0.9, 0.9, 3), (4, 0.5, 0.5, 1.0, 4), (0, 0.0, 0.9, 0.1, 0)],
    )  # fmt: skip
    def test_advice(self, current, bler, stability, criticality, expected):
        advice = advised_retransmissions(
            current, enabled=True, bler=bler, bler_stability=stability, criticality=criticality
        )
        assert advice == expected

    def test_nothing_changes_where_repeating_is_off(self):
        kept = advised_retransmissions(
            1, enabled=False, bler=1.0, bler_stability=0, criticality=1.0
        )
        assert kept == 1

    def test_residual_loss_falls_faster_than_without_combining(self):
        assert residual_loss(0.1, 0) == 0.1
        assert residual_loss(0.1, 1) == pytest.approx(0.1 * 0.025)


class TestResources:
    def test_a_block_carries_its_share(self):
        mcs = mcs_entry(TABLE, 10)
        one = Carrier(30, 51).rate_bps(mcs.efficiency, 1)
        assert resource_need(one, mcs, Carrier(30, 51)).prb == 1
        assert resource_need(one * 1.01, mcs, Carrier(30, 51)).prb == 2

    def test_at_least_one_block(self):
        need = resource_need(1.0, mcs_entry(TABLE, 28), Carrier(30, 51))
        assert (need.prb, need.compression_ratio) == (1, 1.0)

    def test_too_much_is_compressed(self):
        carrier, mcs = Carrier(30, 51), mcs_entry(TABLE, 10)
        fits = carrier.rate_bps(mcs.efficiency)
        need = resource_need(2 * fits, mcs, carrier)
        assert need.prb == 51
        assert need.wanted_prb == 102
        assert need.compression_ratio == pytest.approx(0.5)
        assert resource_need(1e6 * fits, mcs, carrier).compression_ratio == 0.05

    def test_spacing_counts(self):
        mcs = mcs_entry(TABLE, 10)
        narrow = resource_need(5e6, mcs, Carrier(15, 106)).prb
        wide = resource_need(5e6, mcs, Carrier(30, 106)).prb
        assert narrow == pytest.approx(2 * wide, abs=1)

    def test_a_grant_is_obeyed(self):
        need = resource_need(100e6, mcs_entry(TABLE, 10), Carrier(30, 51), available_prb=7)
        assert need.prb == 7


class TestQLearning:
    def test_bins(self):
        assert discretize_state(-10, 0.0, 0, 0.0) == (0, 0, 0, 0)
        assert discretize_state(29.9, 0.49, 99_999, 0.99) == (4, 4, 4, 2)
        assert discretize_state(100, 1.0, 1e9, 1.0) == (4, 4, 4, 2)
        assert discretize_state(-50, 0.1, 20_000, 0.34) == (0, 1, 1, 1)

    def test_the_target_uses_the_state_that_followed(self):
        learner = QLearner([(0,), (1,)], 0, QSettings(learning_rate=0.5, discount=0.9))
        # A state never seen counts with the mean reward for ever: 1 / (1 - 0.9).
        learner.learn("b", 1, 1.0, "nowhere")
        assert learner.value("b", 1) == pytest.approx(1 + 0.9 * 10)
        learner.learn("a", 0, 0.0, "b")
        assert learner.value("a", 0) == pytest.approx(0.9 * 10)
        learner.learn("a", 0, 0.0, "b")
        assert learner.value("a", 0) == pytest.approx(9.0)
        learner.learn("a", 0, 2.0, "a")
        assert learner.value("a", 0) == pytest.approx(9 + 0.5 * (2 + 0.9 * 9 - 9))

    def test_nothing_but_the_heuristic_before_there_is_experience(self):
        learner = QLearner([(-1,), (0,), (1,)], 1)
        assert {learner.choose("s", random.Random(i)) for i in range(50)} == {1}

    def test_it_learns_which_action_pays(self):
        learner, draw = QLearner([(-1,), (0,), (1,)], 1), random.Random(3)
        for _ in range(800):
            action = learner.choose("s", draw)
            learner.learn("s", action, (0.5, 0.6, 0.7)[action], "s")
        assert learner.best("s") == 2
        assert learner.states_seen() == 1
        assert learner.mean_reward() > 0.6

    def test_exploring_costs_no_more_than_its_budget(self):
        learner, draw = QLearner([(-1,), (0,), (1,)], 1, QSettings(budget=0.03)), random.Random(3)
        total = 0.0
        for _ in range(2000):
            action = learner.choose("s", draw)
            reward = 0.6 if action == 1 else 0.0
            total += reward
            learner.learn("s", action, reward, "s")
        assert learner.best("s") == 1
        assert total / (2000 * 0.6) > 0.95

    def test_exploration_decays_to_its_floor(self):
        learner = QLearner([(0,)], 0)
        assert learner.exploration_rate() == 0.2
        learner.episodes = 10_000
        assert learner.exploration_rate() == 0.05
        with pytest.raises(ConfigError):
            QLearner([(0,)], 1)


class TestCongestion:
    def samples(self, buffers, rtts):
        watch = CongestionWatch()
        return [watch.sample(b, r) for b, r in zip(buffers, rtts, strict=True)]

    def test_a_growing_buffer_and_round_trip(self):
        buffers = [10_000.0] * 10 + [40_000.0, 80_000.0, 160_000.0]
        rtts = [20.0] * 10 + [40.0, 80.0, 160.0]
        found = self.samples(buffers, rtts)
        assert not any(found[:10])
        assert found[-1]

    def test_a_first_byte_is_no_congestion(self):
        assert not any(self.samples([0.0] * 10 + [500.0] * 5, [20.0] * 15))

    def test_a_late_packet_is_no_congestion(self):
        assert not any(self.samples([0.0] * 20, [20.0] * 12 + [60.0] + [20.0] * 7))

    def test_it_ends(self):
        watch = CongestionWatch()
        for _ in range(10):
            watch.sample(0.0, 20.0)
        for _ in range(5):
            watch.sample(1e6, 200.0)
        assert watch.is_congested
        for _ in range(20):
            watch.sample(0.0, 20.0)
        assert not watch.is_congested

    def test_prevention_sends_less(self):
        assert prevent(0.6, 3) == (pytest.approx(0.5), 2)
        assert prevent(0.05, 1) == (0.05, 1)


class TestStrategy:
    def test_recommendations(self):
        assert recommended(STRATEGY, "MAXIMIZE_DATA_COLLECTION").prb == 30
        assert recommended(STRATEGY, "MODERATE_CONSERVATION").max_harq_retx == 3
        emergency = recommended(STRATEGY, "EMERGENCY_CONSERVATION")
        assert (emergency.mcs, emergency.prb, emergency.priority) == (6, 5, 1)
        assert emergency.compression_ratio == pytest.approx(0.2)
        assert recommended(STRATEGY, "NORMAL_OPERATION") == STRATEGY

    def test_bounds(self):
        wild = replace(STRATEGY, mcs=99, prb=500, compression_ratio=7.0, priority=0, rate_bps=-1)
        kept, changed = validated(wild, Bounds(28, 51, 4))
        assert (kept.mcs, kept.prb, kept.compression_ratio, kept.priority) == (28, 51, 1.0, 1)
        assert changed == ("mcs", "prb", "compression_ratio", "priority", "rate_bps")
        assert validated(STRATEGY, Bounds()) == (STRATEGY, ())

    def test_an_idle_robot_loses_nothing(self):
        assert score(0.0, 5.0, 0.0, 0.0) == pytest.approx(1.0)
        assert score(0.0, 5.0, 5e6, 10e6) == pytest.approx(0.85)
        assert score(0.5, 0.0, 0.0, None) == 0.0


class TestCore:
    def engine(self, **settings) -> PhysicalAdaptive:
        return PhysicalAdaptive(PhysicalSettings(**settings), random.Random(1))

    def test_a_strategy_is_within_bounds_and_fits(self):
        engine = self.engine()
        engine.observe("4601", VIEW)
        strategy = engine.decide("4601", VIEW, DEMAND)
        assert 19 <= strategy.mcs <= 21
        assert 1 <= strategy.prb <= 51
        assert strategy.strategy_type == "BALANCED"
        assert strategy.rate_bps == pytest.approx(4e6)

    def test_a_grant_is_obeyed(self):
        strategy = self.engine().decide("x", VIEW, replace(DEMAND, rate_bps=1e9, granted_prb=6))
        assert strategy.prb == 6
        assert strategy.compression_ratio < 0.1

    def test_another_target_counts_at_once_and_what_was_learnt_stays(self):
        engine = self.engine(learn=False)
        # Near the bound between two schemes.
        view = replace(VIEW, snr_db=11.5)
        bold = engine.decide("x", view, DEMAND)
        engine.change(target_bler=1e-6, max_harq_retx=0)
        careful = engine.decide("x", view, DEMAND)
        assert careful.mcs < bold.mcs
        assert careful.max_harq_retx == 0
        new = engine.decide("y", view, DEMAND)
        assert new.mcs == careful.mcs
        with pytest.raises(ConfigError, match="target_bler"):
            engine.change(target_bler=0, max_harq_retx=0)

    def test_congestion_compresses(self):
        engine = self.engine(learn=False)
        calm = engine.decide("x", VIEW, DEMAND)
        for _ in range(12):
            engine.observe("x", VIEW)
        for _ in range(4):
            engine.observe("x", replace(VIEW, buffer_bytes=1e6, rtt_ms=300.0))
        tight = engine.decide("x", VIEW, DEMAND)
        assert tight.compression_ratio < calm.compression_ratio
        assert tight.priority == calm.priority - 1

    def test_nothing_is_learnt_from_what_nobody_applied(self):
        engine = self.engine()
        for _ in range(20):
            engine.decide("x", VIEW, DEMAND)
        assert "0 experiences" in engine.learning_status("x")
        for _ in range(20):
            engine.decide("x", VIEW, DEMAND)
            engine.applied("x")
        assert "19 experiences" in engine.learning_status("x")

    def test_a_link_without_radio_numbers(self):
        view = LinkView(None, None, None, 30.0, 0.0, None, 5e6)
        strategy = self.engine().decide("10.0.0.7", view, DEMAND)
        assert strategy.action == "EXPLOITING_PREVIOUS_STRATEGY"
        assert strategy.mcs == 0

    def test_a_search_changes_nothing_that_is_learnt(self):
        engine = self.engine()
        engine.decide("x", VIEW, DEMAND)
        link = engine._link("x")
        before = (link.pending, link.learner.episodes, len(link.scores))
        engine.applied("x")
        engine.search("x", VIEW, DEMAND, 29, 0.1)
        assert link.applied
        assert (link.pending, link.learner.episodes, len(link.scores)) == before

    def test_a_link_that_is_gone_is_forgotten(self):
        engine = self.engine()
        engine.decide("x", VIEW, DEMAND)
        engine.forget("x")
        engine.applied("x")
        assert engine.link_count() == 0

    def test_a_search_never_gets_worse(self):
        best, reward, trail = self.engine().search("x", VIEW, DEMAND, 29, 0.1)
        assert trail == sorted(trail)
        assert reward == trail[-1]
        assert block_error_rate(mcs_entry(TABLE, best.mcs), 12.0) <= 0.2


class TestRrmPolicy:
    def test_the_file(self, tmp_path: Path):
        path = tmp_path / "rrmPolicy_sub.json"
        actuator = RrmPolicyFile(path, 50)
        done = actuator.apply("4601", 0x4601, replace(STRATEGY, prb=20, priority=4))
        assert done.ok
        assert done.detail == "0x4601: priority 4, at least 40 %"
        policy = json.loads(path.read_text())
        assert policy["ueSliceMapping"]["0x4601"]["target_sub_slice"] == 4
        assert policy["subSlicePolicy"]["subSlices"][3]["min_ratio"] == 40
        assert [item.name for item in tmp_path.iterdir()] == [path.name]

    def test_shares_never_exceed_the_whole(self):
        policy = rrm_policy({1: (5, 80, 100), 2: (4, 80, 100), 3: (1, 40, 100)})
        shares = [sub["min_ratio"] for sub in policy["subSlicePolicy"]["subSlices"]]
        assert sum(shares) <= 100

    def test_a_device_that_is_gone_keeps_no_blocks(self, tmp_path: Path):
        path = tmp_path / "policy.json"
        actuator = RrmPolicyFile(path, 50)
        for rnti in (0x4601, 0x4602):
            actuator.apply("", rnti, replace(STRATEGY, prb=20, priority=4))
        assert json.loads(path.read_text())["subSlicePolicy"]["subSlices"][3]["min_ratio"] == 80
        actuator.forget(0x4601)
        path.unlink()
        actuator.apply("", 0x4602, replace(STRATEGY, prb=20, priority=4))
        policy = json.loads(path.read_text())
        assert policy["subSlicePolicy"]["subSlices"][3]["min_ratio"] == 40
        assert list(policy["ueSliceMapping"]) == ["0x4602"]

    def test_it_says_why_not(self, tmp_path: Path):
        actuator = RrmPolicyFile(tmp_path / "missing" / "file.json", 50)
        assert not actuator.apply("wlan0", None, STRATEGY).ok
        assert "cannot be written" in actuator.apply("4601", 0x4601, STRATEGY).detail


class TestLinearForecaster:
    def test_noise_about_a_mean_is_averaged(self):
        draw, forecaster = random.Random(1), LinearForecaster(5)
        forecasts = [forecaster.sample(10 + draw.gauss(0, 1)) for _ in range(2000)]
        assert max(abs(value - 10) for value in forecasts[500:]) < 0.8

    def test_a_walk_is_believed_where_it_is(self):
        draw, forecaster, at = random.Random(1), LinearForecaster(1), 0.0
        errors = []
        for _ in range(2000):
            at += draw.gauss(0, 1)
            errors.append(abs(forecaster.sample(at) - at))
        assert sum(errors[500:]) / 1500 < 0.5

    def test_it_corrects_a_base_and_no_further_than_a_deviation(self):
        draw, forecaster, errors = random.Random(1), LinearForecaster(1, 500.0), []
        level = 0.0
        for _ in range(3000):
            level = 0.9 * level + draw.gauss(0, 1)
            errors.append(abs(forecaster.sample(level, base=0.5 * level) - 0.9 * level))
        assert sum(errors[2000:]) / 1000 < 0.3

    def test_what_stands_beside_may_know(self):
        draw, errors, news = random.Random(1), [], 0.0
        knowing, blind = LinearForecaster(1, others=1), LinearForecaster(1)
        for _ in range(2000):
            value, news = news + draw.gauss(0, 0.1), draw.gauss(0, 1)
            errors.append((knowing.sample(value, others=(news,)) - news) ** 2)
            blind.sample(value)
        assert sum(errors[1000:]) / 1000 < 0.05
        assert knowing.deviation < 0.4 < 0.8 < blind.deviation

    def test_a_neighbour_that_never_spoke_changes_nothing(self):
        draw = random.Random(1)
        one, other = LinearForecaster(2, others=1), LinearForecaster(2)
        for _ in range(200):
            value = draw.gauss(5, 1)
            assert one.sample(value, others=(None,)) == pytest.approx(other.sample(value))
