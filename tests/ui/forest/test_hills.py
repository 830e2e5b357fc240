"""Hills and their handles: whatever moves one moves the other, and neither is ever left alone."""

import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Matrix
from references.scenes import keyed, link, reopened

from forest_addon import spec
from forest_addon.blender.scene import layout
from forest_addon.blender.scene.instances import TREE_KEY
from forest_addon.blender.show import intensity
from forest_addon.ui.settings import exchange


def gaussian(peak, centre, width):
    return spec.Gaussian(peak=peak, centre=centre, width=width)


HILLS = (gaussian(2.0, (1.0, 2.0), (3.0, 4.0)), gaussian(1.0, (5.0, 4.0), (1.5, 2.5)))


def update():
    bpy.context.view_layer.update()


def said():
    """Every hill as the settings have it."""
    update()
    return [hill for p in exchange.to_spec(bpy.context.scene, []).plantings for hill in p.gaussians]


def circles():
    """Every handle in the scene."""
    things = bpy.context.scene.objects
    return sorted((t for t in things if intensity.HANDLE_KEY in t), key=lambda t: t.name)


def choose(*things):
    for obj in bpy.context.scene.objects:
        obj.select_set(obj in things)
    bpy.context.view_layer.objects.active = things[0]


@pytest.fixture
def hilly(small):
    """The small forest with two hills and their handles."""
    exchange.fill(small.plantings[0], "gaussians", HILLS)
    small.drag_hills = True
    update()
    return small


@pytest.fixture
def hill(hilly):
    return hilly.plantings[0].gaussians[0]


def test_handles_lie_where_hills_are(hilly):
    assert [obj.name for obj in circles()] == ["Hazelnut hill", "Hazelnut hill.001"]
    for obj, hill in zip(circles(), HILLS, strict=True):
        assert (*obj.location[:2], *obj.scale[:2]) == (*hill.centre, *hill.width)
        assert obj.empty_display_size == 1
        assert [home.name for home in obj.users_collection] == [layout.INTENSITY]
    assert said() == list(HILLS)


def test_switched_off_nothing_stays(hilly):
    before = len(bpy.data.objects)
    hilly.drag_hills = False
    assert circles() == []
    assert len(bpy.data.objects) == before - 2
    assert said() == list(HILLS)


def test_a_handle_that_is_moved_and_scaled_moves_its_hill(hill):
    hill.handle.location, hill.handle.scale = (-2.5, 7.25, 3.0), (0.5, 6.5, 1.0)
    assert said() == [gaussian(2.0, (-2.5, 7.25), (0.5, 6.5)), HILLS[1]]


def test_numbers_that_are_typed_move_the_handle(hill):
    hill.centre, hill.width = (0.1, 0.7), (0.3, 12.3)
    assert (*hill.handle.location[:2], *hill.handle.scale[:2]) == pytest.approx(
        (0.1, 0.7, 0.3, 12.3)
    )
    assert said()[0] == gaussian(2.0, (0.1, 0.7), (0.3, 12.3))


def test_a_mirrored_or_flat_handle_is_a_hill_that_can_be_built(hill):
    hill.handle.scale = (-3.0, 0.0, 1.0)
    assert said()[0].width == (3.0, intensity.LEAST)


def test_a_parent_moves_a_hill_and_numbers_hold_beside_it(hill):
    parent = link("cart")
    parent.matrix_world = Matrix.Translation((10, 0, 0)) @ Matrix.Rotation(1.5707963, 4, "Z")
    hill.handle.parent = parent
    found = said()[0]
    assert found.centre == pytest.approx((8.0, 1.0), abs=1e-5)
    assert found.width == pytest.approx((4.0, 3.0), abs=1e-5)  # a quarter turn
    hill.centre = (2.2, 3.3)
    assert said()[0].centre == (2.2, 3.3)
    assert hill.handle.matrix_world.translation[:2] == pytest.approx((2.2, 3.3), abs=1e-5)


def test_a_keyed_handle_takes_its_hill_along(hill):
    keyed(hill.handle, "location", {1: (0, 2, 0), 11: (5, 2, 0)})
    for frame, x in ((1, 0.0), (11, 5.0), (1, 0.0)):
        bpy.context.scene.frame_set(frame)
        assert hill.centre[0] == pytest.approx(x)


@pytest.mark.parametrize("how", ["exclude", "hide_viewport", "hide_set"])
def test_a_hidden_handle_says_nothing(hill, how):
    home = bpy.context.view_layer.layer_collection.children["Forest"].children["Intensity"]

    def hide(hidden):
        hill.handle.hide_set(hidden) if how == "hide_set" else setattr(home, how, hidden)

    hide(True)
    update()
    hill.centre = (3.0, 3.5)
    assert said()[0].centre == (3.0, 3.5)
    hide(False)
    assert said()[0].centre == (3.0, 3.5)
    hill.handle.location.x = 2.0
    assert said()[0].centre == (2.0, 3.5)


def test_the_list_adds_and_removes_handles(hilly):
    bpy.ops.forest.add_gaussian()
    assert len(circles()) == 3
    assert circles()[-1].location[:2] == (3.0, 3.0)
    hilly.plantings[0].active_gaussians = 0
    bpy.ops.forest.remove_gaussian()
    assert said()[0] == HILLS[1]
    assert len(circles()) == 2
    bpy.ops.forest.remove_planting()
    assert circles() == []


