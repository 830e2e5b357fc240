"""Trees in the wind in views and renders: held to the motion that sensors meet, and gone without a trace."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.blender.files.export import bake
from forest_addon.blender.scene import layout
from forest_addon.blender.scene.instances import TREE_KEY
from forest_addon.blender.scene.meshes import from_mesh
from forest_addon.blender.scene.nodes import show_as
from forest_addon.blender.show.wind import hide_wind, is_wind, show_wind, shows_wind
from forest_addon.sensing.moving import split_pieces
from forest_addon.stand.wind import KNOTS, sway_of
from forest_addon.ui.forest.wind import forest_of_points

STAND = forest.Scene(
    seed=6,
    forest=forest.Forest(size=(16.0, 16.0)),
    plantings=(
        forest.Planting(species="scots-pine", expected=3.0, variants=1, scale=(0.8, 1.2)),
        forest.Planting(species="whorl-8", expected=3.0, variants=1),
    ),
    wind=forest.Wind(speed=9.0, direction_deg=30.0),
    accuracy=forest.Accuracy(audit=0.0),
)
SCAN = forest.Terrestrial(
    position=(0, 0, 1.5),
    angle_step_deg=6.0,
    elevation_deg=(-10, 60),
    pulse_rate=3000.0,
    max_range=60.0,
)


@cache
def grown(scene):
    return forest.Site.of(scene).grow(None)


def windy(scene=STAND):
    world = forest.Site.of(scene).build(grown(scene), as_assets=False, looks=False)
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


def pieces_drawn(place):
    """How many triangles of pieces a view draws."""
    found = 0
    for one in bpy.context.evaluated_depsgraph_get().object_instances:
        if one.is_instance and one.object.type == "MESH":
            found += len(one.object.data.polygons)
    return found


@pytest.mark.slow
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
@pytest.mark.parametrize("trees", ["objects", "points"])
def test_sensors_see_the_same_with_and_without_the_view(trees):
    place, world, sway = windy(*([POINTS] * (trees == "points")))
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


POINTS = STAND.changed(
    forest=forest.Forest(size=(16.0, 16.0), instancing="points"), plantings=STAND.plantings[1:]
)


def told(place, world, sway, shape):
    """Corners of the pieces of all trees at the frame of a scene, as sensors meet them; shape : gives the
    mesh of a tree, by its row in the stand."""
    knot = np.array([(place.frame_current - 1) / place.render.fps * KNOTS])
    assert knot == np.floor(knot)
    found = []
    for row, stands in enumerate(world.forest.transforms()):
        maps = sway.places(row, knot)[0]
        mesh = shape(row)
        for piece, rows in split_pieces(mesh, sway.pieces(row, mesh)):
            part = mesh.select(rows)
            moved = part.vertices @ maps[piece, :, :3].T + maps[piece, :, 3]
            found.append(moved @ stands[:, :3].T + stands[:, 3])
    return np.concatenate(found)


def shown(place):
    """Corners of what a view shows of trees that are points."""
    obj = next(t for t in bpy.data.objects if any(is_wind(m) for m in t.modifiers))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    found = [from_mesh(obj.evaluated_get(depsgraph).data).vertices]
    for one in depsgraph.object_instances:
        if one.parent is not None and one.parent.original == obj and one.object.type == "MESH":
            at = np.array(one.matrix_world, dtype=np.float64)
            found.append(from_mesh(one.object.data).vertices @ at[:3, :3].T + at[:3, 3])
    return np.concatenate(found)


@pytest.mark.medium
@pytest.mark.parametrize("display", [pytest.param("FULL", marks=pytest.mark.slow), "LIGHT", "DOTS"])
def test_trees_that_are_points_sway_as_they_are_displayed(display):
    """Full trees and stand-ins are where sensors meet their pieces; dots stand still."""
    place, world, sway = windy(POINTS)
    instancer = forest_of_points(place)
    show_as(instancer, display)
    made = show_wind(place, sway, KNOTS)
    assert made.trees == len(sway.number)
    place.frame_set(13)  # at a knot
    if display == "DOTS":
        assert not len(shown(place))
        return
    outlines = sorted(layout.part(place, layout.OUTLINES).objects, key=lambda obj: obj.name)
    number = {key: k for k, key in enumerate(world.forest.variants)}
    light = {key: from_mesh(outlines[k].data) for key, k in number.items()}
    shape = sway.rest if display == "FULL" else lambda row: light[sway.variant(row)]
    there, wanted = shown(place), told(place, world, sway, shape)
    assert there.shape == wanted.shape
    # As sets of places: in any order, each has one of the other within rounding.
    off = max(cKDTree(a).query(b)[0].max() for a, b in ((there, wanted), (wanted, there)))
    assert off < 2e-5
    place.frame_set(1)
    assert cKDTree(shown(place)).query(wanted)[0].max() > 0.02
    show_as(instancer, "DOTS")
    assert not len(shown(place))
    hide_wind(place)
    assert not [one for one in instancer.id_data.data.attributes if "wind" in one.name]


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".usdc", ".abc"])
def test_a_baked_file_moves_as_the_view_does(tmp_path, ending):
    """Read back by Blender's importer (Alembic) or by pxr (USD): every piece's place and triangles."""
    place, _, sway = windy(STAND.changed(plantings=STAND.plantings[1:]))
    place.frame_end = 4
    show_wind(place, sway, KNOTS)
    path = tmp_path / f"wind{ending}"
    bake(place, path)
    assert path.is_file()
    places, size = {}, pieces_drawn(place)
    assert size > 10_000
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
        meshes = [obj for obj in things if obj.type == "MESH"]
        written = sum(len(obj.data.polygons) for obj in meshes)
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
        prims = [UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
        written = sum(len(mesh.GetFaceVertexCountsAttr().Get() or ()) for mesh in prims)
    assert size <= written < 1.1 * size  # the ground, and the trees' own points
    for frame, told in places.items():
        got = np.sort(np.array(back[frame]))
        assert len(got) >= len(told)
        off = np.abs(got[:, None] - told).min(axis=0)
        assert off.max() < 1e-3
    assert np.abs(places[1] - places[4]).max() > 1e-3
