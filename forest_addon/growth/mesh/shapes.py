"""Leaves of species: outline, midrib, stalk and bend, as facets in a blade's unit frame.

A blade is given by one half of its outline, from foot to tip. Facets join it to the midrib, along which the
halves are folded upwards; the whole is bent down along a circle. The stalk comes before it: both together are
the leaf's length. There are two blades of each shape, of equal area: one of few facets for trees, and one
with teeth, lobes and a bent midrib for what is seen from close by.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ...spec import Leaf
from .blades import SHAPES, Blade

CLOSE = 0.001  # metres of tolerance, below which leaves have all their facets
FOLD = 0.10  # height of an edge over the midrib, of the blade's width
STALK = 0.014  # half the width of a stalk, of the blade's width
FINE_RIBS = np.array([0.2, 0.4, 0.6, 0.8])

Outline = np.ndarray  # (K, 2): along the blade from 0 to 1, and half its width up to 0.5


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


def _birch() -> tuple[Outline, Outline]:
    whole = np.array(
        [
            [0, 0],
            [0.08, 0.26],
            [0.2, 0.45],
            [0.3, 0.5],
            [0.5, 0.36],
            [0.75, 0.14],
            [0.9, 0.04],
            [1, 0],
        ]
    )
    return np.array([[0.14, 0.42], [0.36, 0.46], [0.70, 0.17]]), _toothed(whole, 9, 0.10)


def _oak() -> tuple[Outline, Outline]:
    fine = np.array(
        [
            *([0.06, 0.06], [0.14, 0.13], [0.20, 0.22], [0.26, 0.14], [0.33, 0.30], [0.39, 0.38]),
            *([0.44, 0.20], [0.50, 0.40], [0.57, 0.50], [0.63, 0.26], [0.70, 0.40], [0.77, 0.43]),
            *([0.81, 0.24], [0.88, 0.30], [0.93, 0.27], [0.95, 0.14], [0.99, 0.10]),
        ]
    )
    return np.array([[0.35, 0.30], [0.62, 0.44], [0.88, 0.27]]), fine


def _palmate() -> tuple[Outline, Outline]:
    light = np.array(
        [
            *([-0.04, 0.26], [0.16, 0.24], [0.32, 0.50], [0.42, 0.28], [0.78, 0.40]),
            *([0.62, 0.14],),
        ]
    )
    fine = np.array(
        [
            *([-0.05, 0.12], [-0.04, 0.27], [0.06, 0.26], [0.10, 0.34], [0.17, 0.30], [0.20, 0.38]),
            *([0.24, 0.40], [0.33, 0.52], [0.33, 0.40], [0.40, 0.40], [0.38, 0.27], [0.48, 0.33]),
            *([0.56, 0.40], [0.60, 0.36], [0.80, 0.42], [0.70, 0.30], [0.72, 0.24], [0.60, 0.13]),
            *([0.70, 0.145], [0.78, 0.155], [0.84, 0.09], [0.90, 0.08]),
        ]
    )
    return light, fine


HALVES = {"beech": _beech, "birch": _birch, "oak": _oak, "palmate": _palmate}


@lru_cache(maxsize=64)
def leaf_blade(leaf: Leaf, tolerance: float) -> Blade:
    """The blade of a species' leaf.

    tolerance : of the tree's mesh, metres; below a millimetre the blade has all its facets.
    """
    if leaf.shape not in HALVES:
        return SHAPES[leaf.shape]()
    light, fine = HALVES[leaf.shape]()
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
    found = []
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
            found.append(corners)
    return found


def _around(edge: list[int], line: list[int], flat: np.ndarray) -> list[list[int]]:
    """Triangles between an outline and the middle of the blade, from which all of it is seen."""
    return [[line[1], a, b] for a, b in pairwise(edge)]
