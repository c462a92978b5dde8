"""Rates, sizes, times and their lines, without a process or a Master."""

from __future__ import annotations

import pytest

from simple_ros.cli.measurements import (
    Spread,
    bandwidth_facts,
    bandwidth_line,
    cpp_rate_text,
    rate_facts,
    rate_line,
    spread,
)
from simple_ros.cli.node.pinging import ping_summary
from simple_ros.cli.text import columns, duration_text, size_text


class TestMeasurements:
    def test_spread(self) -> None:
        assert spread([1.0, 3.0]) == Spread(2.0, 1.0, 3.0, 1.0)

    @pytest.mark.parametrize("times", [[], [1.0], [1.0, 1.0]])
    def test_too_few(self, times: list[float]) -> None:
        assert rate_facts(times) is None
        assert bandwidth_facts(times, [1] * len(times)) is None

    def test_rate(self) -> None:
        facts = rate_facts([1.0, 1.1, 1.3, 1.4])
        assert facts is not None
        assert facts == pytest.approx(
            {"rate_hz": 7.5, "min_s": 0.1, "max_s": 0.2, "stddev_s": 0.0471404521, "window": 4}
        )
        assert rate_line(facts) == (
            "rate 7.50 Hz, period min 100.000 ms max 200.000 ms stddev 47.140 ms, window 4"
        )

    def test_bandwidth(self) -> None:
        facts = bandwidth_facts([0.0, 0.5, 1.0], [100, 1500, 2000])
        assert facts is not None
        assert bandwidth_line(facts) == (
            "3.50 kB/s, size mean 1.20 kB min 100 B max 2.00 kB, window 3"
        )

    @pytest.mark.parametrize(
        ("count", "text"), [(0, "0 B"), (999, "999 B"), (1e6, "1.00 MB"), (5e9, "5.00 GB")]
    )
    def test_sizes(self, count: float, text: str) -> None:
        assert size_text(count) == text

    def test_durations(self) -> None:
        assert duration_text(0.0005) == "0.500 ms"
        assert duration_text(2.0) == "2.000 s"

    def test_ping(self) -> None:
        assert ping_summary([None]) == "0 of 1 answered"
        assert ping_summary([1.0, None, 2.0]) == (
            "2 of 3 answered: mean 1.500 ms min 1.000 ms max 2.000 ms"
        )

    @pytest.mark.parametrize(
        ("times", "text"),
        [
            ([], None),
            ([1.0], None),
            ([0.0, 0.5, 1.0], "\rAverage rate (3 samples): 2 Hz   "),
            ([0.0, 0.3], "\rAverage rate (2 samples): 3.33333 Hz   "),
            ([0.0, 0.0208], "\rAverage rate (2 samples): 50 Hz   "),  # whole milliseconds
            ([0.0, 0.0004], "\rAverage rate (2 samples): inf Hz   "),
        ],
    )
    def test_as_the_cpp_tool(self, times: list[float], text: str | None) -> None:
        assert cpp_rate_text(times) == text


def test_columns() -> None:
    assert columns([("a", "b"), ("long", "c")]) == "a     b\nlong  c"
