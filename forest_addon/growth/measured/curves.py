"""Limbs as smooth curves: a cubic piece for every segment of a skeleton, cut again into short segments.

Nodes are first drawn towards their neighbours until no limb bends more tightly than its thickness allows.
The tangent at a node is the direction of the circle through it and its neighbours, so that pieces join
without an elbow; a tip bends on as it came. A limb sets out between its parent's direction and its own, the
more along the parent the more nearly it is as thick: a fork divides, a spur stands out. Pieces are cut where
a straight segment would leave the curve by more than a tolerance; what is straight stays whole.

Where a limb leaves its parent it swells in a collar, and narrows to its own radius like a trumpet's bell. At
the parent's surface a limb is (1 + c) times as thick as it would be. Over a reach of a few of its radii that
falls off by a power, steeply at first, so that the two surfaces meet in a hollow and not in a crease. The
collar is in the radii of the skeleton: wood, its mesh and its truth have it alike. Within the parent the limb
keeps the width that it has at the surface, and stays inside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.runs import numbered
from ...base.vectors import beside_segments, cross_rows
from ..skeleton import Axes, LeafSites, Skeleton, depths, find_axes

TIGHT = 2.0  # smallest radius of a bend over that of the limb
ROUNDS = 24  # of drawing nodes together
THIN = 0.004  # metres of radius, below which a twig sets out straight
LIMB = 0.012  # metres of radius, from which it is a limb
AWAY, FAR = 0.0015, 0.003  # metres between a curve and its segments: of a limb, of what is thinner
TURN = 0.32  # radians between two segments of a limb, at most; a piece bends mostly at its ends
MOST = 10  # segments of a piece
SHORT = 0.002  # metres of the shortest segment that a cut leaves
FORK = 0.7  # how far along its parent a limb as thick as that sets out
TAPER = 0.22  # metres of radius that a limb loses on a metre, at most
WIDE = 1.0  # radians between a tangent and the chord of its piece, at most
NO_COLLAR = 0.008  # metres of radius; what is thinner has no collar
FATTEST = 0.92  # of the parent's radius
REACH = 3.0  # radii of the limb over which it narrows, and
ROOM = 0.35  # of its parent's
HALF = 0.5  # of an axis that its collar takes at most
POWER = 2.4
STEPS = np.array([0.0, 0.1, 0.22, 0.38, 0.6, 1.0])  # of the reach, where the bell is cut
STEEPEST = 0.5  # sine of the angle to the parent below which a limb no longer comes out later


@dataclass(frozen=True)
class Curves:
    """A cubic piece for each of S segments: its ends and, times its chord's length, its tangents there.

    start, end, out, into : (S, 3) metres.
    """

    start: np.ndarray
    end: np.ndarray
    out: np.ndarray
    into: np.ndarray

    def at(self, row: np.ndarray, u: np.ndarray) -> np.ndarray:
        """(N, 3) places on pieces ``row`` (N,) at shares ``u`` (N,) of them."""
        u = u[:, None]
        v = 1 - u
        return np.asarray(
            v * v * (1 + 2 * u) * self.start[row]
            + u * u * (3 - 2 * u) * self.end[row]
            + u * v * (v * self.out[row] - u * self.into[row])
        )

    def heading(self, row: np.ndarray, u: np.ndarray) -> np.ndarray:
        """(N, 3) unit tangents there."""
        u = u[:, None]
        chord = self.end[row] - self.start[row]
        way = (
            6 * u * (1 - u) * chord
            + (1 - u) * (1 - 3 * u) * self.out[row]
            + u * (3 * u - 2) * self.into[row]
        )
        return _unit(way)


def curved(skeleton: Skeleton, sites: LeafSites, collar: float = 0.0) -> tuple[Skeleton, LeafSites]:
    """The tree with smooth limbs, and where its leaves then sit.

    collar : how much thicker a limb is where it leaves its parent, relative (``collars``).
    """
    if not len(skeleton):
        return skeleton, sites
    axes = find_axes(skeleton)
    joints = _joints(skeleton, axes)
    curves = _fitted(skeleton, axes, joints, _relaxed(skeleton, axes))
    collars = collars_of(skeleton, axes, curves.start, curves.end, joints.share, collar)
    row, u = _cuts(skeleton, curves, collars)
    return _resampled(skeleton, axes, curves, collars, row, u, joints), _moved_sites(
        skeleton, sites, curves, row, u
    )


@dataclass(frozen=True)
class _Joints:
    """Joints of the first segments of axes with their parents.

    head : (S,) whether a segment starts an axis. share : (S,) of the parent's length; 1 at its end.
    aside : (S, 3) from there to the start, 0 of all but first segments. level : (S,) of the axis: 0 of roots.
    """

    head: np.ndarray
    share: np.ndarray
    aside: np.ndarray
    level: np.ndarray


def _joints(skeleton: Skeleton, axes: Axes) -> _Joints:
    count = len(skeleton)
    head = np.zeros(count, dtype=bool)
    first = axes.segment[axes.first[:-1]]
    head[first] = True
    share, aside = np.ones(count), np.zeros((count, 3))
    borne = first[skeleton.parent[first] >= 0]
    parent = skeleton.parent[borne]
    way = skeleton.end[parent] - skeleton.start[parent]
    share[borne], aside[borne] = beside_segments(skeleton.start[borne], skeleton.start[parent], way)
    axis = axes.of_segment
    bearer = np.where(skeleton.parent[first] >= 0, axis[np.maximum(skeleton.parent[first], 0)], -1)
    return _Joints(head, share, aside, depths(bearer)[axis])


def _relaxed(skeleton: Skeleton, axes: Axes) -> np.ndarray:
    """(S, 3) ends of segments, drawn together until bends are as wide as the limb's thickness asks."""
    end = skeleton.end.copy()
    after = axes.onward
    before = np.full(len(skeleton), -1)
    before[after[after >= 0]] = np.flatnonzero(after >= 0)
    here = axes.segment[after[axes.segment] >= 0]
    onward, before = after[here], before[here]
    thick = TIGHT * np.maximum(skeleton.radius[here, 1], skeleton.radius[onward, 0])
    for _ in range(ROUNDS):
        a = np.where((before >= 0)[:, None], end[np.maximum(before, 0)], skeleton.start[here])
        b, c = end[here], end[onward]
        cross = cross_rows(b - a, c - b)
        sides = [np.einsum("ni,ni->n", v, v) for v in (b - a, c - b, c - a)]
        bend = 2 * np.sqrt(
            np.einsum("ni,ni->n", cross, cross) / np.maximum(sides[0] * sides[1] * sides[2], 1e-30)
        )  # 1 / radius of the circle through three nodes
        tight = bend * thick > 1
        if not tight.any():
            break
        here, onward, before, thick = here[tight], onward[tight], before[tight], thick[tight]
        middle = 0.5 * (a[tight] + c[tight])
        end[here] += 0.5 * (middle - b[tight])
    return end


