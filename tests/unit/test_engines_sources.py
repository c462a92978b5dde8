"""What sources read, on recorded and documented texts."""

from __future__ import annotations

import json
import socket
import struct

import pytest

from simple_ros.errors import ConfigError
from simple_ros_engines.radio_information.record import Quality, record
from simple_ros_engines.radio_information.sources.field_maps import PRESETS, preset, read_fields
from simple_ros_engines.radio_information.sources.modem_text import (
    parse_mmcli_signal,
    parse_oai_stats,
    parse_qeng,
)
from simple_ros_engines.radio_information.sources.record_json import (
    BadRecord,
    from_json,
    to_json,
)
from simple_ros_engines.radio_information.sources.srsran import parse_metrics
from simple_ros_engines.radio_information.sources.tcp_diag import (
    TcpConnection,
    parse_answers,
    request,
)
from simple_ros_engines.radio_information.sources.transport import link_records
from simple_ros_engines.radio_information.sources.wifi_text import (
    parse_proc_wireless,
    parse_station_dump,
    parse_survey_noise,
)

NOW = 1_700_000_000_000_000_000

STATION = """\
Station 02:00:00:00:01:00 (on wlan0)
\tinactive time:\t12 ms
\trx bytes:\t30100
\ttx bytes:\t2000
\ttx packets:\t{sent}
\ttx retries:\t4
\ttx failed:\t{failed}
\tsignal:  \t-61 [-63, -64] dBm
\tsignal avg:\t-60 dBm
\ttx bitrate:\t144.4 MBit/s MCS 15 short GI
\texpected throughput:\t46.875Mbps
Station 02:00:00:00:02:00 (on wlan0)
\tsignal:  \t-80 dBm
"""
SURVEY = """\
Survey data from wlan0
\tfrequency:\t\t\t2412 MHz
\tnoise:\t\t\t\t-88 dBm
Survey data from wlan0
\tfrequency:\t\t\t2437 MHz [in use]
\tnoise:\t\t\t\t-95 dBm
"""
PROC = """\
Inter-| sta-|   Quality        |   Discarded packets               | Missed | WE
 face | tus | link level noise |  nwid  crypt   frag  retry   misc | beacon | 22
 wlan0: 0000   54.  -56.  -256        0      0      0      0     10        0
"""


class TestFieldMaps:
    def test_the_gnb_of_wirelessros_has_units_of_its_own(self):
        raw = {"snr_pusch": 215.0, "DL_Thr": 12.5, "raw_rssi": 680.0, "dl_bler": 0.05, "junk": 1.0}
        found = read_fields(PRESETS["wirelessros_oai"], "4601", NOW, "store", raw)
        assert found is not None
        assert found.rnti == 0x4601
        assert dict(found.values) == {
            "ul_snr_db": pytest.approx(21.5),
            "dl_thr_bps": 12.5e6,
            "rssi_dbm": pytest.approx(-60.0),
            "dl_bler": 0.05,
        }

    def test_srsran_tells_blocks_and_no_error_rate(self):
        raw = {"dl_nof_ok": 90, "dl_nof_nok": 10, "ul_nof_ok": 0, "ul_nof_nok": 0, "cqi": 15}
        found = read_fields(PRESETS["srsran"], "17921", NOW, "srsran", raw)
        assert found is not None
        assert found.link_id == "4601"
        assert found.values["dl_bler"] == pytest.approx(0.1)
        assert found.quality_of("dl_bler") is Quality.DERIVED
        assert "ul_bler" not in found.values

    def test_no_rnti(self):
        assert read_fields(PRESETS["srsran"], "4a", NOW, "x", {}) is None
        with pytest.raises(ConfigError, match="flexric_mac"):
            preset("nokia")


class TestSrsran:
    def test_a_message(self):
        device = {"rnti": 17921, "pusch_snr_db": 22.5, "ul_mcs": 20, "dl_brate": 1e6}
        text = json.dumps({"timestamp": 1.0, "cells": [{"cell_metrics": {}, "ue_list": [device]}]})
        (found,) = parse_metrics(text, NOW)
        assert found is not None
        assert found.values["ul_snr_db"] == 22.5

    @pytest.mark.parametrize(
        ("text", "count"),
        [("nonsense", 1), ("[]", 0), ('{"cells": 3}', 0), ('{"cells": [{"ue_list": [5]}]}', 1),
         ('{"cells": [null, {"ue_list": [{}]}]}', 1)],
    )  # fmt: skip
    def test_what_is_none(self, text, count):
        assert list(parse_metrics(text, NOW)) == [None] * count