def test_a_scene_file_brings_handles_of_its_own(hilly):
    settings = exchange.to_spec(bpy.context.scene)
    (planting,) = settings.plantings
    one = spec.Planting(species="maple", expected=2.0, gaussians=(HILLS[1],))
    exchange.from_spec(bpy.context.scene, spec.Scene(plantings=(planting, one)))
    assert [t.name for t in circles()] == ["Hazelnut hill", "Hazelnut hill.001", "Maple hill"]
    assert said() == [*HILLS, HILLS[1]]


def test_deleting_a_handle_deletes_its_hill(hilly):
    choose(circles()[0])
    bpy.ops.object.delete()
    assert said() == [HILLS[1]]
    assert len(circles()) == 1
    hilly.drag_hills = False
    hilly.drag_hills = True
    assert said() == [HILLS[1]]
    assert len(circles()) == 1


def test_hills_stay_when_the_whole_collection_is_deleted(hilly):
    bpy.data.collections.remove(layout.root(bpy.context.scene))
    assert said() == list(HILLS)


def test_hills_stay_when_another_such_collection_is_made_later(hilly):
    bpy.data.collections.remove(layout.find_part(bpy.context.scene, layout.INTENSITY))
    assert said() == list(HILLS)
    assert bpy.ops.forest.paint() == {"FINISHED"}
    assert bpy.ops.forest.paint() == {"FINISHED"}
    assert said() == list(HILLS)


def test_a_copied_handle_is_a_new_hill(hilly):
    choose(circles()[0])
    bpy.ops.object.duplicate_move(TRANSFORM_OT_translate={"value": (2, 1, 0)})
    assert said() == [*HILLS, gaussian(2.0, (3.0, 3.0), (3.0, 4.0))]
    assert hilly.plantings[0].active_gaussians == 2
    choose(*circles())
    bpy.ops.object.duplicate()
    assert len(said()) == len(circles()) == 6
    assert len({hill.handle for hill in hilly.plantings[0].gaussians}) == 6


def test_a_renamed_handle_is_still_the_same(hilly):
    circles()[0].name = "clearing"
    update()
    choose(bpy.data.objects["clearing"])
    bpy.ops.object.duplicate()
    assert said() == [*HILLS, HILLS[0]]


def test_list_and_view_choose_the_same(hilly):
    planting = hilly.plantings[0]
    planting.active_gaussians = 1
    assert bpy.context.view_layer.objects.active == planting.gaussians[1].handle
    assert bpy.context.selected_objects == [planting.gaussians[1].handle]
    other = hilly.plantings.add()
    hilly.active_plantings = 1
    update()
    assert hilly.active_plantings == 1  # choosing in the list is not undone by what is active
    choose(planting.gaussians[0].handle)
    update()
    assert (hilly.active_plantings, planting.active_gaussians) == (0, 0)
    assert len(other.gaussians) == 0


def test_undo_and_redo_bring_both_back(hilly):
    def step(change):
        change()
        bpy.ops.ed.undo_push(message="step")

    def first():
        return bpy.context.scene.forest_sensing.plantings[0].gaussians[0]

    step(lambda: None)
    step(lambda: setattr(first().handle, "location", (2, 2, 0)))  # undo is older than the update
    update()
    step(lambda: setattr(first(), "centre", (4, 4)))
    step(lambda: (choose(circles()[0]), bpy.ops.object.delete()))
    assert len(said()) == 1
    expected = [(4.0, 4.0), (2.0, 2.0), (1.0, 2.0)]
    for centre in expected:
        bpy.ops.ed.undo()
        assert said()[0].centre == centre
        assert tuple(first().handle.location[:2]) == centre
        assert len(circles()) == 2
    for centre in [(2.0, 2.0), (4.0, 4.0)]:
        bpy.ops.ed.redo()
        assert said()[0].centre == centre
        assert tuple(first().handle.location[:2]) == centre
    bpy.ops.ed.redo()
    assert said() == [HILLS[1]]


@pytest.mark.medium
def test_a_build_leaves_handles_alone_and_results_do_not_know_them(hilly):
    def built():
        bpy.ops.forest.build()
        return sorted(tuple(t.location) for t in bpy.data.objects if TREE_KEY in t)

    things = circles()
    with_handles = built()
    assert circles() == things
    assert [home.name for home in things[0].users_collection] == [layout.INTENSITY]
    assert [c.name for c in layout.root(bpy.context.scene).children].count(layout.INTENSITY) == 1
    hilly.drag_hills = False
    assert built() == with_handles
    assert len(bpy.data.collections[layout.INTENSITY].objects) == 0


def test_a_saved_file_opens_with_its_handles(hill, tmp_path):
    hill.handle.location.x = 2.5
    before = said()
    reopened(tmp_path / "hills.blend")
    assert said() == before
    circles()[0].location.x = 4.5
    assert said()[0].centre == (4.5, 2.0)


def test_hills_of_a_forest_that_is_shown_in_another_scene_are_left_to_it(hilly):
    here, there = bpy.context.scene, bpy.data.scenes.new("there")
    layout.part(there, layout.TREES)  # a forest of its own
    there.collection.children.link(layout.root(here))
    exchange.fill(there.forest_sensing.plantings.add(), "gaussians", HILLS[:1])
    there.forest_sensing.drag_hills = True
    assert len(circles()) == 2  # in the scene here
    assert layout.find_part(there, layout.INTENSITY) != layout.find_part(here, layout.INTENSITY)
    there.forest_sensing.drag_hills = False
    assert len(circles()) == 2