def _fitted(skeleton: Skeleton, axes: Axes, joints: _Joints, end: np.ndarray) -> Curves:
    """The pieces through moved nodes (S, 3), axes after those that bear them."""
    start = skeleton.start.copy()
    onward = axes.onward
    curves = Curves(start, end, np.empty_like(end), np.empty_like(end))
    for level in range(int(joints.level.max()) + 1):
        of_level = joints.level == level
        heads = np.flatnonzero(of_level & joints.head)
        root = skeleton.parent[heads] < 0
        parent, share = np.maximum(skeleton.parent[heads], 0), joints.share[heads]
        foot = skeleton.start[heads]
        along = np.zeros((len(heads), 3))
        if level:
            foot = curves.at(parent, share) + joints.aside[heads]
            along = curves.heading(parent, share)
        start[heads] = np.where(root[:, None], skeleton.start[heads], foot)
        before = np.flatnonzero(of_level & (onward >= 0))
        start[onward[before]] = end[before]
        _set_tangents(skeleton, curves, np.flatnonzero(of_level), heads, onward, along)
    return curves


def _set_tangents(
    skeleton: Skeleton,
    curves: Curves,
    rows: np.ndarray,
    heads: np.ndarray,
    onward: np.ndarray,
    along: np.ndarray,
) -> None:
    """Write the tangents of the axes of one level, whose parents run ``along`` (H, 3) at their feet."""
    chord = curves.end - curves.start
    length = np.sqrt(np.einsum("si,si->s", chord, chord))[:, None]
    way = chord / np.maximum(length, 1e-12)
    before = rows[onward[rows] >= 0]
    after = onward[before]
    through = _unit(way[before] * length[after] + way[after] * length[before])
    curves.into[before], curves.out[after] = through, through

    tips = rows[onward[rows] < 0]
    single = np.isin(tips, heads)
    lone, ends = tips[single], tips[~single]
    curves.into[lone] = way[lone]
    natural = np.where(
        (onward[heads] >= 0)[:, None], _mirrored(curves.into, way, heads), way[heads]
    )
    parent = np.maximum(skeleton.parent[heads], 0)
    own, thick = skeleton.radius[heads, 0], skeleton.radius[parent].mean(axis=1)
    pull = FORK * np.clip(own / np.maximum(thick, 1e-12), 0.0, 1.0)
    pull[(own < THIN) | (skeleton.parent[heads] < 0)] = 0.0
    curves.out[heads] = _unit((1 - pull)[:, None] * natural + pull[:, None] * along)
    curves.into[lone] = _mirrored(curves.out, way, lone)
    curves.into[ends] = _mirrored(curves.out, way, ends)
    for tangents in (curves.out, curves.into):
        tangents[rows] = _within(tangents[rows], way[rows]) * length[rows]


