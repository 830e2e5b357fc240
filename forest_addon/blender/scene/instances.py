"""Instances of geometry nodes: trees as points of one object, and what Blender evaluates of them as
arrays.

The attributes of a point say which variant of the library stands there, how turned and how large, which
tree and which planting it is (``forest_tree``, ``forest_species``, also the names of the custom
properties of trees that are objects). They go along to the evaluated instances. A library is a
collection of objects that counts them in the order of their names.

``standings`` reads an evaluated object without a loop over instances: its meshes, each with all places
where it stands. Blender gives the instances of a geometry as a point cloud whose points have a transform
and the number of what stands there: an object, or a geometry with a mesh and instances of its own, and
so on down. ``evaluated_transforms`` gives the float32 matrices of points that stand in no scene of the
user's.

A tree that is an object says where it was planted; the collection of its planting says where all were. So
a tree that was moved by hand is known (``stood_trees``), and one that was deleted. Of trees that are points
nothing is moved.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...spec import SpecError
from .attributes import mesh_of_points, read
from .layout import (
    POINTS_ROLE,
    ROLE_KEY,
    TREES,
    VARIANTS,
    all_or_nothing,
    by_role,
    find_part,
    groves,
    objects_in,
    within_reach,
)
from .nodes import ROTATION, SCALE, VARIANT, give_instancer

if TYPE_CHECKING:
    from ...stand.forest import GrownForest

TREE_KEY, SPECIES_KEY = "forest_tree", "forest_species"
IGNORED_KEY, REFLECTANCE_KEY = "forest_ignored", "forest_reflectance"
ASSET_KEY = "forest_asset"  # on the mesh of a tree from a library: which (``meshes.read_truth``)
SOLID_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}  # objects that can have a surface


class NeedsIterator(Exception):
    """Something stands there that only the depsgraph's own iterator resolves: a collection, duplis."""


@dataclass(frozen=True)
class Standing:
    """One mesh and the N places where it stands.

    transform : (N, 4, 4) float64, from the mesh to the object that was asked about.
    tree, species : (N,) int64, -1 where no attribute says.
    source : the object that the mesh is of, None where geometry nodes made it.
    keeper : what must live as long as the mesh.
    """

    mesh: bpy.types.Mesh
    transform: np.ndarray
    tree: np.ndarray
    species: np.ndarray
    source: bpy.types.Object | None
    keeper: Any = None


def planted_names(scene: bpy.types.Scene, known: Sequence[str]) -> list[str]:
    """Name what the forest of a scene is planted with, by number: what is known, then the undergrowth."""
    found = dict(enumerate(known))
    for home in (find_part(scene, name) for name in (VARIANTS, TREES)):
        for obj in objects_in(home) if home is not None else ():
            number, role = obj.get(SPECIES_KEY, -1), obj.get(ROLE_KEY, "")
            if number >= 0 and "/" in role:
                found.setdefault(number, re.sub(r"[ .]\d+$", "", role.split("/", 1)[1]))
    return [found.get(number, "") for number in range(max(found, default=-1) + 1)]


def has_nodes(obj: bpy.types.Object) -> bool:
    """Return whether geometry nodes work on an object; those that are switched off everywhere do not."""
    nodes = (modifier for modifier in obj.modifiers if modifier.type == "NODES")
    return any(modifier.show_viewport or modifier.show_render for modifier in nodes)


def has_duplis(obj: bpy.types.Object) -> bool:
    """Return whether an object instances in one of the ways that are older than geometry nodes."""
    return obj.instance_type != "NONE" or len(obj.particle_systems) > 0


def may_be_met(obj: bpy.types.Object) -> bool:
    """Return whether an object may have a surface, or instance something that has."""
    waiting, known = [obj], set()
    while waiting:
        one = waiting.pop()
        if one.type in SOLID_TYPES or has_nodes(one):
            return True
        home = one.instance_collection if one.instance_type == "COLLECTION" else None
        if home is not None and home not in known:
            known.add(home)
            waiting.extend(objects_in(home))
    return False


def standings(obj: bpy.types.Object) -> list[Standing]:
    """The meshes of an evaluated object: its own and those that its geometry nodes instance.

    Raises
    ------
    NeedsIterator : the depsgraph's iterator must be asked instead.
    """
    if has_duplis(obj):
        raise NeedsIterator
    if obj.type == "MESH" and not has_nodes(obj):
        return [_alone(obj.data, obj, None)]
    return _of_geometry(obj.evaluated_geometry(), obj)


