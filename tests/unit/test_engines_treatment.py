"""What the bridge does to data: treatments without flutter, budgets, JPEG; learning congestion and rates."""

from __future__ import annotations

import builtins
import io
import math
import random
from typing import Any

import numpy as np
import pytest

from simple_ros.errors import ConfigError
from simple_ros.msg.sensor_msgs import Image
from simple_ros_engines.cross_domain.flow_rules import FlowRules
from simple_ros_engines.cross_domain.jpeg import JPEG_STEPS, JpegLadder, Look, to_jpeg
from simple_ros_engines.cross_domain.treatment import (
    FlowBudget,
    Reluctant,
    Treatment,
    TreatmentJudge,
    fair_rates,
)
from simple_ros_engines.physical_adaptive.congestion import CongestionWatch
from simple_ros_engines.physical_adaptive.congestion_learning import CongestionLearner
from simple_ros_engines.physical_adaptive.core import (
    Demand,
    LinkView,
    PhysicalAdaptive,
    PhysicalSettings,
)

PIL = pytest.importorskip("PIL.Image")


def test_a_reluctant_number_falls_at_once_and_rises_to_the_least_wanted_meanwhile() -> None:
    number = Reluctant(10, 2.0)
    assert number.want(4, 0.0) == 4
    assert number.want(9, 1.0) == 4
    assert number.want(7, 2.0) == 4
    assert number.want(9, 3.0) == 7
    assert number.want(9, 4.0) == 7
    assert number.want(6, 5.0) == 6
    assert number.want(9, 6.0) == 6


def test_a_link_at_its_border_does_not_make_the_treatment_flutter() -> None:
    judge = TreatmentJudge(dwell_s=2.0)
    changes, before = 0, judge.treatment
    for step in range(600):
        now = judge.constraint(100 if step % 2 else 80, 30, step / 10)
        changes += now != before
        before = now
    assert changes == 1
    for step in range(600, 640):
        before = judge.constraint(100, 30, step / 10)
    assert before == Treatment()
    assert before.is_untouched


def test_a_strategy_makes_smaller_and_zero_says_nothing() -> None:
    judge = TreatmentJudge()
    assert judge.strategy(0.0, 0.0).is_untouched
    assert judge.strategy(0.4, 1.0) == Treatment(100.0, math.inf, pytest.approx(0.4))
    assert judge.strategy(0.01, 1.0).ratio == pytest.approx(0.05)


def test_a_budget_says_how_often_and_how_large() -> None:
    budget = FlowBudget()
    assert budget.rate_hz(30) == 30
    for step in range(50):
        budget.came(step / 20)
        budget.sent(50_000)
    budget.rate_bps = 4e6
    assert budget.rate_hz(30) == pytest.approx(10)
    assert budget.message_bytes(math.inf) == pytest.approx(25_000, rel=0.01)
    assert budget.message_bytes(10) == pytest.approx(50_000)
    budget.rate_bps = 1.0
    assert budget.rate_hz(30) == 1
    budget.rate_bps = 8e6
    assert budget.rate_hz(30) == 30
    assert budget.rate_hz(30, 100_000) == pytest.approx(10)


def test_what_is_there_is_divided_by_what_is_wanted() -> None:
    assert fair_rates(10.0, []) == []
    assert fair_rates(10.0, [math.inf, math.inf]) == [5, 5]
    assert fair_rates(10.0, [math.inf, 2.0]) == [8, 2]
    assert fair_rates(10.0, [4.0, 3.0]) == [4, 3]
    assert fair_rates(0.0, [math.inf, 3.0]) == [0, 0]


def camera_for(rules: FlowRules, begin_s: float, end_s: float, treatment: Treatment) -> list[Look]:
    """Pictures at 30 Hz whose sizes are as the ladder foretells; those that went out."""
    went = []
    for step in range(round(begin_s * 30), round(end_s * 30)):
        now_s = step / 30
        rules.came(900_000, now_s)
        look = rules.look(treatment, now_s)
        if rules.passes(treatment, now_s, rules.ladder.expected_bytes()):
            rules.sent(round(rules.ladder.expected_bytes() or 130_000), look)
            went.append(look)
    return went


FAIR = Treatment(scale=70.0, rate_hz=20.0, ratio=1.0)


