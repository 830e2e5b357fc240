"""Whole trees: the truth that grows with them is what is measured on their triangles. Trees of a planting
at other ages and in other seasons.
"""

import contextlib
import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.solid_brute import union_volume
from scipy.stats import chisquare, kstest, truncnorm

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.growth.draw import draw_discrete, draw_normal
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.lsystem import branching
from forest_addon.growth.lsystem.branching import grow_honda, predict_branches, skeleton_of
from forest_addon.growth.mesh.leaves import Leaves, measure_leaves
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.skeleton import Skeleton, diameter_at
from forest_addon.growth.tree import SUNK, Tree, fallen, grow, in_season, with_fallen
from forest_addon.growth.truth import (
    leaf_angles,
    segment_table,
    shared_once,
    tree_truth,
    volume_of,
    wood_of_mesh,
    wood_of_skeleton,
    wood_of_tree,
)
from forest_addon.site import ForestSite
from forest_addon.spec import (
    Detail,
    Discrete,
    Forest,
    Grammar,
    Honda,
    Leaf,
    Normal,
    Planting,
    Scene,
    Species,
)
from forest_addon.stand import forest as room
from forest_addon.stand.forest import keep_trees, tree_table


@pytest.mark.medium
@pytest.mark.parametrize("name", ["maple", "spruce"])
def test_grafted_truth_is_what_the_mesh_measures(name):
    species, template = load_species(find_species(name, Path()))
    tree = grow(species, template, stream(3, "tree", name, 0))
    measured = measure_leaves(tree.mesh)
    assert len(tree.leaves) == len(measured)
    for column in ("centre", "length", "width", "radius"):
        np.testing.assert_allclose(
            getattr(tree.leaves, column), getattr(measured, column), atol=1e-12
        )
    np.testing.assert_allclose(tree.leaves.normal, measured.normal, atol=1e-11)
    along = np.einsum("li,li->l", tree.leaves.axis, measured.axis)
    np.testing.assert_allclose(np.abs(along), 1, atol=1e-9)  # which end is the tip is not measured
    assert (np.diff(tree.leaves.branch) >= 0).all()


def test_a_species_without_a_template_grows_whole():
    species = Species(name="plain", grammar=Grammar(generations=4, radius=0.08))
    tree = grow(species, None, stream(3, "tree", "plain", 0))
    assert not tree.grafted
    assert tree.mesh.uv is not None
    assert tree.mesh.vertices[:, 2].min() == pytest.approx(-SUNK, abs=0.01)
    again = grow(species, None, stream(3, "tree", "plain", 0))
    assert np.array_equal(tree.mesh.vertices, again.mesh.vertices)
    bare = grow(replace(species, leaf=Leaf(on=False)), None, stream(3, "tree", "plain", 0))
    assert np.array_equal(bare.mesh.vertices, tree.mesh.vertices[: len(bare.mesh.vertices)])
    coarse = grow(
        replace(species, detail=Detail(tolerance=0.02)), None, stream(3, "tree", "plain", 0)
    )
    assert np.sum(coarse.mesh.part == WOOD) < 0.8 * np.sum(tree.mesh.part == WOOD)


def test_fewer_leaves_keep_their_area_and_move_no_branch():
    species, _ = load_species(find_species("honda-birch", Path()))
    few = replace(species, detail=Detail(leaves=0.2))
    whole, thinned = (grow(s, None, stream(3, "tree", "birch", 0)) for s in (species, few))
    assert len(thinned.leaves) == pytest.approx(0.2 * len(whole.leaves), abs=1)
    areas = [(tree.leaves.radius**2).sum() for tree in (thinned, whole)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-9)
    assert np.array_equal(thinned.skeleton.end, whole.skeleton.end)
    measured = measure_leaves(thinned.mesh)
    np.testing.assert_allclose(thinned.leaves.radius, measured.radius, rtol=1e-6)


def grown(**given):
    planting = Planting(**({"expected": 4, "exact": True, "variants": 2, "scale": (1, 1)} | given))
    return ForestSite.read(
        Scene(seed=2, forest=Forest(size=(30, 30)), plantings=(planting,))
    ).grow()


