from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros import names
from simple_ros.errors import InvalidName, SimpleRosError


@pytest.mark.parametrize(
    ("given_name", "canonical"),
    [
        ("quad_odometry", "quad_odometry"),
        ("/quad_odometry", "quad_odometry"),
        ("sensors/range_tof", "sensors/range_tof"),
        ("/a/b/c1", "a/b/c1"),
        ("_hidden", "_hidden"),
    ],
)
def test_one_name_whatever_the_leading_slash(given_name: str, canonical: str) -> None:
    assert names.topic_name(given_name) == canonical
    assert names.node_name(given_name) == canonical
    assert names.canonical(given_name) == canonical


@pytest.mark.parametrize(
    ("bad", "position", "word"),
    [
        ("", 0, "empty"),
        ("/", 0, "empty"),
        ("a b", 1, "' '"),
        ("a//b", 2, "slashes"),
        ("//a", 1, "slashes"),
        ("a/", 2, "ends"),
        ("a/1b", 2, "digit"),
        ("a-b", 1, "'-'"),
        ("ärger", 0, "'ä'"),
    ],
)
def test_bad_names_point_at_the_character(bad: str, position: int, word: str) -> None:
    with pytest.raises(InvalidName) as caught:
        names.topic_name(bad)
    error = caught.value
    assert error.position == position
    assert word in error.reason
    assert isinstance(error, ValueError)
    assert isinstance(error, SimpleRosError)
    caret_line = str(error).splitlines()[-1]
    quoted_line = str(error).splitlines()[-2]
    if bad:
        assert caret_line.index("^") - quoted_line.index("'") == position + 1


def test_too_long_name() -> None:
    assert names.topic_name("a" * 1024)
    with pytest.raises(InvalidName, match="1024"):
        names.topic_name("a" * 1025)


def test_of_a_long_name_only_the_part_about_the_mistake_is_shown() -> None:
    with pytest.raises(InvalidName) as caught:
        names.topic_name("a" * 5000 + "-" + "b" * 5000)
    _, shown, caret = str(caught.value).splitlines()
    assert len(shown) < 140
    assert (shown[:6], shown[-4:]) == ("  ...'", "'...")
    assert shown[caret.index("^")] == "-"


def test_not_a_string() -> None:
    with pytest.raises(TypeError, match="bytes"):
        names.topic_name(b"a")  # type: ignore[arg-type]


@given(st.text())
def test_canonical_takes_anything_and_settles(name: str) -> None:
    once = names.canonical(name)
    assert names.canonical(once) == once
    assert not once.startswith("/")
