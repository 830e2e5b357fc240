"""Forests by hand: trees set, changed and removed, which *Grow Forest* keeps; where others stand, painted.

All of it ends in the settings of plantings (``by_hand`` and ``clearings``). Before a forest is grown anew,
trees that somebody has moved or deleted in the view are noted there, as trees set by hand, and as clearings
where they were drawn. Buttons for selected trees do the same at once. So a scene file and a script grow what
the window shows.

A button lays a canvas over the field and gives the user Blender's brush. While it is painted the canvas is
drawn before the trees, which views show through it. However the user leaves Weight Paint mode, by the button
or Blender's own ways, it is put away then.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ... import spec
from ...blender.scene.instances import (
    STOOD_KEY,
    StoodTree,
    deleted_trees,
    forget_tree,
    note_change,
    stood_trees,
)
from ...blender.scene.layout import (
    INTENSITY,
    ROLE_KEY,
    TREES,
    VARIANTS,
    adopt,
    find_part,
    is_ours,
    part,
)
from ...blender.show import intensity
from ...spec import Clearing, HandTree
from ..settings import exchange
from ..settings.exchange import fill, read
from ..shell.running import Button, button, obstacle
from ..shell.views import PLANTED, chosen_planting, redraw_panels, see_through, select
from ..shell.words import free_name, keep, say

Place = tuple[float, float]
NEAR = 1e-3  # metres: two places that are one
SPOT = 0.01  # metres, radius of the clearing where a tree was drawn
NO_COPIES = keep(
    "Select copies of the forest's trees, such as those dragged from the Asset Browser"
)
NO_TREES = keep("Select trees of the forest that are objects; Plant by Hand changes all others")


def plantings_by_label(scene: bpy.types.Scene) -> dict[str, Any]:
    """The plantings of the panel, by the name that each has in a forest."""
    from ...stand.plan import labels

    plantings = scene.forest_sensing.plantings
    return dict(zip(labels(plantings), plantings, strict=True))


def take_up_changes(scene: bpy.types.Scene) -> int:
    """Note in the settings what was moved or deleted in the view; returns how many trees those are."""
    adopt(scene)
    known, count = plantings_by_label(scene), 0
    for tree in stood_trees(scene):
        if tree.is_changed and tree.label in known:
            set_tree(known[tree.label], tree)
            count += 1
    for label, places in deleted_trees(scene).items():
        for place in places if label in known else ():
            remove_tree(known[label], place)
            count += 1
    if count:
        scene.update_tag()
    return count


def set_tree(planting: Any, tree: StoodTree, variant: int | None = None) -> None:
    """Have a tree stand where it is now, whatever is drawn; ``variant`` in place of its own."""
    entry = find_set(planting, tree.planted)
    if entry is None:
        clear_spot(planting, tree.planted)
    number = tree.variant if variant is None else variant
    note_change(tree, number)
    turned = (np.rad2deg(tree.rotation) + 180) % 360 - 180
    add_tree(planting, tree.place, turned, tree.scale, number, tree.diameter or None, entry)


def add_tree(
    planting: Any,
    place: Place,
    rotation_deg: float,
    scale: float,
    variant: int,
    diameter: float | None = None,
    entry: Any = None,
) -> None:
    """Set a tree by hand at a place (m); ``entry`` is the one that it takes the place of.

    All but the diameter (m) is said, so that it stays the same tree when others are set or removed.
    """
    entry = planting.by_hand.add() if entry is None else entry
    redraw_panels()
    entry.position = place
    given = {"rotation_deg": rotation_deg, "scale": scale, "variant": variant, "diameter": diameter}
    for name, value in given.items():
        setattr(entry, f"use_{name}", value is not None)
        if value is not None:
            setattr(entry, name, value)


def remove_tree(planting: Any, place: Place) -> None:
    """Have no tree stand where one was planted."""
    entry = find_set(planting, place)
    if entry is None:
        clear_spot(planting, place)
    else:
        planting.by_hand.remove(list(planting.by_hand).index(entry))
    redraw_panels()


def find_set(planting: Any, place: Place) -> Any:
    """The tree set by hand at a place, None where there is none."""
    far = max(NEAR, 1e-6 * max(map(abs, place)))
    near = (e for e in planting.by_hand if np.hypot(*np.subtract(e.position, place)) <= far)
    return next(near, None)


def clear_spot(planting: Any, place: Place, radius: float = SPOT) -> None:
    """Keep a disc free of trees that are drawn."""
    disc = planting.clearings.add()
    disc.position, disc.radius = place, radius


def copy_of(obj: bpy.types.Object) -> tuple[str, int] | None:
    """Return the planting and variant of which an object is a copy that somebody made; None: of none."""
    part, _, name = str(obj.get(ROLE_KEY, "")).partition("/")
    if obj.type != "MESH" or is_ours(obj):
        return None
    if part == VARIANTS:
        return variant_copied(obj)
    if part == TREES and STOOD_KEY in obj:
        return name.rpartition(" ")[0], int(obj[STOOD_KEY][4])
    return None


def variant_copied(obj: bpy.types.Object) -> tuple[str, int] | None:
    """Return planting and number of the variant that an object is, here or in another file; None: of none."""
    part, _, name = str(obj.get(ROLE_KEY, "")).partition("/")
    label, _, number = name.rpartition(".")
    is_one = obj.type == "MESH" and part == VARIANTS and number.isdecimal()
    return (label, int(number)) if is_one else None


def swap_tree(planting: Any, tree: StoodTree) -> None:
    """Make a tree the next variant of its species, at once where it is an object, and keep it so."""
    number = (tree.variant + 1) % planting.variants
    set_tree(planting, tree, number)
    role = f"{VARIANTS}/{tree.label}.{number:03d}"
    home = find_part(planting.id_data, VARIANTS)
    for obj in home.objects if home is not None else ():  # else it comes with the forest
        if obj.get(ROLE_KEY) == role and tree.obj is not None:
            tree.obj.data = obj.data


def take_away(planting: Any, tree: StoodTree) -> None:
    """Take a tree out of the forest, and have none drawn in its place."""
    remove_tree(planting, tree.planted)
    forget_tree(tree)


def _stand_among(context: bpy.types.Context) -> bool:
    """Return whether trees of the forest are selected."""
    return any(STOOD_KEY in obj for obj in context.selected_objects)


def _are_among(context: bpy.types.Context) -> bool:
    """Return whether copies of the forest's trees are selected."""
    return any(map(copy_of, context.selected_objects))