@pytest.mark.medium
@pytest.mark.parametrize("species", ["hazelnut", "honda-birch", "abop-monopodial-a"])
def test_trees_are_smaller_the_younger_they_are(species):
    heights = [grown(species=species, age=age).heights().mean() for age in (0.25, 0.5, 1.0, 2.0)]
    assert (np.diff(heights) > 0).all(), heights
    assert grown(species=species).heights().mean() == heights[2]


@pytest.mark.medium
def test_trees_grown_to_measure_have_diameters_in_proportion_to_age():
    """Their heights are as their kind was measured: more than half of them at half the diameter."""
    kind = {"species": "silver-birch", "expected": 2}
    old, young = (tree_table(grown(**kind, age=age)) for age in (1.0, 0.5))
    assert np.array(young["dbh_m"]) == pytest.approx(np.array(old["dbh_m"]) / 2, rel=1e-9)
    ratio = np.array(young["height_m"]) / np.array(old["height_m"])
    assert 0.5 < ratio.mean() < 0.9


@pytest.fixture(scope="module")
def tree():
    species, kind = load_species(find_species("hazelnut", Path()))
    return grow(species, kind, stream(1, "season"))


def test_leaves_fall_the_same_ones_first_and_those_left_are_as_they_were(tree):
    """The share is that of a binomial: off by 4.5 deviations with a chance of 7e-6."""
    count, before = len(tree.leaves), None
    for share in (0.2, 0.5, 0.9):
        left = with_fallen(tree, share, stream(1, "fall"))
        off = abs(len(left.leaves) - (1 - share) * count)
        assert off < 4.5 * np.sqrt(count * share * (1 - share))
        found = set(map(tuple, left.leaves.centre.tolist()))
        assert found <= set(map(tuple, tree.leaves.centre.tolist()))
        assert before is None or found < before
        before = found
        again = measure_leaves(left.mesh)  # mesh and truth say the same
        assert again.centre == pytest.approx(left.leaves.centre, abs=1e-9)
        assert again.radius == pytest.approx(left.leaves.radius, rel=1e-9)
        wood = left.mesh.select(left.mesh.part != LEAF)
        assert len(wood.triangles) == (tree.mesh.part != LEAF).sum()
    assert len(with_fallen(tree, 1.0, stream(1, "fall")).leaves) == 0
    assert with_fallen(tree, 0.0, stream(1, "fall")) is tree


def test_seasons_turn_colours_then_take_leaves():
    species, _ = load_species(find_species("hazelnut", Path()))
    colours = [in_season(species, season).look.autumn for season in (0, 0.25, 0.5, 1)]
    assert colours == [species.look.autumn, 0.5, 1, 1]
    assert [fallen(season) for season in (0, 0.5, 0.75, 1)] == [0, 0, 0.5, 1]
    summer, late, bare = (grown(species="hazelnut", season=s) for s in (0.0, 0.75, 1.0))
    many = [sum(len(t.leaves) for t in f.variants.values()) for f in (summer, late, bare)]
    assert many[2] == 0
    assert many[1] / many[0] == pytest.approx(0.5, abs=0.05)
    assert (summer.stand.position == bare.stand.position).all()


@pytest.mark.slow
@pytest.mark.parametrize("species", ["hazelnut", "silver-birch"])  # of templates, and to measure
def test_kept_trees_are_those_that_would_grow_and_a_season_grows_none(species, monkeypatch):
    def asked(season, age=0.3):
        given = {"species": species, "season": season, "age": age}
        planting = Planting(**given, expected=2, exact=True, variants=1)
        field = Forest(size=(30, 30))
        return ForestSite.read(Scene(seed=2, forest=field, plantings=(planting,)))

    kept, grew = keep_trees(), []
    monkeypatch.setattr(room, "grow", lambda *args, **named: grew.append(1) or grow(*args, **named))
    for season, growing in ((0.0, True), (0.8, False), (1.0, False), (0.3, False)):
        grew.clear()
        forest = asked(season).grow(kept=kept)
        assert bool(grew) == growing
        other = asked(season).grow()
        assert (forest.stand.scale == other.stand.scale).all()
        for key, tree in other.variants.items():
            mine = forest.variants[key]
            for name in ("vertices", "triangles", "leaf"):
                assert (getattr(mine.mesh, name) == getattr(tree.mesh, name)).all()
            assert wood_of_tree(mine) == wood_of_tree(tree)
    grew.clear()
    asked(0.3, age=0.25).grow(kept=kept)
    assert grew  # another age is other trees


