"""The Cross Domain Engine's algorithms."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from simple_ros.errors import ConfigError
from simple_ros.msg.sensor_msgs import Image, PointCloud2, PointField
from simple_ros_engines.cross_domain.adaptation import RateGate, scaled, voxels
from simple_ros_engines.cross_domain.constraints import (
    LEVELS,
    LevelJudge,
    TaskCriticality,
    constrain,
    network_score,
)
from simple_ros_engines.cross_domain.core import CrossDomain, LinkMetrics
from simple_ros_engines.cross_domain.mappings import (
    convert_network_metrics_to_control_limits,
    map_task_priority_to_qos,
    translate_constraints_to_nav_params,
)
from simple_ros_engines.cross_domain.path import (
    PathWeights,
    analyze_path,
    plan,
    plan_between,
)
from simple_ros_engines.cross_domain.quality_map import GridFrame, QualityMap, enhanced_cells
from simple_ros_engines.cross_domain.sensing import (
    CompressionJudge,
    SensorModeJudge,
    compression_target,
    jpeg_quality,
    voxel_leaf_m,
)
from simple_ros_engines.physical_adaptive.strategy import RECOMMENDATIONS, STRATEGY_TYPES
from simple_ros_engines.simulator.coverage import CoverageSettings, random_map

SHORTEST = PathWeights(0.0, 0.0)


class TestGrid:
    def test_a_place_just_outside_is_outside(self):
        """int() would truncate -0.01 to cell 0."""
        frame = GridFrame(10, 10, 0.5)
        assert frame.cell(-0.01, 1.0) is None
        assert frame.cell(1.0, -0.01) is None
        assert frame.cell(0.0, 0.0) == (0, 0)
        assert frame.cell(4.99, 4.99) == (9, 9)
        assert frame.cell(5.0, 1.0) is None

    def test_a_turned_map(self):
        frame = GridFrame(10, 4, 1.0, origin_x_m=2.0, origin_y_m=1.0, yaw_rad=math.pi / 2)
        assert frame.cell(1.5, 4.5) == (3, 0)
        for cell in ((0, 0), (9, 3), (4, 2)):
            assert frame.cell(*frame.centre(*cell)) == cell

    def test_a_map_without_cells_is_refused(self):
        with pytest.raises(ConfigError):
            GridFrame(0, 5, 0.1)
        with pytest.raises(ConfigError):
            GridFrame(5, 5, math.nan)


class TestQualityMap:
    def test_the_first_sample_sets_and_later_ones_move_by_three_tenths(self):
        grid = QualityMap(GridFrame(4, 4, 1.0))
        assert grid.at(1.5, 1.5) is None
        grid.update(1.5, 1.5, 0.8, now_s=10.0)
        assert grid.at(1.5, 1.5) == 0.8
        grid.update(1.5, 1.5, 0.4, now_s=12.0)
        assert grid.at(1.5, 1.5) == pytest.approx(0.3 * 0.4 + 0.7 * 0.8)
        assert grid.count[1, 1] == 2
        assert grid.age_s(1.5, 1.5, 15.0) == 3.0
        assert grid.variance[1, 1] > 0
        assert not grid.update(9.0, 1.0, 0.5, 0.0)

    def test_a_grown_map_keeps_what_is_known(self):
        grid = QualityMap(GridFrame(4, 4, 1.0))
        grid.update(1.5, 2.5, 0.7, 1.0)
        grown = grid.moved(GridFrame(10, 10, 1.0, -3.0, -3.0))
        assert grown.at(1.5, 2.5) == 0.7
        assert grown.known_cells() == 1

    def test_a_visited_good_place_is_cheaper_than_an_unknown_one(self):
        cells = np.array([[0, 0, 0, 100, -1, 30]], np.int8)
        quality = np.array([[1.0, -1.0, 0.0, 0.5, 0.5, 0.5]])
        assert enhanced_cells(cells, quality).tolist() == [[0, 24, 49, 100, -1, 30]]


class TestPath:
    def grid(self, size: int = 20) -> QualityMap:
        grid = QualityMap(GridFrame(size, size, 1.0))
        grid.quality[:] = 0.9
        return grid

    def test_straight_through_the_open(self):
        cells = np.zeros((20, 20), np.int8)
        way = plan(cells, self.grid().quality, (0, 5), (10, 5))
        assert way == [(column, 5) for column in range(11)]

    def test_obstacles_and_their_corners_are_kept_clear_of(self):
        cells = np.zeros((3, 3), np.int8)
        cells[1, 1] = 100
        way = plan(cells, np.ones((3, 3)), (0, 1), (2, 1), SHORTEST)
        assert way is not None
        assert len(way) == 5
        cells[:, 1] = 100
        assert plan(cells, np.ones((3, 3)), (0, 1), (2, 1)) is None
        assert plan(cells, np.ones((3, 3)), (1, 1), (2, 1)) is None
        assert plan(cells, np.ones((3, 3)), (0, 0), (7, 1)) is None

    def test_the_shortest_way_has_the_length_of_an_exhaustive_search(self):
        """Against Bellman and Ford on the same steps."""
        cells, _, start, goal = random_map(
            np.random.default_rng(4), CoverageSettings(size=60, obstacles=9)
        )
        way = plan(cells, np.ones((60, 60)), start, goal, SHORTEST)
        assert way is not None
        length = sum(math.dist(a, b) for a, b in pairwise(way))
        cost = np.full((62, 62), np.inf)
        free = np.zeros((62, 62), bool)
        free[1:-1, 1:-1] = cells < 65
        cost[start[1] + 1, start[0] + 1] = 0.0
        for _ in range(200):
            for dy in (-1, 0, 1):
                for dx in (-1, 0, 1):
                    moved = np.roll(cost, (dy, dx), (0, 1)) + math.hypot(dx, dy)
                    beside = np.roll(free, dy, 0) & np.roll(free, dx, 1)
                    open_ = free & (beside if dx and dy else True)
                    cost = np.where(open_ & (moved < cost), moved, cost)
        assert length == pytest.approx(cost[goal[1] + 1, goal[0] + 1])

    def test_a_dead_zone_is_gone_round(self):
        grid, cells = self.grid(), np.zeros((20, 20), np.int8)
        grid.quality[6:14, 8:12] = 0.05
        short = plan_between(cells, grid, (1.5, 10.5), (18.5, 10.5), SHORTEST)
        ours = plan_between(cells, grid, (1.5, 10.5), (18.5, 10.5))
        assert short is not None
        assert ours is not None
        before, after = analyze_path(short, grid), analyze_path(ours, grid)
        assert before.dead_zone_m == pytest.approx(4.0, abs=0.5)
        assert after.dead_zone_m == 0.0
        assert after.minimum == 0.9
        assert after.length_m < 1.25 * before.length_m
        assert ours[0] == (1.5, 10.5)
        assert ours[-1] == (18.5, 10.5)

    def test_unknown_and_outside_count_half(self):
        found = analyze_path([(-3.0, 5.0), (3.0, 5.0)], QualityMap(GridFrame(10, 10, 1.0)))
        assert (found.mean, found.minimum, found.unknown_m) == (0.5, 0.5, pytest.approx(6.0))
        assert analyze_path([(1.0, 1.0)], self.grid()).minimum == 0.9


class TestConstraints:
    def limits(self, level="FAIR", reliability=0.9, criticality=0.5, **more):
        return constrain(
            level,
            bandwidth_bps=10e6,
            latency_ms=20.0,
            reliability=reliability,
            criticality=criticality,
            **more,
        )

    def test_templates(self):
        best, worst = self.limits("EXCELLENT"), self.limits("BAD")
        assert (best.max_rate_bps, best.min_quality, best.frame_rate) == (10e6, 90, 30)
        assert best.kind == "HIGH_QUALITY"
        assert (worst.max_rate_bps, worst.min_quality, worst.frame_rate) == (2e6, 30, 10)
        assert worst.drop_non_essential
        assert worst.expected_latency_ms == 60.0

    def test_a_critical_task_keeps_its_data_whatever_the_link(self):
        limits = self.limits("BAD", reliability=0.1, criticality=0.9)
        assert limits.kind == "CRITICAL_MINIMUM"
        assert not limits.drop_non_essential
        assert limits.min_quality == 40
        assert limits.frame_rate == 5

    def test_an_ordinary_task_on_an_unreliable_link(self):
        limits = self.limits("FAIR", reliability=0.1)
        assert limits.kind == "EMERGENCY_BALANCED"
        assert limits.drop_non_essential
        assert limits.frame_rate == 10

    def test_the_task_says_what_latency_it_needs(self):
        assert self.limits(deadline_ms=50.0).max_latency_ms == 50.0
        assert self.limits().max_latency_ms == self.limits().expected_latency_ms == 30.0

    def test_every_type_has_a_strategy(self):
        kinds = {
            self.limits(level, reliability, criticality).kind
            for level in LEVELS
            for reliability in (0.1, 0.9)
            for criticality in (0.5, 0.9)
        }
        assert kinds == set(STRATEGY_TYPES)
        assert set(RECOMMENDATIONS) == set(LEVELS)

    def test_levels_fall_at_once_and_rise_with_a_margin(self):
        judge = LevelJudge(0.03)
        scores = [0.85, 0.79, 0.81, 0.82, 0.84, 0.1]
        found = [judge.judge(score) for score in scores]
        assert found == ["EXCELLENT", "GOOD", "GOOD", "GOOD", "EXCELLENT", "BAD"]
        assert network_score(1.0, 0.5) == pytest.approx(0.8)

    def test_criticality(self):
        task = TaskCriticality()
        assert task.value == 0.5
        task.status("critical")
        assert task.value == 0.9
        for _ in range(3):
            task.level("POOR")
        assert task.value == 1.0
        task.status("sleeping")
        assert task.value == pytest.approx(0.12)


class TestSensing:
    @pytest.mark.parametrize(
        ("level", "mbps", "criticality", "mode"),
        [("GOOD", 11, 0.5, "HIGH_RESOLUTION"), ("EXCELLENT", 10, 0.5, "STANDARD"),
         ("FAIR", 6, 0.5, "STANDARD"), ("FAIR", 5, 0.5, "REDUCED"), ("BAD", 3, 0.5, "REDUCED"),
         ("POOR", 1, 0.5, "MINIMAL"), ("FAIR", 5, 0.9, "STANDARD"), ("BAD", 1.5, 0.9, "REDUCED"),
         ("BAD", 0.5, 0.9, "MINIMAL")],
    )  # fmt: skip
    def test_modes(self, level, mbps, criticality, mode):
        assert SensorModeJudge().judge(level, mbps * 1e6, criticality) == mode

    def test_modes_do_not_flutter(self):
        judge = SensorModeJudge(0.15)
        rates = [11e6, 9.9e6, 10.1e6, 11.4e6, 11.6e6]
        modes = [judge.judge("GOOD", rate, 0.5) for rate in rates]
        assert modes == ["HIGH_RESOLUTION", *["STANDARD"] * 3, "HIGH_RESOLUTION"]

    def test_compression(self):
        judge = CompressionJudge()
        assert judge.judge(11e6, 0.85, 0.5) == 0.0
        assert judge.judge(6e6, 0.7, 0.5) == 0.3
        assert judge.judge(3e6, 0.5, 0.9) == pytest.approx(0.4)
        assert judge.judge(0.0, 0.0, 0.5) == 0.9
        assert judge.judge(2.1e6, 0.42, 0.5) == 0.9
        assert judge.judge(2.3e6, 0.45, 0.5) == 0.6

    def test_what_a_level_means(self):
        assert compression_target(0.3) == pytest.approx(0.7)
        assert compression_target(1.0) == 0.05
        assert (jpeg_quality(1.0), jpeg_quality(0.05)) == (95, 30)
        assert voxel_leaf_m(1.0) == 0.0
        assert voxel_leaf_m(0.25, 0.05) == pytest.approx(0.1)


class TestMappings:
    def test_navigation_is_slower_on_a_slow_link(self):
        near = constrain(
            "EXCELLENT", bandwidth_bps=1e7, latency_ms=20, reliability=1, criticality=0
        )
        far = constrain("BAD", bandwidth_bps=1e6, latency_ms=200, reliability=1, criticality=0)
        fast, slow = map(translate_constraints_to_nav_params, (near, far))
        assert fast.max_vel_mps == pytest.approx(1.5 * 0.2 / 0.22)
        assert slow.max_vel_mps == pytest.approx(1.5 * 0.2 / 0.8)
        assert slow.inflation_radius_m > fast.inflation_radius_m
        assert slow.comm_cost_weight > fast.comm_cost_weight
        assert slow.planner_frequency_hz < fast.planner_frequency_hz

    def test_priorities(self):
        """Expedited forwarding is DSCP 46 (RFC 3246)."""
        assert map_task_priority_to_qos(5).dscp == 46
        deadlines = [map_task_priority_to_qos(priority).deadline_s for priority in range(1, 6)]
        assert deadlines == sorted(deadlines, reverse=True)
        with pytest.raises(ConfigError, match=r"1\.\.5"):
            map_task_priority_to_qos(6)

    def test_control_limits(self):
        limits = convert_network_metrics_to_control_limits(100.0, reaction_s=0.2)
        assert limits.max_speed_mps == pytest.approx(0.8 / 0.3)
        assert limits.max_rate_hz == pytest.approx(5.0)
        assert limits.hold_timeout_s == pytest.approx(0.3)
        lossy = convert_network_metrics_to_control_limits(100.0, 0.5)
        assert lossy.max_speed_mps < limits.max_speed_mps


class TestCore:
    def test_links_are_judged_apart(self):
        core = CrossDomain()
        good = core.decide(LinkMetrics("a", 0.95, 1.0, 10.0, 20e6))
        bad = core.decide(LinkMetrics("b", 0.05, 0.0, 300.0, 0.3e6))
        assert (good.level, bad.level) == ("EXCELLENT", "BAD")
        assert good.sensor_mode == "HIGH_RESOLUTION"
        assert bad.compression == 0.9
        assert core.link_count() == 2

    def test_what_is_unknown_is_taken_carefully(self):
        decision = CrossDomain().decide(LinkMetrics("a", 0.5, 0.5, None, None))
        assert decision.limits.max_rate_bps <= 1e5
        assert decision.sensor_mode == "REDUCED"


def cloud(points: list[tuple[float, float, float, float]]) -> PointCloud2:
    names = ("x", "y", "z", "intensity")
    fields = [
        PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate(names)
    ]
    data = np.array(points, "<f4").tobytes()
    return PointCloud2(
        height=1, width=len(points), fields=fields, point_step=16, row_step=len(data), data=data
    )


class TestAdaptation:
    def test_a_gate_lets_through_evenly(self):
        gate = RateGate(10.0)
        passed = [at for at in range(300) if gate.passes(at / 30)]
        assert len(passed) == 100
        assert set(np.diff(passed)) == {3}
        assert all(RateGate().passes(0.0) for _ in range(3))

    def test_a_picture_with_padded_rows(self):
        rows = np.arange(4 * 8, dtype=np.uint8).reshape(4, 8)
        image = Image(height=4, width=6, encoding="mono8", step=8, data=rows.tobytes())
        smaller = scaled(image, 50)
        assert smaller is not None
        assert (smaller.height, smaller.width, smaller.step) == (2, 3, 3)
        assert list(smaller.data) == [0, 2, 4, 16, 18, 20]

    def test_pictures_that_cannot_be_scaled(self):
        assert scaled(Image(height=4, width=6, encoding="mono8", step=6, data=bytes(5)), 50) is None
        bayer = Image(height=2, width=2, encoding="bayer_rggb8", step=2, data=bytes(4))
        assert scaled(bayer, 50) is None
        assert scaled(Image(), 50) is None

    def test_one_point_of_each_voxel_with_all_its_fields(self):
        found = voxels(
            cloud([(0.01, 0, 0, 1), (0.02, 0, 0, 2), (math.nan, 0, 0, 3), (-0.01, 0, 0, 4)]), 0.1
        )
        assert found is not None
        points = np.frombuffer(found.data, "<f4").reshape(-1, 4)
        assert points[:, 3].tolist() == [1.0, 4.0]
        assert found.width == 2
        assert found.row_step == 32

    def test_clouds_that_cannot_be_thinned(self):
        assert voxels(PointCloud2(), 0.1) is None
        broken = cloud([(0, 0, 0, 0)])
        broken.row_step = 3
        assert voxels(broken, 0.1) is None
