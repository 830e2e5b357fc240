"""The evaluated scene to arrays: every instance of every object that evaluates to faces.

Modifiers, collection instances, geometry nodes, curves, text and metaballs are all seen as Blender shows
them; what is hidden is not. Meshes that several instances share are read once. Custom properties of
objects say more: ``forest_tree`` and ``forest_species`` number trees, ``forest_ignored`` keeps an object
from all sensors, ``forest_reflectance`` and what makes a mirror, glass or water (``optics_of``) are for
LiDAR, of a material, too. Trees from an asset library, whose mesh says so, are numbered after all
others, by the names of their objects. What was read is kept until Blender reports any change, or custom
properties say something else, which it does not report. A mesh that is read again and holds what it held is
the same ``TriMesh`` as before, with all that was made of it.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable, Container, Hashable
from dataclasses import fields
from typing import Any, TypeVar
from weakref import WeakValueDictionary

import bpy
import numpy as np

from ...base.kept import digest
from ...base.trimesh import TriMesh
from ...growth.mesh.leaves import separate_leaves
from ...sensing.rays.geometry import SceneGeometry
from ...sensing.rays.tracks import SceneSample, Shape
from ...spec import POLISHED, Polished, property_of
from ..scene.attributes import read
from ..scene.instances import (
    ASSET_KEY,
    IGNORED_KEY,
    REFLECTANCE_KEY,
    SOLID_TYPES,
    SPECIES_KEY,
    TREE_KEY,
    NeedsIterator,
    Standing,
    has_duplis,
    has_nodes,
    standings,
)
from ..scene.layout import CLOUD_KEY
from ..scene.meshes import from_mesh

KIND_KEY, *NUMBER_KEYS = (property_of(field.name) for field in fields(Polished))
PROPERTIES = (IGNORED_KEY, TREE_KEY, SPECIES_KEY, REFLECTANCE_KEY, KIND_KEY, *NUMBER_KEYS)
NO_OPTICS = (np.nan, np.nan, np.nan, np.nan)
Optics = tuple[float, float, float, float]


def optics_of(*places: bpy.types.ID) -> Optics:
    """Kind and numbers of a mirror, glass or water, of the first of an object's places that says one.

    Returns
    -------
    kind as a number of ``spec.POLISHED``, -1 where the word is none of them; index, share and extinction (of
    a retro-reflector its gain), NaN where they are not said. All are NaN where no place says anything.
    """
    for place in places:
        kind = place.original.get(KIND_KEY)
        if isinstance(kind, str) and kind:
            said = [place.original.get(key) for key in NUMBER_KEYS]
            index, share, extinction, gain = (
                float(value) if isinstance(value, (int, float)) else np.nan for value in said
            )
            extinction = gain if kind == "retro" else extinction
            number = POLISHED.index(kind) if kind in POLISHED else -1
            return float(number), index, share, extinction
    return NO_OPTICS


def read_scene(depsgraph: bpy.types.Depsgraph) -> SceneGeometry:
    """Read what an evaluated depsgraph holds; the same object again as long as nothing changes."""
    return kept(depsgraph, _read)


def read_sample(
    depsgraph: bpy.types.Depsgraph, changing: Container[str], known: dict[str, TriMesh]
) -> SceneSample:
    """Read where instances stand, in the order of ``read_scene``, and the shapes of objects of these names.

    known : meshes by what tells their triangles, filled on.
    """
    found = _Found(changing, known)
    scene = _read(depsgraph, found)
    return SceneSample(
        scene.transform,
        scene.object_name,
        scene.object_index,
        scene.mesh_index,
        found.shapes,
        found.sources,
    )


def _read(depsgraph: bpy.types.Depsgraph, reading: _Found | None = None) -> SceneGeometry:
    reading = _Found() if reading is None else reading
    by_nodes = set()
    plain = []
    shown = f"show_instancer_for_{'viewport' if depsgraph.mode == 'VIEWPORT' else 'render'}"
    iterate = any(  # it instances otherwise than by nodes, or is hidden and its instances are not
        has_duplis(obj) or not getattr(obj, shown)
        for obj in depsgraph.ids
        if isinstance(obj, bpy.types.Object)
    )
    for obj in depsgraph.objects:
        if not has_nodes(obj):
            plain.append(obj)
            continue
        try:
            stands = standings(obj)
        except NeedsIterator:
            iterate = True
            continue
        by_nodes.add(obj.name_full)
        for standing in stands:
            reading.add_many(standing, obj)
    if not iterate:
        for obj in plain:
            if obj.type == "MESH":
                reading.add(obj.data, obj, obj, obj.matrix_world)
            elif obj.type in SOLID_TYPES:
                for standing in standings(obj):
                    reading.add_many(standing, obj)
        return reading.scene()
    for instance in depsgraph.object_instances:
        obj = instance.object
        # What is no mesh itself, as a curve or a text, comes a second time as the mesh it evaluates to.
        if obj.type != "MESH" or not instance.show_self:
            continue
        owner = instance.parent if instance.is_instance and instance.parent else obj
        if owner.name_full not in by_nodes:
            reading.add(obj.data, obj, owner, instance.matrix_world)
    return reading.scene()


class _Found:
    """Meshes found so far, each once, and instances, one by one and by the thousand.

    changing, known : as of ``read_sample``, which reads no other meshes than these shapes. shapes : of them,
    by the numbers of their meshes.
    """

    def __init__(
        self, changing: Container[str] = (), known: dict[str, TriMesh] | None = None
    ) -> None:
        self._changing, self._known = changing, known
        self.shapes: dict[int, Shape] = {}
        self._count = 0  # of meshes
        self._number_of: dict[int, int] = {}
        self._meshes: list[tuple] = []  # and what each says of itself, see ``_number``
        self._names: dict[str, int] = {}
        self._single: list[tuple] = []
        self._many: list[tuple] = []
        self._keepers: list[Any] = []

    def add(
        self, mesh: bpy.types.Mesh, obj: bpy.types.Object, owner: bpy.types.Object, matrix: Any
    ) -> None:
        """One instance of an object's mesh, of which ``owner`` is the reason."""
        if _says(owner, obj, IGNORED_KEY, False):
            return
        number = self._number(mesh, obj, obj.name_full)
        if number < 0:
            return
        self._single.append(
            (
                number,
                [row[:] for row in matrix[:3]],
                self._names.setdefault(owner.name, len(self._names)),
                _says(owner, obj, TREE_KEY, -1),
                _says(owner, obj, SPECIES_KEY, -1),
                _says(owner, obj, REFLECTANCE_KEY, np.nan),
                optics_of(owner, obj),
                obj.name_full,
            )
        )

    def add_many(self, standing: Standing, owner: bpy.types.Object) -> None:
        """All instances of a mesh that the nodes of ``owner`` make."""
        self._keepers.append(standing.keeper)  # its meshes tell each other apart by where they are
        source = standing.source or owner
        if _says(owner, source, IGNORED_KEY, False):
            return
        name = "" if standing.source is None else standing.source.name_full
        number = self._number(standing.mesh, standing.source, name, owner.name_full)
        if number < 0:
            return
        count = len(standing.transform)
        world = np.array(owner.matrix_world) @ standing.transform
        tree, species = (
            np.where(own >= 0, own, _says(owner, source, key, -1))
            for own, key in ((standing.tree, TREE_KEY), (standing.species, SPECIES_KEY))
        )
        reflectance = _says(owner, source, REFLECTANCE_KEY, np.nan)
        self._many.append(
            (
                np.full(count, number),
                world[:, :3],
                np.full(count, self._names.setdefault(owner.name, len(self._names))),
                tree,
                species,
                np.full(count, reflectance),
                np.tile(optics_of(owner, source), (count, 1)),
                name,
            )
        )

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the objects whose meshes instances have; "" of those that nodes made."""
        of_many = (name for number, *_, name in self._many for _ in number)
        return *(single[-1] for single in self._single), *of_many

    def scene(self) -> SceneGeometry:
        """All of it as arrays."""
        columns: list[Any] = list(zip(*self._single, strict=True)) or [[]] * 7
        kinds = (np.int64, np.float64, np.int64, np.int64, np.int64, np.float64, np.float64)
        shapes = ((-1,), (-1, 3, 4), (-1,), (-1,), (-1,), (-1,), (-1, 4))
        index, transform, name, tree, species, reflectance, optics = (
            np.concatenate(
                [np.array(column, dtype=kind).reshape(shape), *(many[k] for many in self._many)],
                dtype=kind,
            )
            for k, (column, kind, shape) in enumerate(zip(columns, kinds, shapes, strict=False))
        )
        of_meshes: Any = zip(*self._meshes, strict=True) if self._meshes else [()] * 5
        meshes, slots, slot_optics, assets, materials = of_meshes
        if any(assets):
            kinds = [asset.partition("#")[0] for asset in assets]
            number = {kind: k for k, kind in enumerate(sorted(set(kinds) - {""}))}
            of_mesh = np.array([number.get(kind, -1) for kind in kinds], dtype=np.int64)
            ours = of_mesh[index] >= 0
            new = np.flatnonzero(ours & (tree < 0))
            by_name = np.argsort(np.array(list(self._names))[name[new]], kind="stable")
            tree[new[by_name]] = tree.max(initial=-1) + 1 + np.arange(len(new))
            new = np.flatnonzero(ours & (species < 0))
            species[new] = species.max(initial=-1) + 1 + of_mesh[index[new]]
        return SceneGeometry(
            meshes=meshes,
            transform=transform,
            mesh_index=index,
            object_name=tuple(self._names),
            tree=tree,
            species=species,
            object_index=name,
            reflectance=reflectance,
            slot_reflectance=slots,
            asset=assets,
            slot_names=materials,
            optics=None if np.isnan(optics[:, 0]).all() else optics,
            slot_optics=slot_optics if any(np.isfinite(one).any() for one in slot_optics) else (),
        )

    def _number(self, mesh: bpy.types.Mesh, obj: bpy.types.Object | None, *names: str) -> int:
        """Number of this among the unique meshes, -1 for one without faces. names : of objects by whose
        change its shape changes."""
        key = mesh.as_pointer()
        if key not in self._number_of:
            number = self._number_of[key] = self._count if len(mesh.polygons) else -1
            self._count += number >= 0
            if number >= 0 and self._known is not None:
                if any(name in self._changing for name in names):
                    self.shapes[number] = _shape(mesh, self._known)
            elif number >= 0:
                shares = [m.original.get(REFLECTANCE_KEY) if m else None for m in mesh.materials]
                shares = [s if isinstance(s, int | float) else np.nan for s in shares]
                slots = [optics_of(m) if m else NO_OPTICS for m in mesh.materials]
                # which tree of a library a mesh is, also one that modifiers have worked on; empty for others
                blocks = (mesh, obj.original.data) if obj is not None else (mesh,)
                said = (block.get(ASSET_KEY) for block in blocks if isinstance(block, bpy.types.ID))
                told = (
                    _known(_triangles_of(mesh, obj)),
                    np.array(shares or [np.nan], dtype=np.float64),
                    np.array(slots or [NO_OPTICS]),
                    next((asset for asset in said if isinstance(asset, str)), ""),
                    tuple(m.name if m else "" for m in mesh.materials) or ("",),
                )
                self._meshes.append(told)
        return self._number_of[key]


def _shape(mesh: bpy.types.Mesh, known: dict[str, TriMesh]) -> Shape:
    """Points of a mesh, and its triangles, of ``known`` where they are."""
    corners = read(mesh, ".corner_vert", "INT", "CORNER")
    starts = np.empty(len(mesh.polygons), dtype=np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    told = digest([corners, starts, len(mesh.vertices)])
    if told not in known:
        known[told] = separate_leaves(from_mesh(mesh))
    return Shape(read(mesh, "position", "FLOAT_VECTOR"), known[told])


def _triangles_of(mesh: bpy.types.Mesh, obj: bpy.types.Object | None) -> TriMesh:
    """A mesh as triangles, read from a copy of it where there is an object to make one.

    Blender takes a look at an array for a change of it: what an evaluated mesh shares with its original is
    then held twice for good, and what a copy shares until it is cleared.
    """
    own = obj is not None and obj.type == "MESH" and obj.is_evaluated
    if not own or obj.data.as_pointer() != mesh.as_pointer():
        return from_mesh(mesh)
    try:
        return from_mesh(obj.to_mesh())
    finally:
        obj.to_mesh_clear()


_meshes: WeakValueDictionary[str, TriMesh] = WeakValueDictionary()  # by what they hold


def _known(mesh: TriMesh) -> TriMesh:
    """A mesh that was read, with its leaves apart; where one that holds the same is in use, that one."""
    arrays = mesh.vertices, mesh.triangles, mesh.part, mesh.leaf, mesh.material
    told = digest([len(mesh.vertices), len(mesh.triangles), *arrays])
    return _meshes.get(told) or _meshes.setdefault(told, separate_leaves(mesh))


def _says(owner: bpy.types.Object, obj: bpy.types.Object, key: str, otherwise: Any) -> Any:
    """A custom property of the owner, else of the thing itself; what is no number does not count.

    The originals are asked: what a script sets reaches evaluated objects with the next change of another
    kind.
    """
    said = (place.original.get(key) for place in (owner, obj))
    return next((value for value in said if isinstance(value, bool | int | float)), otherwise)


T = TypeVar("T")

_kept: dict[Hashable, Any] = {}
lasting: dict[str, Any] = {}  # what is kept over changes, and let go of with the file


def kept(depsgraph: bpy.types.Depsgraph, make: Callable[..., T], *settings: Hashable) -> T:
    """``make(depsgraph, *settings)``, or what it made of this scene before if nothing changed since."""
    for name, handler in WATCHED:
        handlers = getattr(bpy.app.handlers, name)
        if handler not in handlers:
            handlers.append(handler)
    view = (depsgraph.scene.session_uid, depsgraph.view_layer.name, depsgraph.mode)
    # what sensors heed among the custom properties of objects and materials
    blocks = (*bpy.data.objects, *bpy.data.materials)
    said = [(block.session_uid, *map(block.get, PROPERTIES)) for block in blocks]
    key = (*view, make, *settings)
    if key not in _kept or _kept[key][0] != said:
        _kept[key] = said, make(depsgraph, *settings)
    return _kept[key][1]


def forget(_scene: Any = None, depsgraph: Any = None, *_: Any) -> None:
    """Drop what holds as long as nothing changes; the handler of every change."""
    _kept.clear()
    for update in () if depsgraph is None else depsgraph.updates:
        obj = update.id.original
        if isinstance(obj, bpy.types.Collection):  # something came or went
            gone = "solids" in lasting and lasting["solids"] != solids_in(depsgraph.scene)
        else:
            gone = (update.is_updated_geometry or update.is_updated_transform) and is_solid(obj)
        if gone:
            lasting["changed"] = True


def is_solid(obj: bpy.types.ID) -> bool:
    """Return whether sensors may meet something, as far as is known without its geometry."""
    of_scene = isinstance(obj, bpy.types.Object) and obj.type in SOLID_TYPES
    return of_scene and not (CLOUD_KEY in obj or obj.get(IGNORED_KEY))


def solids_in(scene: bpy.types.Scene) -> int:
    """Number of objects of a scene that sensors may meet."""
    return sum(map(is_solid, scene.objects))


def ready() -> set[str]:
    """Return kinds of sensors for which all is set up, as far as is known without a look at the scene."""
    return set() if lasting.get("changed", True) else lasting["observer"].ran


def close(*_: Any) -> None:
    """Drop also what lasts; the handler of files that are closed."""
    forget()
    lasting.clear()


def unwatch() -> None:
    """Drop all, and take the handlers back."""
    close()
    for name, handler in WATCHED:
        handlers = getattr(bpy.app.handlers, name)
        if handler in handlers:
            handlers.remove(handler)


WATCHED = (  # Blender's lists of whom to tell of a change, and who is told
    *((f"{name}_post", forget) for name in ("depsgraph_update", "frame_change", "undo", "redo")),
    ("load_pre", close),
)
atexit.register(unwatch)  # with a handler of ours left, bpy 4.5 does not end
