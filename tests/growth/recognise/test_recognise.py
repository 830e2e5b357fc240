"""What is recognised in trees of known structure."""

from __future__ import annotations

import numpy as np
import pytest
from references.model_tree import Model, at, line, tree

from forest_addon.growth.own_tree.centreline import find_contacts
from forest_addon.growth.own_tree.recognise import recognise
from forest_addon.growth.own_tree.template import split_tree


@pytest.mark.medium
@pytest.mark.parametrize(
    "shape",
    [{}, {"sides": 3}, {"sides": 5}, {"sides": 24}, {"capped": True}, {"capped": True, "sides": 6}],
)
def test_structure_is_recognised_whatever_the_tubes_are_made_of(shape: dict[str, object]) -> None:
    model = tree(**shape)  # type: ignore[arg-type]
    model.check(recognise(model.wood(), model.leaves()))


@pytest.mark.medium
@pytest.mark.parametrize("seed", range(1, 6))
def test_structure_does_not_depend_on_the_order_of_facets_nor_on_float32(seed: int) -> None:
    model = tree(seed, branches=5 + seed)
    rng = np.random.default_rng(seed)
    wood = model.wood()
    order = rng.permutation(len(wood))
    shuffled = np.stack([np.roll(f, rng.integers(3), axis=0) for f in wood[order]])
    found = recognise(
        shuffled.astype(np.float32).astype(np.float64),
        model.leaves().astype(np.float32).astype(np.float64),
    )
    model.check(found, order)


def test_foot_tip_and_radius_of_a_straight_tube_are_exact() -> None:
    model = tree()
    found = recognise(model.wood())
    trunk = found.trunk
    np.testing.assert_allclose(found.foot[trunk], model.foot[0], atol=2e-3)
    np.testing.assert_allclose(found.tip[trunk], model.tip[0], atol=2e-3)
    np.testing.assert_allclose(found.radius[trunk], 0.3, rtol=0.03)
    length = float(np.linalg.norm(model.tip[0] - model.foot[0]))
    np.testing.assert_allclose(found.lines.length()[trunk], length, rtol=1e-3)


@pytest.mark.medium
@pytest.mark.parametrize("rings", [2, 3, 7, 40])
@pytest.mark.parametrize("sides", [4, 7, 12])
def test_centreline_does_not_depend_on_where_rings_are(rings: int, sides: int) -> None:
    model = Model()
    model.add(line([0, 0, 0], [0.5, 0, 8], rings), 0.2, -1, sides=sides)
    model.add(line([0.25, 0, 4], [3.25, 1, 5], rings), 0.05, 0, sides=sides)
    found = recognise(model.wood())
    for piece in (0, 1):
        np.testing.assert_allclose(
            found.foot[piece], model.foot[piece], atol=0.05 * model.radius[piece]
        )
        np.testing.assert_allclose(
            found.tip[piece], model.tip[piece], atol=0.05 * model.radius[piece]
        )
        np.testing.assert_allclose(found.radius[piece], model.radius[piece], rtol=0.02)
        knots = found.lines.knot[found.lines.first[piece] : found.lines.first[piece + 1]]
        axis = (model.tip[piece] - model.foot[piece]) / np.linalg.norm(
            model.tip[piece] - model.foot[piece]
        )
        aside = np.cross(knots - model.foot[piece], axis)
        assert np.linalg.norm(aside, axis=1).max() < 0.1 * model.radius[piece]


def test_radius_of_a_rounded_foot_is_that_of_the_tube() -> None:
    lift = np.deg2rad(np.arange(0, 91, 15))
    dome = 0.1 * (1 - np.cos(lift))
    path = np.concatenate([dome, np.linspace(0.2, 3, 20)])[:, None] * [1.0, 0, 0] + [0, 0, 5]
    radius = np.concatenate([0.1 * np.maximum(np.sin(lift), 1e-3), np.full(20, 0.1)])
    model = Model()
    model.add(line([0, 0, 0], [0, 0, 10]), 0.3, -1)
    model.add(path, radius, 0, sides=12)
    found = recognise(model.wood())
    assert found.radius[1] == pytest.approx(0.1, rel=0.05)
    np.testing.assert_allclose(found.foot[1], [0, 0, 5], atol=0.01)


def test_a_hairpin_is_followed_round_its_bend() -> None:
    """Up 2 m, over an arc of 0.3 m radius, and down again, nearer to the ground than its foot is."""
    arc = np.linspace(0, np.pi, 9)
    bend = np.stack([0.5 - 0.3 * np.cos(arc), 0 * arc, 7 + 0.3 * np.sin(arc)], axis=1)
    path = np.concatenate([line([0.2, 0, 5], bend[0])[:-1], bend, line(bend[-1], [0.8, 0, 3])[1:]])
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 10]), 0.3, -1)
    hairpin = model.add(path, np.linspace(0.05, 0.02, len(path)), trunk)
    model.add(line([0.8, 0, 3.5], [1.4, 0, 3.6]), np.linspace(0.01, 0.003, 6), hairpin)
    found = recognise(model.wood())
    model.check(found)
    np.testing.assert_allclose(found.tip[1], [0.8, 0, 3], atol=0.02)
    drawn = 2.0 + 0.3 * np.pi + 4.0
    np.testing.assert_allclose(found.lines.length()[1], drawn, rtol=0.03)