def _of_geometry(geometry: Any, source: bpy.types.Object | None) -> list[Standing]:
    trees = []
    if geometry.mesh is not None:
        trees.append(_alone(geometry.mesh, source, geometry))
    cloud = geometry.instances_pointcloud()
    if cloud is None:
        return trees
    transform, (number, tree, species) = _of_cloud(cloud)
    for index, reference in enumerate(geometry.instance_references()):
        rows = np.flatnonzero(number == index)
        if not len(rows):
            continue
        for inner in _of_reference(reference):
            outer = np.repeat(rows, len(inner.transform))
            trees.append(
                Standing(
                    mesh=inner.mesh,
                    transform=(transform[rows, None] @ inner.transform).reshape(-1, 4, 4),
                    tree=_first_known(np.tile(inner.tree, len(rows)), tree[outer]),
                    species=_first_known(np.tile(inner.species, len(rows)), species[outer]),
                    source=inner.source,
                    keeper=(geometry, inner.keeper),
                )
            )
    return trees


def _of_reference(reference: Any) -> list[Standing]:
    if isinstance(reference, bpy.types.Object):
        return standings(reference)
    if reference is None:
        return []
    if isinstance(reference, bpy.types.ID):
        raise NeedsIterator  # a collection: what of it is visible is Blender's to say
    return _of_geometry(reference, None)


def _alone(mesh: bpy.types.Mesh, source: bpy.types.Object | None, keeper: Any) -> Standing:
    nothing = np.full(1, -1, dtype=np.int64)
    return Standing(mesh, np.eye(4)[None], nothing, nothing, source, keeper)


def _of_cloud(cloud: bpy.types.PointCloud) -> tuple[np.ndarray, Iterator[np.ndarray]]:
    """Transforms of instances (N, 4, 4), and (N,) whose they are, their trees and their species; -1
    where they do not say."""
    columns = read(cloud, "instance_transform", "FLOAT4X4").reshape(-1, 4, 4)
    names = (".reference_index", TREE_KEY, SPECIES_KEY)
    numbers = (read(cloud, name, "INT", missing=-1).astype(np.int64) for name in names)
    return columns.transpose(0, 2, 1).astype(np.float64), numbers  # Blender keeps columns


