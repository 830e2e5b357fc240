"""Things of ours that stand in a scene, and those that a new forest takes over.

A mesh whose shape has not changed since it was made stays, with all that was done to it. A new one wears
the materials of the mesh that stood for the same before, so that whatever was put into a slot stays; a slot
that is empty gets our own material again. Of that there is one for each coat, the bark of a planting say,
which is kept with all edits and only takes the colour that the coat has now.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from itertools import chain

import bpy
import numpy as np

from ...base.trimesh import TriMesh
from ...growth.truth import MEASURES
from .layout import within_reach
from .materials import STYLE_KEY, Colour, recolour
from .ours import ROLE_KEY, SHAPE_KEY, by_role, own

DATA_KEY = "forest_data"  # the mesh that an object was given last, by its name
TOLD_KEY = "forest_told"  # the shape of the mesh that says what its tree measures
OF_SHAPE = {*MEASURES, TOLD_KEY}  # custom properties that another shape does not take over


@dataclass(frozen=True)
class Coat:
    """A material of ours: its name, what makes it, and of what colour if it can have another.

    style : what it is made anew for when that changes (``materials.style_of``).
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
        found = [thing for thing in within_reach(scene) if thing.type == "MESH"]
        things = by_role(found)
        theirs = [thing.data for thing in found]  # a copy may still have what its variant had
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
        thing = self.things.get(role)
        if thing is not None and has_own_mesh(thing):
            return thing.data
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
        bare = [slot for slot in range(len(coats)) if slot >= len(worn) or worn[slot] is None]
        worn += [None] * (len(coats) - len(worn))
        for slot in bare:
            worn[slot] = self._coat(coats[slot])
        return worn

    def _coat(self, coat: Coat) -> bpy.types.Material:
        if coat.name not in self.materials:
            colour = () if coat.colour is None else (coat.colour,)
            made = own(coat.make(coat.name, *colour))
            made[ROLE_KEY] = coat.name
            self.materials[coat.name] = made
        return self.materials[coat.name]


def has_own_mesh(thing: bpy.types.Object) -> bool:
    """Return whether an object of ours has a mesh that the user gave it."""
    return bool(thing.get(DATA_KEY) != thing.data.name_full)


def fingerprint(mesh: TriMesh) -> str:
    """A word that only this mesh has."""
    digest = hashlib.blake2b(digest_size=16)
    for column in fields(mesh):
        values = getattr(mesh, column.name)
        if column.name != "edges" and values is not None:  # edges follow from the triangles
            digest.update(f"{column.name} {values.dtype} {values.shape}".encode())
            digest.update(np.ascontiguousarray(values).view(np.uint8).data)
    return digest.hexdigest()
