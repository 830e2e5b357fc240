"""Truth tables against closed forms and against fine meshes."""

import numpy as np
import pytest

from forest_addon.growth.mesh.leaves import Leaves
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.skeleton import Skeleton
from forest_addon.growth.tree import Tree
from forest_addon.growth.truth import (
    leaf_angles,
    segment_table,
    tree_truth,
    wood_of_mesh,
    wood_of_skeleton,
)


def straight(h, r1, r2):
    return Skeleton(
        np.zeros((1, 3)),
        np.array([[0, 0, h]], float),
        np.array([[r1, r2]], float),
        np.array([-1]),
        np.zeros(1, np.int64),
        np.zeros(1, np.int64),
    )


def test_cylinder_is_simlidars():
    d, h = 0.3, 2.0
    wood = wood_of_skeleton(straight(h, d / 2, d / 2))
    assert wood.volume == pytest.approx(np.pi * d**2 * h / 4)
    assert wood.area == pytest.approx(np.pi * d * h)
    assert wood.projected == pytest.approx(d * h)


@pytest.mark.medium
def test_cone_and_frustum():
    cone = wood_of_skeleton(straight(3.0, 0.5, 0.0))
    assert cone.volume == pytest.approx(np.pi * 0.25)
    assert cone.area == pytest.approx(np.pi * 0.5 * np.hypot(3, 0.5))
    assert cone.projected == pytest.approx(1.5)
    fine = mesh_wood(straight(3.0, 0.5, 0.2), 1e-6, uv=False)
    frustum = wood_of_skeleton(straight(3.0, 0.5, 0.2))
    measured = wood_of_mesh(fine)
    assert measured.volume == pytest.approx(frustum.volume, rel=1e-2)
    caps = np.pi * (0.25 + 0.04)
    assert measured.area == pytest.approx(frustum.area + caps, rel=1e-2)


def test_angles_of_random_and_of_flat_leaves():
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(200_000, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ones = np.ones(len(normal))
    leaves = Leaves(normal, normal, normal, ones, ones, ones, ones.astype(np.int32))
    edges, density = leaf_angles(leaves)
    middle = (edges[1:] + edges[:-1]) / 2
    np.testing.assert_allclose(density, np.sin(middle), atol=0.03)  # spherical distribution
    assert (density * np.diff(edges)).sum() == pytest.approx(1)
    assert leaf_angles(Leaves.none())[1].sum() == 0
    up = np.tile([0, 0, -1.0], (5, 1))
    five = np.ones(5)
    flat = Leaves(up, up, up, five, five, five, five.astype(np.int32))
    assert leaf_angles(flat)[1][0] > 0
    assert leaf_angles(flat)[1][1:].sum() == 0


def test_tree_truth_names_what_it_says():
    skeleton = straight(4.0, 0.2, 0.1)
    tree = Tree(mesh_wood(skeleton, 0.001), Leaves.none(), skeleton, grafted=False)
    truth = tree_truth(tree)
    assert truth["height_m"] == pytest.approx(4.0)
    assert truth["wood_volume_m3"] == pytest.approx(np.pi * 4 * (0.04 + 0.02 + 0.01) / 3)
    assert truth["leaf_area_m2"] == 0
    table = segment_table(skeleton)
    assert table["diameter_m"][0] == pytest.approx(0.3)  # the mean of both ends
    assert all(len(column) == 1 for column in table.values())
