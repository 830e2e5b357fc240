"""Parallel rewriting against T20's strings and a plain string rewriter."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forest_addon.growth.lsystem.tanveer import T20, LSystem, derive

symbols = st.sampled_from("abcd[]")


def to_text(symbols):
    return symbols.tobytes().decode("latin-1")


def rewrite_plainly(system, generations):
    text = system.axiom
    for _ in range(generations):
        text = "".join(system.productions.get(c, c) for c in text)
    return text


def test_t20_strings_as_printed_in_the_paper():
    assert to_text(derive(T20, 1)) == "d(g)[g)+g)"
    assert to_text(derive(T20, 2)) == "d(d(g)[g)+g)[d(g)[g)+g)+d(g)[g)+g)"


@pytest.mark.parametrize("n", range(8))
def test_t20_has_three_to_the_n_tips(n):
    text = to_text(derive(T20, n))
    assert text.count("g") == 3**n
    assert text.count("(") + text.count("[") + 1 == text.count(")")


@given(
    axiom=st.text(symbols, min_size=0, max_size=6),
    rules=st.dictionaries(symbols, st.text(symbols, max_size=4), max_size=4),
    generations=st.integers(0, 4),
)
def test_any_grammar_equals_plain_rewriting(axiom, rules, generations):
    system = LSystem(axiom, rules)
    expected = rewrite_plainly(system, generations)
    assert to_text(derive(system, generations)) == expected


def test_a_derivation_that_would_not_fit_is_refused_with_its_length():
    with pytest.raises(ValueError, match=r"[\d,]{20,} symbols, more than 50,000,000"):
        derive(T20, 60)
