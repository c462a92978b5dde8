"""Each source of metrics at work in the engine, over the transport it really uses.

Radios are not at hand: programs, gNBs and modems are stand-ins that say what theirs are documented to say.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import pty
import socket
import threading
import time
import tty
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import pytest
from support.engines import at_work, source, user
from support.waiting import until

from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.std_msgs import Float32, String
from simple_ros.msg.wireless_ros_msgs import (
    ChannelState,
    EngineStatus,
    FieldQuality,
    GetLinkHistory,
    GetLinkHistoryRequest,
    PhyLayerMetrics,
    SpectrumAnalysis,
)
from simple_ros_engines.cross_domain.node import CrossDomainEngine
from simple_ros_engines.heartbeat import HeartbeatEcho
from simple_ros_engines.radio_information.node import RadioInformationEngine
from simple_ros_engines.radio_information.observers import observe_channels
from simple_ros_engines.radio_information.sources.flexric import FlexricSource
from simple_ros_master import Master


def program(folder: Path, name: str, text: str) -> None:
    """A program of that name that does what ``text``, a shell script, says."""
    file = folder / f"{name}.new"
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o755)
    # At once: somebody may be about to run the former one.
    file.replace(folder / name)


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder whose programs are found first."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    return folder


async def test_wifi_by_iw(master: Master, programs: Path) -> None:
    program(
        programs,
        "iw",
        """case "$3" in station) cat <<END
Station 02:00:00:00:01:00 (on wlan0)
	rx bytes:	30100
	tx bytes:	2000
	tx packets:	100
	tx failed:	1
	signal:  	-61 [-63, -64] dBm
	signal avg:	-60 dBm
	tx bitrate:	144.4 MBit/s MCS 15 short GI
END
;; survey) cat <<END
Survey data from wlan0
	frequency:			2437 MHz [in use]
	noise:				-95 dBm
END
;; esac""",
    )
    engine = RadioInformationEngine()
    async with at_work(engine, master, **source("wifi", period_s=0.05)):
        await until(lambda: "wlan0/02:00:00:00:01:00" in engine.newest, "the station")
        assert engine.newest["wlan0/02:00:00:00:01:00"][0].snr_db == 35.0
        program(programs, "iw", "exit 237")
        await until(lambda: engine.state == "degraded", "the missing interface")
        assert "neither iw nor" in engine.detail or "no Wi-Fi interface" in engine.detail


async def test_wifi_without_iw(master: Master, programs: Path, tmp_path: Path) -> None:
    program(programs, "iw", "exit 237")
    file = tmp_path / "wireless"
    file.write_text(
        "Inter-| sta-|   Quality        |   Discarded packets               | Missed | WE\n"
        " face | tus | link level noise |  nwid  crypt   frag  retry   misc | beacon | 22\n"
        " wlan0: 0000   54.  -56.  -95        0      0      0      0     10        0\n"
    )
    engine = RadioInformationEngine()
    options = source("wifi", period_s=0.05, proc=str(file))
    async with at_work(engine, master, **options):
        await until(lambda: "wlan0" in engine.newest, "the interface")
        assert engine.newest["wlan0"][0].snr_db == 39.0


async def test_modemmanager(master: Master, programs: Path) -> None:
    program(
        programs,
        "mmcli",
        """[ "$2" = 3 ] || exit 1
