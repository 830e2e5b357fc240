"""The truth of leaves, on leaves whose truth is known."""

import numpy as np
import pytest

from forest_addon.base.trimesh import LEAF, TriMesh, join
from forest_addon.growth.mesh.blades import Blade, lay
from forest_addon.growth.mesh.leaves import Leaves, measure_leaves, separate_leaves
from forest_addon.growth.skeleton import LeafSites
from forest_addon.sensing.sonar.discs import FoliageDiscs


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
    assert len(Leaves.none()) == 0
    assert len(measure_leaves(TriMesh.of_part(np.eye(3), np.array([[0, 1, 2]]), 1))) == 0


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


def shoots(count=3, blades=4):
    """Shoots of blades that do not touch each other."""
    sites = LeafSites(
        foot=np.arange(3.0 * count).reshape(count, 3),
        direction=np.tile([1.0, 0, 0], (count, 1)),
        up=np.tile([0, 0, 1.0], (count, 1)),
        length=np.ones(count),
        width=np.ones(count),
        segment=np.zeros(count, dtype=np.int64),
    )
    one = np.array([[0, 0, 0], [0.2, 0.1, 0], [0.2, -0.1, 0]])
    vertices = np.concatenate([one + np.array([0.2 * k, 0, 0.05 * k]) for k in range(blades)])
    triangles = np.arange(3 * blades, dtype=np.int32).reshape(-1, 3)
    return lay(sites, Blade(vertices, triangles))


def test_a_shoot_in_pieces_is_one_leaf_and_its_copies_are_others():
    mesh = shoots()
    assert separate_leaves(mesh) is mesh
    copied = join([mesh, moved(mesh, np.eye(3), np.array([50.0, 0, 0]))])
    copied.leaf[len(mesh.leaf) :] -= 3  # as an Array modifier leaves it
    assert separate_leaves(copied).leaf.tolist() == np.repeat([0, 1, 2, 3, 4, 5], 4).tolist()


def test_to_sound_every_piece_of_a_shoot_is_a_disc():
    mesh = shoots()
    foliage = FoliageDiscs(mesh)
    assert foliage.leaf.tolist() == np.repeat([0, 1, 2], 4).tolist()
    centre, normal, radius = foliage.local
    corners = mesh.vertices[mesh.triangles]
    np.testing.assert_allclose(centre, corners.mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(np.pi * radius**2, 0.02, rtol=1e-12)
    np.testing.assert_allclose(np.abs(normal[:, 2]), 1.0)
