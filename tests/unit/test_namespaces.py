"""What a name means in a node (`simple_ros.names.resolve`)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros import names
from simple_ros.errors import InvalidName

TOKENS = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,5}", fullmatch=True)
NAMES = st.lists(TOKENS, min_size=1, max_size=3).map("/".join)


@pytest.mark.parametrize(
    ("name", "full"),
    [
        ("chatter", "robot1/chatter"),
        ("/chatter", "chatter"),
        ("~gain", "robot1/talker/gain"),
        ("~/gain", "robot1/talker/gain"),
        ("a/b", "robot1/a/b"),
        ("~a/b", "robot1/talker/a/b"),
        ("/robot1/chatter", "robot1/chatter"),
    ],
)
def test_in_a_namespace(name: str, full: str) -> None:
    assert names.Scope("robot1/talker", "robot1").resolve(name) == full


@given(NAMES)
def test_without_one_the_slash_means_nothing(name: str) -> None:
    scope = names.Scope("talker")
    assert scope.resolve(name) == scope.resolve("/" + name) == name
    assert names.topic_name("/" + name) == name


@given(NAMES, NAMES)
def test_an_absolute_full_name_is_itself(namespace: str, name: str) -> None:
    scope = names.Scope(f"{namespace}/n", namespace)
    full = scope.resolve(name)
    assert scope.resolve("/" + full) == full == f"{namespace}/{name}"


@pytest.mark.parametrize(
    ("name", "position"),
    [("~", 0), ("~/", 0), ("~a b", 2), ("~/1", 2), ("~~a", 1), ("a/~b", 2), ("", 0), ("//a", 1)],
)
def test_bad_names_point_at_the_character(name: str, position: int) -> None:
    with pytest.raises(InvalidName) as caught:
        names.Scope("robot1/talker", "robot1").resolve(name, "service")
    assert caught.value.position == position
    assert str(caught.value).startswith("service name")


def test_no_name_is_its_own_where_there_is_no_node() -> None:
    with pytest.raises(InvalidName, match="begins a node's own name"):
        names.topic_name("~gain")


def test_too_long_with_its_namespace() -> None:
    assert names.resolve("a" * 1019, namespace="abcd")
    with pytest.raises(InvalidName, match="namespace 'abcd'"):
        names.resolve("a" * 1020, namespace="abcd")


@pytest.mark.parametrize(
    ("given_name", "canonical"), [("", ""), ("/", ""), ("/a", "a"), ("a/b", "a/b")]
)
def test_namespaces(given_name: str, canonical: str) -> None:
    assert names.namespace_name(given_name) == canonical
