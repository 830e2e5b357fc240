"""Leaves from sites: a flat shape is laid at every site, all leaves at once.

A shape lies in a unit frame: foot at the origin, x along the midrib from 0 to 1, y across it from -0.5 to
0.5, z up. A site gives it foot, direction, upper side, length and width. What is known of the shape in
the unit frame (its area, its middle) gives the truth of every leaf without measuring triangles.

Leaves of species have outline, midrib, stalk and bend, as facets in that unit frame. A blade is given by one
half of its outline, from foot to tip. Facets join it to the midrib, along which the halves are folded
upwards; the whole is bent down along a circle. The stalk comes before it: both together are the leaf's
length. There are two blades of each shape, of equal area: one of few facets for trees, and one with teeth,
lobes and a bent midrib for what is seen from close by.

A shoot of needles is one blade: few large facets whose mean shadow is that of all its needles. A needle is a
cylinder; its mean shadow over all directions, πld/4, is that of a flat strip l·(πd/2), which is half of its
surface. Needles of a shoot shade each other: the mean shadow of the whole shoot is smaller than the sum by
the clumping factor 4·STAR (Oker-Blom & Smolander 1988). It is found by drawing the shoot from directions
spread over the sphere. A shoot of fewer facets has them so wide that its mean shadow is the same, to a
thousandth of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from itertools import pairwise

import numpy as np

from ...base.rng import child_keys
from ...base.trimesh import LEAF, TriMesh
from ...base.vectors import cross_rows, unit
from ...spec import Leaf, Needles
from ..draw import GOLDEN, draw_normal
from ..skeleton import LeafSites
from .leaves import Leaves
from .meshing import repeated_edges

BLADE_SLOT = 1  # material slot
ABOUT = 0.85  # of the way to its middle, about which a leaf is enlarged
FEW = 4096  # leaves at a time
CLOSE = 0.001  # metres of tolerance, below which leaves have all their facets
FOLD = 0.10  # height of an edge over the midrib, of the blade's width
STALK = 0.014  # half the width of a stalk, of the blade's width
FINE_RIBS = np.array([0.2, 0.4, 0.6, 0.8])

Outline = np.ndarray  # (K, 2): along the blade from 0 to 1, and half its width up to 0.5
DIRECTIONS, PIXELS = 16, 256
CLOSELY = 150, 128  # directions and pixels
BARE = 0.06  # of a shoot's foot without needles
APART = 0.12  # radians between a needle and the middle of its fascicle


class BladeError(ValueError):
    """Facets that are no leaf: one sentence with what and what to do."""


@dataclass(frozen=True, eq=False)
class Blade:
    """The shape of a leaf in its unit frame.

    vertices : (K, 3); z, in leaf lengths, is how the leaf is curved.
    triangles : (F, 3) int32, facing up.
    atlas : (K, 2) texture coordinates along the blade and across it, 0 to 1; None: x, and y + 0.5.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    atlas: np.ndarray | None = field(default=None, kw_only=True)

    @cached_property
    def middle(self) -> tuple[float, float]:
        """x and y of the area's centre."""
        area = self._areas()
        centre = self.vertices[self.triangles, :2].mean(axis=1)
        x, y = (centre * area[:, None]).sum(axis=0) / area.sum()
        return float(x), float(y)

    @cached_property
    def curved(self) -> bool:
        """True where it leaves the plane."""
        return bool(self.vertices[:, 2].any())

    @property
    def by_facets(self) -> bool:
        """True where its area is that of its facets: of a curved leaf, not of one that stands for
        more."""
        return self.curved

    @cached_property
    def share(self) -> float:
        """Area of the outline over length times width."""
        return float(self._areas().sum())

    def _areas(self) -> np.ndarray:
        a, b, c = (self.vertices[self.triangles[:, k], :2] for k in range(3))
        cross = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        return np.asarray(0.5 * np.abs(cross))


