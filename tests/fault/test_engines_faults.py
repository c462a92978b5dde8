"""What is wrong with a source of metrics is flagged by the running engine, and stops nothing.

Lines of FlexRIC over UDP, because their stamps are the source's own.
"""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support.engines import at_work, source, user
from support.waiting import LIMIT_S, until

from simple_ros.msg.wireless_ros_msgs import (
    ChannelState,
    Constraint,
    EngineStatus,
    FieldQuality,
)
from simple_ros_engines.cross_domain.node import CrossDomainEngine
from simple_ros_engines.radio_information.node import RadioInformationEngine
from simple_ros_engines.radio_information.sources.base import MetricsSource
from simple_ros_engines.radio_information.sources.flexric import FlexricSource
from simple_ros_master import Master


class Gnb:
    """Sends lines as a gNB does, and sees what the engines make of them."""

    def __init__(self, engine: RadioInformationEngine) -> None:
        self.engine = engine
        self.states: list[ChannelState] = []
        self.constraints: list[Constraint] = []
        self.statuses: list[EngineStatus] = []
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, age_s: float = 0.0, **fields: Any) -> None:
        """A line of link 4601, measured so long ago."""
        stamp = int(1e6 * (time.time() - age_s))
        values = {"pusch_snr": 20.0, "ul_bler": 0.05, "ul_mcs1": 12, **fields}
        text = ",".join(f"{name}={value}" for name, value in values.items())
        self.send_text(f"mac_stats: tstamp={stamp},{text},rnti=4601")

    def send_text(self, text: str) -> None:
        assert isinstance(self.engine.source, FlexricSource)
        self._socket.sendto(text.encode(), ("127.0.0.1", self.engine.source.port))

    async def sending(self, condition: Callable[[], object], what: str, **fields: Any) -> None:
        """Send good lines until a condition holds."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            assert time.monotonic() < end, what
            self.send(**fields)
            await asyncio.sleep(0.02)

    async def goes_on(self) -> None:
        """Good lines still make their way through both engines, and all is well again."""
        before, after = len(self.states), len(self.constraints)
        await self.sending(
            lambda: len(self.states) > before + 2 and len(self.constraints) > after + 2,
            "records and constraints",
        )
        await self.sending(lambda: self.engine.state == "active", "a good state")

    def told(self, name: str) -> float:
        """A measure of the radio engine's newest status."""
        found = [s for s in self.statuses if "radio_info" in s.name]
        return found[-1].measures[name] if found else 0.0

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
async def gnb(master: Master) -> AsyncIterator[Gnb]:
    engine = RadioInformationEngine()
    made = Gnb(engine)
    async with user(master) as node:
        await node.subscribe("/wireless_ros/channel_state", ChannelState, made.states.append)
        await node.subscribe("/wireless_ros/constraints", Constraint, made.constraints.append)
        await node.subscribe("/wireless_ros/status", EngineStatus, made.statuses.append)
        async with (
            at_work(CrossDomainEngine(), master),
            at_work(engine, master, **source("flexric", port=0, period_s=0.01)),
        ):
            await until(lambda: isinstance(engine.source, FlexricSource) and engine.source.port)
            await made.sending(lambda: made.constraints, "the chain")
            yield made
            assert engine.errors == 0
    made.close()


async def test_a_source_that_says_nothing(gnb: Gnb) -> None:
    await until(lambda: gnb.engine.verdict()[0] == "degraded", "silence")
    assert gnb.engine.detail.startswith("nothing came for")
    await until(lambda: gnb.statuses[-1].inactive_links == 1 or gnb.engine.link_count() == 0)
    await gnb.goes_on()


async def test_a_slow_source(gnb: Gnb) -> None:
    await gnb.sending(lambda: gnb.engine.state == "active", "a good state")

    def is_late() -> bool:
        return gnb.engine.verdict()[0] == "degraded" and "old when they come" in gnb.engine.detail

    late = len(gnb.states)
    await gnb.sending(is_late, "late records are flagged", age_s=30.0)
    await until(lambda: gnb.told("late_records") > 0, "the measure")
    # Those of before are known: what is older than them is left out until the source's clock counts as set.
    await gnb.sending(lambda: len(gnb.states) > late, "late records are used after all", age_s=30.0)
    assert gnb.states[-1].age_s == pytest.approx(30.0, abs=5.0)
    await gnb.goes_on()


async def test_half_a_record(gnb: Gnb) -> None:
    for text in (
        "mac_stats: tstamp=17000",
        "mac_stats: tst",
        "",
        "\x00\xff",
        "mac_stats: rnti=4601",
    ):
        gnb.send_text(text)
    gnb.send_text(f"mac_stats: tstamp={time.time_ns() // 1000},rnti=4601,ul_bler=0.5")
    await until(lambda: gnb.states[-1].ul_bler == 0.5, "what the half has")
    assert gnb.states[-1].field_quality["pusch_snr"] == FieldQuality.MISSING
    assert gnb.engine.source is not None
    assert gnb.engine.source.malformed == 4
    await gnb.goes_on()
    assert gnb.states[-1].field_quality["pusch_snr"] == FieldQuality.MEASURED


