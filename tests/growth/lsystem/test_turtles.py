"""The general turtle against a plain one on random grammars, and on the hard cases. Méndez et al.'s apple
trees and ABOP's: measures of internodes, pruning, leaves, tropism. Tanveer et al.'s turtle against known
angles, lengths and topology, and against a plain recursive turtle.
"""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, strategies as st
from references.turtles import grow_plainly, walk_plainly
from scipy.stats import chi2

from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings, structure
from forest_addon.growth.library import find_species
from forest_addon.growth.lsystem import system as engine
from forest_addon.growth.lsystem.branching import (
    CENTRE,
    SIDE,
    SYMMETRIC,
    interpret,
    parse,
    skeleton_of,
    string_of,
)
from forest_addon.growth.lsystem.system import (
    ExpressionError,
    Notation,
    parse_expression,
    predict,
    read_constants,
    read_system,
    rewrite,
)
from forest_addon.growth.lsystem.turtle import (
    ABOP,
    SIMLIDAR,
    read_commands,
    system_of,
    walk,
)
from forest_addon.spec import Grammar, Jitter, Leaf, Rules, Species

KNOWN = {"length": 0.7, "angle": 25.0, "rotation": 20.0, "thinning": 0.8}
STILL = Jitter(length=0, angle_deg=0, twist_deg=0, raise_ratio=0, lean_deg=0, leaf_size=0)


def walk_text(text, tropism=(0.0, 0.0, -1.0), elasticity=0.0, symbols=ABOP.symbols, known=KNOWN):
    word = rewrite(read_system(text, []), 0)
    return walk(read_commands(word, symbols, known), 0.1, tropism, elasticity)


number = st.floats(0.01, 3).map(lambda x: f"({x!r})")
degrees = st.sampled_from([0.0, 180.0, 90.0, -30.0, 137.5, 12.25]).map(lambda x: f"({x})")
plain = st.sampled_from(list("FFFAAf+-&^\\/|$!~"))
module = st.one_of(
    plain,
    st.tuples(st.sampled_from("Ff!"), number).map("".join),
    st.tuples(st.sampled_from("+-&^\\/"), degrees).map("".join),
)
string = st.recursive(
    st.lists(module, max_size=5).map("".join),
    lambda inner: st.lists(st.one_of(module, inner.map(lambda text: f"[{text}]")), max_size=5).map(
        "".join
    ),
    max_leaves=8,
)


@given(
    axiom=string,
    rule=string,
    elasticity=st.sampled_from([0.0, 0.0, 0.3]),
    tropism=st.sampled_from([(0.0, 0.0, -1.0), (0.3, -0.2, 0.9)]),
)
def test_equals_the_plain_turtle_on_random_grammars(axiom, rule, elasticity, tropism):
    word = rewrite(read_system(axiom + "A", [f"A -> {rule}"]), 2)
    letters, values = word.alphabet.letters(), iter(word.values.tolist())
    text = "".join(  # numbers in full: text() shortens them
        symbol + (f"({next(values)!r})" if arity else "")
        for symbol, arity in map(letters.get, word.codes.tolist())
    )
    segments, leaves = walk_plainly(
        text, 0.7, 25.0, 0.8, 0.1, tropism=tropism, elasticity=elasticity
    )
    s, sites = walk(read_commands(word, ABOP.symbols, KNOWN), 0.1, tropism, elasticity)
    assert len(s) == len(segments)
    assert len(sites) == len(leaves)
    for i, (start, end, width, parent, order, generation) in enumerate(segments):
        assert np.abs(s.start[i] - start).max() < 1e-12
        assert np.abs(s.end[i] - end).max() < 1e-12
        assert s.radius[i] == pytest.approx([width / 2, width / 2], rel=1e-12)
        assert (s.parent[i], s.order[i], s.generation[i]) == (parent, order, generation)
    for i, (foot, heading, up, segment) in enumerate(leaves):
        assert np.abs(sites.foot[i] - foot).max() < 1e-12
        assert np.abs(sites.direction[i] - heading).max() < 1e-12
        assert np.abs(sites.up[i] - up).max() < 1e-12
        assert sites.segment[i] == segment


