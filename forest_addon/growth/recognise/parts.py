"""Parts of a tree in a file: meshes with names, told apart into wood and leaves, and set upright.

Names of objects and materials tell first ("leaf", "bark"); a mesh whose name does not tell is what most
of its area looks like, and a file without names is looked at piece by piece. A piece is a leaf where its
facets face one way (|sum of area vectors| above half of the area: a tube's cancel), where it is a card
or crossed cards (most of its edges are borders), or where it is one of very many small ones that are plain,
as needles are, or have an edge that more than two facets share, as tufts of needles have. The upright axis is
that along which the tree stands on a narrow, solid foot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .pieces import Pieces, edge_uses, part, select

LEAFY = (
    "leaf",
    "leaves",
    "foliage",
    "needle",
    "frond",
    "blade",
    "petal",
    "flower",
    "fruit",
    "card",
)
WOODY = ("wood", "bark", "trunk", "branch", "stem", "twig", "log", "bole")
OTHER = ("ground", "terrain", "floor", "soil", "grass")
FACING = 0.5  # share of a piece's area that faces one way if it is a leaf
BORDER = 0.6  # share of its edges that have one facet only, if it is cards
SMALL = 0.01  # extents of the tree that a needle is long at most
PLAIN = 24  # facets of a needle at most
TUFT = 0.03  # extents that needles with a common edge are long together
MANY = 50  # needles of one make at least, and
OFTEN = 3  # times as many as there are other pieces of wood
FOOT = 0.02  # share of the extent, from the ground up, where the foot is looked for
NARROW = 0.03  # extents that any foot may be wide
CLEARLY = 3.0  # times as good a foot, that an axis other than z is taken for upright
UPRIGHT = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
}


@dataclass(frozen=True)
class Group:
    """Facets (T, 3, 3) of one object and material of a file."""

    name: str
    material: str
    facets: np.ndarray


@dataclass(frozen=True)
class Sorted:
    """Wood, leaves or None, as facets, and in words how they were told apart.

    parted : the same as pieces, where they had to be looked at.
    """

    wood: np.ndarray
    leaves: np.ndarray | None
    said: str
    parted: tuple[Pieces, Pieces | None] | None = None


def sort_out(groups: Sequence[Group]) -> Sorted:
    """Tell wood from leaves."""
    kinds = [_kind_by_name(group) for group in groups]
    named = {kind for kind in kinds if kind in ("wood", "leaves")}
    if named == {"wood", "leaves"} and all(kinds):
        return _gather(groups, kinds, "by name")
    left = [k for k in range(len(groups)) if kinds[k] != "other"]
    facets = np.concatenate([groups[k].facets for k in left] or [np.empty((0, 3, 3))])
    if not len(facets):
        return Sorted(facets, None, "")
    pieces, source = part(facets), None
    leaf = looks_like_leaves(pieces)
    owner = np.repeat(np.arange(len(left)), [len(groups[k].facets) for k in left])
    if len(left) > 1:
        source = _group_of_triangles(pieces, facets, owner)
        area = pieces.area
        total = np.bincount(source, area, len(left))
        leafy = np.bincount(source, area * leaf[pieces.piece], len(left))
        for number, k in enumerate(left):
            if not kinds[k]:
                kinds[k] = "leaves" if leafy[number] > total[number] / 2 else "wood"
        return _gather(groups, kinds, "by name and shape" if named else "by shape")
    if kinds[left[0]]:
        return _gather(groups, kinds, "by name")
    if not leaf.any() or leaf.all():
        return Sorted(facets, None, "", (pieces, None))
    shown = pieces.vertices[pieces.triangles]
    mine = leaf[pieces.piece]
    parted = None
    if len(edge_uses(pieces)[0]) == len(pieces.edges):  # no facet without area joins any of them
        parted = (select(pieces, ~leaf), select(pieces, leaf))
    return Sorted(shown[~mine], shown[mine], "by shape", parted)


def looks_like_leaves(pieces: Pieces) -> np.ndarray:
    """(C,) whether a piece has the shape of a leaf, a card or a needle."""
    count = pieces.count
    vectors = pieces.area_vectors()
    area = np.bincount(pieces.piece, pieces.area, count)
    total = np.stack([np.bincount(pieces.piece, x, count) for x in vectors.T], axis=1)
    facing = np.linalg.norm(total, axis=1) / np.maximum(area, 1e-300)
    triangles = np.bincount(pieces.piece, minlength=count)
    key, times = edge_uses(pieces)
    of_edge = pieces.piece_of_vertex[key // len(pieces.vertices)] if len(key) else key
    edges = np.bincount(of_edge, minlength=count)
    border = np.bincount(of_edge[times == 1], minlength=count) / np.maximum(edges, 1)
    leaf = (facing > FACING) | (border > BORDER)

    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, pieces.piece_of_vertex, pieces.vertices)
    np.maximum.at(high, pieces.piece_of_vertex, pieces.vertices)
    length = np.linalg.norm(high - low, axis=1)
    extent = float(np.ptp(pieces.vertices, axis=0).max())
    small = (triangles <= PLAIN) & (length < SMALL * extent)
    tuft = np.zeros(count, dtype=bool)  # tubes have no edge that three facets share
    tuft[of_edge[times > 2]] = True
    small = ~leaf & (small | (tuft & (length < TUFT * extent)))
    others = int(np.count_nonzero(~leaf & ~small))
    if others and int(np.count_nonzero(small)) >= max(MANY, OFTEN * others):
        leaf |= small
    return np.asarray(leaf)


def likely_up(wood: np.ndarray) -> str:
    """The axis, "z" or "y", along which wood (T, 3, 3) stands on a narrow foot."""
    middle = wood.mean(axis=1)
    area = np.linalg.norm(np.cross(wood[:, 1] - wood[:, 0], wood[:, 2] - wood[:, 0]), axis=1)
    extent = max(float(np.ptp(middle, axis=0).max()), 1e-300)

    def foot(axis: str) -> float:
        place = middle @ UPRIGHT[axis].T
        low = place[:, 2] <= place[:, 2].min() + FOOT * extent
        weight = area[low] / max(float(area[low].sum()), 1e-300)
        mean = weight @ place[low, :2]
        spread = float(np.sqrt(weight @ ((place[low, :2] - mean) ** 2).sum(axis=1))) / extent
        return float(area[low].sum() / area.sum()) / (spread + NARROW) ** 2

    return "y" if foot("y") > CLEARLY * foot("z") else "z"


def stood(parts: Sorted, up: str) -> Sorted:
    """Wood and leaves turned so that this axis points up."""
    if up == "z":
        return parts

    def turned(pieces: Pieces) -> Pieces:
        return replace(pieces, vertices=upright(pieces.vertices, up))

    parted = None
    if parts.parted is not None:
        timber, foliage = parts.parted
        parted = (turned(timber), None if foliage is None else turned(foliage))
    leaves = None if parts.leaves is None else upright(parts.leaves, up)
    return Sorted(upright(parts.wood, up), leaves, parts.said, parted)


def upright(facets: np.ndarray, up: str) -> np.ndarray:
    """Facets (T, 3, 3), or places (V, 3), turned so that this axis points up."""
    return facets if up == "z" else np.asarray(facets @ UPRIGHT[up].T)


def _kind_by_name(group: Group) -> str:
    """Return what the material's name says, or else the object's; empty where neither says."""
    for name in (group.material.lower(), group.name.lower()):
        found = [
            kind
            for kind, words in (("leaves", LEAFY), ("wood", WOODY), ("other", OTHER))
            if any(word in name for word in words)
        ]
        if found:
            return found[0] if len(found) == 1 else ""
    return ""


def _gather(groups: Sequence[Group], kinds: Sequence[str], said: str) -> Sorted:
    def of(kind: str) -> np.ndarray:
        chosen = [g.facets for g, k in zip(groups, kinds, strict=True) if k == kind]
        return np.concatenate(chosen or [np.empty((0, 3, 3))])

    leaves = of("leaves")
    return Sorted(of("wood"), leaves if len(leaves) else None, said)


def _group_of_triangles(pieces: Pieces, facets: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """(T,) group of each triangle that was kept: that of the facet with the same middle."""
    from scipy.spatial import cKDTree

    middle = pieces.vertices[pieces.triangles].mean(axis=1)
    return np.asarray(owner[cKDTree(facets.mean(axis=1)).query(middle)[1]])
