"""Parallel rewriting against Tanveer et al.'s strings and a plain string rewriter. Parametric and
stochastic rewriting: strings of the papers, plain rewriting, chances, refusals. Arithmetic of
productions against Python's own, and refusals.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from forest_addon.base.rng import stream
from forest_addon.growth.lsystem import system as engine
from forest_addon.growth.lsystem.branching import string_of
from forest_addon.growth.lsystem.system import (
    ExpressionError,
    GrammarError,
    Notation,
    parse_expression,
    predict,
    read_constants,
    read_system,
    rewrite,
)
from forest_addon.spec import Grammar

symbols = st.sampled_from("abcd[]")
S = Notation(tagged="I")
APPLE = ["F -> InIn[t+InIn+F]In[T-InF]InF"]
FALSE_ALARM = 1e-6  # chance that a distribution test fails though all is well
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
        ("length +", "is not arithmetic"),
        ("(length", "never closed"),
        ("length)", "unmatched"),
        ("(1, 2)", "is not arithmetic"),
        ("min(1)", "takes 2"),
        ("2 3", "is not arithmetic"),
        ("* 2", "is not arithmetic"),
        ("", "is not arithmetic"),
        ("length[0]", "is not arithmetic"),
        ("length # 2", "is not arithmetic"),
        ("lambda: 2", "is not arithmetic"),
        ("length in length", "is not arithmetic"),
        ("min(*length)", "is not arithmetic|takes 2"),
        ("(" * 20000 + "1" + ")" * 20000, "nested|too deep"),
        ("-" * 20000 + "1", "too deep"),
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