case "$3" in --signal-get) cat <<END
modem.signal.refresh.rate : 1
modem.signal.lte.rssi     : --
modem.signal.5g.rsrq      : -11.00
modem.signal.5g.rsrp      : -95.00
modem.signal.5g.snr       : 14.50
END
esac""",
    )
    engine, other = RadioInformationEngine(), RadioInformationEngine()
    async with at_work(engine, master, **source("modemmanager", modem=3)):
        await until(lambda: "modem3" in engine.newest, "the modem")
        assert engine.newest["modem3"][0].snr_db == 14.5
    async with at_work(other, master, **source("modemmanager", modem=4)):
        await until(lambda: other.state == "degraded", "no modem")
        assert other.detail == "mmcli does not know modem 4"


SA = (
    '+QENG: "servingcell","NOCONN","NR5G-SA","TDD",262,01,1234ABCD,12,AB12,632448,78,12,'
    "-88,-10,21,0,30,1"
)


class Modem:
    """The modem's end of a serial line; answers each command by a script."""

    def __init__(self, answer: Callable[[str], str]) -> None:
        self._master, follower = pty.openpty()
        tty.setraw(follower)
        self.port = os.ttyname(follower)
        self.heard: list[str] = []
        self._answer = answer
        self._follower = follower
        self._thread = threading.Thread(target=self._talk, daemon=True)
        self._thread.start()

    def _talk(self) -> None:
        buffer = b""
        with contextlib.suppress(OSError):
            while True:
                buffer += os.read(self._master, 100)
                *commands, buffer = buffer.split(b"\r")
                for command in commands:
                    self.heard.append(command.decode())
                    os.write(self._master, self._answer(command.decode()).encode())

    def vanish(self) -> None:
        """As when the plug is drawn."""
        for end in (self._follower, self._master):
            with contextlib.suppress(OSError):
                os.close(end)


@contextmanager
def modem(answer: Callable[[str], str]) -> Iterator[Modem]:
    made = Modem(answer)
    try:
        yield made
    finally:
        made.vanish()


async def test_a_quectel_modem_on_its_serial_port(master: Master) -> None:
    def answer(command: str) -> str:
        # It echoes, says things unasked, and cuts lines where it likes.
        said = f'{SA}\r\n\r\n+QIND: "csq",31,99\r\n' if "QENG" in command else ""
        return f"{command}\r\r\n{said}\r\nOK\r\n"

    engine = RadioInformationEngine()
    with modem(answer) as device:
        options = source("quectel", port=device.port, period_s=0.05, link="uplink")
        async with at_work(engine, master, **options):
            await until(lambda: "uplink" in engine.newest, "the cell")
            assert device.heard[:2] == ["ATE0", 'AT+QENG="servingcell"']
            assert engine.newest["uplink"][0].snr_db == 21.0
            before = len(device.heard)
            await until(lambda: len(device.heard) > before + 2, "further questions")
            device.vanish()
            await until(lambda: engine.state == "degraded", "the drawn plug")
            assert device.port in engine.detail


async def test_a_quectel_modem_that_refuses(master: Master) -> None:
    def answer(command: str) -> str:
        return "\r\n+CME ERROR: 10\r\n" if "QENG" in command else "\r\nOK\r\n"

    engine = RadioInformationEngine()
    with modem(answer) as device:
        async with at_work(engine, master, **source("quectel", port=device.port)):
            await until(lambda: engine.state == "degraded", "the refusal")
            assert engine.detail == f"the modem at {device.port} says +CME ERROR: 10"


async def test_no_serial_port(master: Master, tmp_path: Path) -> None:
    engine = RadioInformationEngine()
    async with at_work(engine, master, **source("quectel", port=str(tmp_path / "ttyUSB9"))):
        await until(lambda: engine.state == "degraded", "no port")
        assert "cannot be opened" in engine.detail


OAI = """\
UE RNTI {rnti} CU-UE-ID 1 in-sync PH 48 dB PCMAX 21 dBm, average RSRP -84 (16 meas)
UE {rnti}: CQI 15, RI 2, PMI (14,1)
UE {rnti}: dlsch_rounds 5500/12/1/0, dlsch_errors 0, pucch0_DTX 2, BLER 0.00512 MCS (1) 27
UE {rnti}: ulsch_rounds 9000/30/2/0, ulsch_errors 1, ulsch_DTX 0, BLER 0.01250 MCS (1) 9
"""


