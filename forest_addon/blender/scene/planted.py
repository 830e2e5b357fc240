"""Trees as a forest planted them, beside how they stand now: what somebody has moved, changed or deleted.

A tree that is an object says where it was planted; the collection of its planting says where all were. So
a tree that was moved by hand is known, and one that was deleted. Of trees that are points nothing is moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import bpy
import numpy as np

from .attributes import read
from .instances import TREE_KEY, natural
from .layout import (
    POINTS_ROLE,
    ROLE_KEY,
    TREES,
    VARIANTS,
    by_role,
    find_part,
    grove,
    groves,
    within_reach,
)
from .nodes import ROTATION, SCALE, VARIANT

if TYPE_CHECKING:
    from ...stand.forest import GrownForest

STOOD_KEY = "forest_stood"  # of a tree: x, y, rotation, scale, variant, diameter; of a collection: x, y, ...
NEAR = 1e-3  # metres, and share of a size: less is no change
COARSE = 1000  # variants from this number on are coarse ones of the same tree (``sensing/detail``)


@dataclass(frozen=True)
class StoodTree:
    """A tree of a forest: its planting by name, where it was planted, and how it stands now.

    planted, place : x and y, metres. rotation : radians. diameter : 1.3 m up, metres, where it was to have
    one, else 0. thing : its object, None where it is a point.
    """

    label: str
    planted: tuple[float, float]
    place: tuple[float, float]
    rotation: float
    scale: float
    variant: int
    diameter: float
    was: tuple[float, float]  # rotation and scale as planted
    thing: bpy.types.Object | None = None

    @property
    def is_changed(self) -> bool:
        """Return whether it stands otherwise than it was planted."""
        far = max(NEAR, 1e-6 * max(map(abs, self.planted)))
        moved = max(abs(a - b) for a, b in zip(self.place, self.planted, strict=True)) > far
        turn = abs((self.rotation - self.was[0] + np.pi) % (2 * np.pi) - np.pi)
        return bool(moved or turn > NEAR or abs(self.scale / self.was[1] - 1) > NEAR)


def told_of_tree(forest: GrownForest, tree: int) -> list[float]:
    """Return what the object of a tree says of how it was planted."""
    stand, wanted = forest.stand, forest.wanted
    diameter = 0.0 if wanted is None or not np.isfinite(wanted[tree, 0]) else wanted[tree, 0]
    place = stand.position[tree, :2].tolist()
    size = [float(stand.rotation[tree]), float(stand.scale[tree])]
    return [*place, *size, float(stand.variant[tree] % COARSE), float(diameter)]


def note_stood(scene: bpy.types.Scene, forest: GrownForest) -> None:
    """Have the collection of each planting say where its trees were planted."""
    for planting, label in enumerate(forest.labels):
        mine = forest.stand.position[forest.stand.species == planting, :2]
        grove(scene, label)[STOOD_KEY] = mine.ravel().tolist()


def note_change(tree: StoodTree, variant: int) -> None:
    """Have a tree that is an object stand where it does by plan, as this variant."""
    if tree.thing is None:
        return
    stands = [*tree.place, tree.rotation, tree.scale, float(variant), tree.diameter]
    _replace(tree, list(tree.place))
    tree.thing[STOOD_KEY] = stands


def forget_tree(tree: StoodTree) -> None:
    """Delete the object of a tree, which its planting misses no more."""
    if tree.thing is not None:
        _replace(tree, [])
        bpy.data.objects.remove(tree.thing)


def _replace(tree: StoodTree, place: list[float]) -> None:
    """Have collections say another place of a tree, or none."""
    assert tree.thing is not None
    for home in tree.thing.users_collection:
        told = np.reshape(list(home.get(STOOD_KEY, ())), (-1, 2)).tolist()
        if [*tree.planted] in told:
            told.remove([*tree.planted])
            home[STOOD_KEY] = [z for xy in told for z in xy] + place


def stood_trees(scene: bpy.types.Scene) -> list[StoodTree]:
    """Return the trees of a scene's forest that stand there."""
    things = by_role(thing for thing in within_reach(scene) if thing.type == "MESH")
    found = [_of_object(role, thing) for role, thing in things.items() if STOOD_KEY in thing]
    if POINTS_ROLE in things:
        found += _of_points(scene, things[POINTS_ROLE])
    return found


def deleted_trees(scene: bpy.types.Scene) -> dict[str, list[tuple[float, float]]]:
    """Return where trees were planted that are objects and were deleted, by planting.

    Of a planting without any tree left nothing is said: it was cleared away, to be grown anew.
    """
    left: dict[str, set[tuple[float, float]]] = {}
    for thing in bpy.data.objects:  # renamed and unlinked ones too
        if STOOD_KEY in thing and TREE_KEY in thing and thing.users:
            label = str(thing.get(ROLE_KEY, "")).removeprefix(f"{TREES}/").rpartition(" ")[0]
            left.setdefault(label, set()).add(tuple(thing[STOOD_KEY][:2]))
    if find_part(scene, TREES) is None:
        return {}
    gone = {}
    for home in groves(scene):
        label = str(home.get(ROLE_KEY, "")).removeprefix(f"{TREES}/")
        places = np.reshape(list(home.get(STOOD_KEY, ())), (-1, 2)).tolist()
        if label in left:
            gone[label] = [(x, y) for x, y in places if (x, y) not in left[label]]
    return gone


def _of_object(role: str, thing: bpy.types.Object) -> StoodTree:
    x, y, turned, size, variant, diameter = thing[STOOD_KEY]
    label = role.removeprefix(f"{TREES}/").rpartition(" ")[0]
    tied = thing.parent or thing.constraints or thing.animation_data
    place, rotation, scale = (x, y), turned, size
    matrix = np.array(thing.matrix_basis, dtype=float)
    volume = float(np.linalg.det(matrix[:3, :3]))
    if not tied and volume > 0:
        place = float(matrix[0, 3]), float(matrix[1, 3])
        rotation, scale = float(np.arctan2(matrix[1, 0], matrix[0, 0])), float(np.cbrt(volume))
    diameter *= scale / size
    was = turned, size
    return StoodTree(label, (x, y), place, rotation, scale, int(variant), diameter, was, thing)


def _of_points(scene: bpy.types.Scene, thing: bpy.types.Object) -> list[StoodTree]:
    home = find_part(scene, VARIANTS)
    blocks = (*home.objects, *home.children) if home is not None else ()
    library = sorted(blocks, key=lambda block: natural(block.name))
    roles = [str(b.get(ROLE_KEY, "")).removeprefix(f"{VARIANTS}/") for b in library]
    places = read(thing.data, "position", "FLOAT_VECTOR")
    if any(name not in thing.data.attributes for name in (ROTATION, SCALE, VARIANT)):
        return []
    kinds = {ROTATION: "FLOAT", SCALE: "FLOAT", VARIANT: "INT"}
    columns = [read(thing.data, name, kind).tolist() for name, kind in kinds.items()]
    found = []
    rows = zip(places.tolist(), *columns, strict=True)
    for (x, y, _), turned, size, rank in rows:
        label, _, number = roles[rank].rpartition(".") if rank < len(roles) else ("", "", "")
        if number.isdigit():
            same = (x, y), (x, y), turned, size, int(number) % COARSE
            found.append(StoodTree(label, *same, 0.0, (turned, size)))
    return found
