"""Trees that are moved, locked, swapped or removed by hand stay so when the forest is grown again."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Vector
from references.scenes import add_mesh, link, reopened
from ui.pressing import ROOT, press, trees

from forest_addon.base.trimesh import LEAF
from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.scene.instances import TREE_KEY, stood_trees
from forest_addon.blender.scene.layout import VARIANTS, part
from forest_addon.blender.scene.meshes import from_mesh
from forest_addon.blender.show.intensity import CELLS, LIFT
from forest_addon.site import ForestSite
from forest_addon.ui.forest import planting, tree
from forest_addon.ui.forest.hand import Hand, swap_tree, take_away
from forest_addon.ui.forest.planting import FOREST_OT_plant, ground_below
from forest_addon.ui.settings import exchange
from forest_addon.ui.shell.views import region_below


def places():
    return sorted((t.location.x, t.location.y) for t in trees())


def standing_by_script():
    """Where a scene file with the panel's settings has its trees."""
    settings = exchange.to_spec(bpy.context.scene)
    return sorted(map(tuple, ForestSite.read(settings).plan().position[:, :2].tolist()))


def select(*things):
    bpy.ops.object.select_all(action="DESELECT")
    for obj in things:
        obj.select_set(True)
    bpy.context.view_layer.objects.active = things[0]


@pytest.fixture
def grove(small):
    small.plantings[0].expected, small.plantings[0].exact = 5, True
    small.plantings[0].variants = 2
    assert press("build") == {"FINISHED"}
    return small


@pytest.mark.medium
def test_a_tree_that_was_moved_and_turned_stays_there(grove):
    others = places()
    tree = trees()[2]
    others.remove((tree.location.x, tree.location.y))
    mesh = tree.data
    tree.location.x, tree.location.y = 1.25, 9.5
    tree.rotation_euler.z, tree.scale = 0.5, (1.5, 1.5, 1.5)
    press("build")
    assert places() == sorted([*others, (1.25, 9.5)])
    moved = next(t for t in trees() if tuple(t.location[:2]) == (1.25, 9.5))
    assert moved.rotation_euler.z == pytest.approx(0.5, abs=1e-4)
    assert moved.scale.x == pytest.approx(1.5, abs=1e-4)
    assert moved.data == mesh
    press("build")  # nothing is noted twice
    planting = grove.plantings[0]
    assert (len(planting.by_hand), len(planting.clearings)) == (1, 1)
    moved = next(t for t in trees() if tuple(t.location[:2]) == (1.25, 9.5))
    moved.location.x = 2.5
    press("build")
    assert (len(planting.by_hand), len(planting.clearings)) == (1, 1)
    assert (2.5, 9.5) in places()
    assert np.allclose(standing_by_script(), places(), atol=1e-5)


@pytest.mark.medium
def test_a_tree_that_was_deleted_stays_away_and_all_of_them_come_back(grove):
    tree = trees()[0]
    gone = tuple(tree.location[:2])
    bpy.data.objects.remove(tree)
    press("build")
    assert len(trees()) == 4
    assert gone not in places()
    assert np.allclose(standing_by_script(), places(), atol=1e-5)
    bpy.data.batch_remove(trees())
    press("build")
    assert len(trees()) == 4


@pytest.mark.medium
def test_locked_trees_outlive_another_seed(grove):
    tree = trees()[1]
    tree.location.x += 0.75
    stands, mesh = tuple(tree.location), tree.data.name
    select(tree)
    assert press("lock_trees") == {"FINISHED"}
    press("build")
    assert len(grove.plantings[0].by_hand) == 1
    grove.seed += 1
    grove.plantings[0].expected = 2
    press("build")
    assert len(trees()) == 3
    kept = next(t for t in trees() if np.allclose(t.location, stands, atol=1e-5))
    assert kept.data.name == mesh


def test_a_swapped_tree_is_the_next_variant_at_once_and_after_growing(grove):
    tree = trees()[0]
    stands, before = tuple(tree.location[:2]), tree.data.name
    select(tree)
    assert press("swap_trees") == {"FINISHED"}
    now = tree.data.name
    assert now != before
    press("build")
    kept = next(t for t in trees() if np.allclose(t.location[:2], stands, atol=1e-5))
    assert kept.data.name == now


