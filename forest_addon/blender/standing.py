"""What of ours stands in a scene, and what a new forest takes over from it.

A new mesh wears the materials of the mesh that stood for the same before, so that whatever was put into a
slot stays; a slot that is empty gets our own material again. Of that there is one for each coat, the bark
of a planting say, which is kept with all edits and only takes the colour that the coat has now.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain

import bpy

from .layout import within_reach
from .materials import Colour, recolour
from .ours import ROLE_KEY, by_role, own


@dataclass(frozen=True)
class Coat:
    """A material of ours: its name, what makes it, and of what colour if it can have another."""

    name: str
    make: Callable[..., bpy.types.Material]
    colour: Colour | None = None


@dataclass(frozen=True)
class Standing:
    """Objects of a scene's forest, their meshes and materials, by what each stands for."""

    things: dict[str, bpy.types.Object]
    meshes: dict[str, bpy.types.Mesh]
    materials: dict[str, bpy.types.Material]

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> Standing:
        """Read a scene."""
        found = [thing for thing in within_reach(scene) if thing.type == "MESH"]
        meshes = by_role({thing.data for thing in found})
        worn = chain.from_iterable(mesh.materials for mesh in meshes.values())
        return cls(by_role(found), meshes, by_role(material for material in worn if material))

    def first(self, kind: str) -> bpy.types.Mesh | None:
        """The first mesh that stands for something of a kind: of a planting, of the outlines."""
        return next(
            (self.meshes[role] for role in sorted(self.meshes) if role.startswith(kind)), None
        )

    def renew(
        self,
        data: bpy.types.Mesh,
        role: str,
        name: str,
        coats: Sequence[Coat] = (),
        like: bpy.types.Mesh | None = None,
    ) -> bpy.types.Mesh:
        """Give a new mesh the materials and custom properties of the one that stands for the same.

        name : what it is to be called when that is gone. coats : what it wears where the old one wears
        nothing. like : a mesh whose materials it takes where there is no old one.
        """
        old = self.meshes.get(role)
        own(data, name)[ROLE_KEY] = role
        for material in self._dress(old or like, coats):
            data.materials.append(material)
        for key, value in old.items() if old else ():
            if key not in data:
                data[key] = value
        return data

    def recolour(self, coats: Sequence[Coat]) -> None:
        """Give our materials the colours that their coats have now."""
        for coat in coats:
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
