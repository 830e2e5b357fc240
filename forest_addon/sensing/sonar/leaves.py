"""Leaves as discs: what a foliage echo is computed from, measured on the evaluated scene.

A ``SceneGeometry`` goes in; for every leaf of every instance come out centre, normal and the radius of
the disc of equal area, in world coordinates. A mesh is measured once, in its local space. Rotation and
uniform scale move what was measured; under any other transform each facet's area vector goes through
the cofactor matrix (n·dA maps to cof(M)·n·dA), so that squeezed and sheared instances are exact too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from ... import kernels
from ...acoustics.disc import SMALLEST, amplitude_bound, disc_amplitudes
from ...acoustics.disc_table import HANDOVER, table_error
from ...base.rows import distinct, lengths
from ...base.trimesh import TriMesh
from ...growth.mesh.leaves import pieces_of
from ..rays.geometry import apply_transform
from .facets import PIECE, Rims, glints, rims, share_of_turn
from .scatterers import (
    LEAF,
    Population,
    Scatterers,
    Sight,
    Strength,
    StrengthParts,
    Views,
    cluster,
)

SIMILAR = 1e-6  # a rotation with a scale, but for the float32 that Blender keeps it in


@dataclass(frozen=True)
class LeafDiscs:
    """L leaves as discs in world coordinates.

    centre : (L, 3) area centroid, metres. normal : (L, 3) unit, of the summed area; of no sense where
    the radius is 0. radius : (L,) metres, of the disc of equal area.
    instance : (L,) int64. leaf : (L,) int64, number in the instance's mesh. tree : (L,) int64, or -1.
    """

    centre: np.ndarray
    normal: np.ndarray
    radius: np.ndarray
    instance: np.ndarray
    leaf: np.ndarray
    tree: np.ndarray

    def __len__(self) -> int:
        return len(self.radius)


Measured = tuple[np.ndarray, np.ndarray, np.ndarray]  # centre (L, 3), normal (L, 3), radius (L,)


class FoliageDiscs:
    """The leaves of one mesh: F facets, leaf by leaf, and what they measure in local space.

    What is in pieces, as a shoot of needles, is a disc for each of them: no wave knows that they grow on one.
    leaf : (L,) their numbers, the same for pieces of one. local : centre, normal and radius of each.
    """

    def __init__(self, mesh: TriMesh) -> None:
        facets = np.flatnonzero(mesh.leaf >= 0)
        facets = facets[np.argsort(mesh.leaf[facets], kind="stable")]
        owner, leaf = own_pieces(mesh.leaf[facets], mesh.triangles[facets])
        self.leaf = leaf.astype(np.int64)
        order = np.argsort(owner, kind="stable")
        facets, owner = facets[order], owner[order]
        self._first = np.searchsorted(owner, np.arange(len(self.leaf) + 1))
        corners = mesh.vertices[mesh.triangles[facets]]
        self._middle = corners.mean(axis=1)
        vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._vector = _turned_alike(vector, owner, len(self.leaf))
        self.local = _measure(self._middle, self._vector, owner, len(self.leaf))

    @classmethod
    def of_discs(cls, discs: LeafDiscs) -> FoliageDiscs:
        """Discs that are measured already, in the world; only similarities may move them."""
        made = cls.__new__(cls)
        made.leaf = discs.leaf
        centre, normal = np.ascontiguousarray([discs.centre, discs.normal], np.float64)
        made.local = centre, normal, np.ascontiguousarray(discs.radius, np.float64)
        return made

    def moved(self, transform: np.ndarray, rows: np.ndarray | None = None) -> Measured:
        """The leaves, or those of some rows, through one (3, 4) transform."""
        linear = transform[:, :3]
        rows = np.arange(len(self.leaf)) if rows is None else rows
        scale = float(similarity(linear))
        if scale >= 0:
            centre, normal, radius = self.local
            turned = normal[rows] @ linear.T / (scale or 1.0)
            return apply_transform(transform, centre[rows]), turned, scale * radius[rows]
        size = self._first[rows + 1] - self._first[rows]
        owner = np.repeat(np.arange(len(rows)), size)
        facet = np.arange(len(owner)) + np.repeat(self._first[rows] - np.cumsum(size) + size, size)
        middle = apply_transform(transform, self._middle[facet])
        return _measure(middle, self._vector[facet] @ cofactor(linear).T, owner, len(rows))


def own_pieces(number: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Piece, and its leaf, that each triangle (F, 3) is of: pieces counted on (F,), and their leaves
    (L,).

    number : (F,) of the leaf, sorted.
    """
    leaf, owner = np.unique(number, return_inverse=True)
    piece = pieces_of(number, triangles) if len(number) else None
    if piece is None:
        return owner, leaf
    pairs, owner = np.unique(np.stack([number, piece], axis=1), axis=0, return_inverse=True)
    return owner.ravel(), pairs[:, 0].astype(leaf.dtype)


