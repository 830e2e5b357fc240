"""Orchards and lists of trees, and what a planting's own settings do to its stand."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.spec import Forest, Gaussian, Planting, Rows, SpecError
from forest_addon.stand.compose import Inputs, TreeList
from forest_addon.stand.intensity.surface import IntensityError
from forest_addon.stand.layouts import orchard
from forest_addon.stand.plan import plan_stand

LOW, HIGH = np.array([100.0, 200.0]), np.array([120.0, 230.0])


def test_rows_stand_as_they_are_asked_for():
    rows = Rows(rows=3, trees=4, row_spacing=5.0, tree_spacing=2.0, start=(1.0, 2.0))
    places = orchard(rows, LOW, HIGH, stream(1, "rows"))
    assert places.shape == (12, 2)
    assert places[:4] == pytest.approx(np.array([[101, 202], [101, 204], [101, 206], [101, 208]]))
    assert places[4] == pytest.approx([106, 202])  # the next row is to the right of +Y


@pytest.mark.parametrize("heading", [0.0, 30.0, 90.0, -135.0])
def test_rows_fill_the_field(heading):
    rows = Rows(row_spacing=4.0, tree_spacing=1.5, heading_deg=heading, start=(3.0, 4.0))
    places = orchard(rows, LOW, HIGH, stream(1, "rows"))
    inside = ((places >= LOW - 1e-9) & (places <= HIGH + 1e-9)).all(axis=1)
    # Each tree has 6 m²; the number may be off by what the edge cuts.
    assert inside.sum() == pytest.approx(600 / 6, abs=2 * (20 + 30) / 1.5 / 2)
    along = np.array([np.cos(np.deg2rad(heading)), np.sin(np.deg2rad(heading))])
    right = np.array([along[1], -along[0]])
    steps = (places - LOW - [3, 4]) @ np.column_stack([right / 4, along / 1.5])
    assert steps == pytest.approx(np.rint(steps), abs=1e-8)


def test_jitter_spreads_trees_about_their_places():
    still = orchard(Rows(row_spacing=1, tree_spacing=1), LOW, HIGH, stream(1, "rows"))
    moved = orchard(Rows(row_spacing=1, tree_spacing=1, jitter=0.1), LOW, HIGH, stream(1, "rows"))
    off = (moved - still) / 0.1
    assert np.abs(off).max() <= 2
    # Truncated at two, the standard deviation is 0.8796; 5 sigma of it, false alarm 6e-7.
    assert off.std() == pytest.approx(0.8796, abs=5 * 0.8796 / np.sqrt(2 * off.size))


def test_an_orchard_of_too_many_places_is_refused_with_the_number():
    with pytest.raises(IntensityError, match="more than 20,000,000"):
        orchard(Rows(row_spacing=1e-3, tree_spacing=1e-3), LOW, HIGH, stream(1, "x"))


def test_an_orchard_keeps_to_the_field_and_its_polygon():
    field = Forest(size=(20.0, 20.0), polygon=((0, 0), (20, 0), (0, 20)))
    planting = Planting(species="m", layout="rows", rows=Rows(row_spacing=2, tree_spacing=2))
    stand = plan_stand(1, field, [planting])
    assert (stand.position[:, :2].sum(axis=1) <= 20).all()
    assert stand.expected[0] == len(stand) + stand.off_field[0] == 121


# ------------------------------------------------------------------------------------------- lists


def listed():
    return TreeList(
        position=np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [50.0, 6.0]]),
        species=("oak", "elm", "oak", "oak"),
        scale=np.array([1.5, np.nan, np.nan, 1.0]),
        rotation=np.array([np.nan, 0.5, np.nan, 0.0]),
    )


def test_a_list_is_planted_as_it_says_and_the_rest_is_drawn():
    plantings = [
        Planting(species=name, layout="list", trees="t.csv", variants=4) for name in ("oak", "elm")
    ]
    stand = plan_stand(2, Forest(size=(20.0, 20.0)), plantings, Inputs(lists={"t.csv": listed()}))
    assert stand.position[:, :2].tolist() == [[1, 2], [5, 6], [3, 4]]
    assert stand.species.tolist() == [0, 0, 1]
    assert stand.off_field.tolist() == [1, 0]
    assert stand.scale[0] == 1.5
    assert 0.85 <= stand.scale[1] <= 1.15
    assert stand.rotation[2] == 0.5


def test_heights_of_placed_objects_count_in_place_of_the_terrain():
    placed = TreeList(position=np.array([[1.0, 2.0, 7.5]]))
    planting = Planting(species="oak", layout="list", collection="Mine")
    stand = plan_stand(2, Forest(), [planting], Inputs(lists={"Mine": placed}))
    assert stand.position.tolist() == [[1.0, 2.0, 7.5]]


def test_a_list_that_names_what_nobody_plants_is_refused():
    planting = Planting(species="oak", layout="list", trees="t.csv")
    with pytest.raises(IntensityError, match='"elm" is not planted; use one of oak'):
        plan_stand(2, Forest(), [planting], Inputs(lists={"t.csv": listed()}))


def test_all_species_of_a_list_that_nobody_plants_are_named():
    trees = TreeList(position=np.zeros((3, 2)), species=("elm", "oka", "oak"))
    planting = Planting(species="oak", layout="list", trees="t.csv")
    with pytest.raises(
        IntensityError, match=r'"elm", "oka" \(did you mean "oak"\?\) are not planted'
    ):
        plan_stand(2, Forest(), [planting], Inputs(lists={"t.csv": trees}))


def test_a_collection_without_blender_is_refused():
    planting = Planting(species="oak", layout="list", collection="Mine")
    with pytest.raises(IntensityError, match='"Mine" is not here'):
        plan_stand(2, Forest(), [planting])


# ---------------------------------------------------------------------------------------- settings


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ({"expected": 3, "density": 0.1}, "density"),
        ({}, "expected"),
        ({"layout": "list"}, "trees"),
        ({"layout": "list", "trees": "a", "collection": "b"}, "trees"),
        ({"expected": 3, "polygon": ((0, 0), (1, 1))}, "polygon"),
        ({"expected": 3, "holes": (((0, 0), (1, 1), (1, 0)),)}, "holes"),
        ({"expected": 3, "slope_deg": (30, 10)}, "slope_deg"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(values, key):
    with pytest.raises(SpecError) as caught:
        Planting(species="m", **values)
    assert caught.value.key == key


def test_an_exact_number_of_trees_stands():
    hill = Gaussian(centre=(5.0, 5.0), width=(3.0, 3.0))
    planting = Planting(species="m", expected=77, exact=True, gaussians=(hill,))
    counts = {len(plan_stand(s, Forest(), [planting])) for s in range(5)}
    assert counts == {77}


def test_crowns_keep_apart():
    planting = Planting(species="m", expected=300, crown=1.2, scale=(0.5, 1.5))
    stand = plan_stand(1, Forest(), [planting])
    crown = 1.2 * stand.scale
    points = stand.position[:, :2]
    gap = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    np.fill_diagonal(gap, np.inf)
    assert (gap >= crown[:, None] + crown[None]).all()
    assert stand.removed > 0


def test_a_window_far_from_the_origin_is_the_same_stand_moved():
    """To rounding at 5e6 m: positions differ by less than 2 nm, so no tree changes."""
    hill = {"peak": 1.0, "width": (6.0, 4.0)}
    near = Planting(species="m", expected=200, gaussians=(Gaussian(centre=(15, 15), **hill),))
    far = Planting(
        species="m", expected=200, gaussians=(Gaussian(centre=(500_015, 5_400_015), **hill),)
    )
    here = plan_stand(4, Forest(spacing=0.7), [near])
    there = plan_stand(4, Forest(spacing=0.7, origin=(500_000.0, 5_400_000.0)), [far])
    moved = there.position[:, :2] - [500_000, 5_400_000]
    assert moved == pytest.approx(here.position[:, :2], abs=2e-9)
    assert (there.scale == here.scale).all()