SELECTED = ((lambda context: context.mode == "OBJECT" and _stand_among(context), NO_TREES),)
COPIED = ((lambda context: context.mode == "OBJECT" and _are_among(context), NO_COPIES),)


def _change_selected(
    button: bpy.types.Operator,
    context: bpy.types.Context,
    change: Callable[[Any, StoodTree], None],
) -> str | None:
    """Change each selected tree of a known planting; returns how many those are."""
    known, chosen = plantings_by_label(context.scene), set(context.selected_objects)
    trees = [t for t in stood_trees(context.scene) if t.obj in chosen and t.label in known]
    for tree in trees:
        change(known[tree.label], tree)
    if not trees:
        button.report({"WARNING"}, say(NO_TREES))
        return None
    context.scene.update_tag()
    return say("{count} trees; Grow Forest keeps them so", count=len(trees))


CHANGES = (
    (
        "lock_trees",
        "Lock Trees",
        "Keep the selected trees where and as they stand, whatever is drawn around them",
        set_tree,
    ),
    (
        "swap_trees",
        "Next Variant",
        "Make each selected tree the next variant of its species, and keep it so",
        swap_tree,
    ),
    (
        "remove_trees",
        "Remove Trees",
        "Take the selected trees out of the forest, and have none drawn in their places",
        take_away,
    ),
)
CLASSES = tuple(
    button(title, Button, needs=SELECTED, __doc__=words)(
        lambda button, context, change=change: _change_selected(button, context, change), name
    )
    for name, title, words, change in CHANGES
)


@button("Plant Copies", Button, bl_options={"UNDO"}, needs=COPIED)
def adopt_trees(button: bpy.types.Operator, context: bpy.types.Context) -> str | None:
    """Plant the selected copies of trees where they stand: copied here or dragged from the Asset Browser"""
    known, planted = plantings_by_label(context.scene), []
    for obj in context.selected_objects:
        label, variant = copy_of(obj) or ("", 0)
        if label not in known or variant >= known[label].variants:
            continue
        place, turn, size = obj.matrix_world.decompose()
        turned = np.rad2deg(turn.to_euler().z)
        add_tree(known[label], place[:2], turned, sum(size) / 3, variant)
        planted.append(obj)
    if not planted:
        button.report({"WARNING"}, say("No planting of this forest has these trees"))
        return None
    data = {obj.data for obj in planted}
    bpy.data.batch_remove(planted)
    bpy.data.batch_remove([mesh for mesh in data if not mesh.users])  # the browser copies them
    context.scene.update_tag()
    if context.scene.forest_sensing.plant_grows and not obstacle(context):
        bpy.ops.forest.build("INVOKE_DEFAULT")
    return say("{count} planted; Grow Forest keeps them", count=len(planted))