def similarity(linear: np.ndarray) -> np.ndarray:
    """(...) scales of matrices (..., 3, 3) that turn, mirror and scale evenly; NaN of any other."""
    gram = np.swapaxes(linear, -1, -2) @ linear
    scale = np.sqrt(gram[..., 0, 0])
    square = gram[..., :1, :1]
    even = (np.abs(gram - square * np.eye(3)) <= SIMILAR * square).all(axis=(-1, -2))
    return np.where(even, scale, np.nan)


def cofactor(linear: np.ndarray) -> np.ndarray:
    """(3, 3) what area vectors go through when points go through ``linear``."""
    x, y, z = linear.T
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)


def _measure(middle: np.ndarray, vector: np.ndarray, owner: np.ndarray, count: int) -> Measured:
    """Centre, normal and radius of ``count`` leaves from facets (F, 3), (F, 3) and their owners."""
    area = np.linalg.norm(vector, axis=1)
    whole = np.bincount(owner, area, count)
    weight = np.where(whole[owner] > 0, area, 1.0)  # no area: the mean of the facets
    centre = _sum(middle * weight[:, None], owner, count)
    centre /= np.bincount(owner, weight, count)[:, None]
    normal = _sum(vector, owner, count)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.tile([0.0, 0.0, 1.0], (count, 1)), where=length > 0)
    return centre, normal, np.sqrt(whole / math.pi)


