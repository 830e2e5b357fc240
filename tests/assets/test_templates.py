"""The templates that ship: made by their script, and good to grow trees from."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from forest_addon.base.trimesh import WOOD
from forest_addon.formats.stl import read_stl
from forest_addon.growth.mesh.leaves import Leaves
from forest_addon.growth.own_tree.template import TreeTemplate, split_tree

ASSETS = Path(__file__).resolve().parents[2] / "assets"
TEMPLATES = ASSETS / "templates"


class Shipped(NamedTuple):
    """Facets (T, 3, 3) of a template, and what it is cut into."""

    name: str
    wood: np.ndarray
    leaves: np.ndarray
    tree: TreeTemplate


# first-level branches, leaves on a branch, length of a leaf in metres: each from, to
EXPECTED = {
    "maple": (5, (190, 280), (0.10, 0.14)),
    "hazelnut": (6, (150, 200), (0.08, 0.10)),
    "apple": (6, (190, 290), (0.06, 0.08)),
    "spruce": (6, (560, 700), (0.06, 0.09)),
}


@pytest.fixture(scope="module", params=EXPECTED)
def shipped(request: pytest.FixtureRequest) -> Shipped:
    wood, leaves = (
        read_stl(TEMPLATES / request.param / f"{part}.stl") for part in ("wood", "leaves")
    )
    return Shipped(request.param, wood, leaves, split_tree(wood, leaves))


@pytest.mark.slow
def test_the_script_makes_the_committed_files(tmp_path: Path) -> None:
    script = ASSETS / "make_templates.py"
    subprocess.run([sys.executable, str(script), "--out", str(tmp_path)], check=True)
    made = {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.rglob("*.stl")}
    kept = {path.relative_to(TEMPLATES): path.read_bytes() for path in TEMPLATES.rglob("*.stl")}
    assert made.keys() == kept.keys()
    assert [path for path in kept if made[path] != kept[path]] == []
    assert sum(map(len, kept.values())) < 6e6


@pytest.mark.medium
def test_facets_are_whole_and_turned_outwards_and_to_the_sky(shipped: Shipped) -> None:
    for part, corners in (("wood", shipped.wood), ("leaves", shipped.leaves)):
        assert np.isfinite(corners).all()
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(normal, axis=1)
        assert doubled.min() > 1e-9  # m²; read_stl drops facets that are not finite, so count them
        size = (TEMPLATES / shipped.name / f"{part}.stl").stat().st_size
        assert len(corners) == (size - 84) // 50
    upward = normal[:, 2] / doubled  # of leaves
    assert np.median(upward) > 0.6
    assert np.mean(upward > 0) > 0.95
    a, b, c = shipped.wood.transpose(1, 0, 2)
    assert np.einsum("ti,ti->t", a, np.cross(b, c)).sum() > 0  # six times the volume
    assert len(shipped.wood) + len(shipped.leaves) <= 24_000


@pytest.mark.medium
def test_leaves_touch_neither_each_other_nor_the_wood(shipped: Shipped) -> None:
    wood, leaves = (
        np.unique(part.reshape(-1, 3), axis=0) for part in (shipped.wood, shipped.leaves)
    )
    together = np.unique(np.concatenate([leaves, wood]), axis=0)
    assert len(together) == len(leaves) + len(wood)
    a_leaf = shipped.leaves[: len(shipped.leaves) // shipped.tree.leaf_count]
    assert len(leaves) == len(np.unique(a_leaf.reshape(-1, 3), axis=0)) * shipped.tree.leaf_count


@pytest.mark.medium
def test_a_tree_is_cut_into_branches_with_all_leaves(shipped: Shipped) -> None:
    tree, (branches, (fewest, most), (shortest, longest)) = shipped.tree, EXPECTED[shipped.name]
    assert len(tree.branches) == branches
    assert (tree.stubs, tree.unattached_leaves) == (0, 0)
    for branch in tree.branches:
        assert fewest <= len(branch.leaves) <= most
        assert branch.leaves.branch.max() > 0  # there are twigs
        along = branch.leaves.centre[:, 0]  # the branch runs from 0 to 1 along x
        assert along.max() > 0.95
        assert np.mean(along > 0.4) > 0.6
        assert 0.005 < branch.base_radius / branch.length < 0.02  # stout enough to be scaled
        assert np.count_nonzero(branch.mesh.part == WOOD) > 500
    leaves = Leaves.joined([branch.leaves for branch in tree.branches])
    metres = np.repeat([b.length for b in tree.branches], [len(b.leaves) for b in tree.branches])
    assert shortest <= (leaves.length * metres).min()
    assert (leaves.length * metres).max() <= longest
    assert (leaves.radius * metres).min() > 0.01
    corners = shipped.wood.reshape(-1, 3)
    assert np.abs(corners[corners[:, 2] < 1e-4].mean(axis=0)).max() < 0.01  # stands at the origin
    assert tree.trunk_length == pytest.approx(np.ptp(tree.trunk.vertices[:, 2]), rel=0.05)