def test_turns_are_right_handed_about_up_left_and_heading():
    ends = walk_text("[+(90)F(1)][&(90)F(1)][\\(90)+(90)F(1)]")[0].end
    assert ends == pytest.approx(np.array([[1, 0, 0], [0, -1, 0], [0, 1, 0]]), abs=1e-15)


def test_tropism_bends_a_level_branch_by_its_elasticity():
    s = walk_text("+(90)F(1)F(1)", (0, 0, -1), 0.25)[0]
    assert s.end[1] - s.end[0] == pytest.approx([np.cos(0.25), 0, -np.sin(0.25)])


def test_deep_brackets_do_not_overflow():
    depth = 2_000
    wood, _ = walk_text("F(1)" + "[" * depth + "+F(1)" + "]" * depth + "[" * 100 + "F(1)")
    assert wood.parent.tolist() == [-1, 0, 0]
    nested, _ = walk_text("[F" * 1000 + "]" * 1000)
    assert nested.order.tolist() == list(range(1000))
    assert nested.end[-1, 2] == pytest.approx(700)


def test_a_long_axis_stays_exact():
    ends = walk_text("F(1)+(1)" * 1080)[0].end
    assert np.abs(ends[359::360]).max() < 1e-10  # three times round a polygon of 360 sides


@pytest.mark.parametrize("text", ["", "AB", "[]", "f+f", "[[]]A"])
def test_strings_that_draw_nothing(text):
    wood, leaves = walk_text(text)
    assert len(wood) == len(leaves) == 0
    assert wood.end.shape == (0, 3)


def test_outlines_are_leaves_and_no_wood():
    wood, leaves = walk_text("F(1)[+(90){-(30)f(1)+(30)f(1)+(30)f(1)}]F(1){F(2)}")
    assert len(wood) == 2
    assert leaves.foot.tolist() == [[0, 0, 1], [0, 0, 2]]
    assert leaves.direction[0] == pytest.approx([1, 0, 0])
    assert leaves.length.tolist() == pytest.approx([1 + np.sqrt(3), 2])
    assert leaves.width.tolist() == pytest.approx([0.5, 0])
    assert leaves.segment.tolist() == [0, 1]


def test_a_users_symbols_over_the_dialects():
    wood, sites = walk_text(
        "X(2)L", symbols=(*ABOP.symbols, "X(a) = draw(a * length, a)", "L = leaf(1)")
    )
    assert wood.end[0, 2] == pytest.approx(1.4)
    assert wood.radius[0].tolist() == [1, 1]
    assert sites.length.tolist() == [1]


def preset(name, tmp_path=None):
    return read_settings(find_species(name, tmp_path), Species)


def but(species, **changes):
    return dataclasses.replace(species, rules=dataclasses.replace(species.rules, **changes))


def grown(species, seed=0):
    return skeleton_of(species, stream(seed, "test"))


def test_internodes_of_s_have_their_length_and_diameter():
    species = but(preset("apple"), generations=5, prune_descending=False)
    skeleton, _ = grown(species)
    text = rewrite(system_of(species.rules), species.rules.generations).text()
    tags = np.array([int(text[i + 1 : i + 3]) for i, c in enumerate(text) if c == "I"])
    assert len(skeleton) == len(tags)
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    assert length == pytest.approx(0.42 / 2.0 ** (tags - 1))
    assert skeleton.radius[:, 0] * 2 == pytest.approx(5 * 0.006 / tags)
    assert (skeleton.radius[:, 0] == skeleton.radius[:, 1]).all()
    # V = sum of pi d² h/4, as Méndez et al. compute it from counts of internodes by generation
    counts = np.bincount(tags, minlength=6)
    n = np.arange(1, 6)
    wanted = (counts[1:] * np.pi * (5 * 0.006 / n) ** 2 * 0.42 / 2.0 ** (n - 1) / 4).sum()
    assert (np.pi * skeleton.radius[:, 0] ** 2 * length).sum() == pytest.approx(wanted)