# --------------------------------------------------------------------------------------------- honda
# Honda's trees: angles and ratios without chance, every distribution with it, refusals. Distribution tests
# are Kolmogorov-Smirnov (continuous) or chi-square (discrete) over trees of seeds that are fixed here; each
# would fail with a chance of 1e-6 for a correct program and an arbitrary seed.

FALSE_ALARM = 1e-6
BARE = Leaf(on=False)


def fixed(mean):
    return Normal(mean=mean)


STILL = Honda(
    levels=Discrete(values=(3,)),
    length=fixed(2.0),
    radius=fixed(0.1),
    length_ratio=fixed(0.8),
    radius_ratio=fixed(0.6),
    daughters=Discrete(values=(2,)),
    angle_deg=fixed(35.0),
    twist_deg=fixed(90.0),
    crook_deg=fixed(0.0),
    pieces=1,
    tip=0.9,
)


def but(**changes):
    return dataclasses.replace(STILL, **changes)


def lengths_of(skeleton):
    return np.linalg.norm(skeleton.end - skeleton.start, axis=1)


def expected_normal(spread):
    low, high = ((b - spread.mean) / spread.sd for b in spread.bounds())
    return truncnorm(low, high, spread.mean, spread.sd).cdf


def test_angles_ratios_and_divergence_without_chance():
    skeleton, leaves = grow_honda(STILL, BARE, 1)
    assert len(leaves) == 0
    assert len(skeleton) == 1 + 2 + 4 + 8
    length = lengths_of(skeleton)
    heading = (skeleton.end - skeleton.start) / length[:, None]
    for i in range(1, len(skeleton)):
        parent = skeleton.parent[i]
        assert length[i] == pytest.approx(0.8 * length[parent])
        assert skeleton.radius[i, 0] == pytest.approx(0.6 * skeleton.radius[parent, 0])
        assert skeleton.radius[i, 1] == pytest.approx(0.9 * skeleton.radius[i, 0])
        assert heading[i] @ heading[parent] == pytest.approx(np.cos(np.deg2rad(35)))
        assert np.allclose(skeleton.start[i], skeleton.end[parent])
        assert skeleton.order[i] == skeleton.order[parent] + 1
        assert skeleton.generation[i] == skeleton.generation[parent] + 1
    for parent in range(7):  # two children stand opposite, in a plane square to their parent's
        one, other = np.flatnonzero(skeleton.parent == parent)
        assert heading[one] @ heading[other] == pytest.approx(np.cos(np.deg2rad(70)))
        if parent:
            plane = np.cross(heading[one], heading[other])
            sister = np.cross(heading[parent], heading[skeleton.parent[parent]])
            assert plane @ sister == pytest.approx(0, abs=1e-12)


def test_a_leader_goes_straight_on_as_its_mothers_axis():
    skeleton, _ = grow_honda(but(leader_ratio=0.7), BARE, 1)
    assert len(skeleton) == 1 + 3 + 9 + 27
    trunk = skeleton.axis(0)
    assert len(trunk) == 4
    assert skeleton.end[trunk[-1]] == pytest.approx([0, 0, 2 * (1 + 0.7 + 0.49 + 0.343)])
    assert skeleton.radius[trunk[1], 0] == pytest.approx(skeleton.radius[0, 1])


