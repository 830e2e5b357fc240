"""The general turtle against a plain one on random grammars, and on the hard cases."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from references.turtle_abop import walk_plainly

from forest_addon.growth.lsystem.expression import ExpressionError
from forest_addon.growth.lsystem.system import GrammarError, read_system, rewrite
from forest_addon.growth.lsystem.turtle import ABOP, Bend, S, read_commands, walk

KNOWN = {"length": 0.7, "angle": 25.0, "rotation": 20.0, "thinning": 0.8}


def walk_text(text, bend=None, symbols=ABOP.symbols, known=KNOWN):
    word = rewrite(read_system(text, []), 0)
    return walk(read_commands(word, symbols, known), 0.1, bend)


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
    walked = walk(read_commands(word, ABOP.symbols, KNOWN), 0.1, Bend(tropism, elasticity))
    s = walked.skeleton
    assert len(s) == len(segments)
    assert len(walked.leaves) == len(leaves)
    for i, (start, end, width, mother, order, generation) in enumerate(segments):
        assert np.abs(s.start[i] - start).max() < 1e-12
        assert np.abs(s.end[i] - end).max() < 1e-12
        assert s.radius[i] == pytest.approx([width / 2, width / 2], rel=1e-12)
        assert (s.parent[i], s.order[i], s.generation[i]) == (mother, order, generation)
    for i, (foot, heading, up, segment) in enumerate(leaves):
        assert np.abs(walked.leaves.foot[i] - foot).max() < 1e-12
        assert np.abs(walked.leaves.direction[i] - heading).max() < 1e-12
        assert np.abs(walked.leaves.up[i] - up).max() < 1e-12
        assert walked.leaves.segment[i] == segment


def test_turns_are_right_handed_about_up_left_and_heading():
    ends = walk_text("[+(90)F(1)][&(90)F(1)][\\(90)+(90)F(1)]").skeleton.end
    assert ends == pytest.approx(np.array([[1, 0, 0], [0, -1, 0], [0, 1, 0]]), abs=1e-15)


@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_straight_up_against_the_tropism_goes_straight_on(direction):
    s = walk_text("FFF", Bend(direction, 0.5)).skeleton
    assert s.end[-1].tolist() == pytest.approx([0, 0, 2.1])


def test_tropism_bends_a_level_branch_by_its_elasticity():
    s = walk_text("+(90)F(1)F(1)", Bend((0, 0, -1), 0.25)).skeleton
    assert s.end[1] - s.end[0] == pytest.approx([np.cos(0.25), 0, -np.sin(0.25)])


@pytest.mark.parametrize("angle", [0.0, 180.0])
def test_angles_of_0_and_180_degrees(angle):
    s = walk_text("F[+F[&F]][-F]F", known=KNOWN | {"angle": angle}).skeleton
    assert np.isfinite(s.end).all()
    assert np.abs(s.end[:, :2]).max() < 1e-15 * 10


@pytest.mark.slow
def test_deep_brackets_do_not_overflow():
    depth = 30_000
    walked = walk_text("F(1)" + "[" * depth + "+F(1)" + "]" * depth + "[" * 100 + "F(1)")
    assert walked.skeleton.parent.tolist() == [-1, 0, 0]
    assert len(walked.mother) == depth + 101
    nested = walk_text("[F" * 3000 + "]" * 3000)
    assert nested.skeleton.order.tolist() == list(range(3000))
    assert nested.skeleton.end[-1, 2] == pytest.approx(2100)


@pytest.mark.medium
def test_a_long_axis_stays_exact():
    ends = walk_text("F(1)+(1)" * 3600).skeleton.end
    assert np.abs(ends[359::360]).max() < 1e-10  # ten times round a polygon of 360 sides


@pytest.mark.parametrize("text", ["", "AB", "[]", "f+f", "[[]]A"])
def test_strings_that_draw_nothing(text):
    walked = walk_text(text)
    assert len(walked.skeleton) == 0
    assert walked.skeleton.end.shape == (0, 3)
    assert len(walked.leaves) == 0


def test_outlines_are_leaves_and_no_wood():
    walked = walk_text("F(1)[+(90){-(30)f(1)+(30)f(1)+(30)f(1)}]F(1){F(2)}", symbols=ABOP.symbols)
    assert len(walked.skeleton) == 2
    leaves = walked.leaves
    assert leaves.foot.tolist() == [[0, 0, 1], [0, 0, 2]]
    assert leaves.direction[0] == pytest.approx([1, 0, 0])
    assert leaves.length.tolist() == pytest.approx([1 + np.sqrt(3), 2])
    assert leaves.width.tolist() == pytest.approx([0.5, 0])
    assert leaves.segment.tolist() == [0, 1]


def test_a_users_symbols_over_the_dialects():
    walked = walk_text(
        "X(2)L", symbols=(*ABOP.symbols, "X(a) = draw(a * length, a)", "L = leaf(1)")
    )
    assert walked.skeleton.end[0, 2] == pytest.approx(1.4)
    assert walked.skeleton.radius[0].tolist() == [1, 1]
    assert walked.leaves.length.tolist() == [1]


@pytest.mark.parametrize(
    ("text", "symbols", "words"),
    [
        ("F]", ABOP.symbols, "not opened"),
        ("[F]]F", ABOP.symbols, "not opened"),
        ("F}", ABOP.symbols, "not opened"),
        ("F(1,2)", ABOP.symbols, '"F" takes 0 or 1 numbers, not 2'),
        ("!(-1)F", ABOP.symbols, "negative"),
        ("F", ("F = jump",), '"jump" is not known'),
        ("F", ("F = draw",), "takes 1 to 2"),
        ("F", ("F = draw(speed)",), '"speed" is not known'),
        ("F", ("F",), "is not like"),
        ("I(1)", S.symbols, '"h0" is not known'),
    ],
)
def test_what_cannot_be_walked_is_refused(text, symbols, words):
    with pytest.raises((GrammarError, ExpressionError), match=words.replace("(", r"\(")):
        walk_text(text, symbols=symbols)
