"""Verdicts on clocks, limits and devices."""

from dataclasses import replace

import pytest

from simple_ros.doctor.findings import Finding, Level
from simple_ros.doctor.judge_host import (
    ChronyTracking,
    Clock,
    Host,
    SerialPort,
    judge_clock,
    judge_host,
    parse_chrony_tracking,
)

CHRONY = ChronyTracking("ntp.example", 3, 0.0002, 0.004, is_synchronised=True)
TRACKING = (
    "C0248F97,ntp.example,3,1767225600.123,0.000012300,-0.000004,0.000021,"
    "-1.234,0.001,0.020,0.010000000,0.000500000,64.2,Normal\n"
)
MIB = 1 << 20


def texts(findings: list[Finding], level: Level = Level.WARNING) -> list[str]:
    return [found.text for found in findings if found.level is level]


class TestClock:
    def test_chrony_has_the_first_word(self):
        assert texts(judge_clock(Clock(2027, kernel=False, chrony=CHRONY))) == []

    @pytest.mark.parametrize(
        ("chrony", "text"),
        [
            (replace(CHRONY, is_synchronised=False), "no time source"),
            (replace(CHRONY, offset_s=-0.5), "-500.000 ms from ntp.example"),
        ],
    )
    def test_chrony_that_is_off(self, chrony, text):
        assert text in texts(judge_clock(Clock(2027, kernel=True, chrony=chrony)))[0]

    @pytest.mark.parametrize(
        ("kernel", "timedatectl", "is_good"),
        [(True, None, True), (False, True, True), (False, False, False), (None, None, False)],
    )
    def test_without_chrony(self, kernel, timedatectl, is_good):
        findings = judge_clock(Clock(2027, kernel=kernel, timedatectl=timedatectl))
        assert (texts(findings) == []) is is_good

    def test_never_set(self):
        assert "year 1970" in texts(judge_clock(Clock(1970, kernel=True)))[0]

    @pytest.mark.parametrize(("jump_s", "count"), [(0.001, 0), (-3600.0, 1), (0.5, 1)])
    def test_jumps(self, jump_s, count):
        assert len(texts(judge_clock(Clock(2027, kernel=True, jump_s=jump_s)))) == count

    @pytest.mark.parametrize(
        ("is_local", "text"),
        [(True, "one clock"), (False, "cannot be measured"), (None, "not known")],
    )
    def test_against_the_master(self, is_local, text):
        findings = judge_clock(Clock(2027, kernel=True, is_master_local=is_local))
        assert text in findings[1].text
        assert findings[1].level is Level.OK

    def test_tracking_of_chrony(self):
        assert parse_chrony_tracking(TRACKING) == ChronyTracking(
            "ntp.example", 3, 0.0000123, 0.0055, is_synchronised=True
        )
        lost = TRACKING.replace("Normal", "Not synchronised").replace("ntp.example", "")
        assert parse_chrony_tracking(lost) == ChronyTracking(
            "C0248F97", 3, 0.0000123, 0.0055, is_synchronised=False
        )

    @pytest.mark.parametrize(
        "text", ["", "506 Cannot talk to daemon", "a,b,c,d,e,f,g,h,i,j,k,l,m,n"]
    )
    def test_what_is_no_tracking(self, text):
        assert parse_chrony_tracking(text) is None


class TestHost:
    def test_a_host_that_tells_nothing(self):
        assert judge_host(Host()) == []

    def test_a_good_host(self):
        found = Host(
            (1024, 65536),
            (6 * MIB, 4 * MIB),
            (MIB // 4, MIB // 4),
            (1024 * MIB, 900 * MIB),
            (("schedutil", "cpufreq-dt"), ("powersave", "intel_pstate")),
            (SerialPort("/dev/ttyACM0", "dialout", is_allowed=True),),
        )
        assert texts(judge_host(found)) == []

    @pytest.mark.parametrize(
        ("files", "links", "text"),
        [
            ((256, 4096), 0, "a process may have 256; each link"),
            ((1024, 4096), 2000, "node hub has 2000 links"),
        ],
    )
    def test_few_files(self, files, links, text):
        (found,) = judge_host(Host(open_files=files), ("hub", links))
        assert text in found.text
        assert "'ulimit -n 4096'" in found.fix

    def test_no_limit_of_files(self):
        (found,) = judge_host(Host(open_files=(-1, -1)), ("hub", 5000))
        assert (found.level, found.text) == (Level.OK, "no limit")

    @pytest.mark.parametrize(
        ("found", "text"),
        [
            (Host(tcp_buffers=(MIB // 2, 4 * MIB)), "0.5 MiB for receiving"),
            (Host(shared_memory=(16 * MIB, 16 * MIB)), "16 MiB of 16 MiB free"),
            (Host(shared_memory=(1024 * MIB, MIB)), "1 MiB of 1 GiB free"),
            (Host(governors=(("powersave", "acpi-cpufreq"),)), "wakes slowly"),
            (
                Host(serial_ports=(SerialPort("/dev/ttyACM0", "dialout", is_allowed=False),)),
                "/dev/ttyACM0 may not be used",
            ),
        ],
    )
    def test_warnings(self, found, text):
        (warning,) = judge_host(found)
        assert warning.level is Level.WARNING
        assert text in warning.text
        assert warning.fix
