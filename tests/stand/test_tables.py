"""Tables of a forest: what they sum to."""

import numpy as np
import pytest

from forest_addon.growth.truth import volume_of
from forest_addon.spec import Forest, Grammar, Planting, Scene, Species
from forest_addon.stand.forest import (
    angle_table,
    grow_forest,
    leaf_count,
    leaf_table,
    tree_table,
    variant_leaf_table,
)


def test_wood_and_angles_of_a_forest_of_whole_trees():
    scene = Scene(
        name="t", forest=Forest(size=(20, 20)), plantings=(Planting(species="x.toml", expected=6),)
    )
    species = Species(name="plain", grammar=Grammar(generations=3, radius=0.1))
    forest = grow_forest(scene, [(species, None)])
    table = tree_table(forest)
    assert len(table["wood_volume_m3"]) == len(forest.stand)
    for tree, (volume, area, projected) in enumerate(
        zip(
            table["wood_volume_m3"],
            table["wood_area_m2"],
            table["projected_wood_m2"],
            strict=True,
        )
    ):
        skeleton, scale = forest.variant_of(tree).skeleton, table["scale"][tree]
        h = np.linalg.norm(skeleton.end - skeleton.start, axis=1) * scale
        r1, r2 = (skeleton.radius * scale).T
        assert volume == pytest.approx(volume_of(skeleton) * scale**3)
        assert volume < (np.pi * h * (r1**2 + r1 * r2 + r2**2) / 3).sum()
        assert projected == pytest.approx(((r1 + r2) * h).sum())
        assert area == pytest.approx(np.pi * projected, rel=0.01)
    angles = angle_table([forest])
    assert angles["to_deg"][-1] == pytest.approx(90)


@pytest.fixture(scope="module")
def leafy():
    planting = Planting(species="x.toml", expected=12, variants=3, scale=(0.5, 2.0))
    scene = Scene(name="t", seed=5, forest=Forest(size=(20, 20)), plantings=(planting,))
    return grow_forest(scene, [(Species(name="plain", grammar=Grammar(generations=3)), None)])


def test_leaves_of_variants_and_trees_are_the_leaves_of_the_forest(leafy):
    whole, parts, stand = leaf_table(leafy), variant_leaf_table(leafy), leafy.stand
    assert leaf_count(leafy) == len(whole["leaf"]) > 0
    for tree, matrix in enumerate(leafy.transforms()):
        own = whole["tree"] == stand.id[tree]
        rows = (parts["species"] == stand.species[tree]) & (parts["variant"] == stand.variant[tree])
        moved = parts["centre"][rows] @ matrix[:, :3].T + matrix[:, 3]
        np.testing.assert_allclose(whole["centre"][own], moved, atol=1e-12)
        np.testing.assert_allclose(whole["radius"][own], parts["radius"][rows] * stand.scale[tree])
        np.testing.assert_array_equal(whole["leaf"][own], parts["leaf"][rows])


def test_leaf_angles_are_those_of_all_leaves_by_area(leafy):
    whole = leaf_table(leafy)
    tilt = np.arccos(np.abs(whole["normal"][:, 2]))
    table = angle_table([leafy])
    edges = np.radians([*table["from_deg"], 90.0])
    expected, _ = np.histogram(tilt, edges, weights=whole["radius"] ** 2, density=True)
    (density,) = (values for name, values in table.items() if not name.endswith("_deg"))
    np.testing.assert_allclose(density, expected, rtol=1e-6)