def test_without_a_budget_the_constraints_frame_rate_holds() -> None:
    rules = FlowRules()
    assert len(camera_for(rules, 0.0, 3.0, FAIR)) <= 60


def test_with_a_budget_bytes_are_given_up_before_pictures() -> None:
    rules = FlowRules()
    rules.strategy(60e6, 1.0, 0.0)
    assert len(camera_for(rules, 0.0, 3.0, FAIR)) == 90
    rules.strategy(2e6, 1.0, 3.0)
    went = camera_for(rules, 3.0, 6.0, FAIR)
    assert len(went) == 90
    assert {look.quality for look in went} == {25}
    # So little that no picture is small enough: then fewer of them, but some.
    rules.strategy(1e5, 1.0, 6.0)
    camera_for(rules, 6.0, 8.0, FAIR)
    assert 3 <= len(camera_for(rules, 8.0, 11.0, FAIR)) < 30
    rules.strategy(60e6, 1.0, 11.0)
    assert camera_for(rules, 11.0, 14.0, FAIR)[-1] == Look(70.0, 95)


def test_a_short_fade_costs_no_pictures() -> None:
    rules = FlowRules()
    rules.strategy(10e6, 1.0, 0.0)
    camera_for(rules, 0.0, 3.0, FAIR)
    rules.strategy(0.0, 1.0, 3.0)
    assert len(camera_for(rules, 3.0, 3.2, FAIR)) == 6
    assert len(camera_for(rules, 3.2, 6.2, FAIR)) < 30


def test_clouds_are_thinned_to_what_fits_and_learn_how_far_off_that_was() -> None:
    rules = FlowRules(dwell_s=2.0)
    rules.strategy(4e6, 1.0, 0.0)
    whole = Treatment()
    kept = 0
    for step in range(100):
        now_s = step / 10
        rules.came(100_000, now_s)
        share = rules.cloud_share(whole, 100_000, now_s)
        # Twice as much is left as was asked for.
        kept = int(min(1.0, 2 * share) * 100_000)
        rules.thinned(share, 100_000, kept)
        rules.sent(kept)
    assert kept == pytest.approx(50_000, rel=0.02)
    assert rules.cloud_bytes(share, 100_000) == pytest.approx(kept, rel=0.02)
    assert rules.wanted_bps(as_jpeg=False) == pytest.approx(1.1 * 8e6, rel=0.02)
    assert math.isinf(rules.wanted_bps(as_jpeg=True))
    rules.strategy(20e6, 1.0, 10.0)
    assert rules.cloud_share(whole, 100_000, 10.0) < 1
    assert rules.cloud_share(whole, 100_000, 12.1) == 1
    assert rules.cloud_share(FAIR, 100_000, 12.2) == pytest.approx(0.49)


def test_a_picture_as_it_came_must_fit() -> None:
    rules = FlowRules(dwell_s=1.0)
    for step in range(30):
        rules.came(900_000, step / 30)
    assert rules.fits_as_it_came(900_000, 1.0)
    rules.strategy(20e6, 1.0, 1.0)
    assert not rules.fits_as_it_came(900_000, 1.1)
    rules.strategy(1e9, 1.0, 1.2)
    assert not rules.fits_as_it_came(900_000, 1.2)
    assert rules.fits_as_it_came(900_000, 2.3)


def picture(encoding: str, channels: int, padding: int = 0) -> Image:
    rows, columns = np.mgrid[0:48, 0:64]
    pixels = np.zeros((48, 64 * channels + padding), np.uint8)
    values = np.stack([columns * 3, rows * 5, 255 - columns * 3, np.full_like(rows, 255)], -1)
    pixels[:, : 64 * channels] = values[:, :, :channels].reshape(48, -1)
    return Image(
        height=48, width=64, encoding=encoding, step=pixels.shape[1], data=pixels.tobytes()
    )


