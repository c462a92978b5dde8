"""Tables, sizes and the block error model against the standards."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from simple_ros.errors import ConfigError
from simple_ros_engines.radio.bler import (
    best_mcs,
    block_error_rate,
    implied_snr_db,
    required_snr_db,
    to_db,
)
from simple_ros_engines.radio.carrier import (
    Carrier,
    code_blocks,
    resource_blocks,
    transport_block_bits,
)
from simple_ros_engines.radio.mcs import (
    McsTable,
    cqi_efficiency,
    cqi_to_mcs,
    mcs_entry,
    mcs_table,
)
from simple_ros_engines.simulator.propagation import Fading

TABLES = list(McsTable)


class TestMcs:
    """3GPP TS 38.214, 5.1.3.1 and 5.2.2.1."""

    @pytest.mark.parametrize(
        ("table", "index", "modulation", "efficiency"),
        [
            (McsTable.QAM64, 0, "QPSK", 0.2344),
            (McsTable.QAM64, 9, "QPSK", 1.3262),
            (McsTable.QAM64, 10, "16QAM", 1.3281),
            (McsTable.QAM64, 16, "16QAM", 2.5703),
            (McsTable.QAM64, 17, "64QAM", 2.5664),
            (McsTable.QAM64, 28, "64QAM", 5.5547),
            (McsTable.QAM256, 20, "256QAM", 5.3320),
            (McsTable.QAM256, 27, "256QAM", 7.4063),
            (McsTable.LOW_SE, 0, "QPSK", 0.0586),
            (McsTable.LOW_SE, 28, "64QAM", 4.5234),
        ],
    )
    def test_efficiencies_are_those_of_the_tables(self, table, index, modulation, efficiency):
        entry = mcs_entry(table, index)
        assert entry.modulation == modulation
        assert entry.efficiency == pytest.approx(efficiency, abs=1e-4)

    def test_sizes(self):
        assert [len(mcs_table(table)) for table in TABLES] == [29, 28, 29]

    @pytest.mark.parametrize(
        ("table", "expected"),
        [
            (McsTable.QAM64, [0, 0, 2, 4, 6, 8, 11, 13, 15, 18, 20, 22, 24, 26, 28]),
            (McsTable.QAM256, [0, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27]),
            (McsTable.LOW_SE, [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28]),
        ],
    )
    def test_an_indicator_means_the_scheme_of_the_nearest_efficiency(self, table, expected):
        assert [cqi_to_mcs(table, cqi) for cqi in range(1, 16)] == expected
        assert cqi_to_mcs(table, 0) == 0
        assert cqi_efficiency(McsTable.QAM64, 15) == pytest.approx(5.5547, abs=1e-4)

    def test_what_is_not_there_is_refused(self):
        with pytest.raises(ConfigError, match=r"MCS 29 is not in table 64QAM: 0\.\.28"):
            mcs_entry(McsTable.QAM64, 29)
        with pytest.raises(ConfigError, match="CQI 16"):
            cqi_to_mcs(McsTable.QAM64, 16)


class TestCarrier:
    @pytest.mark.parametrize(
        ("scs", "mhz", "blocks"), [(15, 20, 106), (30, 20, 51), (30, 100, 273), (60, 100, 135)]
    )
    def test_blocks_of_a_channel(self, scs, mhz, blocks):
        """TS 38.101-1, table 5.3.2-1."""
        assert resource_blocks(scs, mhz) == blocks

    def test_no_such_channel(self):
        with pytest.raises(ConfigError, match="no channel of 100 MHz at 15 kHz"):
            resource_blocks(15, 100)
        with pytest.raises(ConfigError, match="subcarrier spacing 120"):
            resource_blocks(120, 100)
        with pytest.raises(ConfigError):
            Carrier(30, 0)

    def test_transport_block_of_a_full_carrier(self):
        """TS 38.214, 5.1.3.2: 273 blocks of 156 elements at MCS 28 of table 1."""
        bits = transport_block_bits(mcs_entry(McsTable.QAM64, 28), 273 * 156)
        assert bits == 237_776
        assert code_blocks(bits) == 29

    def test_small_transport_blocks_are_those_of_table_5_1_3_2_1(self):
        assert transport_block_bits(mcs_entry(McsTable.QAM64, 0), 156) == 32
        sizes = [transport_block_bits(entry, 10 * 156) for entry in mcs_table(McsTable.QAM64)[:17]]
        assert sizes == sorted(sizes)
        assert all(size % 8 == 0 for size in sizes)

    def test_rate_of_a_carrier(self):
        # 51 blocks, 156 elements, 2000 slots a second, one bit an element.
        assert Carrier(30, 51).rate_bps(1.0) == 51 * 156 * 2000
        assert Carrier(15, 51, share=0.5, layers=2).rate_bps(1.0, 10) == 10 * 156 * 500 * 2


class TestBler:
    @pytest.mark.parametrize("table", TABLES)
    def test_one_block_in_ten_needs_more_than_shannon_but_not_much(self, table):
        for entry in mcs_table(table):
            limit_db = to_db(2**entry.efficiency - 1)
            assert 1.0 < required_snr_db(entry, 0.1) - limit_db < 4.0

    @pytest.mark.parametrize("table", TABLES)
    def test_every_scheme_needs_more_than_the_one_before(self, table):
        needed = [required_snr_db(entry, 0.1) for entry in mcs_table(table)]
        assert all(low < high for low, high in itertools.pairwise(needed))

    def test_it_falls_with_the_ratio_and_with_length(self):
        entry = mcs_entry(McsTable.QAM64, 10)
        rates = [block_error_rate(entry, snr) for snr in range(-10, 20)]
        assert all(a >= b for a, b in itertools.pairwise(rates))
        assert rates[0] == pytest.approx(1.0)
        assert rates[-1] == pytest.approx(0.0, abs=1e-9)
        assert required_snr_db(entry, 1e-3, 156) > required_snr_db(entry, 1e-3, 1560)

    def test_reliability_costs_signal(self):
        entry = mcs_entry(McsTable.LOW_SE, 10)
        assert required_snr_db(entry, 1e-5) > required_snr_db(entry, 0.1)

    def test_the_best_scheme_meets_the_target_and_the_next_does_not(self):
        chosen = best_mcs(McsTable.QAM64, 10.0)
        assert block_error_rate(chosen, 10.0) <= 0.1 + 1e-3
        following = mcs_entry(McsTable.QAM64, chosen.index + 1)
        assert block_error_rate(following, 10.0) > 0.1
        assert best_mcs(McsTable.QAM64, -30.0).index == 0
        assert best_mcs(McsTable.QAM64, 60.0).index == 28

    def test_the_quirk_of_scheme_17(self):
        """It carries less than 16: nobody should use it."""
        chosen = {best_mcs(McsTable.QAM64, snr / 10).index for snr in range(-100, 300)}
        assert chosen == set(range(29)) - {17}

    def test_the_implied_ratio_inverts_the_model(self):
        entry = mcs_entry(McsTable.QAM64, 15)
        for rate in (0.01, 0.1, 0.5, 0.9):
            assert block_error_rate(entry, implied_snr_db(entry, rate)) == pytest.approx(
                rate, rel=0.03
            )
        assert math.isfinite(implied_snr_db(entry, 0.0))
        assert math.isfinite(implied_snr_db(entry, 1.0))


class TestFading:
    def test_an_even_grid_gives_what_single_times_give(self):
        fading = Fading(10.0, taps=2, waves=4, subbands=3, antennas=1)
        times = np.arange(200) * 1e-3
        uneven = np.r_[times, 0.5]
        even = fading.trace(np.random.default_rng(1), times)
        assert even == pytest.approx(fading.trace(np.random.default_rng(1), uneven)[:200])

    def test_mean_power_is_one(self):
        fading = Fading(10.0, antennas=8)
        gains = fading.trace(np.random.default_rng(1), np.arange(4000) * 5e-3)
        assert gains.mean() == pytest.approx(1.0, abs=0.05)
