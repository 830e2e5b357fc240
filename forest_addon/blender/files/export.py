"""The scene as a .blend and the forest as a .glb or USD file, each whole or not there; meshes of a tree read.

In a .glb, trees that are objects are nodes that share meshes; trees that are points become one node a
variant with a list of places (``formats.glb``), which Blender's own exporter cannot write with their
numbers and without a node for each first. The ground of both ends a little beyond the trees, so that a
viewer that frames all shows the forest.

``read_factory_settings`` is called nowhere: in a Blender of a user it switches every extension off, and
Blender then removes the packages that they brought, from under open windows too. Scripts in a user's
file never run by us, whatever the preferences say. A forest in the wind is baked as Alembic or USD, a
transform a piece and frame.

Meshes of a tree come from PLY, OBJ and glTF files through Blender's own importers: a file is opened in a
scene of its own, its meshes are read with their places in the world, in metres and along the file's own axes,
and everything that came with it is removed again: the user's scene, selection and data stay as they were.
None of these formats runs a script.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from ...formats.atomic import replacing
from ...formats.foreign import guarded, refuse_coarse
from ...formats.glb import Copies, instance_nodes, refuse_broken_gltf
from ...formats.helios.parts import read_obj
from ...formats.ply import refuse_broken_ply
from ...formats.stl import StlError, read_stl, refuse_broken_stl
from ...growth.own_tree.pieces import Group
from ...spec import Scene, SpecError
from ..scene.attributes import places_of, world_places_of
from ..scene.instances import read_points
from ..scene.layout import GROUND_NAME, PART_KEY, TREES, objects_in, root
from ..scene.materials import in_one_colour
from ..scene.nodes import in_full

STARTUP = ("Cube", "Camera", "Light")  # what Blender itself puts into a new file


IMPORTERS = {  # what opens a file of each ending, among Blender's operators
    ".blend": ("wm", "open_mainfile"),
    ".glb": ("import_scene", "gltf"),
    ".gltf": ("import_scene", "gltf"),
    ".obj": ("wm", "obj_import"),
    ".ply": ("wm", "ply_import"),
    ".stl": ("wm", "stl_import"),
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), ("wm", "usd_import")),
}
AS_WRITTEN: dict[
    str, dict[str, Any]
] = {  # options by which meshes of a tree keep the axes of their file
    ".ply": {"forward_axis": "Y", "up_axis": "Z"},
    ".obj": {"forward_axis": "Y", "up_axis": "Z", "use_split_objects": True},
    ".gltf": {"import_shading": "FLAT"},
    ".glb": {"import_shading": "FLAT"},
}


BEFORE = {  # importers pass over what is wrong in a file, and say of a missing one what it is not
    ".obj": read_obj,
    ".ply": refuse_broken_ply,
    ".stl": refuse_broken_stl,
    **dict.fromkeys((".glb", ".gltf"), refuse_broken_gltf),
}


def empty_file() -> None:
    """A new file without anything in it; preferences and extensions stay as they are."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


@guarded("a scene")
def open_file(path: Path) -> float:
    """Open a .blend file without its windows, and without running what scripts it has, or a mesh file in an
    empty scene, by Blender's importer. What counts in another unit is made metres; return metres of a unit.

    Raises
    ------
    SpecError : an ending that is not known; Blender cannot open it; a mesh lost its shape at map coordinates.
    """
    ending = path.suffix.lower()
    if ending not in IMPORTERS:
        raise SpecError(str(path), f"must end in one of {', '.join(IMPORTERS)}")
    if ending == ".blend":
        _import(path, load_ui=False, use_scripts=False)
    else:
        _import(path, anew=True)
        # Single precision may have rounded meshes away, or moved them.
        things = [t for t in bpy.context.scene.objects if t.type == "MESH" and t.data.polygons]
        boxes = [np.array(obj.bound_box) for obj in things]
        turned = [np.array(obj.matrix_world)[:3] for obj in things]
        placed = [box @ m[:, :3].T + m[:, 3] for box, m in zip(boxes, turned, strict=True)]
        for corners in (*(places_of(obj.data) for obj in things), placed) if things else ():
            refuse_coarse(path, np.array(corners))
    units = bpy.context.scene.unit_settings
    metres = float(units.scale_length)
    if metres != 1:
        root = bpy.data.objects.new("metres of a unit", None)
        root.scale = 3 * [metres]
        for obj in bpy.context.scene.objects:
            if obj.parent is None:
                obj.parent = root
        bpy.context.scene.collection.objects.link(root)
        units.scale_length = 1.0
        bpy.context.view_layer.update()
    return metres