def draw_menu(menu: Any, context: bpy.types.Context) -> None:
    """Draw what can be done with selected trees, in the context menu of objects."""
    names = [name for name, *_ in CHANGES] * _stand_among(context)
    names += ["adopt_trees"] * _are_among(context)
    if names:
        menu.layout.separator()
    for name in names:
        menu.layout.operator(f"forest.{name}")


MENUS = (("VIEW3D_MT_object_context_menu", draw_menu),)


APART = 0.6  # of the mean distance at a density, that trees of one stroke keep
TRIES = 20  # for each tree that is wanted
Kept = list[tuple[tuple[HandTree, ...], tuple[Clearing, ...]]]


@dataclass
class Hand:
    """Hand that plants in a scene.

    trees : those that stand, as far as the hand has left them. set, cleared : what it did since the forest
    was grown, for drawing: places (x, y), and discs (x, y, radius).
    """

    scene: bpy.types.Scene
    rng: np.random.Generator
    trees: list[StoodTree] = field(default_factory=list)
    set: list[Place] = field(default_factory=list)
    cleared: list[tuple[float, float, float]] = field(default_factory=list)
    before: list[Kept] = field(default_factory=list)

    @property
    def places(self) -> np.ndarray:
        """Places of the trees, (N, 2) m."""
        return np.reshape([tree.place for tree in self.trees], (-1, 2))

    def look(self) -> None:
        """See what stands now."""
        self.trees = stood_trees(self.scene)
        self.set.clear()
        self.cleared.clear()

    def begin(self) -> None:
        """Note what there was before a stroke."""
        self.before.append(hand_trees(self.scene))

    def take_back(self) -> bool:
        """Undo a stroke; returns whether there was one."""
        if not self.before:
            return False
        plantings = self.scene.forest_sensing.plantings
        for planting, (trees, discs) in zip(plantings, self.before.pop(), strict=False):
            fill(planting, "by_hand", trees)
            fill(planting, "clearings", discs)
        self.scene.update_tag()
        self.set.clear()
        self.cleared.clear()
        return True

    def plant(self, planting: Any, place: Place) -> None:
        """Set one tree."""
        turned = float(self.rng.uniform(-180, 180))
        low, high = planting.scale
        scale = float(low * (high / low) ** self.rng.random())
        add_tree(planting, place, turned, scale, int(self.rng.integers(planting.variants)))
        self.set.append((float(place[0]), float(place[1])))

    def scatter(self, planting: Any, place: Place, radius: float, density: float) -> int:
        """Set trees on a disc until it has as many as the density says; returns how many were set."""
        there = np.concatenate([self.places, np.reshape(self.set, (-1, 2))])
        there = there[np.hypot(*(there - place).T) < 2 * radius]
        within = int((np.hypot(*(there - place).T) <= radius).sum())
        wanted = round(density * np.pi * radius**2) - within
        apart = max(self.scene.forest_sensing.forest.spacing, APART / np.sqrt(density))
        done = 0
        for _ in range(TRIES * max(wanted, 0)):
            away, turn = radius * np.sqrt(self.rng.random()), 2 * np.pi * self.rng.random()
            new = np.add(place, (away * np.cos(turn), away * np.sin(turn)))
            if len(there) and np.hypot(*(there - new).T).min() < apart:
                continue
            self.plant(planting, (float(new[0]), float(new[1])))
            there = np.concatenate([there, new[None]])
            done += 1
            if done >= wanted:
                break
        return done

    def erase(self, place: Place, radius: float) -> int:
        """Take away the trees on a disc, and have none drawn there; returns how many went."""
        near = np.flatnonzero(np.hypot(*(self.places - place).T) <= radius)
        known = plantings_by_label(self.scene)
        trees = [self.trees[k] for k in near if self.trees[k].label in known]
        drawn = [t.label for t in trees if find_set(known[t.label], t.planted) is None]
        for label in set(drawn):
            clear_spot(known[label], place, radius)
        gone = len(drawn)
        for planting in known.values():
            for number in reversed(range(len(planting.by_hand))):
                if np.hypot(*np.subtract(planting.by_hand[number].position, place)) <= radius:
                    planting.by_hand.remove(number)
                    gone += 1
        self.set = [xy for xy in self.set if np.hypot(*np.subtract(xy, place)) > radius]
        self.trees = [tree for k, tree in enumerate(self.trees) if k not in near]
        if gone:
            self.cleared.append((float(place[0]), float(place[1]), radius))
            redraw_panels()
        return gone

    def nearest(self, place: Place, reach: float) -> StoodTree | None:
        """The tree that stands nearest to a place."""
        far = np.hypot(*(self.places - place).T)
        number = int(far.argmin()) if len(far) else -1
        return self.trees[number] if number >= 0 and far[number] <= reach else None

    def change(
        self,
        tree: StoodTree,
        how: Callable[[Any, StoodTree], None] = set_tree,
        place: Place | None = None,
    ) -> None:
        """Keep one tree as it stands, or at another place, or do with it what a button does."""
        known = plantings_by_label(self.scene)
        if tree.label not in known:
            return
        number = self.trees.index(tree)
        now = tree if place is None else replace(tree, place=place)
        if tree.obj is not None and place is not None:
            tree.obj.location[:2] = place
        how(known[tree.label], now)
        if how is take_away:
            self.cleared.append((*tree.planted, 0.5))
            del self.trees[number]
            return
        self.trees[number] = replace(now, planted=now.place, was=(now.rotation, now.scale))
        self.set.append(now.place)


