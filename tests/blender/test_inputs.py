"""What a stand takes from a scene: the ground under trees, painted weights, places of objects."""

from dataclasses import fields, replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import add_collection, add_mesh, link

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.base.trimesh import GROUND, WOOD
from forest_addon.blender.rays.bvh import BvhCaster
from forest_addon.blender.read.inputs import (
    inputs_from_scene,
    read_painted,
    read_places,
    read_terrain,
)
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.layout import GROUND_NAME, part
from forest_addon.blender.scene.meshes import ground_mesh
from forest_addon.blender.scene.nodes import GROUP
from forest_addon.blender.sensors.observe import Observer
from forest_addon.growth.library import load_species
from forest_addon.spec import SpecError
from forest_addon.stand.compose import Inputs
from forest_addon.stand.forest import grow_forest
from forest_addon.stand.intensity.surface import Heightmap


def depsgraph():
    bpy.context.view_layer.update()
    return bpy.context.evaluated_depsgraph_get()


def slab(name, z, low=0.0, high=10.0):
    corners = [(low, low, z), (high, low, z), (high, high, z), (low, high, z)]
    return add_mesh(name, corners, (0, 1, 2, 3))


# ------------------------------------------------------------------------------------------ terrain


def test_a_moved_turned_object_is_terrain_where_it_stands(empty_blender):
    obj = add_mesh("hill", [(0, 0, 0), (8, 0, 0), (0, 8, 4)], (0, 1, 2))  # z = y / 2
    obj.location, obj.rotation_euler = (100, 200, 5), (0, 0, np.pi / 2)
    ground = read_terrain("hill", depsgraph())
    inside = np.array([[99.0, 201.0], [96.0, 203.0]])  # local y is 100 - x
    assert np.allclose(ground.height(inside), 5 + (100 - inside[:, 0]) / 2, atol=1e-5)
    assert np.isnan(ground.height(np.array([[101.0, 201.0]]))).all()


def test_modifiers_of_the_terrain_count(empty_blender):
    obj = slab("flat", 0.0)
    obj.modifiers.new("Up", "DISPLACE").mid_level = 0.25  # 1 - 0.25 along the normal
    assert read_terrain("flat", depsgraph()).height(np.array([[5.0, 5.0]]))[0] == pytest.approx(
        0.75, abs=1e-6
    )


def test_the_topmost_surface_counts_below_an_overhang(empty_blender):
    corners = [(0, 0, 1), (10, 0, 1), (10, 10, 1), (0, 10, 1)]
    roof = [(0, 0, 6), (5, 0, 6), (5, 10, 6), (0, 10, 6)]
    add_mesh("cliff", corners + roof, (0, 1, 2, 3), (4, 5, 6, 7))
    ground = read_terrain("cliff", depsgraph())
    assert ground.height(np.array([[2.0, 5.0], [8.0, 5.0]])).tolist() == [6, 1]


def forest_on(name, **changes):
    settings = spec.Scene(
        seed=5,
        forest=spec.Forest(size=(10.0, 10.0), terrain=spec.Terrain(object=name), **changes),
        plantings=(
            spec.Planting(species="abop-monopodial-a", variants=1, expected=40, exact=True),
        ),
    )
    inputs = inputs_from_scene(settings, depsgraph())
    species = load_species(ASSETS / "species" / "abop-monopodial-a.toml")
    return settings, inputs, grow_forest(settings, [species], inputs=inputs)


def test_no_tree_stands_over_a_hole_and_the_missing_are_counted(empty_blender):
    strip = [(0, 0, 2), (10, 0, 2), (10, 4, 2), (0, 4, 2)]
    other = [(0, 6, 2), (10, 6, 2), (10, 10, 2), (0, 10, 2)]
    add_mesh("strips", strip + other, (0, 1, 2, 3), (4, 5, 6, 7))
    _, _, forest = forest_on("strips")
    y = forest.stand.position[:, 1]
    assert not ((y > 4) & (y < 6)).any()
    assert (forest.stand.position[:, 2] == 2).all()
    assert len(forest.stand) + forest.stand.off_ground.sum() == 40
    assert forest.stand.off_ground.sum() > 0


