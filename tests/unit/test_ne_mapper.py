from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros_engines.network_exposure.qci import (
    FIVE_G_ONLY,
    QCI,
    RESERVED,
    ResourceType,
    dscp_of,
    qos_class,
)
from simple_ros_engines.network_exposure.qos_mapper import MapperSettings, Requirement, select
from simple_ros_engines.network_exposure.requirement import (
    Advice,
    FlowMapper,
    FlowProfile,
    delay_needed_ms,
)
from simple_ros_engines.network_exposure.statistics import FlowMeter, Traffic

# rate Hz, delay required ms, resource type, error rate, burst bytes: the class, its alternatives.
VECTORS = """
1 1000 GBR 1e-05 200: 74 4 73 71
1 1000 GBR 1e-05 1200: 74 4 73 71
1 1000 GBR 0.01 200: 76 74 72 4
1 1000 GBR 0.01 1200: 76 74 72 4
1 1000 Non-GBR 1e-05 200: 9 8 6 80
1 1000 Non-GBR 1e-05 1200: 9 8 6 80
1 1000 Non-GBR 0.01 200: 9 8 6 7
1 1000 Non-GBR 0.01 1200: 9 8 6 7
5 200 GBR 1e-05 200: 71 84 85
5 200 GBR 1e-05 1200: 71 84
5 200 GBR 0.01 200: 2 71 1 75
5 200 GBR 0.01 1200: 2 71 1 75
5 200 Non-GBR 1e-05 200: 80
5 200 Non-GBR 1e-05 1200: 80
5 200 Non-GBR 0.01 200: 7 79 80
5 200 Non-GBR 0.01 1200: 7 79 80
10 100 GBR 1e-05 200: 84 85
10 100 GBR 1e-05 1200: 84
10 100 GBR 0.01 200: 1 75 3 84
10 100 GBR 0.01 1200: 1 75 3 84
10 100 Non-GBR 1e-05 200: 80
10 100 Non-GBR 1e-05 1200: 80
10 100 Non-GBR 0.01 200: 7 79 80
10 100 Non-GBR 0.01 1200: 7 79 80
20 50 GBR 1e-05 200: 84 85
20 50 GBR 1e-05 1200: 84
20 50 GBR 0.01 200: 75 3 84 83
20 50 GBR 0.01 1200: 75 3 84 83
20 50 Non-GBR 1e-05 200: 80
20 50 Non-GBR 1e-05 1200: 80
20 50 Non-GBR 0.01 200: 79 80
20 50 Non-GBR 0.01 1200: 79 80
50 20 GBR 1e-05 200: 85
50 20 GBR 1e-05 1200:
50 20 GBR 0.01 200: 83 82 85
50 20 GBR 0.01 1200: 83
50 20 Non-GBR 1e-05 200: 80
50 20 Non-GBR 1e-05 1200: 80
50 20 Non-GBR 0.01 200: 80
50 20 Non-GBR 0.01 1200: 80
62.5 16 GBR 1e-05 200: 85
62.5 16 GBR 1e-05 1200:
62.5 16 GBR 0.01 200: 83 82 85
62.5 16 GBR 0.01 1200: 83
62.5 16 Non-GBR 1e-05 200: 80
62.5 16 Non-GBR 1e-05 1200: 80
62.5 16 Non-GBR 0.01 200: 80
62.5 16 Non-GBR 0.01 1200: 80
100 10 GBR 1e-05 200: 85
100 10 GBR 1e-05 1200:
100 10 GBR 0.01 200: 83 82 85
100 10 GBR 0.01 1200: 83
100 10 Non-GBR 1e-05 200: 80
100 10 Non-GBR 1e-05 1200: 80
100 10 Non-GBR 0.01 200: 80
100 10 Non-GBR 0.01 1200: 80
200 5 GBR 1e-05 200: 85
200 5 GBR 1e-05 1200:
200 5 GBR 0.01 200: 85
200 5 GBR 0.01 1200:
200 5 Non-GBR 1e-05 200:
200 5 Non-GBR 1e-05 1200:
200 5 Non-GBR 0.01 200:
200 5 Non-GBR 0.01 1200:
500 2 GBR 1e-05 200:
500 2 GBR 0.01 200:
500 2 Non-GBR 1e-05 200:
500 2 Non-GBR 0.01 200:
""".strip().splitlines()


