"""Questions to databases and modems, and what is read from their answers."""

from __future__ import annotations

import json
import logging
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import ConfigError
from simple_ros.node import NodeHandle
from simple_ros_engines.base import WirelessEngine
from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.radio_information.sources.at_dialog import AtAnswer, AtDialog
from simple_ros_engines.radio_information.sources.base import (
    make_source,
    options_with_defaults,
)
from simple_ros_engines.radio_information.sources.field_maps import (
    PRESETS,
    NewestPoints,
    RawPoint,
    read_fields,
    rnti_of,
)
from simple_ros_engines.radio_information.sources.flexric import FlexricSource, record_of_line
from simple_ros_engines.radio_information.sources.influx1 import (
    BadAnswer,
    influxql_of_newest,
    parse_series,
)
from simple_ros_engines.radio_information.sources.influx2 import flux_of_devices, flux_of_last
from simple_ros_engines.radio_information.sources.influx3 import parse_rows, sql_of_newest
from simple_ros_engines.radio_information.sources.transport import link_records
from simple_ros_engines.store.annotated_csv import (
    distinct_csv,
    parse_distinct_csv,
    stamp_of_text,
)
from simple_ros_engines.store.flux import parse_flux
from simple_ros_engines.store.line_protocol import BadLine, flexric_line, parse_fields, parse_line

NOW = 1_700_000_000_000_000_000


class TestAtDialog:
    def test_an_answer_with_echo_and_words_unasked(self):
        dialog = AtDialog()
        assert dialog.ask("AT+X") == b"AT+X\r"
        found = dialog.receive(b'AT+X\r\r\n+X: 1\r\n\r\n+QIND: "csq"\r\n\r\nOK\r\n')
        assert found == AtAnswer("AT+X", ("+X: 1", '+QIND: "csq"'))
        assert found.text == '+X: 1\n+QIND: "csq"'

    @pytest.mark.parametrize("word", ["ERROR", "+CME ERROR: 10", "+CMS ERROR: 500", "NO CARRIER"])
    def test_refusals(self, word):
        dialog = AtDialog()
        dialog.ask("AT")
        found = dialog.receive(f"\r\n{word}\r\n".encode())
        assert found is not None
        assert found.refused == word

    def test_nothing_is_answered_unasked(self):
        assert AtDialog().receive(b"RDY\r\nOK\r\n") is None

    def test_an_unanswered_question_is_given_up(self):
        dialog = AtDialog()
        dialog.ask("AT+A")
        dialog.receive(b"+A: 1\r\n")
        dialog.ask("AT+B")
        assert dialog.receive(b"+B: 2\r\nOK\r\n") == AtAnswer("AT+B", ("+B: 2",))

    @given(st.lists(st.integers(1, 9)))
    def test_any_cutting_of_the_bytes_gives_the_same(self, sizes):
        dialog, data, found = AtDialog(), b"AT\r\r\n+X: 1\r\n\r\nOK\r\n", None
        dialog.ask("AT")
        for size in [*sizes, len(data)]:
            part, data = data[:size], data[size:]
            found = dialog.receive(part) or found
        assert found == AtAnswer("AT", ("+X: 1",))

    def test_noise_is_not_kept(self):
        dialog = AtDialog()
        dialog.ask("AT")
        for _ in range(100):
            assert dialog.receive(b"\xff" * 1000) is None
        assert len(dialog._buffer) <= 4096
        assert dialog.receive(b"\r\nOK\r\n") is not None


class TestInfluxQl:
    def test_the_question(self):
        assert influxql_of_newest('a"b\\', "rnti", 2) == (
            'SELECT * FROM "a\\"b\\\\" WHERE time > now() - 2000ms'
            ' GROUP BY "rnti" ORDER BY time DESC LIMIT 1'
        )

    def test_an_answer(self):
        series = {
            "name": "ue", "tags": {"rnti": "4601"},
            "columns": ["time", "cqi", "pci"], "values": [[NOW, 12, "1"], [None, 1, "1"]],
        }  # fmt: skip
        other = {"name": "ue", "tags": {"rnti": ""}, "columns": ["time"], "values": [[NOW]]}
        text = json.dumps({"results": [{"statement_id": 0, "series": [series, other]}]})
        assert list(parse_series(text, "rnti")) == [RawPoint("4601", NOW, {"cqi": 12, "pci": "1"})]
        assert list(parse_series('{"results": [{"statement_id": 0}]}', "rnti")) == []

    @pytest.mark.parametrize(
        "text", ["", "[]", '{"error": "x"}', '{"results": [{"error": "no"}]}', '{"results": [3]}']
    )
    def test_what_is_none(self, text):
        with pytest.raises(BadAnswer):
            list(parse_series(text, "rnti"))


