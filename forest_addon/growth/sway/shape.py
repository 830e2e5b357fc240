"""A tree as it sways: its first modes, what of it the wind meets, and where its points hold on.

One ``SwayShape`` for each variant, in the variant's own frame and size; wind comes later. Wood and leaves
that are too fine to be members ride on them with their mass and their area.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.trimesh import TriMesh
from ..mesh.leaves import Leaves
from ..skeleton import Skeleton
from .beams import Modes, point_masses, standing_modes
from .members import Members, frustum, members_of
from .motion import Anchors
from .wood import GreenWood

MODES = 12
SAMPLE = 0.1  # metres between points of the skeleton among which the nearest is looked for
SHARE_OF_CIRCLE = 0.5  # of a leaf's one-sided area that faces the wind, of leaves facing all ways


@dataclass(frozen=True)
class LeafSeats:
    """Seats of L leaves: foot (L, 3), unit axis (L, 3) along and normal (L, 3), segment (L,)."""

    foot: np.ndarray
    axis: np.ndarray
    normal: np.ndarray
    segment: np.ndarray

    @classmethod
    def none(cls) -> LeafSeats:
        """No leaves at all."""
        none = np.empty((0, 3))
        return cls(none, none, none, np.empty(0, np.int64))


@dataclass(frozen=True)
class SwayShape:
    """The sway of one variant.

    members : its reduced skeleton. modes : of its nodes. leafy, woody : (B,) m² that the wind meets of
    leaves (half of their one-sided area) and of wood, by member.
    mass, leaf_mass : kg of all of it, and of its leaves.
    """

    skeleton: Skeleton
    members: Members
    modes: Modes
    seats: LeafSeats
    leafy: np.ndarray
    woody: np.ndarray
    mass: float
    leaf_mass: float

    def at_members(self, share: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
        """Points (B, 3) of members and their modes (B, M, 3), at a share of their length."""
        own = self.members
        points = own.start + share * (own.end - own.start)
        low, high = self.ends
        return points, low[:, :, :3] + share * (high - low)[:, :, :3]

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

    def anchors_of(self, points: np.ndarray, leaf: np.ndarray) -> Anchors:
        """Anchors of points (N, 3): of leaves by number ``leaf`` (N,), of wood (-1) by the nearest wood."""
        on_leaf = (leaf >= 0) & (leaf < len(self.seats.segment))
        seat = np.where(on_leaf, leaf, 0)
        segment = np.zeros(len(points), dtype=np.int64)
        held = np.array(points, dtype=np.float64)
        if on_leaf.any():
            segment[on_leaf] = self.seats.segment[seat[on_leaf]]
            held[on_leaf] = self.seats.foot[seat[on_leaf]]
        if not on_leaf.all():
            segment[~on_leaf] = nearest_segments(self.skeleton, held[~on_leaf])
        along = self._along(segment, held)
        own = self.members
        bone = own.of_segment[segment]
        foot = own.start[bone] + along[:, None] * (own.end - own.start)[bone]
        reach = np.where(on_leaf[:, None], points - held, 0.0)
        return Anchors(
            bone=bone.astype(np.int32),
            along=along.astype(np.float32),
            arm=(points - foot).astype(np.float32),
            leaf=np.where(on_leaf, leaf, -1).astype(np.int32),
            reach=reach.astype(np.float32),
        )

    def _along(self, segment: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(N,) share of the member's length at which points on segments hold on."""
        start, end = self.skeleton.start[segment], self.skeleton.end[segment]
        axis = end - start
        square = np.maximum((axis * axis).sum(axis=1), 1e-18)
        share = np.clip(((points - start) * axis).sum(axis=1) / square, 0.0, 1.0)
        low, high = self.members.along[segment].T
        return low + share * (high - low)


def shape_of(skeleton: Skeleton, leaves: Leaves, wood: GreenWood, modes: int = MODES) -> SwayShape:
    """Reduce a tree of at least one segment to its first modes."""
    seats = seats_of(skeleton, leaves)
    area = np.bincount(seats.segment, np.pi * leaves.radius**2, minlength=len(skeleton))
    return shape_with(skeleton, area, wood, modes, seats)


