"""The Radio Information Engine's algorithms."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from simple_ros.errors import ConfigError
from simple_ros.msg.wireless_ros_msgs import FieldQuality
from simple_ros_engines.modes import Intake, IntervalControl, Mode, mode_of
from simple_ros_engines.radio_information.anomalies import AnomalyKind, AnomalyWatch, SuddenChange
from simple_ros_engines.radio_information.core import RadioInformation
from simple_ros_engines.radio_information.history import Series, SessionBook
from simple_ros_engines.radio_information.interference import InterferenceWatch
from simple_ros_engines.radio_information.messages import (
    channel_state,
    phy_metrics,
    spectrum_analysis,
)
from simple_ros_engines.radio_information.prediction import Predictor, line_fit
from simple_ros_engines.radio_information.quality import (
    channel_capacity,
    channel_stability,
    link_quality,
    reliability,
    spectral_efficiency,
    transport_quality,
)
from simple_ros_engines.radio_information.record import (
    LinkRecord,
    Quality,
    link_id_of,
    parse_rnti,
    record,
)
from simple_ros_engines.radio_information.spectrum import (
    interference_over_noise_db,
    utilization,
    zones,
)
from simple_ros_engines.simulator.link import Disturbance, SimulatedLink

SECOND = 10**9


def made(at_s: float = 0.0, link: str = "4601", **values: float) -> LinkRecord:
    return record(link, round(at_s * SECOND), "test", values, rnti=0x4601)


class TestRecord:
    def test_what_no_radio_can_have_is_withheld(self):
        # A ratio in tenths of dB, an error rate in per cent, and what is no number.
        item = made(ul_snr_db=215.0, ul_bler=12.0, rsrp_dbm=math.nan, cqi=12)
        assert dict(item.values) == {"cqi": 12.0}
        assert sorted(item.suspects()) == ["rsrp_dbm", "ul_bler", "ul_snr_db"]
        assert item.quality_of("cqi") is Quality.MEASURED
        assert item.quality_of("ri") is Quality.MISSING

    def test_infinity_and_negative_counts(self):
        item = made(buffer_bytes=-1.0, dl_thr_bps=math.inf)
        assert not item.values

    def test_unknown_fields_are_a_mistake(self):
        with pytest.raises(ConfigError, match="'snr' is no field"):
            made(snr=3.0)

    def test_the_better_known_direction(self):
        up = made(ul_snr_db=10, ul_bler=0.1, ul_mcs=5, dl_sinr_db=20).side()
        assert (up.name, up.snr_db, up.bler, up.mcs) == ("ul", 10.0, 0.1, 5)
        down = made(dl_sinr_db=20, dl_bler=0.01, ul_bler=0.5).side()
        assert (down.name, down.bler) == ("dl", 0.01)

    @pytest.mark.parametrize(
        ("text", "rnti"),
        [("4601", 0x4601), ("0x4601", 0x4601), ("17921", 17921), (17921.0, 17921), ("00ff", 255),
         ("", None), ("0", None), ("zz", None), ("70000", None), (math.nan, None)],
    )  # fmt: skip
    def test_rnti(self, text, rnti):
        assert parse_rnti(text) == rnti

    def test_key(self):
        assert link_id_of(0xFF) == "00ff"

    def test_qualities_have_the_numbers_of_the_message(self):
        assert {item.name: item.value for item in Quality} == dict(FieldQuality.items())


class TestHistory:
    def test_a_series_keeps_the_newest_and_no_late_ones(self):
        series = Series(3)
        for at in (1, 2, 2, 3, 4):
            series.append(at, 10.0 * at)
        assert series.last(10) == [20.0, 30.0, 40.0]
        assert series.last(2) == [30.0, 40.0]

    def test_silence_begins_a_session(self):
        book = SessionBook(gap_s=60)
        first, began = book.take(made(0), 0.0)
        assert began
        second, began = book.take(made(61), 61.0)
        assert began
        assert second.number == 2
        assert list(book.ended) == [first]
        assert not first.is_active

    def test_an_rnti_that_was_given_away(self):
        """Counters start anew: another device."""
        book = SessionBook()
        book.take(made(0, dl_bytes_total=1e6), 0.0)
        book.take(made(1, dl_bytes_total=2e6), 1.0)
        session, began = book.take(made(2, dl_bytes_total=100), 2.0)
        assert (began, session.number) == (True, 2)
        assert len(session.records) == 1

    def test_late_records_are_left_out(self):
        book = SessionBook()
        book.take(made(10), 10.0)
        session, began = book.take(made(9), 11.0)
        assert not began
        assert session.stale == 1
        assert len(session.records) == 1

    def test_a_clock_that_was_set(self):
        book = SessionBook(gap_s=60)
        book.take(made(1000), 0.0)
        assert book.take(made(10), 0.1)[1]
        assert book.take(made(1e6), 0.2)[1]
        assert book.active()[0].number == 3

    def test_silent_links_are_marked_and_kept(self):
        book = SessionBook()
        book.take(made(5e8), 100.0)
        assert book.mark_inactive(104.0, 5.0) == []
        (session,) = book.mark_inactive(106.0, 5.0)
        assert session.link_id == "4601"
        assert book.active() == []
        assert book.take(made(5e8 + 7), 107.0)[0].is_active

    def test_by_how_much_a_counter_rose(self):
        book = SessionBook()
        book.take(made(0, ul_rbs_total=100), 0.0)
        session, _ = book.take(made(0.5, ul_rbs_total=600), 0.5)
        assert session.delta("ul_rbs_total") == (500.0, 0.5)
        assert session.delta("dl_rbs_total") is None


class TestQuality:
    def test_link_quality(self):
        assert link_quality([15.0], [0.1]) == pytest.approx(0.6 * 0.5 + 0.4 * 0.5)
        assert link_quality([45.0], [0.0]) == pytest.approx(1.0)
        assert link_quality([-5.0], [0.3]) == pytest.approx(0.0)
        assert link_quality([], []) == 0.5
        assert link_quality([15.0], []) == pytest.approx(0.5)

    def test_stability(self):
        assert channel_stability([10.0] * 9, [0.0] * 9) == 0.5
        assert channel_stability([10.0] * 10, [0.1] * 10) == 1.0
        assert channel_stability([0.0, 10.0] * 5, [0.0, 0.05] * 5) == pytest.approx(0.5)

    def test_reliability(self):
        assert reliability([0.1, 0.1]) == pytest.approx(0.5)
        assert reliability([0.5]) == 0.0
        assert reliability([]) == 0.5

    def test_efficiency_is_that_of_the_table_less_what_is_lost(self):
        """TS 38.214, table 5.1.3.1-1: MCS 28 carries 5.5547."""
        assert spectral_efficiency(28, 0.1, 2) == pytest.approx(5.5547 * 2 * 0.9, abs=1e-3)
        assert spectral_efficiency(31, 0.0) == pytest.approx(5.5547, abs=1e-3)
        assert spectral_efficiency(None, None) == 0.0

    def test_capacity(self):
        assert channel_capacity(0.0) == 1.0
        assert channel_capacity(10 * math.log10(15)) == pytest.approx(4.0)

    def test_links_without_radio(self):
        assert transport_quality(0.0, 20.0) == pytest.approx(0.913, abs=0.001)
        assert transport_quality(0.2, 20.0) == 0.0
        assert transport_quality(None, None) == 0.5


class TestPrediction:
    def test_lines(self):
        assert line_fit([0, 1, 2], [1, 3, 5], 3) == pytest.approx(7.0)
        assert line_fit([1, 1], [2, 4], 9) == 3.0

    def test_noise_is_averaged_and_confidence_is_earned(self):
        draw, predictor = random.Random(1), Predictor(1.0)
        first = predictor.sample(0.0, 20.0)
        assert (first.confidence, first.error) == (0.0, None)
        for index in range(1, 600):
            last = predictor.sample(0.1 * index, 20 + draw.gauss(0, 2))
        assert last.value == pytest.approx(20.0, abs=1.0)
        assert last.confidence > 0.85
        assert last.error == pytest.approx(1.6, abs=0.4)

    def test_bounds_hold(self):
        predictor = Predictor(1.0, least=1.0, most=50.0)
        values = [predictor.sample(0.1 * i, 10.0 - i).value for i in range(40)]
        assert min(values) == 1.0

    def test_logarithms_never_explode(self):
        predictor, draw = Predictor(1.0, least=1.0, logarithmic=True), random.Random(2)
        rtts = [draw.choice([20.0, 20.0, 20.0, 5000.0]) for _ in range(500)]
        forecasts = [predictor.sample(0.1 * i, rtt).value for i, rtt in enumerate(rtts)]
        assert 1.0 <= min(forecasts) <= max(forecasts) <= 5000.0

    def test_a_number_that_returns_to_its_mean_is_expected_there(self):
        draw, predictor, value = random.Random(3), Predictor(1.0), 0.0
        ours = newest = 0.0
        issued: list[tuple[float, float]] = []
        for index in range(3000):
            value = 0.8 * value + draw.gauss(0, 1)
            if index >= 1000:
                forecast, before = issued[-10]
                ours += abs(forecast - value)
                newest += abs(before - value)
            issued.append((predictor.sample(0.1 * index, value).value, value))
        # Knowing everything would leave sqrt(1 / (2 - 2 * 0.8**10)) = 0.75 of it.
        assert ours < 0.79 * newest

    def test_what_stands_beside_may_be_missing(self):
        predictor = Predictor(1.0, least=1.0, logarithmic=True, others=2)
        for index in range(300):
            beside = (20.0 + index % 3, None) if index % 2 else (None, None)
            last = predictor.sample(0.1 * index, 5.0 + index % 2, beside)
        assert 5.0 <= last.value <= 6.0

    def test_a_clock_set_back_is_no_mishap(self):
        predictor = Predictor(1.0)
        for at in (0.0, 0.1, 0.2, 100.0, 0.0, 0.1):
            assert math.isfinite(predictor.sample(at, 5.0).value)


class TestSpectrum:
    def session(self, *records: LinkRecord):
        book = SessionBook()
        for item in records:
            session, _ = book.take(item, item.stamp_ns / SECOND)
        return session

    def test_utilisation_of_blocks_in_use(self):
        session = self.session(made(prb_cell_used=25, prb_total=50, prb_used=5))
        assert utilization(session, 2000, 51) == 0.5

    def test_utilisation_of_counters_is_their_rise(self):
        session = self.session(made(0, dl_rbs_total=10**9), made(1, dl_rbs_total=10**9 + 51_000))
        assert utilization(session, 2000, 51) == pytest.approx(0.5)

    def test_unknown_utilisation(self):
        assert utilization(self.session(made(cqi=3)), 2000, 51) is None

    def test_interference_from_sinr(self):
        """Noise of 30 kHz at 7 dB: -173.8 + 7 + 44.8 = -122 dBm; SINR 10 at -90 dBm is 22 dB over it."""
        item = made(rsrp_dbm=-90.0, dl_sinr_db=10.0)
        assert interference_over_noise_db(item) == pytest.approx(22.0, abs=0.1)

    def test_interference_from_rsrq_of_an_empty_clean_cell_is_none(self):
        """Only reference signals on two of twelve subcarriers: RSRQ is 10 log10(1/2) = -3 dB."""
        clean = made(rsrp_dbm=-80.0, rsrq_db=-3.01, prb_cell_used=0, prb_total=51)
        assert interference_over_noise_db(clean) == pytest.approx(0.0, abs=0.5)
        dirty = made(rsrp_dbm=-80.0, rsrq_db=-12.0, prb_cell_used=0, prb_total=51)
        assert interference_over_noise_db(dirty) > 30

    def test_interference_unknown(self):
        assert interference_over_noise_db(made(rssi_dbm=-60)) is None

    def test_all_zone_rules_that_hold(self):
        bad = made(rsrp_dbm=-105, rssi_dbm=-65, ul_snr_db=3, ul_bler=0.2, ul_mcs=4)
        assert zones(bad) == (
            "HIGH_INTERFERENCE_ZONE",
            "SIGNAL_DEGRADATION_ZONE",
            "POOR_CHANNEL_ZONE",
        )
        assert zones(made(rsrp_dbm=-80, ul_snr_db=20)) == ()


class TestAnomalies:
    def test_a_drop_begins_and_ends_once(self):
        change = SuddenChange(5.0, falls=True)
        values = [20.0] * 10 + [12.0, 13.0, 12.0] + [19.0] * 5
        found = [change.sample(value) for value in values]
        assert found.index(True) == 10
        assert found.index(False) == 13
        assert sum(item is not None for item in found) == 2

    def test_half_the_way_back_is_not_the_end(self):
        change = SuddenChange(5.0, falls=True)
        found = [change.sample(value) for value in [20.0] * 10 + [12.0, 15.5, 16.9, 18.0]]
        assert found[-4:] == [True, None, None, False]

    def test_a_lively_link_is_not_abnormal(self):
        change, draw = SuddenChange(5.0, falls=True), random.Random(1)
        assert not any(change.sample(draw.gauss(20, 4)) for _ in range(300))

    def test_what_lasts_is_the_new_normal(self):
        change = SuddenChange(5.0, falls=True, lasting=10)
        found = [change.sample(value) for value in [20.0] * 10 + [10.0] * 30]
        assert found.index(False) == 19
        assert not change.is_abnormal

    def test_one_bad_sample_needs_confirmation(self):
        change = SuddenChange(5.0, falls=True, confirm=2)
        assert not any(change.sample(v) for v in [20.0] * 10 + [10.0] + [20.0] * 5)
        assert change.sample(10.0) is None
        assert change.sample(10.0) is True

    def test_every_kind_has_its_own_watch(self):
        watch = AnomalyWatch()
        for at in range(10):
            watch.sample(made(at, ul_snr_db=20, ul_bler=0.1, rtt_ms=20))
        began = [
            watch.sample(made(at, ul_snr_db=20, ul_bler=0.9, rtt_ms=90)) for at in (11, 12, 13)
        ]
        kinds = [[item.kind for item in items] for items in began]
        # Adaptation takes two samples to follow a fade: the third that loses blocks is abnormal.
        assert kinds == [[], [AnomalyKind.LATENCY_SPIKE], [AnomalyKind.BLER_SPIKE]]
        assert watch.present() == ("BLER_SPIKE", "LATENCY_SPIKE")


class TestInterference:
    def run(self, link: SimulatedLink, watch: InterferenceWatch, count: int, hidden_db: float):
        return [watch.sample(link.step(Disturbance(hidden_db=hidden_db))) for _ in range(count)]

    def test_hidden_interference_is_found_and_its_end_too(self):
        link, watch = SimulatedLink(np.random.default_rng(5)), InterferenceWatch()
        assert True not in self.run(link, watch, 600, 0.0)
        assert True in self.run(link, watch, 40, 8.0)
        assert False in self.run(link, watch, 100, 0.0)

    def test_nothing_is_said_without_numbers(self):
        assert InterferenceWatch().sample(made(rtt_ms=20)) is None


class TestCore:
    def test_findings_of_a_simulated_link(self):
        core, link = RadioInformation(), SimulatedLink(np.random.default_rng(1))
        for at in range(60):
            item = link.step()
            found = core.take(item, 0.1 * at)
        assert found is not None
        assert found.quality.from_radio
        assert 0 < found.quality.quality <= 1
        assert found.utilization is not None
        assert found.bandwidth is not None
        assert found.bandwidth.value > 1e5
        message = channel_state(item, found.session)
        assert message.rnti == 0x4601
        assert message.field_quality["pusch_snr"] == FieldQuality.SIMULATED
        assert message.dl_thr == 0.0
        assert "dl_thr" not in message.field_quality
        assert message.pusch_snr == pytest.approx(item.values["ul_snr_db"], rel=1e-5)
        assert phy_metrics(found).link_quality == pytest.approx(found.quality.quality, rel=1e-5)
        assert spectrum_analysis(found).utilization_known

    def test_half_a_record_is_judged_by_what_it_has(self):
        core = RadioInformation()
        found = core.take(made(1, ul_bler=math.nan, rtt_ms=30.0), 0.0)
        assert found is not None
        assert not found.quality.from_radio
        assert found.available_bps is None
        message = channel_state(found.record, 1)
        assert message.field_quality["ul_bler"] == FieldQuality.OUT_OF_RANGE

    def test_an_empty_record_stops_nothing(self):
        found = RadioInformation().take(made(1), 0.0)
        assert found is not None
        assert found.quality.quality == 0.5

    def test_records_that_come_late_are_counted(self):
        core = RadioInformation()
        core.take(made(5), 0.0)
        assert core.take(made(5), 0.1) is None
        assert core.stale == 1


class TestModes:
    def test_names(self):
        assert mode_of("burst") is Mode.BURST
        with pytest.raises(ConfigError, match="realtime, burst, optimized"):
            mode_of("fast")

    def test_realtime_is_at_once(self):
        assert Intake(Mode.REALTIME).offer("a", 1) == [1]

    def test_burst_waits_for_the_tick_and_drops_nothing(self):
        intake: Intake[int] = Intake(Mode.BURST)
        assert [intake.offer("a", i) for i in range(3)] == [[], [], []]
        assert intake.tick() == [0, 1, 2]
        assert intake.tick() == []

    def test_optimized_takes_the_most_urgent_and_starves_nobody(self):
        intake: Intake[int] = Intake(
            Mode.OPTIMIZED, priority=float, differs=lambda a, b: a != b, budget=1
        )
        taken = []
        for _ in range(60):
            intake.offer("high", 5)
            intake._taken.pop("high", None)
            intake.offer("low", 1)
            taken += intake.tick()
        assert 1 in taken
        assert taken.count(5) > taken.count(1)

    def test_optimized_skips_what_has_not_changed(self):
        intake: Intake[int] = Intake(Mode.OPTIMIZED, differs=lambda a, b: a != b)
        intake.offer("a", 1)
        assert intake.tick() == [1]
        intake.offer("a", 1)
        assert intake.tick() == []
        assert intake.skipped == 1

    def test_the_interval_follows_the_load(self):
        control = IntervalControl(0.1)
        assert control.worked(0.09) == pytest.approx(0.15)
        assert control.worked(0.01) == pytest.approx(0.1)
        assert control.worked(0.05) == pytest.approx(0.1)
