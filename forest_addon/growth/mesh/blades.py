"""Leaves from sites: a flat shape is laid at every site, all leaves at once.

A shape lies in a unit frame: foot at the origin, x along the midrib from 0 to 1, y across it from -0.5 to
0.5, z up. A site gives it foot, direction, upper side, length and width. What is known of the shape in
the unit frame (its area, its middle) gives the truth of every leaf without measuring triangles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..skeleton import LeafSites
from .edges import repeated_edges
from .leaves import Leaves
from .trimesh import LEAF, TriMesh

BLADE_SLOT = 1  # material slot


class BladeError(ValueError):
    """Facets that are no leaf: one sentence with what and what to do."""


@dataclass(frozen=True, eq=False)
class Blade:
    """The shape of a leaf in its unit frame.

    vertices : (K, 3); z, in leaf lengths, is how the leaf is curved.
    triangles : (F, 3) int32, facing up.
    """

    vertices: np.ndarray
    triangles: np.ndarray

    @cached_property
    def middle(self) -> tuple[float, float]:
        """x and y of the area's centre."""
        area = self._areas()
        centre = self.vertices[self.triangles, :2].mean(axis=1)
        x, y = (centre * area[:, None]).sum(axis=0) / area.sum()
        return float(x), float(y)

    @cached_property
    def share(self) -> float:
        """Area over length times width."""
        return float(self._areas().sum())

    def _areas(self) -> np.ndarray:
        a, b, c = (self.vertices[self.triangles[:, k], :2] for k in range(3))
        cross = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        return np.asarray(0.5 * np.abs(cross))


def ellipse(corners: int = 8) -> Blade:
    """An ellipse as a polygon, widened a little so that its area is the ellipse's, π/4."""
    angle = np.pi + 2 * np.pi * np.arange(corners) / corners
    x, y = 0.5 + 0.5 * np.cos(angle), 0.5 * np.sin(angle)
    y *= 2 * np.pi / (corners * np.sin(2 * np.pi / corners))
    return _fan(np.stack([x, y], axis=1))


def oval() -> Blade:
    """An egg-shaped leaf of four triangles, folded a little along its midrib."""
    outline = np.array([[0, 0], [0.32, -0.5], [0.72, -0.36], [1, 0], [0.72, 0.36], [0.32, 0.5]])
    lifted = np.array([0, 0.06, 0.05, 0, 0.05, 0.06])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]], dtype=np.int32)
    return Blade(np.column_stack([outline, lifted]), triangles)


def needle() -> Blade:
    """A narrow rhomb, two triangles."""
    return _fan(np.array([[0, 0], [0.45, -0.5], [1, 0], [0.45, 0.5]]))


def maple() -> Blade:
    """Five pointed lobes, as of Acer; triangles fan out from the end of the stalk."""
    half = np.array(
        [
            [0.00, -0.00],
            [-0.04, -0.26],
            [0.16, -0.24],
            [0.32, -0.50],
            [0.42, -0.28],
            [0.78, -0.40],
            [0.62, -0.14],
            [1.00, 0.00],
        ]
    )
    half[:, 0] = (half[:, 0] + 0.04) / 1.04
    outline = np.concatenate([half, half[-2:0:-1] * [1, -1]])
    outline[0] = (0.0, 0.0)
    hub = np.array([[0.26, 0.0]])
    count = len(outline)
    corner = np.arange(count)
    triangles = np.stack([np.full(count, count), corner, (corner + 1) % count], axis=1)
    vertices = np.concatenate([outline, hub])
    return Blade(np.column_stack([vertices, np.zeros(count + 1)]), triangles.astype(np.int32))


SHAPES = {"ellipse": ellipse, "maple": maple, "needle": needle, "oval": oval}


def blade_from(facets: np.ndarray) -> Blade:
    """A user's leaf, (T, 3, 3) facets in any unit and position, brought into the unit frame.

    Its longest extent becomes x, its thinnest z; its foot is the end nearer to the facets' origin.

    Raises
    ------
    BladeError : the facets have no length or no width.
    """
    corners, index = np.unique(facets.reshape(-1, 3), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3).astype(np.int32)
    centre = corners.mean(axis=0)
    frame = np.linalg.svd(corners - centre, full_matrices=False)[2]
    frame[2] = np.cross(frame[0], frame[1])
    ends = [corners[np.argmin(corners @ frame[0])], corners[np.argmax(corners @ frame[0])]]
    if np.linalg.norm(ends[0]) > np.linalg.norm(ends[1]):
        frame[:2] *= -1
    place = (corners - centre) @ frame.T
    low, high = place.min(axis=0), place.max(axis=0)
    long, wide = high[0] - low[0], high[1] - low[1]
    if not (long > 0 and wide > 1e-6 * long):
        raise BladeError("the leaf has no area; export its mesh again.")
    foot = place[place[:, 0] <= low[0] + 1e-3 * long].mean(axis=0)
    vertices = (place - [low[0], foot[1], foot[2]]) / [long, wide, long]
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    if np.cross(b - a, c - a)[:, 2].sum() < 0:
        vertices[:, 1:] *= -1
    return Blade(vertices, triangles)


