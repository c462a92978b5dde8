"""Verdicts on variables, names, addresses and ports."""

from dataclasses import replace

import pytest

from simple_ros.doctor.findings import Finding, Level
from simple_ros.doctor.judge_network import (
    Environment,
    Listener,
    Network,
    judge_environment,
    judge_network,
    judge_ports,
)

ENVIRONMENT = Environment("localhost:50051", "default")
NETWORK = Network(
    hostname="robot",
    host_addresses=("127.0.1.1",),
    lookup_s=0.001,
    localhost_addresses=("::1", "127.0.0.1"),
    loopback_problem="",
    has_ipv6=True,
    interfaces=(("eth0", "10.0.0.2"), ("wlan0", "10.1.0.2")),
    own_address="10.0.0.2",
    is_master_local=False,
)


def bad(findings: list[Finding]) -> list[tuple[str, Level]]:
    assert all(found.fix for found in findings if found.level is Level.ERROR)
    return [(found.check, found.level) for found in findings if found.level is not Level.OK]


class TestEnvironment:
    def test_nothing_set(self):
        assert bad(judge_environment(ENVIRONMENT)) == []

    def test_no_address(self):
        found = Environment("", "SIMPLE_ROS_MASTER", "'x:y' is not an address")
        (first, *_) = judge_environment(found)
        assert first.text == "SIMPLE_ROS_MASTER: 'x:y' is not an address"
        assert first.level is Level.ERROR

    @pytest.mark.parametrize("name", ["SIMPLEROS_MASTER", "SIMPLE_ROS_MASTR", "SIMPLE_ROS_MASTERS"])
    def test_misspelt(self, name):
        found = replace(ENVIRONMENT, names=(name,))
        assert bad(judge_environment(found)) == [("environment", Level.WARNING)]

    @pytest.mark.parametrize("name", ["SIMPLE_ROS_MASTER", "SIMPLE_ROS_TRANSPORTS", "HOME"])
    def test_well_spelt(self, name):
        assert bad(judge_environment(replace(ENVIRONMENT, names=(name,)))) == []

    def test_of_ros(self):
        findings = judge_environment(replace(ENVIRONMENT, names=("ROS_MASTER_URI",)))
        assert any("ROS 1's" in found.text for found in findings)
        assert bad(findings) == []

    def test_proxies_only_trouble_cpp_nodes(self):
        found = replace(ENVIRONMENT, proxies=("http_proxy",))
        assert bad(judge_environment(found)) == [("proxy", Level.WARNING)]
        assert judge_environment(found)[-1].fix == "export no_grpc_proxy=localhost"
        assert bad(judge_environment(replace(found, is_exempt=True))) == []


class TestNetwork:
    def test_good(self):
        assert bad(judge_network(NETWORK)) == []

    @pytest.mark.parametrize(
        ("changes", "verdict"),
        [
            ({"host_addresses": ()}, ("host name", Level.WARNING)),
            ({"lookup_s": 3.0}, ("host name", Level.WARNING)),
            ({"loopback_problem": "Network is down"}, ("loopback", Level.ERROR)),
            ({"localhost_addresses": ("10.9.9.9",)}, ("loopback", Level.ERROR)),
            ({"own_address": "127.0.0.1"}, ("own address", Level.ERROR)),
            ({"own_address": ""}, ("own address", Level.WARNING)),
        ],
    )
    def test_bad(self, changes, verdict):
        assert bad(judge_network(replace(NETWORK, **changes))) == [verdict]

    def test_loopback_is_right_where_the_master_is_here(self):
        found = replace(NETWORK, own_address="127.0.0.1", is_master_local=True, has_ipv6=False)
        assert bad(judge_network(found)) == []


class TestPorts:
    def text(self, check: str, *listeners: Listener, port: int = 50051) -> str:
        (found,) = (one for one in judge_ports(listeners, port) if one.check == check)
        return f"{found.level.value}: {found.text}"

    def test_nobody(self):
        assert bad(judge_ports([])) == []
        assert self.text("port 50051").startswith("ok: free")

    def test_one_master(self):
        one = Listener("127.0.0.1", 50051, 7, "simple-ros-master")
        assert self.text("port 50051", one) == (
            "ok: used by simple-ros-master (pid 7), reachable from this host only"
        )
        assert "only" not in self.text("port 50051", replace(one, ip="0.0.0.0"))

    def test_one_program_may_have_many_sockets(self):
        one = Listener("0.0.0.0", 50051, 7, "master")
        assert self.text("port 50051", one, one, replace(one, ip="::")).startswith("ok")

    def test_two_masters(self):
        two = Listener("0.0.0.0", 7000, 7, "master"), Listener("0.0.0.0", 7000, 8, "master")
        assert self.text("port 7000", *two, port=7000).startswith(
            "error: 2 programs listen on it: master (pid 7), master (pid 8)"
        )

    def test_two_sockets_of_who_knows_whom(self):
        stranger = Listener("0.0.0.0", 50051)
        assert self.text("port 50051", stranger) == "ok: used by a program of another user"
        assert self.text("port 50051", stranger, stranger).startswith("warning")

    def test_ports_that_cpp_tools_need(self):
        assert self.text("port 60002", Listener("0.0.0.0", 60002, 9, "quad_simulator")).startswith(
            "warning: used by quad_simulator (pid 9); C++ rostopic aborts"
        )
        assert bad(judge_ports([Listener("0.0.0.0", 60002, 9, "rostopic echo x")])) == []

    def test_ports_of_cpp_nodes(self):
        many = [Listener("0.0.0.0", 60100 + index, index + 1, "node") for index in range(6)]
        assert "6 in use: 60100 node (pid 1)" in self.text("ports 60000-61000", *many)
        all_of_them = [Listener("0.0.0.0", port, 1, "rostopic") for port in range(60000, 61001)]
        assert ("ports 60000-61000", Level.WARNING) in bad(judge_ports(all_of_them))
