"""Our objects in a Blender file: how they are marked, and the collections below *Forest* that hold them.

Every block that we make carries a custom property with the name it was made under. A copy has the
property but another name, and a block that was renamed has too: both belong to the user, and so does
what comes from another file. A tree that was renamed, and the forest of a copied scene, are taken as ours
again before a forest is grown (``adopt``). What stands for something in a forest, a tree or the material of a
planting's leaves, says so in a second property: by that the next build finds it again.

*Trees*, the *Variants* that they are copies of, and their *Outlines* for the view; *Ground*, *Sensors*
and *Results* hold what their names say, *Intensity* what hills are dragged and weights are painted on,
where that is done. Custom properties tell our collections from a user's own, wherever the user has put
them in the scene and whatever they are called now; of copies, the first one made counts.
"""

from __future__ import annotations

import re
import struct
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import bpy

MADE_KEY = "forest_made"
ROLE_KEY = "forest_role"
SHAPE_KEY = "forest_shape"  # of the mesh that was made, whatever has been done to it since

Block = TypeVar("Block", bound=bpy.types.ID)


def make_object(
    name: str, data: bpy.types.ID | None, home: bpy.types.Collection
) -> bpy.types.Object:
    """A new object of ours in a collection."""
    made = own(bpy.data.objects.new(name, data))
    if data is not None:
        own(data)
    home.objects.link(made)
    return made


def make_collection(name: str, parent: bpy.types.Collection) -> bpy.types.Collection:
    """A new collection of ours within another."""
    made = own(bpy.data.collections.new(name))
    parent.children.link(made)
    return made


def own(block: Block, name: str = "") -> Block:
    """Mark a new block as ours; ``name`` is what ``settle`` is to call it, where that is not free yet."""
    block[MADE_KEY] = name or block.name
    return block


def settle(block: bpy.types.ID, name: str = "") -> None:
    """Give a block of ours a name, as far as it is free now: this, or the one that it was to have."""
    name = name or block[MADE_KEY]
    if block.name != name:
        block.name = name
        if block.name != name:  # Blender counts on from a number at its end, which says something
            block.name = f"{name}.001"
    block[MADE_KEY] = block.name


def is_ours(block: bpy.types.ID) -> bool:
    """Return whether we made it and nobody has copied or renamed it."""
    return block.get(MADE_KEY) == block.name and is_local(block)


def is_local(block: bpy.types.ID) -> bool:
    """Return whether it is of this file, and no override of what is of another."""
    return block.library is None and block.override_library is None


def by_role(blocks: Iterable[Block]) -> dict[str, Block]:
    """The blocks that are ours, by what each stands for; of two that say the same the later one."""
    return {block[ROLE_KEY]: block for block in blocks if ROLE_KEY in block and is_ours(block)}


def adopt(scene: bpy.types.Scene) -> None:
    """Take as ours what stands for something in a scene and was renamed with it, or alone.

    Of a copied scene that is its whole forest; else trees that the user has renamed. Where the original
    stands there too, it is a copy and stays the user's.
    """
    top = root(scene)
    if top is None:
        return
    copied = not is_ours(top) and stem(top.name) == stem(top[MADE_KEY])
    for home in (top, *below(top)) if copied else ():
        if MADE_KEY in home and is_local(home):
            own(home)
    things = within_reach(scene)
    known = {str(obj.get(ROLE_KEY, "")) for obj in things if is_ours(obj)}
    for obj in things:
        role = str(obj.get(ROLE_KEY, ""))
        if MADE_KEY not in obj or is_ours(obj) or not is_local(obj) or role in known - {""}:
            continue
        if not (copied or role.startswith(f"{TREES}/")):
            continue
        known.add(role)
        own(obj)
        data = obj.data
        if copied and data is not None and MADE_KEY in data:
            if stem(str(obj.get(DATA_KEY, ""))) == stem(data.name_full):
                obj[DATA_KEY] = data.name_full
            own(data)


def stem(name: str) -> str:
    """A name without the number that Blender has put at its end."""
    return re.sub(r"\.\d{3,}$", "", name)


@contextmanager
def all_or_nothing(always: bool = False) -> Iterator[None]:
    """Take back every data block that is made in the block when that fails; always : however it ends."""
    kinds = (
        *(bpy.data.objects, bpy.data.meshes, bpy.data.materials),
        *(bpy.data.collections, bpy.data.node_groups, bpy.data.images),
    )
    before, keep = {block.session_uid for kind in kinds for block in kind}, False
    try:
        yield
        keep = not always
    finally:
        new = [block for kind in kinds for block in kind if block.session_uid not in before]
        bpy.data.batch_remove([] if keep else new)


