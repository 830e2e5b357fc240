"""Arrays to Blender's attributes and back, in bulk; pixels of a picture that stands for a block."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy
import numpy as np

# Kinds of attributes: Blender's name of a value, its type, how many numbers it is.
KINDS: dict[str, tuple[str, type, int]] = {
    "FLOAT": ("value", np.float32, 1),
    "INT": ("value", np.int32, 1),
    "INT8": ("value", np.int8, 1),
    "BOOLEAN": ("value", bool, 1),
    "FLOAT2": ("vector", np.float32, 2),
    "FLOAT_VECTOR": ("vector", np.float32, 3),
    "FLOAT_COLOR": ("color", np.float32, 4),
    "BYTE_COLOR": ("color", np.float32, 4),
    "INT32_2D": ("value", np.int32, 2),
    "FLOAT4X4": ("value", np.float32, 16),
}
BY_SHAPE = {(): "FLOAT", (3,): "FLOAT_VECTOR", (4,): "FLOAT_COLOR"}  # of a value with a fraction


def mesh_of_points(name: str, arrays: Mapping[str, np.ndarray]) -> bpy.types.Mesh:
    """A new mesh of vertices alone, with arrays (N,) or (N, K) as attributes: whole numbers, numbers, vectors
    or colours."""
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(next(iter(arrays.values()))))
    for key, values in arrays.items():
        whole = np.issubdtype(values.dtype, np.integer)
        write(data, key, values, "INT" if whole else BY_SHAPE[values.shape[1:]])
    return data


def plain_mesh(
    name: str, places: Any, faces: Any, coat: bpy.types.Material | None = None
) -> bpy.types.Mesh:
    """A new mesh of corners (N, 3) and faces, rows of numbers of corners, with a material."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(np.asarray(places).tolist(), [], np.asarray(faces).tolist())
    if coat is not None:
        data.materials.append(coat)
    return data


def write(
    data: Any, name: str, values: np.ndarray, kind: str = "FLOAT", domain: str = "POINT"
) -> None:
    """Write values (N,) or (N, K) as an attribute of a mesh, made where it is missing."""
    attribute = data.attributes.get(name) or data.attributes.new(name, kind, domain)
    key, dtype, _ = KINDS[kind]
    if len(values):
        attribute.data.foreach_set(key, np.ascontiguousarray(values, dtype=dtype).ravel())


def read(
    data: Any, name: str, kind: str = "FLOAT", domain: str = "POINT", missing: float = 0
) -> np.ndarray:
    """(N,) or (N, K) values of an attribute; all ``missing`` where there is none of this kind and domain."""
    key, dtype, width = KINDS[kind]
    attribute = data.attributes.get(name)
    if attribute is None or (attribute.data_type, attribute.domain) != (kind, domain):
        values = np.full(width * data.attributes.domain_size(domain), missing, dtype=dtype)
    else:
        values = np.empty(width * len(attribute.data), dtype=dtype)
        if len(values):
            attribute.data.foreach_get(key, values)
    return values.reshape(-1, width) if width > 1 else values


def places_of(data: Any) -> np.ndarray:
    """(N, 3) places of points in double precision, in their own space."""
    return read(data, "position", "FLOAT_VECTOR").astype(np.float64)


def world_places_of(obj: bpy.types.Object, data: bpy.types.Mesh) -> np.ndarray:
    """(N, 3) places of the points of an object's mesh in the world."""
    world = np.array(obj.matrix_world, dtype=np.float64)
    return places_of(data) @ world[:3, :3].T + world[:3, 3]


def give_picture(block: bpy.types.ID, pixels: np.ndarray) -> None:
    """Give a block the picture (H, W, 4) that browsers and panels show of it, its lowest row first."""
    preview = block.preview_ensure()
    preview.image_size = pixels.shape[1::-1]
    preview.image_pixels_float.foreach_set(np.ascontiguousarray(pixels, dtype=np.float32).ravel())
