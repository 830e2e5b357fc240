"""Trees in the wind in views and renders: geometry nodes put each tree's pieces where the wind has them.

The trees of a variant share its pieces, which are objects in the hidden collection *Wind*. Each tree has a
modifier that shows pieces in place of its mesh, each moved by one affine map: that of rest, plus the sum over
modes of a map times the amplitude of the moment; one object there has these for all trees. Amplitudes stand
in a table, one row for a tree and a knot of time, between which they go straight as they do for sensors.
Trees that are points have one modifier together (``wind_points``).
Nodes read the frame: no handler, and a render farm without the add-on shows the same. Whoever measures sees
trees at rest (``nodes.in_full``), and moves them by the same pieces and amplitudes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import bpy
import numpy as np

from ..scene.layout import (
    MADE_KEY,
    POINTS_ROLE,
    ROLE_KEY,
    TREES,
    all_or_nothing,
    find_part,
    is_ours,
    make_collection,
    make_object,
    objects_in,
    root,
)
from ..scene.nodes import VIEW_KEY, instancer_of, set_input
from ..scene.standings import TREE_KEY
from .wind_nodes import (
    FIRST,
    KNOT,
    KNOTS,
    LAST,
    NUMBER,
    PIECE,
    PIECES,
    SHAPES,
    TABLE,
    TREE,
    moving_group,
    showing_group,
)
from .wind_pieces import (
    SwayingTrees,
    WindClock,
    WindShown,
    amplitudes_of,
    pieces_mesh,
    pieces_of,
    table_of,
)
from .wind_points import forget_points, show_on_points

HOME = "Wind"
MOST, MOST_POINTS = 1000, 5000  # trees that are objects, and points
SPARE = 1.0  # s after the last frame that the table still has, for motion blur
MOST_SECONDS = 600.0  # that a table may have


def show_wind(
    scene: bpy.types.Scene,
    sway: SwayingTrees,
    knots: int,
    amplitudes: Mapping[int, np.ndarray] | None = None,
) -> WindShown:
    """Let the trees of a scene sway in views and renders, over its range of frames.

    knots : of the sway, a second. amplitudes : of all trees at ``knots_of`` knots, where they were computed
    ahead.

    Raises
    ------
    ValueError : see ``knots_of``.
    """
    count = knots_of(scene, knots)
    instancer, found = _trees(scene)
    rate = scene.render.fps / scene.render.fps_base
    if amplitudes is None or any(len(one) != count for one in amplitudes.values()):
        amplitudes = amplitudes_of(sway, count)
    hide_wind(scene)
    clock = WindClock(scene.frame_start, knots / rate, count, amplitudes)
    with all_or_nothing():
        top = make_collection(HOME, root(scene) or scene.collection)
        top.hide_viewport = top.hide_render = True
        if instancer is not None:
            made = show_on_points(scene, instancer, sway, clock, top, HOME)
        else:
            made = _show_on_objects(found, sway, clock, top)
    return replace(made, seconds=(scene.frame_end - scene.frame_start) / rate)


def knots_of(scene: bpy.types.Scene, knots: int) -> int:
    """Return how many knots of time a scene's range of frames needs; knots : a second.

    Raises
    ------
    ValueError : there are none or too many trees, or the range of frames is too long.
    """
    instancer, found = _trees(scene)
    points = 0 if instancer is None else len(instancer.id_data.data.vertices)
    if not found and not points:
        raise ValueError("no trees stand here: grow a forest first")
    if len(found) > MOST:
        raise ValueError(
            f"wind is shown on at most {MOST:,} trees that are objects, and here are {len(found):,}: set "
            "Instancing to Points and grow the forest"
        )
    if points > MOST_POINTS:
        raise ValueError(f"wind is shown on at most {MOST_POINTS:,} trees, and here are {points:,}")
    seconds = (scene.frame_end - scene.frame_start) * scene.render.fps_base / scene.render.fps
    if seconds > MOST_SECONDS:
        raise ValueError(
            f"frames last {seconds:.0f} s; wind is shown for at most {MOST_SECONDS:.0f} s"
        )
    return int(np.ceil((seconds + SPARE) * knots)) + 2


def _trees(
    scene: bpy.types.Scene,
) -> tuple[bpy.types.Modifier | None, list[bpy.types.Object]]:
    """The modifier that puts trees on points, if they are points, and those that are objects."""
    home = find_part(scene, TREES)
    things = objects_in(home) if home else []
    points = next((thing for thing in things if thing.get(ROLE_KEY) == POINTS_ROLE), None)
    return instancer_of(points), [thing for thing in things if TREE_KEY in thing]


def _show_on_objects(
    found: Sequence[bpy.types.Object],
    sway: SwayingTrees,
    clock: WindClock,
    top: bpy.types.Collection,
) -> WindShown:
    """Let trees sway that are objects."""
    rows = [sway.number.get(int(thing[TREE_KEY]), -1) for thing in found]
    moving = [
        (thing, row) for thing, row in zip(found, rows, strict=True) if row in clock.amplitudes
    ]
    table = table_of(clock.amplitudes, [row for _, row in moving], clock.count)
    given = {TABLE: make_object("Wind Table", table, top)}
    kinds: dict[tuple[str, tuple[int, int]], tuple[bpy.types.Collection, np.ndarray]] = {}
    shapes: list[bpy.types.Collection] = []
    maps: list[np.ndarray] = []
    for thing, row in moving:
        key = thing.data.name, sway.variant(row)
        if key not in kinds:
            home = make_collection(f"Wind {'.'.join(map(str, key[1]))}", top)
            made = pieces_of(sway, row, sway.rest(row), list(thing.data.materials), home)
            kinds[key] = home, made
        shapes.append(kinds[key][0])
        maps.append(kinds[key][1])
    size = np.array([len(one) for one in maps], np.int64)
    tree = np.repeat(np.arange(len(maps)), size)
    piece = np.arange(len(tree)) - np.repeat(np.cumsum(size) - size, size)
    told = {TREE: tree, PIECE: piece, KNOTS: tree * clock.count}
    data = pieces_mesh(np.concatenate(maps) if maps else np.zeros((0, 12, 3, 4)), told)
    pieces = make_object("Wind Pieces", data, top)
    modifier = pieces.modifiers.new(HOME, "NODES")
    modifier.node_group = moving_group()
    times = {LAST: clock.count - 2, FIRST: clock.first, KNOT: clock.knots}
    for name, value in (given | times).items():
        set_input(modifier, name, value)
    for place, (thing, _) in enumerate(moving):
        modifier = thing.modifiers.new(HOME, "NODES")
        modifier.node_group = showing_group(HOME)
        for name, value in {PIECES: pieces, SHAPES: shapes[place], NUMBER: place}.items():
            set_input(modifier, name, value)
    return WindShown(len(moving), len(found) - len(moving), len(tree), 0.0)


def hide_wind(scene: bpy.types.Scene) -> None:
    """Let trees stand at rest again; what was made to show wind goes."""
    for thing in scene.objects:
        for modifier in [m for m in thing.modifiers if is_wind(m)]:
            thing.modifiers.remove(modifier)
            if thing.get(ROLE_KEY) == POINTS_ROLE:
                forget_points(thing.data)
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
    """The collection of what was made to show wind, None where it is not shown."""
    above = root(scene) or scene.collection
    return next(
        (c for c in above.children if c.get(MADE_KEY) == HOME and is_ours(c)), None
    ) or next((c for c in above.children if str(c.get(MADE_KEY, "")).startswith(f"{HOME}.")), None)
