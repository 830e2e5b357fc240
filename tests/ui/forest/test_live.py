"""What Live decides; that it hears of changes and runs is shown in the real window (tests/gui)."""

import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import add_collection, add_mesh, reopened

from forest_addon.blender.read import depsgraph as reading
from forest_addon.spec import SpecError
from forest_addon.ui.forest import build


def grid(name, height=0.0):
    """A plane of 3 x 3 vertices over the small field."""
    places = [(x, y, height) for x in (-1, 3, 7) for y in (-1, 3, 7)]
    faces = [(i, i + 3, i + 4, i + 1) for i in (0, 1, 3, 4)]
    return add_mesh(name, places, *faces)


def mark():
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    return build.fingerprint(bpy.context.scene, graph)


def settle(brought=False):
    """What Live would build now."""
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    return build.settle(bpy.context.scene, graph, brought)


def stale():
    return build.is_stale(bpy.context.scene)


@pytest.fixture
def heard(small):
    """The small forest, of whose changes Live is told as it is in a window."""
    bpy.app.handlers.depsgraph_update_post.append(forget := live_forget)
    yield small
    if forget in bpy.app.handlers.depsgraph_update_post:
        bpy.app.handlers.depsgraph_update_post.remove(forget)
    build.unregister()


def live_forget(_scene, graph):
    build._forget_changed(graph)


@pytest.fixture
def built(heard):
    bpy.ops.forest.build()
    heard.live = True
    return heard


@pytest.mark.medium
@pytest.mark.parametrize(
    ("counts", "change"),
    [
        (True, lambda p: setattr(p, "seed", 4)),
        (True, lambda p: setattr(p.forest, "spacing", 0.5)),
        (True, lambda p: setattr(p.plantings[0], "crown", 0.5)),
        (True, lambda p: setattr(p.plantings[0].gaussians.add(), "peak", 2.0)),
        (True, lambda p: setattr(p.forest.terrain, "base", 1.0)),
        (True, lambda p: bpy.ops.forest.edit_species()),
        (False, lambda p: setattr(p, "name", "other")),
        (False, lambda p: setattr(p.air, "humidity", 20)),
        (False, lambda p: setattr(p.plantings[0], "density", 3.0)),  # not in use
        (False, lambda p: setattr(p.plantings[0], "active_gaussians", 3)),
        (False, lambda p: setattr(p, "live", True)),
        (False, lambda p: bpy.ops.forest.add_sensor(kind="sonar")),
        (False, lambda p: grid("unconcerned")),
    ],
)
def test_what_a_forest_is_made_of_and_nothing_else_is_in_the_fingerprint(heard, counts, change):
    before = mark()
    change(heard)
    assert (mark() != before) == counts


def test_an_edited_species_counts_while_it_is_planted(heard):
    bpy.ops.forest.edit_species()
    before = mark()
    heard.edited[0].settings.jitter.length = 0.3
    assert mark() != before


def move(obj):
    obj.location.x += 1


def raise_a_corner(obj):
    obj.data.vertices[4].co.z = 0.5
    obj.data.update()


def thicken(obj):
    obj.modifiers.new("thick", "SOLIDIFY").thickness = 0.2


def weigh(obj, weight=0.7):
    obj.vertex_groups["trees"].add([4], weight, "REPLACE")
    obj.data.update()


def weigh_less(obj):
    weigh(obj, 0.2)


@pytest.mark.parametrize(
    ("terrain", "planting", "changes"),
    [
        ("thing", {}, (move, raise_a_corner, thicken)),
        ("", {"painted": "thing:trees"}, (weigh, weigh_less)),
        ("thing", {"painted": "thing"}, (weigh,)),
        ("", {"layout": "list", "collection": "places"}, (move,)),
    ],
    ids=["terrain", "canvas", "weights of the terrain", "places of trees"],
)
def test_each_change_of_what_it_stands_on_counts(heard, terrain, planting, changes):
    obj = grid("thing")
    obj.vertex_groups.new(name="trees")
    home = add_collection("places")
    home.objects.link(obj)
    heard.forest.terrain.object = terrain
    for name, value in planting.items():
        setattr(heard.plantings[0], name, value)
    found = [mark()]
    for change in changes:
        change(obj)
        found.append(mark())
    assert len(set(found)) == len(found)
    obj.select_set(True)
    assert mark() == found[-1]