class TestSql:
    def test_the_question(self):
        text = sql_of_newest('u"e', "rnti", 3.0)
        assert 'FROM "u""e" WHERE time >= now() - INTERVAL \'3000 milliseconds\'' in text
        assert 'PARTITION BY "rnti" ORDER BY time DESC' in text

    def test_answers(self):
        rows = '{"time": "2023-11-14T22:13:20.000000001", "rnti": "17921", "cqi": 3}\n\nhalf\n[1]\n'
        found = list(parse_rows(rows + '{"time": "soon", "rnti": "1"}', "rnti"))
        assert found[0] is not None
        assert (found[0].rnti, found[0].stamp_ns) == ("17921", NOW + 1)
        assert found[1:] == [None, None, None]


class TestFlux:
    def test_both_questions_are_those_the_store_understands(self):
        last = parse_flux(flux_of_last('my "bucket"', "ue", 1.5), NOW)
        assert (last.bucket, last.start_ns) == ('my "bucket"', NOW - 1_500_000_000)
        devices = parse_flux(flux_of_devices("b", "ue", "rnti"), NOW)
        assert (devices.distinct, devices.equals) == ("rnti", {"_measurement": "ue"})

    def test_the_answer_to_distinct(self):
        assert list(parse_distinct_csv(distinct_csv("rnti", ["4601", "4602"]))) == ["4601", "4602"]
        assert list(parse_distinct_csv("")) == []

    @pytest.mark.parametrize(
        "text", ["2023-11-14T22:13:20Z", "2023-11-14T22:13:20", "2023-11-14T23:13:20.0+01:00"]
    )
    def test_moments(self, text):
        assert stamp_of_text(text) == NOW


class TestPoints:
    def test_each_point_gives_one_record(self):
        newest = NewestPoints(PRESETS["srsran"], "test")
        point = RawPoint("17921", NOW, {"cqi": 3, "text": "x"})
        (found,) = newest.fresh([point])
        assert found is not None
        assert dict(found.values) == {"cqi": 3}
        assert list(newest.fresh([point])) == []
        assert list(newest.fresh([RawPoint("none", NOW, {})])) == [None]
        assert newest.links(["17921", "none", ""]) == {"4601"}

    @pytest.mark.parametrize(
        ("preset", "text", "rnti"),
        [("srsran", "17921", 0x4601), ("srsran", "4a01", None), ("srsran", "²", None),
         ("flexric_mac", "4601", 0x4601), ("flexric_mac", "0x4601", 0x4601), ("flexric_mac", "", None)],
    )  # fmt: skip
    def test_rntis(self, preset, text, rnti):
        assert rnti_of(PRESETS[preset], text) == rnti

    def test_every_counter_of_the_gnb_of_wirelessros_is_read(self):
        names = [
            "in_sync",
            "frame",
            "slot",
            "DL_Thr",
            "UL_Thr",
            "ph",
            "pcmax",
            "avg_rsrp",
            "num_rsrp_meas",
            "cqi",
            "ri",
            "raw_rssi",
            "ul_rssi",
            "dl_max_mcs",
            "sched_ul_bytes",
            "estimated_ul_buffer",
            "num_total_bytes",
            "dl_pdus_total",
            "snr_pusch",
            "dl_bler",
            "dl_mcs",
            "dlsch_errors",
            "dlsch_total_byte",
            "dlsch_current_bytes",
            "dl_total_rbs",
            "dl_current_rbs",
            "dl_num_mac_sdu",
            "ul_bler",
            "ul_mcs",
            "ulsch_errors",
            "ulsch_total_byte",
            "ulsch_current_bytes",
            "ul_total_rbs",
            "ul_current_rbs",
            "ul_num_mac_sdu",
        ]
        raw = dict.fromkeys(names, 1.0) | {"avg_rsrp": -80.0}
        found = read_fields(PRESETS["wirelessros_oai"], "4601", NOW, "x", raw)
        assert found is not None
        assert len(found.values) == len(names) == 35
        assert list(found.suspects()) == []