def test_removed_trees_go_at_once_and_stay_away(grove):
    gone = trees()[:2]
    lost = [tuple(t.location[:2]) for t in gone]
    select(*gone)
    assert press("remove_trees") == {"FINISHED"}
    assert len(trees()) == 3
    press("build")
    assert len(trees()) == 3
    assert not set(lost) & set(places())
    assert len(grove.plantings[0].clearings) == 2


def test_trees_that_follow_something_else_are_not_taken_for_moved(grove):
    tree = trees()[0]
    tree.parent = trees()[1]
    tree.location.x += 3
    press("build")
    assert not grove.plantings[0].by_hand


def test_copies_of_trees_are_planted_where_they_stand(grove):
    others, planting = places(), grove.plantings[0]
    copy = bpy.data.objects["001 " + trees()[0].name.rpartition(" ")[0] + ".001"].copy()
    copy.data = copy.data.copy()  # as Blender drops an asset of the same file
    copy.location, copy.rotation_euler.z = (2.5, 7.25, 0.0), 0.75
    beside = trees()[0].copy()
    beside.location[:2], beside.scale = (8.5, 1.25), (1.25, 1.25, 1.25)
    mine = bpy.data.objects.new("mine", bpy.data.meshes.new("mine"))
    its_mesh = copy.data.name
    for obj in (copy, beside, mine):
        bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.update()
    mesh = trees()[0].data
    select(mine)
    assert not bpy.ops.forest.adopt_trees.poll()
    select(copy, beside, mine)
    assert press("adopt_trees") == {"FINISHED"}
    assert [entry.variant for entry in planting.by_hand][:1] == [1]
    assert "mine" in bpy.data.objects
    assert its_mesh not in bpy.data.meshes
    assert len(trees()) == 7  # grown at once
    assert places() == sorted([*others, (2.5, 7.25), (8.5, 1.25)])
    new = {tuple(tree.location[:2]): tree for tree in trees()}
    assert new[2.5, 7.25].rotation_euler.z == pytest.approx(0.75, abs=1e-4)
    assert new[8.5, 1.25].scale.x == pytest.approx(1.25, abs=1e-4)
    assert new[8.5, 1.25].data == mesh
    assert np.allclose(standing_by_script(), places(), atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("link", [False, True])
def test_a_tree_of_another_file_is_planted_only_where_it_is_the_same(grove, tmp_path, link):
    """As Blender brings one in when its thumbnail is dropped: appended or linked from a library's file."""
    path = tmp_path / "library.blend"
    variant = next(t for t in part(bpy.context.scene, VARIANTS).objects if t.name.startswith("001"))
    bpy.data.libraries.write(str(path), {variant}, fake_user=True)
    role, scene = variant["forest_role"], bpy.context.scene

    def brought():
        with bpy.data.libraries.load(str(path), link=link) as (there, here):
            here.objects = there.objects[:1]
        assert here.objects[0]["forest_role"] == role
        return here.objects[0]

    same = brought()
    assert planting.is_foreign_tree(same)
    assert planting.is_of_forest(same, scene)
    scene.collection.objects.link(same)
    select(same)
    count = len(trees())
    assert press("adopt_trees") == {"FINISHED"}
    assert len(trees()) == count + 1
    grove.seed += 1
    assert press("build") == {"FINISHED"}
    other = brought()  # this forest has other trees now
    assert planting.is_foreign_tree(other)
    assert not planting.is_of_forest(other, scene)
    assert not planting.is_foreign_tree(bpy.data.objects.new("mine", bpy.data.meshes.new("mine")))


def test_the_view_below_the_mouse_is_taken_and_of_four_the_right_one():
    def box(kind, x, y, width, height, regions=()):
        named = {"type": kind, "x": x, "y": y, "width": width, "height": height, "regions": regions}
        return SimpleNamespace(**named)

    one = box("VIEW_3D", 0, 0, 100, 100, [box("UI", 80, 0, 20, 100), box("WINDOW", 0, 0, 100, 100)])
    four = [box("WINDOW", 100 + 50 * k, 50 * j, 50, 50) for j in (0, 1) for k in (0, 1)]
    quad = box("VIEW_3D", 100, 0, 100, 100, four)
    outliner = box("OUTLINER", 200, 0, 100, 100, [box("WINDOW", 200, 0, 100, 100)])
    window = SimpleNamespace(screen=SimpleNamespace(areas=[outliner, one, quad]))
    assert region_below(window, 30, 30) == (one, one.regions[1])
    assert region_below(window, 160, 70) == (quad, four[3])
    assert region_below(window, 250, 50) == (one, one.regions[1])
    assert (
        region_below(SimpleNamespace(screen=SimpleNamespace(areas=[outliner])), 5, 5) == (None,) * 2
    )


# ------------------------------------------------------------------------------------------ planting
# The hand that plants: what a stroke sets, clears and takes back, in trees that are objects or points.


def planting_places():
    return np.array(sorted(tree.place for tree in stood_trees(bpy.context.scene))).reshape(-1, 2)


@pytest.fixture(params=["objects", "points"])
def hand(small, request):
    small.forest.instancing = request.param
    small.plantings[0].expected, small.plantings[0].exact = 5, True
    small.plantings[0].variants = 2
    assert press("build") == {"FINISHED"}
    one = Hand(bpy.context.scene, np.random.default_rng(5))
    one.look()
    return one


@pytest.mark.medium
def test_a_click_sets_a_tree_exactly_there(hand, small):
    before = planting_places()
    hand.begin()
    hand.plant(small.plantings[0], (4.5, -3.25))
    press("build")
    assert len(planting_places()) == len(before) + 1
    assert (4.5, -3.25) in map(tuple, planting_places().tolist())


@pytest.mark.medium
def test_a_drag_fills_the_disc_up_to_its_density_and_no_further(hand, small):
    planting, before = small.plantings[0], len(hand.trees)
    middle, radius, density = (40.0, 40.0), 5.0, 0.25
    assert hand.scatter(planting, middle, radius, density) == round(density * np.pi * 25)
    assert hand.scatter(planting, middle, radius, density) == 0
    press("build")
    there = planting_places()
    within = np.hypot(*(there - middle).T) <= radius + 1e-4
    assert within.sum() == len(there) - before == 20
    apart = np.linalg.norm(there[within][:, None] - there[within][None], axis=2)
    assert apart[~np.eye(20, dtype=bool)].min() > 0.6 / np.sqrt(density) - 1e-4


@pytest.mark.slow
def test_a_cleared_disc_stays_free_and_can_be_taken_back(hand, small):
    first = planting_places()
    hand.begin()
    hand.plant(small.plantings[0], (3.0, 3.0))
    hand.begin()
    assert hand.erase((3.0, 3.0), 100.0) == len(first) + 1
    small.seed += 1
    press("build")
    assert len(planting_places()) == 0
    small.seed -= 1
    assert hand.take_back()
    assert hand.take_back()
    assert not hand.take_back()
    press("build")
    assert planting_places() == pytest.approx(first)


@pytest.mark.medium
def test_one_tree_is_moved_changed_and_removed(hand, small):
    tree = hand.nearest(tuple(planting_places()[0]), 0.1)
    hand.change(tree, place=(-5.0, 12.0))
    press("build")
    assert (-5.0, 12.0) in map(tuple, planting_places().tolist())
    hand.look()
    tree = hand.nearest((-5.0, 12.0), 0.1)
    hand.change(tree, swap_tree)
    press("build")
    hand.look()
    now = hand.nearest((-5.0, 12.0), 0.1)
    assert now.variant == (tree.variant + 1) % 2
    assert (now.rotation, now.scale) == pytest.approx((tree.rotation, tree.scale), abs=1e-4)
    count = len(hand.trees)
    hand.change(now, take_away)
    press("build")
    assert len(planting_places()) == count - 1
    assert len(small.plantings[0].by_hand) == 0


@pytest.mark.medium
@pytest.mark.parametrize(
    ("event", "passes"),
    [({"type": "MOUSEMOVE"}, "PASS_THROUGH"), ({"type": "RIGHT_BRACKET"}, "RUNNING_MODAL")],
)
def test_the_brush_follows_the_mouse_and_its_keys(hand, event, passes):
    drawn = []
    area = SimpleNamespace(tag_redraw=lambda: drawn.append(1))
    brush = SimpleNamespace(
        over=False, stroke="", hand=hand, area=area, _below=lambda *_: Vector((1, 2, 0))
    )
    brush._key = partial(FOREST_OT_plant._key, brush)
    given = {"value": "PRESS", "ctrl": False, "oskey": False, "alt": False} | event
    assert FOREST_OT_plant.heed(brush, bpy.context, SimpleNamespace(**given)) == {passes}
    assert drawn


def test_what_the_brush_has_seen_is_looked_at_again_after_undo(registered, monkeypatch):
    """Undo makes objects anew: to move one that is gone would end Blender."""
    looked = []
    seen = SimpleNamespace(scene=None, look=lambda: looked.append(1))
    brush = SimpleNamespace(hand=seen, moved="a tree")
    monkeypatch.setattr(planting, "_working", brush)
    for name, heard in planting.WINDOW_HANDLERS:
        if name in ("undo_post", "redo_post"):
            heard(bpy.context.scene)
    assert len(looked) == 2
    assert (brush.moved, seen.scene) == (None, bpy.context.scene)


def test_a_brush_that_fails_is_put_away(registered):
    ended = []
    brush = SimpleNamespace(heed=lambda *_: 1 / 0, _end=ended.append)
    with pytest.raises(ZeroDivisionError):
        FOREST_OT_plant.modal(brush, bpy.context, SimpleNamespace())
    assert ended == [bpy.context]


@pytest.mark.medium
def test_the_ground_is_found_below_the_mouse(hand):
    place = ground_below(bpy.context, Vector((1, 2, 9)), Vector((0, 0, -1)))
    assert tuple(place) == pytest.approx((1, 2, 0), abs=1e-5)
    far = ground_below(bpy.context, Vector((900, 2, 9)), Vector((0, 0.6, -0.8)))
    assert far.z == pytest.approx(0, abs=1e-5)
    assert ground_below(bpy.context, Vector((900, 2, 9)), Vector((0, 0, 1))) is None


# ------------------------------------------------------------------------------------------ painting
# The paint button: a canvas over the field, a layer for each planting, and what is painted is planted.


def canvas():
    return bpy.data.objects["Canvas"]


def vertices():
    """(V, 3) of the canvas in the world."""
    bpy.context.view_layer.update()
    obj = canvas()
    local = np.array([vertex.co for vertex in obj.data.vertices])
    return local @ np.array(obj.matrix_world)[:3, :3].T + np.array(obj.matrix_world)[:3, 3]


def weigh(layer, inside):
    """Paint 1 where ``inside`` of the places says so."""
    chosen = np.flatnonzero(inside(vertices()[:, 0], vertices()[:, 1])).tolist()
    canvas().vertex_groups[layer].add(chosen, 1.0, "REPLACE")


@pytest.fixture
def painting(small):
    small.forest.origin = (-2, 1)
    small.forest.size = (20, 10)
    yield small
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def test_the_button_gives_the_brush_and_takes_it_back(painting):
    assert press("paint") == {"FINISHED"}
    assert bpy.context.mode == "PAINT_WEIGHT"
    assert bpy.context.view_layer.objects.active == canvas()
    assert canvas().vertex_groups.active.name == "hazelnut"
    assert painting.plantings[0].painted == "Canvas:hazelnut"
    for leave in (partial(press, "paint"), partial(bpy.ops.object.mode_set, mode="OBJECT")):
        assert canvas().show_in_front
        assert leave() == {"FINISHED"}
        bpy.context.view_layer.update()
        assert bpy.context.mode == "OBJECT"
        assert (canvas().show_in_front, canvas().display_type) == (False, "BOUNDS")
        press("paint")


def test_the_canvas_lies_on_a_terrain_and_beyond_it_at_its_base(painting):
    add_mesh("slope", [(-9, -9, 0), (8, -9, 8.5), (8, 20, 8.5), (-9, 20, 0)], (0, 1, 2, 3))
    painting.forest.terrain.object = "slope"
    press("paint")
    x, _, z = vertices().T
    on = x < 7.9
    assert z[on] == pytest.approx((x[on] + 9) / 2 + LIFT, abs=1e-5)
    assert z[x > 8.1] == pytest.approx(LIFT)


@pytest.mark.slow
def test_what_is_painted_is_planted_there_and_nowhere_else(painting):
    painting.plantings[0].expected = 40
    press("paint")
    weigh("hazelnut", lambda x, _: x > 10)
    press("paint")
    assert bpy.ops.forest.build() == {"FINISHED"}
    x = [obj.location.x for obj in bpy.data.objects if TREE_KEY in obj]
    assert len(x) > 10
    assert min(x) > 10 - 20 / CELLS


def test_neither_sensors_nor_renders_see_the_canvas(painting):
    press("paint")
    press("paint")
    bpy.context.view_layer.update()
    seen = read_scene(bpy.context.evaluated_depsgraph_get())
    assert "Canvas" not in seen.object_name
    assert canvas().hide_render


def test_the_canvas_covers_the_field_at_its_height_and_follows_it(painting):
    painting.forest.terrain.base = 3.0
    press("paint")
    places = vertices()
    assert len(places) == (CELLS + 1) ** 2
    assert places.min(axis=0) == pytest.approx((-2, 1, 3 + LIFT))
    assert places.max(axis=0) == pytest.approx((18, 11, 3 + LIFT))
    weigh("hazelnut", lambda x, _: x > 10)
    press("paint")
    painting.forest.size = (4, 4)
    press("paint")
    assert [t.name for t in bpy.data.objects if t.name.startswith("Canvas")] == ["Canvas"]
    assert len(canvas().vertex_groups) == 1
    assert vertices().max(axis=0)[:2] == pytest.approx((2, 5))
    weights = [bool(vertex.groups) for vertex in canvas().data.vertices]
    assert 0 < sum(weights) < len(weights)


def test_each_planting_has_a_layer_of_its_own(painting):
    press("paint")
    press("paint")
    for species in ("maple", "hazelnut"):
        painting.plantings.add().species = species
        painting.active_plantings += 1
        press("paint")
        press("paint")
    assert [p.painted for p in painting.plantings] == [
        "Canvas:hazelnut",
        "Canvas:maple",
        "Canvas:hazelnut 2",
    ]


@pytest.mark.slow
def test_the_canvas_survives_a_build_and_undo(painting):
    press("paint")
    weigh("hazelnut", lambda x, _: x > 10)
    press("paint")
    bpy.ops.ed.undo_push(message="painted")
    bpy.ops.forest.build()
    bpy.ops.ed.undo_push(message="built")
    assert [home.name for home in canvas().users_collection] == ["Intensity"]
    bpy.ops.ed.undo()
    assert sum(bool(vertex.groups) for vertex in canvas().data.vertices) > 0


def test_an_object_of_the_next_file_that_has_the_name_of_the_canvas_is_left_alone(painting):
    press("paint")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mine = link("Canvas", bpy.data.meshes.new("Canvas"))
    bpy.context.view_layer.update()
    assert mine.display_type == "TEXTURED"


# ---------------------------------------------------------------------------------------------- tree
# Add > Mesh > L-system Tree, as its operator runs.


def add(**settings):
    assert bpy.ops.forest.add_tree(**settings) == {"FINISHED"}
    return from_mesh(bpy.context.active_object.data)


def test_a_tree_stands_at_the_cursor(props):
    bpy.context.scene.cursor.location = (1, 2, 3)
    add(species="hazelnut")
    obj = bpy.context.active_object
    assert tuple(obj.location) == (1, 2, 3)
    assert obj.select_get()
    assert [slot.name for slot in obj.data.materials] == ["hazelnut bark", "hazelnut leaf"]


@pytest.mark.medium
def test_leaves_off_moves_no_branch(props):
    leafy, bare = add(species="maple", seed=4), add(species="maple", seed=4, leaves=False)
    assert np.any(leafy.part == LEAF)
    assert not np.any(bare.part == LEAF)
    wood = leafy.select(leafy.part != LEAF)
    np.testing.assert_array_equal(bare.vertices[bare.triangles], wood.vertices[wood.triangles])


def test_seed_and_generations_change_the_tree(props):
    small = add(species="ginkgo", generations=4)
    assert len(add(species="ginkgo", generations=5).triangles) > len(small.triangles)
    other = add(species="ginkgo", generations=4, seed=2)
    assert not np.array_equal(other.vertices, small.vertices)


@pytest.mark.slow
def test_every_preset_is_offered_and_any_kind_can_be_added(props):
    presets = {path.stem for path in (ROOT / "assets" / "species").glob("*.toml")}
    assert presets <= {item[0] for item in tree.species_items()}
    for species in (
        "whorl-8",
        "abop-monopodial-a",
        "honda-willow",
        "scots-pine",
        "apple-stochastic",
    ):
        assert len(add(species=species).triangles)


def test_it_starts_with_a_leafy_one_and_offers_the_users_too(small):
    bpy.ops.forest.edit_species()
    offered = [item[0] for item in tree.species_items()]
    assert offered[0] == tree.LEAFY
    assert small.plantings[0].species in offered
    assert np.any(add().part == LEAF)
    assert len(add(species=small.plantings[0].species).triangles)


@pytest.mark.medium
def test_a_tree_is_grown_again_from_the_settings_that_it_keeps(props):
    grown = add(species="ginkgo", generations=4, seed=3)
    obj = bpy.context.active_object
    kept = obj.data.forest_grown
    assert (kept.species, kept.seed, kept.generations, kept.leaves) == ("ginkgo", 3, 4, True)
    mine = bpy.data.materials.new("mine")
    obj.data.materials[0] = mine
    obj.modifiers.new("mine", "DISPLACE")
    other = link("other", obj.data)
    meshes, obj.data["plot"] = len(bpy.data.meshes), "B7"
    assert bpy.ops.forest.grow_again() == {"FINISHED"}
    np.testing.assert_array_equal(from_mesh(obj.data).vertices, grown.vertices)
    assert bpy.ops.forest.grow_again(new_seed=True) == {"FINISHED"}
    assert (obj.data.forest_grown.seed, obj.data["plot"]) == (4, "B7")
    assert not np.array_equal(from_mesh(obj.data).vertices, grown.vertices)
    assert obj.data.materials[0] == mine
    assert (other.data, len(obj.modifiers), len(bpy.data.meshes)) == (obj.data, 1, meshes)
    obj.data.forest_grown.species = "hazelnut"
    obj.data.forest_grown.generations = 0
    assert bpy.ops.forest.grow_again() == {"FINISHED"}
    assert obj.data.materials[0].name == "hazelnut bark"


def test_a_tree_of_another_file_is_left_to_that(props, tmp_path):
    add(species="hazelnut")
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {bpy.context.active_object})
    with bpy.data.libraries.load(path, link=True) as (source, target):
        target.objects = source.objects
    bpy.context.scene.collection.objects.link(target.objects[0])
    bpy.context.view_layer.objects.active = target.objects[0]
    with pytest.raises(RuntimeError, match="another file"):
        bpy.ops.forest.grow_again()


def test_a_tree_that_was_saved_is_grown_again(props, tmp_path):
    grown = add(species="ginkgo", generations=4, seed=3)
    reopened(tmp_path / "tree.blend")
    assert bpy.ops.forest.grow_again() == {"FINISHED"}
    again = from_mesh(bpy.context.object.data)
    np.testing.assert_array_equal(again.vertices, grown.vertices)