def lay(sites: LeafSites, blade: Blade, *, order: np.ndarray | None = None) -> TriMesh:
    """The mesh of all leaves: numbers as in ``sites``, material slot 1, and the atlas 0..1 as uv.

    order : (L,) branching order of what bears each leaf, or None.
    """
    count, corners, facets = len(sites), len(blade.vertices), len(blade.triangles)
    along, across, upward = _frame(sites)
    place = np.concatenate([sites.foot, along, across, upward], axis=1)  # (L, 12)
    unit = np.concatenate([np.ones((corners, 1)), blade.vertices], axis=1)  # (K, 4)
    vertices = place @ np.einsum("kp,ij->pikj", unit, np.eye(3)).reshape(12, 3 * corners)
    first = (corners * np.arange(count)).astype(np.int32)
    atlas = np.stack([blade.vertices[:, 0], blade.vertices[:, 1] + 0.5], axis=1).astype(np.float32)
    return TriMesh(
        vertices=vertices.reshape(-1, 3),
        triangles=(first[:, None, None] + blade.triangles).reshape(-1, 3),
        part=np.full(count * facets, LEAF, dtype=np.int8),
        leaf=np.repeat(np.arange(count, dtype=np.int32), facets),
        material=np.full(count * facets, BLADE_SLOT, dtype=np.int32),
        uv=np.tile(np.clip(atlas, 0, 1)[blade.triangles], (count, 1, 1)),
        order=None if order is None else np.repeat(order.astype(np.int8), facets),
        edges=repeated_edges(blade.triangles, corners, count),
    )


def truth_of(sites: LeafSites, blade: Blade, branch: np.ndarray) -> Leaves:
    """The truth of the leaves of ``lay``; of a curved leaf, that of its flat outline.

    branch : (L,) the branch that bears each leaf.
    """
    along, across, _ = _frame(sites)
    x, y = blade.middle
    normal = sites.up - np.einsum("li,li->l", sites.up, sites.direction)[:, None] * sites.direction
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    return Leaves(
        centre=sites.foot + x * along + y * across,
        normal=normal,
        axis=sites.direction,
        length=sites.length,
        width=sites.width,
        radius=np.sqrt(blade.share * sites.length * sites.width / np.pi),
        branch=branch.astype(np.int32),
    )


def thin_leaves(sites: LeafSites, share: float, rng: np.random.Generator) -> LeafSites:
    """Level of detail: keep this share of the leaves, enlarged so that the total area stays.

    A leaf that a smaller share keeps, a larger one keeps too, from the same stream.
    """
    count = len(sites)
    rank = rng.permutation(count)
    kept = np.flatnonzero(rank < max(round(share * count), min(count, 1)))
    if len(kept) == count:
        return sites
    area = sites.length * sites.width
    size = np.sqrt(area.sum() / max(area[kept].sum(), np.finfo(float).tiny))
    thinned = {name: getattr(sites, name)[kept] for name in ("foot", "direction", "up", "segment")}
    return replace(
        sites, **thinned, length=sites.length[kept] * size, width=sites.width[kept] * size
    )


def _frame(sites: LeafSites) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(L, 3) three times: images of x, y and z of the unit frame."""
    d, u = sites.direction, sites.up
    side = np.empty_like(d)
    side[:, 0] = u[:, 1] * d[:, 2] - u[:, 2] * d[:, 1]
    side[:, 1] = u[:, 2] * d[:, 0] - u[:, 0] * d[:, 2]
    side[:, 2] = u[:, 0] * d[:, 1] - u[:, 1] * d[:, 0]
    length, width = sites.length[:, None], sites.width[:, None]
    return d * length, side * width, u * length


def _fan(outline: np.ndarray) -> Blade:
    """A convex outline (K, 2), counter-clockwise, in triangles from its foot."""
    corner = np.arange(1, len(outline) - 1)
    triangles = np.stack([np.zeros_like(corner), corner, corner + 1], axis=1)
    return Blade(np.column_stack([outline, np.zeros(len(outline))]), triangles.astype(np.int32))
