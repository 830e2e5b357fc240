"""Trees in the wind in views and renders: geometry nodes put each tree's pieces where the wind has them.

The trees of a variant share its pieces, which are objects in the hidden collection *Wind*. Each tree has a
modifier that shows pieces in place of its mesh, each moved by one affine map: that of rest, plus the sum over
modes of a map times the amplitude of the moment; one object there has these for all trees. Amplitudes stand
in a table, one row for a tree and a knot of time, between which they go straight as they do for sensors.
Nodes read the frame: no handler, and a render farm without the add-on shows the same. Whoever measures sees
trees at rest (``nodes.in_full``), and moves them by the same pieces and amplitudes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import bpy
import numpy as np

from ...base.trimesh import TriMesh
from ...sensing.rays.pieces import parted
from ..scene.layout import TREES, find_part, objects_in, root
from ..scene.meshes import to_mesh
from ..scene.nodes import VIEW_KEY, set_input
from ..scene.ours import MADE_KEY, all_or_nothing, is_ours, make_collection, make_object
from ..scene.standings import TREE_KEY
from .wind_nodes import (
    COLUMNS,
    FIRST,
    KNOT,
    KNOTS,
    LAST,
    MODES,
    NUMBER,
    PIECE,
    PIECES,
    SHAPES,
    TABLE,
    TREE,
    amplitude_name,
    basis_name,
    moving_group,
    showing_group,
)

if TYPE_CHECKING:
    from ...growth.sway.rig import SwayRig  # brings in scipy, and panels are drawn with this module

HOME = "Wind"
MOST = 1000  # trees
SPARE = 1.0  # s after the last frame that the table still has, for motion blur
MOST_SECONDS = 600.0  # that a table may have


class SwayingTrees(Protocol):
    """The sway of a stand, as ``stand.wind.sway`` has it."""

    @property
    def number(self) -> dict[int, int]: ...

    def rig(self, tree: int) -> SwayRig | None: ...

    def amplitudes(self, tree: int, knot: np.ndarray) -> np.ndarray: ...

    def rest(self, tree: int) -> TriMesh: ...

    def variant(self, tree: int) -> tuple[int, int]: ...

    def pieces(self, tree: int, mesh: TriMesh) -> np.ndarray: ...


@dataclass(frozen=True)
class WindShown:
    """Numbers of what was made: trees that sway, trees that stand still, pieces of all, seconds of wind."""

    trees: int
    still: int
    pieces: int
    seconds: float


def show_wind(scene: bpy.types.Scene, sway: SwayingTrees, knots: int) -> WindShown:
    """Let the trees of a scene sway in views and renders, over its range of frames.

    knots : of the sway, a second.

    Raises
    ------
    ValueError : the trees are points of one object, or too many, or the range of frames is too long.
    """
    number = sway.number
    home = find_part(scene, TREES)
    found = [thing for thing in objects_in(home) if TREE_KEY in thing] if home else []
    if not found:
        raise ValueError(
            "wind is shown on trees that are objects: set Trees As to Objects and grow the forest"
        )
    if len(found) > MOST:
        raise ValueError(f"wind is shown on at most {MOST} trees; here are {len(found)}")
    rate = scene.render.fps / scene.render.fps_base
    seconds = (scene.frame_end - scene.frame_start) / rate
    if seconds > MOST_SECONDS:
        raise ValueError(
            f"frames last {seconds:.0f} s; wind is shown for at most {MOST_SECONDS:.0f} s"
        )
    hide_wind(scene)
    rows = [number.get(int(thing[TREE_KEY]), -1) for thing in found]
    moving = [
        (thing, row)
        for thing, row in zip(found, rows, strict=True)
        if row >= 0 and sway.rig(row) is not None
    ]
    count = int(np.ceil((seconds + SPARE) * knots)) + 2
    with all_or_nothing():
        top = make_collection(HOME, root(scene) or scene.collection)
        top.hide_viewport = top.hide_render = True
        rows = [row for _, row in moving]
        table = make_object("Wind Table", _table(sway, rows, count), top)
        kinds: dict[tuple[str, tuple[int, int]], _Shapes] = {}
        shapes: list[_Shapes] = []
        for thing, row in moving:
            key = thing.data.name, sway.variant(row)
            if key not in kinds:
                kinds[key] = _shapes(sway, row, thing.data.materials, top)
            shapes.append(kinds[key])
        pieces = make_object("Wind Pieces", _points(shapes, count), top)
        modifier = pieces.modifiers.new(HOME, "NODES")
        modifier.node_group = moving_group()
        clock = {TABLE: table, LAST: count - 2, FIRST: scene.frame_start, KNOT: knots / rate}
        for name, value in clock.items():
            set_input(modifier, name, value)
        for place, (thing, _) in enumerate(moving):
            modifier = thing.modifiers.new(HOME, "NODES")
            modifier.node_group = showing_group(HOME)
            own = {PIECES: pieces, SHAPES: shapes[place].home, NUMBER: place}
            for name, value in own.items():
                set_input(modifier, name, value)
    many = len(pieces.data.vertices)
    return WindShown(len(moving), len(found) - len(moving), many, seconds)


def hide_wind(scene: bpy.types.Scene) -> None:
    """Let trees stand at rest again; what was made to show wind goes."""
    for thing in scene.objects:
        for modifier in [m for m in thing.modifiers if is_wind(m)]:
            thing.modifiers.remove(modifier)
    top = _home(scene)
    if top is None:
        return
    things = objects_in(top)
    data = {thing.data for thing in things}
    homes = [*top.children, top]
    bpy.data.batch_remove(things)
    bpy.data.batch_remove(list(data))
    bpy.data.batch_remove(homes)


def shows_wind(scene: bpy.types.Scene) -> bool:
    """Return whether trees of a scene sway in views."""
    return _home(scene) is not None


def is_wind(modifier: bpy.types.Modifier) -> bool:
    """Return whether a modifier shows a tree in the wind."""
    group = modifier.node_group if modifier.type == "NODES" else None
    return group is not None and group.get(VIEW_KEY) == HOME


def _home(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    above = root(scene) or scene.collection
    return next(
        (c for c in above.children if c.get(MADE_KEY) == HOME and is_ours(c)), None
    ) or next((c for c in above.children if str(c.get(MADE_KEY, "")).startswith(f"{HOME}.")), None)


def _table(sway: SwayingTrees, rows: Sequence[int], count: int) -> bpy.types.Mesh:
    """Amplitudes of every tree at every knot: a vertex for each, trees one after another."""
    data = bpy.data.meshes.new("Wind Table")
    data.vertices.add(len(rows) * count)
    knot = np.arange(count)
    values = np.zeros((len(rows), count, MODES), np.float32)
    for place, row in enumerate(rows):
        own = sway.amplitudes(row, knot)
        values[place, :, : own.shape[1]] = own
    for first in range(0, MODES, 3):
        made = data.attributes.new(amplitude_name(first), "FLOAT_VECTOR", "POINT")
        made.data.foreach_set(
            "vector", np.ascontiguousarray(values[..., first : first + 3]).ravel()
        )
    return data


@dataclass(frozen=True)
class _Shapes:
    """The pieces of a variant: a collection of their meshes, and (P, MODES, 3, 4) how modes move each."""

    home: bpy.types.Collection
    maps: np.ndarray


def _shapes(
    sway: SwayingTrees,
    row: int,
    coats: Sequence[bpy.types.Material | None],
    top: bpy.types.Collection,
) -> _Shapes:
    rig, mesh = sway.rig(row), sway.rest(row)
    assert rig is not None
    name = f"Wind {'.'.join(map(str, sway.variant(row)))}"
    home = make_collection(name, top)
    parts = parted(mesh, sway.pieces(row, mesh))
    for place, (_, part) in enumerate(parts):
        shape = to_mesh(f"{name} {place:03d}", part)
        for coat in coats:
            shape.materials.append(coat)
        make_object(shape.name, shape, home)
    own = np.array([piece for piece, _ in parts], np.int64)
    maps = np.zeros((len(own), MODES, 3, COLUMNS), np.float32)
    maps[:, : rig.maps.shape[1]] = rig.maps[own]
    return _Shapes(home, maps)


def _points(shapes: Sequence[_Shapes], count: int) -> bpy.types.Mesh:
    """A point for every piece of every tree; count : rows of the table for each."""
    data = bpy.data.meshes.new("Wind Pieces")
    size = np.array([len(one.maps) for one in shapes], np.int64)
    tree = np.repeat(np.arange(len(shapes)), size)
    data.vertices.add(len(tree))
    piece = np.arange(len(tree)) - np.repeat(np.cumsum(size) - size, size)
    for name, numbers in ((TREE, tree), (PIECE, piece), (KNOTS, tree * count)):
        made = data.attributes.new(name, "INT", "POINT")
        made.data.foreach_set("value", numbers.astype(np.int32))
    maps = np.concatenate([one.maps for one in shapes] or [np.zeros((0, MODES, 3, COLUMNS))])
    for mode in range(MODES):
        for column in range(COLUMNS):
            made = data.attributes.new(basis_name(mode, column), "FLOAT_VECTOR", "POINT")
            values = np.ascontiguousarray(maps[:, mode, :, column], dtype=np.float32)
            made.data.foreach_set("vector", values.ravel())
    return data