@pytest.mark.parametrize("droop", [2.0, 20.0])
def test_droop_bends_down_and_never_past_the_vertical(droop):
    skeleton, _ = grow_honda(but(droop=min(droop, 6.0), pieces=20), BARE, 1)
    assert np.isfinite(skeleton.end).all()
    heading = (skeleton.end - skeleton.start) / lengths_of(skeleton)[:, None]
    onward = np.flatnonzero(
        (skeleton.order > 0) & (skeleton.order == skeleton.order[np.maximum(skeleton.parent, 0)])
    )
    assert (heading[onward, 2] <= heading[skeleton.parent[onward], 2] + 1e-12).all()
    assert np.abs(skeleton.end[skeleton.order == 0, :2]).max() < 1e-12  # the trunk stays


@pytest.mark.parametrize("angle", [0.0, 180.0])
def test_angles_of_0_and_180_degrees(angle):
    skeleton, leaves = grow_honda(but(angle_deg=fixed(angle), droop=1.0), Leaf(), 1)
    assert np.isfinite(skeleton.end).all()
    assert np.abs(skeleton.end[:, :2]).max() < 1e-12
    assert np.isfinite(leaves.direction).all()


def test_no_levels_is_a_trunk():
    skeleton, leaves = grow_honda(but(levels=Discrete(values=(0,))), Leaf(), 1)
    assert len(skeleton) == 1
    assert leaves.segment.max() == 0


def test_leaves_reach_the_tips_and_move_no_branch():
    honda = Honda()
    bare, _ = grow_honda(honda, BARE, 5)
    leafy, leaves = grow_honda(honda, Leaf(), 5)
    assert (bare.end == leafy.end).all()
    tips = leafy.end[np.setdiff1d(np.arange(len(leafy)), leafy.parent)]
    reached = (np.abs(leaves.foot[:, None] - tips[None]).max(axis=2) < 1e-9).any(axis=0)
    assert reached.all()
    assert np.abs(np.einsum("li,li->l", leaves.direction, leaves.up)).max() < 1e-12
    assert np.linalg.norm(leaves.direction, axis=1) == pytest.approx(np.ones(len(leaves)))


def test_another_number_of_leaves_or_levels_moves_no_branch():
    """Draws are keyed by lineage: what a tree has less of leaves the rest in its place."""
    full, _ = grow_honda(Honda(levels=Discrete(values=(5,))), BARE, 9)
    fewer, _ = grow_honda(Honda(levels=Discrete(values=(3,))), Leaf(), 9)
    assert (full.end[: len(fewer)] == fewer.end).all()


LENGTH = Normal(mean=2.0, sd=0.5, low=1.4, high=2.5)
RADIUS = Normal(mean=0.1, sd=0.02)
RATIO = Normal(mean=0.7, sd=0.1, high=0.8)


@pytest.mark.medium
def test_what_is_drawn_per_tree():
    honda = but(
        levels=Discrete(values=(1, 2, 4), weights=(1.0, 2.0, 1.0)),
        length=LENGTH,
        radius=RADIUS,
        length_ratio=RATIO,
        radius_ratio=dataclasses.replace(RATIO, mean=0.6),
        daughters=Discrete(values=(1,)),
    )
    trees = [grow_honda(honda, BARE, seed)[0] for seed in range(400)]
    length = [lengths_of(t)[:2] for t in trees]
    radius = [t.radius[:2, 0] for t in trees]
    levels = np.array([len(t) - 1 for t in trees])
    continuous = {
        "length": ([a for a, _ in length], LENGTH),
        "length ratio": ([b / a for a, b in length], RATIO),
        "radius": ([a for a, _ in radius], RADIUS),
        "radius ratio": ([b / a for a, b in radius], honda.radius_ratio),
    }
    for name, (seen, spread) in continuous.items():
        low, high = spread.bounds()
        assert low - 1e-9 <= min(seen) <= max(seen) <= high + 1e-9
        assert kstest(seen, expected_normal(spread)).pvalue > FALSE_ALARM, name
    counts = [(levels == k).sum() for k in (1, 2, 4)]
    assert chisquare(counts, [100, 200, 100]).pvalue > FALSE_ALARM


