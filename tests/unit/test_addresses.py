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


@pytest.mark.parametrize(
    ("text", "pair"),
    [
        ("8090", ("127.0.0.1", 8090)),
        (":8090", ("127.0.0.1", 8090)),
        ("0.0.0.0:0", ("0.0.0.0", 0)),
        ("[::1]:8090", ("::1", 8090)),
        ("robot:65535", ("robot", 65535)),
    ],
)
def test_where_to_listen(text: str, pair: tuple[str, int]) -> None:
    assert addresses.address_of(text) == pair


@pytest.mark.parametrize("text", ["", "host", "host:", "host:x", "1.2.3.4:70000", "host:\u00b2"])
def test_where_nobody_can_listen(text: str) -> None:
    with pytest.raises(ConfigError, match=r"page address .* is not of the form \[HOST:\]PORT"):
        addresses.address_of(text, "page address")


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


@pytest.mark.parametrize(
    ("what", "info", "under_way", "silent"),
    [
        ("idle", (0, 0, 0, 60_000), False, False),
        ("just sent", (0, 0, 1, 100), True, False),
        ("retransmitting for a while", (4, 0, 1, 6_144), True, False),
        ("host gone", (5, 0, 1, 8_200), True, True),
        ("reads nothing, but its kernel answers probes", (0, 0, 0, 30_000), False, False),
        ("one probe on its way", (0, 1, 0, 30_000), True, False),
        ("full window and host gone", (0, 4, 0, 9_000), True, True),
    ],
)
def test_a_peer_that_reads_nothing_is_told_from_one_that_is_gone(
    what: str, info: tuple[int, int, int, int], under_way: bool, silent: bool
) -> None:
    """Figures as the kernel gave them in both cases."""
    state = addresses.judge_connection(*info)
    assert (state.is_under_way, state.is_silent) == (under_way, silent), what


def test_the_kernels_figures_are_read_where_they_stand() -> None:
    import socket

    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(server.getsockname()) as near,
        server.accept()[0] as far,
    ):
        near.sendall(b"hello")
        assert far.recv(5) == b"hello"
        state = addresses.connection_state(near)
        assert not state.is_silent