@pytest.mark.parametrize("line", VECTORS)
def test_selects_as_the_table_says(line: str) -> None:
    needs, _, numbers = line.partition(":")
    rate, delay, kind, errors, burst = needs.split()
    profile = FlowProfile(is_reliable=errors == "1e-05")
    assert delay_needed_ms(float(rate), profile) == pytest.approx(float(delay))
    requirement = Requirement(ResourceType(kind), 1000 / float(rate), float(errors), int(burst))
    found = select(requirement)
    wanted = [int(number) for number in numbers.split()]
    if wanted:
        assert [found.qci, *(row.qci for row in found.alternatives)] == wanted
        assert not found.is_unmet
    else:
        assert found.is_unmet
        assert found.misses
        assert not found.alternatives


class TestTables:
    def test_every_class_is_there(self) -> None:
        numbers = {*range(1, 11), *range(65, 68), *range(69, 77), 79, 80, *range(82, 91)}
        assert set(QCI) == numbers
        assert set(QCI) >= FIVE_G_ONLY

    def test_priorities_of_5qi(self) -> None:
        expected = {65: 7, 69: 5, 71: 56, 79: 65, 80: 68, 82: 19, 83: 22, 84: 24, 85: 21, 86: 18}
        assert {number: QCI[number].five_qi_priority for number in expected} == expected

    def test_bursts_and_windows(self) -> None:
        assert {row.qci for row in QCI.values() if row.is_delay_critical} == set(range(82, 91))
        assert all((row.window_ms == 2000) == row.is_gbr for row in QCI.values())

    def test_code_points(self) -> None:
        assert (dscp_of(1), dscp_of(80), dscp_of(9), dscp_of(83), dscp_of(250)) == (
            46,
            34,
            0,
            18,
            0,
        )
        assert all(0 <= dscp_of(number) <= 63 for number in QCI)

    def test_unknown_number(self) -> None:
        assert qos_class(11) is None


class TestSelection:
    def test_camera_that_nothing_serves_misses_little(self) -> None:
        found = select(Requirement(ResourceType.GBR, 1000 / 30, 1e-5, 100_000))
        assert found.is_unmet
        assert found.qci != 85
        assert any("delay" in miss or "bursts" in miss for miss in found.misses)

    def test_reserved_classes_need_authority(self) -> None:
        needs = Requirement(ResourceType.NON_GBR, 200, 1e-6)
        assert select(needs).qci == 80
        assert select(needs, MapperSettings(authorised=frozenset({70}))).qci == 70

    def test_5g_classes_are_an_option(self) -> None:
        needs = Requirement(ResourceType.GBR, 20, 1e-2, 40_000)
        assert select(needs).is_unmet
        found = select(needs, MapperSettings(five_g=True))
        assert (found.qci, found.is_unmet) == (90, False)

    @given(
        kind=st.sampled_from(ResourceType),
        delay_ms=st.floats(0.5, 5000),
        errors=st.sampled_from([1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-9]),
        burst=st.integers(0, 200_000),
    )
    def test_what_is_chosen_serves_or_is_flagged(
        self, kind: ResourceType, delay_ms: float, errors: float, burst: int
    ) -> None:
        found = select(Requirement(kind, delay_ms, errors, burst))
        for row in (found.chosen, *found.alternatives):
            assert row.resource is kind
            assert row.qci not in RESERVED | FIVE_G_ONLY
            if not found.is_unmet:
                assert row.delay_ms <= delay_ms * (1 + 1e-9)
                assert row.error_rate <= errors * (1 + 1e-9)
                assert row.burst_bytes is None or row.burst_bytes >= burst
        assert bool(found.misses) == found.is_unmet


class TestNeeds:
    def test_budget_replaces_the_rate(self) -> None:
        assert delay_needed_ms(30, FlowProfile(budget_ms=150)) == 150
        assert delay_needed_ms(30, FlowProfile(budget_ms=150), 80) == 80

    def test_lifespan_and_deadline_limit_it(self) -> None:
        assert delay_needed_ms(1, FlowProfile(lifespan_ms=300, deadline_ms=200)) == 200
        assert delay_needed_ms(1, FlowProfile(lifespan_ms=300, budget_ms=400)) == 300


def traffic(rate_hz: float, duration_s: float = 5.0, size: int = 100) -> Traffic:
    return Traffic(
        duration_s, int(rate_hz * duration_s), 0, rate_hz, rate_hz * size, 1 / rate_hz, 0.0
    )