def test_what_is_drawn_per_branch():
    angle = Normal(mean=40.0, sd=6.0)
    twist = Normal(mean=100.0, sd=20.0)
    honda = but(
        levels=Discrete(values=(1,)),
        sprouting="along",
        bare=0.25,
        trunk_daughters=Discrete(values=(40, 60)),
        angle_deg=angle,
        twist_deg=twist,
    )
    places, angles, twists, born = [], [], [], []
    for seed in range(150):
        s, _ = grow_honda(honda, BARE, seed)
        heading = (s.end - s.start)[1:] / lengths_of(s)[1:, None]
        places += (s.start[1:, 2] / 2.0).tolist()
        angles += np.rad2deg(np.arccos(heading[:, 2])).tolist()
        azimuth = np.rad2deg(np.arctan2(heading[:, 1], heading[:, 0]))
        assert (np.diff(s.start[1:, 2]) >= 0).all()
        twists += (np.diff(azimuth) % 360).tolist()
        born.append(len(heading))
    assert kstest(places, lambda x: np.clip((x - 0.25) / 0.75, 0, 1)).pvalue > FALSE_ALARM
    assert kstest(angles, expected_normal(angle)).pvalue > FALSE_ALARM
    assert kstest(twists, expected_normal(twist)).pvalue > FALSE_ALARM
    counts = [born.count(40), born.count(60)]
    assert chisquare(counts).pvalue > FALSE_ALARM


def test_what_is_drawn_per_leaf():
    leaf = Leaf(
        length=Normal(mean=0.05, sd=0.01, low=0.045),
        width_ratio=Normal(mean=0.6, sd=0.1),
        angle_deg=Normal(mean=50.0, sd=10.0),
    )
    honda = but(leaves=Discrete(values=(10, 30), weights=(3.0, 1.0)), levels=Discrete(values=(8,)))
    skeleton, leaves = grow_honda(honda, leaf, 3)
    heading = (skeleton.end - skeleton.start) / lengths_of(skeleton)[:, None]
    cosine = np.einsum("li,li->l", heading[leaves.segment], leaves.direction)
    angle = np.rad2deg(np.arccos(cosine))
    assert kstest(leaves.length, expected_normal(leaf.length)).pvalue > FALSE_ALARM
    ratio = leaves.width / leaves.length
    assert kstest(ratio, expected_normal(leaf.width_ratio)).pvalue > FALSE_ALARM
    assert kstest(angle, expected_normal(leaf.angle_deg)).pvalue > FALSE_ALARM
    counts = np.bincount(leaves.segment)[-256:]
    assert chisquare([(counts == 10).sum(), (counts == 30).sum()], [192, 64]).pvalue > FALSE_ALARM


def test_draws_are_inverted_not_rejected():
    keys = np.arange(20000, dtype=np.uint64)
    narrow = Normal(mean=3.0, sd=100.0, low=2.9, high=3.1)  # rejection would take a thousand rounds
    values = draw_normal(narrow, keys, "x")
    assert kstest(values, expected_normal(narrow)).pvalue > FALSE_ALARM
    assert draw_normal(fixed(2.5), keys, "x").tolist() == [2.5] * 20000
    never = draw_discrete(Discrete(values=(7, 8, 9), weights=(0.0, 1.0, 0.0)), keys, "y")
    assert set(never.tolist()) == {8}


def test_sizes_are_predicted_and_refused_with_the_number():
    honda = but(levels=Discrete(values=(2, 4)), daughters=Discrete(values=(1, 3)), leader_ratio=0.5)
    assert predict_branches(honda) == pytest.approx((1 + 3 + 9 + 1 + 3 + 9 + 27 + 81) / 2)
    big = but(levels=Discrete(values=(12,)), daughters=Discrete(values=(5,)), pieces=8)
    with pytest.raises(ValueError, match="about 2,441,406,248 segments"):
        grow_honda(big, BARE, 0)
    with pytest.raises(ValueError, match="would reach 16,382 m"):
        grow_honda(
            but(
                levels=Discrete(values=(12,)),
                length_ratio=fixed(2.0),
                daughters=Discrete(values=(1,)),
            ),
            BARE,
            0,
        )
    growing = but(length_ratio=fixed(1.2))
    assert lengths_of(grow_honda(growing, BARE, 0)[0]).max() == pytest.approx(2 * 1.2**3)