def points_of_forest(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The object whose points are the trees of a scene, None where trees are objects."""
    home = find_part(scene, TREES)
    things = objects_in(home) if home is not None else ()
    return next((obj for obj in things if obj.get(ROLE_KEY) == POINTS_ROLE), None)


ROOT_KEY = "forest_sensing"
DATA_KEY = "forest_data"  # the mesh that an object was given last, by its name
PART_KEY = "forest_part"
CLOUD_KEY = "forest_cloud"  # on points that were found: which sensor found them
FRAME_KEY = "forest_frame"  # on a mesh of points that is kept: the frame that it was found in
COLOUR_BY, COLOUR_MAP, RADIUS = "Colour By", "Colour Map", "Radius"  # their menus, their size
FAR_POINTS = "Far Points"  # beyond the ground that views show
GAMMA = 1 / 2.2  # colours are linear, the screen's are not
LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear red, green and blue, ITU-R BT.709
SHARE = "Show Share"  # of points, of trees: how many a view shows
ROOT, TREES, VARIANTS, OUTLINES = "Forest", "Trees", "Variants", "Outlines"
GROUND_NAME, SENSORS, RESULTS, INTENSITY = "Ground", "Sensors", "Results", "Intensity"
PARTS = (TREES, VARIANTS, OUTLINES, GROUND_NAME, SENSORS, RESULTS)  # of every forest
LIBRARIES = (VARIANTS, OUTLINES)  # not seen themselves
POINTS_ROLE, GROUND_ROLE = (
    f"{TREES}/points",
    f"{GROUND_NAME}/ground",
)  # of the objects that are these


def root(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The collection of the scene's forest, None where it has none.

    One that is linked from another file, or overrides that, can hold nothing new: it is the user's own.
    """
    return _find(scene.collection, ROOT_KEY, True)


def part(scene: bpy.types.Scene, name: str) -> bpy.types.Collection:
    """One of the collections of the scene's forest, made where it is missing."""
    top, collection = root(scene), find_part(scene, name)
    if top is None:
        top = make_collection(ROOT, scene.collection)
        top[ROOT_KEY] = True
        _gather(top, scene.collection, PART_KEY)
        collection = find_part(scene, name)
    if collection is None:
        collection = make_collection(name, top)
        collection[PART_KEY] = name
        collection.hide_viewport = collection.hide_render = name in LIBRARIES
        if name == TREES:
            _gather(collection, top, ROLE_KEY)
    return collection


def find_part(scene: bpy.types.Scene, name: str) -> bpy.types.Collection | None:
    """One of the collections of the scene's forest, None where it is missing."""
    top = root(scene)
    within = _find(top, PART_KEY, name, top) if top else None
    return within or _find(scene.collection, PART_KEY, name, top)


def grove(scene: bpy.types.Scene, label: str) -> bpy.types.Collection:
    """The collection of a planting's trees, made where it is missing."""
    trees, role, top = part(scene, TREES), f"{TREES}/{label}", root(scene)
    collection = _find(trees, ROLE_KEY, role, top) or _find(scene.collection, ROLE_KEY, role, top)
    if collection is None:
        collection = make_collection(label, trees)
        collection[ROLE_KEY] = role
    return collection


def groves(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """The collections of plantings below *Trees*."""
    collections = below(part(scene, TREES), root(scene))
    return [home for home in collections if is_local(home) and (ROLE_KEY in home or is_ours(home))]


def within_reach(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of a scene but for those of another scene's forest that is shown there too."""
    top = root(scene)
    others = [home for home in below(scene.collection) if ROOT_KEY in home and home != top]
    theirs = {obj for home in others for obj in objects_in(home)}
    return [obj for obj in scene.objects if obj not in theirs]


def objects_in(top: bpy.types.Collection) -> list[bpy.types.Object]:
    """The objects of a collection and those below, each once.

    Blender's own list of them, ``all_objects``, may have objects that an undo removed: reading it crashes.
    """
    homes = (top, *below(top))
    return list(dict.fromkeys(obj for home in homes for obj in home.objects))


def _gather(home: bpy.types.Collection, above: bpy.types.Collection, key: str) -> None:
    """Take in what hangs loose since a collection like this one was deleted."""
    for loose in [child for child in above.children if key in child and is_ours(child)]:
        home.children.link(loose)
        above.children.unlink(loose)


def _find(
    top: bpy.types.Collection, key: str, value: object, own: bpy.types.Collection | None = None
) -> bpy.types.Collection | None:
    """The collection below another that has a property of this value: ours, else one that was renamed.

    own : the root of the forest that it is to belong to, see ``below``.
    """
    renamed = None
    for collection in below(top, own):
        if collection.get(key) == value and is_local(collection):
            if is_ours(collection):
                return collection
            renamed = renamed or collection
    return renamed


def below(
    top: bpy.types.Collection, own: bpy.types.Collection | None = None
) -> Iterator[bpy.types.Collection]:
    """Collections below another, the nearest first.

    own : the root of a forest; those of other forests, which a scene may show as well, are left out.
    """
    waiting = deque(top.children)
    while waiting:
        collection = waiting.popleft()
        if own is not None and ROOT_KEY in collection and collection != own:
            continue
        yield collection
        waiting.extend(collection.children)


def shortest(value: float) -> float:
    """The shortest decimal with the same single-precision number as ``value``."""
    stored = struct.pack("f", value)
    return next(
        (
            decimal
            for digits in range(1, 10)
            if struct.pack("f", decimal := float(f"{value:.{digits}g}")) == stored
        ),
        value,
    )
