"""A tree as it sways: its first modes, what of it the wind meets, where its points hold on, and what moves as
one.

One ``SwayShape`` for each variant, in the variant's own frame and size; wind comes later. Wood and leaves
that are too fine to be members ride on them with their mass and their area. A point of the tree (a vertex, a
leaf's centre) is tied to the skeleton once for each variant, as ``Anchors``.

Neighbouring members whose motion one affine map tells, mode by mode, become a piece (``SwayRig``): few enough
that rays and the view can follow each. A piece carries all that rides on its members. The map is linear in
the amplitudes of the modes, so a moment of a tree is a small sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.runs import numbered
from ...base.vectors import beside_segments, unit
from ..mesh.leaves import Leaves
from ..skeleton import LeafSites, Skeleton
from .beams import GreenWood, Members, Modes, members_of, point_masses, standing_modes

MODES = 12
SAMPLE = 0.1  # metres between points of the skeleton among which the nearest is looked for
SHARE_OF_CIRCLE = 0.5  # of a leaf's one-sided area that faces the wind, of leaves facing all ways
WITHIN = 1 / 200  # of the largest displacement of the tree, by which a piece may be off its members
PLACES = (0.0, 0.5, 1.0)  # along members, where that is looked at


@dataclass(frozen=True)
class SwayShape:
    """The sway of one variant.

    members : its reduced skeleton. modes : of its nodes. seats : of its leaves. leafy, woody : (B,) m² that
    the wind meets of leaves (half of their one-sided area) and of wood, by member.
    """

    skeleton: Skeleton
    members: Members
    modes: Modes
    seats: LeafSites
    leafy: np.ndarray
    woody: np.ndarray

    def at_members(self) -> tuple[np.ndarray, np.ndarray]:
        """Middles (B, 3) of members and their modes (B, M, 3)."""
        own = self.members
        points = own.start + 0.5 * (own.end - own.start)
        low, high = self.ends
        return points, low[:, :, :3] + 0.5 * (high - low)[:, :, :3]

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """(B, M, 6) modes of the members' starts and ends."""
        shape, own = self.modes.shape, self.members
        low, high = shape[own.node[:, 0]].copy(), shape[own.node[:, 1]]
        low[:, :, :3] += np.cross(low[:, :, 3:], own.offset[:, None])
        return low, high

    @property
    def tilts(self) -> np.ndarray:
        """(B, M, 2) rotations of members' middles about the level axes, radians by a unit of each mode."""
        low, high = self.ends
        return np.asarray((low + high)[:, :, 3:5] / 2)

    def members_at(self, points: np.ndarray, leaf: np.ndarray) -> np.ndarray:
        """(N,) the member that moves points (N, 3): of leaves (N,) that which bears them, of wood (-1) the
        nearest."""
        on_leaf = (leaf >= 0) & (leaf < len(self.seats.segment))
        segment = np.zeros(len(points), dtype=np.int64)
        segment[on_leaf] = self.seats.segment[leaf[on_leaf]]
        if not on_leaf.all():
            segment[~on_leaf] = _nearest(self.skeleton, points[~on_leaf])[0]
        return np.asarray(self.members.of_segment[segment])


def shape_of(skeleton: Skeleton, leaves: Leaves, wood: GreenWood) -> SwayShape:
    """Reduce a tree of at least one segment to its first modes."""
    seats = seats_of(skeleton, leaves)
    area = np.bincount(seats.segment, np.pi * leaves.radius**2, minlength=len(skeleton))
    return shape_with(skeleton, area, wood, seats=seats)


