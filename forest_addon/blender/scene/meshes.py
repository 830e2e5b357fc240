"""Triangles to a Blender Mesh and back, the mesh of the ground, and the truth of a tree on its mesh.

Meshes go in bulk through attribute arrays. Face attributes carry what a sensor wants to know: ``part``
(other, wood, leaf, ground), ``leaf`` (the leaf's number, -1 elsewhere) and, of whole trees, ``order``
(branching order). They survive modifiers and instancing, so the evaluated scene tells. Texture
coordinates are the layer ``UVMap``.

A mesh that is appended or linked from an asset library comes alone: what sensors and tables need of its
tree must be on the mesh. Custom properties say which asset it is (``forest_asset``: species, variant and
a fingerprint) and what it measures; two more point to meshes that no scene shows: its skeleton (an edge
a segment) and its leaves (a vertex at the centre of each), whose attributes are the columns of
``Skeleton`` and ``Leaves``. Blender takes along what a property points to.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from weakref import WeakValueDictionary
from zlib import crc32

import bpy
import numpy as np

from ... import spec
from ...base.trimesh import GROUND, LEAF, OTHER, TriMesh
from ...growth.mesh.leaves import Leaves
from ...growth.skeleton import Skeleton
from ...growth.tree import Tree
from ...growth.truth import tree_truth
from ...sensing.rays.geometry import SceneGeometry
from ...stand.forest import PlacedTrees, PlacedVariant
from ...stand.intensity.surface import GroundSurface, Heightmap
from .attributes import places_of, read, write
from .instances import ASSET_KEY

# Arrays that were written, for as long as others hold them: what is read back the same is held once.
_written: WeakValueDictionary[tuple[str, tuple[int, ...], int], np.ndarray] = WeakValueDictionary()


def to_mesh(
    name: str, mesh: TriMesh, coats: Iterable[bpy.types.Material | None] = ()
) -> bpy.types.Mesh:
    """A new Blender mesh with these materials; leaves are shaded flat, the rest smooth."""
    data = bpy.data.meshes.new(name)
    for coat in coats:
        data.materials.append(coat)
    count = len(mesh.triangles)
    if not count:
        return data
    for values in (mesh.triangles, mesh.part, mesh.leaf, mesh.material):
        _written[_told(values)] = values
    data.vertices.add(len(mesh.vertices))
    data.loops.add(3 * count)
    data.polygons.add(count)
    write(data, "position", mesh.vertices, "FLOAT_VECTOR")
    write(data, ".corner_vert", mesh.triangles, "INT", "CORNER")
    data.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    write(data, "part", mesh.part, "INT8", "FACE")
    write(data, "leaf", mesh.leaf, "INT", "FACE")
    write(data, "material_index", mesh.material, "INT", "FACE")
    write(data, "sharp_face", mesh.part == LEAF, "BOOLEAN", "FACE")
    if mesh.order is not None:
        write(data, "order", mesh.order, "INT8", "FACE")
    texture = mesh.uv
    if texture is not None:
        write(data, "UVMap", texture, "FLOAT2", "CORNER")
    edges = mesh.known_edges()
    if edges is None:
        data.update(calc_edges=True)
        return data
    data.edges.add(len(edges.ends))
    write(data, ".edge_verts", edges.ends, "INT32_2D", "EDGE")
    write(data, ".corner_edge", edges.of_corner, "INT", "CORNER")
    data.update()
    return data


def from_mesh(data: bpy.types.Mesh) -> TriMesh:
    """Any Blender mesh as triangles in its local space, with our face attributes where it has them."""
    triangles, face = _triangles(data)
    return TriMesh(
        vertices=read(data, "position", "FLOAT_VECTOR"),
        triangles=_once(triangles.reshape(-1, 3)),
        part=_once(_face_values(data, "part", np.int8, OTHER)[face]),
        leaf=_once(_face_values(data, "leaf", np.int32, -1)[face]),
        material=_once(_face_values(data, "material_index", np.int32, 0)[face]),
    )


def _once(values: np.ndarray) -> np.ndarray:
    """An array that was read; where the same was written and is still held, that one, not to be changed."""
    known = _written.get(_told(values))
    if known is None or not np.array_equal(known, values):
        return values
    shared = known.view()
    shared.flags.writeable = False
    return shared


def _told(values: np.ndarray) -> tuple[str, tuple[int, ...], int]:
    """Type and shape of an array, and a checksum of some thousand rows: ``_once`` compares all."""
    return (
        values.dtype.str,
        values.shape,
        crc32(np.ascontiguousarray(values[:: 1 + len(values) // 4096])),
    )


def _triangles(data: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray | slice]:
    """(3 T,) vertices of the triangles of a mesh, and which face each is a part of."""
    if len(data.loops) == 3 * len(data.polygons):  # nothing to cut up
        return read(data, ".corner_vert", "INT", "CORNER"), slice(None)
    data.calc_loop_triangles()
    count = len(data.loop_triangles)
    corners = np.empty(3 * count, dtype=np.int32)
    face = np.empty(count, dtype=np.int32)
    data.loop_triangles.foreach_get("vertices", corners)
    data.loop_triangles.foreach_get("polygon_index", face)
    return corners, face


def _face_values(data: bpy.types.Mesh, name: str, dtype: type, default: int) -> np.ndarray:
    """(F,) whole numbers of the faces of a mesh, whatever their size."""
    kind = "INT8" if getattr(data.attributes.get(name), "data_type", "") == "INT8" else "INT"
    return read(data, name, kind, "FACE", default).astype(dtype)


def ground_mesh(field: spec.Forest, terrain: GroundSurface) -> TriMesh:
    """The terrain as triangles; flat ground and heightmaps reach the field's margin beyond the field."""
    low = np.array(field.origin) - field.margin
    high = np.array(field.origin) + np.array(field.size) + field.margin
    shape = terrain.triangles()
    if shape is None:
        corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        vertices = np.column_stack([corners, terrain.height(corners)])
        return TriMesh.of_part(vertices, np.array([[0, 1, 2], [0, 2, 3]]), GROUND)
    vertices, triangles = shape
    if isinstance(terrain, Heightmap):  # its edge goes on at the height that it has there
        vertices, grid = vertices.copy(), terrain.grid
        place = vertices[:, :2]
        vertices[:, :2] = np.where(
            place <= grid.low,
            np.minimum(grid.low, low),
            np.where(place >= grid.high, np.maximum(grid.high, high), place),
        )
    return TriMesh.of_part(vertices, triangles, GROUND)


