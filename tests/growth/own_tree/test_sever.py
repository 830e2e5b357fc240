"""Trees in one mesh: cut at their forks into what was joined."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.joined_tree import box_tree, remeshed
from references.model_tree import Model, at, line, tree, tube
from scipy.spatial import cKDTree

from forest_addon.base.rng import stream
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.own_tree.pieces import join_along, part
from forest_addon.growth.own_tree.recognise import LeanError, Recognition, TemplateError, recognise
from forest_addon.growth.own_tree.template import split_tree
from forest_addon.growth.skeleton import Skeleton, depths
from forest_addon.growth.tree import grow


def corners(facets: np.ndarray) -> np.ndarray:
    """Facets as sorted rows, to be compared as sets."""
    rows = np.sort(np.round(facets, 9).view([("", float)] * 3).reshape(-1, 3), axis=1)
    return np.sort(rows.view([("", rows.dtype)] * 3).ravel())


# ------------------------------------------------------------------------------ box-modelled


def check_box(found: Recognition) -> None:
    model = box_tree()
    number = np.array(
        [np.argmin(np.linalg.norm(found.tip - r[-1].mean(axis=0), axis=1)) for r in model.rings]
    )
    assert sorted(number) == list(range(len(model.rings))) == list(range(found.wood.count))
    parents = np.array(model.parents)
    expected = np.where(parents < 0, -1, number[parents])
    np.testing.assert_array_equal(found.parent[number], expected)
    # a branch was drawn from her parent's bark, and goes on to her axis
    bark = np.array([0.0 if p < 0 else model.radius[p] for p in parents])
    length = found.lines.length()[number]
    assert np.all(length > 0.97 * np.array(model.length))
    assert np.all(length < 1.03 * np.array(model.length) + 2.5 * bark)
    np.testing.assert_allclose(found.radius[number], model.radius, rtol=0.35)


def test_a_box_modelled_tree_is_cut_at_its_forks() -> None:
    facets = box_tree().facets()
    assert part(facets).count == 1
    found = recognise(facets)
    check_box(found)
    assert found.doubts == ()
    wood = found.wood
    shown = wood.vertices[wood.triangles[: wood.drawn]]
    np.testing.assert_array_equal(corners(shown), corners(facets))  # none lost, none twice
    assert len(wood.triangles) > wood.drawn
    split = split_tree(facets)
    assert len(split.branches) == 7


def test_feet_reach_into_the_mother_and_holes_are_closed() -> None:
    found = recognise(box_tree().facets())
    hangs = found.parent >= 0
    assert np.all(found.gap[hangs] <= 0.2 * found.radius[hangs])
    for piece in range(found.wood.count):
        own = found.wood.triangles[found.wood.piece == piece].astype(np.int64)
        edges = np.sort(np.concatenate([own[:, [0, 1]], own[:, [1, 2]], own[:, [2, 0]]]), axis=1)
        edge, times = np.unique(edges, axis=0, return_counts=True)
        assert times.max() == 2
        rim = edge[times == 1]
        loop = join_along(rim, len(found.wood.vertices))[rim[:, 0]]
        assert len(np.unique(loop)) == 2, piece  # two open ends, no other hole


def noisy(facets: np.ndarray) -> np.ndarray:
    """Facets in another order, their corners moved by millimetres."""
    rng = np.random.default_rng(0)
    places, index = np.unique(facets.reshape(-1, 3), axis=0, return_inverse=True)
    places = places + rng.normal(scale=0.004, size=places.shape)
    return places[index.ravel()].reshape(-1, 3, 3)[rng.permutation(len(facets))]


def doubled(facets: np.ndarray) -> np.ndarray:
    return np.concatenate([facets, facets[::3, ::-1], facets[:40]])


@pytest.mark.parametrize("spoil", [noisy, doubled])
def test_noise_order_and_doubled_facets_change_no_branch(spoil) -> None:
    check_box(recognise(spoil(box_tree().facets())))


def test_the_cut_does_not_need_to_know_what_is_up() -> None:
    lying = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    with pytest.raises(LeanError, match="leans"):  # after it was cut
        recognise(box_tree().facets() @ lying)


def test_a_trunk_that_ends_as_a_level_limb_is_still_upright() -> None:
    bend = np.concatenate([line([0, 0, 0], [0, 0, 2], 9), line([0.3, 0, 2.2], [6, 0, 2.6], 20)])
    model = Model()
    trunk = model.add(bend, np.linspace(0.3, 0.1, len(bend)), -1)
    model.add(line([3, 0, 2.4], [3, 1, 4]), np.linspace(0.05, 0.02, 6), trunk)
    found = recognise(model.wood())
    assert (found.trunk, found.wood.count) == (0, 2)


def test_some_parts_joined_and_some_apart() -> None:
    """A box-modelled tree to which separate twigs were added."""
    model = box_tree()
    twigs = []
    for branch in (3, 6, 9):
        foot = model.rings[branch][6].mean(axis=0)
        twigs.append(tube(line(foot, foot + at(0.1, 0.1, 0.5)), np.linspace(0.02, 0.01, 6)))
    found = recognise(np.concatenate([*twigs, model.facets()]))
    assert found.wood.count == len(model.rings) + 3
    np.testing.assert_array_equal(np.bincount(depths(found.parent)), [1, 7, 4 + 3])


def test_pieces_that_only_touch_stay_apart() -> None:
    """Two branches with a common corner, and twigs that cross without one."""
    model = tree()
    model.tubes[4][0, 0] = model.tubes[1][3, 1]
    assert recognise(model.wood()).wood.count == 28


def test_a_plain_tube_is_not_cut_however_it_bends_or_swells() -> None:
    turn = np.linspace(0, 5 * np.pi, 120)
    vine = np.stack([np.cos(turn), np.sin(turn), 1.2 + 0.2 * turn], axis=1)
    swollen = np.where(np.abs(np.linspace(0, 1, 40) - 0.05) < 0.1, 0.9, 0.15)
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 9], 40), swollen, -1, sides=12)
    model.add(line([0, 0, 6], [2, 0, 7]), np.linspace(0.06, 0.02, 6), trunk)
    model.add(vine, 0.03, trunk)
    assert recognise(model.wood()).wood.count == 3


@pytest.mark.parametrize(
    "facets",
    [
        np.array([[[0.0, 0, 0], [1, 0, 0], [0, 0, 1]]]),
        tube(line([0, 0, 0], [0, 0, 9]), 0.2),
        tube(line([0, 0, 0], [0, 0, 9], 40), np.linspace(0.3, 0.01, 40), capped=True),
    ],
    ids=["triangle", "open tube", "pole"],
)
def test_what_has_no_fork_is_one_sentence_with_a_place(facets: np.ndarray) -> None:
    with pytest.raises(TemplateError) as caught:
        recognise(facets)
    assert "one piece without a fork" in str(caught.value)
    assert caught.value.places.shape == (2, 3)


# ---------------------------------------------------------------------------------- remeshed


@pytest.mark.slow
def test_a_remeshed_tree_has_the_branches_of_its_parts() -> None:
    """Number of branches by order exact, lengths within 6 %, radii at the foot within 20 %, where a voxel
    is half of the twigs' radius."""
    model = tree(capped=True)
    for number in range(1, 28):  # no thinner than the remesher sees
        if model.parents[number] > 0:
            path = line(model.foot[number], model.tip[number])
            model.tubes[number] = tube(path, np.linspace(0.032, 0.022, 6), capped=True)
            model.radius[number] = 0.032
    joined = remeshed(model.wood(), 0.016)
    found = recognise(joined)
    np.testing.assert_array_equal(np.bincount(depths(found.parent)), [1, 9, 18])
    number = np.array([np.argmin(np.linalg.norm(found.tip - tip, axis=1)) for tip in model.tip])
    assert len(np.unique(number)) == 28
    parents = np.array(model.parents)
    np.testing.assert_array_equal(found.parent[number], np.where(parents < 0, -1, number[parents]))
    length = np.array([np.linalg.norm(b - a) for a, b in zip(model.foot, model.tip, strict=True)])
    np.testing.assert_allclose(found.lines.length()[number], length, rtol=0.06)
    np.testing.assert_allclose(found.radius[number], model.radius, rtol=0.2)


