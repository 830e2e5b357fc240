"""Parametric and stochastic rewriting: strings of the papers, plain rewriting, chances, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from forest_addon.base.rng import stream
from forest_addon.growth.lsystem import system as engine
from forest_addon.growth.lsystem.expression import ExpressionError
from forest_addon.growth.lsystem.system import (
    GrammarError,
    Notation,
    predict,
    read_constants,
    read_system,
    rewrite,
)

S = Notation(tagged="I")
APPLE = ["F -> InIn[t+InIn+F]In[T-InF]InF"]
FALSE_ALARM = 1e-6  # chance that a distribution test fails though all is well


def test_s_strings_of_two_and_three_generations():
    system = read_system("[F]", APPLE, notation=S)
    assert rewrite(system, 0).text() == "[F]"
    assert rewrite(system, 1).text() == "[I01I01[t+I01I01+F]I01[T-I01F]I01F]"
    assert rewrite(system, 2).text() == (
        "[I01I01[t+I01I01+I02I02[t+I02I02+F]I02[T-I02F]I02F]I01[T-I01I02I02[t+I02I02+F]I02"
        "[T-I02F]I02F]I01I02I02[t+I02I02+F]I02[T-I02F]I02F]"
    )
    text, successor = "[F]", "InIn[t+InIn+F]In[T-InF]InF"
    for n in (1, 2, 3):
        text = text.replace("F", successor.replace("In", f"I{n:02d}"))
    assert rewrite(system, 3).text() == text


def test_numbers_conditions_and_generation():
    system = read_system(
        "A(2)F",
        ["A(x) : x > 0 -> F(x*r, n)[A(x - 1)]", "A(x) : x <= 0 -> B", "F -> G"],
        read_constants(["a = 2", "r = a/4"]),
    )
    assert rewrite(system, 1).text() == "F(1,1)[A(1)]G"
    assert rewrite(system, 4).text() == "F(1,1)[F(0.5,2)[B]]G"
    assert not predict(system, 4).exact


@given(
    start=st.integers(0, 6),
    rules=st.lists(st.text(st.sampled_from("abF[]"), max_size=5), min_size=2, max_size=2),
    block=st.integers(1, 9),
)
def test_any_block_size_gives_the_plain_string(start, rules, block):
    """``a`` bears a number that falls to zero; the reference is a loop over Python lists."""
    system = read_system(
        f"a({start})b",
        [
            f"a(k) : k > 0 -> {rules[0].replace('a', 'a(k-1)')}",
            f"b -> {rules[1].replace('a', 'a(9)')}",
        ],
    )
    plain = [("a", start), ("b", None)]
    for _ in range(3):
        following = []
        for symbol, k in plain:
            if symbol == "a" and k > 0:
                following += [(c, k - 1 if c == "a" else None) for c in rules[0]]
            elif symbol == "b":
                following += [(c, 9 if c == "a" else None) for c in rules[1]]
            else:
                following.append((symbol, k))
        plain = following
    kept, engine.BLOCK = engine.BLOCK, block
    try:
        word = rewrite(system, 3)
    finally:
        engine.BLOCK = kept
    assert word.text() == "".join(c if k is None else f"{c}({k})" for c, k in plain)


def test_chances_are_met():
    """Chi-square over 30,000 occurrences; fails with a chance of 1e-6 though all is well."""
    system = read_system("F", ["F -> FFF"])
    many = rewrite(system, 9)
    assert len(many) == 3**9
    chance = read_system("F" * 30000, ["F -> a : 1/3", "F -> b : 1/2", "F -> c : 1/6"])
    text = rewrite(chance, 1, stream(0, "chance")).text()
    seen = np.array([text.count(c) for c in "abc"])
    wanted = 30000 * np.array([1 / 3, 1 / 2, 1 / 6])
    assert ((seen - wanted) ** 2 / wanted).sum() < chi2.ppf(1 - FALSE_ALARM, 2)


def test_one_draw_an_occurrence_whatever_the_block(monkeypatch):
    system = read_system("FG", ["F -> FGF : 1/3", "F -> GF : 2/3", "G -> GG:0.5", "G -> F:0.5"])
    whole = rewrite(system, 7, stream(5, "g")).text()
    monkeypatch.setattr(engine, "BLOCK", 3)
    assert rewrite(system, 7, stream(5, "g")).text() == whole
    assert rewrite(system, 7, stream(6, "g")).text() != whole
    with pytest.raises(ValueError, match="random stream"):
        rewrite(system, 1)


@pytest.mark.slow
def test_expected_size_of_a_stochastic_grammar():
    system = read_system("F", ["F -> FF : 0.5", "F -> F : 0.5"])
    expected = predict(system, 8)
    assert expected.symbols == pytest.approx(1.5**8)
    assert not expected.exact
    sizes = [len(rewrite(system, 8, stream(k, "size"))) for k in range(400)]
    # The mean of 400 sizes: 5 of its standard deviations are left aside with a chance of 6e-7.
    assert np.mean(sizes) == pytest.approx(1.5**8, abs=5 * np.std(sizes) / 20)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axiom", "rules", "generations", "words"),
    [
        ("F", ["F -> FF"], 40, "40 generations make 1,099,511,627,776 symbols"),
        ("F", ["F -> FFF : 0.5", "F -> F : 0.5"], 60, "about 1,152,921,504,606,846,976 symbols"),
        ("F", ["F -> FF"], 1000, "1e301 symbols"),
        ("A(1)", ["A(x) : x > 0 -> " + 400 * "A(x)"], 20, "generation 3 of 20 makes"),
        ("A(1)", ["A(x) -> A(x)A(x)A(x)A(x)"], 13, "67,108,864 symbols"),
        ("A(1,1,1,1)", ["A(a,b,c,d) -> A(a,b,c,d)A(a,b,c,d)"], 24, "67,108,864 numbers on symbols"),
    ],
)
def test_what_would_not_fit_is_refused_with_its_number(axiom, rules, generations, words):
    with pytest.raises(ValueError, match=words):
        rewrite(read_system(axiom, rules), generations, stream(0))


@pytest.mark.parametrize(
    ("axiom", "rules", "words"),
    [
        ("F", ["F FF"], 'has no "->"'),
        ("F", ["-> F"], "no symbol before"),
        ("F", ["FG -> F"], "more than one symbol"),
        ("F(", [], "not closed"),
        ("F", ["F -> F(x)"], '"x" is not known'),
        ("F", ["F(l) -> F(lenght)"], "is not known"),
        ("F", ["F -> F : 0.5", "F -> G : 0.4"], "add up to 0.9"),
        ("F", ["F -> F : 0"], "larger than 0"),
        ("F", ["F -> F", "F -> G"], "give both a probability"),
        ("F", ["F(2) -> F"], "is not a name"),
        ("F", ["F(n) -> F"], "is taken"),
        ("Fé", [], "cannot be a symbol"),
        ("F", ["F -> F(__import__)"], "is not known"),
    ],
)
def test_grammars_that_cannot_be_read(axiom, rules, words):
    with pytest.raises(GrammarError, match=words.replace("(", r"\(")):
        read_system(axiom, rules)


def test_bad_constants_and_divisions():
    with pytest.raises(GrammarError, match="name = number"):
        read_constants(["r"])
    with pytest.raises(GrammarError, match="is taken"):
        read_constants(["n = 2"])
    with pytest.raises(ExpressionError, match="not a finite"):
        rewrite(read_system("A(1)", ["A(x) -> A(1/(x-1))"]), 1)


@pytest.mark.parametrize("text", ["", "[" * 50_000 + "F" + "]" * 50_000])
def test_empty_and_deep_strings(text):
    assert rewrite(read_system(text, ["F -> FF"]), 2).text() == text.replace("F", "FFFF")