class TestFlexric:
    MAPPING = PRESETS["flexric_mac"]

    def test_lines(self):
        line = "mac_stats: tstamp=1700000000000000,pusch_snr=21.5,rnti=4601"
        found = record_of_line(line, self.MAPPING, "mac_stats")
        assert found is not None
        assert (found.link_id, found.stamp_ns, found.get("ul_snr_db")) == ("4601", NOW, 21.5)
        assert record_of_line("rlc_stats: tstamp=1,a=1", self.MAPPING, "mac_stats") is None

    @pytest.mark.parametrize(
        "line",
        ["mac_stats: pusch_snr=1,rnti=4601", "mac_stats: tstamp=1,pusch_snr=1", "mac_stats: rnti=4601",
         "", f"mac_stats: tstamp={'9' * 5000},a=1,rnti=4601"],
    )  # fmt: skip
    def test_what_is_none(self, line):
        with pytest.raises(BadLine):
            record_of_line(line, self.MAPPING, "mac_stats")

    def test_not_more_often_than_asked_for(self):
        source, came = FlexricSource(period_s=0.05), []
        for milli in (0, 10, 49, 50, 60, 100, 20):
            stamp = 1_700_000_000_000_000 + 1000 * milli
            source.take(f"mac_stats: tstamp={stamp},pusch_snr=1,rnti=4601", came.append)
        assert [(item.stamp_ns - NOW) / 1e6 for item in came] == [0, 50, 100, 20]


class TestHugeNumbers:
    """Python refuses to read integers of more than 4300 digits."""

    def test_of_a_line(self):
        assert parse_fields(parse_line(f"ue a={'9' * 5000}i 1").fields) == {"a": float("inf")}
        with pytest.raises(BadLine):
            parse_line(f"ue a=1 {'9' * 5000}")
        with pytest.raises(BadLine):
            parse_line("ue a=1 9223372036854775807", 1, 1000)
        assert flexric_line(f"m: tstamp={'9' * 5000},a=1").endswith("9000")


class TestEchoes:
    def test_of_a_host_with_and_without_connections(self):
        found, _ = link_records([], {}, NOW, {"10.0.0.7": 12.0})
        assert dict(found[0].values) == {"rtt_ms": 12.0, "echo_rtt_ms": 12.0}
        assert found[0].link_id == "10.0.0.7"


@pytest.mark.parametrize(
    ("name", "options", "why"),
    [("quectel", {"period_s": 0}, "period_s"), ("influx1", {"url": "ftp://x"}, "neither http"),
     ("influx3", {"fields": "nokia"}, "field map"), ("flexric", {"prot": 1}, "prot"),
     ("replay", {}, "needs the option 'path'"), ("store", {"period_s": 0}, "period_s is 0"),
     ("influx1", {"window_s": math.nan}, "NaN")],
)  # fmt: skip
def test_options_that_have_no_meaning(name: str, options: dict[str, Any], why: str):
    with pytest.raises(ConfigError, match=why):
        make_source(name, options)


def test_options_that_can_be_parameters():
    assert options_with_defaults("replay") == {
        "path": "", "speed": 1.0, "restamp": False, "loop": False,
    }  # fmt: skip
    assert options_with_defaults("transport")["ports"] == ()
    assert options_with_defaults("synthetic")["count"] == 0


class _Failing(WirelessEngine[int]):
    node_name = "failing"
    summary = "fails now and then"

    async def set_up(self, node: NodeHandle) -> None:
        """Nothing."""

    def look_at(self, item: int) -> None:
        if item % 10 == 0:
            raise ValueError("a tenth")

    def link_count(self) -> int:
        return 0


def test_an_engine_whose_inputs_fail_too_often_says_so(caplog: pytest.LogCaptureFixture):
    engine = _Failing()
    for item in range(1, 50):
        engine.offer("a", item)
    assert engine.verdict() == ("starting", "")
    for item in range(50, 101):
        engine.offer("a", item)
    text = "10 of the last 100 inputs failed, with ValueError: a tenth"
    assert engine.verdict() == ("degraded", text)
    assert engine.errors == 10
    assert len([item for item in caplog.records if item.levelno == logging.ERROR]) == 1


def test_records_are_of_one_type():
    assert isinstance(make_source("flexric", {}), FlexricSource)
    assert LinkRecord("a", 1, "x").get("cqi") is None