@pytest.mark.medium
def test_branches_that_have_grown_together_spoil_no_other_piece() -> None:
    """Two branches that cross: the ring that they make with the trunk is said, all lines are sound."""
    model = Model()
    thick = np.linspace(0.09, 0.06, 6)
    trunk = model.add(line([0, 0, 0], [0, 0, 6]), np.linspace(0.25, 0.12, 6), -1, capped=True)
    model.add(line([0, 0, 1.5], [3, 0.0, 4.0]), thick, trunk, capped=True)
    model.add(line([0, 0, 4.0], [3, 0.02, 1.5]), thick, trunk, capped=True)
    model.add(line([0, 0, 4.8], [-2, 0.3, 5.6]), thick, trunk, capped=True)
    found = recognise(remeshed(model.wood(), 0.025))
    assert found.lines.length()[found.trunk] == pytest.approx(6.0, rel=0.02)
    chord = np.linalg.norm(found.tip - found.foot, axis=1)
    assert np.all(found.lines.length() < 1.6 * chord + 0.1)  # no line turns back
    assert 4 <= found.wood.count <= 6  # what lies beyond the crossing may be a branch of its own
    (doubt,) = found.doubts
    assert "grown into one another" in doubt.sentence


def grown(name: str, thinnest: float) -> Skeleton:
    """A tree of our growers without what is thinner than this."""
    species, template = load_species(find_species(name, Path()))
    whole = grow(species, template, stream(1, "joined")).skeleton
    keep = whole.radius[:, 0] >= thinnest
    for number in np.flatnonzero(whole.parent >= 0):
        keep[number] &= keep[whole.parent[number]]
    kept = whole.some(keep)
    return replace(kept, radius=np.maximum(kept.radius, 0.8 * thinnest))