def shape_with(
    skeleton: Skeleton,
    leaf_area: np.ndarray,
    wood: GreenWood,
    modes: int = MODES,
    seats: LeafSites | None = None,
) -> SwayShape:
    """Reduce a tree that bears leaves of an area (S,) m² on its segments to its first modes."""
    members = members_of(skeleton)
    own = members.of_segment
    middle = (skeleton.start + skeleton.end) / 2
    fine = np.where(members.kept, 0.0, wood.density * skeleton.volume)
    carried = fine + wood.leaf_mass * leaf_area
    along = members.along.mean(axis=1)
    node = np.where(along < 0.5, members.node[own, 0], members.node[own, 1])
    load = point_masses(node, carried, middle - members.nodes[node], len(members) + 1)
    length = skeleton.length
    count = len(members)
    return SwayShape(
        skeleton=skeleton,
        members=members,
        modes=standing_modes(members, wood, load, modes),
        seats=seats or LeafSites.none(),
        leafy=np.bincount(own, SHARE_OF_CIRCLE * wood.one_sided * leaf_area, minlength=count),
        woody=np.bincount(own, length * skeleton.radius.sum(axis=1), minlength=count),
    )


def seats_of(skeleton: Skeleton, leaves: Leaves) -> LeafSites:
    """Find where leaves are held: by the end of their axis that is nearer to the wood."""
    half = 0.5 * leaves.length[:, None] * leaves.axis
    ends = np.stack([leaves.centre - half, leaves.centre + half])
    segment, away = (part.reshape(2, -1) for part in _nearest(skeleton, ends.reshape(-1, 3)))
    second = away[1] < away[0]
    foot = np.where(second[:, None], ends[1], ends[0])
    axis = np.where(second[:, None], -leaves.axis, leaves.axis)
    held = np.where(second, segment[1], segment[0])
    return LeafSites(foot, axis, leaves.normal, leaves.length, leaves.width, held)


def _nearest(skeleton: Skeleton, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) segments nearest to points, by the distance to the bark, and (N,) that distance."""
    from scipy.spatial import cKDTree

    length = skeleton.length
    pieces = np.maximum(1, np.ceil(length / SAMPLE).astype(np.int64))
    of, number = numbered(pieces)
    share = ((number + 0.5) / pieces[of])[:, None]
    sample = skeleton.start[of] * (1 - share) + skeleton.end[of] * share
    many = min(4, len(sample))
    _, near = cKDTree(sample).query(points, k=many)
    segment = of[np.asarray(near).reshape(len(points), many)]
    start = skeleton.start[segment]
    along, aside = beside_segments(points[:, None], start, skeleton.end[segment] - start)
    away = np.linalg.norm(aside, axis=2)
    away -= skeleton.radius[segment, 0] * (1 - along) + skeleton.radius[segment, 1] * along
    best = np.argmin(away, axis=1)
    rows = np.arange(len(points))
    return segment[rows, best], away[rows, best]


@dataclass(frozen=True)
class SwayRig:
    """The pieces of one variant.

    of_member : (B,) int64, the piece of each member. maps : (G, M, 3, 4) for a unit amplitude of each mode,
    what is added to the place of a point by each piece, in the variant's frame: linear part and shift, m.
    off : largest distance between pieces and members, over the largest displacement.
    """

    of_member: np.ndarray
    maps: np.ndarray
    off: float

    def __len__(self) -> int:
        return len(self.maps)

    def places(self, amplitude: np.ndarray) -> np.ndarray:
        """(K, G, 3, 4) maps from rest to where pieces are at amplitudes (K, M) over the tree's scale."""
        moved = self.shifts(amplitude)
        moved[:, :, [0, 1, 2], [0, 1, 2]] += 1.0
        return moved

    def shifts(self, amplitude: np.ndarray) -> np.ndarray:
        """(K, G, 3, 4) what is added to places at amplitudes (K, M), or their rates, over the scale."""
        return np.tensordot(amplitude, self.maps, axes=(1, 1))