class TestWifi:
    def test_stations(self):
        noise = parse_survey_noise(SURVEY)
        assert noise == -95.0
        records, counts = parse_station_dump(STATION.format(sent=100, failed=1), NOW, noise)
        first, second = records
        assert first.link_id == "wlan0/02:00:00:00:01:00"
        assert first.values["rssi_dbm"] == -60.0
        assert first.values["dl_sinr_db"] == 35.0
        assert first.values["phy_rate_bps"] == pytest.approx(144.4e6)
        assert first.values["delivery_bps"] == pytest.approx(46.875e6)
        assert "loss" not in first.values
        assert dict(second.values) == {"rssi_dbm": -80.0, "noise_dbm": -95.0, "dl_sinr_db": 15.0}
        later, _ = parse_station_dump(STATION.format(sent=200, failed=11), NOW, noise, counts)
        assert later[0].values["loss"] == pytest.approx(0.1)

    def test_proc(self):
        (found,) = parse_proc_wireless(PROC, NOW)
        assert found.link_id == "wlan0"
        assert dict(found.values) == {"rssi_dbm": -56.0}

    def test_nothing(self):
        assert parse_station_dump("", NOW) == ([], {})
        assert parse_survey_noise("") is None
        assert parse_proc_wireless("", NOW) == []


class TestTcpDiag:
    def answer(self, rtt_us: int, kind: int = 20) -> bytes:
        info = bytearray(168)
        struct.pack_into("=I", info, 8 + 15 * 4, rtt_us)
        struct.pack_into("=I", info, 8 + 23 * 4, 3)
        struct.pack_into("=I", info, 148, 900)
        struct.pack_into("=I", info, 156, 1000)
        struct.pack_into("=Q", info, 160, 125_000)
        attribute = struct.pack("=HH", 4 + len(info), 2) + bytes(info)
        body = bytearray(72)
        body[0] = socket.AF_INET
        struct.pack_into(">HH", body, 4, 5000, 6000)
        body[24:28] = socket.inet_aton("10.0.0.7")
        struct.pack_into("=II", body, 56, 0, 4321)
        whole = bytes(body) + attribute
        return struct.pack("=IHHII", 16 + len(whole), kind, 0, 1, 0) + whole

    def test_an_answer(self):
        done = struct.pack("=IHHII", 16, 3, 0, 1, 0)
        (found,), end = parse_answers(self.answer(20_000) + done)
        assert end
        assert found == TcpConnection(5000, "10.0.0.7", 6000, 20.0, 0.0, 0.9, 1e6, 3, 1000, 4321)

    @pytest.mark.parametrize("cut", [0, 5, 16, 40, 90])
    def test_half_an_answer(self, cut):
        assert parse_answers(self.answer(1)[:cut]) == ([], False)

    def test_the_question(self):
        assert len(request(socket.AF_INET)) == 72

    def test_records_by_peer(self):
        slow = TcpConnection(1, "10.0.0.7", 80, 50.0, 5.0, 40.0, 1e6, 0, 10, 100)
        busy = TcpConnection(2, "10.0.0.7", 80, 20.0, 2.0, 18.0, 2e6, 10, 200, 50)
        _, before = link_records([slow, busy], {}, NOW)
        later = TcpConnection(2, "10.0.0.7", 80, 22.0, 2.0, 18.0, 2e6, 20, 300, 50)
        (found,), _ = link_records([slow, later], before, NOW)
        assert found.link_id == "10.0.0.7"
        assert found.values["rtt_ms"] == 22.0
        assert found.values["min_rtt_ms"] == 18.0
        assert found.values["loss"] == pytest.approx(0.1)
        assert found.values["delivery_bps"] == 3e6
        assert found.values["buffer_bytes"] == 150