@pytest.mark.parametrize(
    ("encoding", "channels", "red_blue"),
    [("rgb8", 3, (0, 2)), ("bgr8", 3, (2, 0)), ("rgba8", 4, (0, 2)), ("bgra8", 4, (2, 0))],
)
def test_pictures_keep_their_colours_in_jpeg(
    encoding: str, channels: int, red_blue: tuple[int, int]
) -> None:
    image = picture(encoding, channels, padding=5)
    image.header.frame_id = "camera"
    found = to_jpeg(image, 100, 95)
    assert found is not None
    assert (found.format, found.header.frame_id) == ("jpeg", "camera")
    pixels = np.asarray(PIL.open(io.BytesIO(found.data)))
    assert pixels.shape == (48, 64, 3)
    raw = np.frombuffer(image.data, np.uint8).reshape(48, -1)[:, : 64 * channels]
    values = raw.reshape(48, 64, channels)
    wanted = np.stack([values[..., red_blue[0]], values[..., 1], values[..., red_blue[1]]], -1)
    assert np.abs(pixels.astype(int) - wanted.astype(int)).mean() < 6


def test_mono_pictures_scale_and_quality() -> None:
    image = picture("mono8", 1)
    fine, coarse = to_jpeg(image, 100, 95), to_jpeg(image, 50, 25)
    assert fine is not None
    assert coarse is not None
    assert PIL.open(io.BytesIO(coarse.data)).size == (32, 24)
    assert len(coarse.data) < len(fine.data) < len(image.data)


@pytest.mark.parametrize(
    "image",
    [
        picture("16UC1", 2),
        Image(height=4, width=4, encoding="rgb8", step=12, data=b"short"),
        Image(height=4, width=4, encoding="rgb8", step=4, data=bytes(16)),
        Image(encoding="rgb8"),
    ],
)
def test_what_jpeg_does_not_know_is_none(image: Image) -> None:
    assert to_jpeg(image, 100, 90) is None


def test_without_pillow_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    known = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("PIL"):
            raise ImportError(name)
        return known(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ConfigError, match=r"simple-ros\[camera\]"):
        to_jpeg(picture("rgb8", 3), 100, 90)


def test_the_quality_follows_the_ratio_in_steps_and_the_size_in_further_ones() -> None:
    ladder = JpegLadder(dwell_s=2.0)
    assert ladder.quality == JPEG_STEPS[0]
    assert ladder.want(0.5, 0.0) == 55
    assert ladder.want(1.0, 1.0) == 55
    ladder.produced(60_000, 50_000)
    # 60 kB at 55 are foretold to be 52 kB at 45 and 44 kB at 35: the first step that fits is taken at once.
    assert ladder.quality == 35
    assert ladder.want(0.5, 1.5) == 35
    ladder.produced(20_000, 50_000)
    assert ladder.quality == 35
    assert ladder.want(1.0, 3.4) == 35
    ladder.produced(20_000, 50_000)
    assert ladder.want(1.0, 3.6) == 35
    ladder.produced(20_000, 60_000)
    # Of the size 75 would do; the ratio of 0.5 was wanted less than 2 s ago.
    assert ladder.quality == 55
    for _ in range(20):
        ladder.produced(2, 1)
    assert ladder.quality == JPEG_STEPS[-1]


def shown(look: Look) -> tuple[float, int]:
    return round(look.scale), look.quality


def test_pictures_give_up_quality_first_then_pixels() -> None:
    ladder = JpegLadder(dwell_s=2.0)
    assert shown(ladder.look(100.0, math.inf, 0.0)) == (100, 95)
    assert ladder.expected_bytes() is None
    ladder.produced(100_000, math.inf)
    for budget, expected in (
        (100_000, (100, 95)),
        (40_000, (100, 75)),
        (14_500, (100, 25)),
        (10_000, (70, 25)),
        (5_500, (50, 25)),
        (1, (30, 25)),
    ):
        assert shown(ladder.look(100.0, budget, 0.1)) == expected
    assert shown(ladder.look(50.0, 1, 0.2)) == (30, 25)
    assert shown(ladder.look(20.0, 1, 0.2)) == (20, 25)
    # Better comes after the dwell, in one step.
    assert shown(ladder.look(100.0, math.inf, 1.0)) == (30, 25)
    assert shown(ladder.look(100.0, math.inf, 2.9)) == (30, 25)
    assert shown(ladder.look(100.0, math.inf, 3.0)) == (100, 95)