async def test_the_statistics_file_of_openairinterface(master: Master, tmp_path: Path) -> None:
    file = tmp_path / "nrMAC_stats.log"
    engine = RadioInformationEngine()
    options = source("oai-stats", path=str(file), period_s=0.02)
    async with user(master) as node:
        states: list[ChannelState] = []
        await node.subscribe("/wireless_ros/channel_state", ChannelState, states.append)
        async with at_work(engine, master, **options):
            await until(lambda: engine.state == "degraded", "no file")
            file.write_text(OAI.format(rnti="4601"))
            await until(lambda: states, "the device")
            assert (states[0].rnti, states[0].dl_mcs, states[0].avg_rsrp) == (0x4601, 27, -84)
            # The gNB is about to write: half of the file is there.
            file.write_text(OAI.format(rnti="a0b1")[:90])
            await until(lambda: states[-1].rnti == 0xA0B1, "half a device")
            assert states[-1].avg_rsrp == -84
            assert "dl_bler" not in states[-1].field_quality


async def test_flexric_sends_datagrams(master: Master) -> None:
    engine = RadioInformationEngine()
    async with at_work(engine, master, **source("flexric", port=0, period_s=0.05)):
        await until(lambda: isinstance(engine.source, FlexricSource) and engine.source.port)
        assert isinstance(engine.source, FlexricSource)
        stamp_us = time.time_ns() // 1000

        def line(back_us: int, snr: float) -> str:
            return f"mac_stats: tstamp={stamp_us - back_us},pusch_snr={snr},ul_mcs1=12,rnti=4601"

        place = ("127.0.0.1", engine.source.port)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for text in (
                line(200_000, 20.0),
                line(190_000, 1.0),
                "rlc_stats: tstamp=1,rnti=4601,x=1",
                "half a li",
                f"mac_stats: tstamp={stamp_us},pusch_snr=3",
                line(100_000, 22.0),
            ):
                sender.sendto(text.encode(), place)
            await until(lambda: engine.processed == 2, "two lines that are due")
        assert engine.newest["4601"][0].snr_db == 22.0
        assert engine.source.malformed == 2
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with taken:
        taken.bind(("127.0.0.1", 0))
        again = RadioInformationEngine()
        async with at_work(again, master, **source("flexric", port=taken.getsockname()[1])):
            await until(lambda: again.state == "degraded", "the taken port")
            assert "cannot listen" in again.detail


@asynccontextmanager
async def http_server(answer: Callable[[str, bytes], tuple[int, str]]) -> AsyncIterator[int]:
    """Answers each request by its head and body; gives the port."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        length = [line for line in head.splitlines() if line.lower().startswith("content-length")]
        body = await reader.readexactly(int(length[0].split(":")[1])) if length else b""
        status, text = answer(head, body)
        writer.write(
            f"HTTP/1.1 {status} X\r\nContent-Length: {len(text.encode())}\r\n"
            f"Connection: close\r\n\r\n{text}".encode()
        )
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        yield server.sockets[0].getsockname()[1]


async def test_influxdb_3_is_asked_by_sql(master: Master) -> None:
    """The form of the answer is that of InfluxDB 3's documentation: JSON lines, times in UTC without a zone."""
    asked: list[tuple[str, dict[str, str]]] = []
    is_there = True

    def answer(head: str, body: bytes) -> tuple[int, str]:
        asked.append((head, json.loads(body)))
        if not is_there:
            return 404, '{"error": "database not found"}'
        now = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime())
        row = {"time": f"{now}.123456789", "rnti": "17921", "pci": "1", "newest_first": 1}
        fields = {"pusch_snr_db": 21.5, "ul_nof_ok": 90, "ul_nof_nok": 10, "ul_mcs": 9}
        return 200, f"{json.dumps({**row, **fields})}\nhalf a li"

    engine = RadioInformationEngine()
    async with http_server(answer) as port:
        options = source(
            "influx3", url=f"http://127.0.0.1:{port}", database='my "db"', token="t", period_s=0.02
        )
        async with at_work(engine, master, **options):
            await until(lambda: "4601" in engine.newest, "the row")
            metrics = engine.newest["4601"][0]
            assert (metrics.snr_db, metrics.bler) == (21.5, pytest.approx(0.1))
            assert engine.source is not None
            assert engine.source.malformed
            await until(lambda: engine.discovered == {"4601"}, "the devices of the last minute")
            is_there = False
            await until(lambda: engine.state == "degraded", "the refusal")
            assert "404" in engine.detail
            assert "database not found" in engine.detail
    head, body = asked[0]
    assert head.startswith("POST /api/v3/query_sql ")
    assert "Authorization: Bearer t" in head
    assert body["db"] == 'my "db"'
    assert 'PARTITION BY "rnti"' in body["q"]


