"""Tables of a forest: what they sum to."""

import numpy as np
import pytest

from forest_addon.spec import Forest, Grammar, Planting, Scene, Species
from forest_addon.stand.forest import angle_table, grow_forest, tree_table


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
        assert volume == pytest.approx((np.pi * h * (r1**2 + r1 * r2 + r2**2) / 3).sum())
        assert projected == pytest.approx(((r1 + r2) * h).sum())
        assert area == pytest.approx(np.pi * projected, rel=0.01)
    angles = angle_table(forest)
    assert angles["to_deg"][-1] == pytest.approx(90)
