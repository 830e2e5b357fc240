"""What is left to "auto": from files and from Python, bounds that hold, and what knows no auto."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.echoes import square_leaves
from references.rays import BruteCaster, scene_with

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD, TriMesh, is_wood
from forest_addon.formats.toml_file import read_settings, structure, table_of, write_settings
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.leaves import separate_leaves
from forest_addon.growth.tree import grow
from forest_addon.sensing.audit import Audit, Check, held
from forest_addon.sensing.canopy import OUTSIDE, REACH, SKY, hemisphere, look_up
from forest_addon.sensing.detail import grow_needed
from forest_addon.sensing.kind import AROUND, Cost
from forest_addon.sensing.kinds import choose, kind_of, outline
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.sensing.sonar.beam import beam_offsets
from forest_addon.sensing.trajectory import frame_of
from forest_addon.sensing.trees_audit import (
    _to_triangles,
    audit_trees,
    part_of_leaves,
    part_of_tubes,
    points_on_cones,
)
from forest_addon.spec import (
    AUTO,
    Accuracy,
    Air,
    Airborne,
    Beam,
    Forest,
    Mobile,
    Normal,
    Place,
    Planting,
    Pose,
    Reverb,
    Scene,
    Sonar,
    SpecError,
    Stems,
    Targets,
    Terrestrial,
    Tractor,
)
from forest_addon.stand.forest import grow_forest

AUTOS = [Sonar(tolerance="auto", cull="auto"), Reverb(tolerance="auto")]


@pytest.mark.parametrize("sensor", AUTOS, ids=["sonar", "reverb"])
def test_the_word_in_a_file_and_in_python(sensor, tmp_path):
    assert sensor.tolerance == AUTO
    assert table_of(sensor)["tolerance"] == "auto"
    write_settings(tmp_path / "scene.toml", Scene(sensors=(sensor,)))
    assert 'tolerance = "auto"' in (tmp_path / "scene.toml").read_text()
    assert read_settings(tmp_path / "scene.toml", Scene).sensors == (sensor,)


@pytest.mark.parametrize("sensor", AUTOS, ids=["sonar", "reverb"])
def test_nothing_is_left_to_auto_and_each_choice_has_its_bound(sensor):
    made, chosen = choose(sensor)
    assert AUTO not in vars(made).values()
    assert all(getattr(made, choice.key) == choice.value for choice in chosen)
    assert all(0 < choice.bound < 0.01 and choice.why for choice in chosen)
    assert choose(made) == (made, ())


def test_a_cruder_leaf_is_summed_more_coarsely():
    exact, paper = (choose(AUTOS[0].changed(leaf_model=m))[0] for m in ("exact", "paper"))
    assert exact.tolerance < paper.tolerance
    assert exact.cull < paper.cull
    assert choose(Sonar(tolerance=1e-3, cull="auto"))[0].cull == pytest.approx(1e-2)


def test_what_has_nothing_to_choose_stays():
    tripod = Terrestrial()
    assert choose(tripod) == (tripod, ())


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"kind": "sonar", "max_range": "auto"}, "max_range"),
        ({"kind": "sonar", "tolerance": "automatic"}, "tolerance"),
        ({"kind": "reverb", "tolerance": -0.5}, 'or "auto"'),
        ({"kind": "reverb", "strength": -1.0}, "strength"),
    ],
)
def test_only_what_can_be_chosen_may_be_left_to_it(table, words):
    with pytest.raises(SpecError) as said:
        structure({"sensors": [table]}, Scene)
    assert words in str(said.value)


@pytest.mark.slow
def test_a_chosen_reverb_keeps_its_bound():
    rng = stream(3, "choice")
    place = rng.uniform(-40, 40, (400, 2))
    place = place[np.linalg.norm(place, axis=1) > 3]
    trunks = Trunks(place, np.exp(rng.uniform(-4, -1, len(place))), np.arange(len(place)))
    clap = Reverb(source=(0, 0, 1.5), receiver=(2, 0, 1.5), sample_rate=8000, duration=0.3)
    made, (choice,) = choose(clap.changed(tolerance="auto"))
    fast = impulse_response(trunks, made, Air()).trees
    exact = impulse_response(trunks, clap.changed(tolerance=0.0), Air()).trees
    assert np.linalg.norm(fast - exact) <= choice.bound * np.linalg.norm(exact)


def test_what_only_the_direct_sum_keeps_is_served_and_said():
    made, (choice,) = choose(Reverb(tolerance=1e-8))
    assert made.tolerance == 1e-8
    assert "direct sum" in str(choice)
    assert choice.record()["asked"] == 1e-8
    assert choose(Reverb(tolerance=1e-6)) == (Reverb(tolerance=1e-6), ())


# ---------------------------------------------------------------------------------------- cost words
# Cost of a run in words, as commands say it before they begin.


@pytest.mark.parametrize(
    ("cost", "words"),
    [
        (Cost("pings", 12, 12, 1.2, 0), "12 pings: about a second"),
        (
            Cost("pulses", 22_000_000, 154_000_000, 308.0, 9_900_000_000),
            "22,000,000 pulses of 154,000,000 rays: about 5 min, 9.9 GB",
        ),
        (Cost("pulses", 10**9, 10**9, 2e4, 0), "1,000,000,000 pulses: about 5.6 h"),
        (Cost("pulses", 9, 9, 1.1e11, 10**16), "9 pulses: about 30,555,556 h, 10,000,000 GB"),
    ],
)
def test_costs_in_words(cost, words):
    assert str(cost) == words


def test_a_reverb_takes_longer_with_heights_stems_and_a_forest_that_goes_on():
    """In proportion to cuts and to channels; a forest that goes on as stems of its number do."""
    level = Reverb(source=(5.0, 5.0, 1.5), receiver=(9.0, 5.0, 1.5))

    def among(*given):
        count = kind_of(level).cost(given[0], None, "embree").count
        return sum(kind_of(level).seconds_among(*given, count))

    field = Scene(name="field", forest=Forest(size=(100.0, 100.0)))
    stems = field.changed(stems=(Stems(count=30_000), Stems(count=10_000)))
    one = among(level, field, 100)
    assert among(level, field, 200) == pytest.approx(2 * one)
    high = [among(level.changed(receiver=(9.0, 5.0, 1.5 + rise)), field, 100) for rise in (6, 11.5)]
    assert (high[1] - one) / (high[0] - one) == pytest.approx(22 / 11)  # 23 and 12 heights
    pair = level.changed(receivers=(Place(position=(9.0, 7.0, 1.5)),))
    assert among(pair, stems, 0) == pytest.approx(2 * among(level, stems, 0))
    far = level.changed(continue_to=200.0)  # 0.01 trees/m² over π·4 ha, of which 100 stand
    as_many = field.changed(stems=(Stems(count=round(0.01 * math.pi * 200.0**2) - 100),))
    assert among(far, field, 100) == pytest.approx(among(level, as_many, 100), rel=1e-3)
    assert among(level, as_many, 100) < among(level, stems, 100)


def test_a_scanners_pulses_are_counted_before_they_are_sent():
    scanner = Terrestrial(angle_step_deg=1.0, elevation_deg=(0, 9), beam=Beam(subrays=7))
    assert str(kind_of(scanner).cost(scanner, None, "embree")).startswith("3,600 pulses of 25,200 ")


# ------------------------------------------------------------------------------------- detail needed
# What a scene's sensors need of a forest: what is left out changes nothing, or no more than is said.

WIDE = Beam(divergence_mrad=(0.8, 0.5), subrays=7)
PLANE = Airborne(position=(-40.0, 10.0, 80.0), heading_deg=0.0, beam=WIDE)


def scene(*sensors, species="honda-birch", detail="auto", variants=4):
    planting = Planting(species=species, variants=variants, expected=8, exact=True)
    return Scene(
        seed=2,
        forest=Forest(size=(20.0, 20.0)),
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
@pytest.mark.parametrize("species", ["honda-birch", "silver-birch"])
def test_where_no_sensor_meets_a_leaf_none_grows_and_no_branch_moves(species):
    asked = scene(Reverb(), species=species)
    young = asked.plantings[0].changed(age=0.4)
    full, some, chosen = grown(asked.changed(plantings=(young,)))
    assert not any(len(tree.leaves) for tree in some.variants.values())
    same_wood(some, full)
    assert np.array_equal(some.stand.position, full.stand.position)
    assert np.array_equal(some.stand.sink, full.stand.sink)
    (choice,) = chosen
    assert choice.bound == 0
    assert "no change" in str(choice)


@pytest.mark.slow
def test_a_model_with_leaves_keeps_them_and_so_does_who_does_not_ask():
    for sensors, detail in (
        ((Reverb(model="forest"),), "auto"),
        ((Reverb(),), "full"),
        ((), "auto"),
    ):
        asked = scene(*sensors, detail=detail, variants=1)
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


# ------------------------------------------------------------------------------------------- outline
# Outlines: drawn where the sensor itself says that it looks.


@pytest.mark.parametrize("axis", [(0, 0), (110, 12), (-30, 90), (45, -90)])
@pytest.mark.parametrize("width", [(30.0, 30.0), (10.0, 60.0), (5.0, 170.0)])
def test_the_contour_of_a_beam_is_where_it_has_lost_3_db(axis, width):
    sonar = Sonar(
        position=(1, 2, 3),
        azimuth_deg=axis[0],
        elevation_deg=axis[1],
        beam_width_deg=width,
        max_range=7.0,
    )
    contour = outline(sonar)[:AROUND, 0] - sonar.position
    np.testing.assert_allclose(np.linalg.norm(contour, axis=1), 7.0, rtol=1e-12)
    az, el = np.degrees(beam_offsets(contour / 7.0, frame_of(*np.radians(axis))))
    lost = 3.0 * ((2 * az / width[0]) ** 2 + (2 * el / width[1]) ** 2)  # dB of a Gaussian
    np.testing.assert_allclose(lost, 3.0, atol=1e-9)


def test_the_fan_of_a_tractor_starts_at_the_ground_and_ends_at_the_top():
    tractor = Tractor(position=(1, 2, 1), heading_deg=90, reach=20, top=12, track=30)
    ends = outline(tractor)
    assert ends[0].tolist() == pytest.approx(np.array([(1, 2, 1), (1, 32, 1)]))
    fan = ends[1:, 1]
    assert fan[:, 0].max() > 20  # to the right of a drive towards +Y
    angles = np.degrees(np.arctan2(fan[:, 2] - 1, fan[:, 0] - 1))
    assert angles.max() == pytest.approx(math.degrees(math.atan2(11, 20)))
    assert angles[angles < 0].min() == pytest.approx(-math.degrees(math.atan2(1, 20)))
    mirrored = outline(Tractor(position=(1, 2, 1), side="left"))
    assert mirrored[1:, 1, 0].min() < -10


def test_the_window_of_a_scanner_keeps_to_its_angles():
    scanner = Terrestrial(position=(5, 5, 2), azimuth_deg=(10, 50), elevation_deg=(-20, 40))
    seen = (outline(scanner) - scanner.position).reshape(-1, 3)
    azimuth = np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))
    elevation = np.degrees(np.arcsin(seen[:, 2] / np.linalg.norm(seen, axis=1)))
    assert (azimuth.min(), azimuth.max()) == pytest.approx((10, 50))
    assert (elevation.min(), elevation.max()) == pytest.approx((-20, 40))


def test_the_ground_path_is_as_long_as_from_the_mirrored_source():
    reverb = Reverb(source=(0, 0, 1), receiver=(9, 0, 2))
    direct, down, up = outline(reverb)
    assert np.linalg.norm(direct[1] - direct[0]) == pytest.approx(math.hypot(9, 1))
    assert down[1][2] == 0
    length = np.linalg.norm(down[1] - down[0]) + np.linalg.norm(up[1] - up[0])
    assert length == pytest.approx(math.hypot(9, 3))


def test_a_flight_is_its_strips_and_where_its_beams_meet_the_ground():
    flight = Airborne(position=(0, 0, 50), heading_deg=90, track=80, strips=2, spacing=30)
    segments = outline(flight)
    np.testing.assert_allclose(segments[0], [(0, 0, 50), (0, 80, 50)], atol=1e-12)
    np.testing.assert_allclose(segments[4], [(30, 80, 50), (30, 0, 50)], atol=1e-12)  # flown back
    reach = 50 * math.tan(math.radians(30))
    np.testing.assert_allclose(segments[1:3, 1], [(-reach, 0, 0), (reach, 0, 0)], atol=1e-12)


def test_a_mobile_scanner_is_its_poses():
    poses = (Pose(), Pose(time=1, position=(5, 0, 2)), Pose(time=2, position=(5, 5, 2)))
    assert outline(Mobile(poses=poses)).tolist() == [
        [[0, 0, 2], [5, 0, 2]],
        [[5, 0, 2], [5, 5, 2]],
    ]
    assert len(outline(Mobile())) == 0


# -------------------------------------------------------------------------------------- trees audit
# Audits of what grew: silent on the shipped species, loud on thin tubes, lost branches, moved leaves.

RNG = stream(1, "audit test")
POINTS = 24
SEEDLING = Targets(dbh=Normal(mean=0.03), height=3.0, leaf_area=1.0)


@pytest.fixture
def points(monkeypatch):
    """An audit of branches by so many points."""
    monkeypatch.setattr("forest_addon.sensing.trees_audit.LEAST", POINTS)

    def audit(*trees):
        rng = stream(2, "audit points")
        return held([part_of_tubes(trees, rng)], rng, 1.0)

    return audit


def tree_of(name):
    species, template = load_species(find_species(name, Path()))
    return grow(species, template, stream(2, "audit tree")), species.detail.tolerance


@pytest.fixture(scope="module")
def birch():
    return tree_of("honda-birch")


@pytest.mark.medium
@pytest.mark.parametrize("name", ["honda-willow", "abop-ternary-a"])
def test_the_tubes_of_species_are_within_their_tolerance(name, points):
    found = points(tree_of(name))
    assert found.kept, str(found)
    assert found.error > 0
    assert found.checked == POINTS


@pytest.mark.medium
def test_a_branch_that_is_thin_or_lost_is_found(birch, points):
    """Half of the wood is lost: that none of 24 points lies there has a chance of 6e-8."""
    tree, allowed = birch
    thick = replace(tree, skeleton=replace(tree.skeleton, radius=tree.skeleton.radius * 1.2))
    assert not points((thick, allowed)).kept
    wood = np.flatnonzero(tree.mesh.part == WOOD)
    lost = tree.mesh.select(~np.isin(np.arange(len(tree.mesh.part)), wood[len(wood) // 2 :]))
    assert not points((replace(tree, mesh=lost), allowed)).kept


def test_points_are_on_cones_above_the_ground(birch):
    wood = birch[0].skeleton
    points = points_on_cones(wood, 50, RNG)
    assert (points[:, 2] > 0).all()
    span = wood.end - wood.start
    for point in points:  # of some segment: as far off its axis as it is thick there
        along = np.einsum("si,si->s", point - wood.start, span) / np.einsum("si,si->s", span, span)
        foot = wood.start + along[:, None] * span
        thick = wood.radius[:, 0] + along * np.diff(wood.radius, axis=1)[:, 0]
        off = np.abs(np.linalg.norm(point - foot, axis=1) - thick)
        assert off[(along >= 0) & (along <= 1)].min() < 1e-12


def test_metres_to_a_triangle():
    """Against many points of the triangle; one has no area."""
    corners = RNG.normal(size=(20, 3, 3))
    corners[0, 2] = corners[0, 1]
    share = RNG.dirichlet([0.6, 0.6, 0.6], 40_000)
    share[:3] = np.eye(3)
    for point in RNG.normal(size=(5, 3)) * 2:
        found = _to_triangles(point, corners)
        brute = [np.linalg.norm(share @ one - point, axis=1).min() for one in corners]
        assert (found <= np.array(brute) + 1e-12).all()
        assert np.allclose(found, brute, atol=0.03)


@pytest.mark.medium
@pytest.mark.parametrize("name", ["fern", "scots-pine"])
def test_curved_leaves_and_shoots_are_where_their_truth_says(name):
    """As they come out of Blender: in single precision, and numbered anew where they are in pieces."""
    species, kind = load_species(find_species(name, Path()))
    settings = Scene(plantings=(Planting(species=name, variants=1, expected=1, exact=True),))
    small = species.changed(targets=SEEDLING) if species.needles else species
    forest = grow_forest(settings, [(small, kind)])
    mesh = forest.variant_of(0).mesh
    single = replace(mesh, vertices=mesh.vertices.astype(np.float32).astype(np.float64))
    none = np.zeros(1, np.int64)
    meshes = (separate_leaves(single),)
    scene = SceneGeometry(meshes, forest.transforms(), none, ("a",), forest.stand.id, none)
    found = held([part_of_leaves(forest, scene, 1.0)], RNG, 1.0)
    assert found.kept
    assert found.checked == 1


def test_leaves_are_where_their_truth_says():
    bush = Planting(species="hazelnut", variants=1, expected=2, exact=True)
    settings = Scene(plantings=(bush,))
    forest = grow_forest(settings, [load_species(find_species("hazelnut", Path()))])
    tree = forest.variant_of(0)
    single = tree.mesh.vertices.astype(np.float32).astype(np.float64)
    mesh = replace(tree.mesh, vertices=single)
    none = np.zeros(2, np.int64)
    scene = SceneGeometry((mesh,), forest.transforms(), none, ("a", "b"), forest.stand.id, none)
    found = audit_trees(forest, scene, RNG, 1.0, 0.1)
    assert list(found) == ["leaves"]  # branches come from a template
    assert found["leaves"].kept
    assert found["leaves"].checked == 1
    moved = replace(scene, meshes=(replace(mesh, vertices=single + np.array([0, 0, 1e-3])),))
    assert not held([part_of_leaves(forest, moved, 0.1)], RNG, 1.0).kept
    fewer = replace(scene, meshes=(mesh.select(mesh.leaf != 0),))
    assert held([part_of_leaves(forest, fewer, 0.1)], RNG, 1.0).error == np.inf


def test_an_audit_reads_as_people_write_numbers():
    check = Check.on("rays", np.zeros(3), 30, 1e-9, "m")
    assert "(10 % of 30; sees errors in 63 %), 0 m off at most" in str(Audit((check,), 1.0, 1234.0))
    said = {1234.0: "1,230", 1.2e7: "12,000,000", 56.54: "56.5", 2.0: "2"}
    for times, words in said.items():
        assert f"; about {words} times as fast" in str(Audit((check,), 1.0, times))


# -------------------------------------------------------------------------------------------- canopy
# Hemispherical pictures of canopies whose gap fraction is known.


def slab(index, rng, size=0.4, half=7.0):
    """Square leaves at random from 1 to 1.5 m up, facing all ways: P = exp(-L/(2 cos θ))."""
    count = round(index * (2 * half) ** 2 / size**2)
    centre = np.column_stack([rng.uniform(-half, half, (count, 2)), rng.uniform(1.0, 1.5, count)])
    return scene_with(square_leaves(centre, rng.standard_normal((count, 3)), size))


@pytest.mark.slow
def test_leaves_at_random_have_the_index_that_they_have():
    """L = 0.8, spherical, from 40 points; a ring's gap is that of about as many leaves, 0.48/√40 = 0.08."""
    points = np.column_stack([stream(1, "at").uniform(-3, 3, (40, 2)), np.zeros(40)])
    seen = look_up(BruteCaster(slab(0.8, stream(1, "slab"))), points, stream(1, "rays"), 6, 12)
    expected = np.exp(-0.4 / np.cos(seen.zenith))
    assert seen.gap[:4] == pytest.approx(expected[:4], abs=0.16)
    assert seen.effective == pytest.approx(0.8, rel=0.2)
    assert 0 < seen.open < 1
    assert seen.rays == 40 * 6 * 12
    assert seen.zenith[-1] < REACH