def test_branches_of_a_whorl_hang_on_the_trunk_and_not_on_each_other() -> None:
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 10], 8), np.linspace(0.2, 0.1, 8), -1)
    for turn in np.arange(8) * np.pi / 4:
        out = np.array([np.cos(turn), np.sin(turn), 0.4])
        model.add(line([0, 0, 5], np.array([0, 0, 5]) + 2 * out), np.linspace(0.08, 0.02, 6), trunk)
    model.check(recognise(model.wood()))


def test_feet_just_off_the_bark_hang_on_the_trunk_and_not_on_a_nearer_neighbour() -> None:
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 10], 20), 0.3, -1, sides=64)
    thick = np.linspace(0.1, 0.03, 6)
    model.add(line([0.31, 0, 5], [2.3, 0, 5.5]), thick, trunk)  # a tenth of its radius off
    model.add(line([0.34, 0, 4.88], [2.3, 0, 3.9]), thick, trunk)  # 0.04 off, 0.02 from the other
    model.check(recognise(model.wood()))


def test_feet_on_the_bark_and_feet_that_float_are_hung_too() -> None:
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 10], 20), 0.2, -1)
    for number, gap in enumerate((-0.1, -0.01, 0.0, 0.02, 0.3)):
        foot = np.array([0.2 + gap, 0, 2.0 + 1.5 * number])
        branch = model.add(line(foot, foot + at(2, 0, 1)), np.linspace(0.04, 0.01, 6), trunk)
        foot = foot + at(1, 0.03, 0.5)
        model.add(line(foot, foot + at(0.2, 0.5, 0.2)), np.linspace(0.008, 0.003, 6), branch)
    found = recognise(model.wood())
    model.check(found)
    for number, gap in enumerate((-0.1, -0.01, 0.0, 0.02, 0.3)):
        assert found.hierarchy.gap[1 + 2 * number] == pytest.approx(gap, abs=0.01)


def test_a_thin_tip_that_touches_a_neighbour_does_not_hang_on_it() -> None:
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 10], 20), 0.2, -1)
    lower = model.add(line([0, 0, 4], [3, 0, 4]), np.linspace(0.08, 0.03, 6), trunk)
    upper = model.add(line([0, 0, 6], [3, 0, 6]), np.linspace(0.08, 0.03, 6), trunk)
    model.add(line([1.5, 0, 4], [1.5, 0, 6]), np.linspace(0.03, 0.01, 6), lower)  # up to the upper
    model.add(
        line([2.5, 0, 6], [0.1, 0, 8]), np.linspace(0.03, 0.01, 6), upper
    )  # back into the trunk
    model.check(recognise(model.wood()))


def test_a_foot_within_its_mother_is_not_hung_on_wood_that_crosses_there() -> None:
    """Twigs begin on the axis of a thin branch that lies against the trunk; their tips pierce another."""
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 10], 20), 0.2, -1)
    branch = model.add(line([0, 0, 3], [2, 0, 3]), np.linspace(0.08, 0.04, 6), trunk)
    hanging = model.add(line([1, 0, 3], [0.16, 0.1, 7]), np.linspace(0.03, 0.02, 6), branch)
    at_tip = at(1, 0, 3) + 0.975 * at(-0.84, 0.1, 4)
    for way in (
        at(1, 0.3, 0),
        at(0.3, 1, 0.2),
        at(1, 1, 0.5),
    ):  # within each other, and in the trunk
        model.add(line(at_tip, at_tip + 0.5 * way), np.linspace(0.016, 0.012, 6), hanging)
    model.add(line([0.58, 0.05, 5], [0, 0.0, 6]), np.linspace(0.012, 0.011, 6), hanging)
    model.check(recognise(model.wood()))


def test_pieces_that_begin_within_each_other_are_hung_all_the_same() -> None:
    """Three that float, each with its thick end in the next: a ring has no root."""
    model = Model()
    model.add(line([0, 0, 0], [0, 0, 10], 20), 0.2, -1)
    corners = [at(1, 0, 5), at(2, 0, 5), at(1.5, 0.8, 5)]
    for number in range(3):
        end = corners[(number + 1) % 3]
        model.add(line(end, corners[number] + 0.2 * (corners[number] - end)), 0.03, 0)
    found = recognise(model.wood())
    assert (found.parent[1:] >= 0).all()
    assert np.count_nonzero(found.parent == 0) == 1