def test_a_tree_larger_than_its_prediction_is_refused_too(monkeypatch):
    monkeypatch.setattr(branching, "MAX_SEGMENTS", 60)
    unlucky = but(
        daughters=Discrete(values=(1, 30), weights=(20.0, 1.0)), levels=Discrete(values=(2,))
    )
    sizes = []
    for seed in range(60):
        with contextlib.suppress(ValueError):
            sizes.append(len(grow_honda(unlucky, BARE, seed)[0]))
    assert 0 < len(sizes) < 60
    assert max(sizes) <= 60


# --------------------------------------------------------------------------------------------- truth
# Truth tables against closed forms and against fine meshes. The volume of wood, joints counted once: closed
# forms, random points, and the fine mesh. Volume of pieces that reach into each other, against closed
# forms. Cylinders of a tree whose every measure is known, and their sums against the truth of its segments.

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))])


def straight(h, r1, r2):
    return Skeleton(
        np.zeros((1, 3)),
        np.array([[0, 0, h]], float),
        np.array([[r1, r2]], float),
        np.array([-1]),
        np.zeros(1, np.int64),
        np.zeros(1, np.int64),
    )


@pytest.mark.medium
def test_cone_and_frustum():
    cone = wood_of_skeleton(straight(3.0, 0.5, 0.0))
    assert cone.volume == pytest.approx(np.pi * 0.25)
    assert cone.area == pytest.approx(np.pi * 0.5 * np.hypot(3, 0.5))
    assert cone.projected == pytest.approx(1.5)
    fine = mesh_wood(straight(3.0, 0.5, 0.2), 1e-6)
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


def skeleton(*segments):
    """Of (start, end, radius, parent, order)."""
    start, end, radius, parent, order = zip(*segments, strict=True)
    return Skeleton(
        np.array(start, float),
        np.array(end, float),
        np.array([np.broadcast_to(r, 2) for r in radius], float),
        np.array(parent),
        np.array(order),
        np.arange(len(parent)),
    )


UP = (0, 0, 2)


@pytest.mark.parametrize(
    ("segments", "apart", "together"),
    [
        (  # a trunk, and a branch of its radius at right angles from its middle: half a Steinmetz solid
            [
                ((0, 0, 0), UP, 0.2, -1, 0),
                (UP, (0, 0, 4), 0.2, 0, 0),
                (UP, (3, 0, 2), 0.2, 0, 1),
            ],
            np.pi * 0.04 * 7,
            np.pi * 0.04 * 7 - 8 * 0.2**3 / 3,
        ),
        (
            [((0, 0, 0), UP, (0.2, 0.15), -1, 0), (UP, (1, 0, 3), (0.15, 0.0), 0, 0)],
            np.pi * (2 * (0.04 + 0.03 + 0.0225) + np.sqrt(2) * 0.0225) / 3,
            np.pi * (2 * (0.04 + 0.03 + 0.0225) + np.sqrt(2) * 0.0225) / 3,
        ),
        (
            [((0, 0, 0), UP, 0.2, -1, 0), *2 * [(UP, (0, 0, 5), 0.2, 0, 1)]],
            np.pi * 0.04 * 8,
            np.pi * 0.04 * 5,
        ),
    ],
    ids=["a branch and its mother", "one axis", "sisters that start as one"],
)
def test_the_volume_of_wood_counts_what_is_shared_once(segments, apart, together):
    wood = skeleton(*segments)
    assert wood_of_skeleton(wood).volume == pytest.approx(apart)
    assert volume_of(wood) == pytest.approx(together, rel=1e-3)


