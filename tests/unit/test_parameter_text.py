from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.parameters.errors import BadParameterText
from simple_ros.parameters.text import FileItem, parse_node_file, parse_tree, parse_value, written


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e3", 1000.0),
        ("-.5", -0.5),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        ("yes", "yes"),
        ("on", "on"),
        ("True", True),
        ("12:30:00", "12:30:00"),
        ("2024-01-01", "2024-01-01"),
        ("1_000", "1_000"),
        ("'1'", "1"),
        ("!!binary aGFsbG8=", b"hallo"),
        ("[]", []),
        ("", ""),
        ("{a: {b: 1}}", {"a/b": 1}),
    ],
)
def test_plain_words(text: str, value: Any) -> None:
    assert repr(parse_value(text)) == repr(value)


def test_a_tree() -> None:
    text = "max_speed: 2\nrobot1:\n  driver: {gain: 1.5, ids: [1, 2]}\na/b: x\n"
    values = {"max_speed": 2, "robot1/driver/gain": 1.5, "robot1/driver/ids": [1, 2], "a/b": "x"}
    assert parse_tree(text, "f") == values
    assert parse_tree(written(values), "f") == values
    assert parse_tree("", "f") == parse_tree("# nothing\n", "f") == {}
    assert written({}) == ""


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("a: 1\nb: [1, x]\n", 2, "mixes int and string"),
        ("a: 1\n\na: 2\n", 3, "given already in line 1"),
        ("a/b: 1\na: {b: 2}\n", 2, "'a/b' of line 1"),
        ("a/b: 1\na: 2\n", 2, "cannot both be parameters"),
        ("a: 2\na/b: 1\n", 2, "cannot both be parameters"),
        ("a:\n  9b: 1\n", 2, "starts with a digit"),
        ("a: 1\n b: 2\n", 2, "no YAML"),
        ("a: [1\nb: 2\n", 2, "no YAML"),
        ("- 1\n", 1, "must be a mapping"),
        ("x\n", 1, "must be a mapping"),
        ("a: 1\nb:\n", 2, "null"),
        ("a: 1\nb: !!python/name:os.system x\n", 2, "no value"),
        ("a: 1\n[x]: 1\n", 2, "plain text"),
        ("a: 1\nb: 99999999999999999999\n", 2, "64 bits"),
        ("a: 1\nb: \x00\n", 1, "no YAML"),
        ("[" * 5000, 1, "no YAML|nested"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(text: str, line: int, reason: str) -> None:
    with pytest.raises(BadParameterText, match=reason) as caught:
        parse_tree(text, "robot.yaml")
    assert str(caught.value).startswith(f"robot.yaml:{line}: ")
    assert (caught.value.source, caught.value.line) == ("robot.yaml", line)


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text: str) -> None:
    for parse in (parse_tree, parse_node_file):
        try:
            parse(text, "f")
        except BadParameterText:
            pass


def test_files_for_nodes() -> None:
    text = """
    talker: {gain: 2, pid: {p: 1}}
    /**: {common: 1}
    robot1:
      driver: {ros__parameters: {x: 1.0}}
      group: {arm: {ros__parameters: {y: 2}}}
    /robot2/driver: {ros__parameters: {x: 3}}
    """
    assert parse_node_file(text, "f") == [
        FileItem("", "common", 1),
        FileItem("talker", "gain", 2),
        FileItem("talker", "pid/p", 1),
        FileItem("robot1/driver", "x", 1.0),
        FileItem("robot1/group/arm", "y", 2),
        FileItem("robot2/driver", "x", 3),
    ]


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("talker: 1", 1, "parameters of 'talker' must be a mapping"),
        ("a-b: {x: 1}", 1, "'-'"),
        ("t:\n  ros__parameters: {x: 1}\n  y: 2\n", 3, "beside 'ros__parameters'"),
        ("t:\n  ros__parameters: 1\n", 2, "must be a mapping"),
    ],
)
def test_files_for_nodes_that_are_wrong(text: str, line: int, reason: str) -> None:
    with pytest.raises(BadParameterText, match=reason) as caught:
        parse_node_file(text, "f")
    assert caught.value.line == line