def _import(path: Path, anew: bool = False, **options: Any) -> None:
    """Have Blender's operator for such files open one; anew : in an empty scene."""
    ending = path.suffix.lower()
    BEFORE.get(ending, Path.stat)(path)
    if anew:
        empty_file()
    group, operator = IMPORTERS[ending]
    getattr(getattr(bpy.ops, group), operator)(filepath=str(path.resolve()), **options)


def open_for(scene: Scene, folder: Path) -> None:
    """Open the file that a scene starts from; without one, stay in the file that is open, but for the cube,
    camera and lamp that ``bpy`` as a module starts with.

    Raises
    ------
    SpecError : Blender cannot open it; says why.
    """
    if scene.blend:
        path = folder / scene.blend
        try:
            open_file(path)
        except SpecError as problem:
            raise SpecError("blend", f"{path} {problem.problem}") from None
    elif getattr(bpy.app, "module", False) and not bpy.data.filepath:
        things = [bpy.data.objects.get(name) for name in STARTUP]
        if all(things) and len(bpy.data.objects) == len(STARTUP):
            bpy.data.batch_remove(things)


BESIDE = 0.25  # of the trees' extent, that the ground goes on beyond them
LEAST_BESIDE = 5.0  # metres
NUMBERS = {"_TREE": "tree", "_SPECIES": "species"}


def save_blend(path: str | os.PathLike[str]) -> None:
    """Save a copy of the whole file, compressed.

    Raises
    ------
    OSError : Blender could not write it.
    """
    with replacing(path) as partial, _said_of(path):
        bpy.ops.wm.save_as_mainfile(
            filepath=str(partial), copy=True, compress=True, check_existing=False
        )


def export_glb(scene: bpy.types.Scene, path: str | os.PathLike[str]) -> None:
    """Export trees and ground as binary glTF; trees of one variant share a mesh.

    Trees that are points carry their numbers as the attributes ``_TREE`` and ``_SPECIES`` of their nodes,
    trees that are objects as custom properties.

    Raises
    ------
    OSError : the exporter could not write it.
    ValueError : nodes that were edited instance something that is no object; says what to do.
    """
    wanted = _of_parts(scene, TREES, GROUND_NAME)
    with in_full(bpy.context.evaluated_depsgraph_get()), _stand_ins(scene, wanted) as copies:
        bare = {obj for obj in wanted if obj.type == "MESH" and not obj.data.polygons}
        with replacing(path) as partial, _trimmed(scene, wanted) as trimmed:
            shown = (trimmed - bare) | {scene.objects[name] for name in copies}
            with _selected(shown), in_one_colour(), _said_of(path):
                bpy.ops.export_scene.gltf(
                    filepath=str(partial),
                    export_format="GLB",
                    use_selection=True,
                    export_extras=True,
                    export_apply=False,
                    export_animations=False,
                    export_attributes=False,
                    export_texcoords=False,
                    export_yup=True,
                )
            if copies:
                instance_nodes(partial, copies)


def export_usd(scene: bpy.types.Scene, path: str | os.PathLike[str]) -> None:
    """Export trees and ground as USD (.usdc, .usda, .usdz), Z up, metres; copies of a tree are instances.

    Raises
    ------
    OSError : the exporter could not write it.
    """
    wanted = _of_parts(scene, TREES, GROUND_NAME)
    with (
        in_full(bpy.context.evaluated_depsgraph_get()),
        replacing(path) as partial,
        _trimmed(scene, wanted) as shown,
        _selected(shown),
        in_one_colour(),
        _said_of(path),
    ):
        bpy.ops.wm.usd_export(
            filepath=str(partial),
            check_existing=False,
            selected_objects_only=True,
            export_animation=False,
            use_instancing=True,
            evaluation_mode="RENDER",
            export_lights=False,
            convert_world_material=False,
            convert_orientation=False,
        )


def _of_parts(scene: bpy.types.Scene, *parts: str) -> set[bpy.types.Object]:
    """The objects of these parts of the forest."""
    top = root(scene)
    return {
        obj
        for child in (top.children if top else ())
        if child.get(PART_KEY) in parts
        for obj in objects_in(child)
    }


