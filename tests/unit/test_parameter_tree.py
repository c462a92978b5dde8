from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.errors import InvalidName
from simple_ros.parameters import feed as feeds
from simple_ros.parameters.errors import (
    ParameterConflict,
    ParameterError,
    ParameterOutOfRange,
    ParameterReadOnly,
    ParameterTypeMismatch,
    UnknownParameter,
)
from simple_ros.parameters.feed import ParameterFeed, ParameterMirror
from simple_ros.parameters.own import Own, OwnParameters
from simple_ros.parameters.tree import Declaration, Origin, ParameterTree
from simple_ros.parameters.values import Descriptor


def declaration(name: str, value: Any, kind: str = "float", **more: Any) -> Declaration:
    said = {key: more.pop(key) for key in ("minimum", "maximum", "read_only") if key in more}
    return Declaration(name, Descriptor(kind, **said), value, **more)


@pytest.fixture
def tree() -> ParameterTree:
    return ParameterTree()


class TestSetting:
    def test_a_group_is_set_as_one(self, tree: ParameterTree) -> None:
        changes = tree.set({"/a/b": 1, "c": "x"})
        assert [(change.name, change.value, change.revision) for change in changes] == [
            ("a/b", 1, 1),
            ("c", "x", 1),
        ]
        assert tree.values() == {"a/b": 1, "c": "x"}
        assert tree.values("a") == {"a/b": 1}

    def test_what_is_the_same_is_no_change(self, tree: ParameterTree) -> None:
        tree.set({"a": 1})
        assert tree.set({"a": 1}) == []
        assert tree.revision == 1
        assert len(tree.set({"a": 1.0})) == 1
        assert len(tree.set({"a": float("nan")})) == 1
        assert tree.set({"a": float("nan")}) == []

    @pytest.mark.parametrize(
        ("values", "error"),
        [
            ({"x": 1, "gain": "hot"}, ParameterTypeMismatch),
            ({"x": 1, "gain": 9}, ParameterOutOfRange),
            ({"x": 1, "fixed": 2.0}, ParameterReadOnly),
            ({"x": 1, "gain/sub": 1}, ParameterConflict),
            ({"x": 1, "group": 1}, ParameterConflict),
            ({"x": 1, "x/y": 1}, ParameterConflict),
            ({"x": 1, "a-b": 1}, InvalidName),
        ],
    )
    def test_a_group_with_anything_wrong_changes_nothing(
        self, tree: ParameterTree, values: dict[str, Any], error: type[Exception]
    ) -> None:
        tree.set({"group/inner": 1})
        tree.declare(
            "n",
            [
                declaration("gain", 1.0, maximum=5),
                declaration("fixed", 1.0, read_only=True),
            ],
        )
        before = tree.values(), tree.revision
        for order in (values, dict(reversed(values.items()))):
            with pytest.raises(error):
                tree.set(order)
            assert (tree.values(), tree.revision) == before

    def test_a_read_only_one_may_be_set_to_what_it_is(self, tree: ParameterTree) -> None:
        tree.declare("n", [declaration("fixed", 1.0, read_only=True)])
        assert tree.set({"fixed": 1}) == []

    def test_unknown_names_are_told_with_those_alike(self, tree: ParameterTree) -> None:
        tree.set({"robot1/driver/gain": 1})
        for wrong in ("robot1/driver/gian", "gain"):
            with pytest.raises(UnknownParameter, match="did you mean 'robot1/driver/gain'"):
                tree.entry(wrong)


class TestDeleting:
    def test_groups_go_as_one(self, tree: ParameterTree) -> None:
        tree.set({"a/b": 1, "a/c": 2, "d": 3})
        assert [change.name for change in tree.delete(["/a", "d"])] == ["a/b", "a/c", "d"]
        assert len(tree) == 0
        tree.set({"a": 1})  # the group is gone, its name is free

    def test_all_or_none(self, tree: ParameterTree) -> None:
        tree.set({"a": 1})
        with pytest.raises(UnknownParameter):
            tree.delete(["a", "b"])
        assert "a" in tree

    def test_not_what_a_live_node_declares(self, tree: ParameterTree) -> None:
        tree.declare("n", [declaration("n/x", 1.0)])
        with pytest.raises(ParameterConflict, match="node 'n'"):
            tree.delete(["n"])
        assert tree.delete(["n/x"], by="n")