@pytest.mark.medium
@pytest.mark.parametrize("instancing", ["points", "objects"])
def test_on_a_slope_no_gap_shows_under_a_trunk(empty_blender, instancing):
    """Rays along the slope, just above it, meet the foot of every tree before they could pass below."""
    obj = add_mesh("slope", [(0, 0, 0), (10, 0, 6), (10, 10, 6), (0, 10, 0)], (0, 1, 2, 3))
    settings, inputs, forest = forest_on("slope", instancing=instancing)
    build(bpy.context.scene, settings, forest, inputs.terrain)
    assert obj.name in bpy.context.scene.objects
    assert not part(bpy.context.scene, GROUND_NAME).objects
    scene = Observer(depsgraph()).geometry
    base = forest.transforms()[:, :, 3]
    ground = inputs.terrain.height(base[:, :2])
    radius = np.array([t.skeleton.radius[0, 0] for t in forest.variants.values()])[0]
    radius = radius * forest.stand.scale
    assert (base[:, 2] <= ground - 0.6 * radius + 1e-9).all()
    down = np.column_stack([-np.ones(len(base)), np.zeros(len(base)), np.full(len(base), -0.6)])
    level = inputs.terrain.height(base[:, :2] + [0.8, 0]) + 0.002
    origins = np.column_stack([base[:, 0] + 0.8, base[:, 1], level])
    inside = np.isfinite(level)
    hits = BvhCaster(scene).cast(origins[inside], down[inside], 1.2)
    parts = [
        scene.meshes[scene.mesh_index[i]].part[t]
        for i, t in zip(hits.instance, hits.triangle, strict=True)
        if i >= 0
    ]
    assert inside.sum() > 20
    assert len(parts) == inside.sum()
    assert set(parts) == {WOOD}


def test_a_ground_that_we_made_and_that_is_named_as_terrain_stays(empty_blender):
    settings, _, forest = forest_on("")
    build(bpy.context.scene, settings, forest)
    settings, inputs, forest = forest_on("Ground")
    for _ in range(2):
        build(bpy.context.scene, settings, forest, inputs.terrain)
        assert "Ground" in bpy.data.objects
        assert len(part(bpy.context.scene, GROUND_NAME).objects) == 1


def test_a_heightmap_becomes_a_ground_with_a_margin(empty_blender):
    field = spec.Forest(size=(10.0, 10.0), origin=(100.0, 0.0), margin=7.0)
    pixels = np.arange(12.0).reshape(3, 4)
    terrain = Heightmap(pixels, np.array([100.0, 0.0]), np.array([10.0, 10.0]), "map")
    mesh = ground_mesh(field, terrain)
    assert mesh.vertices[:, :2].min(axis=0).tolist() == [93, -7]
    assert mesh.vertices[:, :2].max(axis=0).tolist() == [117, 17]
    assert (mesh.part == GROUND).all()
    assert (mesh.area_vectors()[:, 2] > 0).all()  # nothing folds over
    assert mesh.area_vectors()[:, 2].sum() == pytest.approx(24 * 24)
    within = (np.abs(mesh.vertices[:, :2] - [105, 5]) < 5).all(axis=1)
    vertices = mesh.vertices[within]
    assert len(vertices) == 12
    assert np.allclose(vertices[:, 2], terrain.height(vertices[:, :2]))


# ------------------------------------------------------------------------------------------- weights


def test_a_vertex_group_is_read_by_name_or_as_the_active_one(empty_blender):
    obj = slab("field", 0.0)
    for name, weight in (("oaks", 0.5), ("ash", 1.0)):
        group = obj.vertex_groups.new(name=name)
        group.add([1, 2], weight, "REPLACE")
    assert read_painted("field:oaks", depsgraph()).weight.tolist() == [0, 0.5, 0.5, 0]
    assert read_painted("field", depsgraph()).weight.tolist() == [0, 1, 1, 0]  # the last made