def test_the_ladder_learns_how_large_its_pictures_are() -> None:
    """Pictures that hardly shrink with quality: foretold too small at first, then not."""
    sizes = dict(zip(JPEG_STEPS, (100, 90, 80, 70, 60, 50, 40, 30), strict=True))
    ladder = JpegLadder(dwell_s=0.0)
    off = []
    for turn in range(40):
        look = ladder.look(100.0, 1e5 if turn % 2 else 60.0, float(turn))
        expected = ladder.expected_bytes()
        if expected is not None and not turn % 2:
            off.append(abs(expected / sizes[look.quality] - 1))
        ladder.produced(sizes[look.quality], 1e5)
    assert off[-1] < 0.1 < off[0]


def bursts(seed: int, count: int) -> list[tuple[float, float]]:
    """A link that congests now and then; what comes before is too little for fixed thresholds."""
    generator = random.Random(seed)
    trace: list[tuple[float, float]] = []
    while len(trace) < count:
        for _ in range(generator.randint(60, 160)):
            trace.append((generator.uniform(0, 2000), 20 + generator.uniform(0, 3)))
        for step in range(7):
            trace.append((2200 + 250 * step, 22 + step + generator.uniform(0, 1)))
        for _ in range(25):
            trace.append((60_000 + generator.uniform(0, 9000), generator.uniform(80, 120)))
    return trace


def warnings(trace: list[tuple[float, float]], flags: list[bool]) -> tuple[int, int, int]:
    """Congestion foreseen before it came, congestion in all, false warnings in calm."""
    foreseen = total = false = 0
    for index in range(11, len(trace)):
        begins = trace[index][1] > 50 and trace[index - 1][1] <= 50
        if begins:
            total += 1
            foreseen += any(flags[index - 6 : index])
    for index, flag in enumerate(flags):
        ahead = trace[index : index + 12]
        false += flag and trace[index][1] <= 50 and not any(rtt > 50 for _, rtt in ahead)
    return foreseen, total, false


def test_congestion_that_announces_itself_is_learnt_and_foreseen() -> None:
    results = []
    for seed in range(5):
        trace = bursts(seed, 12_000)
        learner, watch = CongestionLearner(), CongestionWatch()
        flags = [learner.sample(*item) for item in trace]
        plain = [watch.sample(*item) for item in trace]
        half = len(trace) // 2
        results.append((warnings(trace[half:], flags[half:]), warnings(trace[half:], plain[half:])))
    for (foreseen, total, false), (plain_foreseen, _, _) in results:
        assert foreseen >= 0.9 * total
        assert false <= 0.03 * 6000
        assert plain_foreseen == 0


def test_a_link_that_never_congested_is_never_suspected() -> None:
    learner = CongestionLearner()
    generator = random.Random(1)
    assert not any(
        learner.sample(generator.uniform(0, 9000), generator.uniform(20, 30)) for _ in range(3000)
    )
    assert learner.positives == 0
    assert learner.probability == 0
    assert not learner.sample(None, 20.0)


@pytest.mark.parametrize(("bler", "carried", "expected"), [(0.0, 30e6, 0.08), (0.5, 1e3, 0.12)])
def test_the_learning_rate_follows_the_rewards_if_asked(
    bler: float, carried: float, expected: float
) -> None:
    core = PhysicalAdaptive(PhysicalSettings(), random.Random(0))
    demand = Demand("STANDARD", 5e6, 0.5)
    view = LinkView(20.0, bler, 20 if not bler else 1, 20.0, 1e6 if bler else 0.0, carried, 30e6)
    for _ in range(150):
        core.decide("a", view, demand)
        core.applied("a")
    core.review()
    assert core._link("a").learner.settings.learning_rate == pytest.approx(expected)


def test_while_nothing_waits_no_stronger_compression_is_tried() -> None:
    """It would bring nothing, and cost quality; a large message that was just handed over is no queue."""
    core = PhysicalAdaptive(PhysicalSettings(), random.Random(0))
    demand = Demand("HIGH_QUALITY", 20e6, 0.5)
    for step in range(600):
        burst = 160_000.0 if step % 2 else 0.0
        view = LinkView(30.0, 0.0, 28, 35.0 if step % 2 else 20.0, burst, 10e6, 80e6)
        assert not core.observe("a", view)
        assert core.decide("a", view, demand).compression_ratio == 1
        core.applied("a")