async def test_heartbeats_come_back_from_other_hosts(master: Master) -> None:
    """Engines of one host stand for two hosts."""
    engine = RadioInformationEngine()
    states: list[ChannelState] = []
    async with user(master) as node:
        await node.subscribe("/wireless_ros/channel_state", ChannelState, states.append)
        async with (
            at_work(HeartbeatEcho(), master),
            at_work(engine, master, **source("transport", loopback=True, period_s=0.05)),
        ):
            await until(lambda: any(state.echo_rtt_ms for state in states), "an echo")
    echoed = [state for state in states if state.echo_rtt_ms]
    assert echoed[-1].link_id == "127.0.0.1"
    assert 0 < echoed[-1].echo_rtt_ms < 5000
    assert echoed[-1].field_quality["echo_rtt_ms"] == FieldQuality.MEASURED


async def test_histories_and_observers(master: Master, tmp_path: Path) -> None:
    """A gap of two samples in a recording is filled by a line, and said so."""
    lines = [
        json.dumps({"link": "4601", "stamp_ns": at * 10**8, "values": {"rtt_ms": 10.0 * at}})
        for at in (1, 2, 5)
    ]
    file = tmp_path / "records.jsonl"
    file.write_text("\n".join(lines))
    engine = RadioInformationEngine()
    seen: list[ChannelState] = []
    near: list[ChannelState] = []

    class Watcher:
        def __init__(self, states: list[ChannelState]) -> None:
            self._states = states

        def on_channel_update(self, state: ChannelState) -> None:
            self._states.append(state)

    engine.observers.register_observer(Watcher(near))
    async with user(master) as node:
        await observe_channels(node, Watcher(seen), "4601")
        options = source("replay", path=str(file), speed=0)
        async with at_work(engine, master, interpolate=5, **options):
            await until(lambda: len(seen) == 3, "all records")
            client = node.service_client("/wireless_ros/get_link_history", GetLinkHistory)
            found = await client.call(GetLinkHistoryRequest(rnti=0x4601, field="rtt_ms"))
            assert list(found.values) == pytest.approx([10, 20, 30, 40, 50])
            assert list(found.interpolated) == [False, False, True, True, False]
            wrong = await client.call(GetLinkHistoryRequest(rnti=0x4601, field="rtt"))
            assert "rtt_ms" in wrong.message
            missing = await client.call(GetLinkHistoryRequest(rnti=7, field="rtt_ms"))
            assert missing.message == "no such link; there are: 4601"
    assert [state.link_id for state in near] == ["4601"] * 3


async def test_status_tells_times_flows_and_measures(master: Master) -> None:
    engine = RadioInformationEngine()
    statuses: list[EngineStatus] = []
    async with user(master) as node:
        await node.subscribe("/wireless_ros/status", EngineStatus, statuses.append)
        async with at_work(engine, master, **source("synthetic", links=2, period_s=0.02)):
            await until(lambda: statuses and statuses[-1].processed > 20, "some work")
    status = statuses[-1]
    assert sum(status.processing.counts) == status.processed
    assert 0 < status.processing_ms_p50 <= status.processing_ms_p99
    assert (status.state, status.links, status.inactive_links) == ("active", 2, 0)
    assert (status.kind, status.pid) == ("engine", os.getpid())
    assert status.memory_bytes > 10**7
    assert status.measures["withheld_values"] == 0
    assert 0 <= status.measures["bandwidth_accuracy"] <= 1