@pytest.mark.parametrize(
    ("kind", "domain", "key", "values", "expected"),
    [
        ("FLOAT", "POINT", "value", [0.0, 1, 2, 3], [0, 1, 2, 0, 2, 3]),
        ("FLOAT", "CORNER", "value", [4.0, 5, 6, 7], [4, 5, 6, 4, 6, 7]),
        ("FLOAT", "FACE", "value", [2.5], [2.5] * 6),
        ("INT", "POINT", "value", [0, 1, 2, 3], [0, 1, 2, 0, 2, 3]),
        ("BOOLEAN", "FACE", "value", [True], [1] * 6),
        ("FLOAT_COLOR", "POINT", "color", [[1, 1, 1, 1]] * 4, [1] * 6),
        ("FLOAT_COLOR", "CORNER", "color", [[0, 1, 0, 1]] * 4, [0.7152] * 6),
        ("BYTE_COLOR", "CORNER", "color", [[1, 0, 0, 1]] * 4, [0.2126] * 6),
    ],
)
def test_attributes_of_every_kind_weigh(empty_blender, kind, domain, key, values, expected):
    obj = slab("field", 0.0)
    attribute = obj.data.attributes.new("w", kind, domain)
    attribute.data.foreach_set(key, np.ravel(values))
    painted = read_painted("field:w", depsgraph())
    found = painted.weight[painted.triangles]
    corner = painted.vertices[painted.triangles].reshape(-1, 3)
    order = {(0, 0): 0, (10, 0): 1, (10, 10): 2, (0, 10): 3}
    by_corner = {}
    for place, weight in zip(corner, found.ravel(), strict=True):
        by_corner[order[tuple(place[:2].round().astype(int))]] = weight
    wanted = dict(zip([0, 1, 2, 0, 2, 3], expected, strict=True))
    assert by_corner == pytest.approx(wanted, abs=1e-6)


def test_a_name_with_a_colon_is_an_object_where_there_is_one(empty_blender):
    obj = slab("field", 0.0)
    obj.name = "site: north"
    obj.vertex_groups.new(name="w").add([0], 1.0, "REPLACE")
    assert read_painted("site: north", depsgraph()).weight.tolist() == [1, 0, 0, 0]
    assert read_painted("site: north:w", depsgraph()).weight.tolist() == [1, 0, 0, 0]


@pytest.mark.medium
def test_trees_stand_where_it_is_painted(empty_blender):
    obj = slab("field", 0.0)
    obj.location = (20, 0, 0)
    obj.vertex_groups.new(name="w").add([1, 2], 1.0, "REPLACE")  # grows along x
    settings = spec.Scene(
        seed=1,
        forest=spec.Forest(size=(40.0, 20.0)),
        plantings=(spec.Planting(species="apple", painted="field:w", expected=900, exact=True),),
    )
    from forest_addon.stand.plan import plan_stand

    inputs = inputs_from_scene(settings, depsgraph())
    stand = plan_stand(settings.seed, settings.forest, settings.plantings, inputs)
    x = stand.position[:, 0] - 20
    assert ((x >= 0) & (x <= 10)).all()
    # λ grows like x, so that (x/10)² is uniform: its mean is 1/2 ± 0.29/30; 5 σ.
    assert np.mean((x / 10) ** 2) == pytest.approx(0.5, abs=5 * 0.29 / 30)


# -------------------------------------------------------------------------------------------- places


def test_objects_say_where_trees_stand(empty_blender):
    home = add_collection("surveyed")
    for number, (x, size) in enumerate([(1, 1.0), (5, 2.0), (7, 0.5)]):
        peg = link(f"peg {number}", home=home)
        peg.location, peg.scale = (x, 2, 3), (size,) * 3
        peg.rotation_euler = (0, 0, 0.1 * number)
    found = read_places("surveyed", depsgraph())
    assert found.position.tolist() == [[1, 2, 3], [5, 2, 3], [7, 2, 3]]
    assert found.scale == pytest.approx([1, 2, 0.5])
    assert found.rotation == pytest.approx([0, 0.1, 0.2])
    settings = spec.Scene(
        forest=spec.Forest(size=(10.0, 10.0)),
        plantings=(spec.Planting(species="apple", layout="list", collection="surveyed"),),
    )
    inputs = inputs_from_scene(settings, depsgraph(), Inputs())
    forest = grow_forest(settings, [load_species(ASSETS / "species" / "apple.toml")], inputs=inputs)
    assert np.allclose(forest.stand.position, found.position)
    assert np.allclose(forest.stand.scale, found.scale)