@pytest.mark.medium
@pytest.mark.parametrize("species", ["abop-monopodial-a", "abop-ternary-a"])
def test_a_species_fills_what_random_points_say(species):
    settings, _ = load_species(find_species(species, Path()))
    grown, _ = skeleton_of(settings, stream(1, "solid"))
    union = union_volume(grown)
    assert volume_of(grown) == pytest.approx(union, rel=6e-3)
    assert union < 0.99 * wood_of_skeleton(grown).volume
    bare = Tree(mesh_wood(grown, 0.01), Leaves.none(), grown, grafted=False)
    assert wood_of_tree(bare).volume == volume_of(grown)


def box(low, size):
    return (np.asarray(low, float) + CORNERS * size)[FACES]


def turned(corners, angle=0.7):
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]]) @ np.array(
        [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]
    )
    return corners @ turn.T


UNIT = box((0, 0, 0), (1, 1, 1))
PAIR = [UNIT, box((0.5, 0.25, 0.25), (1, 1, 0.5))]  # 1 and 0.5 m3 that share a third of the smaller


@pytest.mark.medium
@pytest.mark.parametrize(
    ("boxes", "turn", "once", "near"),
    [
        (PAIR, 0.0, (1.5 - 0.5 * 0.75 * 0.5) / 1.5, 2e-3),
        (PAIR, 0.7, (1.5 - 0.5 * 0.75 * 0.5) / 1.5, 2e-3),
        ([UNIT, box((3, 0, 5), (1, 2, 0.5))], 0.7, 1.0, 1e-9),
        ([UNIT, box((0.2, 0.2, 0.2), (0.5, 0.5, 0.5))], 0.7, 1 / 1.125, 2e-3),
        ([UNIT] * 3, 0.7, 1 / 3, 1e-9),
    ],
    ids=["two", "two, turned", "apart", "one within another", "three in one place"],
)
def test_what_boxes_share_counts_once(boxes, turn, once, near):
    found = shared_once(turned(np.concatenate(boxes), turn))
    assert found == pytest.approx(once, abs=near)


def test_a_piece_without_a_cap_says_nothing():
    """Lines through the hole of a third box are left out: between 0.75 of two and 2.5 / 3 of three."""
    both = np.concatenate([box((0, 0, 0), (1, 1, 1)), box((0.5, 0, 0), (1, 1, 1))])
    opened = np.concatenate([both, box((9, 0, 0), (1, 1, 1))[:-2]])
    assert 0.75 < shared_once(turned(opened)) < 0.83
    assert shared_once(np.empty((0, 3, 3))) == 1.0


def fork():
    """A trunk of two segments, a branch of two at its middle, and a twig."""
    start = [[0, 0, 0], [0, 0, 1], [0, 0, 1], [1, 0, 1.5], [1, 0, 1.5]]
    end = [[0, 0, 1], [0, 0, 3], [1, 0, 1.5], [2, 0, 2], [1, 1, 1.5]]
    radius = [[0.2, 0.16], [0.16, 0.08], [0.05, 0.04], [0.04, 0.02], [0.01, 0.01]]
    return Skeleton(
        start=np.array(start, float),
        end=np.array(end, float),
        radius=np.array(radius),
        parent=np.array([-1, 0, 0, 2, 2]),
        order=np.array([0, 0, 1, 1, 2]),
        generation=np.array([0, 1, 1, 2, 2]),
    )


def test_diameter_at_a_height():
    tree = fork()
    assert diameter_at(tree, 1.3) == pytest.approx(2 * (0.16 - 0.08 * 0.15))
    assert diameter_at(tree, 0.0) == pytest.approx(0.4)
    assert diameter_at(tree, 3.0) == 0.0
    two = replace(
        tree,
        **{
            name: np.concatenate([getattr(tree, name), getattr(tree, name)[:2]])
            for name in ("start", "end", "radius", "parent", "order", "generation")
        },
    )
    assert diameter_at(two, 1.3) == pytest.approx(np.sqrt(2) * diameter_at(tree, 1.3))