def test_an_open_sky_has_no_leaves():
    seen = look_up(
        BruteCaster(slab(0.0, stream(2, "slab"))), np.zeros((1, 3)), stream(2, "rays"), 4, 8
    )
    assert (seen.gap == 1).all()
    assert seen.effective == 0
    assert seen.open == 1


def test_a_hemispherical_picture_shows_a_ceiling_where_it_is():
    """A square at height 1 from x 0 to 2 and y 0 to 1, east and north of the point: tan z (cos a, sin a)."""
    corners = np.array([[0, 0, 1], [2, 0, 1], [2, 1, 1], [0, 1, 1.0]])
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), LEAF)
    seen = hemisphere(BruteCaster(scene_with(mesh)), np.zeros(3), 40)
    row, column = np.indices((40, 40))
    east, north = 1 - (column + 0.5) / 20, 1 - (row + 0.5) / 20  # the head lies north: east is left
    away = np.hypot(east, north)
    reach = np.tan(np.minimum(away, 0.999) * np.pi / 2) / away
    x, y = east * reach, north * reach
    covered = (x > 0) & (x < 2) & (y > 0) & (y < 1) & (away < 1)
    assert np.array_equal(seen == LEAF, covered)
    assert np.array_equal(seen == OUTSIDE, away > 1)
    assert np.array_equal(seen == SKY, (away <= 1) & ~covered)
