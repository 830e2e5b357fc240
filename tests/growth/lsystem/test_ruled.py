"""S's apple trees and ABOP's: measures of internodes, pruning, leaves, tropism."""

import dataclasses

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings, structure
from forest_addon.growth.library.species_file import find_species
from forest_addon.growth.lsystem.ruled import system_of
from forest_addon.growth.lsystem.system import GrammarError, read_system, rewrite
from forest_addon.growth.lsystem.turtle import ABOP, prune_descending, read_commands, walk
from forest_addon.growth.species import skeleton_of
from forest_addon.spec import Grammar, Leaf, Rules, SpecError, Species


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
    # V = sum of pi d² h/4, as S computes it from counts of internodes by generation
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
    mother = pruned.parent[1:]
    assert np.allclose(pruned.start[1:], pruned.end[mother])
    assert (leaves.segment < len(pruned)).all()
    assert np.allclose(leaves.foot, pruned.end[leaves.segment])


def test_pruning_takes_all_that_a_branch_bears():
    text = "F(1)[&(100)F(1)[^(100)F(1)~]]~[&(30)F(1)[&(90)F(2)]F(1)~]F(1)"
    word = rewrite(read_system(text, []), 0)
    known = {"length": 1.0, "angle": 0.0, "rotation": 0.0, "thinning": 1.0}
    walked = prune_descending(walk(read_commands(word, ABOP.symbols, known), 0.1))
    assert walked.skeleton.parent.tolist() == [-1, 0, 1, 0]
    assert walked.skeleton.order.tolist() == [0, 1, 1, 0]
    assert walked.leaves.segment.tolist() == [0, 2]


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


def test_abop_ternary_tree_grows_threefold_and_bends_down():
    species = preset("abop-ternary-a")
    skeleton, _ = grown(species)
    assert len(skeleton) == 2 * 3**6 - 1
    straight, _ = grown(but(species, elasticity=0.0))
    assert len(straight) == len(skeleton)
    assert skeleton.end[:, 2].max() < straight.end[:, 2].max()
    assert skeleton.end[0] == pytest.approx(straight.end[0])  # upright against the tropism


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


def test_what_cannot_be_used_is_said():
    with pytest.raises(SpecError, match="beside template"):
        Species(name="x", template=preset("maple").template, rules=Rules(axiom="F"))
    with pytest.raises(GrammarError, match='axiom: "x": "x" is not known'):
        grown(Species(name="x", rules=Rules(axiom="F(x)")))
    growing = Species(
        name="x", rules=Rules(axiom="F", productions=("F -> F[+F]F",), generations=30)
    )
    with pytest.raises(ValueError, match="30 generations make"):
        grown(growing)


def test_trees_too_large_to_walk_or_to_stand_are_refused_with_their_size():
    long = Species(name="x", rules=Rules(axiom="F", productions=("F -> F[+F]F",), generations=15))
    with pytest.raises(ValueError, match="15 generations make 35,872,266 symbols"):
        grown(long)
    wide = Species(
        name="x", rules=Rules(axiom="A(1)", productions=("A(l) -> F(l)A(l*4)",), generations=9)
    )
    with pytest.raises(ValueError, match="reach 87,381 m"):
        grown(wide)
    with pytest.raises(SpecError, match="reach 16,382 m"):
        Grammar(side_ratio=2.0, generations=12)


@pytest.mark.parametrize("ratio", [0.0, -0.5, float("nan")])
@pytest.mark.parametrize("key", ["side_ratio", "centre_ratio", "radius_ratio"])
def test_ratios_of_a_grammar_that_cannot_be_are_refused(key, ratio):
    with pytest.raises(SpecError, match="out of range"):
        Grammar(**{key: ratio})
