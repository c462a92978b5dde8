"""How the engines watch sources, sequences and their own times."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.wireless_ros_msgs import ChannelState, FieldQuality
from simple_ros_engines.flow import SequenceWatch
from simple_ros_engines.histogram import BOUNDS_MS, Histogram
from simple_ros_engines.modes import Intake, Mode
from simple_ros_engines.radio_information.core import RadioInformation, RadioSettings
from simple_ros_engines.radio_information.health import SourceHealth
from simple_ros_engines.radio_information.history import (
    Beginning,
    Filling,
    Series,
    SessionBook,
)
from simple_ros_engines.radio_information.messages import (
    channel_state,
    spectrum_analysis,
    zone_text,
)
from simple_ros_engines.radio_information.observers import Observers
from simple_ros_engines.radio_information.record import FIELDS, LinkRecord, record

SECOND = 10**9


def made(time_s: float = 0.0, link: str = "4601", **values: float) -> LinkRecord:
    return record(link, round(time_s * SECOND), "test", values)


class TestSequences:
    def came(self, *numbers: int, stamps: list[int] | None = None) -> SequenceWatch:
        watch = SequenceWatch()
        for index, number in enumerate(numbers):
            watch.came(number, stamps[index] if stamps else number)
        return watch

    def test_all_there(self):
        watch = self.came(5, 6, 7)
        assert (watch.received, watch.gaps, watch.duplicates) == (3, 0, 0)

    def test_gaps_and_what_comes_late_after_all(self):
        watch = self.came(0, 1, 4, 3)
        assert (watch.gaps, watch.late, watch.duplicates) == (1, 1, 0)

    def test_the_same_again_is_no_new_message(self):
        watch = self.came(0, 1)
        assert not watch.came(1, 1)
        assert not watch.came(0, 0)
        assert (watch.received, watch.duplicates) == (4, 2)

    def test_numbers_start_anew_after_the_largest(self):
        watch = self.came(2**32 - 1, 0, 2)
        assert (watch.gaps, watch.restarts) == (1, 0)

    def test_a_publisher_that_began_again_is_no_duplicate(self):
        """Its first messages may not have reached us: the numbers were all seen before, the stamps not."""
        watch = self.came(*range(100))
        assert all(watch.came(number, 1000 + number) for number in range(30, 40))
        assert (watch.duplicates, watch.gaps, watch.restarts) == (0, 0, 1)

    @given(st.lists(st.integers(0, 2**32 - 1), max_size=60))
    def test_counts_add_up_whatever_comes(self, numbers):
        watch = SequenceWatch()
        new = sum(watch.came(number, number) for number in numbers)
        assert watch.received == len(numbers) == new + watch.duplicates
        assert watch.gaps >= 0

    def test_memory_is_bounded(self):
        watch = self.came(0, 2**31 - 1)
        assert watch.gaps == 2**31 - 2
        assert len(watch._missing) <= 512


class TestHistogram:
    def test_nothing(self):
        assert (Histogram().mean_ms(), Histogram().quantile_ms(0.99)) == (0, 0)

    def test_quantiles_lie_between_the_bounds_they_fall_into(self):
        histogram = Histogram()
        for step in range(1, 101):
            histogram.add(step / 10)
        assert histogram.mean_ms() == pytest.approx(5.05)
        assert 4.5 <= histogram.quantile_ms(0.5) <= 5.5
        assert 9.0 <= histogram.quantile_ms(0.99) <= 10.0

    def test_what_lies_above_all_bounds(self):
        histogram = Histogram()
        histogram.add(1e6)
        assert histogram.counts[-1] == 1
        assert BOUNDS_MS[-1] < histogram.quantile_ms(0.5) < histogram.quantile_ms(1.0) == 1e6

    @given(st.lists(st.floats(0, 400), min_size=1))
    def test_quantiles_rise_and_counts_add_up(self, times):
        histogram = Histogram()
        for time_ms in times:
            histogram.add(time_ms)
        assert sum(histogram.counts) == histogram.count == len(times)
        found = [histogram.quantile_ms(share / 10) for share in range(1, 11)]
        assert found == sorted(found)


class TestHealth:
    def test_all_well(self):
        health = SourceHealth(0.0)
        assert health.came(made(10, cqi=3), 10 * SECOND, 1.0) == 0.0
        assert health.verdict(1.5) == ""

    def test_silence(self):
        assert SourceHealth(0.0).verdict(3.0) == "nothing came for 3 s"
        assert SourceHealth(0.0, silent_after_s=math.inf).verdict(1e9) == ""

    def test_down_until_a_record_comes(self):
        health = SourceHealth(0.0)
        health.failed("no gNB")
        assert health.verdict(9.0) == "no gNB"
        assert health.counts["source_failures"] == 1
        health.came(made(1), SECOND, 9.0)
        assert health.verdict(9.0) == ""

    def test_records_that_are_old_when_they_come(self):
        health = SourceHealth(0.0, stale_after_s=2.0)
        for at in range(3):
            health.came(made(at), (at + 5) * SECOND, 0.0)
        assert health.verdict(0.0) == "records are 5.0 s old when they come"
        assert health.counts["late_records"] == 3

    def test_one_late_record_is_no_slow_source(self):
        health = SourceHealth(0.0)
        for at, age in enumerate((0, 0, 9)):
            health.came(made(at), (at + age) * SECOND, 0.0)
        assert health.verdict(0.0) == ""

    def test_stamps_of_the_future(self):
        health = SourceHealth(0.0)
        health.came(made(60), 0, 0.0)
        assert health.verdict(0.0) == "records are stamped 60.0 s ahead: clocks differ"
        assert health.counts["future_records"] == 1

    def test_a_recording_has_no_age(self):
        health = SourceHealth(0.0, live=False)
        assert health.came(made(1), 10**18, 0.0) == 0.0
        assert health.verdict(0.0) == ""

    def test_what_was_withheld_is_named_for_a_while(self):
        health = SourceHealth(0.0, silent_after_s=100.0)
        health.came(made(1, ul_snr_db=215.0, ul_bler=math.nan), SECOND, 1.0)
        assert "ul_bler of 4601, ul_snr_db of 4601" in health.verdict(2.0)
        assert health.counts["withheld_values"] == 2
        assert health.verdict(7.0) == ""


class TestFilling:
    def test_a_gap_is_filled_by_a_line_and_marked(self):
        series = Series(10)
        for at, value in ((0.0, 0.0), (0.1, 1.0), (0.4, 4.0)):
            series.append(at, value, Filling(0.1, 5))
        assert list(series.times_s) == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
        assert list(series.values) == pytest.approx([0, 1, 2, 3, 4])
        assert list(series.interpolated) == [False, False, True, True, False]

    def test_a_long_gap_stays(self):
        series = Series(10)
        for at in (0.0, 0.4):
            series.append(at, at, Filling(0.1, 2))
        assert len(series) == 2

    def test_nothing_is_filled_unless_asked_for(self):
        book = SessionBook()
        book.take(made(0, rtt_ms=1), 0.0)
        session, _ = book.take(made(1, rtt_ms=1), 1.0)
        assert list(session.of("rtt_ms").interpolated) == [False, False]

    def test_by_the_settings_of_the_core(self):
        core = RadioInformation(RadioSettings(fill=3))
        for at in (0.0, 0.1, 0.3):
            core.take(made(at, rtt_ms=10 * at), at)
        assert list(core.book.current["4601"].of("rtt_ms").values) == pytest.approx([0, 1, 2, 3])


class TestSessions:
    def book(self, live: bool = True) -> SessionBook:
        book = SessionBook(live=live)
        for at in range(3):
            book.take(made(1000 + at), float(at))
        return book

    @pytest.mark.parametrize(
        ("time_s", "heard_s", "why"),
        [(1003, 3.0, Beginning.FIRST), (1030, 3.0, Beginning.CLOCK), (1100, 100.0, Beginning.SILENCE),
         (10, 3.0, Beginning.CLOCK), (1004.9, 3.0, Beginning.FIRST)],
    )  # fmt: skip
    def test_why_a_session_begins(self, time_s, heard_s, why):
        session, _ = self.book().take(made(time_s), heard_s)
        assert session.beginning is why

    def test_of_a_recording_only_its_own_time_counts(self):
        session, began = self.book(live=False).take(made(1030), 2.001)
        assert not began
        assert session.last_seen_s == 1030

    def test_a_clock_set_back_a_little_begins_a_session_when_it_goes_on(self):
        book = self.book()
        began = [book.take(made(990 + at / 2), 3 + at / 2)[1] for at in range(10)]
        assert began.index(True) == 4
        assert book.current["4601"].beginning is Beginning.CLOCK
        assert book.current["4601"].last_seen_s == 994.5

    def test_a_few_old_records_at_once_do_not(self):
        book = self.book()
        assert not any(book.take(made(990 + at / 10), 3.0)[1] for at in range(10))
        assert book.current["4601"].stale == 10

    def test_what_a_record_lacks_is_missing(self):
        core = RadioInformation()
        core.take(made(1, cqi=3, ul_bler=0.1), 0.0)
        found = core.take(made(2, cqi=3), 1.0)
        assert found is not None
        assert found.missing == ("ul_bler",)
        message = channel_state(found.record, 1, missing=found.missing)
        assert message.field_quality["ul_bler"] == FieldQuality.MISSING
        assert message.field_quality["cqi"] == FieldQuality.MEASURED


class TestForgetting:
    def test_of_links_that_are_silent_for_long(self):
        core = RadioInformation(RadioSettings(forget_s=100.0))
        core.take(made(1, "a", prb_used=1, prb_total=50), 0.0)
        core.take(made(1, "b", prb_used=1, prb_total=50), 50.0)
        assert core.forget(101.0) == ["a"]
        assert set(core.book.current) == set(core._links) == {"b"}
        found = core.take(made(200, "a"), 102.0)
        assert found is not None
        assert found.began

    def test_an_intake_keeps_nothing_of_them(self):
        intake: Intake[int] = Intake(Mode.OPTIMIZED, differs=lambda a, b: a != b)
        intake.offer("a", 1)
        intake.tick()
        intake.forget("a")
        intake.offer("a", 1)
        assert intake.tick() == [1]


class TestShares:
    def test_of_the_carrier_all_active_links_have_their_part(self):
        core = RadioInformation()
        core.take(made(1, "a", prb_used=10, prb_total=50), 0.0)
        found = core.take(made(1, "b", prb_used=5, prb_total=50), 0.0)
        assert found is not None
        assert found.own_share == pytest.approx(0.1)
        assert core.carrier_share(found.record) == pytest.approx(0.3)

    def test_what_the_cell_says_goes_before(self):
        core = RadioInformation()
        item = made(1, prb_used=10, prb_cell_used=40, prb_total=50)
        found = core.take(item, 0.0)
        assert found is not None
        assert core.carrier_share(item) == pytest.approx(0.8)
        assert found.utilization == pytest.approx(0.8)

    def test_nothing_known(self):
        core = RadioInformation()
        core.take(made(1), 0.0)
        assert core.carrier_share(made(1)) is None

    def test_interference_is_foretold(self):
        core = RadioInformation()
        for at in range(30):
            found = core.take(made(at / 10, rsrp_dbm=-90, dl_sinr_db=10), at / 10)
        assert found is not None
        assert found.interference is not None
        assert found.interference.value == pytest.approx(22.0, abs=0.2)


class TestPlaces:
    def test_a_zone_is_somewhere(self):
        place = PoseStamped()
        place.pose.position.x, place.pose.position.y = 1.5, -2.0
        found = RadioInformation().take(made(1, ul_snr_db=3, ul_bler=0.2, ul_mcs=4), 0.0)
        assert found is not None
        message = spectrum_analysis(found, place)
        assert message.position_known
        assert (message.position.x, message.position.y) == (1.5, -2.0)
        assert zone_text("4601", found.zones[0], place) == (
            "4601: POOR_CHANNEL_ZONE at 1.50 -2.00 in map"
        )
        assert not spectrum_analysis(found).position_known


class TestMessages:
    def test_every_field_that_has_a_place_in_the_message_gets_there(self):
        """Each counter of the gNB of WirelessROS has its field."""
        item = made(1, **dict.fromkeys(FIELDS, 1.0) | {"rsrp_dbm": -80.0})
        message = channel_state(item, 1)
        unset = [
            field.name
            for field in ChannelState.DESCRIPTOR.fields
            if field.name not in ("header", "rnti", "link_id", "session", "source", "age_s")
            and field.name not in {name.name for name, _ in message.ListFields()}
        ]
        assert unset == []


class TestObservers:
    def test_each_is_told_once_whatever_another_does(self, caplog):
        heard: list[str] = []

        class Good:
            def on_channel_update(self, state: ChannelState) -> None:
                heard.append(state.link_id)

        class Bad:
            def on_channel_update(self, state: ChannelState) -> None:
                raise ValueError("no")

        observers, good = Observers(), Good()
        assert observers.register_observer(Bad())
        assert observers.register_observer(good)
        assert not observers.register_observer(good)
        observers.notify_observers(ChannelState(link_id="4601"))
        assert heard == ["4601"]
        assert observers.errors == 1
        assert "observer" in caplog.text
        assert observers.unregister_observer(good)
        assert not observers.unregister_observer(good)
        assert len(observers) == 1
