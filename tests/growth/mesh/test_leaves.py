"""The truth of leaves, on leaves whose truth is known."""

import numpy as np
import pytest

from forest_addon.growth.mesh.leaves import join_leaves, measure_leaves, no_leaves, separate_leaves
from forest_addon.growth.mesh.trimesh import LEAF, TriMesh, join


def rectangle(length, width, number=0):
    corners = np.array([[0, 0, 0], [length, 0, 0], [length, width, 0], [0, width, 0]], float)
    return TriMesh(
        corners,
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.full(2, LEAF, np.int8),
        np.full(2, number, np.int32),
        np.zeros(2, np.int32),
    )


def moved(mesh, rotation, shift):
    return TriMesh(
        mesh.vertices @ rotation.T + shift, mesh.triangles, mesh.part, mesh.leaf, mesh.material
    )


@pytest.mark.parametrize("seed", range(5))
def test_rectangle_anywhere(seed):
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation[:, 0] *= np.linalg.det(rotation)
    shift = rng.normal(size=3) * 100
    leaves = measure_leaves(moved(rectangle(0.12, 0.05), rotation, shift))
    assert leaves.centre[0] == pytest.approx(rotation @ [0.06, 0.025, 0] + shift)
    assert abs(leaves.normal[0] @ rotation[:, 2]) == pytest.approx(1)
    assert abs(leaves.axis[0] @ rotation[:, 0]) == pytest.approx(1)
    assert leaves.radius[0] == pytest.approx(np.sqrt(0.12 * 0.05 / np.pi), rel=1e-9)
    assert leaves.length[0] == pytest.approx(0.12)
    assert leaves.width[0] == pytest.approx(0.05)


def test_facets_wound_against_each_other_do_not_cancel():
    mesh = rectangle(0.1, 0.1)
    flipped = TriMesh(
        mesh.vertices,
        np.array([[0, 1, 2], [3, 2, 0]], np.int32),
        mesh.part,
        mesh.leaf,
        mesh.material,
    )
    leaves = measure_leaves(flipped)
    assert abs(leaves.normal[0, 2]) == pytest.approx(1)
    assert leaves.radius[0] == pytest.approx(np.sqrt(0.01 / np.pi))


def test_zero_area_leaf_is_harmless():
    leaves = measure_leaves(rectangle(0.1, 0.0))
    assert leaves.radius[0] == 0
    assert np.isfinite(leaves.centre).all()
    assert np.linalg.norm(leaves.normal[0]) == pytest.approx(1)


def test_no_leaves():
    assert len(no_leaves()) == 0
    assert len(measure_leaves(TriMesh.of_part(np.eye(3), np.array([[0, 1, 2]]), 1))) == 0
    assert len(join_leaves([])) == 0


def test_join_numbers_leaves_on_and_select_drops_unused_vertices():
    mesh = join(
        [rectangle(1, 1), rectangle(2, 1), TriMesh.of_part(np.eye(3), np.array([[0, 1, 2]]), 1)]
    )
    assert mesh.leaf.tolist() == [0, 0, 1, 1, -1]
    kept = mesh.select(mesh.leaf == 1)
    assert len(kept.vertices) == 4
    assert kept.vertices.max() == 2


def test_copies_that_share_a_number_become_leaves_of_their_own():
    a, b = rectangle(1, 1, 0), moved(rectangle(1, 1, 0), np.eye(3), np.array([5.0, 0, 0]))
    both = TriMesh(
        np.concatenate([a.vertices, b.vertices]),
        np.concatenate([a.triangles, b.triangles + 4]).astype(np.int32),
        np.concatenate([a.part, b.part]),
        np.concatenate([a.leaf, b.leaf]),
        np.concatenate([a.material, b.material]),
    )
    assert separate_leaves(both).leaf.tolist() == [0, 0, 1, 1]
    assert separate_leaves(a) is a