def shape_with(
    skeleton: Skeleton,
    leaf_area: np.ndarray,
    wood: GreenWood,
    modes: int = MODES,
    seats: LeafSeats | None = None,
) -> SwayShape:
    """Reduce a tree that bears leaves of an area (S,) m² on its segments to its first modes."""
    members = members_of(skeleton)
    own = members.of_segment
    middle = (skeleton.start + skeleton.end) / 2
    fine = np.where(
        members.kept, 0.0, wood.density * frustum(skeleton.start, skeleton.end, skeleton.radius)
    )
    carried = fine + wood.leaf_mass * leaf_area
    along = members.along.mean(axis=1)
    node = np.where(along < 0.5, members.node[own, 0], members.node[own, 1])
    load = point_masses(node, carried, middle - members.nodes[node], len(members) + 1)
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    count = len(members)
    kept = frustum(members.start, members.end, members.radius).sum() * wood.density
    return SwayShape(
        skeleton=skeleton,
        members=members,
        modes=standing_modes(members, wood, load, modes),
        seats=seats or LeafSeats.none(),
        leafy=np.bincount(own, SHARE_OF_CIRCLE * wood.one_sided * leaf_area, minlength=count),
        woody=np.bincount(own, length * skeleton.radius.sum(axis=1), minlength=count),
        mass=float(kept + carried.sum()),
        leaf_mass=float(wood.leaf_mass * leaf_area.sum()),
    )


def seats_of(skeleton: Skeleton, leaves: Leaves) -> LeafSeats:
    """Find where leaves are held: by the end of their axis that is nearer to the wood."""
    if not len(leaves):
        return LeafSeats.none()
    half = 0.5 * leaves.length[:, None] * leaves.axis
    ends = np.stack([leaves.centre - half, leaves.centre + half])
    found = [_nearest(skeleton, end) for end in ends]
    second = found[1][1] < found[0][1]
    foot = np.where(second[:, None], ends[1], ends[0])
    axis = np.where(second[:, None], -leaves.axis, leaves.axis)
    return LeafSeats(foot, axis, leaves.normal, np.where(second, found[1][0], found[0][0]))


def nearest_segments(skeleton: Skeleton, points: np.ndarray) -> np.ndarray:
    """(N,) the segment whose bark is nearest to each point, among the four nearest axes."""
    return _nearest(skeleton, points)[0]


def corner_leaves(mesh: TriMesh) -> np.ndarray:
    """(V,) int32 the leaf that each vertex is of, -1 where it is of none."""
    leaf = np.full(len(mesh.vertices), -1, np.int32)
    rows = mesh.leaf >= 0
    leaf[mesh.triangles[rows].ravel()] = np.repeat(mesh.leaf[rows], 3)
    return leaf


def _nearest(skeleton: Skeleton, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) segments nearest to points, by the distance to the bark, and (N,) that distance."""
    from scipy.spatial import cKDTree

    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    pieces = np.maximum(1, np.ceil(length / SAMPLE).astype(np.int64))
    of = np.repeat(np.arange(len(skeleton)), pieces)
    number = np.arange(len(of)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = ((number + 0.5) / pieces[of])[:, None]
    sample = skeleton.start[of] * (1 - share) + skeleton.end[of] * share
    many = min(4, len(sample))
    _, near = cKDTree(sample).query(points, k=many)
    segment = of[np.asarray(near).reshape(len(points), many)]
    start = skeleton.start[segment]
    axis = skeleton.end[segment] - start
    to = points[:, None] - start
    along = (to * axis).sum(axis=2) / np.maximum((axis * axis).sum(axis=2), 1e-18)
    along = np.clip(along, 0.0, 1.0)
    away = np.linalg.norm(to - along[..., None] * axis, axis=2)
    away -= skeleton.radius[segment, 0] * (1 - along) + skeleton.radius[segment, 1] * along
    best = np.argmin(away, axis=1)
    rows = np.arange(len(points))
    return segment[rows, best], away[rows, best]
