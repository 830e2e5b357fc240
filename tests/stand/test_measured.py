"""Stands of trees that measure what a list or a planting says."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from forest_addon import spec
from forest_addon.api.world import World
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import DEAD, LEAF, WOOD
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library import find_species, load_species, read_allometry
from forest_addon.growth.measured.allometry import TARGETS, Wanted, band, draw, scores
from forest_addon.growth.skeleton import Skeleton
from forest_addon.growth.tree import grow
from forest_addon.growth.truth import segment_table, volume_of
from forest_addon.sensing.audit import held
from forest_addon.sensing.trees_audit import part_of_tubes
from forest_addon.site import ForestSite
from forest_addon.spec import (
    Forest,
    Grammar,
    Normal,
    Planting,
    Reverb,
    Rows,
    Scene,
    SpecError,
    Species,
    Targets,
    Terrain,
    Terrestrial,
)
from forest_addon.stand.competition import aside
from forest_addon.stand.compose import Inputs
from forest_addon.stand.files import read_tree_list
from forest_addon.stand.forest import (
    NONE,
    ForestPlan,
    angle_table,
    cylinder_table,
    grow_forest,
    inventory,
    leaf_count,
    leaf_table,
    met_targets,
    missed_measures,
    tree_table,
    variant_leaf_table,
    voxel_arrays,
)
from forest_addon.stand.intensity.surface import Flat, Heightmap, Triangulated, roughened
from forest_addon.stand.measured import (
    dbh_at,
    facts_of,
    groups_of,
    in_band,
    record,
    scales_for,
    sentences,
    targets_met,
    with_targets,
)
from forest_addon.stand.plan import PLANTS, plan_stand

LIST = "x,y,dbh,height\n" + "".join(
    f"{x},{x},{0.08 + 0.01 * x:.3f},{7 + 0.3 * x:.2f}\n" for x in range(1, 9)
)


def grown(tmp_path, variants):
    file = tmp_path / "plot.csv"
    file.write_text(LIST)
    planting = Planting(species="scots-pine", layout="list", trees="plot.csv", variants=variants)
    scene = Scene(seed=4, forest=Forest(size=(20, 20)), plantings=(planting,))
    inputs = Inputs(lists={"plot.csv": read_tree_list(file)})
    return grow_forest(scene, [load_species(find_species("scots-pine", Path()))], None, inputs)


@pytest.mark.medium
def test_every_tree_of_a_list_has_its_diameter(tmp_path):
    """With a variant for each tree its height too; with fewer, that of a tree of like proportions."""
    forests = {variants: grown(tmp_path, variants) for variants in (8, 3)}
    for variants, forest in forests.items():
        table = tree_table(forest)
        dbh, height = np.array(table["dbh_m"]), np.array(table["height_m"])
        assert len(forest.variants) == variants
        assert dbh == pytest.approx(0.08 + 0.01 * np.arange(1, 9), abs=1e-6)
        near = 0.01 if variants == 8 else 0.35
        assert height == pytest.approx(7 + 0.3 * np.arange(1, 9), rel=near)
        assert table["target_dbh_m"] == pytest.approx(dbh)
        assert np.array(table["crown_base_m"]).min() > 0
    assert forests[8].wanted == pytest.approx(forests[3].wanted)  # whichever others stand


def test_a_variant_of_which_no_tree_stands_lends_its_size_to_none():
    pine = load_species(find_species("scots-pine", Path()))
    targets = Targets(allometry="pinus-sylvestris", dbh=Normal(mean=0.1, sd=0.01))
    planting = Planting(species="scots-pine", expected=2, exact=True, variants=1, targets=targets)
    scene = Scene(seed=4, forest=Forest(size=(20, 20)), plantings=(planting, planting))
    plan = ForestPlan.of(scene, [pine, pine])
    trees = dict(plan.grow().variants)
    assert sorted(trees) == [(0, 0), (1, 0)]
    thick = grow(*pine, stream(9, "thick"), Wanted(0.3, 18.0, 5.0, 9.0, 60.0))
    assert np.array_equal(plan.placed(trees | {(0, 1): thick}).scale, plan.placed(trees).scale)


def test_what_no_allometry_tells_must_be_given():
    targets = Targets(dbh=Normal(mean=0.1), height=8.0, crown_width=2.0, crown_base=3.0)
    planting = Planting(species="ginkgo", expected=2, exact=True, targets=targets)
    scene = Scene(forest=Forest(size=(20, 20)), plantings=(planting,))
    species = load_species(find_species("ginkgo", Path()))
    with pytest.raises(SpecError, match="leaf_area is not given"):
        grow_forest(scene, [species])


@pytest.mark.slow
def test_sizes_in_a_stand_are_one_joint_law():
    """Spruces too far apart to compete: each size follows its diameter as the law says, and what is left
    of it no diameter, but the other sizes as residuals are correlated.

    Of 2,500 trees each of ten correlations is off by 4.5 standard errors with a chance of 7e-6.
    """
    name, law = "norway-spruce", read_allometry("picea-abies", Path())
    rows = Rows(row_spacing=30, tree_spacing=30)
    targets = Targets(dbh=Normal(mean=0.3, sd=0.07), allometry="picea-abies")
    planting = Planting(species=name, layout="rows", rows=rows, targets=targets)
    inputs = Inputs(allometries={"picea-abies": law})
    stand = plan_stand(7, Forest(size=(1500, 1500)), [planting], inputs)
    species = [load_species(find_species(name, Path()))]
    trees = with_targets(7, stand, [planting], [name], species, inputs).trees
    left = np.column_stack([trees[:, 0], scores(law, trees[:, 0], trees[:, 1:])])
    found = np.corrcoef(left.T)[np.triu_indices(5, 1)]
    assert len(trees) > 2400
    expected = [0, 0, 0, 0, *law.correlation]
    assert np.abs(found - expected).max() < 4.5 / np.sqrt(len(trees))


def test_a_size_is_found_at_which_a_stem_has_its_diameter():
    """A cone of 10 m, 0.3 m thick at the foot: s·0.3·(1 - 1.3/(10 s)) = D."""
    z = np.zeros((1, 3))
    cone = Skeleton(
        z, np.array([[0, 0, 10.0]]), np.array([[0.15, 0.0]]), np.array([-1]), *np.zeros((2, 1), int)
    )
    wanted = np.array([0.2, 0.3, 0.5])
    scale = scales_for(cone, wanted)
    assert scale == pytest.approx((wanted + 0.3 * 0.13) / 0.3, rel=1e-9)
    assert dbh_at(cone, scale) == pytest.approx(wanted, rel=1e-9)


def test_like_trees_share_a_variant():
    rng = stream(1, "like")
    slim = np.column_stack(
        [np.full(40, 0.2), np.full(40, 22.0), *np.tile([3.0, 9.0, 30.0], (40, 1)).T]
    )
    stout = slim * [1, 0.5, 2, 0.4, 1]
    wanted = np.concatenate([slim, stout]) * np.exp(0.01 * rng.standard_normal((80, 5)))
    group, models = groups_of(wanted, 2, None, stream(2, "like"))
    assert len(models) == 2
    assert len(set(group[:40])) == len(set(group[40:])) == 1
    assert group[0] != group[40]


# ------------------------------------------------------------------------------------------- targets
# What trees were to measure, and what is said of it: counted against the table, and where nobody asked.

TARGETS_LIST = "x,y,dbh,height\n2,2,0.10,8.0\n5,5,0.12,9.0\n8,8,0.16,9.5\n"
LAW = read_allometry("betula", Path())


GAPS = "x,y,dbh,height\n2,2,0.10,8.0\n5,5,0.11,15.0\n8,8,0.12,\n2,8,,9.0\n"


def targets_scene(tmp_path, targets, variants=3, text=TARGETS_LIST):
    file = tmp_path / "plot.csv"
    file.write_text(text)
    planting = Planting(
        species="honda-birch", layout="list", trees="plot.csv", variants=variants, targets=targets
    )
    scene = Scene(seed=4, forest=Forest(size=(10, 10)), plantings=(planting,))
    lists = {"plot.csv": read_tree_list(file)}
    return scene, Inputs(lists=lists, allometries={"betula": LAW} if targets else {})


def targets_grown(tmp_path, targets, **options):
    scene, inputs = targets_scene(tmp_path, targets, **options)
    return grow_forest(scene, [load_species(find_species("honda-birch", Path()))], None, inputs)


def test_gaps_of_a_list_and_measures_that_are_missed_are_counted(tmp_path):
    """One variant cannot have three heights: who is off, and the worst, as the table of trees says."""
    betula = Targets(allometry="betula")
    forest = targets_grown(tmp_path, betula, variants=1, text=GAPS)
    assert forest.notes == (
        "honda-birch: of the 4 trees of its list, 1 without dbh and 1 without height, which is drawn",
    )
    scene, inputs = targets_scene(tmp_path, betula, variants=1, text=GAPS)
    (said,) = missed_measures(forest, scene, inputs)
    height = np.array(tree_table(forest)["height_m"])
    given = np.array([8.0, 15.0, np.nan, 9.0])
    off = np.abs(height / given - 1)
    worst = int(np.nanargmax(off))
    assert f"{(off > 0.05).sum()} of the 4 trees of its list do not meet" in said
    assert f"a height of {height[worst]:.3g} in place of {given[worst]:.3g} m; trees.csv" in said


def test_target_and_reached_of_every_tree(tmp_path, monkeypatch):
    forest = targets_grown(tmp_path, Targets(allometry="betula"))
    assert forest.notes == ()
    (met,) = met_targets(forest)
    table = tree_table(forest)
    assert met.kind == LAW.name
    assert met.wanted[:, 0].tolist() == [0.10, 0.12, 0.16]
    assert met.found[:, 1].tolist() == table["height_m"]
    assert met.reached[:, 0].all()
    told = record(met)
    assert told["measures"]["height"]["target"] == [8.0, 9.0, 9.5]
    assert told["measures"]["dbh"]["not_met"] == 0
    assert told["all_within_band"] == np.mean(np.array(table["in_band"], dtype=float))
    assert next(iter(facts_of(met))) == "honda-birch: dbh"
    low, high = band(LAW, np.array([0.10, 0.12, 0.16]))
    height = np.array(table["height_m"])
    inside = (height >= low[:, 0]) & (height <= high[:, 0])
    assert told["measures"]["height"]["within_band"] == inside.mean()
    world = World(Scene(), tmp_path, forest, None)
    monkeypatch.setattr(world, "_standing", lambda: (forest, NONE))
    columns = world.trees
    assert columns["target_leaf_area_m2"].dtype == columns["in_band"].dtype == np.float64
    assert columns["not_met"].shape == (3,)


def test_what_a_list_says_in_vain_is_said(tmp_path):
    forest = targets_grown(tmp_path, None)
    assert forest.notes == (
        "honda-birch: its list gives dbh and height, which count only with [plantings.targets]; the "
        "trees have the sizes of their species",
    )
    assert met_targets(forest) == []
    assert "target_dbh_m" not in tree_table(forest)


def table_of(found):
    names = ("dbh_m", "height_m", "crown_width_m", "crown_base_m", "leaf_area_m2")
    return dict(zip(names, found.T.tolist(), strict=True))


def test_what_could_not_be_is_counted():
    """A tree a millimetre and more too thick, one with a crown 6 % too wide; the third has no targets."""
    wanted = np.array([[0.2, 15, 4, 5, 60], [0.2, 15, 4, 5, 60], [np.nan] * 5])
    found = np.array([[0.2012, 15, 4.19, 5, 60], [0.2, 15.0, 4.24, 5, 60], [0.1, 2, 1, 1, 1]])
    (met,) = targets_met(
        table_of(found), np.zeros(3, int), ["a"], wanted, [LAW], [("no room",), (), ()]
    )
    assert list(sentences(met)) == [
        "a: dbh of 1 of 2 trees is off its target by more than 1 mm.",
        "a: crown_width of 1 of 2 trees is off its target by more than 5%.",
        "a: no room (1 of 2 trees).",
    ]
    assert dict(zip(TARGETS, met.off.max(axis=0), strict=True))["crown_width"] == pytest.approx(
        0.06
    )


def test_the_band_is_that_of_nine_of_ten():
    """Trees drawn by the law itself: 4,000 binomial trials."""
    rng = stream(3, "band")
    dbh = np.exp(rng.uniform(np.log(0.05), np.log(0.3), 4000))
    drawn = draw(LAW, dbh, np.full((4000, 4), np.nan), rng.random((4000, 4)))
    inside = in_band(LAW, np.column_stack([dbh, drawn])).mean(axis=0)
    # Residuals are those of a normal within 1.9 sigmas: 0.9 / 0.94257. Four sigmas: 3e-4 false alarms.
    assert np.abs(inside - 0.9 / 0.94257).max() < 4 * np.sqrt(0.955 * 0.045 / 4000)


# --------------------------------------------------------------------------------------------- truth
# The truth of a small forest: trees, cylinders and areas by cell against its meshes in the world.

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


# -------------------------------------------------------------------------------------------- tables
# Tables of a forest: what they sum to.


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


# --------------------------------------------------------------------------------------- undergrowth
# Undergrowth of measured stands: what is planted, that it moves no tree, and ground that is rough.

LOOKED_AT = (Terrestrial(),)
SCENES = Path(__file__).parents[2] / "assets" / "scenes"


def scene_of(undergrowth="auto", species="scots-pine", sensors=LOOKED_AT, **field):
    field = Forest(size=(20.0, 20.0), undergrowth=undergrowth, **field)
    planted = Planting(species=species, expected=20.0, exact=True)
    return Scene(seed=3, forest=field, plantings=(planted,), sensors=sensors)


BARE = scene_of("none").plantings


@pytest.mark.parametrize(
    ("scene", "clothed", "rough"),
    [
        (scene_of(), True, True),
        (scene_of("sparse"), True, True),
        (scene_of("sparse", terrain=Terrain(roughness=0.0)), True, False),
        (scene_of("none"), False, False),
        (scene_of(sensors=(Reverb(),)), False, False),
        (scene_of(species="honda-birch"), False, False),
        (
            scene_of().changed(plantings=(*BARE, Planting(species="fern", expected=3.0))),
            False,
            False,
        ),
    ],
    ids=["auto", "sparse", "level", "none", "for the ear", "not measured", "by hand"],
)
def test_measured_stands_are_clothed_and_rough_where_something_looks(scene, clothed, rough):
    site = ForestSite.read(scene)
    assert (len(site.scene.plantings) > 5) == clothed
    assert clothed or site.scene.plantings == scene.plantings
    assert (site.inputs.terrain is not None) == rough


@pytest.mark.medium
@pytest.mark.parametrize("name", sorted(path.stem for path in SCENES.glob("*.toml")))
def test_scenes_that_are_shipped_stay_as_they_are(name):
    scene = read_settings(SCENES / f"{name}.toml", Scene)
    site = ForestSite.read(scene, SCENES)
    assert site.scene == scene
    assert site.inputs.terrain is None or isinstance(site.inputs.terrain, Heightmap | Triangulated)


def test_undergrowth_moves_no_tree():
    bare, clothed = (
        ForestSite.read(scene_of(kind, spacing=1.5)).plan() for kind in ("none", "dense")
    )
    own = clothed.first(1)
    assert own.position[:, :2].tobytes() == bare.position[:, :2].tobytes()
    assert own.variant.tolist() == bare.variant.tolist()
    assert clothed.id[: len(bare)].tolist() == bare.id.tolist()
    assert (clothed.too_near[1:] == 0).all()


def test_young_trees_take_no_room_from_the_canopy():
    bare, clothed = (
        ForestSite.read(scene_of(kind)).planned().measured.trees for kind in ("none", "dense")
    )
    assert clothed[: len(bare)] == pytest.approx(bare, abs=1e-12)


def test_numbers_are_those_of_the_table():
    counts = np.zeros(len(PLANTS))
    for seed in range(5):
        site = ForestSite.read(scene_of("dense").changed(seed=seed))
        counts += site.plan().counts()[1 : 1 + len(PLANTS)]
    wanted = 5 * 400 / 1e4 * np.array([numbers[0][1] for numbers in PLANTS.values()])
    assert (abs(counts - wanted) < 4.5 * np.sqrt(wanted) + 1).all()  # Poisson, 1 in 1e5


@pytest.mark.parametrize("name", ["stump", "log"])
def test_stumps_and_logs_are_dead_wood_that_is_audited_as_other_wood(name):
    (tree, *_) = ForestSite.read(scene_of("none", name)).grow().variants.values()
    assert (tree.mesh.part == DEAD).all()
    assert tree.height < 0.6
    rng = np.random.default_rng(0)
    assert held([part_of_tubes([(tree, 0.002)], rng)], rng, 0.01).kept


def test_ground_is_as_rough_as_asked():
    field = Forest(size=(40.0, 30.0), margin=20.0)
    for roughness in (0.05, 0.2):
        ground = roughened(Flat(2.0), field, roughness, 5)
        x, y = np.meshgrid(np.linspace(1, 39, 160), np.linspace(1, 29, 120))
        height = ground.height(np.column_stack([x.ravel(), y.ravel()]))
        assert height.std() == pytest.approx(roughness / 4, rel=0.15)
        assert height.mean() == pytest.approx(2.0, abs=roughness / 10)
        edge = ground.height(np.array([[-5.9, 10.0], [45.9, 10.0], [10.0, -5.9], [10.0, 35.9]]))
        assert edge == pytest.approx(2.0, abs=1e-9)
    again = roughened(Flat(2.0), field, 0.2, 5)
    assert again.grid.nodes.tobytes() == ground.grid.nodes.tobytes()
    assert roughened(ground, field, 0.0, 5) is ground


def test_rough_triangles_are_refused():
    square = Triangulated(
        np.array([[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    with pytest.raises(SpecError, match="roughness"):
        roughened(square, Forest(), 0.1, 1)


def test_crowns_stand_aside_towards_the_light():
    ticks = 2.5 * np.arange(9)
    place = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    gone = np.linalg.norm(place - place[40] - [2.5, 0.0], axis=1) < 0.1
    place, height, width = place[~gone], np.full(80, 15.0), np.full(80, 3.0)
    every = np.ones(80, dtype=bool)
    found = aside(place, height, width, every)
    assert found[40, 0] > 0.1  # to the gap at its side
    assert abs(found[40, 1]) < 1e-9
    assert np.abs(found[0]).max() < 1e-9  # as much light on all sides as it can be told
    assert not aside(place, np.where(np.arange(80) == 40, 30.0, height), width, every)[
        40
    ].any()  # taller
    far = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]])
    assert not aside(far, height[:3], width[:3], every[:3]).any()
    turned = aside(place @ [[0.0, 1.0], [-1.0, 0.0]], height, width, every)
    assert turned == pytest.approx(found @ [[0.0, 1.0], [-1.0, 0.0]], abs=1e-9)