async def test_wrong_units(gnb: Gnb) -> None:
    """Tenths of dB and per cent."""
    gnb.send(pusch_snr=215.0, ul_bler=5.0)
    await until(lambda: gnb.states[-1].field_quality["pusch_snr"] == FieldQuality.OUT_OF_RANGE)
    assert gnb.states[-1].field_quality["ul_bler"] == FieldQuality.OUT_OF_RANGE
    assert (gnb.states[-1].pusch_snr, gnb.states[-1].ul_bler) == (0.0, 0.0)
    state, detail = gnb.engine.verdict()
    assert state == "degraded"
    assert "a wrong unit?" in detail
    assert "ul_snr_db of 4601" in detail
    await gnb.goes_on()
    await until(lambda: gnb.told("withheld_values") == 2, "the measure")


async def test_no_number(gnb: Gnb) -> None:
    gnb.send(pusch_snr="nan")
    gnb.send(pusch_snr="inf")
    gnb.send(pusch_snr="1e999")
    await until(lambda: gnb.states[-1].field_quality["pusch_snr"] == FieldQuality.OUT_OF_RANGE)
    assert gnb.engine.source is not None
    assert gnb.engine.source.malformed == 2
    await gnb.goes_on()


async def test_an_rnti_that_was_given_to_another_device(gnb: Gnb) -> None:
    session = gnb.states[-1].session
    await gnb.sending(lambda: gnb.states[-1].dl_total_rbs == 10**6, "counters", dl_aggr_prb=10**6)
    assert gnb.states[-1].session == session
    await gnb.sending(lambda: gnb.states[-1].dl_total_rbs == 5, "another device", dl_aggr_prb=5)
    assert gnb.states[-1].session == session + 1
    assert gnb.engine.core.book.ended[-1].newest.values["dl_rbs_total"] == 10**6
    await gnb.goes_on()


@pytest.mark.parametrize("age_s", [-30.0, 30.0, 3600.0, -3600.0])
async def test_a_clock_that_is_set(gnb: Gnb, age_s: float) -> None:
    """The source's clock jumps; its records are used on, in a new session, and the difference is told."""
    session = gnb.states[-1].session
    await gnb.sending(lambda: gnb.states[-1].session > session, "a new session", age_s=age_s)
    came = len(gnb.states)
    await gnb.sending(lambda: len(gnb.states) > came + 30, "further records", age_s=age_s)
    state, detail = gnb.engine.verdict()
    assert state == "degraded"
    assert ("old when they come" if age_s > 0 else "ahead: clocks differ") in detail
    assert gnb.states[-1].session == session + 1
    assert gnb.states[-1].age_s == pytest.approx(age_s, abs=1.0)


async def test_a_source_that_is_down(master: Master) -> None:
    engine, other = RadioInformationEngine(), CrossDomainEngine()
    statuses: list[EngineStatus] = []
    options = source("influx2", url="http://127.0.0.1:9")
    async with user(master) as node:
        await node.subscribe("/wireless_ros/status", EngineStatus, statuses.append)
        async with at_work(other, master), at_work(engine, master, **options):
            await until(lambda: any("not answer" in status.detail for status in statuses))
            told = [status for status in statuses if "not answer" in status.detail]
            assert told[-1].state == "degraded"
            await until(lambda: statuses[-1].measures.get("source_failures", 0) >= 2, "new tries")


class Broken(MetricsSource):
    summary = "breaks"

    async def run(self, emit: Any) -> None:
        raise RuntimeError("a mistake of a plug-in")

    async def discover(self) -> frozenset[str]:
        raise RuntimeError("another one")


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def make(name: str, options: Any) -> MetricsSource:
        return Broken()

    monkeypatch.setattr("simple_ros_engines.radio_information.node.make_source", make)
    return


async def test_a_source_with_a_mistake_in_it(
    master: Master, broken: None, caplog: pytest.LogCaptureFixture
) -> None:
    engine = RadioInformationEngine()
    async with at_work(engine, master):
        await until(lambda: engine.state == "degraded", "the mistake")
        assert engine.detail == "RuntimeError: a mistake of a plug-in"
        await until(lambda: engine.errors >= 3, "another try")
    assert "a mistake of a plug-in" in caplog.text


async def test_no_number_in_a_recording(master: Master, tmp_path: Path) -> None:
    values = '{"link": "a", "stamp_ns": 1, "values": {"rtt_ms": NaN, "cqi": 9}}'
    file = tmp_path / "records.jsonl"
    file.write_text(f"{values}\n{json.dumps({'link': 'a'})}\n")
    engine = RadioInformationEngine()
    states: list[ChannelState] = []
    async with user(master) as node:
        await node.subscribe("/wireless_ros/channel_state", ChannelState, states.append)
        async with at_work(engine, master, **source("replay", path=str(file), speed=0)):
            await until(lambda: states, "the record")
            await until(lambda: "ended" in engine.detail, "its end")
    assert states[0].cqi == 9
    assert states[0].field_quality["rtt_ms"] == FieldQuality.OUT_OF_RANGE