class TestDeclaring:
    def test_the_first_there_is(self, tree: ParameterTree) -> None:
        tree.set({"set": 2, "both": 2})
        tree.declare(
            "n",
            [
                declaration("default", 1.0),
                declaration("set", 1.0),
                declaration("told", 3.0, origin=Origin.OVERRIDE),
                declaration("both", 3.0, origin=Origin.OVERRIDE),
            ],
        )
        assert tree.values() == {"default": 1.0, "set": 2.0, "told": 3.0, "both": 3.0}
        assert repr(tree.entry("set").value) == "2.0"

    def test_a_value_that_was_set_and_does_not_fit(self, tree: ParameterTree) -> None:
        tree.set({"n/x": "hello"})
        with pytest.raises(ParameterTypeMismatch, match="set before the node came"):
            tree.declare("n", [declaration("n/y", 1.0), declaration("n/x", 1.0)])
        assert tree.values() == {"n/x": "hello"}

    def test_what_was_declared_goes_with_the_node_unless_it_was_set(
        self, tree: ParameterTree
    ) -> None:
        tree.declare("n", [declaration("n/x", 1.0), declaration("n/y", 1.0)])
        tree.set({"n/y": 2.0})
        assert tree.kept() == {"n/y": 2.0}
        assert [change.name for change in tree.release("n")] == ["n/x"]
        assert tree.values() == {"n/y": 2.0}
        assert tree.entry("n/y").descriptor is None
        tree.declare("n", [declaration("n/x", 5.0), declaration("n/y", 5.0)])
        assert tree.values() == {"n/x": 5.0, "n/y": 2.0}

    def test_several_owners_must_agree_and_all_are_obeyed(self, tree: ParameterTree) -> None:
        tree.declare("a", [declaration("speed", 1.0, maximum=5)])
        with pytest.raises(ParameterConflict, match="node 'a' declares float"):
            tree.declare("b", [declaration("speed", 1, "int")])
        tree.declare("b", [declaration("speed", 2.0, minimum=0)])
        assert tree.values() == {"speed": 1.0}
        for bad in (-1, 6):
            with pytest.raises(ParameterOutOfRange):
                tree.set({"speed": bad})
        assert tree.owners_of(["speed", "other"]) == {"a": ["speed"], "b": ["speed"]}
        assert tree.release("a") == []
        assert [change.name for change in tree.release("b")] == ["speed"]

    def test_what_a_node_uses_stands(self, tree: ParameterTree) -> None:
        tree.set({"n/x": 9.0})
        tree.declare("n", [declaration("n/x", 4.0, origin=Origin.SET, standing=True)])
        assert tree.values() == {"n/x": 4.0}

    def test_a_declaration_in_the_way(self, tree: ParameterTree) -> None:
        tree.set({"a/b": 1})
        for name in ("a", "a/b/c"):
            with pytest.raises(ParameterConflict):
                tree.declare("n", [declaration(name, 1.0)])


NAMES = st.sampled_from(["a", "b", "a/x", "a/y", "a/x/z", "c/d"])
VALUES = st.one_of(st.integers(0, 3), st.sampled_from([0.5, "s", True, [1], []]))
STEPS = st.one_of(
    st.tuples(st.just("set"), st.dictionaries(NAMES, VALUES, min_size=1, max_size=3)),
    st.tuples(st.just("delete"), st.lists(NAMES, min_size=1, max_size=2)),
    st.tuples(st.just("declare"), st.tuples(st.sampled_from("pq"), NAMES, st.booleans())),
    st.tuples(st.just("release"), st.sampled_from("pq")),
    st.tuples(st.just("told"), st.sampled_from([0, 1])),
    st.tuples(st.just("lost"), st.sampled_from([0, 1])),
)


