"""Trees in the wind in views and renders: geometry nodes put each tree's pieces where the wind has them.

The trees of a variant share its pieces, which are objects in the hidden collection *Wind*. Each tree has
a modifier that shows pieces in place of its mesh, each moved by one affine map: that of rest, plus the
sum over modes of a map times the amplitude of the moment; one object there has these for all trees.
Amplitudes stand in a table, one row for a tree and a knot of time, between which they go straight as
they do for sensors. Trees that are points have one modifier together: their stand-ins sway in views that
show those, dots do not. Nodes read the frame: no handler, and a render farm without the add-on shows the
same. Whoever measures sees trees at rest (``nodes.in_full``), and moves them by the same pieces and
amplitudes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...base.progress import Progress
from ...base.trimesh import TriMesh
from ...sensing.moving import split_pieces
from ..scene.attributes import mesh_of_points, read, write
from ..scene.instances import TREE_KEY, library_of
from ..scene.layout import (
    OUTLINES,
    TREES,
    VARIANTS,
    all_or_nothing,
    find_part,
    make_collection,
    make_object,
    objects_in,
    points_of_forest,
    root,
)
from ..scene.meshes import from_mesh, to_mesh
from ..scene.nodes import (
    VARIANT,
    VIEW_KEY,
    Graph,
    Value,
    instancer_of,
    marked,
    set_input,
    show_as,
    shown_of,
)
from ..scene.placing import KNOTS, OF_FULL, OF_LIGHT, ROW, WIND, WIND_COLUMNS, hide_wind

if TYPE_CHECKING:
    from ...stand.wind import ForestSway


WIND_KEY = "forest_wind"  # of the group that moves pieces
MANY_KEY = "forest_wind_many"  # of the group that shows trees that are points
MODES, COLUMNS = 12, 4
OUT = "Tree", ""  # what comes out of a group
TREE, PIECE, MAP = "tree", "piece", "map"  # attributes of pieces, with KNOTS
TABLE, LAST, FIRST, KNOT = "Table", "Last Knot", "First Frame", "Knots"
MOVING = (
    ("Pieces", "Geometry", "A point for every piece of every tree"),
    (TABLE, "Object", "Amplitudes of modes, by tree and knot of time"),
    (LAST, "Int", "Knot of the table at which wind stands still"),
    (FIRST, "Int", "Frame of the table's first knot"),
    (KNOT, "Float", "Knots of the table in a frame"),
)
PIECES, SHAPES, NUMBER = "Pieces", "Shapes", "Tree Number"
SHOWING = (
    ("Tree", "Geometry", "The tree at rest"),
    (PIECES, "Object", "Where the pieces of all trees are"),
    (SHAPES, "Collection", "Meshes of the tree's pieces"),
    (NUMBER, "Int", "Which of the pieces are the tree's"),
)
AMPLITUDES, STAND = "wind now", "wind stand"  # attributes of trees that are points, while nodes run
FULL, LIGHT, DOTS = "Full", "Light View", "Dots"
MANY = (
    ("Tree", "Geometry", "The trees at rest"),
    (LIGHT, "Bool", "Stand-ins sway in views; renders show trees"),
    (DOTS, "Bool", "Dots in views stand still"),
    (f"{PIECES} {FULL}", "Object", "How modes move each piece of each variant"),
    (f"{PIECES} {LIGHT}", "Object", "The same of pieces of stand-ins"),
    (f"{SHAPES} {FULL}", "Collection", "Meshes of the pieces"),
    (f"{SHAPES} {LIGHT}", "Collection", "Meshes of the pieces of stand-ins"),
    *MOVING[1:],
)


@dataclass(frozen=True)
class WindShown:
    """Numbers of what was made: trees that sway, trees that stand still, pieces of all, seconds of wind."""

    trees: int
    still: int
    pieces: int
    seconds: float


def amplitudes_of(
    sway: ForestSway, count: int, tell: Progress | None = None
) -> dict[int, np.ndarray]:
    """Compute the amplitudes (count, M) of each tree that sways at that many knots, by its row; touches no
    Blender."""
    rows, knot, computed = sorted(sway.number.values()), np.arange(count), {}
    for done, row in enumerate(rows):
        if tell:
            tell(done, len(rows))
        if sway.rig(row) is not None:
            computed[row] = sway.amplitudes(row, knot).astype(np.float32)
    return computed


def table_of(
    amplitudes: Mapping[int, np.ndarray], rows: Sequence[int], count: int
) -> bpy.types.Mesh:
    """Amplitudes of every tree at every knot: a vertex for each, trees one after another."""
    values = np.zeros((len(rows), count, MODES), np.float32)
    for place, row in enumerate(rows):
        own = amplitudes[row]
        values[place, :, : own.shape[1]] = own
    threes = {
        amplitude_name(first): values[..., first : first + 3].reshape(-1, 3)
        for first in range(0, MODES, 3)
    }
    return mesh_of_points("Wind Table", threes)


def pieces_of(
    sway: ForestSway,
    row: int,
    mesh: TriMesh,
    coats: Sequence[bpy.types.Material | None],
    home: bpy.types.Collection,
) -> np.ndarray:
    """Cut a mesh of a tree's variant, its own or a stand-in, into objects of a collection, in the order of
    their names; returns how modes move each, (P, MODES, 3, 4)."""
    rig = sway.rig(row)
    assert rig is not None
    cut = split_pieces(mesh, sway.pieces(row, mesh))
    parts = [(which, mesh.select(rows)) for which, rows in cut]
    for place, (_, part) in enumerate(parts, len(home.objects)):
        shape = to_mesh(f"{home.name} {place:06d}", part, coats)
        make_object(shape.name, shape, home)
    own = np.array([piece for piece, _ in parts], np.int64)
    maps = np.zeros((len(own), MODES, 3, COLUMNS), np.float32)
    maps[:, : rig.maps.shape[1]] = rig.maps[own]
    return maps


def pieces_mesh(maps: np.ndarray, numbers: Mapping[str, np.ndarray]) -> bpy.types.Mesh:
    """A point for every piece: how modes move it, (P, MODES, 3, 4), and whole numbers (P,) by name."""
    moved = {
        basis_name(mode, column): maps[:, mode, :, column]
        for mode in range(MODES)
        for column in range(COLUMNS)
    }
    return mesh_of_points("Wind Pieces", {**numbers, **moved})


def show_on_points(
    scene: bpy.types.Scene,
    instancer: bpy.types.Modifier,
    sway: ForestSway,
    amplitudes: Mapping[int, np.ndarray],
    clock: dict[str, float],
    top: bpy.types.Collection,
    key: str,
) -> WindShown:
    """Let the trees of an instancer sway. clock : inputs of modifiers that say when. top : where what is made
    for that goes. key : mark of the modifier."""
    obj, number = instancer.id_data, sway.number
    tree, kind = (read(obj.data, name, "INT", missing=-1) for name in (TREE_KEY, VARIANT))
    row_of = [number.get(one, -1) for one in tree.tolist()]
    moving = [k for k, row in enumerate(row_of) if row in amplitudes]
    rows, count = [row_of[k] for k in moving], int(clock[LAST]) + 2
    told = {name: np.zeros(len(tree), np.int64) for name in WIND_COLUMNS}
    told[ROW][moving] = 1 + np.arange(len(moving))
    told[KNOTS][moving] = count * np.arange(len(moving))
    given = {TABLE: make_object("Wind Table", table_of(amplitudes, rows, count), top)}
    used, sample = np.unique(kind[moving], return_index=True)
    for what, names, part in ((FULL, OF_FULL, VARIANTS), (LIGHT, OF_LIGHT, OUTLINES)):
        home, maps = make_collection(f"Wind {what}", top), []
        for one, first in zip(used.tolist(), sample.tolist(), strict=True):
            block, row = library_of(scene, part)[one], rows[first]
            # of a stand-in the mesh that stands for it, where it is one mesh
            rough = isinstance(block, bpy.types.Object) and block.type == "MESH"
            mesh = from_mesh(block.data) if part == OUTLINES and rough else sway.rest(row)
            mesh = mesh if len(mesh.triangles) else sway.rest(row)
            begin = len(home.objects)
            maps.append(pieces_of(sway, row, mesh, _coats(scene, block, one), home))
            selected = np.array(moving)[kind[moving] == one]
            told[names[0]][selected], told[names[1]][selected] = begin, len(home.objects) - begin
        all_maps = np.concatenate(maps) if maps else np.zeros((0, 12, 3, 4))
        given[f"{PIECES} {what}"] = make_object(
            f"Wind Pieces {what}", pieces_mesh(all_maps, {}), top
        )
        given[f"{SHAPES} {what}"] = home
    for name, values in told.items():
        write(obj.data, name, values, "INT")
    modifier = obj.modifiers.new(key, "NODES")
    modifier.node_group = marked(MANY_KEY, key) or _many(key)
    for name, value in (given | clock).items():
        set_input(modifier, name, value)
    show_as(instancer, shown_of(instancer))
    many = int(told[OF_FULL[1]].sum())
    return WindShown(len(moving), len(tree) - len(moving), many, 0.0)


def _coats(
    scene: bpy.types.Scene, block: bpy.types.ID, one: int
) -> list[bpy.types.Material | None]:
    own = block if isinstance(block, bpy.types.Object) else library_of(scene, VARIANTS)[one]
    return list(own.data.materials) if isinstance(own, bpy.types.Object) and own.data else []


MOST, MOST_POINTS = 1000, 5000  # trees that are objects, and points
SPARE = 1.0  # s after the last frame that the table still has, for motion blur
MOST_SECONDS = 600.0  # that a table may have


def show_wind(
    scene: bpy.types.Scene,
    sway: ForestSway,
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
    instancer, trees = _trees(scene)
    rate = scene.render.fps / scene.render.fps_base
    if amplitudes is None or any(len(one) != count for one in amplitudes.values()):
        amplitudes = amplitudes_of(sway, count)
    hide_wind(scene)
    clock = {LAST: count - 2, FIRST: scene.frame_start, KNOT: knots / rate}
    with all_or_nothing():
        top = make_collection(WIND, root(scene) or scene.collection)
        top.hide_viewport = top.hide_render = True
        if instancer is not None:
            made = show_on_points(scene, instancer, sway, amplitudes, clock, top, WIND)
        else:
            made = _show_on_objects(trees, sway, amplitudes, clock, top)
    return replace(made, seconds=(scene.frame_end - scene.frame_start) / rate)


def knots_of(scene: bpy.types.Scene, knots: int) -> int:
    """Number of knots in time that a scene's range of frames needs; knots : a second.

    Raises
    ------
    ValueError : there are none or too many trees, or the range of frames is too long.
    """
    instancer, trees = _trees(scene)
    points = 0 if instancer is None else len(instancer.id_data.data.vertices)
    if not trees and not points:
        raise ValueError("no trees stand here: grow a forest first")
    if len(trees) > MOST:
        raise ValueError(
            f"wind is shown on at most {MOST:,} trees that are objects, and here are {len(trees):,}: set "
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
    return instancer_of(points_of_forest(scene)), [t for t in things if TREE_KEY in t]


def _show_on_objects(
    found: Sequence[bpy.types.Object],
    sway: ForestSway,
    amplitudes: Mapping[int, np.ndarray],
    clock: dict[str, float],
    top: bpy.types.Collection,
) -> WindShown:
    """Let trees sway that are objects."""
    rows = [sway.number.get(int(obj[TREE_KEY]), -1) for obj in found]
    moving = [(obj, row) for obj, row in zip(found, rows, strict=True) if row in amplitudes]
    count = int(clock[LAST]) + 2
    table = table_of(amplitudes, [row for _, row in moving], count)
    given = {TABLE: make_object("Wind Table", table, top)}
    kinds: dict[tuple[str, tuple[int, int]], tuple[bpy.types.Collection, np.ndarray]] = {}
    shapes: list[bpy.types.Collection] = []
    maps: list[np.ndarray] = []
    for obj, row in moving:
        key = obj.data.name, sway.variant(row)
        if key not in kinds:
            home = make_collection(f"Wind {'.'.join(map(str, key[1]))}", top)
            made = pieces_of(sway, row, sway.rest(row), list(obj.data.materials), home)
            kinds[key] = home, made
        shapes.append(kinds[key][0])
        maps.append(kinds[key][1])
    size = np.array([len(one) for one in maps], np.int64)
    tree = np.repeat(np.arange(len(maps)), size)
    piece = np.arange(len(tree)) - np.repeat(np.cumsum(size) - size, size)
    told = {TREE: tree, PIECE: piece, KNOTS: tree * count}
    data = pieces_mesh(np.concatenate(maps) if maps else np.zeros((0, 12, 3, 4)), told)
    pieces = make_object("Wind Pieces", data, top)
    modifier = pieces.modifiers.new(WIND, "NODES")
    modifier.node_group = marked(WIND_KEY, True) or _moving()
    for name, value in (given | clock).items():
        set_input(modifier, name, value)
    for place, (obj, _) in enumerate(moving):
        modifier = obj.modifiers.new(WIND, "NODES")
        # the file's group that shows a tree's pieces, made where there is none
        groups = (g for g in bpy.data.node_groups if g.get(VIEW_KEY) == WIND and MANY_KEY not in g)
        modifier.node_group = next(groups, None) or _showing(WIND)
        for name, value in {PIECES: pieces, SHAPES: shapes[place], NUMBER: place}.items():
            set_input(modifier, name, value)
    return WindShown(len(moving), len(found) - len(moving), len(tree), 0.0)


def amplitude_name(first: int) -> str:
    """The column of the table with the amplitudes of three modes from this one on."""
    return f"wind {first}"


def basis_name(mode: int, column: int) -> str:
    """The attribute of pieces with a column of what a mode adds to their map."""
    return f"mode {mode} {'xyz'[column] if column < 3 else 'shift'}"


def _moving() -> bpy.types.NodeTree:
    graph = Graph.group("Forest Sensing Wind", "Says where the wind has each piece", MOVING, OUT)
    graph.tree[WIND_KEY] = True
    where = _piece_map(
        graph,
        _amplitudes(graph),
        lambda mode, column: graph.named(basis_name(mode, column), "FLOAT_VECTOR"),
    )
    moved = graph.store(graph.given["Pieces"], MAP, "FLOAT4X4", where)
    return graph.finish(_without(graph, moved, "mode *"))  # each tree would copy them


def _showing(key: str) -> bpy.types.NodeTree:
    told = "Shows a tree's pieces where the wind has them; sensors do the same"
    graph = Graph.group("Forest Sensing Swaying Tree", told, SHOWING, OUT)
    graph.tree[VIEW_KEY] = key
    how = {"data_type": "INT", "operation": "EQUAL"}
    selected = graph.value("Compare", graph.named(TREE, "INT"), graph.given[NUMBER], **how)
    own = graph.value("SeparateGeometry", graph.geometry_of(PIECES), selected, domain="POINT")
    return graph.finish(_placed(graph, own, graph.library(SHAPES), (MAP,)))


def _many(key: str) -> bpy.types.NodeTree:
    told = "Shows the pieces of trees where the wind has them; sensors do the same"
    graph = Graph.group("Forest Sensing Swaying Forest", told, MANY, OUT)
    graph.tree[VIEW_KEY] = graph.tree[MANY_KEY] = key
    given, viewed = graph.given, graph.value("IsViewport")
    light, dots = (graph.both(viewed, given[name]) for name in (LIGHT, DOTS))
    sways = graph.math("GREATER_THAN", graph.named(ROW, "INT"), 0.5)
    parted = {"Geometry": given["Tree"], "Selection": sways}
    moving, still = graph.add("SeparateGeometry", parted, domain="INSTANCE").outputs
    stand = graph.value("InstanceTransform")  # of each tree that sways, a point that says so
    trees = graph.store(moving, STAND, "FLOAT4X4", stand, "INSTANCE")
    trees = graph.value("InstancesToPoints", trees)
    for number, three in enumerate(_amplitudes(graph)):
        trees = graph.store(trees, f"{AMPLITUDES} {number}", "FLOAT_VECTOR", three)
    joined = graph.add("JoinGeometry", {0: _pieces(graph, trees, light)})
    graph.put(joined.inputs[0], still)
    return graph.finish(graph.switch("GEOMETRY", dots, joined.outputs[0], given["Tree"]))


def _pieces(graph: Graph, trees: Value, light: Value) -> Value:
    """An instance for every piece of every tree; of stand-ins one mesh, which is drawn faster."""
    first, count = (
        graph.switch("INT", light, graph.named(no, "INT"), graph.named(yes, "INT"))
        for no, yes in zip(OF_FULL, OF_LIGHT, strict=True)
    )
    copies = {"Geometry": trees, "Amount": count}
    each, number = graph.add("DuplicateElements", copies, domain="POINT").outputs
    told = graph.store(each, PIECE, "INT", graph.math("ADD", first, number))
    tables = (graph.geometry_of(f"{PIECES} {what}") for what in (FULL, LIGHT))
    table, piece = graph.switch("GEOMETRY", light, *tables), graph.named(PIECE, "INT")
    now = [graph.named(f"{AMPLITUDES} {n}", "FLOAT_VECTOR") for n in range(MODES // 3)]
    where = _piece_map(
        graph, now, lambda mode, at: _sampled(graph, table, basis_name(mode, at), piece)
    )
    placed = graph.value("MatrixMultiply", graph.named(STAND, "FLOAT4X4"), where)
    told = graph.store(told, MAP, "FLOAT4X4", placed)
    shapes = (graph.library(f"{SHAPES} {what}") for what in (FULL, LIGHT))
    each = _placed(graph, told, graph.switch("GEOMETRY", light, *shapes), (MAP, "wind *"))
    return graph.switch("GEOMETRY", light, each, graph.value("RealizeInstances", each))


def _without(graph: Graph, geometry: Value, pattern: str) -> Value:
    """A geometry without the attributes of a name with a wildcard."""
    made = graph.add("RemoveAttribute", {"Geometry": geometry, "Name": pattern})
    if hasattr(made, "pattern_mode"):  # before Blender 5
        made.pattern_mode = "WILDCARD"
    else:
        graph.put(made.inputs["Pattern Mode"], "Wildcard")
    return made.outputs["Geometry"]


def _placed(graph: Graph, points: Value, shapes: Value, spare: tuple[str, ...]) -> Value:
    """Pieces where points say, by their attributes ``PIECE`` and ``MAP``; spare : attributes to drop.

    They are dropped from the points. Dropped from instances of objects, they would make these
    instances of bare meshes, which Blender's exporters write without a face.
    """
    where = graph.named(MAP, "FLOAT4X4")
    keep = graph.add("CaptureAttribute", {"Geometry": points}, domain="POINT")
    keep.capture_items.new("MATRIX", MAP)
    graph.put(keep.inputs[MAP], where)
    bare = keep.outputs["Geometry"]
    for pattern in spare:
        bare = _without(graph, bare, pattern)
    number = graph.named(PIECE, "INT")
    stand = {"Points": bare, "Instance": shapes, "Pick Instance": True, "Instance Index": number}
    stood = graph.add("InstanceOnPoints", stand).outputs["Instances"]
    moved = {"Instances": stood, "Transform": keep.outputs[MAP]}
    return graph.add("SetInstanceTransform", moved).outputs["Instances"]


def _sampled(graph: Graph, geometry: Value, name: str, index: Value) -> Value:
    """A vector attribute of one point of a geometry."""
    value = graph.named(name, "FLOAT_VECTOR")
    how = {"data_type": "FLOAT_VECTOR", "domain": "POINT", "clamp": True}
    return graph.value("SampleIndex", geometry, value, index, **how)


def _amplitudes(graph: Graph) -> list[Value]:
    """Amplitudes of three modes after three at the scene's frame, straight between knots."""
    given, frame = graph.given, graph.add("InputSceneTime").outputs["Frame"]
    past = graph.math("SUBTRACT", frame, given[FIRST])
    knot = graph.math("MAXIMUM", graph.math("MULTIPLY", past, given[KNOT]), 0.0)
    knot = graph.math("MINIMUM", knot, given[LAST])
    below = graph.math("FLOOR", knot)
    share = graph.math("SUBTRACT", knot, below)
    row = graph.math("ADD", below, graph.named(KNOTS, "INT"))
    rows, table = (row, graph.math("ADD", row, 1.0)), graph.geometry_of(TABLE)
    mixed = []
    for first in range(0, MODES, 3):
        ends = (_sampled(graph, table, amplitude_name(first), row) for row in rows)
        mixed.append(graph.value("Mix", share, *ends, data_type="VECTOR", clamp_factor=True))
    return mixed


def _piece_map(graph: Graph, amplitudes: list[Value], basis: Callable[[int, int], Value]) -> Value:
    """The map of a piece at amplitudes: that of rest, and what each mode adds to a column of it
    (``basis``)."""
    each = [number for three in amplitudes for number in graph.numbers(three)]
    entries: list[Value] = []
    for number in range(COLUMNS):
        column: Value = tuple(float(number == line) for line in range(3))
        for mode, amplitude in enumerate(each):
            added = graph.value("VectorMath", basis(mode, number), amplitude, operation="SCALE")
            column = graph.value("VectorMath", column, added, operation="ADD")
        entries += [*graph.numbers(column), None]  # the last line of a map stays as it is
    return graph.value("CombineMatrix", *entries)