def rig_of(shape: SwayShape, within: float = WITHIN) -> SwayRig:
    """Join the members of a tree to pieces. within : of the largest displacement, of what a piece may be off.

    Modes count as a slow wind stirs them: by the inverse square of their frequency.
    """
    members, modes = shape.members, shape.modes
    weight = (modes.frequency[0] / modes.frequency) ** 2
    points, moved, of_member = _samples(shape)
    moved = moved * weight[:, None]
    most = float(np.linalg.norm(moved, axis=2).sum(axis=1).max(initial=0.0)) or 1.0
    group = np.zeros(len(members), dtype=np.int64)
    held: list[np.ndarray] = []
    fits: list[np.ndarray] = []
    worst = 0.0
    for member in range(len(members)):
        bearer = int(members.node[member, 0]) - 1
        if bearer >= 0:
            own = np.concatenate([held[group[bearer]], of_member[member]])
            fit, off = _fitted(points[own], moved[own])
            if off <= within * most:
                group[member] = group[bearer]
                held[group[bearer]], fits[group[bearer]] = own, fit
                continue
        own = of_member[member]
        fit, _ = _fitted(points[own], moved[own])
        group[member] = len(held)
        held.append(own)
        fits.append(fit)
    for own, fit in zip(held, fits, strict=True):
        worst = max(worst, _off(points[own], moved[own], fit))
    # (4, M, 3) of each piece to (M, 3, 4), mode by mode in memory, as sums over modes read them.
    maps = np.ascontiguousarray(np.array(fits).transpose(2, 0, 3, 1) / weight[:, None, None, None])
    return SwayRig(group, maps.swapaxes(0, 1), worst / most)


def _samples(shape: SwayShape) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Points (P, 3) on members and of what rides on them, how modes move them (P, M, 3), and the rows of each
    member."""
    members, skeleton = shape.members, shape.skeleton
    low, high = shape.ends
    axis = members.end - members.start
    around = _around(axis, members.radius.max(axis=1))
    every = np.arange(len(members))
    bone = np.concatenate([*[every] * (len(PLACES) * len(around)), members.of_segment])
    shares = [np.full(len(members), place) for place in PLACES for _ in around]
    along = np.concatenate([*shares, members.along.mean(axis=1)])
    foot = members.start[bone] + along[:, None] * axis[bone]
    middle = (skeleton.start + skeleton.end) / 2
    own = len(foot) - len(middle)
    points = np.concatenate([foot[:own] + np.concatenate(around * len(PLACES)), middle])
    both = low[bone] + along[:, None, None] * (high - low)[bone]
    moved = both[:, :, :3] + np.cross(both[:, :, 3:], (points - foot)[:, None])
    order = np.argsort(bone, kind="stable")
    return points, moved, np.split(order, np.searchsorted(bone[order], every[1:]))


def _around(axis: np.ndarray, radius: np.ndarray) -> list[np.ndarray]:
    """Ways (B, 3) from axes to themselves and to four places on the bark."""
    way = unit(axis)
    aside = np.where(np.abs(way[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(way, aside)
    first *= (radius / np.linalg.norm(first, axis=1))[:, None]
    second = np.cross(way, first)
    return [np.zeros_like(way), first, -first, second, -second]


def _fitted(points: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, float]:
    """The affine map (4, M, 3) that tells motions (Q, M, 3) of points (Q, 3) best, and the largest sum of its
    errors over modes, m."""
    middle = points.mean(axis=0)
    given = np.concatenate([points - middle, np.ones((len(points), 1))], axis=1)
    square = np.linalg.pinv(given.T @ given, rcond=1e-11, hermitian=True)
    fit = square @ (given.T @ moved.reshape(len(points), -1))
    fit[3] -= middle @ fit[:3]
    fit = fit.reshape(4, moved.shape[1], 3)
    return fit, _off(points, moved, fit)


def _off(points: np.ndarray, moved: np.ndarray, fit: np.ndarray) -> float:
    told = points @ fit[:3].reshape(3, -1)
    told += fit[3].ravel() - moved.reshape(len(points), -1)
    return float(np.linalg.norm(told.reshape(moved.shape), axis=2).sum(axis=1).max(initial=0.0))