SPECIES, WOOD, LEAVES = "forest_asset_species", "forest_skeleton", "forest_leaves"
GRAFTED = "forest_grafted"
COLUMNS: Mapping[str, tuple[str, str]] = {  # attribute of a column, and its kind
    "radius": ("radius", "FLOAT"),
    "parent": ("parent", "INT"),
    "order": ("order", "INT"),
    "generation": ("generation", "INT"),
    "normal": ("leaf_normal", "FLOAT_VECTOR"),
    "axis": ("leaf_axis", "FLOAT_VECTOR"),
    "length": ("length", "FLOAT"),
    "width": ("width", "FLOAT"),
    "branch": ("branch", "INT"),
    "dead": ("dead", "INT"),
}
OF_SEGMENTS = ("parent", "order", "generation", "dead")
OF_LEAVES = ("normal", "axis", "length", "width", "radius", "branch")


def write_truth(mesh: bpy.types.Mesh, asset: str, species: str, tree: Tree) -> None:
    """Say on a mesh of a tree what it is.

    asset : a word that only this tree has.
    """
    mesh[ASSET_KEY], mesh[SPECIES], mesh[GRAFTED] = asset, species, tree.grafted
    for key, value in tree_truth(tree).items():
        mesh[key] = value
    data = bpy.data.meshes.new(f"{mesh.name} skeleton")
    count = len(tree.skeleton)
    data.vertices.add(2 * count)
    data.edges.add(count)
    ends = np.stack([tree.skeleton.start, tree.skeleton.end], axis=1).reshape(-1, 3)
    if count:
        write(data, "position", ends, "FLOAT_VECTOR")
        data.edges.foreach_set("vertices", np.arange(2 * count, dtype=np.int32))
    _put(data, "POINT", "radius", tree.skeleton.radius.ravel())
    for column in OF_SEGMENTS:
        _put(
            data,
            "EDGE",
            column,
            tree.skeleton.is_dead if column == "dead" else getattr(tree.skeleton, column),
        )
    data.update()
    mesh[WOOD] = data
    data = bpy.data.meshes.new(f"{mesh.name} leaves")
    data.vertices.add(len(tree.leaves))
    if len(tree.leaves):
        write(data, "position", tree.leaves.centre, "FLOAT_VECTOR")
    for column in OF_LEAVES:
        _put(data, "POINT", column, getattr(tree.leaves, column))
    data.update()
    mesh[LEAVES] = data