def test_a_mirrored_peg_is_refused(empty_blender):
    link("left", home=add_collection("surveyed")).scale.x = -1
    with pytest.raises(SpecError, match='"left" is mirrored'):
        read_places("surveyed", depsgraph())


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: read_terrain("hill", depsgraph()), 'no object "hill".*field'),
        (lambda: read_terrain("edge", depsgraph()), '"edge".*no area from above'),
        (lambda: read_painted("hill:w", depsgraph()), 'no object "hill"'),
        (lambda: read_painted("field:w", depsgraph()), 'no layer "w" of weights'),
        (lambda: read_painted("field", depsgraph()), "no painted layer"),
        (lambda: read_places("pegs", depsgraph()), 'no collection "pegs"'),
    ],
)
def test_what_is_not_there_is_named_with_what_is(empty_blender, ask, words):
    slab("field", 0.0)
    add_mesh("edge", [(0, 0, 0), (1, 0, 0), (0, 0, 1)], (0, 1, 2))
    with pytest.raises(SpecError, match=words):
        ask()


# -------------------------------------------------------------------------------------- ground nodes
# A ground to the horizon: views show what is around the forest, sensors all of it.

HORIZON = spec.Scene(forest=spec.Forest(size=(36.0, 20.0), origin=(5.0, -3.0), margin=1000.0))


def plant(settings=HORIZON):
    build(bpy.context.scene, settings, grow_forest(settings, []))
    return part(bpy.context.scene, GROUND_NAME).objects["Ground"]


def near(settings=HORIZON):
    return replace(settings, forest=replace(settings.forest, margin=20.0))


def box(obj):
    """Corners of what a view shows, which View All frames."""
    bpy.context.view_layer.update()
    corners = np.array(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).bound_box)
    return corners.min(axis=0), corners.max(axis=0)


def read():
    """All that sensors are given of a scene."""
    found = Observer(bpy.context.evaluated_depsgraph_get()).geometry
    arrays = [getattr(found, f.name) for f in fields(found) if f.name != "meshes"]
    for mesh in found.meshes:
        arrays += [mesh.vertices, mesh.triangles, mesh.part]
    return [array.tobytes() if isinstance(array, np.ndarray) else repr(array) for array in arrays]


def test_views_show_a_quarter_of_the_field_around_it(empty_blender):
    low, high = box(plant())
    assert low == pytest.approx([5 - 9, -3 - 9, 0])
    assert high == pytest.approx([5 + 36 + 9, -3 + 20 + 9, 0])


def test_sensors_are_given_the_same_bytes_as_without_the_nodes(empty_blender):
    # An object that comes before the ground by name, and so among instances.
    add_mesh("a rock", [(0, 0, 1), (1, 0, 1), (0, 1, 2)], (0, 1, 2))
    ground = plant()
    with_nodes, shown = read(), box(ground)
    assert (box(ground)[1] == shown[1]).all()  # views are as they were
    assert ground.modifiers[0].show_viewport
    ground.modifiers.clear()
    assert with_nodes == read()
    assert box(ground)[1] == pytest.approx([1041, 1017, 0])


def test_a_near_ground_has_no_nodes_and_what_was_taken_away_stays_away(empty_blender):
    assert not plant(near()).modifiers
    assert [m.name for m in plant().modifiers] == [GROUP]
    assert [m.name for m in plant().modifiers] == [GROUP]
    assert not plant(near()).modifiers
    plant().modifiers.clear()
    assert not plant().modifiers
