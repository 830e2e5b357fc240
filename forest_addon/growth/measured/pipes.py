"""Radii by the pipe model: what a stem bears decides how thick it is, and it ends at its DBH.

r^n is proportional to the number of twigs above (Shinozaki et al. 1964; n = 2 is da Vinci's rule). Below the
crown the pipes of branches that are gone stay in the stem, so that it tapers there too; at the ground it
widens into its roots by exp(-z/1.5 r). The factor follows from the diameter at breast height, exactly.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...spec import Crown
from ..skeleton import Skeleton
from .colonise import Nodes
from .measure import dbh_of

TURN = np.deg2rad(60.0)  # by which an axis goes on at most


def borne(parent: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(N,) what each of N things bears itself and by all that descend from it; parents come first."""
    total = own.astype(float).copy()
    depth = np.zeros(len(parent), dtype=np.int64)
    at, up = np.arange(len(parent)), parent
    while (up >= 0).any():  # pointer by pointer, as many rounds as the deepest thing has parents
        depth[at] += up >= 0
        up = np.where(up >= 0, parent[np.maximum(up, 0)], -1)
    by_depth = np.argsort(-depth, kind="stable")
    edges = np.flatnonzero(np.diff(depth[by_depth], prepend=-1))
    for first, last in zip(edges, [*edges[1:], len(parent)], strict=True):
        rows = by_depth[first:last]
        rows = rows[parent[rows] >= 0]
        np.add.at(total, parent[rows], total[rows])
    return total


def orders_of(nodes: Nodes, total: np.ndarray) -> np.ndarray:
    """(N,) branching order: an axis goes on to what bears most and turns least, the stem to its top.

    Where every child turns away by more than ``TURN`` the axis ends.
    """
    count = len(nodes.parent)
    parent = np.maximum(nodes.parent, 0)
    way = nodes.place - nodes.place[parent]
    length = np.linalg.norm(way, axis=1)
    turn = np.einsum("ni,ni->n", way, way[parent]) / np.maximum(length * length[parent], 1e-12)
    turn = np.where(length[parent] > 0, turn, 1.0)
    rank = total * ((1 + turn) / 2) ** 2 + np.where(nodes.trunk, total.max() + 1, 0)
    up = np.lexsort((rank, nodes.parent))  # of each parent the last is the one that goes on
    last = np.ones(count, dtype=bool)
    last[:-1] = np.diff(nodes.parent[up]) != 0
    goes_on = np.zeros(count, dtype=bool)
    goes_on[up[last]] = True
    goes_on &= nodes.trunk | (turn > np.cos(TURN))
    order = np.zeros(count, dtype=np.int64)
    for node in range(1, count):
        order[node] = order[nodes.parent[node]] + (not goes_on[node])
    return order


def skeleton_of_nodes(nodes: Nodes, total: np.ndarray) -> Skeleton:
    """Segments between nodes, without radii yet; segment k ends at node k + 1."""
    order = orders_of(nodes, total)[1:]
    parent = nodes.parent[1:]
    depth = np.zeros(len(nodes.parent), dtype=np.int64)
    for node in range(1, len(depth)):
        depth[node] = depth[nodes.parent[node]] + 1
    return Skeleton(
        start=nodes.place[parent],
        end=nodes.place[1:],
        radius=np.zeros((len(parent), 2)),
        parent=parent - 1,
        order=order,
        generation=depth[1:] - 1,
    )


def with_radii(skeleton: Skeleton, total: np.ndarray, crown: Crown, dbh: float) -> Skeleton:
    """The skeleton with the radii of its pipes.

    total : (S,) twigs that each segment bears. dbh : that it ends at, metres.
    """
    base = skeleton.start[skeleton.order == 1, 2].min(initial=np.inf)
    foot = dbh / 2

    def thick(z: np.ndarray, pipes: np.ndarray, stem: np.ndarray) -> np.ndarray:
        gone = crown.disused / (1 - crown.disused) * np.clip(1 - z / max(base, 1e-9), 0, 1)
        own = np.maximum(pipes, 0.3) * (1 + np.where(stem, gone, 0.0))
        flare = 1 + crown.flare * np.exp(-np.maximum(z, 0) / max(1.5 * foot, 1e-9))
        return np.asarray(own ** (1 / crown.pipe) * np.where(stem, flare, 1.0))

    stem = skeleton.order == 0
    low = thick(skeleton.start[:, 2], total, stem)
    # An axis narrows along a segment to where it goes on; its last segment to half.
    high = 0.5 * low
    mother = skeleton.parent
    on = np.flatnonzero((mother >= 0) & (skeleton.order == skeleton.order[np.maximum(mother, 0)]))
    high[mother[on]] = low[on]
    radius = np.stack([low, np.minimum(high, low)], axis=1)
    drawn = replace(skeleton, radius=radius)
    found = dbh_of(drawn)
    factor = dbh / found if found > 0 else dbh / (2 * float(radius.max()))
    radius = np.maximum(radius * factor, crown.twig_radius)
    return replace(skeleton, radius=radius)


def scaled_to(skeleton: Skeleton, dbh: float) -> Skeleton:
    """A skeleton whose radii are changed in proportion until the stem has this diameter at breast height."""
    found = dbh_of(skeleton)
    return replace(skeleton, radius=skeleton.radius * (dbh / found)) if found > 0 else skeleton