def _fan(outline: np.ndarray, lifted: np.ndarray | float = 0.0) -> Blade:
    """A convex outline (K, 2), counter-clockwise, of these heights (K,), in triangles from its foot."""
    corner = np.arange(1, len(outline) - 1)
    triangles = np.stack([np.zeros_like(corner), corner, corner + 1], axis=1)
    height = np.broadcast_to(lifted, len(outline))
    return Blade(np.column_stack([outline, height]), triangles.astype(np.int32))


def _ellipse() -> Blade:
    """An ellipse as a polygon, widened a little so that its area is the ellipse's, π/4."""
    angle = np.pi + np.pi / 4 * np.arange(8)
    y = 0.5 * np.sin(angle) * (2 * np.pi / (8 * np.sin(np.pi / 4)))
    return _fan(np.stack([0.5 + 0.5 * np.cos(angle), y], axis=1))


def _maple() -> Blade:
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


SHAPES = {  # an oval leaf is egg-shaped and folded a little along its midrib, a needle a narrow rhomb
    "ellipse": _ellipse(),
    "maple": _maple(),
    "needle": _fan(np.array([[0, 0], [0.45, -0.5], [1, 0], [0.45, 0.5]])),
    "oval": _fan(
        np.array([[0, 0], [0.32, -0.5], [0.72, -0.36], [1, 0], [0.72, 0.36], [0.32, 0.5]]),
        np.array([0, 0.06, 0.05, 0, 0.05, 0.06]),
    ),
}


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


def lay(
    sites: LeafSites,
    blade: Blade,
    *,
    order: np.ndarray | None = None,
    wood: TriMesh | None = None,
) -> TriMesh:
    """The mesh of all leaves: numbers as in ``sites``, material slot 1, and the atlas 0..1 as uv.

    order : (L,) branching order of what bears each leaf, or None.
    wood : a mesh without leaves that comes first in the result, as ``join`` would have it. Leaves are written
        where they stay: of a large tree, copying takes as long as laying.
    """
    first = TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), LEAF) if wood is None else wood
    count, corners, facets = len(sites), len(blade.vertices), len(blade.triangles)
    v, t = len(first.vertices), len(first.triangles)
    vertices = np.empty((v + count * corners, 3))
    vertices[:v] = first.vertices
    _place(sites, blade, vertices[v:].reshape(count, 3 * corners))
    triangles = np.empty((t + count * facets, 3), dtype=np.int32)
    triangles[:t] = first.triangles
    foot = (v + corners * np.arange(count)).astype(np.int32)
    pattern = blade.triangles.reshape(-1).astype(np.int32)
    np.add(foot[:, None], pattern, out=triangles[t:].reshape(count, 3 * facets))
    atlas = np.stack([blade.vertices[:, 0], blade.vertices[:, 1] + 0.5], axis=1)
    atlas = atlas if blade.atlas is None else blade.atlas
    own = np.clip(atlas, 0, 1).astype(np.float32)[blade.triangles]
    before = np.zeros((t, 3, 2), dtype=np.float32) if first.uv is None else first.uv
    borne = None
    if order is not None:
        bearing = np.empty(0, np.int8) if first.order is None else first.order
        borne = np.concatenate([bearing, np.repeat(order.astype(np.int8), facets)])
    return TriMesh(
        vertices=vertices,
        triangles=triangles,
        part=np.append(first.part, np.full(count * facets, LEAF, np.int8)),
        leaf=np.append(first.leaf, np.repeat(np.arange(count, dtype=np.int32), facets)),
        material=np.append(first.material, np.full(count * facets, BLADE_SLOT, np.int32)),
        uv=partial(_textured, before, own, count),  # type: ignore[arg-type]
        order=borne,
        # Only a Blender mesh needs both; kept, they would be as large as the triangles four times.
        edges=partial(repeated_edges, blade.triangles, corners, count, first.edges, v),
    )


