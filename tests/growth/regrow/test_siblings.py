"""Siblings of trees that we grew ourselves: as like them as was promised, attached, and different."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from references.own_trees import SPECIES, own_tree, sibling

from forest_addon.base.trimesh import WOOD
from forest_addon.growth.likeness import axes_of, compare, insertion_angles, portray, trunk_radius
from forest_addon.growth.own_tree.habit import fit
from forest_addon.growth.own_tree.lines import stand_on
from forest_addon.growth.own_tree.relay import feet_of_leaves, hang_leaves, mesh_of
from forest_addon.growth.own_tree.sibling import grow_sibling
from forest_addon.spec import Siblings, SpecError

COUNT = 30


@cache
def portraits(name):
    return portray(sibling(name, 0, variety=0.0)), [
        portray(sibling(name, seed)) for seed in range(1, COUNT + 1)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECIES)
def test_siblings_are_within_the_goals(name):
    """Means within 10 % and 4.5 standard errors: a false alarm in 10,000 runs; profiles overlap."""
    template, siblings = portraits(name)
    found = compare(template, siblings)
    for row in found.numbers:
        if row.template >= 20 or not row.name.startswith(("branches", "their")):  # else single ones
            error = 4.5 * row.spread / np.sqrt(COUNT)
            room = max(0.1 * abs(row.template), 0.02 * template.numbers["height, m"])
            assert abs(row.mean - row.template) < room + error, row
            assert row.spreads < 2, row
    for profile in found.profiles:
        assert profile.overlap > 0.85, profile
    for sample in found.samples:
        if "deg" in sample.name:
            assert sample.mover < 3.0, sample


@pytest.mark.medium
@pytest.mark.parametrize("name", SPECIES)
def test_every_piece_is_within_its_mother_and_every_leaf_on_its_seat(name):
    own = own_tree(name)
    worst = own.anatomy.foliage.seat.away.max()
    for key in (11, 12):
        grown = grow_sibling(own.habit, Siblings(), key)
        mesh, leaves, _ = mesh_of(own.anatomy, grown, 1.0)
        assert np.isfinite(mesh.vertices).all()
        wood = own.anatomy.wood.stock
        _, owner, _ = wood.triangles.copy(grown.piece)
        facets = mesh.vertices[mesh.triangles[mesh.part == WOOD]]
        begin = np.searchsorted(owner, np.arange(len(grown.piece) + 1))
        feet = grown.lines.knot[grown.lines.first[:-1] + np.arange(len(grown.piece))]
        rng = np.random.default_rng(key)
        borne = np.flatnonzero(grown.mother >= 0)
        for branch in rng.choice(borne, 60, replace=False):
            mother = grown.mother[branch]
            around = facets[begin[mother] : begin[mother + 1]]
            if winding_number(feet[branch], around) < 0.5:
                assert distance(feet[branch], around) < 1e-3
        hung = hang_leaves(own.anatomy, grown, 1.0)
        assert len(hung.branch) == len(leaves)
        place, _, radius = stand_on(grown.lines, hung.branch, hung.seat)
        foot, _ = feet_of_leaves(own.anatomy, grown, hung, True)
        gap = np.linalg.norm(foot - place, axis=1) - radius
        assert gap.max() < worst + 1e-3


@pytest.mark.medium
@pytest.mark.parametrize("name", SPECIES)
def test_no_trunk_is_cut_off(name):
    template = sibling(name, 0, variety=0.0).skeleton
    thin = template.radius[template.order == 0][-1, 1] / template.radius[0, 0]
    for settings in ({}, {"age": 0.5}, {"age": 2.0}, {"height": 14.0}, {"dbh": 0.5}):
        wood = sibling(name, 5, **settings).skeleton
        radius = wood.radius[wood.order == 0]
        assert radius[-1, 1] / radius[0, 0] <= 1.05 * thin
        assert (np.diff(radius[1:, 0]) < 0.02 * radius[0, 0]).all()  # the foot's cap aside


@pytest.mark.slow
def test_siblings_differ_and_follow_from_their_stream():
    one, again, other = (sibling("honda", seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(one.mesh.vertices, again.mesh.vertices)
    assert len(one.leaves) != len(other.leaves)
    heights = [p.numbers["height, m"] for p in portraits("honda")[1]]
    assert 0.05 < np.std(heights) / np.mean(heights) < 0.15


@pytest.mark.medium
def test_the_dial_turns_from_the_tree_itself_to_its_stand():
    def spread(variety):
        found = [portray(sibling("whorled", seed, variety=variety)).numbers for seed in range(8)]
        return np.std([p["height, m"] for p in found]), np.std([p["leaves"] for p in found])

    low, middle, high = spread(0.0), spread(0.3), spread(1.0)
    assert low == (0, 0)
    assert 0 < middle[0] < high[0]
    assert 0 < middle[1] < high[1]


@pytest.mark.medium
def test_whorls_stay_whorls_and_a_spiral_a_spiral():
    wood = sibling("whorled", 3).skeleton
    first, _ = axes_of(wood)
    on_trunk = first[wood.order[first] == 1]
    height = np.sort(wood.start[on_trunk, 2])
    steps = np.diff(height)
    assert (steps < 0.05).sum() >= 0.75 * len(steps)  # five of a whorl stand together
    assert np.median(steps[steps > 0.05]) > 0.3

    habit = own_tree("abop").habit  # 137.5° from branch to branch
    grown = grow_sibling(habit, Siblings(), 3)
    firsts = np.flatnonzero(grown.order == 1)
    up = firsts[np.argsort(grown.share[firsts])]
    heading = grown.lines.frame[grown.lines.first[up], :, 2]
    turn = np.diff(np.arctan2(heading[:, 1], heading[:, 0]))
    off = np.abs(np.abs(np.angle(np.exp(1j * turn))) - np.deg2rad(137.5))  # it may be mirrored
    assert np.rad2deg(np.median(off)) < 12


@pytest.mark.medium
def test_twigs_of_a_weeping_tree_hang():
    def low(tree):
        wood = tree.skeleton
        first, axis = axes_of(wood)
        twig = wood.order[first] == 3
        last = np.zeros(len(first), np.int64)
        last[axis] = np.arange(len(axis))
        way = wood.end[last[twig]] - wood.start[last[twig]]
        return np.rad2deg(np.arccos(way[:, 2] / np.linalg.norm(way, axis=1)))

    template = low(sibling("weeping", 0, variety=0.0))
    grown = np.concatenate([low(sibling("weeping", seed)) for seed in range(4)])
    assert np.median(grown) == pytest.approx(np.median(template), abs=4)
    assert np.percentile(grown, 10) == pytest.approx(np.percentile(template, 10), abs=12)


@pytest.mark.medium
@pytest.mark.parametrize("name", ["honda", "weeping"])
def test_height_and_diameter_are_what_was_asked_for(name):
    tree = sibling(name, 2, height=9.0, dbh=0.4)
    assert tree.skeleton.end[:, 2].max() == pytest.approx(9.0, rel=0.03)
    assert 2 * trunk_radius(tree.skeleton, 1.3) == pytest.approx(0.4, rel=0.03)


@pytest.mark.slow
def test_a_younger_tree_is_smaller_everywhere_with_shoots_as_thin():
    young, old = (portray(sibling("honda", 1, age=age, variety=0.0)).numbers for age in (0.5, 2.0))
    here = portraits("honda")[0].numbers
    for name in ("height, m", "DBH, cm", "crown width, m", "branches of order 1", "leaves"):
        assert young[name] < here[name] < old[name], name
    assert young["DBH, cm"] == pytest.approx(0.5 * here["DBH, cm"], rel=0.02)
    assert old["height, m"] / here["height, m"] == pytest.approx(2**0.666, rel=0.12)
    tips = [sibling("honda", 1, age=age).skeleton.radius.min() for age in (1.0, 2.0)]
    assert tips[1] < 1.5 * tips[0]


def test_members_of_a_class_are_alike_and_every_piece_is_in_one():
    habit = fit(own_tree("honda").anatomy)
    reach = habit.anatomy.lines.reach()
    for kind in range(len(habit.of_class.size)):
        member = habit.member[habit.of_class.first[kind] :][: habit.of_class.size[kind]]
        assert len(np.unique(habit.anatomy.order[member])) == 1
        assert np.ptp(np.log(reach[member])) < 0.46
    assert len(np.unique(habit.member)) == habit.anatomy.count


def test_tables_say_how_a_cone_is_made():
    """In the whorled tree branches shorten evenly to 0.19 of the lowest; insertion falls from 80°."""
    table = own_tree("whorled").habit.tables[0]
    low, high = np.interp([0.25, 0.85], table.share, table.length)
    reach = own_tree("whorled").anatomy.lines.reach().max()
    wood = sibling("whorled", 0, variety=0.0).skeleton
    first, axis = axes_of(wood)
    length = np.bincount(axis, np.linalg.norm(wood.end - wood.start, axis=1))
    mine = wood.order[first] == 1
    share = wood.start[first[mine], 2] / reach
    near = [np.abs(share - at) < 0.05 for at in (0.25, 0.85)]
    assert low == pytest.approx(length[mine][near[0]].mean() / reach, rel=0.1)
    assert high == pytest.approx(length[mine][near[1]].mean() / reach, rel=0.1)
    angle = np.rad2deg(insertion_angles(wood)[mine])
    found = np.rad2deg(np.interp(0.25, table.share, table.angle))
    assert found == pytest.approx(angle[near[0]].mean(), abs=3)


def test_settings_that_contradict_each_other_are_refused():
    with pytest.raises(SpecError, match="beside age"):
        Siblings(age=2.0, height=10.0)


def winding_number(point, facets):
    """How often closed facets (T, 3, 3) go around a point: 1 inside, 0 outside (Van Oosterom 1983)."""
    a, b, c = (facets[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    above = np.einsum("ti,ti->t", a, np.cross(b, c))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return abs(np.arctan2(above, below).sum() / (2 * np.pi))


def distance(point, facets):
    """To the nearest of a fine grid of places on facets, brute force."""
    share = np.linspace(0, 1, 25)
    u, v = (grid.ravel() for grid in np.meshgrid(share, share))
    u, v = u[u + v <= 1], v[u + v <= 1]
    near = facets[np.argsort(np.linalg.norm(facets - point, axis=2).min(axis=1))[:60]]
    places = near[:, 0, None] * (1 - u - v)[:, None] + near[:, 1, None] * u[:, None]
    places = places + near[:, 2, None] * v[:, None]
    return np.linalg.norm(places - point, axis=2).min()