@pytest.mark.parametrize("name", ["apple", "apple-stochastic"])
def test_nothing_descends_after_pruning(name):
    wild, _ = grown(but(preset(name), prune_descending=False))
    pruned, leaves = grown(preset(name))
    assert 0 < len(pruned) < len(wild)
    assert (wild.end[:, 2] < wild.start[:, 2]).any()
    assert (pruned.end[:, 2] >= pruned.start[:, 2] - 1e-9).all()
    assert (pruned.parent < np.arange(len(pruned))).all()
    parent = pruned.parent[1:]
    assert np.allclose(pruned.start[1:], pruned.end[parent])
    assert (leaves.segment < len(pruned)).all()
    assert np.allclose(leaves.foot, pruned.end[leaves.segment])


def test_pruning_takes_all_that_a_branch_bears():
    text = "F(1)[&(100)F(1)[^(100)F(1)~]]~[&(30)F(1)[&(90)F(2)]F(1)~]F(1)"
    word = rewrite(read_system(text, []), 0)
    known = {"length": 1.0, "angle": 0.0, "rotation": 0.0, "thinning": 1.0}
    commands = read_commands(word, ABOP.symbols, known)
    wood, leaves = walk(commands, 0.1, prune_descending=True)
    assert wood.parent.tolist() == [-1, 0, 1, 0]
    assert wood.order.tolist() == [0, 1, 1, 0]
    assert leaves.segment.tolist() == [0, 2]


def test_leafless_and_leafy_apples_have_the_same_wood():
    bare, none = grown(preset("apple-leafless"))
    leafy, leaves = grown(preset("apple"))
    assert len(none) == 0 < len(leaves)
    assert (bare.end == leafy.end).all()
    stochastic = preset("apple-stochastic")
    off = dataclasses.replace(stochastic, leaf=Leaf(on=False))
    assert (grown(stochastic, 4)[0].end == grown(off, 4)[0].end).all()
    one, other = grown(stochastic, 4)[0], grown(stochastic, 5)[0]
    assert len(one) != len(other) or not np.allclose(one.end, other.end)


def test_no_generation_of_s_is_a_leaf_without_wood():
    skeleton, leaves = grown(but(preset("apple"), generations=0))
    assert len(skeleton) == 0
    assert leaves.segment.tolist() == [-1]
    assert leaves.foot.tolist() == [[0, 0, 0]]


def test_abop_monopodial_trees_have_their_angles_and_ratios():
    skeleton, _ = grown(preset("abop-monopodial-a"))
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    heading = (skeleton.end - skeleton.start) / length[:, None]
    trunk = skeleton.axis(0)
    assert len(trunk) == 10
    assert length[trunk] == pytest.approx(0.9 ** np.arange(10))
    assert skeleton.radius[trunk, 0] == pytest.approx(0.05 * 0.707 ** np.arange(10))
    sides = [np.flatnonzero((skeleton.parent == t) & (skeleton.order == 1)) for t in trunk[:9]]
    assert all(len(s) == 1 for s in sides)
    first = np.concatenate(sides)
    assert heading[first, 2] == pytest.approx(np.cos(np.deg2rad(45)))
    azimuth = np.rad2deg(np.arctan2(heading[first, 1], heading[first, 0]))
    assert np.diff(azimuth) % 360 == pytest.approx([360 - 137.5] * 8)  # "/" rolls to the right