def _turned_alike(vector: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """Area vectors (F, 3), each turned to agree with its leaf's largest facet: windings may differ."""
    order = np.argsort(np.linalg.norm(vector, axis=1), kind="stable")
    largest = np.zeros((count, 3))
    largest[owner[order]] = vector[order]  # the last one written stays
    against = np.einsum("fi,fi->f", vector, largest[owner]) < 0
    return np.where(against[:, None], -vector, vector)


def _sum(values: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) sums of (F, 3) values by owner."""
    sums = [np.bincount(owner, values[:, axis], count) for axis in range(3)]
    return np.stack(sums, axis=1).astype(np.float64)  # of nothing, bincount counts whole numbers


# The echo of a disc.
#
# A leaf is a disc of its own area whose scattering is that of ``acoustics/disc``. Well off its
# normal a piston's echo comes from two places of its rim, the nearest and the farthest, whose interference
# is what wiggles in frequency: each alone is smooth.


LATER = 1.0  # radii by which a disc's response that crosses its face is later than that of its rims
PAPER_REACH = 0.3  # radii to both sides
PAPER_TURN = (
    0.45  # about radians at ka = 1 by which the fit's angle turns while the frequency doubles
)
GRAZING = (
    np.pi / 3
)  # beyond it, the formula for large discs is up to 79 % off; they are faint there
FAR = 2.0  # ka² from where on f/r² holds within 0.1 dB, for the sound that is mirrored


@dataclass(frozen=True)
class DiscStrength(Strength):
    """radius, incidence : (M,) metres and radians. nearness : (M,) a factor of the amplitude. later : (M,) or
    one, radii by which their delays are taken to be later. side : as of ``disc_amplitudes``."""

    radius: np.ndarray
    incidence: np.ndarray
    nearness: np.ndarray
    model: str
    later: np.ndarray | float = 0.0
    side: np.ndarray | None = None

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        return disc_amplitudes(
            wavenumber,
            self.radius,
            self.incidence,
            self.nearness,
            self.model,
            self.later,
            self.side,
        )

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        far = amplitude_bound(lowest, highest, self.radius, self.incidence, self.model)
        return self.nearness * far

    def parts(self, lowest: float, highest: float) -> StrengthParts:
        """Parts of a piston, far enough off its normal: the two places of its rim that sound, one as minus
        the conjugate of the other; of an exact disc the disc itself, some time later: its rims' sound crosses
        its face."""
        if self.model == "paper":
            return self.whole()
        if self.model == "exact":
            late = LATER * self.radius[None]
            return replace(self.whole(), offset=late, strength=replace(self, later=LATER))
        across = 2.0 * self.radius * np.sin(self.incidence)
        rims = across > max(SMALLEST / lowest, np.pi / (highest - lowest))
        held = np.where(rims, self.nearness, 0.5 * self.nearness)  # of all of a disc twice a half
        strength = replace(self, nearness=held, side=rims.astype(np.int8))
        late = np.where(rims, across, 0.0)
        return replace(
            self.whole(),
            offset=np.stack([late, -late]),
            strength=strength,
            second=np.full(len(late), -1.0),
            conjugate=True,
        )

    def reach(self, wavenumber: float) -> np.ndarray:
        if self.model == "paper":  # has the beam of the mirror direction, and no rim
            turn = PAPER_TURN * self.incidence / np.maximum(wavenumber * self.radius, 1e-3)
            return PAPER_REACH * self.radius + turn / wavenumber
        rims = (
            2.0 * self.radius * np.sin(self.incidence.astype(np.float32))
        )  # in a tenth of the time
        if self.model == "exact":
            return rims + LATER * self.radius
        return rims if self.side is None else np.where(self.side == 0, rims, 0.0)

    def error(self, highest: float) -> np.ndarray | None:
        if self.model != "exact":
            return None
        return self.radius * table_error(highest * self.radius, self.incidence)


@dataclass(frozen=True)
class LeafEchoes(Scatterers):
    """Leaves as discs: unit normal (M, 3), radius (M,).

    nearness : (M,) what the amplitudes are multiplied with.
    """

    normal: np.ndarray
    radius: np.ndarray
    nearness: np.ndarray
    model: str
    kind: ClassVar[str] = LEAF

    def count_close(self, instance: np.ndarray) -> int:
        return int(np.count_nonzero(self.nearness < (2.0 - (2.0 * FAR) ** -2) ** -0.5))

    def count_doubtful(self, point: np.ndarray, wavenumber: float) -> int:
        large = self.select((self.model == "exact") & (wavenumber * self.radius > HANDOVER))
        return int(np.count_nonzero(large.incidence(point) > GRAZING))

    def seen(self, point: np.ndarray) -> Strength:
        return DiscStrength(self.radius, self.incidence(point), self.nearness, self.model)

    def incidence(self, point: np.ndarray) -> np.ndarray:
        """(M,) radians between their normals and the way to a point."""
        library = kernels.library()
        if library is not None:
            angle = np.empty(len(self))
            places = (np.ascontiguousarray(each) for each in (self.centre, self.normal, point))
            library.incidences(len(self), *places, angle)
            return angle
        way = self.centre - point
        # Sine and cosine both keep their digits, face-on and edge-on.
        grazing = lengths(np.cross(way, self.normal))
        return np.arctan2(grazing, np.abs(np.einsum("mi,mi->m", way, self.normal)))


# Leaves within their near field, where a disc is no point: their faces, and what the models add.
#
# Far off a disc sends back f/r². Nearer than about 2ka² the waves from its middle and its rim
# no longer arrive in step, and f/r² is too loud where it mirrors. There a leaf is a flat face and sounds as
# ``facets`` do, by Kirchhoff's integral at its true distance: the mirror's echo where the foot of the sonar
# lies on it, and its rim. On its axis that is |p| = |sin(ka²/2r)|/r: never more than twice an endless
# mirror's 1/2r, which a disc of just one Fresnel zone reaches.
#
# The exact disc differs from physical optics by what its edge adds: the far field's difference, which holds
# the way to the nearest and the farthest place of the rim to the first order. Both are later by a²cos²β/2r to
# the second, so that the difference comes as if from √(r² + a²cos²β) away, times r²/(r² + a²). Against the
# rigid disc for a point source, ka 3 to 37, all incidences: off by at most 15 % of the loudest echo of
# that distance at r = 1.5 a, 12 % at 2 a, 5 % from 3 a and 3 % from 6 a on (90 % of all: 6 %). Beyond 45°,
# where it is faint, it may be off by half of itself and more. The paper's fit has no near field: it is held
# below 1/r by 1/√(1 + x²), x = ka²/2r, from where a face would take over.


ASIDE = 6.0  # a/r: sine of the incidence from where two places of the rim sound
CLOSEST = 20.0  # radii within which all leaves are faces
CLOSE = 0.5  # ka² from where the near field is so that f/r² has no sense
CORNERS = (48, 1024)  # of the polygon that stands for a disc: at least, at most
EDGE = 1.05  # of a, no |f| of the exact disc less physical optics is larger


def near_field(distance: np.ndarray, radius: np.ndarray, wavenumber: float) -> np.ndarray:
    """(M,) bool: leaves that may be too near for f/r²."""
    return distance < FAR * wavenumber * radius**2


def needs_face(leaves: LeafEchoes, sight: Sight) -> np.ndarray:
    """(M,) bool: leaves that are too near for f/r² as they are turned.

    Well off its normal a disc sounds from two places of its rim, whose waves do not care how far the
    middle is: f/r² is right there but for 1/2·a/(r·sinβ) of each, until r is some radii.
    """
    distance = lengths(leaves.centre - sight.point)
    near = near_field(distance, leaves.radius, sight.wavenumber)
    near &= (distance <= sight.reach) & (distance >= sight.nearest)
    rows = np.flatnonzero(near)
    some, away = leaves.select(rows), distance[rows]
    mirrors = np.sin(some.incidence(sight.point)) < ASIDE * some.radius / away
    near[rows] = mirrors | (away < CLOSEST * some.radius)
    return near


def subdued(distance: np.ndarray, radius: np.ndarray, wavenumber: float) -> np.ndarray:
    """(M,) what the paper's fit is multiplied with; 1 far off."""
    x = wavenumber * radius**2 / (2.0 * np.maximum(distance, 1e-9))
    return (1.0 + np.maximum(x**2 - 1.0 / (2.0 * FAR) ** 2, 0.0)) ** -0.5


@dataclass(frozen=True)
class NearFaces(Rims):
    """Pieces of the faces of near leaves; see ``Rims``. close : (M,) bool, nearer than ka²/2."""

    close: np.ndarray
    kind: ClassVar[str] = LEAF

    def count(self, instance: np.ndarray, some: np.ndarray) -> int:
        return len(distinct((instance * (self.number.max(initial=0) + 1) + self.number)[some]))

    def count_close(self, instance: np.ndarray) -> int:
        return self.count(instance, self.close)


def near_faces(leaves: LeafEchoes, sight: Sight) -> tuple[NearFaces, np.ndarray]:
    """Discs as polygons of equal area, in pieces, disc by disc, and (M,) the rows of their discs."""
    centre, normal = leaves.centre - sight.point, leaves.normal
    radius, number = leaves.radius, leaves.number
    height = np.einsum("mi,mi->m", centre, normal)
    normal = np.where(height > 0, -1.0, 1.0)[:, None] * normal  # towards the sonar
    height = np.abs(height)
    foot = -height[:, None] * normal
    turned = np.where(np.abs(normal[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(normal, turned)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normal, across)
    nearest = np.maximum(np.linalg.norm(centre, axis=1) - radius, 1e-3)
    longest = PIECE * np.sqrt(2.0 * math.pi * nearest / sight.wavenumber)
    corners = np.clip(2.0 * math.pi * radius / longest, *CORNERS)
    corners = (16 * np.ceil(corners / 16)).astype(np.int64)
    pieces = []  # numbered by the rows of their discs: an edge may be in parts, or out of range
    for count in distinct(corners).tolist():
        some = corners == count
        angle = 2.0 * math.pi * np.arange(count) / count
        size = radius[some] * math.sqrt(2.0 * math.pi / (count * math.sin(2.0 * math.pi / count)))
        ring = (
            np.cos(angle)[:, None] * across[some, None] + np.sin(angle)[:, None] * along[some, None]
        )
        ring = centre[some, None] + size[:, None, None] * ring  # (m, count, 3)
        ends = np.stack([ring, np.roll(ring, -1, axis=1)], axis=2).reshape(-1, 2, 3)
        row = np.flatnonzero(some).repeat(count)
        pieces.append(rims(ends, foot[row], normal[row], height[row], row, sight))
        share = share_of_turn(ring, foot[some], normal[some])
        glint = np.flatnonzero(some)[share > 0]
        pieces.append(glints(foot[glint], height[glint], share[share > 0], glint))
    made = Rims.joined(pieces)
    made = made.select(np.argsort(made.number, kind="stable"))
    row = made.number
    close = np.linalg.norm(centre, axis=1) < CLOSE * sight.wavenumber * radius**2
    return NearFaces(
        made.centre + sight.point, number[row], made.weight, made.slope, close[row]
    ), row


def near_groups(leaves: LeafEchoes, sight: Sight) -> list[tuple[Scatterers, np.ndarray]]:
    """Near leaves as their faces, and what exact ones add, each with the rows of its leaves."""
    groups: list[tuple[Scatterers, np.ndarray]] = [near_faces(leaves, sight)]
    if leaves.model == "exact":
        groups.append((NearEdges(**vars(leaves)), np.arange(len(leaves))))
    return groups


@dataclass(frozen=True)
class EdgeStrength(Strength):
    """Part of the exact disc beyond physical optics; radius, incidence, share (M,), and late (M,), metres of
    path by which the edge is heard after the middle."""

    radius: np.ndarray
    incidence: np.ndarray
    share: np.ndarray
    late: np.ndarray

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        given = wavenumber, self.radius, self.incidence, self.share
        edge = disc_amplitudes(*given, "exact") - disc_amplitudes(*given, "piston")
        return edge * np.exp(-1j * wavenumber[:, None] * self.late)

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        return EDGE * self.share * self.radius

    def reach(self, wavenumber: float) -> np.ndarray:
        return 2.0 * (np.sin(self.incidence) + LATER) * self.radius + self.late

    def error(self, highest: float) -> np.ndarray:
        return self.share * self.radius * table_error(highest * self.radius, self.incidence)


@dataclass(frozen=True)
class NearEdges(LeafEchoes):
    """Near leaves without what their faces sound like; these count."""

    def count(self, instance: np.ndarray, some: np.ndarray) -> int:
        return 0

    def seen(self, point: np.ndarray) -> Strength:
        distance, incidence = lengths(self.centre - point), self.incidence(point)
        share = distance**2 / (distance**2 + self.radius**2)
        late = 2.0 * (np.hypot(distance, self.radius * np.cos(incidence)) - distance)
        return EdgeStrength(self.radius, incidence, share, late)


# The leaves of one mesh, in blocks, and how loud a block of them can be.
#
# A block of leaves has a table of bounds by the direction it is seen from, because leaves that face away
# are hundreds of times weaker than leaves that face the sonar. Leaves near the sonar become faces.


def spiral(count: int) -> np.ndarray:
    """(count, 3) unit directions evenly over the upper hemisphere (Fibonacci's spiral)."""
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    side = np.sqrt(1.0 - z**2)
    return np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)


SPREADS = np.array([0.08, 0.16, 0.32])  # radians between views of one block
VIEWS = spiral(96)  # of a block, one of each pair of opposite directions
BETWEEN = 0.23  # radians from any direction to the nearest of these, at most
RADII, STEPS = 8, 90  # classes of radii, steps of incidence


class LeafPopulation(Population):
    """The leaves of one mesh."""

    kind: ClassVar[str] = LEAF

    def __init__(self, foliage: FoliageDiscs, model: str) -> None:
        centre, _, radius = foliage.local
        self.blocks = cluster(centre, np.where(np.isfinite(radius), radius, np.nan))
        self._foliage, self._model = foliage, model
        self._largest = self.blocks.each(np.maximum, radius[self.blocks.order])
        self._tables: dict[tuple[float, float], np.ndarray] = {}

    @property
    def held(self) -> tuple[np.ndarray, np.ndarray]:
        return self.table[0], self.table[3]

    def ceiling(self, views: Views, lowest: float, highest: float) -> np.ndarray:
        widened = np.sqrt(views.stretch[:, 0] * views.stretch[:, 1]) * self._largest[views.block]
        most = self.blocks.count[views.block] * amplitude_bound(
            lowest, highest, widened, np.zeros(1), self._model
        )
        scale = views.stretch[:, 0]
        alike = scale - views.stretch[:, 2] <= 2 * SIMILAR * scale
        spread = np.searchsorted(SPREADS, views.spread)
        known = np.flatnonzero(alike & (spread < len(SPREADS)))
        if len(known):
            # A bound grows with the radius at most as its square, and at least as its root.
            larger = np.maximum(scale[known] ** 2, np.sqrt(scale[known]))
            view = np.abs(views.direction[known] @ VIEWS.T).argmax(axis=1)
            table = self._directed(lowest, highest)
            some = larger * table[views.block[known], view, spread[known]]
            most[known] = np.minimum(most[known], some)
        # A near face is never louder than 1/r, and its rim adds what the edge does.
        near = near_field(views.nearest, widened, highest)
        face = self.blocks.count[views.block] * (views.nearest + EDGE * widened)
        return np.where(near, np.maximum(most, face), most)

    def _directed(self, lowest: float, highest: float) -> np.ndarray:
        """(B, V, S) bounds on Σ|f| of blocks that are seen from ``VIEWS``, give or take ``SPREADS``.

        Radii are rounded up to a few classes, incidences down to steps, and a bound is made to fall with
        the incidence, so that two look-ups a leaf and view do.
        """
        key = (lowest, highest)
        if key not in self._tables:
            normal, radius = self.table[1], np.nan_to_num(self.table[2], posinf=0.0)
            classes = np.quantile(radius, np.linspace(0.0, 1.0, RADII + 1)[1:])
            step = np.linspace(0.0, np.pi / 2, STEPS + 1)
            bound = amplitude_bound(lowest, highest, classes[:, None], step, self._model)
            bound = np.maximum.accumulate(bound[:, ::-1], axis=1)[:, ::-1].astype(np.float32)
            row = np.searchsorted(classes, radius)[:, None] * np.int64(STEPS + 1)
            cosine = np.abs(normal @ VIEWS.T)
            incidence = np.arccos(np.minimum(np.nan_to_num(cosine), 1.0)).astype(np.float32)
            tables = []
            for spread in SPREADS:
                place = np.maximum(incidence - np.float32(spread + BETWEEN), 0.0) * (
                    2 * STEPS / np.pi
                )
                some = bound.ravel().take(row + place.astype(np.int64))
                tables.append(np.add.reduceat(some, self.blocks.first[:-1], axis=0))
            self._tables[key] = 1.00001 * np.stack(tables, axis=-1)  # sums in single precision
        return self._tables[key]

    def scatterers(self, transform: np.ndarray, rows: np.ndarray, sight: Sight) -> list[Scatterers]:
        leaf = self.blocks.order[rows]
        centre, normal, radius = self._foliage.moved(transform, leaf)
        number = self._foliage.leaf[leaf]
        if sight.turns is not None:
            centre, normal = sight.turns(number, centre, normal)
        far = LeafEchoes(centre, number, normal, radius, np.ones(len(leaf)), self._model)
        if self._model == "paper":
            distance = lengths(centre - sight.point)
            return [replace(far, nearness=subdued(distance, radius, sight.wavenumber))]
        near = needs_face(far, sight)
        if not near.any():
            return [far]
        return [far.select(~near), *(made for made, _ in near_groups(far.select(near), sight))]

    @cached_property
    def table(self) -> tuple[np.ndarray, ...]:
        """Centres, normals, radii and numbers of the leaves, in the order of the blocks."""
        order, foliage = self.blocks.order, self._foliage
        return tuple(column.take(order, 0) for column in (*foliage.local, foliage.leaf))