def _first_known(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.where(first >= 0, first, second).astype(np.int64)


@dataclass(frozen=True)
class InstancedTrees:
    """N trees as they are evaluated.

    source : objects that they are instances of. transform : (N, 3, 4) local to world. index : (N,) which of
    ``source``. tree, species : (N,) int64, -1 where a tree does not say.
    """

    source: tuple[bpy.types.Object, ...]
    transform: np.ndarray
    index: np.ndarray
    tree: np.ndarray
    species: np.ndarray

    def __len__(self) -> int:
        return len(self.index)


def points_mesh(
    name: str,
    count: int,
    position: np.ndarray,
    rotation: np.ndarray,
    scale: np.ndarray,
    variant: np.ndarray,
    tree: np.ndarray,
    species: np.ndarray,
) -> bpy.types.Mesh:
    """The points of N trees, for an object that ``give_instancer`` completes.

    count : how many variants there are. position : (N, 3) metres. rotation : (N,) radians about the
    vertical. scale : (N,) size factors. variant : (N,) number of an object in the library by the order of
    names. tree, species : (N,) numbers that sensors report.

    Raises
    ------
    SpecError : a size factor is not above 0, a place is not finite, a variant is not there.
    """
    _refuse(~(np.isfinite(scale) & (scale > 0)), scale, tree, "has the size factor", "above 0")
    _refuse(~np.isfinite(position).all(axis=1), position, tree, "stands at", "finite")
    _refuse(~np.isfinite(rotation), rotation, tree, "is turned by", "finite")
    _refuse((variant < 0) | (variant >= count), variant, tree, "is variant", f"0 to {count - 1}")
    measures = {"position": position, ROTATION: rotation, SCALE: scale}
    numbers = {VARIANT: variant, TREE_KEY: tree, SPECIES_KEY: species}
    data = mesh_of_points(name, measures | numbers)
    data.update()
    return data


def ranks(names: Sequence[str], others: Sequence[str]) -> np.ndarray:
    """Place of each of ours in a library where ``others`` are too, as geometry nodes count
    them."""
    order = sorted([*names, *others], key=natural)
    return np.array([order.index(name) for name in names], dtype=np.int64)


def natural(name: str) -> list[str | int]:
    """A key to sort by as Blender does: numbers by their size, letters whatever their case."""
    pieces: list[str | int] = list(re.split(r"([0-9]+)", name.lower()))
    pieces[1::2] = [int(number) for number in pieces[1::2]]
    return pieces


def library_of(scene: bpy.types.Scene, name: str) -> list[bpy.types.ID]:
    """Variants or stand-ins of a scene by their number, as geometry nodes count them."""
    home = find_part(scene, name)
    blocks = (*home.objects, *home.children) if home is not None else ()
    return sorted(blocks, key=lambda block: natural(block.name))


def read_points(obj: bpy.types.Object) -> InstancedTrees:
    """The trees of an evaluated object; none where its modifiers put none."""
    geometry = obj.evaluated_geometry() if has_nodes(obj) else None
    points = geometry.instances_pointcloud() if geometry is not None else None
    if points is None or not len(points.points):  # 4.5 gives no columns where there is no row
        empty = np.empty(0, dtype=np.int64)
        return InstancedTrees((), np.empty((0, 3, 4)), empty, empty, empty)
    local, numbers = _of_cloud(points)
    world = np.array(obj.matrix_world, dtype=np.float64)
    return InstancedTrees(tuple(geometry.instance_references()), (world @ local)[:, :3], *numbers)


def _refuse(bad: np.ndarray, values: np.ndarray, tree: np.ndarray, what: str, must: str) -> None:
    if bad.any():
        first = int(np.argmax(bad))
        raise SpecError("build", f"tree {tree[first]} {what} {values[first]}; it must be {must}")


NAME = "Forest Sensing, for a moment"


def evaluated_transforms(
    position: np.ndarray, rotation: np.ndarray, scale: np.ndarray
) -> np.ndarray:
    """(N, 3, 4) float64 that hold Blender's float32: local to world of N trees.

    position : (N, 3) metres. rotation : (N,) radians about the vertical. scale : (N,) size factors.

    Raises
    ------
    SpecError : a size factor is not above 0, or a place is not finite.
    """
    count = len(position)
    if not count:
        return np.empty((0, 3, 4))
    number, zero = np.arange(count), np.zeros(count, dtype=np.int64)
    scene = bpy.data.scenes.new(NAME)
    try:
        with all_or_nothing(always=True):
            points = points_mesh(NAME, 1, position, rotation, scale, zero, number, zero)
            single = bpy.data.meshes.new(NAME)
            single.vertices.add(1)
            obj, library = bpy.data.objects.new(NAME, points), bpy.data.collections.new(NAME)
            library.objects.link(bpy.data.objects.new(NAME, single))
            scene.collection.objects.link(obj)
            give_instancer(obj, library, library, light=False)
            layer = scene.view_layers[0]
            layer.update()
            placed = read_points(obj.evaluated_get(layer.depsgraph))
    finally:
        bpy.data.scenes.remove(scene)
    return placed.transform[np.argsort(placed.tree)]


STOOD_KEY = "forest_stood"  # of a tree: x, y, rotation, scale, variant, diameter; of a collection: x, y, ...
NEAR = 1e-3  # metres, and share of a size: less is no change
COARSE = 1000  # variants from this number on are coarse ones of the same tree (``sensing/detail``)


@dataclass(frozen=True)
class StoodTree:
    """A tree of a forest: its planting by name, where it was planted, and how it stands now.

    planted, place : x and y, metres. rotation : radians. diameter : 1.3 m up, metres, where it was to have
    one, else 0. obj : its object, None where it is a point.
    """

    label: str
    planted: tuple[float, float]
    place: tuple[float, float]
    rotation: float
    scale: float
    variant: int
    diameter: float
    was: tuple[float, float]  # rotation and scale as planted
    obj: bpy.types.Object | None = None

    @property
    def is_changed(self) -> bool:
        """Return whether it stands otherwise than it was planted."""
        far = max(NEAR, 1e-6 * max(map(abs, self.planted)))
        moved = max(abs(a - b) for a, b in zip(self.place, self.planted, strict=True)) > far
        turn = abs((self.rotation - self.was[0] + np.pi) % (2 * np.pi) - np.pi)
        return bool(moved or turn > NEAR or abs(self.scale / self.was[1] - 1) > NEAR)


def told_of_tree(forest: GrownForest, tree: int) -> list[float]:
    """Record, on the object of a tree, of how it was planted."""
    stand, wanted = forest.stand, forest.wanted
    diameter = 0.0 if wanted is None or not np.isfinite(wanted[tree, 0]) else wanted[tree, 0]
    place = stand.position[tree, :2].tolist()
    size = [float(stand.rotation[tree]), float(stand.scale[tree])]
    return [*place, *size, float(stand.variant[tree] % COARSE), float(diameter)]


def note_change(tree: StoodTree, variant: int) -> None:
    """Have a tree that is an object stand where it does by plan, as this variant."""
    if tree.obj is None:
        return
    stands = [*tree.place, tree.rotation, tree.scale, float(variant), tree.diameter]
    _replace(tree, list(tree.place))
    tree.obj[STOOD_KEY] = stands


def forget_tree(tree: StoodTree) -> None:
    """Delete the object of a tree, which its planting misses no more."""
    if tree.obj is not None:
        _replace(tree, [])
        bpy.data.objects.remove(tree.obj)


def _replace(tree: StoodTree, place: list[float]) -> None:
    """Have collections say another place of a tree, or none."""
    assert tree.obj is not None
    for home in tree.obj.users_collection:
        told = np.reshape(list(home.get(STOOD_KEY, ())), (-1, 2)).tolist()
        if [*tree.planted] in told:
            told.remove([*tree.planted])
            home[STOOD_KEY] = [z for xy in told for z in xy] + place


def stood_trees(scene: bpy.types.Scene) -> list[StoodTree]:
    """Return the trees of a scene's forest that stand there."""
    things = by_role(obj for obj in within_reach(scene) if obj.type == "MESH")
    stood = [_of_object(role, obj) for role, obj in things.items() if STOOD_KEY in obj]
    if POINTS_ROLE in things:
        stood += _of_points(scene, things[POINTS_ROLE])
    return stood


def deleted_trees(scene: bpy.types.Scene) -> dict[str, list[tuple[float, float]]]:
    """Places of planted trees that are objects and were deleted, by planting.

    Of a planting without any tree left nothing is said: it was cleared away, to be grown anew.
    """
    left: dict[str, set[tuple[float, float]]] = {}
    for obj in bpy.data.objects:  # renamed and unlinked ones too, not those of a copied scene
        here = not obj.users_scene or scene in obj.users_scene
        if here and STOOD_KEY in obj and TREE_KEY in obj and obj.users:
            label = str(obj.get(ROLE_KEY, "")).removeprefix(f"{TREES}/").rpartition(" ")[0]
            left.setdefault(label, set()).add(tuple(obj[STOOD_KEY][:2]))
    if find_part(scene, TREES) is None:
        return {}
    gone = {}
    for home in groves(scene):
        label = str(home.get(ROLE_KEY, "")).removeprefix(f"{TREES}/")
        places = np.reshape(list(home.get(STOOD_KEY, ())), (-1, 2)).tolist()
        if label in left:
            gone[label] = [(x, y) for x, y in places if (x, y) not in left[label]]
    return gone


def _of_object(role: str, obj: bpy.types.Object) -> StoodTree:
    x, y, turned, size, variant, diameter = obj[STOOD_KEY]
    label = role.removeprefix(f"{TREES}/").rpartition(" ")[0]
    tied = obj.parent or obj.constraints or obj.animation_data
    place, rotation, scale = (x, y), turned, size
    matrix = np.array(obj.matrix_basis, dtype=float)
    volume = float(np.linalg.det(matrix[:3, :3]))
    if not tied and volume > 0:
        place = float(matrix[0, 3]), float(matrix[1, 3])
        rotation, scale = float(np.arctan2(matrix[1, 0], matrix[0, 0])), float(np.cbrt(volume))
    diameter *= scale / size
    was = turned, size
    return StoodTree(label, (x, y), place, rotation, scale, int(variant), diameter, was, obj)


def _of_points(scene: bpy.types.Scene, obj: bpy.types.Object) -> list[StoodTree]:
    library = library_of(scene, VARIANTS)
    roles = [str(b.get(ROLE_KEY, "")).removeprefix(f"{VARIANTS}/") for b in library]
    places = read(obj.data, "position", "FLOAT_VECTOR")
    if any(name not in obj.data.attributes for name in (ROTATION, SCALE, VARIANT)):
        return []
    kinds = {ROTATION: "FLOAT", SCALE: "FLOAT", VARIANT: "INT"}
    columns = [read(obj.data, name, kind).tolist() for name, kind in kinds.items()]
    stood = []
    rows = zip(places.tolist(), *columns, strict=True)
    for (x, y, _), turned, size, rank in rows:
        label, _, number = roles[rank].rpartition(".") if rank < len(roles) else ("", "", "")
        if number.isdigit():
            same = (x, y), (x, y), turned, size, int(number) % COARSE
            stood.append(StoodTree(label, *same, 0.0, (turned, size)))
    return stood
