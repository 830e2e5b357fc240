"""Trees that are moved, locked, swapped or removed by hand stay so when the forest is grown again."""

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import press, trees

from forest_addon.blender.scene.layout import VARIANTS, part
from forest_addon.site import ForestSite
from forest_addon.ui.forest import planting
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
    for thing in things:
        thing.select_set(True)
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


def test_without_a_tree_that_is_selected_the_buttons_say_so(grove):
    bpy.ops.object.select_all(action="DESELECT")
    with pytest.raises(RuntimeError, match="Select trees of the forest"):
        press("lock_trees")


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
    for thing in (copy, beside, mine):
        bpy.context.scene.collection.objects.link(thing)
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
