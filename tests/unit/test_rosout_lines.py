from __future__ import annotations

import json
import re

import pytest
import typer

from simple_ros.cli.log import line_json, line_text, line_wanted
from simple_ros.errors import ConfigError
from simple_ros.log_levels import level_name, python_level, ros_level
from simple_ros.msg.rosgraph_msgs import Log


@pytest.mark.parametrize(
    ("python", "ros", "name"),
    [(10, 1, "debug"), (20, 2, "info"), (30, 4, "warn"), (40, 8, "error"), (50, 16, "fatal")],
)
def test_levels(python: int, ros: int, name: str) -> None:
    assert ros_level(python) == ros
    assert ros_level(python + 5) == ros, "in between, the lower one counts"
    assert level_name(ros) == name
    assert python_level(name) == python_level(name.upper()) == python_level(python) == python


def test_other_levels() -> None:
    assert (ros_level(5), ros_level(0), ros_level(99)) == (Log.DEBUG, Log.DEBUG, Log.FATAL)
    assert (python_level("Warning"), python_level("CRITICAL")) == (30, 50)
    assert level_name(3) == "3"
    for wrong in ("loud", "", -1):
        with pytest.raises(ConfigError, match="log level"):
            python_level(wrong)


def line(**parts: object) -> Log:
    made = Log(level=Log.WARN, name="robot", msg="battery low", file="a.py", line=7, function="f")
    made.header.stamp.seconds = 5
    made.header.stamp.nanos = 25_000_000
    for name, value in parts.items():
        setattr(made, name, value)
    return made


def test_filters() -> None:
    assert line_wanted("warn", [], None)(line())
    assert not line_wanted("error", [], None)(line())
    assert line_wanted("debug", ["/robot", "x"], None)(line())
    assert not line_wanted("debug", ["x"], None)(line())
    assert line_wanted("debug", [], re.compile("bat+ery"))(line())
    assert not line_wanted("debug", [], re.compile("^low"))(line())
    with pytest.raises(typer.BadParameter, match="log level"):
        line_wanted("loud", [], None)


def test_text() -> None:
    text = line_text(line(), colour=False, verbose=True)
    assert text.endswith(".025 warn  robot: battery low  (a.py:7 f)")
    assert line_text(line(), colour=True, verbose=False).startswith("\x1b[33m")
    assert line_text(line(level=Log.INFO), colour=True, verbose=False).endswith("battery low")
    hostile = line_text(line(msg="a\x1b[2Jb\nc"), colour=False, verbose=False)
    assert hostile.endswith("a\\x1b[2Jb\nc"), "a log line steers no terminal"


def test_json() -> None:
    assert json.loads(line_json(line())) == {
        "stamp_ns": 5_025_000_000,
        "level": "warn",
        "node": "robot",
        "text": "battery low",
        "file": "a.py",
        "line": 7,
        "function": "f",
    }
