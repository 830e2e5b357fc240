"""Collars: where a branch leaves its mother it is thicker, and narrows to its own radius a diameter further.

The first segment of a branch is cut there. Its lower part is a cone whose radius at the mother's surface is
(1 + c) times the branch's own, so that wood, its mesh and its truth have the collar alike.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..skeleton import LeafSites, Skeleton

THIN = 0.008  # metres of radius; what is thinner has no collar
FATTEST = 0.9  # of the mother's radius


def collared(skeleton: Skeleton, sites: LeafSites, collar: float) -> tuple[Skeleton, LeafSites]:
    """The tree with collars: each a segment more, right before that which it was cut from.

    collar : how much thicker than the branch, relative; 0: the tree as it is.
    """
    count, mother = len(skeleton), np.maximum(skeleton.parent, 0)
    along = skeleton.end - skeleton.start
    length = np.linalg.norm(along, axis=1)
    own, thick = skeleton.radius[:, 0], skeleton.radius[mother].mean(axis=1)
    reach = np.minimum(thick + 2 * own, 0.8 * length)
    has = (skeleton.parent >= 0) & (skeleton.order > skeleton.order[mother]) & (own >= THIN)
    has &= reach > 1.2 * thick
    if collar <= 0 or not has.any():
        return skeleton, sites
    number = np.arange(count) + np.cumsum(has)  # of what a segment was, behind its collar
    cut, lower = np.flatnonzero(has), number[has] - 1
    total = count + len(cut)
    split = skeleton.start[cut] + (reach / length)[cut, None] * along[cut]
    share = (reach / length)[cut]
    at_cut = own[cut] + share * (skeleton.radius[cut, 1] - own[cut])
    wide = own[cut] * (1 + collar * reach[cut] / (reach - thick)[cut])
    wide = np.maximum(np.minimum(wide, FATTEST * thick[cut]), own[cut])

    def spread(values: np.ndarray) -> np.ndarray:
        made = np.empty((total, *values.shape[1:]), dtype=values.dtype)
        made[number], made[lower] = values, values[cut]
        return made

    start, end, radius = spread(skeleton.start), spread(skeleton.end), spread(skeleton.radius)
    start[number[cut]] = end[lower] = split
    radius[lower, 0], radius[lower, 1] = wide, at_cut
    radius[number[cut], 0] = at_cut
    parent = spread(np.where(skeleton.parent < 0, -1, number[mother]))
    parent[number[cut]] = lower
    more = has.astype(np.int64)
    for level in range(1, int(skeleton.generation.max()) + 1):
        rows = np.flatnonzero(skeleton.generation == level)
        more[rows] += more[skeleton.parent[rows]]
    generation = spread(skeleton.generation + more)
    generation[lower] -= 1
    wood = Skeleton(start, end, radius, parent, spread(skeleton.order), generation)
    on = np.where(sites.segment < 0, -1, number[np.maximum(sites.segment, 0)])
    return wood, replace(sites, segment=on)
