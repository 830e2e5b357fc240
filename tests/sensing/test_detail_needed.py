"""What a scene's sensors need of a forest: what is left out changes nothing, or no more than is said."""

from dataclasses import replace

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD, is_wood
from forest_addon.growth.library import find_species, load_species
from forest_addon.sensing.audit import held
from forest_addon.sensing.detail import grow_needed
from forest_addon.sensing.trees_audit import part_of_tubes
from forest_addon.spec import (
    Accuracy,
    Airborne,
    Beam,
    Forest,
    Planting,
    Reverb,
    Scene,
    Sonar,
    Terrestrial,
)
from forest_addon.stand.forest import grow_forest

WIDE = Beam(divergence_mrad=(0.8, 0.5), subrays=7)
PLANE = Airborne(position=(-40.0, 10.0, 80.0), heading_deg=0.0, beam=WIDE)


def scene(*sensors, species="honda-birch", detail="auto", **forest):
    planting = Planting(species=species, variants=4, expected=8, exact=True)
    return Scene(
        seed=2,
        forest=Forest(size=(20.0, 20.0), **forest),
        plantings=(planting,),
        sensors=sensors,
        accuracy=Accuracy(detail=detail),
    )


def grown(asked):
    planted = [load_species(find_species(p.species, None)) for p in asked.plantings]
    full = grow_forest(asked, planted)
    some = grow_needed(asked, planted)
    return full, some, some.chosen


def same_wood(some, full):
    assert some.variants.keys() == full.variants.keys()
    for key, tree in full.variants.items():
        bare, wood = some.variants[key].mesh, tree.mesh.select(is_wood(tree.mesh.part))
        assert np.array_equal(bare.vertices[bare.triangles], wood.vertices[wood.triangles])
        assert np.array_equal(some.variants[key].skeleton.end, tree.skeleton.end)


@pytest.mark.slow
@pytest.mark.parametrize("species", ["honda-birch", "hazelnut", "silver-birch"])
def test_where_no_sensor_meets_a_leaf_none_grows_and_no_branch_moves(species):
    full, some, chosen = grown(scene(Reverb(), species=species))
    assert not any(len(tree.leaves) for tree in some.variants.values())
    same_wood(some, full)
    assert np.array_equal(some.stand.position, full.stand.position)
    assert np.array_equal(some.stand.sink, full.stand.sink)
    (choice,) = chosen
    assert choice.bound == 0
    assert "no change" in str(choice)


@pytest.mark.medium
def test_a_model_with_leaves_keeps_them_and_so_does_who_does_not_ask():
    for asked in (scene(Reverb(model="forest")), scene(Reverb(), detail="full"), scene()):
        full, some, chosen = grown(asked)
        assert chosen == ()
        assert all(
            np.array_equal(some.variants[key].mesh.vertices, tree.mesh.vertices)
            for key, tree in full.variants.items()
        )


@pytest.mark.medium
def test_leaves_beyond_every_range_are_left_out_and_none_within():
    bat = Sonar(position=(0.0, 0.0, 2.0), max_range=6.0)
    full, some, (choice,) = grown(scene(bat, species="hazelnut"))
    bared = {key for key, tree in some.variants.items() if not len(tree.leaves)}
    assert 0 < len(bared) < len(full.variants)
    for row, matrix in enumerate(full.transforms()):
        key = int(full.stand.species[row]), int(full.stand.variant[row])
        tree = full.variants[key]
        if key in bared:
            corners = tree.mesh.vertices @ matrix[:, :3].T + matrix[:, 3]
            assert np.linalg.norm(corners - bat.position, axis=1).min() > bat.max_range
    assert choice.bound == 0
    assert f"{len(bared)} variants" in choice.why


@pytest.mark.slow
def test_tubes_are_as_coarse_as_the_beam_and_within_what_is_said():
    full, some, (choice,) = grown(scene(PLANE, species="abop-ternary-a"))
    assert choice.key == "detail.tolerance"
    assert choice.unit == "m"
    tallest = max(tree.height for tree in full.variants.values())
    narrowest = 0.5e-3 * (80.0 - 1.2 * tallest)  # of the highest tree that could stand
    assert 0.002 < choice.bound < 0.1 * 0.5e-3 * 80.0
    assert choice.bound > 0.1 * narrowest / 1.2
    trees = [(tree, choice.bound) for tree in some.variants.values()]
    rng = stream(1, "needs")
    audit = held([part_of_tubes(trees, rng)], rng, 1.0)
    assert audit.kept
    assert audit.checked >= 20
    assert some.species[0].detail.tolerance == choice.bound
    for key, tree in full.variants.items():
        coarse = some.variants[key]
        assert (coarse.mesh.part == WOOD).sum() < 0.8 * (tree.mesh.part == WOOD).sum()
        assert (coarse.mesh.part == LEAF).sum() == (tree.mesh.part == LEAF).sum()
        assert np.array_equal(coarse.leaves.centre, tree.leaves.centre)


@pytest.mark.medium
@pytest.mark.parametrize(
    "other",
    [
        Terrestrial(position=(10.0, 10.0, 1.6)),  # lines without width
        Terrestrial(position=(10.0, 10.0, 1.6), beam=WIDE),  # among the trees: no beam is wide
        Sonar(position=(10.0, 10.0, 1.6)),  # the phase of sound at wood
        Reverb(),
    ],
    ids=["line", "near", "sonar", "reverb"],
)
def test_the_finest_sensor_decides(other):
    asked = scene(PLANE, other, species="abop-ternary-a")
    full, some, chosen = grown(asked)
    assert not [choice for choice in chosen if choice.key == "detail.tolerance"]
    key = next(iter(full.variants))
    assert len(some.variants[key].mesh.triangles) == len(full.variants[key].mesh.triangles)


def test_a_templates_mesh_stays():
    full, some, chosen = grown(scene(PLANE, species="hazelnut"))
    assert chosen == ()
    key = next(iter(full.variants))
    assert some.variants[key] is not None
    assert np.array_equal(some.variants[key].mesh.vertices, full.variants[key].mesh.vertices)


@pytest.mark.medium
def test_nothing_is_chosen_where_all_is_asked_for():
    asked = replace(scene(PLANE), accuracy=Accuracy())
    full, some, chosen = grown(asked)
    assert chosen == () == some.detail
    for key, tree in full.variants.items():
        assert np.array_equal(some.variants[key].mesh.vertices, tree.mesh.vertices)
        assert np.array_equal(some.variants[key].mesh.triangles, tree.mesh.triangles)
