"""A tree taken apart is put together again as it was, and its pieces bend as they should."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from references.model_tree import Model, line, tree
from references.own_trees import SPECIES, mothers_of, own_tree, sibling
from scipy.spatial import cKDTree

from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.growth.own_tree.anatomy import dissect
from forest_addon.growth.own_tree.habit import fit
from forest_addon.growth.own_tree.lines import lay, lay_sloping, slopes, unbend, walk
from forest_addon.growth.own_tree.recognise import recognise
from forest_addon.growth.own_tree.relay import farthest_off, mesh_of
from forest_addon.growth.own_tree.sibling import grow_sibling
from forest_addon.spec import Siblings

SAME = Siblings(variety=0.0)


def corners_of(facets: np.ndarray) -> np.ndarray:
    """Facets as rows that do not depend on their order, nor on where each begins."""
    rounded = np.round(facets, 7) + 0.0
    first = np.lexsort(rounded.transpose(2, 0, 1)[::-1], axis=-1)[:, 0]
    turned = rounded[np.arange(len(rounded))[:, None], (first[:, None] + np.arange(3)) % 3]
    rows = turned.reshape(-1, 9)
    return rows[np.lexsort(rows.T[::-1])]


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECIES)
def test_the_hierarchy_of_our_own_trees_is_recovered_exactly(name):
    own = own_tree(name)
    mother, foot, tip = mothers_of(own.tree)
    found = own.found
    assert found.wood.count == len(mother)
    feet, tips = np.hstack([found.foot, found.tip]), np.hstack([foot, tip])
    gap, number = cKDTree(feet).query(tips)
    assert np.sort(gap)[-2] < 0.01  # but for the trunk, which is sunk
    assert len(np.unique(number)) == len(mother)
    np.testing.assert_array_equal(np.where(mother < 0, -1, number[mother]), found.parent[number])
    assert found.leaves.count == len(own.tree.leaves)


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECIES)
def test_a_tree_of_no_variety_is_the_template_itself(name):
    own = own_tree(name)
    rebuilt = sibling(name, 1, variety=0.0)
    facets = rebuilt.mesh.vertices[rebuilt.mesh.triangles] + own.found.origin
    for part, brought in ((WOOD, own.wood), (LEAF, own.leaves)):
        mine = facets[rebuilt.mesh.part == part]
        assert len(mine) == len(brought)
        np.testing.assert_allclose(
            np.sort(mine.reshape(-1, 9).sum(axis=1)),
            np.sort(brought.reshape(-1, 9).sum(axis=1)),
            atol=1e-9,
        )
    every = np.concatenate([own.wood, own.leaves])
    np.testing.assert_allclose(corners_of(facets)[:, 0], corners_of(every)[:, 0], atol=2e-7)
    assert len(rebuilt.leaves) == len(own.tree.leaves)
    assert farthest_off(own.anatomy, grow_sibling(own.habit, SAME, 7)) < 1e-9  # metres


def test_a_tree_in_centimetres_anywhere_is_rebuilt_in_metres():
    model = tree()
    found = recognise(
        100 * model.wood() + [3e4, -2e4, 500], 100 * model.leaves() + [3e4, -2e4, 500]
    )
    anatomy = dissect(found, 0.01)
    mesh, leaves, _ = mesh_of(anatomy, grow_sibling(fit(anatomy), SAME, 0), 0.0)
    facets = mesh.vertices[mesh.triangles[mesh.part == WOOD]]
    plain = recognise(model.wood())
    assert len(leaves) == len(model.bearers)
    gap = cKDTree((model.wood() - plain.origin).reshape(-1, 3)).query(facets.reshape(-1, 3))[0]
    assert gap.max() < 1e-6


def test_bends_walk_a_line_again_and_a_circle_is_a_circle():
    rng = np.random.default_rng(4)
    first = np.array([0, 7, 8, 20])
    way = rng.normal(size=(20, 3))
    way[:, 2] += 1.5
    length = np.linalg.norm(way, axis=1)
    start = np.tile(np.eye(3), (3, 1, 1))
    start[:, :, 2] = (way / length[:, None])[first[:-1]]
    start[:, :, 0] = np.cross([0.3, 0.9, 0.1], start[:, :, 2])
    start[:, :, 0] /= np.linalg.norm(start[:, :, 0], axis=1, keepdims=True)
    start[:, :, 1] = np.cross(start[:, :, 2], start[:, :, 0])
    frame, bend = unbend(way / length[:, None], first, start)
    np.testing.assert_allclose(
        frame @ np.swapaxes(frame, 1, 2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(lay(bend, first, start), frame, atol=1e-12)
    knots = walk(frame, length, first, np.zeros((3, 3)))
    np.testing.assert_allclose(knots[7], way[:7].sum(axis=0), atol=1e-12)

    steps = 90  # 1° each about N: a quarter of a circle of radius 1
    quarter = np.tile([np.pi / 2 / steps, 0.0], (steps, 1))
    quarter[0] = 0
    once = np.array([0, steps])
    knots = walk(
        lay(quarter, once, np.eye(3)[None]),
        np.full(steps, np.pi / 2 / steps),
        once,
        np.zeros((1, 3)),
    )
    np.testing.assert_allclose(knots[-1], [0, -1, 1], atol=0.02)


def test_a_line_keeps_the_slopes_that_it_is_given():
    rng = np.random.default_rng(5)
    first = np.array([0, 40])
    slope = np.clip(np.linspace(0.5, 3.0, 40) + rng.normal(0, 0.1, 40), 0, np.pi)
    bend = rng.normal(0, 0.3, (40, 2))
    frame = lay_sloping(bend, first, np.eye(3)[None], slope)
    np.testing.assert_allclose(slopes(frame)[1:], slope[1:], atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(frame), 1.0, atol=1e-9)


def test_a_bent_tube_keeps_its_thickness():
    """A straight branch laid along a quarter of a circle has its surface a radius from that circle."""
    model = Model()
    model.add(line([0, 0, 0], [0, 0, 8], 40), 0.2, -1)
    model.add(line([0, 0, 4], [3, 0, 4], 60), 0.05, 0, sides=12)
    anatomy = dissect(recognise(model.wood()))
    habit = fit(anatomy)
    grown = grow_sibling(habit, SAME, 0)
    lines = anatomy.lines
    branch = slice(int(lines.first[1]), int(lines.first[2]))
    count = branch.stop - branch.start
    grown.bend[branch] = [np.pi / 2 / count, 0.0]
    frame = lay(grown.bend, grown.lines.first, grown.lines.frame[grown.lines.first[:-1]])
    feet = grown.lines.knot[grown.lines.first[:-1] + np.arange(2)]
    grown.lines.frame[:] = frame
    grown.lines.knot[:] = walk(frame, grown.lines.length, grown.lines.first, feet)
    mesh, *_ = mesh_of(anatomy, grown, 0.0)
    stock = anatomy.wood.stock
    bent = mesh.vertices[len(mesh.vertices) - int(stock.vertices.size[1]) :]
    knots = grown.lines.knot[-count - 1 :]
    fine = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(knots)])
    radius = cKDTree(fine).query(bent)[0]
    assert np.percentile(radius, 5) > 0.046
    assert np.percentile(radius, 95) < 0.0505
    assert np.linalg.norm(knots[-1] - knots[0]) < 2.9  # it is bent