def axes_by_order(skeleton: Skeleton) -> np.ndarray:
    parent = np.maximum(skeleton.parent, 0)
    first = (skeleton.parent < 0) | (skeleton.order != skeleton.order[parent])
    return np.bincount(skeleton.order[first])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "thinnest"), [("abop-monopodial-a", 0.014), ("honda-birch", 0.03)]
)
def test_trees_of_our_growers_remeshed_keep_their_orders(name: str, thinnest: float) -> None:
    """Number of branches by order exact; length by order within 4 %, or half the parents' radii."""
    skeleton = grown(name, thinnest)
    mesh = mesh_wood(skeleton, 0.002)
    found = recognise(remeshed(mesh.vertices[mesh.triangles], 0.5 * thinnest))
    order = depths(found.parent)
    np.testing.assert_array_equal(np.bincount(order), axes_by_order(skeleton))
    length, expected = (
        np.bincount(order, found.lines.length()),
        np.bincount(skeleton.order, skeleton.length),
    )
    thick = np.where(found.parent < 0, 0.0, found.radius[found.parent])
    assert np.all(np.abs(length - expected) <= 0.04 * expected + 0.5 * np.bincount(order, thick))


@pytest.mark.slow
def test_limbs_that_leave_the_trunk_as_one_fork_where_they_part() -> None:
    """A coarse ginkgo: two of its eight limbs, 5 cm thick, begin 3 cm apart in one direction, and are one
    tube for 11 cm of their way. What parts there is a fork off the trunk, one limb the other's child."""
    skeleton = grown("ginkgo", 0.02)
    mesh = mesh_wood(skeleton, 0.002)
    found = recognise(remeshed(mesh.vertices[mesh.triangles], 0.01))
    np.testing.assert_array_equal(axes_by_order(skeleton), [1, 8])
    np.testing.assert_array_equal(np.bincount(depths(found.parent)), [1, 7, 1])
    (late,) = np.flatnonzero(depths(found.parent) == 2)
    away = np.linalg.norm((found.foot[late] - found.foot[found.parent[late]])[:2])
    assert 0.1 < away < 0.25
    assert found.lines.length()[found.trunk] == pytest.approx(
        np.bincount(skeleton.order, skeleton.length)[0], rel=0.01
    )