async def test_gaps_and_duplicates_are_counted_by_topic(master: Master) -> None:
    statuses: list[EngineStatus] = []
    engine = CrossDomainEngine()
    async with user(master) as node, at_work(engine, master):
        await node.subscribe("/wireless_ros/status", EngineStatus, statuses.append)
        metrics = await node.advertise("/wireless_ros/phy_layer_metrics", PhyLayerMetrics)
        await metrics.wait_for_subscribers(1, timeout=30)
        for number in (0, 1, 1, 4):
            message = PhyLayerMetrics(link_id="4601", link_quality=0.8)
            message.header.seq = number
            message.header.stamp.FromNanoseconds(number)
            metrics.publish(message)
        await until(lambda: statuses and statuses[-1].inputs[0].received == 4, "all messages")
    flow = statuses[-1].inputs[0]
    assert flow.topic == "/wireless_ros/phy_layer_metrics"
    assert (flow.gaps, flow.duplicates) == (2, 1)
    assert engine.processed == 3


async def test_zones_are_where_the_robot_is_and_shares_add_up(
    master: Master, tmp_path: Path
) -> None:
    values = {"ul_bler": 0.3, "ul_mcs": 4, "ul_snr_db": 2.0, "prb_used": 10, "prb_total": 50}
    lines = [
        json.dumps({"link": link, "stamp_ns": at * 10**7, "values": values})
        for at in range(1, 4)
        for link in ("4601", "4602")
    ]
    file = tmp_path / "records.jsonl"
    file.write_text("\n".join(lines))
    zones: list[str] = []
    own: list[float] = []
    carrier: list[float] = []
    spectra: list[SpectrumAnalysis] = []
    async with user(master) as node:
        listen = node.subscribe
        topics = "/wireless_ros"
        await listen(f"{topics}/interference_zone", String, lambda m: zones.append(m.data))
        await listen(f"{topics}/prb_utilization", Float32, lambda m: own.append(m.data))
        await listen(f"{topics}/resource_utilization", Float32, lambda m: carrier.append(m.data))
        await listen(f"{topics}/spectrum_analysis", SpectrumAnalysis, spectra.append)
        options = source("replay", path=str(file), restamp=True, loop=True)
        async with at_work(RadioInformationEngine(), master, link="4602", **options):
            poses = await node.advertise("/robot/pose", PoseStamped)
            await poses.wait_for_subscribers(1, timeout=30)
            pose = PoseStamped()
            pose.header.frame_id = "map"
            pose.pose.position.x, pose.pose.position.y = 3.0, -1.5
            poses.publish(pose)
            await until(lambda: any("4602" in zone and "at" in zone for zone in zones), "the place")
            await until(lambda: own and carrier and carrier[-1] > 0.3, "both shares")
    assert zones[-1] in (
        "4602: POOR_CHANNEL_ZONE at 3.00 -1.50 in map",
        "4601: POOR_CHANNEL_ZONE",
    )
    assert {round(share, 3) for share in own} == {0.2}
    assert carrier[-1] == pytest.approx(0.4)
    placed = [item for item in spectra if item.position_known]
    assert {item.link_id for item in placed} == {"4602"}
    assert (placed[-1].position.x, placed[-1].frame_id) == (3.0, "map")


async def test_options_are_parameters_too(master: Master) -> None:
    engine = RadioInformationEngine()
    options = {"synthetic/links": 3, "synthetic/period_s": 0.02}
    async with at_work(engine, master, source="synthetic", **options) as node:
        await until(lambda: len(engine.newest) == 3, "three links")
        assert await node.get_parameter("~synthetic/seed") == 1
        assert engine.source is not None
        assert engine.source.period_s == 0.02
