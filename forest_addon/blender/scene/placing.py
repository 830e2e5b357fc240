"""Objects put in place of those that stood for the same before.

A forest says which objects it wants. Each is the object of ours that stands for it already, with other data
and at another place, or a new one; so collections, modifiers, visibility and all else that belongs to an
object stay as the user has them. Those that are wanted no more go. What was prepared before cannot fail
here, so a scene has the old forest or the new one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from .layout import CLOUD_KEY, LIBRARIES, PARTS, TREES, VARIANTS, grove, groves, part, root
from .ours import ROLE_KEY, is_ours, settle
from .standing import DATA_KEY, KeptStanding, has_own_mesh


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
    made = {want.data for want in wanted} - {thing.data for thing in kept.values()}

    variants = {t.data for role, t in standing.things.items() if role.startswith(VARIANTS)}
    _clear(homes, set(kept.values()))
    _send_home(kept, wanted, home_of, homes)
    _dissolve(set(groves(scene)) - set(home_of.values()), part(scene, TREES))
    things, given = {}, []
    for want in wanted:
        thing = kept.get(want.role)
        if thing is None:
            thing = bpy.data.objects.new(want.name, want.data)
            home_of[want.part, want.label].objects.link(thing)
            given.append(thing)
        elif not has_own_mesh(thing) or (want.part == TREES and thing.data in variants):
            thing.data = want.data
            given.append(thing)
        things[want.role] = thing
    _sweep()
    for mesh in made:
        settle(mesh)
    for thing in given:
        thing[DATA_KEY] = thing.data.name_full
    for want in wanted:
        _tell(things[want.role], want)
    return things


def _clear(homes: set[bpy.types.Collection], kept: set[bpy.types.Object]) -> None:
    """Remove what of ours is wanted no more; what is in a collection of the user's too stays in that.
    Points that were found in the forest of before stay until their sensor runs again.

    What is nowhere any more, its collection removed, goes as well: it would keep its name from others.
    """
    every = (*bpy.data.collections, *(scene.collection for scene in bpy.data.scenes))
    theirs = {thing for home in every if home not in homes for thing in home.objects}
    doomed = {t for t in bpy.data.objects if not t.users and ROLE_KEY in t and is_ours(t)}
    for home in homes:
        for thing in list(home.objects):
            if thing in kept or thing.type != "MESH" or not is_ours(thing):
                continue
            if CLOUD_KEY in thing:
                continue
            if thing in theirs:
                home.objects.unlink(thing)
            else:
                doomed.add(thing)
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
        thing, home = kept.get(want.role), home_of[want.part, want.label]
        if thing is None or thing in inside[home]:
            continue
        astray = [other for other in homes if thing in inside[other]]
        if astray or want.part in LIBRARIES:
            home.objects.link(thing)
        for other in astray:
            other.objects.unlink(thing)


def _dissolve(unwanted: set[bpy.types.Collection], heir: bpy.types.Collection) -> None:
    """Remove collections of ours; what others put there goes into another. Renamed ones stay."""
    for home in unwanted:
        if not is_ours(home):
            continue
        for mine, others in ((heir.objects, home.objects), (heir.children, home.children)):
            known = set(mine)
            for block in others:
                if block not in known and block not in unwanted:
                    mine.link(block)
        bpy.data.collections.remove(home)


def _sweep() -> None:
    """Remove meshes of ours that nothing uses any more, with the materials that only they used."""
    unused = [mesh for mesh in bpy.data.meshes if not mesh.users and is_ours(mesh)]
    worn = {material for mesh in unused for material in mesh.materials if material}
    bpy.data.batch_remove(unused)
    bpy.data.batch_remove([coat for coat in worn if not coat.users and is_ours(coat)])


def _tell(thing: bpy.types.Object, want: WantedObject) -> None:
    """Name and place an object of ours, and have it say what it is."""
    settle(thing, want.name)
    thing[ROLE_KEY] = want.role
    for key, value in want.says.items():
        thing[key] = value
    if want.place is not None:
        matrix = Matrix([*want.place.tolist(), [0.0, 0.0, 0.0, 1.0]])
        if thing.parent is None:
            thing.matrix_world = matrix
        else:  # it goes along with what the user has tied it to
            thing.matrix_basis = matrix