@pytest.mark.slow
def test_a_weeping_tree_in_one_mesh_comes_back() -> None:
    """Branches that arch over, hanging twigs nearer to the ground than their parents' feet."""
    model, rise = Model(), np.linspace(0, 1, 14)
    trunk = model.add(line([0, 0, 0], [0.2, 0, 6], 20), np.linspace(0.2, 0.06, 20), -1, capped=True)
    for number in range(6):
        turn, z = 2.4 * number, 2.2 + 0.55 * number
        out = at(np.cos(turn), np.sin(turn), 0)
        path = at(0.2 * z / 6, 0, z) + np.outer(1.6 * rise, out)
        path[:, 2] += 1.2 * rise - 3.0 * rise**2
        branch = model.add(path, np.linspace(0.05, 0.03, 14), trunk, capped=True)
        for knot, hand in ((6, 1), (10, -1)):
            twig = path[knot] + np.outer(0.35 * rise, hand * np.cross(out, [0, 0, 1]))
            twig[:, 2] -= rise**2
            model.add(twig, np.linspace(0.034, 0.028, 14), branch, capped=True)
    found = recognise(remeshed(model.wood(), 0.017))
    assert found.doubts == ()
    assert found.wood.count == 19
    apart = np.linalg.norm(found.tip[:, None] - np.array(model.tip), axis=2)
    number = np.argmin(apart, axis=0)
    assert apart.min(axis=0).max() < 0.01
    parents = np.array(model.parents)
    np.testing.assert_array_equal(found.parent[number], np.where(parents < 0, -1, number[parents]))


# ------------------------------------------------------------------------------------- apart


def right_parents(skeleton: Skeleton, found: Recognition) -> np.ndarray:
    """Tell whether the piece of each axis hangs on the piece of its parent, at the right end."""
    bearer = np.maximum(skeleton.parent, 0)
    begins = (skeleton.parent < 0) | (skeleton.order != skeleton.order[bearer])
    first, axis = np.flatnonzero(begins), np.cumsum(begins) - 1
    last = first.copy()
    for number in np.flatnonzero(~begins):
        axis[number] = axis[skeleton.parent[number]]
        last[axis[number]] = number
    ends = found.lines.ends()
    both = np.concatenate([ends.reshape(-1, 6), ends[:, ::-1].reshape(-1, 6)])
    truth = np.concatenate([skeleton.start[first], skeleton.end[last]], axis=1)
    end, piece = np.divmod(cKDTree(both).query(truth)[1], found.wood.count)
    assert len(np.unique(piece)) == len(first) == found.wood.count
    parent = skeleton.parent[first]
    expected = np.where(parent < 0, -1, piece[axis[parent]])
    return np.asarray((found.parent[piece] == expected) & (found.foot_end[piece] == end))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "honda-willow",
        "ginkgo",
        "abop-sympodial-b",
    ],
)
def test_trees_of_our_growers_in_parts_come_back(name: str) -> None:
    """Every axis a piece, every piece on its parent, also where twigs begin within others that cross."""
    species, template = load_species(find_species(name, Path()))
    skeleton = grow(species, template, stream(2, "apart")).skeleton
    mesh = mesh_wood(skeleton, 0.004)
    assert right_parents(skeleton, recognise(mesh.vertices[mesh.triangles])).all()