class TestRecordLines:
    def test_there_and_back(self):
        item = record("4601", NOW, "test", {"cqi": 3, "ul_bler": 7.0}, rnti=0x4601)
        again = from_json(to_json(item))
        assert again == item

    def test_simulated_stays_simulated(self):
        item = record("a", NOW, "synthetic", {"cqi": 3}, quality=Quality.SIMULATED)
        assert from_json(to_json(item)).quality_of("cqi") is Quality.SIMULATED

    @pytest.mark.parametrize(
        "line",
        ["", "{}", "[1]", '{"link": "a", "stamp_ns": "x", "values": {}}',
         '{"link": "a", "stamp_ns": 1, "values": {"cqi": "many"}}',
         '{"link": "a", "stamp_ns": 1e999, "values": {}}',
         '{"link": "a", "stamp_ns": 1, "values": {}, "quality": {"cqi": "fine"}}',
         '{"link": "a", "stamp_ns": 1, "values": {}, "quality": ["cqi"]}',
         '{"link": "a", "stamp_ns": 1, "values": {}, "rnti": "x"}',
         '{"link": "a", "stamp_ns": 1, "values": {}, "rnti": -4}',
         '{"link": "", "stamp_ns": 1, "values": {}}', "[" * 100_000,
         '{"link": "a", "stamp_ns": 99999999999999999999, "values": {}}'],
    )  # fmt: skip
    def test_what_is_none(self, line):
        with pytest.raises(BadRecord):
            from_json(line)


MMCLI = """\
modem.signal.refresh.rate : 1
modem.signal.lte.rssi     : --
modem.signal.lte.rsrp     : -101.00
modem.signal.5g.rsrq      : -11.00
modem.signal.5g.rsrp      : -95.00
modem.signal.5g.snr       : 14.50
"""
SA = (
    '+QENG: "servingcell","NOCONN","NR5G-SA","TDD",262,01,1234ABCD,12,AB12,632448,78,12,'
    "-88,-10,21,0,30,1"
)
NSA = """\
+QENG: "servingcell","NOCONN"
+QENG: "LTE","FDD",262,01,1A2B3C,301,1300,3,5,5,54F0,-97,-12,-65,13,12,120,-
+QENG: "NR5G-NSA",262,01,500,-101,9,-11,632448,78,12,1
"""
OAI = """\
UE RNTI 4601 CU-UE-ID 1 in-sync PH 48 dB PCMAX 21 dBm, average RSRP -84 (16 meas)
UE 4601: CQI 15, RI 2, PMI (14,1)
UE 4601: dlsch_rounds 5500/12/1/0, dlsch_errors 0, pucch0_DTX 2, BLER 0.00512 MCS (1) 27
UE 4601: ulsch_rounds 9000/30/2/0, ulsch_errors 1, ulsch_DTX 0, BLER 0.01250 MCS (1) 9
UE 4601: MAC:    TX     123456 RX      65432 bytes
UE RNTI a0b1 CU-UE-ID 2 out-of-sync PH 0 dB PCMAX 0 dBm, average RSRP 0 (0 meas)
"""


class TestModems:
    def test_modemmanager(self):
        found = parse_mmcli_signal(MMCLI, NOW, "modem0")
        assert found is not None
        assert dict(found.values) == {"rsrq_db": -11.0, "rsrp_dbm": -95.0, "dl_sinr_db": 14.5}
        lte = parse_mmcli_signal(MMCLI.replace(".5g.", ".umts."), NOW, "modem0")
        assert lte is not None
        assert dict(lte.values) == {"rsrp_dbm": -101.0}
        assert parse_mmcli_signal("error", NOW, "modem0") is None

    def test_standalone(self):
        (found,) = parse_qeng(SA, NOW, "modem0")
        assert dict(found.values) == {"rsrp_dbm": -88.0, "rsrq_db": -10.0, "dl_sinr_db": 21.0}

    def test_not_standalone(self):
        nr, lte = parse_qeng(NSA, NOW, "modem0")
        assert dict(nr.values) == {"rsrp_dbm": -101.0, "dl_sinr_db": 9.0, "rsrq_db": -11.0}
        assert lte.values["rssi_dbm"] == -65.0

    def test_another_order_of_fields_is_seen(self):
        (found,) = parse_qeng(SA.replace("-88,-10,21", "632448,-88,-10"), NOW, "modem0")
        assert "rsrp_dbm" in found.suspects()
        assert parse_qeng('+QENG: "servingcell","SEARCH"', NOW, "x") == []

    def test_openairinterface(self):
        first, second = parse_oai_stats(OAI, NOW)
        assert first.link_id == "4601"
        assert first.values["rsrp_dbm"] == -84
        assert (first.values["dl_bler"], first.values["dl_mcs"]) == (0.00512, 27)
        assert (first.values["ul_bler"], first.values["ul_mcs"]) == (0.0125, 9)
        assert (first.values["dl_bytes_total"], first.values["ul_bytes_total"]) == (123456, 65432)
        assert (second.link_id, second.values["in_sync"]) == ("a0b1", 0)
