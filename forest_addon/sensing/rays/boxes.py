"""Instances that a ray may meet: a tree of axis-aligned boxes, walked by many rays at a time.

The boxes, in the order of their centres along a Morton curve, are the leaves of an implicit tree with
``WIDTH`` children a node; a level is two arrays. A block of rays meets the whole top level at once, then
each pair of a ray and a node it meets is replaced by those with the node's children: the front of a
breadth-first walk. This happens in float32 about the scene's centre, with boxes that are larger by
more than float32 can be wrong, so that rounding never loses one.
"""

from __future__ import annotations

import numpy as np

WIDTH = 8  # children of a node
TOP = 64  # nodes that every ray is tested against
BLOCK = 2048  # rays at a time: their pairs stay in the cache
WIDER = np.float32(1 + 4e-6)  # more than a distance is wrong after its few operations
TINY = 1e-30  # stands for a direction's zero, so that there is no 0/0

Pairs = tuple[np.ndarray, np.ndarray, np.ndarray]  # ray (P,), box (P,), entry (P,)
Box = tuple[np.ndarray, np.ndarray]  # smallest and largest coordinates, (3, ...) each


class BoxTree:
    """Boxes from (I, 3) to (I, 3), metres; those with NaN are never met."""

    def __init__(self, low: np.ndarray, high: np.ndarray) -> None:
        known = np.flatnonzero(np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1))
        low, high = low[known], high[known]
        self._low, self._high = low.min(axis=0, initial=np.inf), high.max(axis=0, initial=-np.inf)
        self._centre = (self._low + self._high) / 2 if len(known) else np.zeros(3)
        size = float((self._high - self._low).max()) if len(known) else 0.0
        self._slack = 4e-7 * size + 1e-7
        low, high = low - self._centre - self._slack, high - self._centre + self._slack
        order = np.argsort(morton(low + high), kind="stable")
        self._number = known[order]
        self._levels = _levels(low[order].T, high[order].T)

    def pairs(
        self, origins: np.ndarray, directions: np.ndarray, start: np.ndarray, limit: np.ndarray
    ) -> Pairs:
        """Rays, the boxes that each meets between ``start`` and ``limit``, and where it enters them.

        origins, directions : (3, R) finite, unit directions. start, limit : (R,) metres from the origin.

        Returns ray (P,), box (P,) and entry (P,) metres, by ray and then by entry. The entry is
        ``start`` inside of a box, and never later than in truth.
        """
        slope = inverse(directions)
        low, high = self._low - self._slack, self._high + self._slack
        enters, leaves = clip(low, high, origins, directions, start, limit)
        rays = np.flatnonzero(enters <= leaves)
        parts = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))]
        for first in range(0, len(rays), BLOCK):
            block = rays[first : first + BLOCK]
            begin = enters[block]
            ray, box, entry = self._meet(
                (origins[:, block] - self._centre[:, None] + begin * directions[:, block]).astype(
                    "f4"
                ),
                slope[:, block].astype("f4"),
                ((leaves[block] - begin) * WIDER + self._slack).astype("f4"),
            )
            order = np.lexsort((entry, ray))
            ray, entry = ray[order], entry[order] / WIDER
            parts.append((block[ray], box[order], begin[ray] + entry))
        ray, box, entry = (np.concatenate(part) for part in zip(*parts, strict=True))
        return ray, box, entry

    def _meet(self, origin: np.ndarray, slope: np.ndarray, limit: np.ndarray) -> Pairs:
        """Pairs of a block of rays (3, R), float32 about the centre, in no order."""
        low, high = self._levels[0]
        top = (low[:, None], high[:, None])
        entry, leave = slabs(origin[:, :, None], slope[:, :, None], top)
        ray, node = np.nonzero(_meets(entry, leave, limit[:, None]))
        entry = entry[ray, node]
        for low, high in self._levels[1:]:
            children = (
                low.reshape(3, -1, WIDTH).take(node, 1),
                high.reshape(3, -1, WIDTH).take(node, 1),
            )
            at, slopes = origin.take(ray, 1)[:, :, None], slope.take(ray, 1)[:, :, None]
            entry, leave = slabs(at, slopes, children)
            meets = _meets(entry, leave, limit.take(ray)[:, None]).ravel().nonzero()[0]
            pair, child = meets // WIDTH, meets % WIDTH
            entry = entry.ravel().take(meets)
            ray, node = ray.take(pair), node.take(pair) * WIDTH + child
        return ray, self._number[node], entry