def test_what_is_not_there_is_refused_as_a_build_refuses_it(heard):
    heard.plantings[0].painted = "nothing"
    with pytest.raises(SpecError, match=r"plantings\[0\]\.painted.*no object"):
        mark()


def test_an_unread_scene_is_not_read_twice(heard, monkeypatch):
    """Surfaces are read again when Blender reports them changed, and not before."""
    from forest_addon.blender.read import inputs

    ground = grid("hill")
    heard.forest.terrain.object = "hill"
    reads = []
    read = inputs.read_terrain
    monkeypatch.setattr(inputs, "read_terrain", lambda *a: reads.append(a) or read(*a))
    for _ in range(3):
        mark()
    assert len(reads) == 1
    ground.location.z = 2
    mark()
    assert len(reads) == 2


@pytest.mark.slow
def test_a_change_is_shown_and_built_once(built):
    assert settle() == ""
    assert not stale()
    built.seed = 9
    wanted = settle()
    assert wanted
    assert stale()
    build.let_be(bpy.context.scene, wanted)  # it is being built
    assert settle() == ""
    bpy.ops.forest.build()
    assert settle() == ""
    assert not stale()
    assert built.built == wanted


def test_what_failed_or_was_cancelled_waits_for_the_next_change(built):
    built.seed = 9
    build.let_be(bpy.context.scene, settle())
    assert settle() == settle() == ""
    assert stale()
    built.seed = 10
    assert settle()
    built.seed = 3
    assert settle() == ""  # back at what stands
    assert not stale()
    built.seed = 9
    assert settle()


@pytest.mark.medium
def test_settings_that_cannot_be_built_are_stale_and_left(built):
    built.plantings[0].use_expected = False
    assert settle() == ""
    assert stale()
    built.plantings[0].use_expected = True
    assert settle() == ""
    assert not stale()


def test_switched_off_nothing_is_wanted_but_the_star_is_shown(built):
    built.live = False
    built.seed = 9
    assert settle() == ""
    assert stale()
    built.live = True
    assert settle()
    built.built = ""  # as in a file of an older version
    settle()
    assert not stale()


@pytest.mark.slow
def test_undo_is_let_be_and_brings_the_fingerprint_back(built):
    def props():
        return bpy.context.scene.forest_sensing

    def trees():
        things = bpy.context.scene.objects
        return sorted(tuple(t.location) for t in things if reading.TREE_KEY in t)

    bpy.ops.ed.undo_push(message="built")
    first, stood = props().built, trees()
    props().seed = 9
    bpy.ops.ed.undo_push(message="seed")
    second = settle()
    build.let_be(bpy.context.scene, second)
    bpy.ops.forest.build()
    bpy.ops.ed.undo_push(message="build")
    assert props().built == second
    assert trees() != stood
    bpy.ops.ed.undo()
    assert (props().seed, props().built, trees()) == (9, first, stood)
    assert settle(brought=True) == ""
    assert stale()
    bpy.ops.ed.undo()
    assert (props().seed, props().built) == (3, first)
    assert settle(brought=True) == ""
    assert not stale()
    bpy.ops.ed.redo()
    bpy.ops.ed.redo()
    assert settle(brought=True) == ""
    assert not stale()
    assert props().built == second
    props().seed = 11
    assert settle()


def test_what_a_file_brought_is_let_be_in_every_scene(built):
    """Two windows show two scenes: the report of the first says nothing of the second."""
    here, there = bpy.context.scene, bpy.data.scenes.new("there")
    for scene in (here, there):
        scene.forest_sensing.built, scene.forest_sensing.live = "an older forest", True
    build._hear_brought()
    for scene in (here, there):
        with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
            graph = bpy.context.evaluated_depsgraph_get()
            build._hear(scene, graph)
            assert not bpy.app.timers.is_registered(build._settle)
            assert build.settle(scene, graph) == ""


def test_without_a_window_nothing_runs_by_itself(built):
    """Switched on in the background: no handlers, no timer."""
    assert bpy.app.background
    built.seed = 12
    bpy.context.view_layer.update()
    assert not bpy.app.timers.is_registered(build._settle)
    assert build._hear not in bpy.app.handlers.depsgraph_update_post


@pytest.mark.medium
def test_saved_and_opened_the_forest_is_known_to_be_up_to_date(built, tmp_path):
    reopened(tmp_path / "live.blend")
    assert settle(brought=True) == ""
    assert not stale()
    assert bpy.context.scene.forest_sensing.live
