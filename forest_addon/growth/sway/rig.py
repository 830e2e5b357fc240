"""Pieces of a tree that move as one: few enough that rays and the view can follow each.

Neighbouring members whose motion one affine map tells, mode by mode, become a piece. A piece carries all that
rides on its members. The map is linear in the amplitudes of the modes, so a moment of a tree is a small sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.trimesh import TriMesh
from .shape import SwayShape

WITHIN = 1 / 200  # of the largest displacement of the tree, by which a piece may be off its members
PLACES = (0.0, 0.5, 1.0)  # along members, where that is looked at


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
        moved = np.einsum("km,gmij->kgij", amplitude, self.maps)
        moved[:, :, [0, 1, 2], [0, 1, 2]] += 1.0
        return moved

    def shifts(self, amplitude: np.ndarray) -> np.ndarray:
        """(K, G, 3, 4) what is added to places at amplitudes (K, M), or their rates, over the scale."""
        return np.asarray(np.einsum("km,gmij->kgij", amplitude, self.maps))


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
    # (4, M, 3) of each piece to (M, 3, 4).
    maps = np.array(fits).transpose(0, 2, 3, 1) / weight[:, None, None]
    return SwayRig(group, maps, worst / most)


def piece_of_triangles(shape: SwayShape, rig: SwayRig, mesh: TriMesh) -> np.ndarray:
    """(T,) int64 the piece that each triangle of the variant's mesh is of."""
    middle = mesh.vertices[mesh.triangles].mean(axis=1)
    return np.asarray(rig.of_member[shape.anchors_of(middle, mesh.leaf).bone])


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
    way = axis / np.linalg.norm(axis, axis=1, keepdims=True)
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
    told += (fit[3].ravel()) - moved.reshape(len(points), -1)
    return float(np.linalg.norm(told.reshape(moved.shape), axis=2).sum(axis=1).max(initial=0.0))
