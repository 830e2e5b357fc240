"""A hand that plants: single trees, trees over a disc up to a density, discs made free, each to be undone.

All of it ends in the settings of plantings (``by_hand`` and ``clearings``).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np

from ...blender.scene.planted import StoodTree, stood_trees
from .hand_edits import Place, clear_spot, find_set, plantings_by_label, remove_tree, set_tree

APART = 0.6  # of the mean distance at a density, that trees of one stroke keep
TRIES = 20  # for each tree that is wanted
Kept = list[tuple[list[dict[str, Any]], list[dict[str, Any]]]]


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

    def look(self) -> None:
        """See what stands now."""
        self.trees = stood_trees(self.scene)
        self.places = np.reshape([tree.place for tree in self.trees], (-1, 2))
        self.set.clear()
        self.cleared.clear()

    def begin(self) -> None:
        """Note what there was before a stroke."""
        self.before.append(_kept(self.scene))

    def take_back(self) -> bool:
        """Undo a stroke; returns whether there was one."""
        if not self.before:
            return False
        _restore(self.scene, self.before.pop())
        self.set.clear()
        self.cleared.clear()
        return True

    def plant(self, planting: Any, place: Place) -> None:
        """Set one tree."""
        tree = planting.by_hand.add()
        tree.position = place
        tree.use_rotation_deg = True  # so it stays the same tree when others are set or removed
        tree.rotation_deg = float(self.rng.uniform(-180, 180))
        low, high = planting.scale
        tree.use_scale, tree.scale = True, float(low * (high / low) ** self.rng.random())
        tree.use_variant, tree.variant = True, int(self.rng.integers(planting.variants))
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
        drawn = [self.trees[k].label for k in near if not self._is_set(known, self.trees[k])]
        for label in set(drawn) & known.keys():
            clear_spot(known[label], place, radius)
        gone = len(drawn)
        for planting in known.values():
            for number in reversed(range(len(planting.by_hand))):
                if np.hypot(*np.subtract(planting.by_hand[number].position, place)) <= radius:
                    planting.by_hand.remove(number)
                    gone += 1
        self.set = [xy for xy in self.set if np.hypot(*np.subtract(xy, place)) > radius]
        self._drop(near)
        if gone:
            self.cleared.append((float(place[0]), float(place[1]), radius))
        return gone

    def nearest(self, place: Place, reach: float) -> StoodTree | None:
        """The tree that stands nearest to a place."""
        far = np.hypot(*(self.places - place).T)
        number = int(far.argmin()) if len(far) else -1
        return self.trees[number] if number >= 0 and far[number] <= reach else None

    def change(
        self, tree: StoodTree, variant: int | None = None, place: Place | None = None
    ) -> None:
        """Keep one tree as it stands, or as another variant, or at another place."""
        known = plantings_by_label(self.scene)
        if tree.label not in known:
            return
        planting, number = known[tree.label], self.trees.index(tree)
        now = tree if place is None else replace(tree, place=place)
        if tree.thing is not None and place is not None:
            tree.thing.location[:2] = place
        set_tree(planting, now, None if variant is None else variant % planting.variants)
        self.trees[number] = replace(now, planted=now.place, was=(now.rotation, now.scale))
        self.places[number] = now.place
        self.set.append(now.place)

    def remove(self, tree: StoodTree) -> None:
        """Take one tree away."""
        known = plantings_by_label(self.scene)
        if tree.label in known:
            remove_tree(known[tree.label], tree.planted)
            self.cleared.append((*tree.planted, 0.5))
            self._drop(np.array([self.trees.index(tree)]))

    def _is_set(self, known: dict[str, Any], tree: StoodTree) -> bool:
        return tree.label in known and find_set(known[tree.label], tree.planted) is not None

    def _drop(self, rows: np.ndarray) -> None:
        gone = set(rows.tolist())
        self.trees = [tree for number, tree in enumerate(self.trees) if number not in gone]
        self.places = np.delete(self.places, rows, axis=0)


def _kept(scene: bpy.types.Scene) -> Kept:
    """Return what is set and cleared in each planting, as plain values."""

    def rows(items: Any) -> list[dict[str, Any]]:
        return [{key: _plain(getattr(item, key)) for key in _names(item)} for item in items]

    return [(rows(p.by_hand), rows(p.clearings)) for p in scene.forest_sensing.plantings]


def _restore(scene: bpy.types.Scene, kept: Kept) -> None:
    for planting, lists in zip(scene.forest_sensing.plantings, kept, strict=False):
        for items, rows in zip((planting.by_hand, planting.clearings), lists, strict=True):
            items.clear()
            for row in rows:
                item = items.add()
                for key, value in row.items():
                    setattr(item, key, value)
    scene.update_tag()


def _names(item: Any) -> list[str]:
    return list(type(item).__annotations__)


def _plain(value: Any) -> Any:
    return value if isinstance(value, (bool, int, float, str)) else tuple(value)
