"""The metrics store: line protocol, Flux, annotated CSV, the database."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros_engines.store.annotated_csv import (
    LastValue,
    distinct_csv,
    last_csv,
    parse_last_csv,
)
from simple_ros_engines.store.database import MetricsStore
from simple_ros_engines.store.flux import BadFlux, FluxQuery, parse_flux
from simple_ros_engines.store.line_protocol import (
    BadLine,
    Point,
    flexric_line,
    parse_fields,
    parse_line,
    parse_lines,
    parse_tags,
    tag_text,
)

NOW = 1_700_000_000_000_000_000
SECOND = 10**9


def points(text: str) -> list[Point]:
    found = list(parse_lines(text))
    assert not any(isinstance(item, BadLine) for item in found)
    return [item for item in found if isinstance(item, Point)]


def query(text: str) -> FluxQuery:
    return parse_flux(text, NOW)


class TestLines:
    def test_all_kinds_of_values(self):
        line = r'ue,rnti=4601,cell=a\ b f=1.5,i=-2i,u=7u,e=1e3,t=true,n=F,s="x, \"y\" =" 12'
        point = parse_line(line)
        assert (point.measurement, point.stamp_ns) == ("ue", 12)
        assert parse_tags(point.tags) == {"cell": "a b", "rnti": "4601"}
        assert parse_fields(point.fields) == {
            "f": 1.5, "i": -2, "u": 7, "e": 1000.0, "t": True, "n": False, "s": 'x, "y" =',
        }  # fmt: skip

    def test_units_of_time(self):
        assert parse_line("ue a=1 1700000000000", 1, 10**6).stamp_ns == NOW
        assert parse_line("ue a=1").stamp_ns is None

    @pytest.mark.parametrize(
        "line",
        ["", "ue", "ue a", "ue a=", "ue a=1,", "ue a=x", ",rnti=1 a=1", "ue,rnti a=1",
         "ue a=1 notime", "ue a=1 1 2", 'ue s="open', "ue a=nan", "ue a=" + "1" * 70_000],
    )  # fmt: skip
    def test_what_is_none(self, line):
        with pytest.raises(BadLine, match="line 7 is no line protocol"):
            parse_line(line, 7)

    def test_good_lines_count_though_others_are_bad(self):
        found = list(parse_lines("ue a=1\n# comment\n\nbroken\nue a=2\n"))
        assert [type(item) for item in found] == [Point, BadLine, Point]
        assert found[1].number == 4

    @given(st.dictionaries(st.text("ab =,\\", min_size=1), st.text("xy =,\\", min_size=1)))
    def test_tags_come_back(self, tags):
        assert parse_tags(tag_text(tags)) == tags

    @given(st.text(max_size=200))
    def test_any_text_is_a_point_or_a_bad_line(self, text):
        for item in parse_lines(text):
            assert isinstance(item, Point | BadLine)

    def test_what_flexric_sends(self):
        line = flexric_line("mac_stats: tstamp=1700000000000000,frame=1,pusch_snr=21.5,rnti=4601")
        point = parse_line(line)
        assert parse_tags(point.tags) == {"rnti": "4601"}
        assert parse_fields(point.fields) == {"frame": 1.0, "pusch_snr": 21.5}
        assert point.stamp_ns == NOW
        assert flexric_line("ue,rnti=1 a=1") == "ue,rnti=1 a=1"


class TestFlux:
    def test_the_last_values_of_a_device(self):
        found = query(
            'from(bucket: "b") |> range(start: -1s)\n'
            ' |> filter(fn: (r) => r["_measurement"] == "glasses_18" and r.rnti == "4601")'
            " |> last()"
        )
        assert found == FluxQuery(
            "b", NOW - SECOND, NOW + 1, {"_measurement": "glasses_18", "rnti": "4601"}
        )

    def test_which_devices_there_are(self):
        found = query(
            'from(bucket:"b")|>range(start:-1m)|>filter(fn:(r)=>r._measurement=="ue")'
            '|>group(columns:["rnti"])|>distinct(column:"rnti")'
        )
        assert found.distinct == "rnti"
        assert found.start_ns == NOW - 60 * SECOND

    @pytest.mark.parametrize(
        ("text", "moment"),
        [("-1h30m", NOW - 5400 * SECOND), ("now()", NOW), ("1700000000", NOW),
         ("2023-11-14T22:13:20Z", NOW), ("2023-11-14T22:13:20.5Z", NOW + SECOND // 2)],
    )  # fmt: skip
    def test_moments(self, text, moment):
        assert query(f'from(bucket: "b") |> range(start: {text}) |> last()').start_ns == moment

    @pytest.mark.parametrize(
        ("text", "why"),
        [
            ("", "is no call"),
            ("buckets()", "begins with from"),
            ('from(bucket: "b") |> last()', "needs range"),
            ('from(bucket: "b") |> range(start: -1m) |> mean()', "ends in .'mean'."),
            ('from(bucket: "b") |> range(start: soon) |> last()', "no moment"),
            ('from(bucket: "b") |> range(start: 2020-01-01) |> last()', "time zone"),
            (
                'from(bucket: "b") |> range(start: -1m) |> filter(fn: (r) => r.x > 3) |> last()',
                "no comparison",
            ),
            ("from(bucket: b) |> range(start: -1m) |> last()", "bucket"),
        ],
    )
    def test_what_is_not_understood_is_said(self, text, why):
        with pytest.raises(BadFlux, match=why):
            query(text)


class TestAnswers:
    def test_last(self):
        values = [
            LastValue("ue", {"rnti": "4601"}, "bler", 0.5, NOW),
            LastValue("ue", {"rnti": "4601"}, "cqi", 12, NOW),
            LastValue("ue", {"rnti": "4602"}, "bler", 0.25, NOW),
        ]
        blocks = last_csv(values, NOW - SECOND, NOW).split("\r\n\r\n")
        assert len(blocks) == 2
        rows = list(csv.reader(blocks[0].splitlines()))
        assert rows[0][6] == "double"
        named = [dict(zip(rows[3], row, strict=True)) for row in rows[4:]]
        assert [(row["rnti"], row["_value"], row["table"]) for row in named] == [
            ("4601", "0.5", "0"),
            ("4602", "0.25", "1"),
        ]
        assert named[0]["_time"] == "2023-11-14T22:13:20.000000000Z"

    def test_there_and_back(self):
        values = [
            LastValue("ue", {"rnti": "4601"}, "bler", 0.5, NOW + 1),
            LastValue("ue", {"rnti": "4601", "pci": "1"}, "cqi", 12, NOW),
            LastValue("ue", {"rnti": "4601"}, "name", 'a, "b"', NOW),
            LastValue("ue", {"rnti": "4601"}, "ok", True, NOW),
        ]
        assert list(parse_last_csv(last_csv(values, NOW - SECOND, NOW))) == values
        assert list(parse_last_csv("nonsense\n1,2\n")) == []
        assert list(parse_last_csv("")) == []

    def test_distinct(self):
        rows = list(csv.reader(distinct_csv("rnti", ["4601", "4602"]).splitlines()))
        assert rows[3] == ["", "result", "table", "rnti", "_value"]
        assert rows[4] == ["", "", "0", "4601", "4601"]
        assert distinct_csv("rnti", []) == ""


class TestDatabase:
    def span(self, seconds: float = 60, **equals: str) -> FluxQuery:
        return FluxQuery("b", NOW - int(seconds * SECOND), NOW + 1, equals)

    def test_newest_value_of_each_field(self):
        store = MetricsStore()
        store.write(points(f"ue,rnti=4601 a=1,b=2 {NOW - 2}\nue,rnti=4601 a=3 {NOW - 1}"), NOW)
        found = {value.name: value.value for value in store.last(self.span())}
        assert found == {"a": 3.0, "b": 2.0}
        assert store.last(self.span(rnti="4602")) == []
        assert [v.name for v in store.last(self.span(_field="b"))] == ["b"]
        store.close()

    def test_order_of_tags_makes_no_other_series(self):
        store = MetricsStore()
        store.write(points(f"ue,a=1,b=2 x=1 {NOW}\nue,b=2,a=1 y=2 {NOW}"), NOW)
        (one, other) = store.last(self.span())
        assert one.tags == other.tags == {"a": "1", "b": "2"}
        store.close()

    def test_devices(self):
        store = MetricsStore()
        lines = f"ue,rnti=4602 a=1 {NOW}\nue,rnti=4601 a=1 {NOW}\nold,rnti=1 a=1 {NOW - 10**12}"
        store.write(points(lines), NOW)
        wanted = FluxQuery("b", NOW - SECOND, NOW + 1, {}, "rnti")
        assert store.distinct(wanted) == ["4601", "4602"]
        store.close()

    def test_it_survives_a_restart_and_forgets(self, tmp_path: Path):
        path = tmp_path / "metrics.db"
        store = MetricsStore(path, retention_s=10)
        store.write(points(f"ue,rnti=1 a=1 {NOW - 20 * SECOND}\nue,rnti=1 a=2 {NOW}"), NOW)
        store.close()
        again = MetricsStore(path, retention_s=10)
        assert [value.value for value in again.last(self.span())] == [2.0]
        again.forget(NOW)
        old = FluxQuery("b", 0, NOW - SECOND, {})
        assert again.last(old) == []
        again.close()