def test_a_users_rules_in_plain_tables():
    species = structure(
        {
            "name": "mine",
            "rules": {
                "axiom": "A(s)",
                "productions": ["A(x) : x > 0.2 -> X(x)[+A(x*r)][-A(x*r)]", "A(x) : x <= 0.2 -> L"],
                "constants": ["s = 1", "r = s/2"],
                "symbols": ["X(x) = draw(x, x/10)", "L = leaf(0.1, 0.05)"],
                "generations": 5,
                "scale": 2.0,
            },
        },
        Species,
    )
    skeleton, leaves = grown(species)
    assert len(skeleton) == 1 + 2 + 4
    assert len(leaves) == 8
    assert skeleton.end[0].tolist() == [0, 0, 2]
    assert skeleton.radius[0].tolist() == [0.1, 0.1]
    assert leaves.length.tolist() == [0.2] * 8
    assert leaves.width.tolist() == [0.1] * 8


def derived(generations):
    return string_of(Grammar(generations=generations))


def skeleton(generations, grammar=None, jitter=STILL, seed=0):
    return interpret(derived(generations), grammar or Grammar(), jitter, stream(seed, "test"))


def test_mothers_and_roles_of_the_second_iteration():
    parent, role = parse(derived(2))
    # d ( d (g) [g) + g ) [ d (g) [g) + g ) + d (g) [g) + g )
    assert parent.tolist() == [-1, 0, 1, 1, 1, 0, 5, 5, 5, 0, 9, 9, 9]
    assert role.tolist() == [CENTRE] + [
        r for first in (SIDE, CENTRE, SYMMETRIC) for r in (first, SIDE, CENTRE, SYMMETRIC)
    ]


@pytest.mark.parametrize("text", ["d)g", "d(g))g", "d(g"])
def test_symbols_that_are_of_no_string(text):
    codes = np.frombuffer(text.encode(), np.uint8)
    if text == "d(g":  # an unclosed branch is harmless
        assert parse(codes)[0].tolist() == [-1, 0]
        return
    with pytest.raises(ValueError, match="bracket"):
        parse(codes)


@pytest.mark.parametrize("seed", range(5))
def test_equals_a_plain_recursive_turtle_with_jitter(seed):
    jitter = Jitter(length=0.1, angle_deg=6, twist_deg=9, raise_ratio=0.5, lean_deg=4)
    grammar = Grammar(angle_deg=40, twist_deg=25)
    ours = skeleton(4, grammar, jitter, seed)
    start, end, radius = grow_plainly(derived(4), grammar, jitter, stream(seed, "test"))
    assert np.abs(ours.start - start).max() < 1e-12
    assert np.abs(ours.end - end).max() < 1e-12
    assert np.abs(ours.radius[:, 0] - radius).max() < 1e-15


# -------------------------------------------------------------------------------------------- system
# Parallel rewriting against Tanveer et al.'s strings and a plain string rewriter. Parametric and stochastic
# rewriting: strings of the papers, plain rewriting, chances, refusals. Arithmetic of productions against
# Python's own, and refusals.

symbols = st.sampled_from("abcd[]")
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


def rewrite_plainly(text, rules, generations):
    for _ in range(generations):
        text = "".join(rules.get(c, c) for c in text)
    return text


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


def test_expected_size_of_a_stochastic_grammar():
    system = read_system("F", ["F -> FF : 0.5", "F -> F : 0.5"])
    expected = predict(system, 8)
    assert expected.symbols == pytest.approx(1.5**8)
    assert not expected.exact
    sizes = [len(rewrite(system, 8, stream(k, "size"))) for k in range(200)]
    # The mean of 200 sizes: 5 of its standard deviations are left aside with a chance of 6e-7.
    assert np.mean(sizes) == pytest.approx(1.5**8, abs=5 * np.std(sizes) / 200**0.5)


@pytest.mark.parametrize("text", ["", "[" * 50_000 + "F" + "]" * 50_000])
def test_empty_and_deep_strings(text):
    assert rewrite(read_system(text, ["F -> FF"]), 2).text() == text.replace("F", "FFFF")


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


