"""Parallel rewriting against Tanveer et al.'s strings and a plain string rewriter."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forest_addon.growth.lsystem.system import Notation, read_system, rewrite
from forest_addon.growth.lsystem.tanveer import string_of
from forest_addon.spec import Grammar

symbols = st.sampled_from("abcd[]")


def tanveer(generations):
    return string_of(Grammar(generations=generations)).tobytes().decode("latin-1")


def rewrite_plainly(text, rules, generations):
    for _ in range(generations):
        text = "".join(rules.get(c, c) for c in text)
    return text


def test_strings_as_printed_in_the_paper():
    assert tanveer(1) == "d(g)[g)+g)"
    assert tanveer(2) == "d(d(g)[g)+g)[d(g)[g)+g)+d(g)[g)+g)"


@pytest.mark.parametrize("n", range(1, 8))
def test_there_are_three_to_the_n_tips(n):
    text = tanveer(n)
    assert text.count("g") == 3**n
    assert text.count("(") + text.count("[") + 1 == text.count(")")


@given(
    axiom=st.text(symbols, min_size=0, max_size=6),
    rules=st.dictionaries(symbols, st.text(symbols, max_size=4), max_size=4),
    generations=st.integers(0, 4),
)
def test_any_grammar_equals_plain_rewriting(axiom, rules, generations):
    texts = [f"{symbol} -> {successor}" for symbol, successor in rules.items()]
    system = read_system(axiom, texts, notation=Notation(parametric=False))
    expected = rewrite_plainly(axiom, rules, generations)
    assert rewrite(system, generations).codes.tobytes().decode("latin-1") == expected


def test_a_derivation_that_would_not_fit_is_refused_with_its_length():
    with pytest.raises(ValueError, match=r"[\d,]{20,} symbols, more than 50,000,000"):
        rewrite(read_system("g", ["g -> ggg"], notation=Notation(parametric=False)), 60)
