"""Arithmetic of productions against Python's own, and refusals."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forest_addon.growth.lsystem.expression import ExpressionError, parse_expression

leaf = st.one_of(st.integers(0, 9).map(str), st.sampled_from(["l", "w2", "1.5", ".25", "2e-1"]))
tree = st.recursive(
    leaf,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(" ".join),
        inner.map(lambda a: f"({a})"),
        inner.map(lambda a: f"(-{a})"),
        st.tuples(inner, inner).map(lambda p: f"max({p[0]}, {p[1]})"),
        st.tuples(inner, st.sampled_from(["<", "<=", "==", "!="]), inner).map(
            lambda p: f"({p[0]} {p[1]} {p[2]})"
        ),
    ),
    max_leaves=12,
)


@pytest.mark.medium
@given(tree)
def test_any_expression_has_pythons_value(text):
    known = {"l": 3.0, "w2": -0.5, "max": max}
    expected = float(eval(text, {"__builtins__": {}}, known))  # the reference, on text drawn here
    values = {"l": np.full(3, 3.0), "w2": np.full(3, -0.5)}
    assert np.asarray(parse_expression(text, values)(values)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2^3^2", 512),
        ("-2^2", -4),
        ("2^-1", 0.5),
        ("1 - 2 - 3", -4),
        ("8/4/2", 1),
        ("!0 && 3 > 2 || 0", 1),
        ("not 1 or 1 and 0", 0),
        ("sin(30)", 0.5),
        ("sqrt(2)**2", 2),
        ("min(1, max(2, 3)) + abs(-4)", 5),
        ("l > 1 && l < 3", 1),
        ("- - 2", 2),
        ("exp(log(7))", 7),
    ],
)
def test_ranks_and_functions(text, value):
    assert float(parse_expression(text, ["l"])({"l": 2.0})) == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lenght * 2", 'did you mean "length"'),
        ("__import__('os')", "__import__"),
        ("l.real", "is not arithmetic"),
        ("length +", "missing at the end"),
        ("(length", "not closed"),
        ("length)", "no bracket"),
        ("(1, 2)", "no bracket"),
        ("min(1)", "takes 2"),
        ("2 3", "an operator is expected"),
        ("* 2", "a number or a name is expected"),
        ("", "missing"),
        ("a[0]", "is not"),
    ],
)
def test_what_is_not_arithmetic_is_refused(text, words):
    with pytest.raises(ExpressionError, match=words.replace("(", r"\(")):
        parse_expression(text, ["length"])


def test_a_division_by_zero_is_refused_with_the_text():
    ratio = parse_expression("1 / l", ["l"])
    assert ratio({"l": np.array([1.0, 2.0])}).tolist() == [1, 0.5]
    with pytest.raises(ExpressionError, match=r'"1 / l" is not a finite'):
        ratio({"l": np.array([1.0, 0.0])})


def test_deep_brackets_do_not_overflow():
    deep = "(" * 20000 + "1" + ")" * 20000
    assert parse_expression(deep, [])({}) == 1
    assert math.isclose(float(parse_expression("-" * 20000 + "1", [])({})), 1)