def _textured(before: np.ndarray, own: np.ndarray, count: int) -> np.ndarray:
    """Texture coordinates (T, 3, 2) before those (F, 3, 2) of a leaf, so many times."""
    return np.concatenate([before, np.tile(own, (count, 1, 1))])


def _place(sites: LeafSites, blade: Blade, out: np.ndarray) -> None:
    """Write the corners of all leaves into ``out`` (L, 3 K)."""
    unit = np.concatenate([np.ones((len(blade.vertices), 1)), blade.vertices], axis=1)  # (K, 4)
    for part in _parts(len(sites)):
        place = np.stack([sites.foot[part], *_frame(sites, part)], axis=1)  # (L, 4, 3)
        # Small products one by one: of one large product BLAS would make threads, which mostly wait.
        np.matmul(unit, place, out=out[part].reshape(len(place), len(unit), 3))


def truth_of(sites: LeafSites, blade: Blade, branch: np.ndarray) -> Leaves:
    """The truth of the leaves of ``lay``: of a curved leaf, as its facets have it; of a shoot, where they
    are, and the area of the needles that they stand for.

    branch : (L,) the branch that bears each leaf.
    """
    centre, normal = np.empty_like(sites.foot), np.empty_like(sites.up)
    area = np.empty(len(sites))
    x, y = blade.middle
    for part in _parts(len(sites)):
        if blade.curved:
            centre[part], normal[part], area[part] = _curved(sites, part, blade)
            continue
        along, across, _ = _frame(sites, part)
        centre[part] = sites.foot[part] + x * along + y * across
        normal[part] = _facing(sites, part)
    if not blade.by_facets:
        area = blade.share * sites.length * sites.width
    return Leaves(
        centre=centre,
        normal=normal,
        axis=sites.direction,
        length=sites.length,
        width=sites.width,
        radius=np.sqrt(area / np.pi),
        branch=branch.astype(np.int32),
    )


def facings(sites: LeafSites, blade: Blade) -> np.ndarray:
    """(L, 3) unit normals of leaves: of a curved one the mean of its facets, which leans to its tip."""
    if not blade.curved:
        return sites.up
    normals = [_curved(sites, part, blade)[1] for part in _parts(len(sites))]
    return np.concatenate(normals) if normals else sites.up


def leaf_areas(sites: LeafSites, blade: Blade) -> np.ndarray:
    """(L,) m² of one side of the leaves of ``lay``."""
    if not blade.by_facets:
        return np.asarray(blade.share * sites.length * sites.width)
    areas = [_facet_areas(sites, part, blade).sum(axis=1) for part in _parts(len(sites))]
    return np.concatenate(areas) if areas else np.empty(0)


def _facet_areas(sites: LeafSites, part: slice, blade: Blade) -> np.ndarray:
    """(L, F) areas of the facets of some of the leaves.

    The images of the unit frame's axes, x, y and z, turn a facet of area vector h into one whose square is
    h·A·h, where A is the adjugate of the images' Gram matrix (Cauchy and Binet); y is across x and z.
    """
    d, u = sites.direction[part], sites.up[part]
    dd, uu, du = (np.einsum("li,li->l", p, q) for p, q in ((d, d), (u, u), (d, u)))
    long, wide = sites.length[part] ** 2, sites.width[part] ** 2
    flat = np.maximum(dd * uu - du * du, 0.0)
    across = long * wide * flat
    adjugate = np.stack([across * uu, long * long * flat, across * dd, -2 * across * du], axis=1)
    h = _area_vectors(blade)
    terms = np.stack([h[:, 0] ** 2, h[:, 1] ** 2, h[:, 2] ** 2, h[:, 0] * h[:, 2]])
    square = adjugate @ terms
    return np.asarray(np.sqrt(np.maximum(square, 0.0, out=square), out=square))