@contextmanager
def _trimmed(
    scene: bpy.types.Scene, shown: set[bpy.types.Object]
) -> Iterator[set[bpy.types.Object]]:
    """The same objects, the ground cut off a little beyond the trees."""
    grounds = {t for t in _of_parts(scene, GROUND_NAME) & shown if t.type == "MESH"}
    corners = [
        np.array([t.matrix_world @ Vector(corner) for corner in t.bound_box])
        for t in shown - grounds
        if t.type == "MESH" and t.data.vertices  # of trees that are points, their places
    ]
    if not corners or not grounds:
        yield shown
        return
    every = np.concatenate(corners)[:, :2]
    low, high = every.min(axis=0), every.max(axis=0)
    more = max(BESIDE * float((high - low).max()), LEAST_BESIDE)
    made = [_cut(ground, low - more, high + more) for ground in grounds]
    try:
        for obj in made:
            scene.collection.objects.link(obj)
        yield (shown - grounds) | set(made)
    finally:
        bpy.data.batch_remove([*made, *(obj.data for obj in made)])


def _cut(ground: bpy.types.Object, low: np.ndarray, high: np.ndarray) -> bpy.types.Object:
    """A copy of a ground, what is outside of a rectangle (2,) to (2,) metres in the world cut away."""
    import bmesh  # after bpy, which brings it

    shape = bmesh.new()
    shape.from_mesh(ground.data)
    shape.transform(ground.matrix_world)
    for axis, (edge, side) in [(k, e) for k in (0, 1) for e in ((low, -1.0), (high, 1.0))]:
        normal, place = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        normal[axis], place[axis] = side, float(edge[axis])
        bmesh.ops.bisect_plane(
            shape,
            geom=[*shape.verts, *shape.edges, *shape.faces],
            plane_co=place,
            plane_no=normal,
            clear_outer=True,
        )
    data = bpy.data.meshes.new(ground.data.name)
    shape.to_mesh(data)
    shape.free()
    for material in ground.data.materials:
        data.materials.append(material)
    return bpy.data.objects.new(ground.name, data)


