"""The volume that a skeleton's wood fills, by random points in all segments: slow, sees every overlap."""

import numpy as np


def union_volume(skeleton, points=12_000, seed=0):
    """m³: each point stands for its segment's volume over its number of points and of segments around it."""
    rng = np.random.default_rng(seed)
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    r1, r2 = skeleton.radius.T
    volume = np.pi * length * (r1**2 + r1 * r2 + r2**2) / 3
    number = np.where(length > 1e-9, np.maximum(4, points * volume / volume.sum()), 0).astype(int)
    segment = np.repeat(np.arange(len(length)), number)
    way = (skeleton.end - skeleton.start) / np.maximum(length, 1e-300)[:, None]
    side = np.cross(way, np.eye(3)[np.abs(way).argmin(axis=1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    across = np.cross(way, side)

    along = rng.random((len(segment), 12))  # a thick end has more: the first that is not refused
    thick = (r1[segment, None] + (r2 - r1)[segment, None] * along) ** 2
    taken = rng.random(along.shape) * np.maximum(r1, r2)[segment, None] ** 2 < thick
    along = along[np.arange(len(segment)), taken.argmax(axis=1)]
    out = (r1[segment] + (r2 - r1)[segment] * along) * np.sqrt(rng.random(len(segment)))
    turn = 2 * np.pi * rng.random(len(segment))
    place = skeleton.start[segment] + (along * length[segment])[:, None] * way[segment]
    place += (out * np.cos(turn))[:, None] * side[segment]
    place += (out * np.sin(turn))[:, None] * across[segment]

    around = np.zeros(len(place))
    for s in np.flatnonzero(length > 1e-9):
        foot = place - skeleton.start[s]
        above = foot @ way[s]
        square = np.einsum("pk,pk->p", foot, foot) - above**2
        share = above / length[s]
        radius = r1[s] + (r2[s] - r1[s]) * share
        within = (share >= -1e-12) & (share <= 1 + 1e-12)
        around += within & (square <= radius**2 * (1 + 1e-9))
    return float(np.sum(volume[segment] / number[segment] / np.maximum(around, 1)))
