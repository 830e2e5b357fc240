"""A new forest in place of the old one: which objects, meshes and materials stay, which are made, which
go.

A forest says which objects it wants. Each is the object of ours that stands for it already, with other
data and at another place, or a new one; so collections, modifiers, visibility and all else that belongs
to an object stay as the user has them. Those that are wanted no more go. What was prepared before cannot
fail here, so a scene has the old forest or the new one.

A mesh whose shape has not changed since it was made stays, with all that was done to it. A new one wears
the materials of the mesh that stood for the same before, so that whatever was put into a slot stays; a
slot that is empty gets our own material again. Of that there is one for each coat, the bark of a
planting say, which is kept with all edits and only takes the colour that the coat has now.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from itertools import chain
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...base.kept import digest
from ...base.trimesh import TriMesh
from ...growth.truth import MEASURES
from .layout import (
    CLOUD_KEY,
    DATA_KEY,
    LIBRARIES,
    MADE_KEY,
    PARTS,
    POINTS_ROLE,
    ROLE_KEY,
    SHAPE_KEY,
    TREES,
    VARIANTS,
    by_role,
    grove,
    groves,
    is_ours,
    objects_in,
    own,
    part,
    root,
    settle,
    stem,
    within_reach,
)
from .materials import STYLE_KEY, Colour, recolour
from .nodes import VIEW_KEY

WIND = "Wind"  # the collection of what shows trees in the wind, their modifiers and groups
ROW = "wind row"  # of a tree that is a point: its place among those that sway, from 1 on; 0: it stands still
KNOTS = "first knot"
OF_FULL, OF_LIGHT = ("wind first", "wind pieces"), ("wind first light", "wind pieces light")
WIND_COLUMNS = (ROW, KNOTS, *OF_FULL, *OF_LIGHT)  # attributes of points
TOLD_KEY = "forest_told"  # the shape of the mesh that says what its tree measures
OF_SHAPE = {*MEASURES, TOLD_KEY}  # custom properties that another shape does not take over


@dataclass(frozen=True)
class Coat:
    """A material of ours: its name, what makes it, and of what colour if it can have another.

    style : what it is made anew for when that changes (``materials.bark``).
    """

    name: str
    make: Callable[..., bpy.types.Material]
    colour: Colour | None = None
    style: str | None = None


@dataclass(frozen=True)
class KeptStanding:
    """Objects of a scene's forest, their meshes and materials, by what each stands for.

    bare : meshes that stay, and what they are to wear where they wear nothing.
    """

    things: dict[str, bpy.types.Object]
    meshes: dict[str, bpy.types.Mesh]
    materials: dict[str, bpy.types.Material]
    bare: list[tuple[bpy.types.Mesh, list[bpy.types.Material | None]]] = field(default_factory=list)

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> KeptStanding:
        """Read a scene."""
        found = [obj for obj in within_reach(scene) if obj.type == "MESH"]
        things = by_role(found)
        theirs = [obj.data for obj in found]  # a copy may still have what its variant had
        meshes = by_role([*theirs, *(things[role].data for role in sorted(things))])
        worn = chain.from_iterable(mesh.materials for mesh in meshes.values())
        return cls(things, meshes, by_role(material for material in worn if material))

    def first(self, kind: str) -> bpy.types.Mesh | None:
        """The first mesh of a kind, of a planting say; what it stands for is KIND.NUMBER."""
        roles = [role for role in self.meshes if role.rpartition(".")[0] == kind]
        return self.meshes[min(roles)] if roles else None

    def renew(
        self,
        role: str,
        name: str,
        shape: str,
        make: Callable[[], bpy.types.Mesh],
        coats: Sequence[Coat] = (),
        like: bpy.types.Mesh | None = None,
    ) -> bpy.types.Mesh:
        """The mesh that stands for this, or a new one with its materials and custom properties.

        name : what a new one is to be called. shape : its fingerprint; the old one stays if it has the
        same. coats : what it wears where the old one wears nothing. like : a mesh whose materials it
        takes where there is no old one. A mesh that the user gave the object stays.
        """
        obj = self.things.get(role)
        if obj is not None and has_own_mesh(obj):
            return obj.data
        old = self.meshes.get(role)
        worn = self._dress(old or like, coats)
        if old is not None and shape and old.get(SHAPE_KEY) == shape:
            self.bare.append((old, worn))
            return old
        data = own(make(), name)
        data[ROLE_KEY], data[SHAPE_KEY] = role, shape
        for material in worn:
            data.materials.append(material)
        for key, value in old.items() if old else ():
            if key not in data and key not in OF_SHAPE:
                data[key] = value
        return data

    def dress(self, coats: Sequence[Coat]) -> None:
        """Put on what is missing, and give our materials the colours that their coats have now."""
        for data, worn in self.bare:
            for slot, material in enumerate(worn):
                if slot >= len(data.materials):
                    data.materials.append(material)
                elif data.materials[slot] is None:
                    data.materials[slot] = material
        for coat in coats:
            worn = self.materials.get(coat.name)
            if worn and coat.style and worn.get(STYLE_KEY, coat.style) != coat.style:
                coat.make(coat.name, coat.colour, into=worn)
            if coat.colour is not None and coat.name in self.materials:
                recolour(self.materials[coat.name], coat.colour)

    def _dress(
        self, old: bpy.types.Mesh | None, coats: Sequence[Coat]
    ) -> list[bpy.types.Material | None]:
        worn = list(old.materials) if old else []
        worn += [None] * (len(coats) - len(worn))
        for slot, coat in enumerate(coats):
            if worn[slot] is None and coat.name not in self.materials:
                made = own(coat.make(coat.name, *([] if coat.colour is None else [coat.colour])))
                made[ROLE_KEY] = coat.name
                self.materials[coat.name] = made
            worn[slot] = worn[slot] or self.materials[coat.name]
        return worn


def has_own_mesh(obj: bpy.types.Object) -> bool:
    """Return whether an object of ours has a mesh that the user gave it."""
    return bool(obj.get(DATA_KEY) != obj.data.name_full)


def fingerprint(mesh: TriMesh) -> str:
    """A word that only this mesh has."""
    told: list[Any] = []
    for column in fields(mesh):
        values = getattr(mesh, column.name)
        if column.name != "edges" and values is not None:  # edges follow from the triangles
            told += [f"{column.name} {values.dtype} {values.shape}".encode(), values]
    return digest(told)


@dataclass(frozen=True)
class WantedObject:
    """An object that a forest wants.

    part, label : where a new one goes: which part of the forest, and whose trees' collection in it if any.
    role : what it stands for. place : (3, 4) local to world, None where that does not matter.
    says : its custom properties.
    """

    part: str
    role: str
    name: str
    data: bpy.types.Mesh
    label: str = ""
    place: np.ndarray | None = None
    says: dict[str, Any] = field(default_factory=dict)


def put(
    scene: bpy.types.Scene,
    standing: KeptStanding,
    wanted: Sequence[WantedObject],
    labels: Sequence[str],
) -> dict[str, bpy.types.Object]:
    """Make a scene's forest consist of these objects; returns them by what they stand for.

    labels : of plantings whose trees have a collection.
    """
    home_of = {(name, ""): part(scene, name) for name in PARTS}
    home_of |= {(TREES, label): grove(scene, label) for label in labels}
    homes = {root(scene), *home_of.values(), *groves(scene)}
    kept = {w.role: standing.things[w.role] for w in wanted if w.role in standing.things}
    made = {want.data for want in wanted} - {obj.data for obj in kept.values()}

    variants = {t.data for role, t in standing.things.items() if role.startswith(VARIANTS)}
    _clear(homes, set(kept.values()))
    _send_home(kept, wanted, home_of, homes)
    unwanted = set(groves(scene)) - set(home_of.values())
    heir = part(scene, TREES)
    for home in unwanted:
        if not is_ours(home):
            continue
        for mine, others in ((heir.objects, home.objects), (heir.children, home.children)):
            known = set(mine)
            for block in others:
                if block not in known and block not in unwanted:
                    mine.link(block)
        bpy.data.collections.remove(home)
    things, given = {}, []
    for want in wanted:
        obj = kept.get(want.role)
        if obj is None:
            obj = bpy.data.objects.new(want.name, want.data)
            home_of[want.part, want.label].objects.link(obj)
            given.append(obj)
        elif not has_own_mesh(obj) or (want.part == TREES and obj.data in variants):
            obj.data = want.data
            given.append(obj)
        things[want.role] = obj
    # Meshes of ours that nothing uses any more go, with the materials that only they used.
    unused = [mesh for mesh in bpy.data.meshes if not mesh.users and is_ours(mesh)]
    worn = {material for mesh in unused for material in mesh.materials if material}
    bpy.data.batch_remove(unused)
    bpy.data.batch_remove([coat for coat in worn if not coat.users and is_ours(coat)])
    for mesh in made:
        settle(mesh)
    for obj in given:
        obj[DATA_KEY] = obj.data.name_full
    for want in wanted:
        _tell(things[want.role], want)
    return things


def _clear(homes: set[bpy.types.Collection], kept: set[bpy.types.Object]) -> None:
    """Remove what of ours is wanted no more; what is in a collection of the user's too stays in that.
    Points that were found in the forest of before stay until their sensor runs again.

    What is nowhere any more, its collection removed, goes as well: it would keep its name from others.
    """
    every = (*bpy.data.collections, *(scene.collection for scene in bpy.data.scenes))
    theirs = {obj for home in every if home not in homes for obj in home.objects}
    doomed = {t for t in bpy.data.objects if not t.users and ROLE_KEY in t and is_ours(t)}
    for home in homes:
        for obj in list(home.objects):
            if obj in kept or obj.type != "MESH" or not is_ours(obj) or CLOUD_KEY in obj:
                continue
            if obj in theirs:
                home.objects.unlink(obj)
            else:
                doomed.add(obj)
    bpy.data.batch_remove(doomed)


def _send_home(
    kept: dict[str, bpy.types.Object],
    wanted: Sequence[WantedObject],
    home_of: dict[tuple[str, str], bpy.types.Collection],
    homes: set[bpy.types.Collection],
) -> None:
    """Put objects where they belong, since a collection that is deleted leaves them to the one above.

    What the user has put into a collection of his own may stay there, except from the libraries.
    """
    inside = {home: set(home.objects) for home in homes}
    for want in wanted:
        obj, home = kept.get(want.role), home_of[want.part, want.label]
        if obj is None or obj in inside[home]:
            continue
        astray = [other for other in homes if obj in inside[other]]
        if astray or want.part in LIBRARIES:
            home.objects.link(obj)
        for other in astray:
            other.objects.unlink(obj)


def _tell(obj: bpy.types.Object, want: WantedObject) -> None:
    """Name and place an object of ours, and have it say what it is."""
    if want.part != TREES or stem(obj.name) == want.name:  # else the user calls it so
        settle(obj, want.name)
    obj[ROLE_KEY] = want.role
    for key, value in want.says.items():
        obj[key] = value
    if want.place is not None:
        matrix = Matrix([*want.place.tolist(), [0.0, 0.0, 0.0, 1.0]])
        if obj.parent is None:
            obj.matrix_world = matrix
        else:  # it goes along with what the user has tied it to
            obj.matrix_basis = matrix


def hide_wind(scene: bpy.types.Scene) -> None:
    """Let trees stand at rest again; what was made to show wind goes."""
    for obj in scene.objects:
        for modifier in [m for m in obj.modifiers if is_wind(m)]:
            obj.modifiers.remove(modifier)
            if obj.get(ROLE_KEY) == POINTS_ROLE:
                for name in WIND_COLUMNS:
                    attribute = obj.data.attributes.get(name)
                    if attribute is not None:
                        obj.data.attributes.remove(attribute)
    top = wind_home(scene)
    if top is None:
        return
    things = objects_in(top)
    data = {obj.data for obj in things}
    homes = [*top.children, top]
    bpy.data.batch_remove(things)
    bpy.data.batch_remove(list(data))
    bpy.data.batch_remove(homes)


def is_wind(modifier: bpy.types.Modifier) -> bool:
    """Return whether a modifier shows a tree in the wind."""
    group = modifier.node_group if modifier.type == "NODES" else None
    return group is not None and group.get(VIEW_KEY) == WIND


def wind_home(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The collection of what was made to show wind, None where it is not shown."""
    above = root(scene) or scene.collection
    return next(
        (c for c in above.children if c.get(MADE_KEY) == WIND and is_ours(c)), None
    ) or next((c for c in above.children if str(c.get(MADE_KEY, "")).startswith(f"{WIND}.")), None)
