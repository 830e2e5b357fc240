"""Stand-ins of trees: few triangles that stand where the tree stands, with its trunk and its crown."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, OTHER, WOOD, TriMesh
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.mesh.stand_in import LEVELS, level_for, stand_in
from forest_addon.growth.skeleton import Skeleton
from forest_addon.growth.tree import grow

NOTHING = Skeleton(
    *(np.empty(shape) for shape in ((0, 3), (0, 3), (0, 2))),
    *(np.empty(0, np.int64) for _ in range(3)),
)


def sky(mesh, places):
    """The share of level rays at places (N, 2) that meet no leaf, from one side: by brute force."""
    corners = mesh.vertices[:, 1:][mesh.triangles[mesh.part == LEAF]]  # seen along x
    least, most = (np.ascontiguousarray(end(corners, axis=1).T) for end in (np.min, np.max))
    met = []
    for y, z in places:
        rows = np.flatnonzero((least[0] <= y) & (y <= most[0]))
        rows = rows[(least[1][rows] <= z) & (z <= most[1][rows])]
        a, b, c = (corners[rows, k] - (y, z) for k in range(3))
        turns = np.stack(
            [u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] for u, v in ((a, b), (b, c), (c, a))]
        )
        met.append(((turns >= 0).all(axis=0) | (turns <= 0).all(axis=0)).any())
    return 1 - np.mean(met)


@pytest.mark.slow
@pytest.mark.parametrize("species", ["maple", "silver-birch", "apple-leafless"])
def test_a_stand_in_is_its_tree_at_a_glance(species):
    tree = grow(*load_species(find_species(species, Path())), stream(2, "outline"))
    leaves = tree.mesh.vertices[tree.mesh.triangles[tree.mesh.part == LEAF].ravel()]
    places, true = None, 1.0
    if len(leaves):
        middle, half = leaves[:, 1:].mean(axis=0), 1.2 * leaves[:, 1:].std(axis=0)
        places = np.random.default_rng(1).uniform(middle - half, middle + half, (60, 2))
        true = sky(tree.mesh, places)
    for number, level in enumerate(LEVELS):
        rough = looks_like(tree, leaves, level, 1.0 + 0.5 * number)
        if len(leaves):  # sky through the crown, of 1
            assert abs(true - sky(rough, places)) < (0.22 if level is LEVELS[0] else 0.3)


def looks_like(tree, leaves, level, slack):
    """Hold a stand-in to its tree, a coarse one less strictly; returns it."""
    mesh, rough = tree.mesh, stand_in(tree.mesh, tree.skeleton, level)
    assert level.most / 10 < len(rough.triangles) <= level.most
    assert np.isfinite(rough.vertices).all()
    assert ((rough.material == 1) == (rough.part == LEAF)).all()
    top = mesh.vertices[:, 2].max()
    assert rough.vertices[:, 2].max() == pytest.approx(top, rel=0.12 * slack)
    wood = rough.vertices[rough.triangles[rough.part == WOOD].ravel()]
    low = np.abs(wood[:, 2] - 0.05 * top) < 0.06 * top  # the trunk stands at the foot, as thick
    assert np.linalg.norm(wood[low][:, :2].mean(axis=0)) < 0.05 * top
    assert (rough.part == LEAF).any() == bool(len(leaves))
    if not len(leaves):
        return rough
    cards = rough.vertices[rough.triangles[rough.part == LEAF].ravel()]
    assert np.allclose(cards.mean(axis=0), leaves.mean(axis=0), atol=0.06 * slack * top)
    spread = leaves.std(axis=0)
    assert np.allclose(cards.std(axis=0), spread, rtol=0.25 * slack, atol=0.02 * top)
    return rough


def test_many_trees_have_coarser_stand_ins():
    assert level_for(0, 0) is LEVELS[0]
    assert level_for(250, 125_000) is LEVELS[0]
    for trees in (251, 1001, 20_000, 10**6):
        level = level_for(trees, 125_000)
        finer = LEVELS[: LEVELS.index(level)]
        assert all(trees * better.most > 125_000 for better in finer)
        assert trees * level.most <= 125_000 or level is LEVELS[-1]


def test_what_has_no_skeleton_has_a_trunk_all_the_same():
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    ring = np.column_stack([0.2 * np.cos(angle) + 3, 0.2 * np.sin(angle) - 1])
    heights = np.linspace(0, 6, 13)
    vertices = np.concatenate([np.column_stack([ring, np.full(48, z)]) for z in heights])
    corner = np.arange(48 * 12)
    pole = TriMesh.of_part(vertices, np.column_stack([corner, corner + 1, corner + 48]), WOOD)
    rough = stand_in(pole, NOTHING)
    foot = rough.vertices[rough.vertices[:, 2] < 1e-9]
    foot = foot[np.linalg.norm(foot[:, :2] - [3, -1], axis=1) > 1e-3]  # without the cap's middle
    assert np.abs(np.linalg.norm(foot[:, :2] - [3, -1], axis=1) - 0.2).max() < 0.03
    assert (rough.part == WOOD).all()


@pytest.mark.parametrize(
    "vertices", [np.empty((0, 3)), np.zeros((3, 3)), np.array([[0, 0, -1], [1, 0, -1], [0, 1, -2]])]
)
def test_what_does_not_stand_up_has_no_stand_in(vertices):
    triangles = np.array([[0, 1, 2]]) if len(vertices) else np.empty((0, 3))
    assert len(stand_in(TriMesh.of_part(vertices, triangles, OTHER), NOTHING).triangles) == 0