def hand_trees(scene: bpy.types.Scene) -> Kept:
    """Return the trees and clearings that are set by hand in each planting.

    Raises
    ------
    SpecError : a value that cannot be used.
    """
    return [
        (
            tuple(read(tree, HandTree) for tree in planting.by_hand),
            tuple(read(disc, Clearing) for disc in planting.clearings),
        )
        for planting in scene.forest_sensing.plantings
    ]


NAME = "Canvas"
PAINTING = "PAINT_WEIGHT"

_in_hand = ""  # the canvas that is being painted


@bpy.app.handlers.persistent
def _put_away(*_: object) -> None:
    """Put the canvas away when it is no longer painted."""
    global _in_hand
    if not _in_hand or bpy.context.mode == PAINTING:
        return
    obj = bpy.data.objects.get(_in_hand)
    _in_hand = ""
    see_through(False)
    if obj is not None and intensity.CANVAS_KEY in obj:  # in another file it may be anything
        intensity.show_canvas(obj, painted=False)


IN_MODE = (
    lambda context: context.mode in ("OBJECT", PAINTING),
    keep("Leave this mode first: painting begins in Object Mode"),
)


@button("Paint", Button, needs=(IN_MODE, PLANTED))
def paint(_button: Button, context: bpy.types.Context) -> str:
    """Paint where this species stands, on the ground; press again when it is done"""
    global _in_hand
    if context.mode == PAINTING:
        bpy.ops.object.mode_set(mode="OBJECT")
        _put_away()
        return ""
    from ...blender.read.inputs import with_objects
    from ...site import ForestSite
    from ...stand.files import read_inputs

    props = context.scene.forest_sensing
    folder = Path(bpy.path.abspath(props.folder))
    settings = spec.Scene(
        forest=exchange.read(props.forest, spec.Forest, "forest"),
        offset=exchange.parsed("offset", props.offset) or (0.0, 0.0, 0.0),
        crs=props.crs,
    )
    site = ForestSite(settings, folder, inputs=read_inputs(settings, folder))
    site = with_objects(site, context.evaluated_depsgraph_get())
    home = part(context.scene, INTENSITY)
    known = (t for t in home.objects if intensity.CANVAS_KEY in t and t.type == "MESH")
    obj = next(known, None) or intensity.new_canvas(NAME, home)
    intensity.lay(obj, settings.forest, site.ground)
    planting = chosen_planting(context.scene.forest_sensing)
    name = str(planting.painted_layer)  # the layer that the planting has on the canvas
    if planting.painted_pointer != obj or name not in obj.vertex_groups:
        stem = Path(planting.species).stem or "trees"
        name = free_name(stem, " ", "", obj.vertex_groups.__contains__)
    planting.painted = f"{obj.name}:{intensity.layer_of(obj, name).name}"
    select(context, obj)
    bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    intensity.show_canvas(obj, painted=True)
    _in_hand = obj.name
    see_through(True)
    return say("Paint where trees stand; Done ends it, Grow Forest plants them")


HANDLERS = (("depsgraph_update_post", _put_away),)
