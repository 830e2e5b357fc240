"""Trees in the wind in views and renders: held to the motion that sensors meet, and gone without a trace."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.blender.files.baked import bake
from forest_addon.blender.scene.standings import TREE_KEY
from forest_addon.blender.show.wind import hide_wind, show_wind, shows_wind
from forest_addon.stand.wind.response import KNOTS
from forest_addon.stand.wind.sway import sway_of

STAND = forest.Scene(
    seed=6,
    forest=forest.Forest(size=(16.0, 16.0)),
    plantings=(
        forest.Planting(species="scots-pine", expected=3.0, variants=1, scale=(0.8, 1.2)),
        forest.Planting(species="maple", expected=3.0, variants=1),
    ),
    wind=forest.Wind(speed=9.0, direction_deg=30.0),
)
SCAN = forest.Terrestrial(
    position=(0, 0, 1.5),
    angle_step_deg=3.0,
    elevation_deg=(-10, 60),
    pulse_rate=3000.0,
    max_range=60.0,
)


def windy(scene=STAND):
    world = forest.build(scene)
    place = bpy.context.scene
    place.frame_start, place.frame_end = 1, 30
    place.frame_set(1)
    return place, world, sway_of(world.forest, scene.wind, scene.seed)


def seen(place):
    """Where the depsgraph has the pieces of each tree, by the tree's number."""
    found = {}
    for one in bpy.context.evaluated_depsgraph_get().object_instances:
        if one.is_instance and one.parent is not None and TREE_KEY in one.parent.original:
            number = one.parent.original[TREE_KEY]
            found.setdefault(number, []).append(np.array(one.matrix_world, dtype=np.float64))
    return found


def test_pieces_are_where_sensors_meet_them():
    """At frames and between them, against the maps that rays are cast at, in float64."""
    place, _, sway = windy()
    made = show_wind(place, sway, KNOTS)
    assert made.trees == len(sway.number)
    things = {t[TREE_KEY]: t for t in bpy.data.objects if TREE_KEY in t}
    moved = 0.0
    for frame, part in ((1, 0.0), (12, 0.37), (29, 0.5)):
        place.frame_set(frame, subframe=part)
        found = seen(place)
        assert sorted(found) == sorted(sway.number)
        knot = (frame + part - 1) / place.render.fps * KNOTS
        for number, pieces in found.items():
            low, high = sway.places(sway.number[number], np.floor(knot) + np.array([0.0, 1.0]))
            local = low + (knot - np.floor(knot)) * (high - low)
            stands = np.array(things[number].matrix_world, dtype=np.float64)
            told = np.stack([stands @ np.vstack([one, [0, 0, 0, 1]]) for one in local])
            rounded = 1e-6 * max(10.0, np.abs(told).max())  # single precision
            assert np.abs(np.stack(pieces) - told).max() < rounded
            moved = max(moved, np.abs(told - stands).max())
    assert moved > 0.05


@pytest.mark.slow
def test_sensors_see_the_same_with_and_without_the_view():
    place, world, sway = windy()
    before = world.scan(SCAN)
    show_wind(place, sway, KNOTS)
    assert np.array_equal(world.scan(SCAN).points, before.points)


@pytest.mark.slow
def test_it_goes_without_a_trace():
    place, _, sway = windy()
    kinds = (bpy.data.objects, bpy.data.meshes, bpy.data.collections)
    before = [sorted(block.name for block in kind) for kind in kinds]
    show_wind(place, sway, KNOTS)
    assert shows_wind(place)
    show_wind(place, sway, KNOTS)
    hide_wind(place)
    assert [sorted(block.name for block in kind) for kind in kinds] == before
    assert not shows_wind(place)
    assert not seen(place)


def test_a_forest_of_points_is_refused():
    points = STAND.changed(forest=forest.Forest(size=(16.0, 16.0), instancing="points"))
    place, _, sway = windy(points)
    with pytest.raises(ValueError, match="Objects"):
        show_wind(place, sway, KNOTS)
    assert not shows_wind(place)


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".usdc", ".abc"])
def test_a_baked_file_moves_as_the_view_does(tmp_path, ending):
    """Read back by Blender's importer (Alembic) or by pxr (USD)."""
    place, _, sway = windy()
    place.frame_end = 4
    show_wind(place, sway, KNOTS)
    path = tmp_path / f"wind{ending}"
    bake(place, path)
    assert path.is_file()
    places = {}
    for frame in (1, 4):
        place.frame_set(frame)
        every = [m for pieces in seen(place).values() for m in pieces]
        places[frame] = np.sort(np.stack(every)[:, 0, 3])
    back = {1: [], 4: []}
    if ending == ".abc":
        bpy.ops.wm.read_homefile(use_empty=True)
        bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False)
        for frame in back:
            bpy.context.scene.frame_set(frame)
            things = bpy.context.evaluated_depsgraph_get().objects
            back[frame] = [t.matrix_world[0][3] for t in things if t.type == "MESH"]
    else:
        pxr = pytest.importorskip("pxr")
        from pxr import Usd, UsdGeom  # noqa: F401

        stage = pxr.Usd.Stage.Open(str(path))
        for frame in back:
            cache = pxr.UsdGeom.XformCache(frame)
            back[frame] = [
                cache.GetLocalToWorldTransform(prim)[3][0]
                for prim in stage.Traverse()
                if prim.IsInstance() or prim.IsA(pxr.UsdGeom.Mesh)
            ]
    for frame, told in places.items():
        got = np.sort(np.array(back[frame]))
        assert len(got) >= len(told)
        off = np.abs(got[:, None] - told).min(axis=0)
        assert off.max() < 1e-3
    assert np.abs(places[1] - places[4]).max() > 1e-3
