"""Whether a node is on this host, by the address it gave."""

from __future__ import annotations

import socket

import psutil
import pytest

from simple_ros.cli.hosts import is_this_host

ELSEWHERE = "192.0.2.1:50051"
"""An address for documentation, which no host has."""


@pytest.mark.parametrize("master", ["localhost:50051", "127.0.0.1:50051", "[::1]:50051"])
def test_a_loopback_address_is_where_the_master_is(master: str) -> None:
    assert is_this_host("127.0.0.1", master)
    assert not is_this_host("127.0.0.1", ELSEWHERE)


def test_the_master_by_its_address_in_the_network() -> None:
    for address in own_addresses():
        assert is_this_host("127.0.0.1", f"{address}:50051")


def test_own_and_other_addresses() -> None:
    for address in own_addresses():
        assert is_this_host(address, ELSEWHERE)
    assert not is_this_host("192.0.2.1", "localhost")


def own_addresses() -> list[str]:
    """Those in a network; none on a host without one."""
    entries = [entry for found in psutil.net_if_addrs().values() for entry in found]
    found = [entry.address for entry in entries if entry.family == socket.AF_INET]
    return [address for address in found if not address.startswith("127.")]