@contextmanager
def _stand_ins(
    scene: bpy.types.Scene, things: set[bpy.types.Object]
) -> Iterator[dict[str, Copies]]:
    """An object at the origin for everything that geometry nodes instance, and by its name the copies."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    made: dict[str, Copies] = {}
    objects = []
    try:
        for obj in sorted(things, key=lambda obj: obj.name):
            placed = read_points(obj.evaluated_get(depsgraph))
            solid = np.abs(np.linalg.det(placed.transform[:, :, :3])) > 0
            for number, source in enumerate(placed.source):
                of_stand_in = solid & (placed.index == number)
                if not of_stand_in.any():
                    continue
                if not isinstance(source, bpy.types.Object) or source.type != "MESH":
                    raise ValueError(
                        f'the nodes of "{obj.name}" instance something that is no mesh object, which a '
                        ".glb cannot share; let them pick mesh objects"
                    )
                stand_in = bpy.data.objects.new(source.name, source.original.data)
                objects.append(stand_in)
                scene.collection.objects.link(stand_in)
                made[stand_in.name] = Copies(
                    name=source.original.data.name,
                    transform=placed.transform[of_stand_in],
                    numbers={
                        key: getattr(placed, name)[of_stand_in] for key, name in NUMBERS.items()
                    },
                )
        yield made
    finally:
        bpy.data.batch_remove(objects)


@contextmanager
def _selected(things: set[bpy.types.Object]) -> Iterator[None]:
    """Select these objects for an exporter; in the end selection, mode and frame are as they were."""
    layer, scene = bpy.context.view_layer, bpy.context.scene
    frame, active = (scene.frame_current, scene.frame_subframe), layer.objects.active
    mode = active.mode if active is not None else "OBJECT"
    before = {obj for obj in layer.objects if obj.select_get()}
    for obj in layer.objects:
        obj.select_set(obj in things)
    try:
        yield
    finally:
        for obj in layer.objects:
            obj.select_set(obj in before)
        if active is not None and active.mode != mode:  # glTF's leaves it
            bpy.ops.object.mode_set(mode=mode)
        if frame != (scene.frame_current, scene.frame_subframe):  # and goes to a whole one
            scene.frame_set(frame[0], subframe=frame[1])


@contextmanager
def _said_of(path: str | os.PathLike[str]) -> Iterator[None]:
    """Have an operator's report in this block say what the system refused, of the path that was asked for.

    Raises
    ------
    OSError : the operator failed.
    """
    try:
        yield
    except RuntimeError as problem:
        text = str(problem).strip()
        for code in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EACCES, errno.EROFS):
            if os.strerror(code) in text:
                raise OSError(code, os.strerror(code), os.fspath(path)) from None
        said = text.splitlines()[-1].removeprefix("Error: ") if text else "Blender failed"
        raise OSError(said) from None


def bake(scene: bpy.types.Scene, path: Path) -> None:
    """Write what the scene's forest shows over its range of frames; in Alembic trees of a variant
    share their meshes.

    Raises
    ------
    OSError : Blender could not write it.
    """
    top = root(scene)
    name = top.name if top is not None else ""
    with replacing(path) as part, _said_of(path):
        if path.suffix.lower() == ".abc":
            bpy.ops.wm.alembic_export(
                filepath=str(part),
                start=scene.frame_start,
                end=scene.frame_end,
                collection=name,
                evaluation_mode="RENDER",
                as_background_job=False,
                use_instancing=True,
            )
        else:
            bpy.ops.wm.usd_export(
                filepath=str(part),
                export_animation=True,
                collection=name,
                evaluation_mode="RENDER",
                use_instancing=False,  # Blender 5.2 refers pieces to themselves otherwise
            )


DRACO = b"KHR_draco_mesh_compression"
COMPRESSED = "this Blender cannot decode its compressed meshes (Draco); export it without"


@guarded("a mesh", key="template")
def read_groups(path: Path) -> list[Group]:
    """The meshes of a file, one group for each object and material.

    Raises
    ------
    SpecError : the file is not there, is no such file, holds no facets, or lost its shape at map coordinates.
    """
    ending = path.suffix.lower()
    if ending not in AS_WRITTEN:
        known = ", ".join((".stl", *AS_WRITTEN))
        raise SpecError("template", f"{path.name} is of no known kind; use {known}")
    with _apart() as scene:
        try:
            _import(path, **AS_WRITTEN[ending])
        except RuntimeError:
            if _is_compressed(path):
                raise SpecError("template", f"{path} cannot be read: {COMPRESSED}") from None
            raise
        groups = [group for obj in scene.objects for group in _groups_of(obj)]
    if ending in (".gltf", ".glb"):  # Blender has turned it to z up
        groups = [Group(g.name, g.material, g.facets @ _Y_TO_Z) for g in groups]
    if not groups:
        problem = f"{path.name} has no facets; export it with its meshes"
        compressed = f"{path} cannot be read: {COMPRESSED}"
        raise SpecError("template", compressed if _is_compressed(path) else problem)
    refuse_coarse(path, np.concatenate([group.facets for group in groups]))
    return groups


def read_parts(wood: Path, leaves: Path | None) -> list[Group]:
    """The meshes of one file, or of two that are wood and leaves whatever names say; STL too."""
    if leaves is None:
        return read_groups(wood)
    return [
        Group(kind, kind, group.facets)
        for kind, path in (("wood", wood), ("leaves", leaves))
        for group in _of_any(path)
    ]


def _of_any(path: Path) -> list[Group]:
    if path.suffix.lower() != ".stl":
        return read_groups(path)
    try:
        return [Group(path.stem, "", read_stl(path))]
    except FileNotFoundError:
        raise SpecError("template", f"there is no file {path}; check the path") from None
    except StlError as problem:
        raise SpecError("template", str(problem)) from None


def _is_compressed(path: Path) -> bool:
    return path.suffix.lower() in (".gltf", ".glb") and DRACO in path.read_bytes()


_Y_TO_Z = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # rows times this: z up back to y up


@contextmanager
def _apart() -> Iterator[bpy.types.Scene]:
    """A scene for a while, current to what is called within; then all new data is removed."""
    before = {data.session_uid for data in _everything()}
    window, current = bpy.context.window, bpy.context.scene
    if bpy.context.mode != "OBJECT":
        raise SpecError("template", "a file cannot be read in this mode; go to Object Mode first")
    scene = bpy.data.scenes.new("tree file")
    try:
        if window is not None:
            window.scene = scene
            yield scene
        else:
            with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
                yield scene
    finally:
        if window is not None:
            window.scene = current
        bpy.data.batch_remove([data for data in _everything() if data.session_uid not in before])


def _everything() -> Iterator[bpy.types.ID]:
    for prop in bpy.data.bl_rna.properties:
        if prop.type == "COLLECTION":
            every = getattr(bpy.data, prop.identifier)
            yield from (d for d in every if isinstance(d, bpy.types.ID) and d.id_type != "LIBRARY")


def _groups_of(obj: bpy.types.Object) -> list[Group]:
    if obj.type != "MESH":
        return []
    mesh = obj.data
    mesh.calc_loop_triangles()
    corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    slot = np.empty(len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("material_index", slot)
    facets = world_places_of(obj, mesh)[corners.reshape(-1, 3)]
    names = [slot.material.name if slot.material else "" for slot in obj.material_slots] or [""]
    slot = np.clip(slot, 0, len(names) - 1)
    return [Group(obj.name, names[number], facets[slot == number]) for number in np.unique(slot)]