def read_truth(mesh: bpy.types.Mesh) -> PlacedVariant | None:
    """Truth of a tree as its mesh keeps it, in float32; None where it keeps nothing, or not all of it."""
    wood, leaves = mesh.get(WOOD), mesh.get(LEAVES)
    if not (isinstance(wood, bpy.types.Mesh) and isinstance(leaves, bpy.types.Mesh)):
        return None
    told = {key: value for key, value in mesh.items() if isinstance(value, float)}
    ends, columns = places_of(wood).reshape(-1, 2, 3), [c for c in OF_SEGMENTS if c != "dead"]
    skeleton = Skeleton(
        start=ends[:, 0],
        end=ends[:, 1],
        radius=_get(wood, "POINT", "radius").reshape(-1, 2),
        **{column: _get(wood, "EDGE", column) for column in columns},
        dead=_get(wood, "EDGE", "dead") > 0 if "dead" in wood.attributes else None,
    )
    of_leaves = {column: _get(leaves, "POINT", column) for column in OF_LEAVES}
    of_leaves["branch"] = of_leaves["branch"].astype(np.int32)
    return PlacedVariant(
        name=str(mesh[ASSET_KEY]),
        species=str(mesh.get(SPECIES, "")),
        skeleton=skeleton,
        leaves=Leaves(centre=places_of(leaves), **of_leaves),
        truth=told,
        grafted=bool(mesh.get(GRAFTED, False)),
    )


def placed_trees(scene: SceneGeometry) -> PlacedTrees:
    """The trees from libraries in a scene that was read, with the truth that their meshes bring."""
    wanted = sorted({asset for asset in scene.asset if asset})
    by_asset: dict[str, PlacedVariant] = {}
    for mesh in bpy.data.meshes:
        asset = mesh.get(ASSET_KEY)
        if isinstance(asset, str) and asset in wanted and asset not in by_asset:
            truth = read_truth(mesh)
            if truth is not None:
                by_asset[asset] = truth
    names = [asset for asset in wanted if asset in by_asset]
    number = {asset: k for k, asset in enumerate(names)}
    of_mesh = np.array([number.get(asset, -1) for asset in scene.asset], dtype=np.int64)
    kind = of_mesh[scene.mesh_index] if len(of_mesh) else np.full(len(scene), -1)
    rows = np.flatnonzero(kind >= 0)
    rows = rows[np.argsort(scene.tree[rows], kind="stable")]
    return PlacedTrees(
        grown=tuple(by_asset[name] for name in names),
        index=kind[rows],
        transform=scene.transform[rows],
        tree=scene.tree[rows],
        species=scene.species[rows],
        object_name=tuple(scene.object_name[k] for k in scene.object_index[rows].tolist()),
    )


def _put(data: bpy.types.Mesh, domain: str, column: str, values: np.ndarray) -> None:
    name, kind = COLUMNS[column]
    write(data, name, values, kind, domain)


def _get(data: bpy.types.Mesh, domain: str, column: str) -> np.ndarray:
    """A column as float64 or int64, (N,) or (N, 3)."""
    name, kind = COLUMNS[column]
    return read(data, name, kind, domain).astype(np.int64 if kind == "INT" else np.float64)
