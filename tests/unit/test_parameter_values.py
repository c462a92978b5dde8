from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from simple_ros.parameters.convert import value_from_proto, value_to_proto
from simple_ros.parameters.errors import (
    ParameterConflict,
    ParameterError,
    ParameterOutOfRange,
    ParameterTypeMismatch,
)
from simple_ros.parameters.text import parse_tree, parse_value, value_text, written
from simple_ros.parameters.values import Descriptor, checked, described, normalised, type_of
from simple_ros.rpc.parameters_pb2 import ParameterValue

TEXT = st.text(st.characters(codec="utf-8"), max_size=20)
SCALARS: list[st.SearchStrategy[Any]] = [
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    TEXT,
    st.binary(max_size=20),
]
VALUES = st.one_of(*SCALARS, *(st.lists(kind, max_size=4) for kind in SCALARS))
NAMES = st.lists(st.from_regex(r"[A-Za-z_]{1,4}", fullmatch=True), min_size=1, max_size=3).map(
    "/".join
)


@given(VALUES)
@example("\x85")
@example(["a\n", "\u2028b"])
def test_values_come_back_from_the_wire_and_from_text(value: Any) -> None:
    kept = normalised("x", value)
    message = ParameterValue.FromString(value_to_proto(kept).SerializeToString())
    assert repr(value_from_proto("x", message)) == repr(kept)
    assert repr(parse_value(value_text(kept))) == repr(kept)
    assert repr(parse_tree(written({"a/x": kept}), "f")) == repr({"a/x": kept})


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        (True, "bool"),
        (1, "int"),
        (1.0, "float"),
        ("1", "string"),
        (b"1", "bytes"),
        ([], "[]"),
        ((1, 2), "int[]"),
        ([1, 2.5], "float[]"),
        (np.float32(1), "float"),
        (np.int8(1), "int"),
        (np.array([1.5, 2]), "float[]"),
        (bytearray(b"x"), "bytes"),
    ],
)
def test_types(value: Any, kind: str) -> None:
    assert type_of(normalised("x", value)) == kind


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (None, "null"),
        (2**63, "64 bits"),
        ("\ud800", "Unicode"),
        ([1, "a"], "int and string"),
        ([True, 1], "bool and int"),
        ([[1]], "list within a list"),
        ({}, "dict"),
        (object(), "object"),
    ],
)
def test_what_no_parameter_can_be(value: Any, reason: str) -> None:
    with pytest.raises(ParameterTypeMismatch, match=reason) as caught:
        normalised("a/b", value)
    assert caught.value.name == "a/b"
    assert isinstance(caught.value, TypeError)


@pytest.mark.parametrize(
    ("declared", "value", "expected"),
    [
        ("float", 3, 3.0),
        ("float[]", [1, 2], [1.0, 2.0]),
        ("string[]", [], []),
        ("int", 3, 3),
    ],
)
def test_only_widening(declared: str, value: Any, expected: Any) -> None:
    assert repr(checked("x", Descriptor(declared), value)) == repr(expected)


@pytest.mark.parametrize(
    ("declared", "value"),
    [
        ("int", 3.0),
        ("int", True),
        ("float", True),
        ("string", 1),
        ("bool", 0),
        ("bytes", "x"),
        ("int[]", 1),
        ("int", []),
    ],
)
def test_nothing_else(declared: str, value: Any) -> None:
    with pytest.raises(ParameterTypeMismatch) as caught:
        checked("robot/x", Descriptor(declared), value)
    for fact in ("robot/x", declared, repr(value)):
        assert fact in str(caught.value)


@pytest.mark.parametrize(
    ("descriptor", "good", "bad"),
    [
        (Descriptor("int", minimum=0, maximum=5), [0, 5], [-1, 6]),
        (Descriptor("float", minimum=0), [0.0, math.inf], [-0.1, math.nan]),
        (Descriptor("float", maximum=1.5), [1.5, -math.inf], [1.6, math.nan]),
        (Descriptor("float", step=0.1), [0.3, -0.7, 1e6], [0.35, math.inf]),
        (Descriptor("int", minimum=1, step=2), [1, 3, 2**53 + 1], [2, 2**53]),
        (Descriptor("string", choices=("a", "b")), ["a", "b"], ["c", ""]),
        (Descriptor("int[]", minimum=0), [[], [1]], [[1, -1]]),
    ],
)
def test_limits(descriptor: Descriptor, good: list[Any], bad: list[Any]) -> None:
    for value in good:
        assert checked("x", descriptor, value) == value
    for value in bad:
        with pytest.raises(ParameterOutOfRange):
            checked("x", descriptor, value)


@pytest.mark.parametrize(
    ("default", "said", "reason"),
    [
        ([], Descriptor(""), "needs its type"),
        (1, Descriptor("integer"), "no type 'integer'"),
        ("a", Descriptor("", minimum=1), "mean nothing for string"),
        (1, Descriptor("", step=0), "more than 0"),
        (1, Descriptor("", minimum=2, maximum=1), "more than its maximum"),
    ],
)
def test_declarations_that_contradict_themselves(
    default: Any, said: Descriptor, reason: str
) -> None:
    with pytest.raises(ParameterConflict, match=reason):
        described("x", default, said)


def test_choices_are_of_the_type() -> None:
    assert described("x", 1.0, Descriptor("", choices=(1, 2))).choices == (1.0, 2.0)
    with pytest.raises(ParameterTypeMismatch):
        described("x", 1, Descriptor("", choices=("a",)))


def test_a_value_from_another_version_is_refused() -> None:
    with pytest.raises(ParameterError, match="no value that is known"):
        value_from_proto("x", ParameterValue())
