"""Truth of a tree, written onto its mesh, so that it goes along wherever the mesh goes.

A mesh that is appended or linked from an asset library comes alone: what sensors and tables need of its tree
must be on the mesh. Faces have ``part``, ``leaf`` and ``order`` (``meshes``). Custom properties say which
asset it is (``forest_asset``: species, variant and a fingerprint) and what it measures; two more point to
meshes that no scene shows: its skeleton (an edge a segment) and its leaves (a vertex at the centre of each),
whose attributes are the columns of ``Skeleton`` and ``Leaves``. Blender takes along what a property points
to.
"""

from __future__ import annotations

from collections.abc import Mapping

import bpy
import numpy as np

from ...growth.mesh.leaves import Leaves
from ...growth.skeleton import Skeleton
from ...growth.tree import Tree
from ...growth.truth import tree_truth
from ...sensing.rays.geometry import SceneGeometry
from ...stand.placed import PlacedTrees, PlacedVariant
from .standings import ASSET_KEY

SPECIES, WOOD, LEAVES = "forest_asset_species", "forest_skeleton", "forest_leaves"
GRAFTED = "forest_grafted"
COLUMNS: Mapping[str, tuple[str, str, str, int, type]] = {
    # column: attribute, its type, its key, its width
    "radius": ("radius", "FLOAT", "value", 1, np.float32),
    "parent": ("parent", "INT", "value", 1, np.int32),
    "order": ("order", "INT", "value", 1, np.int32),
    "generation": ("generation", "INT", "value", 1, np.int32),
    "normal": ("leaf_normal", "FLOAT_VECTOR", "vector", 3, np.float32),
    "axis": ("leaf_axis", "FLOAT_VECTOR", "vector", 3, np.float32),
    "length": ("length", "FLOAT", "value", 1, np.float32),
    "width": ("width", "FLOAT", "value", 1, np.float32),
    "branch": ("branch", "INT", "value", 1, np.int32),
    "dead": ("dead", "INT", "value", 1, np.int32),
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
    mesh[WOOD] = _skeleton_mesh(f"{mesh.name} skeleton", tree.skeleton)
    mesh[LEAVES] = _leaf_mesh(f"{mesh.name} leaves", tree.leaves)


def read_truth(mesh: bpy.types.Mesh) -> PlacedVariant | None:
    """Return what a mesh says of its tree, in float32; None where it says nothing, or not all of it."""
    wood, leaves = mesh.get(WOOD), mesh.get(LEAVES)
    if not (isinstance(wood, bpy.types.Mesh) and isinstance(leaves, bpy.types.Mesh)):
        return None
    told = {key: value for key, value in mesh.items() if isinstance(value, float)}
    return PlacedVariant(
        name=str(mesh[ASSET_KEY]),
        species=str(mesh.get(SPECIES, "")),
        skeleton=_read_skeleton(wood),
        leaves=_read_leaves(leaves),
        truth=told,
        grafted=bool(mesh.get(GRAFTED, False)),
    )


def has_assets() -> bool:
    """Return whether this file has a tree of a library."""
    return any(ASSET_KEY in mesh for mesh in bpy.data.meshes)


def placed_trees(scene: SceneGeometry) -> PlacedTrees:
    """The trees from libraries in a scene that was read, with the truth that their meshes bring."""
    wanted = sorted({asset for asset in scene.asset if asset})
    by_asset: dict[str, PlacedVariant] = {}
    for mesh in bpy.data.meshes:
        asset = mesh.get(ASSET_KEY)
        if isinstance(asset, str) and asset in wanted and asset not in by_asset:
            found = read_truth(mesh)
            if found is not None:
                by_asset[asset] = found
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


def _skeleton_mesh(name: str, wood: Skeleton) -> bpy.types.Mesh:
    data = bpy.data.meshes.new(name)
    count = len(wood)
    data.vertices.add(2 * count)
    data.edges.add(count)
    ends = np.stack([wood.start, wood.end], axis=1).reshape(-1, 3)
    if count:
        data.attributes["position"].data.foreach_set("vector", ends.astype(np.float32).ravel())
        data.edges.foreach_set("vertices", np.arange(2 * count, dtype=np.int32))
    _put(data, "POINT", "radius", wood.radius)
    for column in OF_SEGMENTS:
        _put(data, "EDGE", column, wood.is_dead if column == "dead" else getattr(wood, column))
    data.update()
    return data


def _read_skeleton(data: bpy.types.Mesh) -> Skeleton:
    ends = _positions(data).reshape(-1, 2, 3)
    return Skeleton(
        start=ends[:, 0],
        end=ends[:, 1],
        radius=_get(data, "radius").reshape(-1, 2),
        **{column: _get(data, column) for column in OF_SEGMENTS if column != "dead"},
        dead=_get(data, "dead") > 0 if "dead" in data.attributes else None,
    )


def _leaf_mesh(name: str, leaves: Leaves) -> bpy.types.Mesh:
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(leaves))
    if len(leaves):
        centre = leaves.centre.astype(np.float32).ravel()
        data.attributes["position"].data.foreach_set("vector", centre)
    for column in OF_LEAVES:
        _put(data, "POINT", column, getattr(leaves, column))
    data.update()
    return data


def _read_leaves(data: bpy.types.Mesh) -> Leaves:
    columns = {column: _get(data, column) for column in OF_LEAVES}
    columns["branch"] = columns["branch"].astype(np.int32)
    return Leaves(centre=_positions(data), **columns)


def _put(data: bpy.types.Mesh, domain: str, column: str, values: np.ndarray) -> None:
    name, kind, key, _, dtype = COLUMNS[column]
    attribute = data.attributes.new(name, kind, domain)
    if len(values):
        attribute.data.foreach_set(key, np.ascontiguousarray(values, dtype=dtype).ravel())


def _get(data: bpy.types.Mesh, column: str) -> np.ndarray:
    """A column as float64 or int64, (N,) or (N, 3)."""
    name, _, key, width, dtype = COLUMNS[column]
    attribute = data.attributes[name]
    values = np.empty(width * len(attribute.data), dtype=dtype)
    if len(values):
        attribute.data.foreach_get(key, values)
    wide = values.astype(np.float64 if dtype is np.float32 else np.int64)
    return wide.reshape(-1, 3) if width == 3 else wide


def _positions(data: bpy.types.Mesh) -> np.ndarray:
    values = np.empty(3 * len(data.vertices), dtype=np.float32)
    if len(values):
        data.attributes["position"].data.foreach_get("vector", values)
    return values.reshape(-1, 3).astype(np.float64)
