"""The truth of a small forest: trees, cylinders and areas by cell against its meshes in the world."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from forest_addon import spec
from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.truth import segment_table
from forest_addon.stand.forest import cylinder_table, grow_forest, inventory, voxel_arrays

EDGE = 0.3


@cache
def forest():
    kinds = ("apple", "abop-monopodial-a")
    scene = spec.Scene(
        seed=3,
        forest=spec.Forest(size=(10.0, 10.0), origin=(400.0, -30.0)),
        plantings=tuple(
            spec.Planting(species=k, expected=2, exact=True, variants=2) for k in kinds
        ),
    )
    return grow_forest(scene, [load_species(find_species(k, Path())) for k in kinds])


def world_areas(part):
    total = []
    for tree, matrix in enumerate(forest().transforms()):
        mesh = forest().variant_of(tree).mesh
        place = mesh.vertices @ matrix[:, :3].T + matrix[:, 3]
        a, b, c = (place[mesh.triangles[mesh.part == part, k]] for k in range(3))
        total.append(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    return np.array(total)


def test_areas_by_cell_add_up_to_the_meshes():
    found = voxel_arrays(forest(), EDGE)
    for name, part in (("leaf", LEAF), ("wood", WOOD)):
        whole = world_areas(part).sum()
        assert abs(found[f"{name}_area_density"].sum() * EDGE**3 - whole) < 1e-9 * whole
    assert len(found["tree_cell"]) >= len(found["cell"])
    assert set(found["tree"].tolist()) == set(range(4))


def test_the_inventory_is_in_metres_above_the_ground():
    table = inventory(forest())
    assert np.allclose(table["leaf_area_m2"], world_areas(LEAF), rtol=1e-9)
    for tree, matrix in enumerate(forest().transforms()):
        grown = forest().variant_of(tree)
        top = (grown.mesh.vertices @ matrix[2, :3] + matrix[2, 3]).max()
        assert table["height_m"][tree] == pytest.approx(top - table["z_m"][tree])
        skeleton = grown.skeleton
        ends = (
            skeleton.start[:, 2] * table["scale"][tree],
            skeleton.end[:, 2] * table["scale"][tree],
        )
        trunk = np.flatnonzero((skeleton.order == 0) & (ends[0] <= 1.3) & (ends[1] > 1.3))
        if len(trunk) == 1:
            (s,) = trunk
            share = (1.3 - ends[0][s]) / (ends[1][s] - ends[0][s])
            radius = skeleton.radius[s] * table["scale"][tree]
            wanted = 2 * (radius[0] + share * (radius[1] - radius[0]))
            assert table["dbh_m"][tree] == pytest.approx(wanted)


def test_cylinders_stand_in_the_world_and_hold_all_wood():
    table = cylinder_table(forest())
    for tree, matrix in enumerate(forest().transforms()):
        skeleton, rows = forest().variant_of(tree).skeleton, table["tree"] == tree
        end = np.stack([table[f"end{axis}"][rows] for axis in "XYZ"], axis=1)
        assert np.allclose(end, skeleton.end @ matrix[:, :3].T + matrix[:, 3])
        scale = float(forest().stand.scale[tree])
        volume = segment_table(skeleton)["volume_m3"].sum() * scale**3
        assert table["volume"][rows].sum() == pytest.approx(volume)
        own, parent = table["cyl_ID"][rows], table["parent_ID"][rows]
        assert np.array_equal(own, np.arange(1, len(skeleton) + 1))
        assert (parent < own).all()
        following = table["extension_ID"][rows]
        on = following > 0
        assert (
            parent[following[on] - 1] == own[on]
        ).all()  # an extension's parent is what it extends
