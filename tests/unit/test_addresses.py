from __future__ import annotations

import pytest

from simple_ros.errors import ConfigError
from simple_ros.net import addresses


@pytest.mark.parametrize(
    ("text", "pair"),
    [
        ("localhost:50051", ("localhost", 50051)),
        ("10.0.0.1:1", ("10.0.0.1", 1)),
        ("[::1]:50051", ("::1", 50051)),
        ("robot", ("robot", 7)),
        ("::1", ("::1", 7)),
        ("[fe80::2]", ("fe80::2", 7)),
    ],
)
def test_addresses_are_split(text: str, pair: tuple[str, int]) -> None:
    assert addresses.split_address(text, default_port=7) == pair


@pytest.mark.parametrize("text", ["", ":50051", "host:port", "host:99999", "host", "host:-1"])
def test_what_is_no_address(text: str) -> None:
    with pytest.raises(ConfigError, match="host:port"):
        addresses.split_address(text)


def test_join_is_the_way_back() -> None:
    for text in ("10.0.0.1:1", "[::1]:50051"):
        assert addresses.join_address(*addresses.split_address(text)) == text


def test_master_is_found_by_argument_then_environment_then_default(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("SIMPLE_ROS_MASTER", raising=False)
    assert addresses.master_address() == "localhost:50051"
    monkeypatch.setenv("SIMPLE_ROS_MASTER", "robot:1234")
    assert addresses.master_address() == "robot:1234"
    assert addresses.master_address("other") == "other:50051"


@pytest.mark.parametrize("master", ["localhost:50051", "127.0.0.1:1", "[::1]:50051"])
async def test_a_local_master_means_a_loopback_address(master: str) -> None:
    assert addresses.own_ipv4(master) == "127.0.0.1"
    assert await addresses.find_own_ipv4(master) == "127.0.0.1"
    assert addresses.further_addresses("127.0.0.1", 1) == ()


def test_further_addresses_leave_out_loopback_and_the_shown_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        addresses, "_interface_addresses", lambda: ["10.0.0.1", "192.168.1.1", "fd00::1"]
    )
    assert addresses.further_addresses("10.0.0.1", 9) == ("192.168.1.1:9", "[fd00::1]:9")
