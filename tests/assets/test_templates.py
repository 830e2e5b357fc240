"""The templates that ship: made by their script, and good to grow trees from."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.trimesh import WOOD
from forest_addon.formats.stl import read_stl
from forest_addon.growth.mesh.leaves import Leaves, join_leaves
from forest_addon.growth.own_tree.template import TreeTemplate, split_tree

ASSETS = Path(__file__).resolve().parents[2] / "assets"
TEMPLATES = ASSETS / "templates"
# first-level branches, leaves on a branch, length of a leaf in metres: each from, to
EXPECTED = {
    "maple": (5, (190, 280), (0.10, 0.14)),
    "hazelnut": (6, (150, 200), (0.08, 0.10)),
    "apple": (6, (190, 290), (0.06, 0.08)),
    "spruce": (6, (560, 700), (0.06, 0.09)),
}
species = pytest.mark.parametrize("name", EXPECTED)


def facets(name: str, part: str) -> np.ndarray:
    return read_stl(TEMPLATES / name / f"{part}.stl")


@pytest.fixture(scope="module")
def trees() -> dict[str, TreeTemplate]:
    return {name: split_tree(facets(name, "wood"), facets(name, "leaves")) for name in EXPECTED}


def leaves_in_metres(tree: TreeTemplate) -> tuple[Leaves, np.ndarray]:
    """All leaves of a tree in canonical frames, and the length in metres of the unit of each."""
    unit = [np.full(len(branch.leaves), branch.length) for branch in tree.branches]
    return join_leaves([branch.leaves for branch in tree.branches]), np.concatenate(unit)


@pytest.mark.slow
def test_the_script_makes_the_committed_files(tmp_path: Path) -> None:
    script = ASSETS / "make_templates.py"
    subprocess.run([sys.executable, str(script), "--out", str(tmp_path)], check=True)
    made = {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.rglob("*.stl")}
    kept = {path.relative_to(TEMPLATES): path.read_bytes() for path in TEMPLATES.rglob("*.stl")}
    assert made.keys() == kept.keys()
    assert [path for path in kept if made[path] != kept[path]] == []


def test_they_are_small() -> None:
    assert sum(path.stat().st_size for path in TEMPLATES.rglob("*.stl")) < 6e6
    assert len(facets("maple", "wood")) + len(facets("maple", "leaves")) <= 20_000


@species
@pytest.mark.parametrize("part", ["wood", "leaves"])
def test_every_facet_is_finite_and_has_an_area(name: str, part: str) -> None:
    corners = facets(name, part)
    assert np.isfinite(corners).all()
    doubled = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert doubled.min() > 1e-9  # m²; read_stl drops facets that are not finite, so count them too
    size = (TEMPLATES / name / f"{part}.stl").stat().st_size
    assert len(corners) == (size - 84) // 50


@pytest.mark.slow
@species
def test_a_tree_splits_into_its_branches_with_all_leaves(
    name: str, trees: dict[str, TreeTemplate]
) -> None:
    tree, (branches, (fewest, most), _) = trees[name], EXPECTED[name]
    counts = [len(branch.leaves) for branch in tree.branches]
    assert len(tree.branches) == branches
    assert (tree.stubs, tree.unattached_leaves) == (0, 0)
    assert fewest <= min(counts) <= max(counts) <= most
    assert all(branch.leaves.branch.max() > 0 for branch in tree.branches)  # there are twigs


@pytest.mark.medium
@species
def test_the_trunk_stands_at_the_origin(name: str, trees: dict[str, TreeTemplate]) -> None:
    wood = facets(name, "wood").reshape(-1, 3)
    foot = wood[wood[:, 2] < 1e-4]
    assert np.abs(foot.mean(axis=0)).max() < 0.01
    assert trees[name].trunk_length == pytest.approx(
        np.ptp(trees[name].trunk.vertices[:, 2]), rel=0.05
    )


@pytest.mark.medium
@species
def test_leaves_have_their_natural_size(name: str, trees: dict[str, TreeTemplate]) -> None:
    leaves, unit = leaves_in_metres(trees[name])
    shortest, longest = EXPECTED[name][2]
    assert shortest <= (leaves.length * unit).min()
    assert (leaves.length * unit).max() <= longest
    assert (leaves.radius * unit).min() > 0.01


@species
def test_leaves_reach_the_tips(name: str, trees: dict[str, TreeTemplate]) -> None:
    for branch in trees[name].branches:
        along = branch.leaves.centre[:, 0]  # the branch runs from 0 to 1 along x
        assert along.max() > 0.95
        assert np.mean(along > 0.4) > 0.6


@species
def test_leaves_lie_with_their_upper_side_to_the_sky(name: str) -> None:
    corners = facets(name, "leaves")
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    upward = normal[:, 2] / np.linalg.norm(normal, axis=1)
    assert np.median(upward) > 0.6
    assert np.mean(upward > 0) > 0.95


@pytest.mark.medium
@species
def test_leaves_touch_neither_each_other_nor_the_wood(
    name: str, trees: dict[str, TreeTemplate]
) -> None:
    leaf_corners = np.unique(facets(name, "leaves").reshape(-1, 3), axis=0)
    wood_corners = np.unique(facets(name, "wood").reshape(-1, 3), axis=0)
    together = np.unique(np.concatenate([leaf_corners, wood_corners]), axis=0)
    assert len(together) == len(leaf_corners) + len(wood_corners)
    a_leaf = facets(name, "leaves")[: len(facets(name, "leaves")) // trees[name].leaf_count]
    corners_of_one = len(np.unique(a_leaf.reshape(-1, 3), axis=0))
    assert len(leaf_corners) == corners_of_one * trees[name].leaf_count


@species
def test_wood_faces_outwards(name: str) -> None:
    corners = facets(name, "wood")
    volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume.sum() > 0


@species
def test_branches_are_stout_enough_to_be_scaled(name: str, trees: dict[str, TreeTemplate]) -> None:
    for branch in trees[name].branches:
        assert 0.005 < branch.base_radius / branch.length < 0.02
        assert np.count_nonzero(branch.mesh.part == WOOD) > 500