def do(tree: ParameterTree, step: str, data: Any) -> list[Any]:
    match step:
        case "set":
            return tree.set(data)
        case "delete":
            return tree.delete(data)
        case "declare":
            owner, name, standing = data
            return tree.declare(owner, [declaration(name, 1, "int", standing=standing)])
        case _:
            return tree.release(data)


@given(st.lists(STEPS, max_size=40))
def test_watchers_know_the_tree_whatever_happens(steps: list[tuple[str, Any]]) -> None:
    """A watch with lost connections and a slow reader ends with what is there, and is told once."""
    tree = ParameterTree()
    prefixes = ["", "a"]
    sources = [ParameterFeed(tree, prefix) for prefix in prefixes]
    mirrors = [ParameterMirror(), ParameterMirror()]

    def told(number: int) -> None:
        mirror = mirrors[number]
        while (event := sources[number].take()) is not None:
            for change in mirror.apply(event):
                assert repr(change.value) != repr(change.previous)

    for step, data in steps:
        if step == "told":
            told(data)
        elif step == "lost":
            sources[data] = ParameterFeed(tree, prefixes[data])
        else:
            before = tree.values(), tree.revision
            try:
                changes = do(tree, step, data)
            except ParameterError:
                assert (tree.values(), tree.revision) == before
                continue
            assert (tree.revision > before[1]) is bool(changes)
            for source in sources:
                source.add(changes)
        names = list(tree.values())
        assert not any(one != two and two.startswith(one + "/") for one in names for two in names)
    for number, mirror in enumerate(mirrors):
        told(number)
        assert repr(dict(sorted(mirror.values.items()))) == repr(tree.values(prefixes[number]))


def test_a_watcher_that_is_too_slow_gets_a_snapshot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeds, "MAX_WAITING", 3)
    tree = ParameterTree()
    feed, mirror = ParameterFeed(tree, ""), ParameterMirror()
    assert feed.take() is not None
    for number in range(5):
        feed.add(tree.set({"a": number}))
    event = feed.take()
    assert event is not None
    assert event.HasField("snapshot")
    assert [change.value for change in mirror.apply(event)] == [4]
    assert feed.take() is None


class TestOwn:
    def own(self) -> OwnParameters:
        found = OwnParameters()
        found.add(Own("n/x", "~x", Descriptor("float", maximum=5), 1.0, Origin.DEFAULT, 3))
        return found

    def test_older_news_change_nothing(self) -> None:
        own = self.own()
        assert own.apply({"n/x": 2.0}, 2) == []
        assert own.settle("n/x", 2.0, Origin.SET, 2) == []
        assert own["n/x"].value == 1.0
        assert [item.name for item in own.apply({"n/x": 2.0, "other": 1}, 4)] == ["n/x"]
        assert (own["n/x"].value, own["n/x"].origin) == (2.0, Origin.SET)

    def test_a_new_master_counts_anew(self) -> None:
        own = self.own()
        own.new_master()
        assert own.settle("n/x", 2.0, Origin.SET, 1)

    def test_repeating_a_declaration(self) -> None:
        own = self.own()
        assert own.repeated("n/x", Descriptor("float", maximum=5)) is own["n/x"]
        assert own.repeated("n/y", Descriptor("float")) is None
        with pytest.raises(ParameterConflict):
            own.repeated("n/x", Descriptor("float"))

    def test_checking(self) -> None:
        own = self.own()
        assert repr(own.checked({"n/x": 2, "other": "y"})) == "{'n/x': 2.0}"
        assert own.spelled({"n/x": 2.0, "other": 1}) == {"~x": 2.0}
        with pytest.raises(ParameterOutOfRange):
            own.checked({"n/x": 6})

    def test_to_the_same_master_a_command_line_is_old_news(self) -> None:
        item = Own("n/x", "~x", Descriptor("float"), 1.0, Origin.OVERRIDE)
        assert item.declaration().origin is Origin.OVERRIDE
        assert item.repetition(other_master=True).standing
        again = item.repetition(other_master=False)
        assert (again.origin, again.standing) == (Origin.DEFAULT, False)