def _area_vectors(blade: Blade) -> np.ndarray:
    """(F, 3) half the cross products of the edges of a blade's facets."""
    a, b, c = (blade.vertices[blade.triangles[:, k]] for k in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))


def _curved(
    sites: LeafSites, part: slice, blade: Blade
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre (L, 3), normal (L, 3) and area (L,) of some of the leaves, from their facets' areas.

    The images of the unit frame's axes, X, Y and Z, turn an area vector h into
    h_x Y×Z + h_y Z×X + h_z X×Y.
    """
    x, y, z = _frame(sites, part)
    size = _facet_areas(sites, part, blade)
    area = size.sum(axis=1)
    middle = size @ blade.vertices[blade.triangles].mean(axis=1)
    middle /= np.maximum(area, np.finfo(float).tiny)[:, None]
    centre = sites.foot[part] + middle[:, :1] * x + middle[:, 1:2] * y + middle[:, 2:] * z
    whole = _area_vectors(blade).sum(axis=0)
    normal = whole[0] * cross_rows(y, z) + whole[1] * cross_rows(z, x) + whole[2] * cross_rows(x, y)
    length = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(length, np.finfo(float).tiny)[:, None]
    all_round = length < 0.5 * area  # a shoot: it faces as what bears it has it
    normal[all_round] = _facing(sites, part)[all_round]
    return centre, normal, area


def _facing(sites: LeafSites, part: slice) -> np.ndarray:
    """(L, 3) what is up of some leaves, across their direction."""
    u, d = sites.up[part], sites.direction[part]
    return unit(u - np.einsum("li,li->l", u, d)[:, None] * d)


def thin_leaves(
    sites: LeafSites,
    share: float,
    rng: np.random.Generator,
    middle: float = 0.5,
    area: np.ndarray | None = None,
) -> LeafSites:
    """Level of detail: keep this share of the leaves, enlarged so that the total area stays.

    A leaf that a smaller share keeps, a larger one keeps too, from the same stream. It grows about nearly the
    middle of its area, ``middle`` of its length from its foot: about its foot it would carry area out of the
    crown and out of the shade of its neighbours. Leaves left at random are more clumped than all of them, so
    that a little of that is right; how much was found by rays through trees of all measured species.

    area : (L,) of the leaves; left out: as their lengths times widths.
    """
    count = len(sites)
    rank = rng.permutation(count)
    kept = np.flatnonzero(rank < max(round(share * count), min(count, 1)))
    if len(kept) == count:
        return sites
    area = sites.length * sites.width if area is None else area
    size = np.sqrt(area.sum() / max(area[kept].sum(), np.finfo(float).tiny))
    left = sites.select(kept)
    back = ABOUT * middle * (size - 1) * left.length[:, None] * left.direction
    return replace(left, foot=left.foot - back, length=left.length * size, width=left.width * size)


def _parts(count: int) -> Iterator[slice]:
    """Leaves in so few at a time that what is made of them stays in the processor's cache."""
    for first in range(0, count, FEW):
        yield slice(first, first + FEW)


def _frame(sites: LeafSites, part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(L, 3) three times: images of x, y and z of the unit frame, of some of the leaves."""
    d, u = sites.direction[part], sites.up[part]
    length, width = sites.length[part, None], sites.width[part, None]
    return d * length, cross_rows(u, d) * width, u * length


def _toothed(outline: Outline, teeth: int, deep: float) -> Outline:
    """An outline with teeth that point to the tip."""
    x, y = outline.T
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    place = np.linspace(0, along[-1], 2 * teeth + 1)[1:-1]
    out = np.stack([np.interp(place, along, x), np.interp(place, along, y)], axis=1)
    out[::2, 1] *= 1 - deep
    out[1::2, 0] += 0.01
    return out


def _beech() -> tuple[Outline, Outline]:
    x = np.linspace(0, 1, 12)[1:-1]
    y = 0.5 * np.sin(np.pi * x**0.92) ** 0.85 * (1 - 0.35 * x**7)
    y *= 1 + 0.025 * np.cos(np.arange(10) * np.pi)
    return np.array([[0.28, 0.44], [0.70, 0.40]]), np.stack([x, y], axis=1)


# By shape, half an outline of few corners and one of many.
HALVES: dict[str, tuple[Outline, Outline]] = {
    "beech": _beech(),
    "birch": (
        np.array([[0.14, 0.42], [0.36, 0.46], [0.70, 0.17]]),
        _toothed(
            np.array(
                [
                    *([0, 0], [0.08, 0.26], [0.2, 0.45], [0.3, 0.5]),
                    *([0.5, 0.36], [0.75, 0.14], [0.9, 0.04], [1, 0]),
                ]
            ),
            9,
            0.10,
        ),
    ),
    "oak": (
        np.array([[0.35, 0.30], [0.62, 0.44], [0.88, 0.27]]),
        np.array(
            [
                *([0.06, 0.06], [0.14, 0.13], [0.20, 0.22], [0.26, 0.14], [0.33, 0.30]),
                *([0.39, 0.38], [0.44, 0.20], [0.50, 0.40], [0.57, 0.50], [0.63, 0.26]),
                *([0.70, 0.40], [0.77, 0.43], [0.81, 0.24], [0.88, 0.30], [0.93, 0.27]),
                *([0.95, 0.14], [0.99, 0.10]),
            ]
        ),
    ),
    "palmate": (
        np.array(
            [
                *([-0.04, 0.26], [0.16, 0.24], [0.32, 0.50], [0.42, 0.28], [0.78, 0.40]),
                [0.62, 0.14],
            ]
        ),
        np.array(
            [
                *([-0.05, 0.12], [-0.04, 0.27], [0.06, 0.26], [0.10, 0.34], [0.17, 0.30]),
                *([0.20, 0.38], [0.24, 0.40], [0.33, 0.52], [0.33, 0.40], [0.40, 0.40]),
                *([0.38, 0.27], [0.48, 0.33], [0.56, 0.40], [0.60, 0.36], [0.80, 0.42]),
                *([0.70, 0.30], [0.72, 0.24], [0.60, 0.13], [0.70, 0.145], [0.78, 0.155]),
                *([0.84, 0.09], [0.90, 0.08]),
            ]
        ),
    ),
}


@lru_cache(maxsize=64)
def leaf_blade(leaf: Leaf, tolerance: float) -> Blade:
    """The blade of a species' leaf.

    tolerance : of the tree's mesh, metres; below a millimetre the blade has all its facets.
    """
    if leaf.shape not in HALVES:
        return SHAPES[leaf.shape]
    light, fine = HALVES[leaf.shape]
    hub = leaf.shape == "palmate"
    full = _blade(fine, np.array([0.25]) if hub else FINE_RIBS, leaf)
    if tolerance < CLOSE:
        return full
    plain = _blade(light, np.array([0.25]) if hub else np.empty(0), leaf)
    wide = plain.vertices * [1, full.share / plain.share, 1]
    return replace(plain, vertices=wide)


def _blade(half: Outline, ribs: np.ndarray, leaf: Leaf) -> Blade:
    """A blade with its stalk: the outline's right half, its midrib, its left half."""
    sides, middle = len(half), len(ribs)
    rib = np.stack([ribs, np.zeros(middle)], axis=1)
    right, left = half * [1, -1], half
    flat = np.concatenate([[[0.0, 0.0]], right, rib, left, [[1.0, 0.0]]])
    tip = len(flat) - 1
    line = [0, *range(1 + sides, 1 + sides + middle), tip]
    join = _around if leaf.shape == "palmate" else _between
    triangles = join([0, *range(1, 1 + sides), tip], line, flat)
    triangles += join([0, *range(1 + sides + middle, tip), tip], line, flat)
    stalk = leaf.petiole / (1 + leaf.petiole)
    height = FOLD * np.abs(flat[:, 1]) * 2 * (leaf.width_ratio.mean)
    bend = np.deg2rad(leaf.curl_deg)
    along, down = flat[:, 0], 0.0 * height
    if bend:
        turn = bend * flat[:, 0]
        size = np.sin(bend) if abs(bend) < 1.5 else bend  # a leaf's length is that of its chord
        along, down = np.sin(turn) / size, (1 - np.cos(turn)) / size
    vertices = np.stack([stalk + (1 - stalk) * along, flat[:, 1], (1 - stalk) * (height - down)], 1)
    atlas = flat + np.array([0.0, 0.5])
    if stalk > 0:
        foot = len(vertices)
        stem = np.array([[0.0, -STALK, 0.0], [0.0, STALK, 0.0]])
        vertices = np.concatenate([vertices, stem])
        atlas = np.concatenate([atlas, [[0.0, 0.5], [0.0, 0.5]]])
        triangles.append([foot, 0, foot + 1])
    facets = np.array(triangles, dtype=np.int32)
    a, b, c = (vertices[facets[:, k], :2] for k in range(3))
    down_facing = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    facets[down_facing] = facets[down_facing][:, ::-1]
    return Blade(vertices, facets, atlas=np.clip(atlas, 0.0, 1.0))


def _between(edge: list[int], line: list[int], flat: np.ndarray) -> list[list[int]]:
    """Triangles between two lines of corners that start and end alike, the shorter diagonal first."""
    i = j = 0
    triangles = []
    while i + 1 < len(edge) or j + 1 < len(line):
        on_edge = i + 1 < len(edge)
        if on_edge and j + 1 < len(line):
            ahead = [
                np.linalg.norm(flat[a] - flat[b])
                for a, b in ((edge[i + 1], line[j]), (edge[i], line[j + 1]))
            ]
            on_edge = bool(ahead[0] <= ahead[1])
        corners = [edge[i], edge[i + 1] if on_edge else line[j + 1], line[j]]
        i, j = (i + 1, j) if on_edge else (i, j + 1)
        if len(set(corners)) == 3:
            triangles.append(corners)
    return triangles


def _around(edge: list[int], line: list[int], flat: np.ndarray) -> list[list[int]]:
    """Triangles between an outline and the middle of the blade, from which all of it is seen."""
    return [[line[1], a, b] for a, b in pairwise(edge)]


def set_leaves(
    leaf: Leaf,
    keys: np.ndarray,
    foot: np.ndarray,
    heading: np.ndarray,
    across: np.ndarray,
    azimuth: np.ndarray,
    segment: np.ndarray,
) -> LeafSites:
    """L leaves, their sizes and angles drawn by key.

    foot, heading, across : (L, 3) where they sit, the branch's direction and one at right angles to it.
    azimuth : (L,) radians about the branch, from ``across``.
    segment : (L,) what bears them.
    """
    angle = np.deg2rad(draw_normal(leaf.angle_deg, keys, "leaf angle"))[:, None]
    around = np.cos(azimuth)[:, None] * across
    around = around + np.sin(azimuth)[:, None] * cross_rows(heading, across)
    direction = unit(np.cos(angle) * heading + np.sin(angle) * around)
    blade = draw_normal(leaf.length, keys, "leaf length")
    width = blade * draw_normal(leaf.width_ratio, keys, "leaf width")
    length = blade * (1 + stalk_of(leaf))
    up = -direction[:, 2:] * direction  # as far up as the direction allows
    up[:, 2] += 1.0
    up[np.abs(direction[:, 2]) > 1 - 1e-12] = (1.0, 0.0, 0.0)
    return LeafSites(foot, direction, unit(up), length, width, segment)


def leaves_on_nodes(
    leaf: Leaf, keys: np.ndarray, foot: np.ndarray, heading: np.ndarray, segment: np.ndarray
) -> LeafSites:
    """Leaves at the nodes of T twigs, ``leaf.per_node`` at each, turned from node to node by the fan angle.

    keys : (T,) lineage of the twigs. foot, heading : (T, leaf.nodes, 3) of nodes. segment : (T,) what bears
    them.
    """
    each = leaf.nodes * leaf.per_node
    number = np.tile(np.arange(each), len(keys))
    node, side = np.divmod(number, leaf.per_node)
    foot, heading = (np.repeat(v.reshape(-1, 3), leaf.per_node, axis=0) for v in (foot, heading))
    azimuth = 2 * np.pi * side / leaf.per_node + np.deg2rad(leaf.fan_deg) * node
    keys = child_keys(np.repeat(keys, each), number)
    bearer = np.repeat(segment, each)
    return set_leaves(leaf, keys, foot, heading, across(heading), azimuth, bearer)


def stalk_of(leaf: Leaf) -> float:
    """Length of a leaf's stalk over its blade's; 0 of shapes that have none."""
    return leaf.petiole if leaf.shape in HALVES and not leaf.mesh else 0.0


def across(heading: np.ndarray) -> np.ndarray:
    """(L, 3) a horizontal unit vector at right angles to each heading; +X for a vertical one."""
    side = np.stack([-heading[:, 1], heading[:, 0], np.zeros(len(heading))], axis=1)
    size = np.linalg.norm(side, axis=1, keepdims=True)
    return np.where(size > 1e-9, side / np.maximum(size, 1e-9), np.array([1.0, 0.0, 0.0]))


@dataclass(frozen=True, eq=False)
class Shoot(Blade):
    """A blade that stands for needles.

    needle_area : of all its needles, half their surface, over the square of the shoot's length.
    shadow : mean over all directions, over the square of the shoot's length.
    """

    needle_area: float = 0.0
    shadow: float = 0.0

    @property
    def by_facets(self) -> bool:
        """No: they are as wide as their shadow wants."""
        return False

    @property
    def share(self) -> float:  # type: ignore[override]
        """One-sided needle area over length times width."""
        return self.needle_area

    @property
    def clumping(self) -> float:
        """Shadow over that of the same needles apart, 4·STAR."""
        return 2 * self.shadow / self.needle_area


@lru_cache(maxsize=32)
def shoot_of(needles: Needles, length: float) -> Shoot:
    """The blade of a shoot of this length, metres, in its unit frame (width = length)."""
    reach, wide = needles.length / length, np.pi / 2 * needles.diameter / length
    area = needles.count * reach * wide
    full = _strips(needles.count, reach, wide, needles)
    shadow = mean_shadow(*full)
    count = needles.blades
    if not count or count >= needles.count:
        return Shoot(*full, area, shadow)
    # As if they hid nothing of each other.
    width = wide * needles.count / count * shadow / (area / 2)
    return Shoot(*_shading(count, reach, width, needles, shadow, 4), area, shadow)


@lru_cache(maxsize=32)
def coarse_shoot(needles: Needles, length: float, blades: int) -> Shoot:
    """A shoot of fewer blades in place of ``shoot_of``: the same needles, and the same mean shadow.

    Few blades hide much more from some sides than from others, so that both are seen from many.
    """
    fine = shoot_of(needles, length)
    wanted = mean_shadow(fine.vertices, fine.triangles, *CLOSELY)
    width = np.pi / 2 * needles.diameter / length * needles.count / blades
    strips = _shading(blades, needles.length / length, width, needles, wanted, 6, *CLOSELY)
    return Shoot(*strips, fine.needle_area, fine.shadow)


def _shading(
    count: int, reach: float, width: float, needles: Needles, shadow: float, rounds: int, *seen: int
) -> tuple[np.ndarray, np.ndarray]:
    """Strips of needles made wider or narrower until their mean shadow, seen so, is this."""
    for _ in range(rounds):
        width *= (shadow / mean_shadow(*_strips(count, reach, width, needles), *seen)) ** 1.2
    return _strips(count, reach, width, needles)


def mean_shadow(
    vertices: np.ndarray,
    triangles: np.ndarray,
    directions: int = DIRECTIONS,
    pixels: int = PIXELS,
) -> float:
    """Mean over directions of the area that triangles hide, by drawing them."""
    total = 0.0
    k = np.arange(directions) + 0.5
    z, azimuth = 1 - k / directions, GOLDEN * k  # half a sphere: both ways hide the same
    for dz, turn in zip(z, azimuth, strict=True):
        flat = np.sqrt(1 - dz * dz)
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        up = np.array([-dz * np.cos(turn), -dz * np.sin(turn), flat])
        seen = np.stack([vertices @ right, vertices @ up], axis=1)
        low, size = seen.min(axis=0), float(np.ptp(seen, axis=0).max())
        last = pixels - 1
        drawn = _drawn((seen - low) / size * last, triangles, pixels)
        total += drawn * (size / last) ** 2
    return total / directions


def _drawn(corners: np.ndarray, triangles: np.ndarray, pixels: int) -> float:
    """Pixels whose middle lies in any of the triangles."""
    picture = np.zeros((pixels, pixels), dtype=bool)
    corner = corners[triangles]
    low = np.floor(corner.min(axis=1)).astype(int).tolist()
    high = (np.ceil(corner.max(axis=1)).astype(int) + 1).tolist()
    place = np.arange(pixels + 1)
    for (x0, y0), (x1, y1), (a, b, c) in zip(low, high, corner.tolist(), strict=True):
        x, y = place[x0:x1], place[y0:y1, None]
        first, second, third = (
            (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
            for p, q in ((a, b), (b, c), (c, a))
        )
        inside = np.minimum(np.minimum(first, second), third) >= 0
        inside |= np.maximum(np.maximum(first, second), third) <= 0
        picture[y0:y1, x0:x1] |= inside
    return float(picture.sum())


def _strips(
    count: int, reach: float, wide: float, needles: Needles
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of needles around x from 0 to 1: narrow kites, each turned about itself.

    Those of a fascicle spring from one place and lean apart. They stand along all of the shoot, so that the
    last stand out beyond its end.
    """
    k, angle = np.arange(count), np.deg2rad(needles.angle_deg)
    bundle, of_bundle = np.divmod(k, needles.together)
    bundles = -(-count // needles.together)
    along = BARE + (1 - BARE) * (bundle + 0.5) / bundles
    azimuth, lean = GOLDEN * bundle, angle * (1 - 0.5 * (bundle / bundles) ** 3)
    radial = np.stack([np.zeros(count), np.cos(azimuth), np.sin(azimuth)], axis=1)
    way = np.cos(lean)[:, None] * [1.0, 0, 0] + np.sin(lean)[:, None] * radial
    side = unit(np.cross(way, radial))
    third = np.cross(way, side)
    if needles.together > 1:
        round_it = 2 * np.pi * of_bundle[:, None] / needles.together
        apart = np.cos(round_it) * side + np.sin(round_it) * third
        way = np.cos(APART) * way + np.sin(APART) * apart
        side = unit(np.cross(way, radial))
        third = np.cross(way, side)
    turn = 2.4 * k[:, None]
    side = np.cos(turn) * side + np.sin(turn) * third
    foot = along[:, None] * [1.0, 0, 0]
    middle = foot + 0.5 * reach * way
    # A kite has half the area of its box: twice as wide in the middle as the strip that it stands for.
    corners = np.stack(
        [foot, middle - wide * side, foot + reach * way, middle + wide * side], axis=1
    )
    first = 4 * k[:, None, None]
    triangles = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return corners.reshape(-1, 3), triangles.astype(np.int32)
