"""Small parts of launch that touch the system: readiness, log directories, a full disk."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from simple_ros.launch.errors import LaunchFailed
from simple_ros.launch.logs import LogFile, new_log_directory
from simple_ros.ready import ready


@pytest.mark.parametrize("shown", ["{path}", "@simple_ros_test_{pid}"])
def test_ready_is_a_datagram(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shown: str) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert ready() is False
    address = shown.format(path=tmp_path / "s", pid=os.getpid())
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as hearer:
        hearer.bind(address.replace("@", "\0"))
        assert ready() is True
        assert hearer.recv(100) == b"READY=1"


def test_log_directories(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMPLE_ROS_LOG_DIR", str(tmp_path / "log"))
    first, second = (new_log_directory("robot", now=0.0) for _ in range(2))
    assert second.name == f"{first.name}-2"
    assert (tmp_path / "log" / "latest").resolve() == second
    (tmp_path / "taken").touch()
    monkeypatch.setenv("SIMPLE_ROS_LOG_DIR", str(tmp_path / "taken"))
    with pytest.raises(LaunchFailed, match=r"cannot write logs below .*taken: "):
        new_log_directory("robot")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_a_full_disk_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    log = LogFile(Path("/dev/full"))
    for _ in range(3):
        log.lines(["words"])
    log.close()
    assert [record.getMessage() for record in caplog.records] == [
        "cannot write /dev/full: No space left on device; nothing more goes there"
    ]
