"""A whole skeleton to triangles, all branches at once.

Every axis becomes a closed tube as in ``tubes``: a ring of n corners is widened by π/(n·sin(π/n)), which
gives it the circle's perimeter and so its mean silhouette; n follows from the tolerance. ``nodes`` sorts
the axes by n, ``frames`` turns their rings; here rings of equal n become vertices by one matrix product
and triangles by one sum. Where the radius steps, as between S's internodes, a node has two rings. Nothing
loops over branches.
"""

from __future__ import annotations

import numpy as np

from .edges import tube_edges
from .frames import ring_frames
from .nodes import Line, lines_of, thin_nodes
from .skeleton import Skeleton
from .trimesh import WOOD, Edges, TriMesh

POINTED = 2e-5  # metres; a thinner tip is a point: float32 would flatten its ring


def mesh_wood(
    skeleton: Skeleton, tolerance: float = 0.001, *, sunk: float = 0.0, uv: bool = True
) -> TriMesh:
    """The wood of a skeleton: closed tubes, facing outwards, in material slot 0.

    tolerance : metres between a ring and its circle, and between the tube and an axis whose nodes are
        so nearly in line that they are left out.
    sunk : metres that a root goes on below its start, so that no gap shows at the ground.
    uv : also make texture coordinates: u whole turns of about a metre around, v metres from the foot.

    Branches without a radius have no mesh. ``order`` of the result is that of each triangle's axis.
    """
    line = thin_nodes(lines_of(skeleton, tolerance, sunk), tolerance)
    return _tubes(line, uv)


def _tubes(line: Line, with_uv: bool) -> TriMesh:
    """Rings around nodes, walls between rings, a fan at each end."""
    first, axes = line.first, len(line.sides)
    last = first[1:] - 1
    across, along_side = ring_frames(line)
    tip = np.maximum(line.below[last], 0.0)
    pointed = tip <= POINTED

    times = 1 + (np.abs(line.below - line.above) > 1e-12)  # rings of each node
    times[last] = 1 - pointed
    node = np.repeat(np.arange(len(times)), times)
    second = np.concatenate([[False], node[1:] == node[:-1]]) if len(node) else np.zeros(0, bool)
    radius = np.where(second | (times[node] == 1), line.above[node], line.below[node])
    radius = np.maximum(radius, POINTED)
    ring_end = np.cumsum(times)
    ring_first = np.concatenate([[0], ring_end[last]])  # (A + 1,)
    ring_axis = np.repeat(np.arange(axes), np.diff(ring_first))
    wall = np.ones(len(node), dtype=bool)
    wall[ring_first[1:] - 1] = False  # the last ring of an axis has the tip above it

    sides = line.sides
    around = sides[ring_axis]
    widened = radius * (np.pi / (around * np.sin(np.pi / around)))
    ring = np.concatenate(
        [line.point[node], across[node] * widened[:, None], along_side[node] * widened[:, None]],
        axis=1,
    )  # (R, 9) its centre, and what cosine and sine are multiplied by

    vertex_count = int(around.sum() + 2 * axes)
    triangle_count = int((2 * around[wall]).sum() + 2 * sides.sum())
    vertices = np.empty((vertex_count, 3))
    triangles = np.empty((triangle_count, 3), dtype=np.int32)
    order = np.empty(triangle_count, dtype=np.int8)
    texture = np.empty((triangle_count, 3, 2), dtype=np.float32) if with_uv else None
    metres = _along(line)[node] if with_uv else np.empty(0)
    turns = np.empty(0)
    if with_uv and axes:
        turns = np.maximum(np.rint(2 * np.pi * np.maximum.reduceat(line.above, first[:-1])), 1.0)

    known = []
    v = t = 0
    for n in np.unique(sides):
        a, b = np.searchsorted(sides, [n, n + 1])
        low, high = ring_first[a], ring_first[b]
        rings, count = high - low, b - a
        angle = 2 * np.pi * np.arange(n) / n
        circle = np.stack([np.ones(n), np.cos(angle), np.sin(angle)])  # (3, n)
        spread = np.einsum("pc,ij->picj", circle, np.eye(3)).reshape(9, 3 * n)
        np.matmul(ring[low:high], spread, out=vertices[v : v + rings * n].reshape(rings, 3 * n))
        foot_vertex = v + rings * n + np.arange(count)
        tip_vertex = foot_vertex + count
        vertices[foot_vertex], vertices[tip_vertex] = line.point[first[a:b]], line.point[last[a:b]]

        corner = np.arange(n)
        following = (corner + 1) % n
        pattern = np.stack(
            [
                np.stack([corner, following, n + following], 1),
                np.stack([corner, n + following, n + corner], 1),
            ],
            axis=1,
        ).astype(np.int32)  # (n, 2, 3)
        walls = np.flatnonzero(wall[low:high])
        w = len(walls) * 2 * n
        np.add(
            pattern,
            (v + n * walls).astype(np.int32)[:, None, None, None],
            out=triangles[t : t + w].reshape(-1, n, 2, 3),
        )
        feet = triangles[t + w : t + w + count * n].reshape(count, n, 3)
        feet[:, :, 0] = foot_vertex[:, None]
        foot_ring = (v + n * (ring_first[a:b] - low))[:, None]
        feet[:, :, 1], feet[:, :, 2] = foot_ring + following, foot_ring + corner
        tips = triangles[t + w + count * n : t + w + 2 * count * n].reshape(count, n, 3)
        tip_ring = (v + n * (ring_first[a + 1 : b + 1] - 1 - low))[:, None]
        tips[:, :, 0] = tip_vertex[:, None]
        tips[:, :, 1], tips[:, :, 2] = tip_ring + corner, tip_ring + following

        order[t : t + w] = np.repeat(line.order[ring_axis[low:high][walls]], 2 * n)
        order[t + w : t + w + 2 * count * n] = np.tile(np.repeat(line.order[a:b], n), 2)
        if texture is not None:
            _texture(
                texture[t : t + w + 2 * count * n],
                n,
                turns[ring_axis[low:high][walls]],
                metres[low:high][walls],
                metres[low:high][np.minimum(walls + 1, rings - 1)],
                turns[a:b],
                metres[ring_first[a:b]],
                metres[ring_first[a + 1 : b + 1] - 1],
            )
        feet_at, tips_at = ring_first[a:b] - low, ring_first[a + 1 : b + 1] - 1 - low
        known.append(
            tube_edges(n, v, 3 * t // 2, walls, feet_at, tips_at, rings)
        )  # closed: 2E = 3T
        v += rings * n + 2 * count
        t += w + 2 * count * n

    return TriMesh(
        vertices=vertices,
        triangles=triangles,
        part=np.full(triangle_count, WOOD, dtype=np.int8),
        leaf=np.full(triangle_count, -1, dtype=np.int32),
        material=np.zeros(triangle_count, dtype=np.int32),
        uv=texture,
        order=order,
        edges=Edges(
            np.concatenate([e.ends for e in known] or [np.empty((0, 2), np.int32)]),
            np.concatenate([e.of_corner for e in known] or [np.empty((0, 3), np.int32)]),
        ),
    )


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
