"""Trees in the wind that are points of one object: stand-ins sway in views that show those, dots do not.

A modifier after the one that puts trees on points takes away those that sway and puts their pieces there.
How modes move a piece is kept once for all trees of a variant; each tree says in attributes of its point
where that begins, and where its amplitudes do.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...base.trimesh import TriMesh
from ..scene.instances import natural
from ..scene.layout import OUTLINES, VARIANTS, find_part, make_collection, make_object
from ..scene.meshes import from_mesh
from ..scene.nodes import VARIANT, set_input, show_as, shown_of
from ..scene.standings import TREE_KEY
from .wind_nodes import (
    FIRST,
    FULL,
    KNOT,
    KNOTS,
    LAST,
    LIGHT,
    OF_FULL,
    OF_LIGHT,
    PIECES,
    ROW,
    SHAPES,
    TABLE,
    many_group,
)
from .wind_pieces import (
    SwayingTrees,
    WindClock,
    WindShown,
    give_numbers,
    pieces_mesh,
    pieces_of,
    table_of,
)

OWN = (ROW, KNOTS, *OF_FULL, *OF_LIGHT)  # attributes of points


def show_on_points(
    scene: bpy.types.Scene,
    instancer: bpy.types.Modifier,
    sway: SwayingTrees,
    clock: WindClock,
    top: bpy.types.Collection,
    key: str,
) -> WindShown:
    """Let the trees of an instancer sway. top : where what is made for that goes. key : mark of the
    modifier."""
    thing, number = instancer.id_data, sway.number
    tree, kind = (_numbers(thing.data, name) for name in (TREE_KEY, VARIANT))
    row_of = [number.get(one, -1) for one in tree.tolist()]
    moving = [k for k, row in enumerate(row_of) if row in clock.amplitudes]
    rows = [row_of[k] for k in moving]
    told = {name: np.zeros(len(tree), np.int64) for name in OWN}
    told[ROW][moving] = 1 + np.arange(len(moving))
    told[KNOTS][moving] = clock.count * np.arange(len(moving))
    given = {TABLE: make_object("Wind Table", table_of(clock.amplitudes, rows, clock.count), top)}
    used, sample = np.unique(kind[moving], return_index=True)
    for what, names, part in ((FULL, OF_FULL, VARIANTS), (LIGHT, OF_LIGHT, OUTLINES)):
        home, maps = make_collection(f"Wind {what}", top), []
        for one, first in zip(used.tolist(), sample.tolist(), strict=True):
            block, row = _library(scene, part)[one], rows[first]
            mesh = _rest(block, sway, row, part)
            begin = len(home.objects)
            maps.append(pieces_of(sway, row, mesh, _coats(scene, block, one), home))
            mine = np.array(moving)[kind[moving] == one]
            told[names[0]][mine], told[names[1]][mine] = begin, len(home.objects) - begin
        all_maps = np.concatenate(maps) if maps else np.zeros((0, 12, 3, 4))
        given[f"{PIECES} {what}"] = make_object(
            f"Wind Pieces {what}", pieces_mesh(all_maps, {}), top
        )
        given[f"{SHAPES} {what}"] = home
    for name, values in told.items():
        give_numbers(thing.data, name, values)
    modifier = thing.modifiers.new(key, "NODES")
    modifier.node_group = many_group(key)
    times = {LAST: clock.count - 2, FIRST: clock.first, KNOT: clock.knots}
    for name, value in (given | times).items():
        set_input(modifier, name, value)
    show_as(instancer, shown_of(instancer))
    many = int(told[OF_FULL[1]].sum())
    return WindShown(len(moving), len(tree) - len(moving), many, 0.0)


def forget_points(data: bpy.types.Mesh) -> None:
    """Take from points what they were told of wind."""
    for name in OWN:
        attribute = data.attributes.get(name)
        if attribute is not None:
            data.attributes.remove(attribute)


def _library(scene: bpy.types.Scene, part: str) -> list[bpy.types.ID]:
    """Variants or stand-ins by their number."""
    home = find_part(scene, part)
    blocks = (*home.objects, *home.children) if home is not None else ()
    return sorted(blocks, key=lambda block: natural(block.name))


def _rest(block: bpy.types.ID, sway: SwayingTrees, row: int, part: str) -> TriMesh:
    """The mesh of a variant; of a stand-in the one that stands for it, where it is one mesh."""
    stands = part == OUTLINES and isinstance(block, bpy.types.Object) and block.type == "MESH"
    mesh = from_mesh(block.data) if stands else sway.rest(row)
    return mesh if len(mesh.triangles) else sway.rest(row)


def _coats(
    scene: bpy.types.Scene, block: bpy.types.ID, one: int
) -> list[bpy.types.Material | None]:
    own = block if isinstance(block, bpy.types.Object) else _library(scene, VARIANTS)[one]
    return list(own.data.materials) if isinstance(own, bpy.types.Object) and own.data else []


def _numbers(data: bpy.types.Mesh, name: str) -> np.ndarray:
    """(N,) whole numbers of points; -1 where they have none of this name."""
    values = np.full(len(data.vertices), -1, np.int32)
    attribute = data.attributes.get(name)
    if attribute is not None and attribute.data_type == "INT" and len(values):
        attribute.data.foreach_get("value", values)
    return values
