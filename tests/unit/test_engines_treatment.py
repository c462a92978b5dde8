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
from simple_ros_engines.cross_domain.jpeg import JPEG_STEPS, JpegLadder, to_jpeg
from simple_ros_engines.cross_domain.treatment import (
    FlowBudget,
    Reluctant,
    Treatment,
    TreatmentJudge,
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
    ladder.produced(60_000, 40_000)
    assert ladder.quality == 45
    ladder.produced(30_000, 40_000)
    assert ladder.quality == 45
    ladder.produced(10_000, 40_000)
    assert ladder.quality == 55
    assert ladder.want(1.0, 3.5) == 95
    for _ in range(20):
        ladder.produced(2, 1)
    assert ladder.quality == JPEG_STEPS[-1]


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
