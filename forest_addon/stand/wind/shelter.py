"""Drag area of a stand by height: how much of the wind its trees take."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...growth.sway.beams import GreenWood
from ...growth.tree import Tree
from ..forest import GrownForest
from .field import DRAG
from .response import WOOD_DRAG

LAYERS = 40  # from the ground to the tops
SLICES = 100  # of a variant's height


def drag_area_of(
    forest: GrownForest, height: float, wood_of: Callable[[tuple[int, int]], GreenWood]
) -> np.ndarray:
    """(LAYERS,) drag coefficient times area in equal layers up to a height in m, over the ground's area.

    wood_of : the wood of a variant, by planting and number. What stands above the height counts in the top
    layer.
    """
    stand, found = forest.stand, np.zeros(LAYERS)
    if not len(stand) or stand.area <= 0:
        return found
    for key, tree in forest.variants.items():
        mine = (stand.species == key[0]) & (stand.variant == key[1])
        place, area = drag_slices(tree, wood_of(key).one_sided)
        layer = np.outer(stand.scale[mine], place) / height * LAYERS
        rows = np.clip(layer.astype(np.int64), 0, LAYERS - 1)
        own = np.outer(stand.scale[mine] ** 2, area)
        found += np.bincount(rows.ravel(), own.ravel(), minlength=LAYERS)
    return found / stand.area


def drag_slices(tree: Tree, one_sided: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights (SLICES,) in m of a variant and its drag coefficient times area (SLICES,) there, m².

    one_sided : m² of one side of its leaves in a m² of leaf area.
    """
    skeleton, leaves = tree.skeleton, tree.leaves
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    wood = 0.5 * WOOD_DRAG * length * skeleton.radius.sum(axis=1)
    leaf = DRAG * one_sided * np.pi * leaves.radius**2
    z = np.concatenate([(skeleton.start + skeleton.end)[:, 2] / 2, leaves.centre[:, 2]])
    top = max(float(z.max(initial=0.0)), 1e-6)
    row = np.clip((z / top * SLICES).astype(np.int64), 0, SLICES - 1)
    area = np.bincount(row, np.concatenate([wood, leaf]), minlength=SLICES)
    return (np.arange(SLICES) + 0.5) / SLICES * top, area
