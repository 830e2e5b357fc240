"""A tree recognised in facets: its trunk, what hangs on what, and which wood bears which leaf.

Facets of wood and of leaves go in, in any unit, z up; they are parted into pieces (``pieces``), the wood
gets centrelines (``centreline``) and parents (``hierarchy``), every leaf its bearer. ``template`` cuts
the tree along these lines; a picture of it can be drawn from them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .centreline import Centrelines, find_centrelines
from .hierarchy import Hierarchy, Known, find_bearers, find_parents, find_trunk
from .pieces import Pieces, part
from .sever import may_fork, sever

MOST_LEAN = np.deg2rad(60.0)
FARTHEST_WOOD = 0.25  # heights of the tree between a piece and what it hangs on
LARGEST_LEAF = 0.5  # extents of the wood; what is larger is foliage in one piece, and no leaf
FARTHEST_LEAVES = 0.5  # extents of the wood between it and half of the leaves


class TemplateError(ValueError):
    """Facets that are no tree to take templates from: one sentence with what and what to do."""


@dataclass(frozen=True)
class Recognition:
    """What was recognised, in the units of the facets: C pieces of wood and L leaves.

    wood : the pieces of wood; ``wood.piece`` is the piece of each triangle.
    lines : their centrelines.
    hierarchy : trunk, parent and first-level branch of each piece.
    leaves : the leaves, as pieces; ``leaves.piece`` is the leaf of each triangle.
    bearer : (L,) int64, the piece of wood that bears each leaf.
    """

    wood: Pieces
    lines: Centrelines
    hierarchy: Hierarchy
    leaves: Pieces
    bearer: np.ndarray

    @property
    def trunk(self) -> int:
        """The piece that is the trunk."""
        return self.hierarchy.trunk

    @property
    def parent(self) -> np.ndarray:
        """(C,) the piece that each one hangs on, -1 for the trunk."""
        return self.hierarchy.parent

    @property
    def branch(self) -> np.ndarray:
        """(C,) the first-level branch that each piece belongs to, -1 for the trunk."""
        return self.hierarchy.branch

    @property
    def foot(self) -> np.ndarray:
        """(C, 3) middle of the end at which each piece hangs."""
        return self._of_end(self.lines.ends(), self.hierarchy.foot_end)

    @property
    def tip(self) -> np.ndarray:
        """(C, 3) middle of the other end."""
        return self._of_end(self.lines.ends(), 1 - self.hierarchy.foot_end)

    @property
    def radius(self) -> np.ndarray:
        """(C,) radius at the foot."""
        return self._of_end(self.lines.end_radius, self.hierarchy.foot_end)

    @staticmethod
    def _of_end(values: np.ndarray, end: np.ndarray) -> np.ndarray:
        return np.asarray(values[np.arange(len(end)), end])


def recognise(wood: np.ndarray, leaves: np.ndarray | None = None) -> Recognition:
    """Recognise a tree in facets (T, 3, 3) of its wood and of its leaves.

    Raises
    ------
    TemplateError : there is no trunk with branches, or the leaves cannot be told apart.
    """
    timber, lines, known = _cut_at_forks(_pieces_of(wood, "wood"))
    if timber.count == 1:
        raise TemplateError(
            "the wood is one piece without a fork, so there are no branches to grow from; bring trunk "
            "and branches, joined or as separate parts."
        )
    trunk = find_trunk(timber, lines, known.mother < 0)
    hierarchy = find_parents(lines, trunk, known)
    bare = leaves is None or not len(leaves)
    foliage = part(np.empty((0, 3, 3))) if bare else _pieces_of(leaves, "leaves")
    found = Recognition(timber, lines, hierarchy, foliage, np.empty(0, dtype=np.int64))
    _check_one_tree(found)
    if bare:
        return found
    bearer, gap = find_bearers(lines, foliage)
    _check_leaves(foliage, gap, extent=float(np.ptp(timber.vertices, axis=0).max()))
    return Recognition(timber, lines, hierarchy, foliage, bearer)


def _cut_at_forks(timber: Pieces) -> tuple[Pieces, Centrelines, Known]:
    """Pieces none of which forks, their lines, and what is known of those that were joined."""
    joined = np.ones(1, dtype=bool)
    lines = None
    if timber.count > 1:
        lines = find_centrelines(timber)
        joined = may_fork(timber, lines)
    if joined.any():
        cut = sever(timber, joined)
        if cut.pieces.count > timber.count or lines is None:
            return cut.pieces, find_centrelines(cut.pieces), cut.known
    return timber, lines, Known.nothing(timber.count)


def checked_facets(facets: np.ndarray | None, what: str) -> np.ndarray:
    """Facets as (T, 3, 3) float64; ``TemplateError`` if they are anything else."""
    corners = np.asarray(facets, dtype=np.float64)
    if corners.ndim != 3 or corners.shape[1:] != (3, 3) or not np.isfinite(corners).all():
        raise TemplateError(f"the facets of the {what} must be finite numbers of shape (T, 3, 3).")
    return corners


def _pieces_of(facets: np.ndarray | None, what: str) -> Pieces:
    pieces = part(checked_facets(facets, what))
    if not pieces.count:
        raise TemplateError(f"there is no facet with an area in the {what}; export the mesh again.")
    return pieces


def _check_one_tree(found: Recognition) -> None:
    axis = found.tip[found.trunk] - found.foot[found.trunk]
    lean = float(np.arctan2(np.hypot(axis[0], axis[1]), axis[2]))
    if lean > MOST_LEAN:
        raise TemplateError(
            f"what looks like the trunk leans {np.rad2deg(lean):.0f}° from the z axis; export the tree "
            "with z up, and without ground or other objects."
        )
    height = float(np.ptp(found.wood.vertices[:, 2]))
    if found.hierarchy.gap.max() > FARTHEST_WOOD * height:
        raise TemplateError(
            "some of the wood lies far from the rest; export one tree alone, without other objects."
        )


def _check_leaves(leaves: Pieces, gap: np.ndarray, extent: float) -> None:
    if np.median(gap) > FARTHEST_LEAVES * extent:
        raise TemplateError(
            "the leaves lie far from the wood; export both from the same scene, with the same units "
            "and origin."
        )
    low, high = np.full((leaves.count, 3), np.inf), np.full((leaves.count, 3), -np.inf)
    np.minimum.at(low, leaves.piece_of_vertex, leaves.vertices)
    np.maximum.at(high, leaves.piece_of_vertex, leaves.vertices)
    largest = float((high - low).max())
    if largest > LARGEST_LEAF * extent:
        raise TemplateError(
            f"one leaf is {largest / extent:.0%} as large as the tree, so leaves seem to hang together "
            "along edges; separate them before you export them."
        )
