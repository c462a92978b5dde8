"""Words for the node beside the options of a program, and launch files by their names."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
import typer

from simple_ros import arguments
from simple_ros.launch import describe
from simple_ros_firmware_bridge.launching import LAUNCH_FILES, launch
from simple_ros_firmware_bridge.node_words import take_words


@pytest.fixture(autouse=True)
def process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Words as if the process had just begun with these."""
    monkeypatch.setattr(arguments, "_process", arguments._Process())
    monkeypatch.setenv(arguments.ENVIRONMENT, "_gain:=1")
    monkeypatch.setattr("sys.argv", ["bridge", "--remap", "odom:=wheels", "__name:=left"])


def test_a_remap_of_the_board_is_no_remap_of_the_node() -> None:
    take_words(["__name:=left", "_text:='a b'"])
    found = arguments.process_arguments()
    assert found == arguments.parse_arguments(["_gain:=1", "__name:=left", "_text:='a b'"])


def test_what_is_no_word_is_refused() -> None:
    with pytest.raises(typer.BadParameter, match="no word for a node"):
        take_words(["robot"])
    take_words(None)
    assert arguments.process_arguments() == arguments.parse_arguments(["_gain:=1"])


@pytest.mark.parametrize("name", ["robot_xl", "pico_bridge.yaml", "controller"])
def test_launch_files_by_name(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    launch(name, path=True)
    assert Path(capsys.readouterr().out.strip()).is_file()
    launch(name, show=True)
    assert "command: " in capsys.readouterr().out


def test_a_launch_file_that_is_not_there() -> None:
    with pytest.raises(typer.BadParameter, match="only controller, pico_bridge, robot_xl"):
        launch("robot")


def test_the_measures_of_a_robot_and_the_speed_of_its_line_are_arguments() -> None:
    given = {"port": "/dev/ttyAMA0", "baud": "921600", "lever_m": "0.3"}
    bridge, control = describe(LAUNCH_FILES["robot_xl"], given).processes
    assert "--port /dev/ttyAMA0 --baud 921600" in shlex.join(bridge.command)
    assert "_lever_m:=0.3" in control.words