class TestFlowMapper:
    def look(
        self, mapper: FlowMapper, rate_hz: float, now_s: float, advice: Advice | None = None
    ) -> object:
        return mapper.look(traffic(rate_hz), 100, FlowProfile(), now_s, advice)

    def test_waits_for_two_windows(self) -> None:
        mapper = FlowMapper()
        assert mapper.look(traffic(10, 1.5), 100, FlowProfile(), 0) is None
        assert self.look(mapper, 10, 1) is None
        assert self.look(mapper, 10, 2) is None
        found = self.look(mapper, 10, 3.0)
        assert found.requirement.resource is ResourceType.GBR  # type: ignore[attr-defined]
        assert found.requirement.bit_rate == 16_000  # type: ignore[attr-defined]

    def test_steadiness_has_hysteresis(self) -> None:
        mapper = FlowMapper()
        rates = [10, 10, 11.5, 13.0, 17.0, 19.5, 20.0]
        found = [self.look(mapper, rate, 2.0 * n) for n, rate in enumerate(rates)]
        kinds = [item.requirement.resource.value for item in found[1:]]  # type: ignore[attr-defined]
        assert kinds == ["GBR", "GBR", "GBR", "Non-GBR", "Non-GBR", "GBR"]

    def test_advice_goes_first(self) -> None:
        mapper = FlowMapper()
        self.look(mapper, 50, 0)
        assert self.look(mapper, 50, 2).requirement.delay_ms == 20  # type: ignore[attr-defined]
        told = self.look(mapper, 50, 3, Advice(budget_ms=100, error_rate=1e-2))
        assert (told.requirement.delay_ms, told.requirement.error_rate) == (100, 1e-2)  # type: ignore[attr-defined]
        assert self.look(mapper, 50, 4, Advice(qci=9)).qci == 9  # type: ignore[attr-defined]
        odd = self.look(mapper, 50, 5, Advice(qci=33))
        assert any("33" in text for text in odd.warnings)  # type: ignore[attr-defined]

    def test_warns_as_the_paper_does(self) -> None:
        mapper = FlowMapper(MapperSettings(min_window_s=0.5))
        profile = FlowProfile(lifespan_ms=50, deadline_ms=60)
        mapper.look(traffic(10, 1), 100, profile, 0)
        found = mapper.look(traffic(10, 1), 100, profile, 1)
        assert found is not None
        told = " ".join(found.warnings)
        assert "lifespan 50 ms" in told
        assert "deadline 60 ms" in told
        assert "2000 ms" in told


class TestMeter:
    def test_rate_jitter_and_burst(self) -> None:
        meter = FlowMeter(5.0)
        for n in range(100):
            meter.sent(200, n / 10)
        seen = meter.traffic(9.9)
        assert seen.rate_hz == pytest.approx(10)
        assert seen.bandwidth == pytest.approx(2000)
        assert seen.jitter_s == pytest.approx(0, abs=1e-9)
        assert seen.duration_s == pytest.approx(5.0, abs=0.11)
        assert meter.burst(0.1) == 200
        assert meter.burst(1.0) == 2000
        assert (meter.messages, meter.bytes) == (100, 20_000)

    def test_silence_lowers_the_rate(self) -> None:
        meter = FlowMeter(5.0)
        for n in range(20):
            meter.sent(200, n / 10)
        assert meter.traffic(3.9).rate_hz == pytest.approx(19 / 3.8)
        assert meter.traffic(20).messages == 0

    def test_jitter(self) -> None:
        meter = FlowMeter(5.0)
        for n in range(40):
            meter.sent(1, n / 10 + (0.01 if n % 2 else 0))
        assert meter.traffic(4.0).jitter_s == pytest.approx(0.01, rel=0.02)

    @pytest.mark.parametrize("window_s", [2.0, 5.0, 10.0])
    @pytest.mark.parametrize("rate_hz", [1.3, 7.0, 30.0])
    def test_a_window_is_whole_wherever_its_messages_fall(
        self, window_s: float, rate_hz: float
    ) -> None:
        meter, mapper = FlowMeter(window_s), FlowMapper()
        found = None
        for n in range(int(rate_hz * 15)):
            meter.sent(200, n / rate_hz)
            seen = meter.traffic(n / rate_hz)
            assert seen.duration_s == pytest.approx(min(window_s, n / rate_hz))
            found = mapper.look(seen, 200, FlowProfile(), n / rate_hz)
        assert found is not None
        assert not found.warnings

    def test_a_topic_that_begins_anew_has_no_whole_window(self) -> None:
        meter = FlowMeter(2.0)
        for n in range(50):
            meter.sent(200, n / 10)
        assert meter.traffic(5.0).duration_s == 2.0
        meter.sent(200, 60.0)
        meter.sent(200, 60.1)
        assert meter.traffic(60.1).duration_s == pytest.approx(0.1)

    def test_more_messages_than_are_kept(self) -> None:
        meter = FlowMeter(2.0)
        for n in range(60_000):
            meter.sent(10, n / 20_000)
        seen = meter.traffic(3.0)
        assert (seen.duration_s, round(seen.rate_hz)) == (2.0, 20_000)