def _mirrored(tangent: np.ndarray, way: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(N, 3) the other tangent of a circular arc with this one and this chord."""
    d = way[rows]
    return np.asarray(2 * np.einsum("ni,ni->n", tangent[rows], d)[:, None] * d - tangent[rows])


def _within(tangent: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Unit tangents (N, 3) that stand at most WIDE to their chords."""
    cosine = np.clip(np.einsum("ni,ni->n", tangent, way), -1.0, 1.0)
    out = tangent.copy()
    wide = np.flatnonzero(cosine < np.cos(WIDE))
    aside = _unit(tangent[wide] - cosine[wide, None] * way[wide])
    out[wide] = np.cos(WIDE) * way[wide] + np.sin(WIDE) * aside
    return out


def _cuts(skeleton: Skeleton, curves: Curves, collars: Collars) -> tuple[np.ndarray, np.ndarray]:
    """Starts of the segments: piece (N,) and share of it (N,), ascending; every piece starts at 0."""
    chord = curves.end - curves.start
    length = np.maximum(np.sqrt(np.einsum("si,si->s", chord, chord)), 1e-12)
    aside = [np.sqrt(((t - chord) ** 2).sum(axis=1)) for t in (curves.out, curves.into)]
    turn = (aside[0] + aside[1]) / length
    limb = skeleton.radius[:, 0] >= LIMB
    away = (aside[0] + aside[1]) / 8
    count = np.ceil(np.sqrt(away / np.where(limb, AWAY, FAR)) - 1e-9)
    count = np.where(limb, np.maximum(count, np.ceil(4 * turn / TURN - 1e-9)), count)
    count = np.clip(count, 1, MOST).astype(np.int64)
    row, number = numbered(count)
    u = number / count[row]
    extra, share = collars.cuts
    row, u = np.concatenate([row, extra]), np.concatenate([u, share])
    sort = np.lexsort((u, row))
    row, u = row[sort], u[sort]
    gap = np.empty(len(u))
    gap[0] = np.inf
    gap[1:] = np.where(row[1:] == row[:-1], (u[1:] - u[:-1]) * length[row[1:]], np.inf)
    kept = ((gap > SHORT) & ((1 - u) * length[row] > SHORT)) | (u == 0)
    kept &= (u > 0) | (np.diff(row, prepend=-1) > 0)
    return row[kept], u[kept]


def _resampled(
    skeleton: Skeleton,
    axes: Axes,
    curves: Curves,
    collars: Collars,
    row: np.ndarray,
    u: np.ndarray,
    joints: _Joints,
) -> Skeleton:
    """The skeleton of the cut pieces."""
    begins = u == 0
    last = np.append(begins[1:], True)
    stop = np.where(last, 1.0, np.append(u[1:], 1.0))
    start = curves.at(row, u)
    start[begins] = curves.start
    end = np.empty_like(start)
    end[:-1], end[last] = start[1:], curves.end
    r0, r1 = skeleton.radius.T
    radius = np.stack(
        [collars.radius(row, share, r0[row] + share * (r1 - r0)[row]) for share in (u, stop)],
        axis=1,
    )
    parent = np.arange(len(row)) - 1
    bearer = skeleton.parent
    parent[begins] = np.where(bearer < 0, -1, _part_of(row, u, bearer, joints.share))
    radius = _tapered(radius, np.linalg.norm(end - start, axis=1), row, axes)
    return replace(
        skeleton.select(row),
        start=start,
        end=end,
        radius=radius,
        parent=parent,
        generation=depths(parent),
    )


def _tapered(radius: np.ndarray, length: np.ndarray, row: np.ndarray, axes: Axes) -> np.ndarray:
    """Radii (N, 2) that fall by TAPER a metre at most along an axis: no shoulder below a fork."""
    place = np.empty(len(axes.segment), dtype=np.int64)
    place[axes.segment] = np.arange(len(place))
    chain = np.argsort(place[row], kind="stable")
    axis = axes.of_row[place[row[chain]]]
    gone = np.cumsum(length[chain])
    metres = np.stack([gone - length[chain], gone], axis=1)
    own = radius[chain].max(axis=1) >= LIMB
    least = radius[chain] + TAPER * metres
    far = float(np.ptp(least)) + 1.0 if len(least) else 1.0
    highest = np.maximum.accumulate((least + far * axis[:, None]).ravel()).reshape(-1, 2)
    wide = highest - far * axis[:, None] - TAPER * metres
    out = radius.copy()
    out[chain] = np.where(own[:, None] & (wide > radius[chain] + 1e-9), wide, radius[chain])
    return out


def _part_of(row: np.ndarray, u: np.ndarray, of: np.ndarray, share: np.ndarray) -> np.ndarray:
    """(N,) which of the cut segments holds these shares (N,) of segments (N,)."""
    return np.searchsorted(row + u, of + np.minimum(share, 1 - 1e-9), side="right") - 1


def _moved_sites(
    skeleton: Skeleton, sites: LeafSites, curves: Curves, row: np.ndarray, u: np.ndarray
) -> LeafSites:
    """Leaf sites on the curves."""
    on = np.maximum(sites.segment, 0)
    start = skeleton.start[on]
    share, aside = beside_segments(sites.foot, start, skeleton.end[on] - start)
    foot = np.where((sites.segment >= 0)[:, None], curves.at(on, share) + aside, sites.foot)
    segment = np.where(sites.segment < 0, -1, _part_of(row, u, on, share))
    return replace(sites, foot=foot, segment=segment)


def _unit(vectors: np.ndarray) -> np.ndarray:
    size = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
    return np.asarray(vectors / np.maximum(size, 1e-12)[:, None])


@dataclass(frozen=True)
class Collars:
    """The collars of S segments.

    metres : (S, 2) along its axis from the foot to both ends of a segment.
    surface, reach : (S,) metres from the foot to the parent's surface and over which the limb narrows from
        there; 0 where an axis has no collar.
    swelling : (S,) how much thicker it is at the surface, relative. most : (S,) metres of radius.
    cuts : segments (N,) and shares (N,) where a collar bends.
    """

    metres: np.ndarray
    surface: np.ndarray
    reach: np.ndarray
    swelling: np.ndarray
    most: np.ndarray
    cuts: tuple[np.ndarray, np.ndarray]

    def radius(self, row: np.ndarray, share: np.ndarray, plain: np.ndarray) -> np.ndarray:
        """(N,) radii at shares (N,) of segments (N,) that would be ``plain`` (N,) thick."""
        low, high = self.metres[row].T
        beyond = low + share * (high - low) - self.surface[row]
        left = 1 - np.clip(beyond / np.maximum(self.reach[row], 1e-12), 0.0, 1.0)
        wide = plain * (1 + self.swelling[row] * left**POWER)
        limit = np.maximum(np.where(beyond < 0, self.most[row], np.inf), 1e-6)
        return np.asarray(np.where(self.reach[row] > 0, np.minimum(wide, limit), plain))


def collars_of(
    skeleton: Skeleton,
    axes: Axes,
    start: np.ndarray,
    end: np.ndarray,
    share: np.ndarray,
    collar: float,
) -> Collars:
    """The collars of a tree whose segments go from ``start`` to ``end`` (S, 3).

    share : (S,) of its parent's length at which a segment starts. collar : the swelling; 0: none.
    """
    chain, count = axes.segment, len(skeleton)
    length = np.linalg.norm(end - start, axis=1)
    total = np.cumsum(length[chain])
    before = np.repeat(total[axes.first[:-1]] - length[chain[axes.first[:-1]]], np.diff(axes.first))
    metres = np.empty((count, 2))
    metres[chain, 1] = total - before
    metres[chain, 0] = total - before - length[chain]

    foot, tip = chain[axes.first[:-1]], chain[axes.first[1:] - 1]
    parent = np.maximum(skeleton.parent[foot], 0)
    r1, r2 = skeleton.radius[parent].T
    thick, own = r1 + share[foot] * (r2 - r1), skeleton.radius[foot, 0]
    way, up = end[foot] - start[foot], end[parent] - start[parent]
    cosine = np.einsum("ai,ai->a", way, up) / np.maximum(length[foot] * length[parent], 1e-12)
    sine = np.sqrt(np.clip(1 - cosine**2, STEEPEST**2, 1.0))
    surface = thick / sine
    reach = np.minimum(REACH * own + ROOM * thick, HALF * metres[tip, 1] - surface)
    room = np.minimum(collar, np.maximum(FATTEST * thick / np.maximum(own, 1e-12) - 1, 0.0))
    has = (
        (collar > 0)
        & (skeleton.parent[foot] >= 0)
        & (own >= NO_COLLAR)
        & (reach > own)
        & (room > 0)
    )
    columns = [np.where(has, v, 0.0) for v in (surface, reach, room)]
    columns.append(np.where(has, np.maximum(FATTEST * thick, 1e-6), np.inf))
    spread = np.empty((4, count))
    spread[:, chain] = np.repeat(np.stack(columns), np.diff(axes.first), axis=1)

    rows = np.flatnonzero(has)
    wanted = (surface[rows, None] + STEPS * reach[rows, None]).ravel()
    axis = np.repeat(rows, len(STEPS))
    base = total[axes.first[axis]] - length[chain[axes.first[axis]]]
    place = np.minimum(np.searchsorted(total, base + wanted), axes.first[axis + 1] - 1)
    on = chain[place]
    part = (wanted - metres[on, 0]) / np.maximum(length[on], 1e-12)
    inside = (part > 0) & (part < 1)
    return Collars(metres, spread[0], spread[1], spread[2], spread[3], (on[inside], part[inside]))