def test_a_division_by_zero_is_refused_with_the_text():
    ratio = parse_expression("1 / l", ["l"])
    assert ratio({"l": np.array([1.0, 2.0])}).tolist() == [1, 0.5]
    with pytest.raises(ExpressionError, match=r'"1 / l" is not a finite'):
        ratio({"l": np.array([1.0, 0.0])})


# ------------------------------------------------------------------------------------------ refusals

WALKS = [
    ("F]", ABOP.symbols, "not opened"),
    ("[F]]F", ABOP.symbols, "not opened"),
    ("F}", ABOP.symbols, "not opened"),
    ("F(1,2)", ABOP.symbols, '"F" takes 0 or 1 numbers, not 2'),
    ("!(-1)F", ABOP.symbols, "negative"),
    ("F", ("F = jump",), '"jump" is not known'),
    ("F", ("F = draw",), "takes 1 to 2"),
    ("F", ("F = draw(speed)",), '"speed" is not known'),
    ("F", ("F",), "is not like"),
    ("I(1)", SIMLIDAR.symbols, '"h0" is not known'),
]
SIZES = [  # axiom, productions and generations, and how many symbols they would make
    ("F", ["F -> FF"], 40, "40 generations make 1,099,511,627,776 symbols"),
    ("F", ["F -> FFF : 0.5", "F -> F : 0.5"], 60, "about 1,152,921,504,606,846,976 symbols"),
    ("F", ["F -> FF"], 1000, "1e301 symbols"),
    ("A(1)", ["A(x) : x > 0 -> " + 400 * "A(x)"], 20, "generation 3 of 20 makes"),
    ("A(1)", ["A(x) -> A(x)A(x)A(x)A(x)"], 13, "67,108,864 symbols"),
    ("A(1,1,1,1)", ["A(a,b,c,d) -> A(a,b,c,d)A(a,b,c,d)"], 24, "67,108,864 numbers on symbols"),
]
GRAMMARS = [
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
]
EXPRESSIONS = [
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
]


def ruled(axiom, *productions, generations=1):
    """Grow a species of these rules."""
    rules = Rules(axiom=axiom, productions=productions, generations=generations)
    return grown(Species(name="x", rules=rules))


REFUSED = [
    *((lambda text=t, symbols=s: walk_text(text, symbols=symbols), words) for t, s, words in WALKS),
    *(
        (
            lambda axiom=a, rules=r, times=n: rewrite(read_system(axiom, rules), times, stream(0)),
            words,
        )
        for a, r, n, words in SIZES
    ),
    *((lambda axiom=a, rules=r: read_system(axiom, rules), words) for a, r, words in GRAMMARS),
    *((lambda text=text: parse_expression(text, ["length"]), words) for text, words in EXPRESSIONS),
    (lambda: read_constants(["r"]), "name = number"),
    (lambda: read_constants(["n = 2"]), "is taken"),
    (
        lambda: Species(name="x", template=preset("maple").template, rules=Rules(axiom="F")),
        "beside template",
    ),
    (lambda: ruled("F(x)"), 'axiom: "x": "x" is not known'),
    (lambda: ruled("F", "F -> F[+F]F", generations=30), "30 generations make"),
    (lambda: ruled("F", "F -> F[+F]F", generations=15), "15 generations make 35,872,266 symbols"),
    (lambda: ruled("A(1)", "A(l) -> F(l)A(l*4)", generations=9), "reach 87,381 m"),
    (lambda: Grammar(side_ratio=2.0, generations=12), "reach 16,382 m"),
]


@pytest.mark.parametrize(("make", "words"), REFUSED)
def test_what_cannot_be_grown_is_refused(make, words):
    with pytest.raises(ValueError, match=words.replace("(", r"\(")):  # every kind of refusal is one
        make()
