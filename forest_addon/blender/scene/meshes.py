"""Triangles to a Blender Mesh and back, in bulk through attribute arrays.

Face attributes carry what a sensor wants to know: ``part`` (other, wood, leaf, ground), ``leaf`` (the
leaf's number, -1 elsewhere) and, of whole trees, ``order`` (branching order). They survive modifiers and
instancing, so the evaluated scene tells. Texture coordinates are the layer ``UVMap``.
"""

from __future__ import annotations

from weakref import WeakValueDictionary
from zlib import crc32

import bpy
import numpy as np

from ...base.trimesh import LEAF, OTHER, TriMesh

# Arrays that were written, for as long as others hold them: what is read back the same is held once.
_written: WeakValueDictionary[tuple[str, tuple[int, ...], int], np.ndarray] = WeakValueDictionary()


def to_mesh(name: str, mesh: TriMesh) -> bpy.types.Mesh:
    """A new Blender mesh; leaves are shaded flat, the rest smooth."""
    data = bpy.data.meshes.new(name)
    count = len(mesh.triangles)
    if not count:
        return data
    for values in (mesh.triangles, mesh.part, mesh.leaf, mesh.material):
        _written[_told(values)] = values
    data.vertices.add(len(mesh.vertices))
    data.loops.add(3 * count)
    data.polygons.add(count)
    _set(data.attributes["position"], "vector", mesh.vertices, np.float32)
    _set(data.attributes[".corner_vert"], "value", mesh.triangles, np.int32)
    data.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    _set(data.attributes.new("part", "INT8", "FACE"), "value", mesh.part, np.int8)
    _set(data.attributes.new("leaf", "INT", "FACE"), "value", mesh.leaf, np.int32)
    _set(data.attributes.new("material_index", "INT", "FACE"), "value", mesh.material, np.int32)
    _set(data.attributes.new("sharp_face", "BOOLEAN", "FACE"), "value", mesh.part == LEAF, bool)
    if mesh.order is not None:
        _set(data.attributes.new("order", "INT8", "FACE"), "value", mesh.order, np.int8)
    if mesh.uv is not None:
        _set(data.attributes.new("UVMap", "FLOAT2", "CORNER"), "vector", mesh.uv, np.float32)
    edges = mesh.known_edges()
    if edges is None:
        data.update(calc_edges=True)
        return data
    data.edges.add(len(edges.ends))
    _set(data.attributes[".edge_verts"], "value", edges.ends, np.int32)
    _set(data.attributes[".corner_edge"], "value", edges.of_corner, np.int32)
    data.update()
    return data


def from_mesh(data: bpy.types.Mesh) -> TriMesh:
    """Any Blender mesh as triangles in its local space, with our face attributes where it has them."""
    triangles, face = _triangles(data)
    position = np.empty(3 * len(data.vertices), dtype=np.float32)
    if len(position):
        data.attributes["position"].data.foreach_get("vector", position)
    return TriMesh(
        vertices=position.reshape(-1, 3).astype(np.float64),
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
    """Type, shape and checksum of an array."""
    return values.dtype.str, values.shape, crc32(np.ascontiguousarray(values))


def _triangles(data: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray | slice]:
    """(3 T,) vertices of the triangles of a mesh, and which face each is a part of."""
    if len(data.loops) == 3 * len(data.polygons):  # nothing to cut up
        corners = np.empty(len(data.loops), dtype=np.int32)
        if len(corners):
            data.attributes[".corner_vert"].data.foreach_get("value", corners)
        return corners, slice(None)
    data.calc_loop_triangles()
    count = len(data.loop_triangles)
    corners = np.empty(3 * count, dtype=np.int32)
    face = np.empty(count, dtype=np.int32)
    data.loop_triangles.foreach_get("vertices", corners)
    data.loop_triangles.foreach_get("polygon_index", face)
    return corners, face


def _face_values(data: bpy.types.Mesh, name: str, dtype: type, default: int) -> np.ndarray:
    count = len(data.polygons)
    attribute = data.attributes.get(name)
    if (
        attribute is None
        or attribute.domain != "FACE"
        or attribute.data_type not in ("INT8", "INT")
    ):
        return np.full(count, default, dtype=dtype)
    values = np.empty(count, dtype=np.int8 if attribute.data_type == "INT8" else np.int32)
    attribute.data.foreach_get("value", values)
    return values.astype(dtype)


def _set(attribute: bpy.types.Attribute, key: str, values: np.ndarray, dtype: type) -> None:
    attribute.data.foreach_set(key, np.ascontiguousarray(values, dtype=dtype).ravel())