def test_a_column_is_a_trunk_with_steep_branches_beside_it() -> None:
    """Forty branches that rise along the trunk, as a poplar's or a cypress', each twice as long as its bark
    is away from the next."""
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 12], 24), np.linspace(0.2, 0.03, 24), -1)
    rise = np.linspace(0, 1, 10)
    for number in range(40):
        turn, z = 2.4 * number, 1.0 + 0.25 * number
        out = at(np.cos(turn), np.sin(turn), 0) * (0.28 + 0.2 * (1 - z / 12))
        path = at(0, 0, z) + np.outer(1 - (1 - rise) ** 3, out) + np.outer(1.4 * rise, at(0, 0, 1))
        model.add(path, np.linspace(0.3, 0.1, 10) * (0.2 - 0.014 * z), trunk)
    model.check(recognise(model.wood()))


def test_of_several_stems_the_largest_is_the_trunk() -> None:
    model = Model()
    for x, radius, top in ((0.0, 0.08, 4.0), (0.15, 0.1, 6.0), (0.3, 0.085, 5.0)):
        model.add(line([x, 0, 0.01 * x], [2 * x, 0, top]), np.linspace(radius, radius / 2, 6), 1)
    model.parents[1] = -1
    found = recognise(model.wood())
    assert found.trunk == 1
    np.testing.assert_array_equal(found.parent, [1, -1, 1])
    assert [b.height for b in split_tree(model.wood()).branches] == pytest.approx([0, 0], abs=0.02)


def test_a_limb_thicker_than_the_tapered_trunk_is_not_the_trunk() -> None:
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 3]), np.linspace(0.3, 0.2, 6), -1)
    model.add(line([0, 0, 2.8], [3, 0, 9]), np.linspace(0.32, 0.1, 6), trunk)
    model.check(recognise(model.wood()))


def test_a_leaf_hangs_by_the_middle_of_its_side_too() -> None:
    """Its corners are nearer to the neighbour's bark than to that of its own twig."""
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 5]), 0.1, -1)
    own = model.add(line([0, 0, 3], [2, 0, 3]), np.linspace(0.02, 0.015, 6), trunk)
    model.add(line([0, 0, 3.1], [2, 0, 3.1]), np.linspace(0.02, 0.015, 6), trunk)
    model.leaf(own, [1, 0, 3], [0, 1, 0], [0, 0, 1], 0.1, 0.14)
    model.check(recognise(model.wood(), model.leaves()))


def test_a_leaf_in_a_fork_hangs_on_the_twig() -> None:
    """Its foot is inside both the twig and the branch that bears it, and deeper in the branch."""
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 5]), 0.1, -1)
    branch = model.add(line([0, 0, 3], [2, 0, 3]), np.linspace(0.06, 0.05, 6), trunk)
    twig = model.add(line([1, 0, 3], [1, 1, 3]), np.linspace(0.01, 0.005, 6), branch)
    model.leaf(twig, [1, 0.03, 3], [0, 0.6, 0.8], [1, 0, 0])
    model.check(recognise(model.wood(), model.leaves()))


@pytest.mark.slow
def test_contacts_agree_with_a_search_of_all_wood() -> None:
    model = tree(3)
    found = recognise(model.wood())
    lines = found.lines
    rng = np.random.default_rng(5)
    low, high = model.wood().reshape(-1, 3).min(axis=0), model.wood().reshape(-1, 3).max(axis=0)
    scattered = rng.uniform(low, high, (300, 3))
    near = lines.knot[rng.integers(len(lines.knot), size=600)] + rng.normal(size=(600, 3)) * 0.04
    points = np.concatenate([scattered, near])
    contact = find_contacts(lines, np.arange(found.wood.count), points)

    gaps = np.full((len(points), found.wood.count), np.inf)
    for piece in range(found.wood.count):
        knots = slice(lines.first[piece], lines.first[piece + 1])
        fine = np.linspace(0, lines.along[knots][-1], 2000)
        axis = np.stack(
            [np.interp(fine, lines.along[knots], lines.knot[knots, k]) for k in range(3)], axis=1
        )
        radius = np.interp(fine, lines.along[knots], lines.radius[knots])
        distance = np.linalg.norm(points[:, None] - axis, axis=2) - radius
        gaps[:, piece] = distance.min(axis=1)
    exact = gaps.min(axis=1)
    missed = contact.gap - exact
    assert missed.min() > -1e-3  # never nearer than there is wood
    inside = exact < 0
    assert np.count_nonzero(inside) > 100
    assert np.all(contact.gap[inside] < 1e-3)
    assert np.mean(missed < 2e-3) > 0.97  # far from all wood, the second nearest may be taken,
    assert np.all(missed < 0.2 * np.maximum(exact, 0.02))  # but none that is much farther
    np.testing.assert_allclose(
        contact.gap, gaps[np.arange(len(points)), contact.piece], rtol=0, atol=5e-3
    )