def clip(
    low: np.ndarray,
    high: np.ndarray,
    origins: np.ndarray,
    directions: np.ndarray,
    start: np.ndarray | float,
    limit: np.ndarray | float,
) -> tuple[np.ndarray, np.ndarray]:
    """Distances at which rays (3, R) enter and leave a box (3,), (3,), within their limits; leave < enter:
    never."""
    enters, leaves = slabs(origins, inverse(directions), (low, high), start)
    return enters, np.minimum(leaves, limit, out=leaves)


def extents(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(2, D) least and most of straight ways from (R, 3) to (R, 3) along fixed directions."""
    # Not by BLAS, whose threads wait for each other longer than so few sums take.
    ends = [np.einsum("di,ir->dr", SIDES, points.T.copy()) for points in (begin, end)]
    least = np.minimum(*(each.min(axis=1) for each in ends))
    return np.stack([least, np.maximum(*(each.max(axis=1) for each in ends))])


def within(low: np.ndarray, high: np.ndarray, between: np.ndarray) -> np.ndarray:
    """(I,) whether boxes from (I, 3) to (I, 3) may come into a bundle of ways (2, D), see ``extents``."""
    middle, half = (low + high) / 2, (high - low) / 2
    at, out = middle @ SIDES.T, half @ np.abs(SIDES).T
    return np.asarray(((at - out <= between[1]) & (at + out >= between[0])).all(axis=1))


def swept(boxes: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest coordinates (P, 3) that parts in boxes (P, 2, 3) have at places (K, P, 3, 4).

    Between knots every point goes straight, so it stays in the box of both.
    """
    middle, half = boxes.mean(axis=1), (boxes[:, 1] - boxes[:, 0]) / 2
    centre = np.einsum("kpij,pj->kpi", places[..., :3], middle) + places[..., 3]
    out = np.einsum("kpij,pj->kpi", np.abs(places[..., :3]), half)
    return (centre - out).min(axis=0), (centre + out).max(axis=0)


def inverse(directions: np.ndarray) -> np.ndarray:
    """1 over each coordinate; a zero counts as TINY."""
    small = np.abs(directions) < TINY
    if small.any():
        directions = np.where(small, TINY, directions)
    return 1.0 / directions


def slabs(
    origin: np.ndarray, slope: np.ndarray, box: Box, start: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Distances at which rays enter boxes, not before ``start``, and leave them; slope is
    1/direction."""
    low, high = box
    entry, leave = start, np.inf
    for axis in range(3):
        a = low[axis] - origin[axis]
        a *= slope[axis]
        b = high[axis] - origin[axis]
        b *= slope[axis]
        near, far = np.minimum(a, b), np.maximum(a, b, out=b)
        entry = np.maximum(near, entry, out=near)
        leave = np.minimum(leave, far, out=far)
    return np.asarray(entry), np.asarray(leave)


def _meets(entry: np.ndarray, leave: np.ndarray, limit: np.ndarray) -> np.ndarray:
    return entry <= np.minimum(leave * WIDER, limit)


def _levels(low: np.ndarray, high: np.ndarray) -> list[Box]:
    """Boxes (3, n) and the levels above them, from the top; padded by boxes that are never met."""
    levels = []
    while low.shape[1] > TOP:
        pad = ((0, 0), (0, -low.shape[1] % WIDTH))
        low = np.pad(low, pad, constant_values=np.nan)
        high = np.pad(high, pad, constant_values=np.nan)
        levels.append((low, high))
        low = np.fmin.reduce(low.reshape(3, -1, WIDTH), axis=2)
        high = np.fmax.reduce(high.reshape(3, -1, WIDTH), axis=2)
    levels.append((low, high))
    return [(low.astype("f4"), high.astype("f4")) for low, high in reversed(levels)]


def morton(centre: np.ndarray) -> np.ndarray:
    """(n,) place of points (n, 3) along a Morton curve: the bits of x, y and z in turn."""
    if not len(centre):
        return np.empty(0, dtype=np.int64)
    axes = np.ascontiguousarray(centre.T)
    low = [float(x.min()) for x in axes]
    spread = max(*(float(x.max()) - least for x, least in zip(axes, low, strict=True)), 1e-30)
    code = np.zeros(len(centre), dtype=np.int64)
    for axis, (x, least) in enumerate(zip(axes, low, strict=True)):
        x = x - least
        x /= spread
        x *= 1023
        code |= APART.take(x.astype(np.int64), mode="clip") << axis
    return code


APART = np.arange(1024)  # ten bits of each number, two zeros between them
for _shift, _mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
    APART = (APART | APART << _shift) & _mask
_TURNS = np.arange(24) * np.pi / 24
# (D, 3) unit directions along which bundles of ways are measured: level ones, and the vertical.
SIDES = np.column_stack([np.cos(_TURNS), np.sin(_TURNS), np.zeros(24)])
SIDES = np.concatenate([SIDES, [[0.0, 0.0, 1.0]]])
