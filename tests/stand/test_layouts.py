"""Orchards and lists of trees, and what a planting's own settings do to its stand."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import stats
from scipy.spatial import cKDTree

from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings, write_settings
from forest_addon.sensing.lidar.pattern import Pulses, pattern_of
from forest_addon.site import ForestSite
from forest_addon.spec import (
    Airborne,
    Clearing,
    Distance,
    Forest,
    Gaussian,
    HandTree,
    Normal,
    Planting,
    Rows,
    Scene,
    SpecError,
    Stems,
    Terrain,
    Terrestrial,
)
from forest_addon.stand.compose import Inputs, TreeList, process_of
from forest_addon.stand.intensity.surface import IntensityError
from forest_addon.stand.layouts import orchard, plant_stems
from forest_addon.stand.plan import Spacing, labels, plan_stand, space
from forest_addon.tiles import LEVELS, TiledPulses, TileGrid, belongs, buffer_of, tiled_pulses

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


STRANGERS = TreeList(position=np.zeros((3, 2)), species=("elm", "oka", "oak"))


@pytest.mark.parametrize(
    ("source", "lists", "words"),
    [
        ({"trees": "t.csv"}, {"t.csv": listed()}, '"elm" is not planted; use one of oak'),
        ({"trees": "t.csv"}, {"t.csv": STRANGERS}, r'"elm", "oka" \(did you mean "oak"\?\) are'),
        (
            {"trees": "t.csv"},
            {"t.csv": TreeList(position=np.zeros((2, 2)), species=("Fichte", "Kiefer"))},
            r'"Fichte" \(did you mean "norway-spruce"\?\), "Kiefer" \(did you mean "scots-pine"\?\) are',
        ),
        ({"collection": "Mine"}, {}, '"Mine" is not here'),
    ],
)
def test_a_list_that_cannot_be_planted_is_refused(source, lists, words):
    planting = Planting(species="oak", layout="list", **source)
    with pytest.raises(IntensityError, match=words):
        plan_stand(2, Forest(), [planting], Inputs(lists=lists))


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


# ------------------------------------------------------------------------------------------- by hand
# Trees set by hand: they stay, they are kept apart from, and they change nothing else.

FIELD = Forest(size=(30.0, 30.0), spacing=2.0)
OAK = Planting(species="maple", expected=40)
TREES = (
    HandTree(position=(5.0, 5.0), rotation_deg=90.0, scale=1.5, variant=2),
    HandTree(position=(5.5, 5.0)),
    HandTree(position=(-3.0, 40.0)),
)


def rows_of(stand, keep):
    names = ("position", "rotation", "scale", "species", "variant", "number")
    return [tuple(np.ravel(getattr(stand, name)[k]).tolist() for name in names) for k in keep]


@pytest.mark.parametrize("rule", ["matern", "greedy"])
def test_trees_set_by_hand_stay_and_others_keep_away(rule):
    field = FIELD.changed(spacing_rule=rule)
    stand = plan_stand(3, field, [OAK.changed(by_hand=TREES)])
    hand = np.flatnonzero(stand.number < 0)
    assert stand.position[hand, :2].tolist() == [[5, 5], [5.5, 5], [-3, 40]]
    assert stand.rotation[hand[0]] == pytest.approx(np.pi / 2)
    assert (stand.scale[hand[0]], stand.variant[hand[0]]) == (1.5, 2)
    drawn = np.flatnonzero(stand.number >= 0)
    apart = np.linalg.norm(stand.position[drawn, None, :2] - stand.position[None, hand, :2], axis=2)
    assert apart.min() >= 2.0
    between = np.linalg.norm(stand.position[drawn, None] - stand.position[None, drawn], axis=2)
    assert between[~np.eye(len(drawn), dtype=bool)].min() >= 2.0


def test_nothing_else_changes():
    """Without spacing every drawn tree is bit for bit what it was, those of other plantings too."""
    field, other = FIELD.changed(spacing=0.0), Planting(species="spruce", expected=25)
    plain = plan_stand(3, field, [OAK, other])
    hand = plan_stand(3, field, [OAK.changed(by_hand=TREES), other])
    assert rows_of(hand, np.flatnonzero(hand.number >= 0)) == rows_of(plain, range(len(plain)))
    assert len(hand) == len(plain) + 3
    assert hand.id.tolist() == list(range(len(hand)))


def test_a_clearing_takes_what_stands_in_it_and_nothing_else():
    field = FIELD.changed(spacing=0.0)
    plain = plan_stand(3, field, [OAK])
    tree = plain.position[7, :2]
    discs = (
        Clearing(position=tuple(tree)),
        Clearing(position=(20.0, 20.0), radius=6.0),
    )
    stand = plan_stand(3, field, [OAK.changed(clearings=discs, by_hand=TREES[:1])])
    far = np.hypot(*(plain.position[:, :2] - [20, 20]).T) > 6
    far[7] = False
    assert 0 < far.sum() < len(plain) - 1
    kept = rows_of(stand, np.flatnonzero(stand.number >= 0))
    assert kept == rows_of(plain, np.flatnonzero(far))


@pytest.mark.parametrize("rule", ["matern", "greedy"])
def test_where_trees_were_deleted_or_moved_none_that_spacing_had_removed_moves_up(rule):
    field, dense = FIELD.changed(spacing_rule=rule), OAK.changed(expected=150)
    plain = plan_stand(3, field, [dense])
    assert plain.removed > 30
    every = range(0, len(plain), 4)
    discs = tuple(Clearing(position=tuple(plain.position[k, :2]), radius=0.01) for k in every)
    left = rows_of(plain, [k for k in range(len(plain)) if k not in every])
    for hand in ((), tuple(HandTree(position=(-20.0, 3.0 * k)) for k in range(len(discs)))):
        stand = plan_stand(3, field, [dense.changed(clearings=discs, by_hand=hand)])
        assert rows_of(stand, np.flatnonzero(stand.number >= 0)) == left
        assert stand.removed == plain.removed


def test_a_tree_where_there_is_no_ground_is_said(tmp_path):
    np.save(tmp_path / "hill.npy", np.ones((4, 4)))
    field = FIELD.changed(terrain=Terrain(file="hill.npy"))
    planting = OAK.changed(by_hand=TREES, expected=0, variants=3)
    forest = ForestSite.read(Scene(forest=field, plantings=(planting,)), tmp_path).grow()
    assert len(forest.stand) == 2
    assert any("set by hand" in note and "no ground" in note for note in forest.notes)


def test_a_scene_file_holds_them(tmp_path):
    planting = OAK.changed(by_hand=TREES, clearings=(Clearing(position=(1.0, 2.0), radius=3.0),))
    scene = Scene(plantings=(planting,))
    write_settings(tmp_path / "scene.toml", scene)
    assert read_settings(tmp_path / "scene.toml", Scene) == scene
    (tmp_path / "bad.toml").write_text(
        '[[plantings]]\nspecies = "maple"\nexpected = 1\nby_hand = [{ scale = 2 }]\n'
    )
    with pytest.raises(SpecError, match=r"plantings\[0\].by_hand\[0\].*position"):
        read_settings(tmp_path / "bad.toml", Scene)


def grown(planting):
    scene = Scene(seed=4, forest=Forest(size=(20, 20)), plantings=(planting,))
    return ForestSite.read(scene, Path()).grow()


@pytest.mark.medium
def test_trees_grown_to_measure_keep_theirs_where_one_is_set_beside_them():
    """Of drawn trees no bit changes; the one that is set is a variant of theirs in the size of its stem."""
    drawn = Planting(species="scots-pine", expected=3, exact=True, variants=2)
    plain = grown(drawn)
    tree = HandTree(position=(3.0, 4.0), diameter=0.31, variant=5)
    beside = grown(drawn.changed(by_hand=(tree,)))
    own = beside.stand.number >= 0
    assert (beside.wanted[own] == plain.wanted).all()
    assert (beside.stand.scale[own] == plain.stand.scale).all()
    assert beside.variants.keys() == plain.variants.keys()
    assert beside.stand.variant[~own] == [1]
    assert beside.wanted[~own, 0] == [0.31]
    alone = grown(drawn.changed(by_hand=(tree,), expected=0))
    assert alone.wanted[0, 0] == 0.31


# ------------------------------------------------------------------------------------------- spacing
# Spacing against brute force, its exact minimum distance, and what no distance may do.

RULES = ("matern", "greedy")


def apart(rule, points, mark, distance):
    none = np.zeros(len(points))
    return space(points, mark, Spacing(np.array([[distance]]), none.astype(int), none), rule)


def forest(count, seed=1, cluster=False):
    """Points, marks and spacing of three kinds, with crowns on one of them."""
    rng = stream(seed, "spacing", count)
    points = rng.uniform(0, 20, (count, 2)) + np.array([500_000.0, 5_400_000.0])
    if cluster:
        points[: count // 2] = points[0] + rng.normal(0, 0.05, (count // 2, 2))
    kind = rng.integers(0, 3, count)
    crown = np.where(kind == 2, rng.uniform(0.2, 0.9, count), 0.0)
    distance = np.array([[0.8, 0.3, 1.5], [0.3, 0.0, 0.5], [1.5, 0.5, 0.6]])
    return points, rng.random(count), Spacing(distance, kind, crown)


def brute(points, mark, spacing, rule):
    """One tree after another, from the oldest on."""
    order = np.argsort(mark, kind="stable")
    keep, judges = np.zeros(len(points), dtype=bool), []
    for tree in order:
        others = np.array(judges, dtype=int)
        gap = np.hypot(*(points[others] - points[tree]).T)
        ok = not (gap < spacing.between(np.full(len(others), tree), others)).any()
        keep[tree] = ok
        if ok or rule == "matern":
            judges.append(tree)
    return keep


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("cluster", [False, True])
@pytest.mark.parametrize("count", [2, 60, 900])
def test_pairs_crowns_and_rules_equal_the_definition(rule, cluster, count):
    points, mark, spacing = forest(count, cluster=cluster)
    keep = space(points, mark, spacing, rule)
    assert (keep == brute(points, mark, spacing, rule)).all()
    a, b = np.triu_indices(int(keep.sum()), 1)
    trees = np.flatnonzero(keep)
    gap = np.hypot(*(points[trees[a]] - points[trees[b]]).T)
    assert (gap >= spacing.between(trees[a], trees[b])).all()


@pytest.mark.medium
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("distance", [0.05, 0.5, 3.0])
def test_batches_of_many_trees_equal_the_definition(rule, distance):
    """More trees than one batch holds, against a walk in a grid of its own."""
    rng = stream(2, "many")
    points, mark = rng.uniform(0, 30, (6000, 2)), rng.random(6000)
    near = cKDTree(points).query_ball_point(points, distance * (1 - 1e-12))
    expected = np.zeros(6000, dtype=bool)
    for k in np.argsort(mark):
        older = [o for o in near[k] if mark[o] < mark[k]]
        expected[k] = not (expected[older].any() if rule == "greedy" else older)
    assert (apart(rule, points, mark, distance) == expected).all()


@pytest.mark.medium
@pytest.mark.parametrize("rule", RULES)
def test_a_distance_larger_than_the_field_leaves_the_oldest_tree(rule):
    rng = stream(3, "one")
    points, mark = rng.uniform(0, 20, (8_000, 2)), rng.random(8_000)
    keep = apart(rule, points, mark, 1000.0)
    assert keep.sum() == 1
    assert keep[np.argmin(mark)]


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("count", [0, 1, 5])
def test_trees_in_one_place_and_hardly_any(rule, count):
    points = np.full((count, 2), 7.0)
    keep = apart(rule, points, np.zeros(count), 0.5)
    assert keep.sum() == min(count, 1)
    assert apart(rule, points, np.zeros(count), 0.0).all()


@pytest.mark.parametrize("rule", RULES)
def test_a_distance_of_exactly_the_spacing_is_kept(rule):
    points = np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0]])
    assert apart(rule, points, np.arange(3.0), 5.0).all()
    assert apart(rule, points, np.arange(3.0), np.nextafter(5.0, 6)).sum() == (
        2 if rule == "greedy" else 1
    )


def test_matern_ii_keeps_the_share_that_it_should():
    """Of a Poisson process, (1 - exp(-λπr²))/(λπr²) stay (Matérn 1960; Stoyan, Kendall and Mecke 5.4).

    150 runs; neighbours inhibit each other, so the binomial error is larger than the true one: 4.5 sigma,
    false alarm below 7e-6.
    """
    stay, every = 0, 0
    for s in range(150):
        rng = stream(s, "share")
        points = rng.uniform(0, 20, (rng.poisson(400), 2))
        keep = apart("matern", points, rng.random(len(points)), 0.6)
        inner = ((points > 0.6) & (points < 19.4)).all(axis=1)
        stay, every = stay + (keep & inner).sum(), every + inner.sum()
    load = np.pi * 0.6**2
    expected = (1 - np.exp(-load)) / load
    assert abs(stay / every - expected) < 4.5 * np.sqrt(expected * (1 - expected) / every)


def test_two_species_on_the_same_centre_keep_their_pair_distance():
    field = Forest(
        size=(20.0, 20.0),
        spacing=0.5,
        distances=(
            Distance(species="oak", other="elm", distance=2.0),
            Distance(species="elm", other="elm", distance=0.0),
        ),
    )
    hill = [{"peak": 1.0, "centre": (10.0, 10.0), "width": (2.0, 2.0)}]
    trees = tuple(
        Planting(species=name, expected=60, gaussians=tuple(Gaussian(**h) for h in hill))
        for name in ("oak", "elm")
    )
    stand = plan_stand(5, field, trees)
    assert stand.removed > 0
    assert stand.too_near.sum() == stand.removed
    points = stand.position[:, :2]
    gap = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    np.fill_diagonal(gap, np.inf)
    oak = stand.species == 0
    assert gap[np.ix_(oak, oak)].min() >= 0.5
    assert gap[np.ix_(oak, ~oak)].min() >= 2.0
    assert stand.density().sum() == pytest.approx(len(stand) / 400)


def test_a_distance_of_a_species_that_is_not_planted_is_refused():
    field = Forest(distances=(Distance(species="oak", other="yew", distance=2.0),))
    with pytest.raises(
        SpecError, match=r'distances\[0\].other: "yew" is not planted; use one of oak'
    ):
        plan_stand(0, field, [Planting(species="oak", expected=3)])


# --------------------------------------------------------------------------------------------- stems
# Stems: exactly as many as asked for, evenly over the field, radii of their law.

STEMS_FIELD = Forest(size=(100.0, 50.0), origin=(-20.0, 5.0))


def test_count_place_and_radius() -> None:
    """Kolmogorov-Smirnov at a false alarm in 10 000 for each of x, y and radius."""
    spread = Normal(mean=0.2, sd=0.05)
    position, radius = plant_stems(3, STEMS_FIELD, (Stems(count=5000, radius=spread),))
    assert position.shape == (5000, 2)
    assert stats.kstest(position[:, 0], stats.uniform(-20, 100).cdf).pvalue > 1e-4
    assert stats.kstest(position[:, 1], stats.uniform(5, 50).cdf).pvalue > 1e-4
    law = stats.truncnorm(-2, 2, loc=0.2, scale=0.05)
    assert stats.kstest(radius, law.cdf).pvalue > 1e-4
    assert abs(np.corrcoef(position[:, 0], radius)[0, 1]) < 4 / np.sqrt(5000)


def test_groups_have_streams_of_their_own() -> None:
    first, second = Stems(count=10), Stems(count=20, radius=Normal(mean=0.1))
    alone, _ = plant_stems(1, STEMS_FIELD, (first,))
    both, radii = plant_stems(1, STEMS_FIELD, (first, second))
    np.testing.assert_array_equal(both[:10], alone)
    np.testing.assert_array_equal(radii, [0.25] * 10 + [0.1] * 20)
    assert not np.array_equal(plant_stems(2, STEMS_FIELD, (first,))[0], alone)
    assert plant_stems(1, STEMS_FIELD, ())[0].shape == (0, 2)
    np.testing.assert_array_equal(plant_stems(1, STEMS_FIELD, (first,))[0], alone)


# --------------------------------------------------------------------------------------------- stand
# The stand against its laws. Every statistical test states its false-alarm rate.

STAND_FIELD = Forest(size=(20.0, 20.0))
HILLS = Planting(
    species="maple",
    gaussians=(
        Gaussian(
            peak=0.4, centre=(5.0, 5.0), width=(5**0.5, 6**0.5)
        ),  # Tanveer et al. 2020a's example
        Gaussian(peak=0.3, centre=(19.0, 15.0), width=(3.0, 9.0)),  # reaches over the edge
    ),
)


def test_zero_trees_and_nothing_to_scale():
    assert len(plan_stand(0, STAND_FIELD, [])) == 0
    assert len(plan_stand(0, STAND_FIELD, [Planting(species="m", expected=0)])) == 0
    far = (Gaussian(centre=(1e6, 0.0), width=(1.0, 1.0)),)
    with pytest.raises(ValueError, match="put nothing on the field"):
        process_of(Planting(species="m", expected=3, gaussians=far), STAND_FIELD)


def test_adding_a_species_moves_no_tree_of_another():
    maple = Planting(species="maple", expected=30)
    hazel = Planting(species="hazelnut", expected=50)
    alone = plan_stand(9, STAND_FIELD, [maple])
    for place, planted in enumerate(([maple, hazel], [hazel, maple])):
        both = plan_stand(9, STAND_FIELD, planted)
        for name in ("position", "rotation", "scale", "variant"):
            assert (getattr(both, name)[both.species == place] == getattr(alone, name)).all()


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (("a", "a", "my/a.toml", "b", "a"), ["a", "a-2", "a-3", "b", "a-4"]),
        (("pine-2", "pine", "pine"), None),
        (("pine", "pine", "pine-2"), None),
    ],
)
def test_labels_tell_plantings_of_one_species_apart(names, told):
    made = labels([Planting(species=name, expected=1) for name in names])
    assert len(set(made)) == len(names)
    assert told is None or made == told


def test_scales_stay_in_their_range_and_variants_too():
    stand = plan_stand(
        1, STAND_FIELD, [Planting(species="m", expected=500, variants=3, scale=(0.5, 2.0))]
    )
    assert stand.scale.min() >= 0.5
    assert stand.scale.max() <= 2.0
    assert set(stand.variant.tolist()) == {0, 1, 2}
    # Turns are uniform: Kolmogorov-Smirnov, false alarm 1e-4.
    assert stats.kstest(stand.rotation / (2 * np.pi), "uniform").pvalue > 1e-4


# -------------------------------------------------------------------------------------------- tiles
# Tiles of a field: every place in one, every crown that reaches in, no pulse beyond what its scene holds.

SIZES = st.floats(0.5, 300.0)


@given(
    size=SIZES, along=st.floats(1.0, 200.0), across=st.floats(1.0, 200.0), x=st.floats(-1e5, 1e5)
)
def test_every_place_lies_in_one_tile_and_between_its_corners(size, along, across, x):
    grid = TileGrid.of(Forest(size=(along, across), origin=(x, -7.0)), size)
    rng = stream(3, "places")
    place = grid.low + rng.random((200, 2)) * (grid.high - grid.low)
    low, high = grid.corners(grid.tile_of(place))
    room = 1e-9 * (1 + abs(x))
    assert (place >= low - room).all()
    assert (place <= high + room).all()
    low, high = grid.corners(np.arange(len(grid)))
    assert np.prod(high - low, axis=1).sum() == pytest.approx(along * across, rel=1e-6)
    assert len({grid.name(tile) for tile in range(len(grid))}) == len(grid)


@given(
    size=st.floats(3.0, 80.0),
    height=st.floats(-5.0, 90.0),
    down=st.floats(-1.0, 1.0),
    reach=st.floats(1.0, 200.0),
    seed=st.integers(0, 99),
)
def test_no_ray_of_a_beam_leaves_what_its_tile_holds(size, height, down, reach, seed):
    scanner = Terrestrial(max_range=reach)
    grid = TileGrid.of(Forest(size=(60.0, 40.0)), size)
    rng = stream(seed, "pulses")
    origin = np.column_stack(
        [rng.uniform(-30, 90, 60), rng.uniform(-30, 70, 60), np.full(60, height)]
    )
    way = rng.normal(size=(60, 3)) * [1.0, 1.0, 0.3] + [0, 0, down]
    way /= np.linalg.norm(way, axis=1)[:, None]
    zero = np.zeros(60)
    box = np.array([[-10.0, -5.0, -1.0], [55.0, 60.0, 22.0]])
    tile, excess = belongs(scanner, Pulses(origin, way, way, zero, zero), grid, box)
    low, high = grid.corners(tile)
    far = np.linspace(0, reach, 301)[:, None, None]
    point = origin + far * way
    beyond = np.maximum(low - point[..., :2], point[..., :2] - high).max(axis=2)
    among = ((point >= box[0]) & (point <= box[1])).all(axis=2)
    assert (np.where(among, beyond, 0.0) <= excess).all()


def test_pulses_of_all_pieces_are_all_pulses_once_and_followed_ones_are_counted():
    scanner = Airborne(position=(0, 20, 60), track=60, speed=20, pulse_rate=2000, line_rate=20)
    pattern = pattern_of(scanner)
    grid = TileGrid.of(Forest(size=(60.0, 40.0)), 12.0)
    box = np.array([[-20.0, -20.0, 0.0], [80.0, 60.0, 15.0]])
    found = tiled_pulses(scanner, pattern, grid, box, 5.0)
    every = [np.concatenate(list(found.numbers(piece, 97))) for piece in found.pieces]
    assert np.array_equal(np.sort(np.concatenate(every)), np.arange(pattern.count))
    assert all((np.diff(numbers) > 0).all() for numbers in every)
    beyond = [len(n) for n, p in zip(every, found.pieces, strict=True) if p % LEVELS]
    assert found.followed == sum(beyond) > 0
    tile, excess = belongs(scanner, pattern.pulses(np.arange(pattern.count)), grid, box)
    for numbers, piece in zip(every, found.pieces, strict=True):
        assert (tile[numbers] == piece // LEVELS).all()
        assert (excess[numbers] <= buffer_of(int(piece % LEVELS), 5.0)).all()


def test_a_piece_without_pulses_gives_none():
    found = TiledPulses(np.array([0]), np.array([LEVELS]), 5, 0.0, 0)
    assert list(found.numbers(0, 10)) == []
