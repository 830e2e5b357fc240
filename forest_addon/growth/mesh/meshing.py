"""A whole skeleton to triangles, all branches at once; and a single polyline with radii to a closed tube.

Every axis becomes a closed tube: a ring of n corners is widened by π/(n·sin(π/n)): its perimeter, and so its
mean silhouette, is then the circle's, where an inscribed 8-gon would be 2.6 % too thin. n is chosen so that
the polygon departs from the circle by at most a tolerance. ``nodes`` sorts the axes by n and turns their
rings; here rings of equal n become vertices by one matrix product and triangles by one sum. Where the radius
steps, as between Méndez et al.'s internodes, a node has two rings. Nothing loops over branches. The rings of
a single tube follow its line by parallel transport, so that nothing twists.

Edges are known from how tubes and leaves are made. Blender needs each edge once and the edge of every corner
of every triangle. It can find them itself, but that takes longer than everything else about a mesh; whoever
makes triangles in patterns knows them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.trimesh import WOOD, Edges, TriMesh
from ..skeleton import Skeleton
from .nodes import Line, lines_of, ring_frames, thin_nodes
from .relief import FROM, Relief

STEP = 1e-12  # metres between two radii of a node from which it has two rings
POINTED = 2e-5  # metres; a thinner tip is a point: float32 would flatten its ring


def tube_edges(
    n: int, vertex: int, edge: int, wall: np.ndarray, feet: np.ndarray, tips: np.ndarray, rings: int
) -> Edges:
    """Edges of a group of tubes with rings of n corners, their triangles in the order of ``meshing``.

    vertex, edge : the first of the group.
    wall : (W,) rings with a wall above, counted within the group.
    feet, tips : (A,) first and last ring of each tube.

    Every ring has 3n edges: those around it, and the upright and the slanted ones of the wall above.
    Above a last ring there is no wall: there the spokes of the tip and of the foot take their place.
    """
    corner = np.arange(n, dtype=np.int32)
    following = (corner + 1) % n
    count = len(feet)
    around, upright, slanted = corner, n + corner, 2 * n + corner

    pattern = np.concatenate(
        [
            np.stack([corner, following], axis=1),
            np.stack([corner, n + corner], axis=1),
            np.stack([corner, n + following], axis=1),
        ]
    )  # (3n, 2)
    ends = pattern + (vertex + n * np.arange(rings, dtype=np.int32))[:, None, None]
    middle = (vertex + n * rings + np.arange(count, dtype=np.int32))[:, None]
    ends[tips, n : 2 * n, 1] = middle + count
    ends[tips, 2 * n :, 0] = middle
    ends[tips, 2 * n :, 1] = (vertex + n * feet.astype(np.int32))[:, None] + corner

    pattern = np.stack(
        [around, upright[following], slanted, slanted, 3 * n + around, upright], axis=1
    ).reshape(-1)  # (6n,)
    of_corner = np.empty((2 * n * (len(wall) + count), 3), dtype=np.int32)
    below = (edge + 3 * n * wall).astype(np.int32)
    np.add(below[:, None], pattern, out=of_corner[: 2 * n * len(wall)].reshape(-1, 6 * n))
    fans = of_corner[2 * n * len(wall) :].reshape(2, count, 3 * n)
    first = (edge + 3 * n * feet).astype(np.int32)[:, None]
    last = (edge + 3 * n * tips).astype(np.int32)[:, None]
    np.add(last, np.repeat(upright, 3), out=fans[1])
    fans[1, :, 1::3], fans[1, :, 2::3] = last + around, last + upright[following]
    np.add(last, np.repeat(slanted, 3), out=fans[0])
    fans[0, :, 0::3], fans[0, :, 1::3] = last + slanted[following], first + around
    return Edges(ends.reshape(-1, 2), of_corner)


def repeated_edges(
    triangles: np.ndarray, corners: int, times: int, first: Edges | None = None, vertex: int = 0
) -> Edges:
    """Edges of a shape (F, 3) with so many corners that is there so many times, one after the other.

    first : edges that come before them, of ``vertex`` vertices.
    """
    ahead = np.stack([triangles, triangles[:, [1, 2, 0]]], axis=2).reshape(-1, 2)  # (3F, 2)
    low, high = ahead.min(axis=1).astype(np.int64), ahead.max(axis=1)
    base = int(high.max(initial=0)) + 1
    keys, index = np.unique(low * base + high, return_inverse=True)  # quicker than unique rows
    ends = np.stack(np.divmod(keys, base), axis=1).reshape(-1).astype(np.int32)
    before = np.empty((0, 2), np.int32) if first is None else first.ends
    turns = np.empty((0, 3), np.int32) if first is None else first.of_corner
    copy = np.arange(times, dtype=np.int32)[:, None]
    return Edges(
        _behind(before, ends, vertex + corners * copy),
        _behind(turns, index.reshape(-1).astype(np.int32), len(before) + len(keys) * copy),
    )


def _behind(first: np.ndarray, pattern: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Rows (N, C), and behind them a flat pattern of such rows once for each shift (L, 1)."""
    wide = first.shape[1]
    out = np.empty((len(first) + len(shift) * len(pattern) // wide, wide), dtype=np.int32)
    out[: len(first)] = first
    np.add(pattern, shift, out=out[len(first) :].reshape(len(shift), len(pattern)))
    return out


def sides_for(radius: float, tolerance: float) -> int:
    """Corners of a ring that stays within ``tolerance`` metres of a circle of ``radius`` metres."""
    return int(np.clip(np.ceil(np.pi / np.arccos(1 - min(tolerance / radius, 0.9))), 3, 64))


def tube(points: np.ndarray, radius: np.ndarray, sides: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (P·sides + 2, 3) and triangles (T, 3) of a tube with closed ends, facing outwards.

    points : (P, 3) the axis, P >= 2, no two neighbours equal.
    radius : (P,) metres.
    """
    count = len(points)
    step = np.diff(points, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    between = step[:-1] + step[1:]
    sharp = np.linalg.norm(between, axis=1) < 1e-6  # the line turns back on itself: keep its way
    between[sharp] = step[:-1][sharp]
    tangent = np.concatenate([step[:1], between, step[-1:]])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)

    around = np.empty((count, 3))
    around[0] = _across(tangent[0])
    for ring in range(1, count):  # parallel transport: keep the last direction, made normal again
        kept = around[ring - 1] - around[ring - 1] @ tangent[ring] * tangent[ring]
        size = np.linalg.norm(kept)
        around[ring] = kept / size if size > 1e-9 else _across(tangent[ring])
    across = np.cross(tangent, around)

    angle = 2 * np.pi * np.arange(sides) / sides
    widened = radius * np.pi / (sides * np.sin(np.pi / sides))
    ring_points = points[:, None] + widened[:, None, None] * (
        np.cos(angle)[:, None] * around[:, None] + np.sin(angle)[:, None] * across[:, None]
    )
    vertices = np.concatenate([ring_points.reshape(-1, 3), points[:1], points[-1:]])

    corner = np.arange(sides)
    following = (corner + 1) % sides
    low = (np.arange(count - 1) * sides)[:, None]
    a, b, c, d = low + corner, low + following, low + sides + following, low + sides + corner
    walls = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    foot, tip = count * sides, count * sides + 1
    last = (count - 1) * sides
    caps = [
        np.stack([np.full(sides, foot), following, corner], axis=1),
        np.stack([np.full(sides, tip), last + corner, last + following], axis=1),
    ]
    return vertices, np.concatenate([walls, *caps]).astype(np.int32)


def _across(direction: np.ndarray) -> np.ndarray:
    """A unit vector at right angles to a unit direction."""
    normal = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    return np.asarray(normal / np.linalg.norm(normal))


def mesh_wood(
    skeleton: Skeleton,
    tolerance: float = 0.001,
    *,
    sunk: float = 0.0,
    uv: bool = True,
    relief: Relief | None = None,
) -> TriMesh:
    """The wood of a skeleton: closed tubes, facing outwards, in material slot 0.

    tolerance : metres between a ring and its circle, and between the tube and an axis whose nodes are
        so nearly in line that they are left out.
    sunk : metres that a root goes on below its start, so that no gap shows at the ground.
    uv : also make texture coordinates: u whole turns of about a metre around, v metres from the foot.
    relief : of the bark of thick axes; None: rings are round.

    Branches without a radius have no mesh. ``order`` of the result is that of each triangle's axis.
    """
    corners = None if relief is None else relief.corners
    line = thin_nodes(lines_of(skeleton, tolerance, sunk, corners), tolerance)
    if relief is not None:
        line = relief.densified(line)
    return _tubes(line, uv, relief)


@dataclass(frozen=True)
class _Rings:
    """R rings of A axes, axis by axis."""

    plane: np.ndarray  # (R, 9) centre, and what cosine and sine are multiplied by
    first: np.ndarray  # (A + 1,) first ring of each axis
    axis: np.ndarray  # (R,)
    wall: np.ndarray  # (R,) whether there is a wall above: not on the last ring of an axis
    metres: np.ndarray  # (R,) along the axis from its foot
    radius: np.ndarray  # (R,)


def _rings(line: Line) -> _Rings:
    """One ring around each node, two where the radius steps, none at a tip that is a point."""
    across, beside = ring_frames(line)
    last = line.first[1:] - 1
    times = 1 + (np.abs(line.below - line.above) > STEP)
    times[last] = line.below[last] > POINTED
    node = np.repeat(np.arange(len(times)), times)
    upper = np.diff(node, prepend=-1) == 0  # the second ring of its node
    radius = np.where(upper | (times[node] == 1), line.above[node], line.below[node])
    first = np.concatenate([[0], np.cumsum(times)[last]])
    axis = np.repeat(np.arange(len(line.sides)), np.diff(first))
    wall = np.ones(len(node), dtype=bool)
    wall[first[1:] - 1] = False
    around = line.sides[axis]
    widened = np.maximum(radius, POINTED) * (np.pi / (around * np.sin(np.pi / around)))
    plane = np.concatenate(
        [line.point[node], across[node] * widened[:, None], beside[node] * widened[:, None]], axis=1
    )
    return _Rings(plane, first, axis, wall, _along(line)[node], radius)


def _tubes(line: Line, with_uv: bool, relief: Relief | None = None) -> TriMesh:
    """Rings around nodes, walls between rings, a fan at each end."""
    sides, last = line.sides, line.first[1:] - 1
    rings = _rings(line)
    around = sides[rings.axis]
    vertices = np.empty((int(around.sum() + 2 * len(sides)), 3))
    count = int((2 * around[rings.wall]).sum() + 2 * sides.sum())
    triangles = np.empty((count, 3), dtype=np.int32)
    order = np.empty(count, dtype=np.int8)
    texture = np.empty((count, 3, 2), dtype=np.float32) if with_uv else None
    turns = np.empty(0)
    if with_uv and len(sides):
        thick = np.maximum.reduceat(line.above, line.first[:-1])
        turns = np.maximum(np.rint(2 * np.pi * thick), 1.0)

    known = []
    v = t = 0
    for n in np.unique(sides):
        a, b = np.searchsorted(sides, [n, n + 1])  # axes of this group, and their rings
        low, high = rings.first[a], rings.first[b]
        size, tubes = int(high - low), int(b - a)
        wall = np.flatnonzero(rings.wall[low:high])
        feet, tips = rings.first[a:b] - low, rings.first[a + 1 : b + 1] - 1 - low
        stop = t + 2 * n * (len(wall) + tubes)

        angle = 2 * np.pi * np.arange(n) / n
        circle = np.stack([np.ones(n), np.cos(angle), np.sin(angle)])  # (3, n)
        spread = np.einsum("pc,ij->picj", circle, np.eye(3)).reshape(9, 3 * n)
        middle = v + size * n
        np.matmul(rings.plane[low:high], spread, out=vertices[v:middle].reshape(size, 3 * n))
        if relief is not None:
            _roughen(vertices[v:middle].reshape(size, n, 3), rings, (int(a), int(b)), relief)
        vertices[middle : middle + tubes] = line.point[line.first[a:b]]
        vertices[middle + tubes : middle + 2 * tubes] = line.point[last[a:b]]
        _triangulate(triangles[t:stop], n, v, wall, feet, tips, middle)
        known.append(tube_edges(n, v, 3 * t // 2, wall, feet, tips, size))  # closed: 2E = 3T

        own = line.order[a:b]
        order[t : t + 2 * n * len(wall)] = np.repeat(own[rings.axis[low:high][wall] - a], 2 * n)
        order[t + 2 * n * len(wall) : stop] = np.tile(np.repeat(own, n), 2)
        if texture is not None:
            metres, turn = rings.metres[low:high], turns[rings.axis[low:high][wall]]
            above = np.minimum(wall + 1, size - 1)
            _texture(
                *(texture[t:stop], n, turn, metres[wall], metres[above]),
                *(turns[a:b], metres[feet], metres[tips]),
            )
        v, t = middle + 2 * tubes, stop

    return TriMesh(
        vertices=vertices,
        triangles=triangles,
        part=np.full(count, WOOD, dtype=np.int8),
        leaf=np.full(count, -1, dtype=np.int32),
        material=np.zeros(count, dtype=np.int32),
        uv=texture,
        order=order,
        edges=Edges(
            np.concatenate([e.ends for e in known] or [np.empty((0, 2), np.int32)]),
            np.concatenate([e.of_corner for e in known] or [np.empty((0, 3), np.int32)]),
        ),
    )


def _roughen(out: np.ndarray, rings: _Rings, axes: tuple[int, int], relief: Relief) -> None:
    """Give rings (R, n, 3) of a range of axes, which have as many corners, the relief of their bark."""
    low = rings.first[axes[0]]
    for axis in range(*axes):
        rows = slice(rings.first[axis] - low, rings.first[axis + 1] - low)
        mine = slice(rings.first[axis], rings.first[axis + 1])
        radius = rings.radius[mine]
        if not len(radius) or radius.max() < FROM:
            continue
        metres = rings.metres[mine]
        factor = relief.factor(out.shape[1], radius, metres, float(metres[-1]), axis)
        centre = rings.plane[mine, None, :3]
        out[rows] = centre + factor[:, :, None] * (out[rows] - centre)


def _triangulate(
    out: np.ndarray,
    n: int,
    vertex: int,
    wall: np.ndarray,
    feet: np.ndarray,
    tips: np.ndarray,
    middle: int,
) -> None:
    """Write a group's triangles into ``out``: walls, fans of feet, fans of tips.

    vertex : the group's first. middle : of its first foot; those of the tips follow on those of the feet.
    wall, feet, tips : rings, counted within the group.
    """
    corner = np.arange(n)
    following = (corner + 1) % n
    pattern = np.stack(
        [corner, following, n + following, corner, n + following, n + corner], axis=1
    ).reshape(-1)  # (6n,): two triangles a corner
    count = len(feet)
    walls, fans = out[: 2 * n * len(wall)], out[2 * n * len(wall) :].reshape(2, count, n, 3)
    np.add(
        (vertex + n * wall).astype(np.int32)[:, None],
        pattern.astype(np.int32),
        out=walls.reshape(-1, 6 * n),
    )
    ends = middle + np.arange(2 * count).reshape(2, count, 1)
    low, high = (vertex + n * feet)[:, None], (vertex + n * tips)[:, None]
    fans[..., 0] = ends
    fans[0, :, :, 1], fans[0, :, :, 2] = low + following, low + corner
    fans[1, :, :, 1], fans[1, :, :, 2] = high + corner, high + following


def _texture(
    out: np.ndarray,
    n: int,
    wall_turns: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    turns: np.ndarray,
    foot: np.ndarray,
    tip: np.ndarray,
) -> None:
    """Write texture coordinates of a group's walls, feet and tips into ``out`` (T, 3, 2)."""
    here = (np.arange(n) / n).astype(np.float32)
    there = here + np.float32(1 / n)
    walls = out[: len(low) * 2 * n].reshape(-1, n, 2, 3, 2)
    pattern = np.stack(
        [np.stack([here, there, there], 1), np.stack([here, there, here], 1)], axis=1
    )  # (n, 2, 3)
    np.multiply(wall_turns.astype(np.float32)[:, None, None, None], pattern, out=walls[..., 0])
    v = np.stack([low, low, high, low, high, high], axis=1).astype(np.float32)
    walls[..., 1] = v.reshape(-1, 1, 2, 3)
    ends = out[len(low) * 2 * n :].reshape(2, len(turns), n, 3, 2)
    middle = here + np.float32(0.5 / n)
    for end, fan, height in (
        (0, np.stack([middle, there, here], 1), foot),
        (1, np.stack([middle, here, there], 1), tip),
    ):
        ends[end, ..., 0] = turns[:, None, None] * fan
        ends[end, ..., 1] = height[:, None, None]


def _along(line: Line) -> np.ndarray:
    """(N,) metres along its axis from the foot to each node."""
    step = np.zeros(len(line.point))
    step[1:] = np.linalg.norm(np.diff(line.point, axis=0), axis=1)
    step[line.first[:-1]] = 0.0
    total = np.cumsum(step)
    return np.asarray(total - np.repeat(total[line.first[:-1]], np.diff(line.first)))
